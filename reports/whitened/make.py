"""The filter ``whitened``: ``python -m tools.reports whitened`` makes this report anew.

What it gains over aperture sums: on visits of the optical model that it has not seen, with the covariance of another
instrument, and on images of the camera.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from cpic_core import FloatArray, write_text
from cpic_planner import validation
from cpic_planner.confirm.etc_images import grey_scene
from cpic_planner.etc import build_model, planet_offsets
from cpic_planner.queries import Strategy
from cpic_planner.targets import find_target
from cpic_planner.validation.measure import SpeckleModel, WhitenedFilter
from cpic_planner.validation.photometry import EXCLUSION_RADII, aperture_photometry, aperture_weights, outside_discs
from cpic_planner.validation.rdi import surviving_fraction
from simulator.config import Instrument, load_instrument
from simulator.imaging import Psf, centred_axis, single_band_psf, visit_responses
from simulator.knobs import FIDELITIES
from simulator.signal import REGION_LAMBDA_D, Whitening, speckle_covariance, with_noise
from simulator.signal.speckle_modes import Stamps, stamps_around

HERE = Path(__file__).resolve().parent
OFFSET_NM, HELD_OUT, SEED = 0.05, 1000, 7
PLACES = {"F520": (0.4, 0.6, 0.85), "F850": (0.52, 0.6, 0.8)}
NOISES, MIDDLE = (0.3, 1.0), 0.6
# Of an outside study with other visits and the filter over the whole hole.
ASKED = {
    "F520": {0.3: (3.2, 2.0, 1.4), 1.0: (1.6, 1.27, 1.16)},
    "F850": {0.3: (3.8, 2.3, 1.5), 1.0: (1.9, 1.33, 1.2)},
}
OTHERS: dict[str, Any] = {
    "other aberrations of the same size (wavefront.seed 2)": {"wavefront": {"seed": 2}},
    "the mirror of cpic_single_jacobian": "cpic_single_jacobian",
    "the mirror of as_published": "as_published",
}
# The last: planets at once, not at opposite places; the inner corner has room for one.
IMAGES = (("F520", 0.6, 0.3, 2), ("F520", 0.6, 1.0, 2), ("F850", 0.6, 1.0, 2), ("F520", 0.4, 0.3, 1))
STAR, VISIT_S, REALISATIONS, SNR = "bet Hyi", 1800.0, 120, 10.0
Row = dict[str, Any]


def held_out(psf: Psf, instrument: Instrument) -> FloatArray:
    """Visits of another seed than those of the covariance, over the hole, their mean taken off."""
    hole, imager = psf.geometry.hole, psf.imager
    rows, columns = (np.flatnonzero(hole.any(axis=axis)) for axis in (1, 0))
    offset = centred_axis(len(hole), imager.pixel_scale_arcsec)
    axes = [imager.axis(offset[part], masked=True) for part in (rows, columns)]
    _, linear, square = visit_responses(imager, *axes, instrument.drift.psd_slope, HELD_OUT, SEED)
    images = (OFFSET_NM * linear + OFFSET_NM**2 * square)[:, hole[np.ix_(rows, columns)]]
    return np.asarray(images - images.mean(axis=0))


def error_of(sums: FloatArray, around: Stamps, seen: FloatArray, white: float) -> FloatArray:
    """Rms of sums over visits and white noise, in units of the planets that they find."""
    variance = ((seen @ sums.T) ** 2).mean(axis=0) + white * (sums**2).sum(axis=1)
    return np.asarray(np.sqrt(variance) / (sums * around.planets).sum(axis=1))


def speckle_rms(around: Stamps, seen: FloatArray) -> float:
    """Rms of aperture sums over visits and places."""
    return float(np.sqrt(((seen @ around.apertures.T) ** 2).mean()))


def visits_rows(band: str) -> list[Row]:
    """Every place and noise of a band on visits that are held out, with the right covariance and with others."""
    instrument = load_instrument()
    psf = single_band_psf(band, instrument=instrument)
    images = held_out(psf, instrument)
    middle = stamps_around(psf, MIDDLE)
    level = speckle_rms(middle, images[:, middle.inside])
    models = {"its own": instrument} | {name: load_instrument(other) for name, other in OTHERS.items()}
    rows = []
    for place in PLACES[band]:
        around = stamps_around(psf, place)
        seen, squares = images[:, around.inside], float((around.apertures**2).sum(axis=1).mean())
        aperture = around.own - around.mean
        for noise in NOISES:
            white = (noise * level) ** 2 / squares
            plain = error_of(aperture, around, seen, white)
            row: Row = {
                "band": band,
                "arcsec": place,
                "noise": noise,
                "local": noise * level / speckle_rms(around, seen),
            }
            for name, model in models.items():
                covariance = speckle_covariance(model, band, place, OFFSET_NM**2, OFFSET_NM**4)
                whitening = Whitening(with_noise(covariance, white), np.ones((1, len(covariance))))
                error = error_of(whitening.weights(around.planets), around, seen, white)
                foreseen = 1.0 / np.sqrt((whitening.of(around.planets) ** 2).sum(axis=1))
                row[name] = {"gain": float(np.mean(plain / error)), "honest": float(np.mean(error / foreseen))}
            rows.append(row)
            print(row, flush=True)
    return rows


def image_row(band: str, place_arcsec: float, noise: float, planets: int) -> Row:
    """Images of one visit with its references: planets on the diagonals, flux and errors of both filters."""
    visits = star_visits(band, place_arcsec, noise)
    geometry, rate = visits.geometry, visits.science.truth.sources[0].rate_e_s
    pixel, middle, side = geometry.pixel_scale_arcsec, geometry.stamp_pixels // 2, geometry.stamp_pixels
    radius, away = geometry.aperture_radius_arcsec / pixel, place_arcsec / np.sqrt(2.0)
    offsets = [(x * away, y * away) for x, y in ((1, 1), (-1, 1))[:planets]]
    places = [(middle + x / pixel, middle + y / pixel) for x, y in offsets]
    templates = [visits.optics.at(*offset) for offset in offsets]
    weights = [aperture_weights((side, side), *place, radius) for place in places]
    cores = [float(np.sum(a * b)) for a, b in zip(weights, templates, strict=True)]
    model = SpeckleModel.of(visits, rate)
    first = visits.draw(0).reduced
    around = outside_discs(geometry.annulus(place_arcsec, 1.5), places, EXCLUSION_RADII * radius)
    filters = [
        WhitenedFilter(
            first,
            template,
            place,
            geometry=geometry,
            model=model,
            background_region=around & first.region,
            neighbours=tuple(other for other in templates if other is not template),
        )
        for template, place in zip(templates, places, strict=True)
    ]
    plain0 = [aperture_photometry(first.image_e, *p, radius, background_region=around & first.region) for p in places]
    strength = SNR * float(np.mean([one.sigma_background for one in plain0])) / float(np.mean(cores))  # electrons
    lit = visits.with_light(sum(templates) * strength / first.integration_s)
    settings = {"background_region": around & first.region, "factor2": first.factor2}
    found: dict[str, list[list[tuple[float, float, float]]]] = {"aperture": [], "whitened": []}
    for number in range(1, REALISATIONS + 1):
        stack = lit.draw(number).reduced
        apertures = [
            aperture_photometry(
                stack.image_e,
                *place,
                radius,
                throughput=surviving_fraction("template", t, t, w, settings["background_region"]),
                **settings,
            )
            for place, t, w in zip(places, templates, weights, strict=True)
        ]
        for name, many in (("aperture", apertures), ("whitened", [one.photometry(stack) for one in filters])):
            found[name].append(
                [
                    (p.flux / core, p.error / core, p.sigma_background / p.throughput / core)
                    for p, core in zip(many, cores, strict=True)
                ]
            )
    row: Row = {"band": band, "arcsec": place_arcsec, "noise": noise, "planets": planets}
    for name, runs in found.items():
        flux, error, sigma = np.moveaxis(np.array(runs), -1, 0)
        scatter = np.sqrt(flux.var(axis=0, ddof=1).mean())
        ratio = np.sqrt((error**2).mean()) / scatter
        row[name] = {
            "flux": float(flux.mean() / strength),
            "flux_error": float(scatter / np.sqrt(flux.size) / strength),
            "snr": float(strength / scatter),
            "reported_over_true": float(ratio),
            "ratio_error": float(ratio / np.sqrt(2.0 * flux.size)),
            "sigma": float(np.sqrt((sigma**2).mean())),
        }
    annulus = geometry.annulus(place_arcsec, REGION_LAMBDA_D)
    speckles, white = model.covariance_e2(place_arcsec, annulus, geometry), first.white_variance_e2[annulus]
    foreseen, share = [], []
    for one, weight, template, core in zip(filters, weights, templates, cores, strict=True):
        sums = weight[annulus] - weight.sum() * settings["background_region"][annulus] / around.sum()
        parts = sums @ speckles @ sums, sums**2 @ white
        foreseen.append((sum(parts) / (sums @ template[annulus]) ** 2, (one.sigma_e / core) ** 2))
        share.append(parts)
    row["foreseen"] = float(np.sqrt(np.divide(*np.mean(foreseen, axis=0))))
    row["local"] = float(np.sqrt(1.0 / np.divide(*np.mean(share, axis=0))))
    print(row, flush=True)
    return row


def star_visits(band: str, place_arcsec: float, noise: float) -> validation.VisitPair:
    """One visit with its references of a star so bright that white noise is so much of the speckles at 0.6 arcsec."""
    instrument = load_instrument()
    model = build_model(instrument, [band], Strategy(visits=1))
    star, _ = find_target(STAR)

    def pair(v_mag: float) -> validation.VisitPair:
        one = replace(star, v_mag=np.array([v_mag]))
        exposure_s = float(np.clip(10.0 ** (0.4 * (v_mag - 2.8) + 1.0), 0.2, 30.0))
        frames = validation.Frames(exposure_s, round(VISIT_S / exposure_s), 300.0, 1)
        scene = grey_scene(model, one, band, place_arcsec, 1e-14)
        expected = validation.expected_of(
            model, one, band, planet_offsets(model, one, band, place_arcsec), 1e-14, frames
        )
        task = validation.task_of(model, scene, band, frames, [expected], seed=11, fidelity="standard")
        how = replace(validation.modelling_of(task), draw="sums", knobs=FIDELITIES["quick"], epochs=2)
        return validation.visit_pair(task, modelling=how)

    first = pair(1.0)
    geometry, drawn = first.geometry, first.draw(0).reduced
    around = stamps_around(first.optics, MIDDLE)
    squares = SpeckleModel.of(first, first.science.truth.sources[0].rate_e_s)
    covariance = squares.covariance_e2(MIDDLE, geometry.annulus(MIDDLE, 2.4), geometry)
    speckle2 = float(((around.apertures @ covariance) * around.apertures).sum(axis=1).mean())
    white2 = float((around.apertures**2 @ drawn.white_variance_e2[geometry.annulus(MIDDLE, 2.4)]).mean())
    return pair(1.0 + 5.0 * np.log10(noise / np.sqrt(white2 / speckle2)))


def text_of(results: dict[str, Any]) -> str:
    """The report."""
    lines = [
        "# The filter whitened by the optical model",
        "",
        "`python -m tools.reports whitened` writes this report. `filter: whitened` weighs pixels by the inverse "
        "covariance of speckles and noise that the optical model foresees. It takes for granted that the model is that "
        "of this very instrument. Gains are ratios of SNR over aperture sums with the mean of the annulus taken off, "
        f"at a drift of {OFFSET_NM} nm.",
        "",
        f"## On {HELD_OUT} visits that it has not seen",
        "",
        "Noise: rms of white noise in aperture sums over that of the speckles of a visit at 0.6 arcsec; local: at the "
        "place. Honest: scatter over the error that the covariance foresees. Asked: what the study found that proposed "
        "the filter.",
        "",
        "| band | arcsec | noise | local | gain asked | gain | honest |",
        "|---|---|---|---|---|---|---|",
    ]
    visits = results.get("visits", [])
    for row in visits:
        own = row["its own"]
        asked = ASKED[row["band"]][row["noise"]][PLACES[row["band"]].index(row["arcsec"])]
        lines.append(
            f"| {row['band']} | {row['arcsec']} | {row['noise']} | {row['local']:.2f} | {asked} | {own['gain']:.2f} | "
            f"{own['honest']:.3f} |"
        )
    lines += [
        "",
        "## With the covariance of another instrument",
        "",
        "The same visits, the filter made for an instrument whose field in the dark hole is another one: gain, and in "
        "brackets scatter over the error that is foreseen. The photometry does not give that error but the scatter at "
        "other places.",
        "",
        "| band | arcsec | noise | " + " | ".join(OTHERS) + " |",
        "|---" * (3 + len(OTHERS)) + "|",
    ]
    for row in visits:
        cells = " | ".join(f"{row[name]['gain']:.2f} ({row[name]['honest']:.1f})" for name in OTHERS)
        lines.append(f"| {row['band']} | {row['arcsec']} | {row['noise']} | {cells} |")
    lines += [
        "",
        "## On images",
        "",
        f"One visit of {VISIT_S / 60:.0f} min and as long a reference, drift and walk as in `cpic_default`, drawn "
        f"{REALISATIONS} times with the noise of the camera; planets of SNR {SNR:.0f} before their own noise on the "
        "diagonals; the filter of the white noise of one more realisation. Reported over true: rms of the reported "
        "errors over the scatter of the fluxes. Gain: of the scatter, right to a tenth, beside what the covariance "
        "foresees at these very places. A planet at the opposite place would cost a tenth of it: the speckles there "
        "tell of those here.",
        "",
        "| band | arcsec | noise | planets | local | gain foreseen | gain | aperture: flux | reported over true | "
        "whitened: flux | reported over true | SNR, true |",
        "|---|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for row in results.get("images", []):
        plain, white = row["aperture"], row["whitened"]
        cells = [
            f"{one['flux']:.3f} ± {one['flux_error']:.3f} | {one['reported_over_true']:.3f} ± {one['ratio_error']:.3f}"
            for one in (plain, white)
        ]
        lines.append(
            f"| {row['band']} | {row['arcsec']} | {row['noise']} | {row['planets']} | {row['local']:.2f} | "
            f"{row['foreseen']:.2f} | {white['snr'] / plain['snr']:.2f} | {' | '.join(cells)} | "
            f"{plain['snr']:.1f}, {white['snr']:.1f} |"
        )
    return "\n".join(lines) + "\n"


def main() -> None:
    """Work everything out and write the report."""
    results = {
        "visits": [row for band in PLACES for row in visits_rows(band)],
        "images": [image_row(*case) for case in IMAGES],
    }
    write_text(HERE / "report.md", text_of(results))


if __name__ == "__main__":
    main()
