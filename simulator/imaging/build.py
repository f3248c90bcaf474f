"""The optical model of a band, put together from the configuration, and the state of its mirror.

The state is shipped for every instrument preset and cached for any other. It is valid for a content key: apodizer,
telescope, band, zone, static wavefront, mirror and control, but not the resolution and noise of the mirror's
electronics, which act on the finished command.
"""

import functools
import hashlib
import logging
import math
from collections.abc import Mapping
from dataclasses import astuple, replace
from typing import Any

import numpy as np

from catalogs import Spectrum, load_reference_spectrum
from cpic_core import FloatArray, InputError, NDArray, announce, compute_once, read_npz, stream
from simulator.config import Instrument, content_hash
from simulator.imaging import dark_hole, pupil
from simulator.imaging.deformable_mirror import DeformableMirror, load_dm_surface
from simulator.imaging.imager import Imager
from simulator.imaging.zones import HoleStatus, HoleZone, zone_of
from simulator.knobs import Knobs, resolve_knobs
from simulator.passbands import Passbands

_LOG = logging.getLogger(__name__)
MAX_SAMPLES = 2048


def configured_mirror(instrument: Instrument) -> DeformableMirror:
    """Return the mirror of an instrument."""
    return DeformableMirror(**dict(instrument.mirror))


def aberrations_of(instrument: Instrument) -> pupil.Aberrations | None:
    """Return an instrument's static aberrations without its mirror, the star held on the mask; None if it has none."""
    wavefront = instrument.wavefront
    if wavefront.perfect:
        return None
    drawn = pupil.draw_aberrations(
        wavefront.seed,
        samples=wavefront.samples,
        opd_rms_nm=wavefront.opd_rms_nm,
        amplitude_rms=wavefront.amplitude_rms,
        psd_slope=wavefront.psd_slope,
    )
    return drawn.pointed(pupil.cell_means(pupil.configured_apodizer(instrument), wavefront.samples))


def bare_imager(
    instrument: Instrument, band: str, fidelity: str | Knobs = "standard", *, spectrum: Spectrum | None = None
) -> Imager:
    """Return the optical model without aberrations and mirror: apodizer, cross, pixels and jitter.

    Parameters
    ----------
    instrument : Instrument
    band : str
    fidelity : str or Knobs
    spectrum : Spectrum, optional
        Photon spectrum that weights the wavelengths; the Sun's if omitted.

    Raises
    ------
    InputError
        For a table, an unknown band or fidelity, a spectrum that does not cover the band, or an apodizer whose steps
        and the grid of the static wavefront have no common grid of at most 2048 samples.
    """
    if instrument.coronagraph.table is not None:
        allowed = "an instrument with modelled optics: a table has no wavefront"
        raise InputError("coronagraph.table", instrument.name, allowed=allowed)
    knobs = resolve_knobs(fidelity)
    instrument.band(band)
    passbands = Passbands.from_instrument(instrument)
    light = load_reference_spectrum("sun") if spectrum is None else spectrum
    nodes = knobs.wavelength_nodes + _extra_nodes(instrument, band, knobs)
    wavelength_nm, weights = passbands.wavelength_nodes(band, nodes, spectrum=light)
    apodizer = pupil.configured_apodizer(instrument)
    zone = zone_of(instrument, band)
    assert isinstance(zone, HoleZone)
    return Imager(
        band=band,
        wavelengths_m=wavelength_nm * 1e-9,
        weights=weights,
        diameter_m=instrument.telescope.diameter_m,
        transmission=pupil.upsample(apodizer, _grid(len(apodizer), instrument, band, knobs)),
        pixel_scale_arcsec=instrument.pixel_scale_arcsec(band),
        mask_half_width_arcsec=instrument.mask_half_width_arcsec(band),
        aperture_radius_arcsec=instrument.aperture_radius_arcsec(band),
        zone=zone,
        lambda_d_arcsec=instrument.lambda_d_arcsec(band),
        knobs=knobs,
        jitter_arcsec=instrument.wavefront.jitter_mas * 1e-3,
    )


def build_imager(
    instrument: Instrument, band: str, fidelity: str | Knobs = "standard", *, spectrum: Spectrum | None = None
) -> Imager:
    """Return the optical model of one band of an instrument, aberrations and mirror included.

    Parameters
    ----------
    instrument : Instrument
    band : str
    fidelity : str or Knobs
        ``quick``, ``standard``, ``reference``, or the settings themselves. The pupil grid has at least
        ``pupil_samples`` samples: the next multiple of the steps of apodizer and static wavefront.
    spectrum : Spectrum, optional
        Photon spectrum that weights the wavelengths; the Sun's if omitted. Between stars of type F and K the core
        throughput changes by less than 1e-3 of itself.

    Raises
    ------
    InputError
        As `bare_imager`, or for an unusable surface of the mirror.
    """
    bare = bare_imager(instrument, band, fidelity, spectrum=spectrum)
    static = static_wavefront(instrument, band)
    if static is None:
        return bare
    return replace(bare, static=static.upsampled(len(bare.transmission)))


