"""Level-1 files as any program could write them: pairs of an image in electrons and its mask, and a few keywords."""

from pathlib import Path

import numpy as np
from astropy.io import fits

from cpic_planner.validation import calibrated_frames, moved, observe_off_mask
from simulator import load_scene, observe

BAND, EXPOSURE_S, GAIN, SIDE = "F662", 10.0, 20.0, 137


def write_pairs(path, electrons, usable, pixel_scale, star=(SIDE // 2, SIDE // 2), **header):
    """Write frames; ``star`` is its column and row, from 0."""
    units = [fits.PrimaryHDU()]
    known = {"OBSTYPE": "SCI", "FILTER": BAND, "EXPTIME": EXPOSURE_S, "EMGAIN": GAIN, "POS_ANG0": 0.0}
    for key, value in (known | header).items():
        units[0].header[key] = value
    for image, good in zip(electrons, usable, strict=True):
        own = fits.ImageHDU(np.asarray(image, "f4"))
        own.header["CRPIX1"], own.header["CRPIX2"], own.header["PIXSCALE"] = star[0] + 1, star[1] + 1, pixel_scale
        units += [own, fits.ImageHDU(np.where(good, 0, 1).astype("u1"))]
    path.parent.mkdir(parents=True, exist_ok=True)
    fits.HDUList(units).writeto(path)


def scenes(*, planet=True):
    """Return what science and reference visits see: alpha Cen B with or without its planet, without other stars."""
    whole = load_scene("paper_science").model_copy(update={"stars": ()})
    return (whole if planet else whole.without_planets()), whole.without_planets()


def write_programme(folder, seed, *, frames=8, visits=1, planet=True, jitter=None, rolls_deg=(0.0, 0.0), shown=None):
    """Write the visits of a programme, every effect of the camera on; frames of visit v are moved by ``jitter[v]``.

    ``shown`` are the scenes of science and reference visits, those of `scenes` by default.
    """
    seen_by = zip(("science", "reference"), shown or scenes(planet=planet), rolls_deg, strict=True)
    for role, scene, roll_deg in seen_by:
        for visit in range(visits):
            seen = observe(
                scene,
                band=BAND,
                exposure_s=EXPOSURE_S,
                n_frames=frames,
                em_gain=GAIN,
                seed=seed,
                role=role,
                visit=visit,
                visits=visits,
                roll_deg=roll_deg,
                window="hole",
                fidelity="quick",
                max_epochs=2,
            )
            made, star = calibrated_frames(seen), scene.cstar
            x, y = (0.0, 0.0) if jitter is None else jitter[visit]
            electrons = [moved(image, x, y) if x or y else image for image in made.electrons]
            where = {"RA_OBJ": star.ra_deg, "DEC_OBJ": star.dec_deg, "POS_ANG0": roll_deg, "OBJECT": "alpha Cen B"}
            told = {"ROLE": role, "VISIT": visit + 1, "EXPSTART": 61771.0 + visit}
            path = Path(folder) / f"{role}_{visit + 1}.fits"
            write_pairs(path, electrons, made.usable, seen.psf.pixel_scale_arcsec, **where, **told)
    return seen


def write_off_mask(folder, seed):
    """Write a series of the star beside the mask; return its true rate, e-/s."""
    seen = observe_off_mask(scenes()[1], BAND, n_frames=10, seed=seed, fidelity="quick").unwrap()
    made, (x, y), pixel = calibrated_frames(seen), seen.star_offset_arcsec, seen.psf.pixel_scale_arcsec
    star = seen.area.centre[1] + x / pixel, seen.area.centre[0] + y / pixel
    told = {"OBSTYPE": "CALS", "ROLE": "calibration", "STAROFFX": x, "STAROFFY": y, "EXPTIME": seen.exposure_s}
    write_pairs(Path(folder) / "off_mask.fits", made.electrons, made.usable, pixel, star, **told, EMGAIN=1.0)
    return seen.truth.sources[0].rate_e_s