def static_wavefront(instrument: Instrument, band: str) -> pupil.Aberrations | None:
    """Return the aberrations with the mirror as it stands in one band; None if both are flat.

    Parameters
    ----------
    instrument : Instrument
    band : str
        Name of a band of the instrument, such as ``F520``.
    """
    aberrations, control = aberrations_of(instrument), instrument.dark_hole.control
    if control == "off":
        return aberrations
    if control == "surface":
        surface = _surface(instrument, band)
        samples = math.lcm(len(surface), instrument.wavefront.samples)
        aberrations = aberrations or pupil.flat_aberrations(instrument.wavefront.samples)
        return aberrations.upsampled(samples).plus_opd(2.0 * pupil.upsample(surface, samples))
    solver, aberrations, mirror = _bench(instrument, band)
    state = hole_state(instrument, solver, aberrations, mirror)
    if instrument.wavefront.perfect and not state.commands_nm.any():
        return None
    samples = len(solver.transmission)
    commands = mirror.realise(state.commands_nm, stream(instrument.wavefront.seed, "mirror_noise", band))
    return aberrations.plus_opd(mirror.opd_nm(commands, samples))


def dark_hole_of(instrument: Instrument, band: str) -> dark_hole.DarkHole:
    """Return the dark hole of one band: shipped, cached or dug now; see `hole_state`.

    Parameters
    ----------
    instrument : Instrument
    band : str
        Name of a band of the instrument, such as ``F520``.

    Raises
    ------
    InputError
        If the instrument's mirror is off or loaded from a file, or the band is unknown.
    """
    if instrument.dark_hole.control in ("off", "surface"):
        raise InputError("dark_hole.control", instrument.dark_hole.control, allowed="conjugation, single_jacobian")
    return hole_state(instrument, *_bench(instrument, band))


def hole_state_of(instrument: Instrument, band: str, mean_contrast: float) -> HoleStatus:
    """Return whether the hole of the images is as dark as asked.

    Parameters
    ----------
    instrument : Instrument
    band : str
    mean_contrast : float
        Mean raw contrast of the images in the hole: with the commands as the electronics make them.

    Returns
    -------
    str
        ``reached``; ``not_reached``, by the search or by half as much again in the images; ``none`` where no search
        sets the mirror.
    """
    if instrument.dark_hole.control in ("off", "surface"):
        return "none"
    state = dark_hole_of(instrument, band)
    dark = state.reached and mean_contrast <= 1.5 * state.limit_contrast
    return "reached" if dark else "not_reached"


def dig(instrument: Instrument, band: str) -> tuple[dark_hole.DarkHole, str]:
    """Return the search for the hole of one band whatever is stored, and the key to store it under.

    Parameters
    ----------
    instrument : Instrument
    band : str
        Name of a band of the instrument, such as ``F520``.
    """
    bench = _bench(instrument, band)
    return search(instrument, *bench), hole_key(instrument, bench[0])


def _bench(instrument: Instrument, band: str) -> tuple[Imager, pupil.Aberrations, DeformableMirror]:
    """Return what the search for a hole works with: bare optics, aberrations on their grid, mirror."""
    solver = bare_imager(instrument, band, Knobs(wavelength_nodes=5))
    aberrations = aberrations_of(instrument) or pupil.flat_aberrations(instrument.wavefront.samples)
    return solver, aberrations.upsampled(len(solver.transmission)), configured_mirror(instrument)


def _extra_nodes(instrument: Instrument, band: str, knobs: Knobs) -> int:
    """Return the wavelengths to add if a wide band moves the speckles at the hole's rim by over two lambda/D."""
    passbands = Passbands.from_instrument(instrument)
    low, high = passbands.bands[passbands.index(band)].support_nm
    rim = math.sqrt(2.0) * instrument.hole_outer_arcsec(band) / instrument.lambda_d_arcsec(band)
    moved = rim * (high - low) / instrument.band(band).center_nm
    return max(0, math.ceil(1.1 * (moved - 2.0))) if knobs.wavelength_nodes > 1 else 0


def _surface(instrument: Instrument, band: str) -> FloatArray:
    """Return the loaded surface of the mirror in one band, nm."""
    path = instrument.dark_hole.surface_files.get(band)
    if path is None:
        raise InputError("dark_hole.surface_files", band, allowed="a surface for every band in use")
    surface = load_dm_surface(path)
    if math.lcm(len(surface), instrument.wavefront.samples) > MAX_SAMPLES:
        allowed = f"a map that shares a grid with the {instrument.wavefront.samples} samples of the static wavefront"
        raise InputError("dark_hole.surface_files", path, allowed=allowed, hint=f"it has {len(surface)} samples a side")
    return surface


def _grid(steps: int, instrument: Instrument, band: str, knobs: Knobs) -> int:
    """Return the samples across the pupil: a multiple of those of apodizer, static wavefront and loaded surface."""
    flat = instrument.wavefront.perfect and instrument.dark_hole.control == "off"
    common = steps if flat else math.lcm(steps, instrument.wavefront.samples)
    if instrument.dark_hole.control == "surface":
        common = math.lcm(common, len(_surface(instrument, band)))
    samples = common * max(1, math.ceil(knobs.pupil_samples / common))
    if samples > MAX_SAMPLES:
        allowed = f"a grid that shares one of at most {MAX_SAMPLES} samples with the {steps} steps of the apodizer"
        hint = "set coronagraph.apodizer_samples to that number"
        raise InputError("wavefront.samples", instrument.wavefront.samples, allowed=allowed, hint=hint)
    return samples


METHOD: dict[str, dark_hole.HoleMethod] = {"conjugation": "relinearised", "single_jacobian": "single_jacobian"}


def _search_settings(instrument: Instrument, band: str) -> dark_hole.ControlSettings:
    hole = instrument.dark_hole
    usual = dark_hole.default_settings(hole.mode, METHOD[hole.control], hole.sensing_contrast_of(band))
    seed = instrument.wavefront.seed
    return replace(usual, bandwidth=hole.bandwidth, hold_star=hole.hold_star, sensing_seed=seed)


def hole_key(instrument: Instrument, solver: Imager) -> str:
    """Return the content key of the state of one band, 16 hex digits.

    Parameters
    ----------
    instrument : Instrument
    solver : Imager
        Bare optical model on the grid of the search.
    """
    settings = astuple(_search_settings(instrument, solver.band))
    parts = {
        "schema": pupil.HOLE_SCHEMA,
        "band": solver.band,
        "transmission": hashlib.sha256(solver.transmission.astype("<f8").tobytes()).hexdigest(),
        "wavelengths": pupil.rounded([*solver.wavelengths_m, *solver.weights]),
        "optics": [solver.diameter_m, solver.lambda_d_arcsec, solver.aperture_radius_arcsec, *astuple(solver.zone)],
        "wavefront": instrument.wavefront.model_dump(mode="json", exclude={"jitter_mas"}),
        "mirror": instrument.mirror.model_dump(mode="json", exclude={"bits", "noise_nm"}),
        "settings": settings if settings[-2] else settings[:-2],  # sensing has no part in a search without its errors
    }
    return content_hash(parts)


def hole_state(
    instrument: Instrument, solver: Imager, static: pupil.Aberrations, mirror: DeformableMirror
) -> dark_hole.DarkHole:
    """Return the state of the mirror in one band: from the shipped file, the cache, or a new search.

    A search of a shipped instrument takes 1 to 14 s of one processor (``make bench``), one nearer to the
    star some minutes; it is announced. A hole that was not `reached` brings one warning.
    """
    key = hole_key(instrument, solver)
    path = pupil.shipped("hole", key, solver.band)
    if path is not None:
        state = hole_from_arrays(read_npz(path), solver)
    else:
        found = functools.partial(hole_from_arrays, solver=solver)
        state = compute_once(f"hole-{key}", lambda: hole_arrays(search(instrument, solver, static, mirror)), found)
    if not state.reached:
        _warn(key, state.reason)
    return state


@functools.cache
def _warn(key: str, reason: str) -> None:
    """Say once for each hole that it was not reached: one measurement of the optics asks for it several times."""
    _LOG.warning("dark hole not reached: %s", reason)


def search(
    instrument: Instrument, solver: Imager, aberrations: pupil.Aberrations, mirror: DeformableMirror
) -> dark_hole.DarkHole:
    """Dig the hole of one band now."""
    zone = solver.zone
    takes = "seconds on a free processor, minutes where the hole is hard to reach"
    announce(f"digging the dark hole of {instrument.name} in {solver.band} ({zone.mode}), once: {takes}")
    settings = _search_settings(instrument, solver.band)
    return dark_hole.solve_dark_hole(solver, aberrations, mirror, mode=zone.mode, side=zone.side, settings=settings)


def hole_arrays(state: dark_hole.DarkHole) -> dict[str, NDArray[Any]]:
    """Return everything that an npz file needs to hold a state."""
    scores = np.array([astuple(score) for score in (state.before, state.wide, state.own)])
    return {
        "commands_nm": state.commands_nm,
        "scores": scores,
        "history": np.array(state.search.history),
        "strong": np.array(state.search.strong, dtype=bool),
        "ended": np.asarray(state.search.ended),
        "method": np.asarray(state.method),
        "limit_contrast": np.asarray(state.limit_contrast),
    }


def hole_from_arrays(arrays: Mapping[str, NDArray[Any]], solver: Imager) -> dark_hole.DarkHole:
    """Return the inverse of `hole_arrays`.

    Parameters
    ----------
    arrays : mapping of str to ndarray
        Arrays by name.
    solver : Imager
    """
    commands = np.array(arrays["commands_nm"], dtype=np.float64)
    commands.flags.writeable = False
    history = tuple(map(float, arrays["history"]))
    strong = tuple(map(bool, arrays["strong"]))
    search = dark_hole.Search(commands, history, strong, str(arrays["ended"]))  # type: ignore[arg-type]
    before, wide, own = (dark_hole.HoleScore(*map(float, row)) for row in arrays["scores"])
    limit, method = float(arrays["limit_contrast"]), str(arrays["method"])
    return dark_hole.DarkHole(solver.band, solver.zone, method, commands, search, before, wide, own, limit)  # type: ignore[arg-type]
