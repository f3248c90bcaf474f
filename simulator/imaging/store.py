"""The store of `PsfMetrics`: shipped for every instrument preset, cached for any other.

A file is valid for the content key in its name: the apodizer's values, telescope, geometry of mask and hole, static
wavefront, mirror and its control, jitter, pixel scale, band edges and spectral slope of the drift; not detector noise,
optical transmission or the size of the drift. Presets whose optics are the same share a file.

The visible bands of the default instrument are stored exactly, but for the map of the wings, whose values are rounded
by less than 6e-8 of themselves, and not deflated. To keep the package small, the maps and profiles of all others are
rounded, each value by less than 4e-6 of itself (1.3e-4 in the map of the wings), and the map of apertures around a
source is in all files, by less than 0.8 %, which averages over the many apertures that are ever asked for: far below
the difference between this optical model and any real instrument.

Between measured states of the mirror there are the figures of a band for any mean raw contrast. The mirror of a state
is set from a field that is sensed with errors, from none to ten times those that leave the contrast which is published
of the instrument (preset ``as_published``). Every state is measured on images of the whole optical model. Between two
of them the masked starlight is a mixture of both: where the errors of the field add to what is left without them,
intensities are linear in the square of the errors. No state's light is scaled.

Files of the states of the default instrument hold no maps of the far wings of an unmasked source, which are those of
its own state: they differ by some per cent, and only light of companions is read from them.
"""

from __future__ import annotations

import functools
import hashlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from cpic_core import (
    InputError,
    Keyed,
    NDArray,
    announce,
    compute_once,
    numeric_context,
    of_byte_planes,
    overlap_weights,
    read_npz,
)
from simulator.config import CoronagraphTable, Instrument, content_hash, load_instrument
from simulator.imaging.aperture import aperture_sums
from simulator.imaging.metrics import PsfMetrics
from simulator.imaging.pupil import HOLE_SCHEMA, configured_apodizer, rounded, shipped, shipped_file
from simulator.imaging.zones import zone_of
from simulator.knobs import Knobs


@functools.lru_cache(maxsize=16)
def _shipped_metrics(path: Path, pupil_steps: int) -> PsfMetrics:
    """Return the metrics of a file in the package: it takes longer to unpack them than to use them."""
    return replace(PsfMetrics.from_arrays(unpacked(read_npz(path))), pupil_steps=pupil_steps)


SENSING = ("sensing", "sensing_contrast", "sensing_contrast_by_band")  # keys that a hole without its errors lacks
WING_NODES = 12  # wavelengths that far wings need
TABLE_SCHEMA = 1  # raise when the meaning of a table changes
SCHEMA = 8  # raise when the meaning of a stored number or the optical model changes
EXACT_DIGITS = {"wing_map": 22, "aperture_map": 7, "filter_gain": 13, "filter_linear": 13}
DIGITS = EXACT_DIGITS | {
    "column_light": 18,
    "core_table": 18,
    "raw_contrast": 18,
    "column_profile": 18,
    "wing_profile": 18,
    "wing_map": 13,
}
"""Binary digits that a rounded file keeps of each value, and an exact one of the large maps and of filters."""


def metrics_key(instrument: Instrument, band: str) -> str:
    """Return the content key of a band's metrics, 16 hex digits.

    Parameters
    ----------
    instrument : Instrument
    band : str
        Name of a band of the instrument, such as ``F520``.
    """
    configuration = instrument.band(band)
    if (table := instrument.table(band)) is not None:
        return _table_key(instrument, band, table)
    mask = configured_apodizer(instrument)
    edges: Any = [configuration.center_nm, configuration.width_nm]
    if configuration.transmission_file is not None:
        from simulator.passbands import Passbands

        nodes = Passbands.from_instrument(instrument).wavelength_nodes(band, Knobs().wavelength_nodes)
        edges = [*edges, *(rounded(part) for part in nodes)]
    surface = instrument.dark_hole.surface_files.get(band)
    if surface:
        from simulator.imaging.deformable_mirror import load_dm_surface

        surface = hashlib.sha256(load_dm_surface(surface).astype("<f8").tobytes()).hexdigest()
    zone = zone_of(instrument, band)
    sensing = instrument.dark_hole.sensing_contrast_of(band)
    mask_arcsec = instrument.mask_half_width_arcsec(band)
    aperture_arcsec = instrument.aperture_radius_arcsec(band)
    pixel_arcsec = instrument.pixel_scale_arcsec(band)
    parts = {
        "schema": [SCHEMA, HOLE_SCHEMA],
        "fields": sorted(field.name for field in fields(PsfMetrics) if field.default is MISSING),
        "band": band,
        "edges": edges,
        "apodizer": hashlib.sha256(mask.astype("<f8").tobytes()).hexdigest(),
        "telescope": {"diameter_m": instrument.telescope.diameter_m},
        "geometry": [zone.inner_arcsec, zone.outer_arcsec, mask_arcsec, aperture_arcsec, pixel_arcsec],
        "wavefront": instrument.wavefront.model_dump(mode="json"),
        "mirror": instrument.mirror.model_dump(mode="json"),
        "dark_hole": instrument.dark_hole.model_dump(mode="json", exclude={"surface_files", *SENSING})
        | ({"sensing": sensing} if sensing else {}),
        "surface": surface,
        "psd_slope": instrument.drift.psd_slope,
        "knobs": Knobs().model_dump(mode="json"),
    }
    return content_hash(parts)


def _table_key(instrument: Instrument, band: str, table: CoronagraphTable) -> str:
    """Return the content key of the metrics of a table: its content, and what `table_metrics` reads beside it."""
    coronagraph = instrument.coronagraph.model_dump(mode="json", exclude={"table", "psf"})
    parts = {
        "table": [TABLE_SCHEMA, table.sha256],
        "coronagraph": coronagraph,
        "band": instrument.band(band).model_dump(mode="json", include={"center_nm", "width_nm", "camera"}),
        "telescope": instrument.telescope.model_dump(mode="json"),
        "geometry": [instrument.pixel_scale_arcsec(band), instrument.mask_half_width_arcsec(band)],
        "hole": instrument.dark_hole.model_dump(mode="json", include={"mode", "side"}),
        "psd_slope": instrument.drift.psd_slope,
    }
    return content_hash(parts)


@functools.lru_cache(maxsize=32)
def _table_metrics(keyed: Keyed[Instrument], band: str) -> PsfMetrics:
    from simulator.imaging.table_metrics import table_metrics

    instrument = keyed.value
    table = instrument.table(band)
    assert table is not None
    return table_metrics(instrument, band, table)


@numeric_context()
def psf_metrics(instrument: Instrument, band: str) -> PsfMetrics:
    """Return a band's metrics at the standard knobs: of its table, the shipped file, the cache, or measured anew.

    Parameters
    ----------
    instrument : Instrument
    band : str
        Name of a band of the instrument, such as ``F520``.

    Raises
    ------
    InputError
        For an unknown band, an unusable apodizer or table.
    """
    key = metrics_key(instrument, band)
    if instrument.coronagraph.table is not None:
        return _table_metrics(Keyed(key, instrument), band)
    path = shipped("metrics", key, band)
    if path is not None:
        steps = math.lcm(len(configured_apodizer(instrument)), instrument.wavefront.samples)
        return _shipped_metrics(path, steps)

    return compute_once(
        f"metrics-{key}", lambda: measure(instrument, band), lambda arrays: PsfMetrics.from_arrays(unpacked(arrays))
    )


def measure(instrument: Instrument, band: str) -> dict[str, NDArray[Any]]:
    """Return the arrays of the metrics of a band, measured anew, with the state of its dark hole.

    Parameters
    ----------
    instrument : Instrument
    band : str
        Name of a band of the instrument, such as ``F520``.
    """
    from simulator.imaging.build import build_imager, hole_state_of
    from simulator.imaging.measure import measure_metrics

    imager, wide = build_imager(instrument, band), build_imager(instrument, band, Knobs(wavelength_nodes=WING_NODES))
    announce(f"measuring the optics of {instrument.name} in {band}, once: five to ten seconds of a processor")
    metrics = measure_metrics(imager, instrument.drift.psd_slope, wide)
    state = hole_state_of(instrument, band, float(metrics.raw_contrast[metrics.hole].mean()))
    return metrics.to_arrays() | {"hole_state": np.asarray(state)}


def unpacked(stored: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """Return the arrays of a shipped file, rounded or exact.

    Parameters
    ----------
    stored : mapping of str to ndarray
        Arrays by name, as the file has them.
    """
    arrays = dict(stored)
    for name in DIGITS:
        if arrays[name].dtype == np.uint8:
            arrays[name] = of_byte_planes(arrays[name]).astype(float)
    if "halo_map" not in arrays:
        weights = overlap_weights(float(arrays["aperture_radius_arcsec"] / arrays["pixel_scale_arcsec"]))
        arrays["halo_map"] = aperture_sums(arrays["raw_contrast"] * arrays["peak_off_axis"], weights)
    return arrays


LEVELS = (0.0, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0)
"""Mean square errors of sensing of the states, over those of the preset ``as_published``."""
SHARED = ("wing_map", "aperture_map", "wing_profile", "column_profile")
"""Figures that a file of a state leaves to the instrument's own: of the far light of a source without the mask."""
_PUBLISHED = "as_published"


def sensed_with(instrument: Instrument, band: str, level: float) -> Instrument:
    """Return an instrument whose mirror is set from a field that is sensed with errors.

    Parameters
    ----------
    instrument : Instrument
    band : str
        One of the visible bands of the preset ``as_published``.
    level : float
        Mean square error over that of the preset, 0 or more; 0 is the field without errors.

    Raises
    ------
    InputError
        For a band of which no contrast is published.
    """
    published = load_instrument(_PUBLISHED).dark_hole.sensing_contrast_by_band
    if band not in published:
        allowed = f"a band of which a contrast is published: {', '.join(published_bands())}"
        raise InputError("contrast", band, allowed=allowed)
    sensing: dict[str, Any] = {"sensing": "perfect", "sensing_contrast": 0.0, "sensing_contrast_by_band": {}}
    if level > 0.0:
        sensing |= {"sensing": "probes", "sensing_contrast_by_band": {band: level * published[band]}}
    return instrument.changed({"dark_hole": sensing})


def published_bands() -> tuple[str, ...]:
    """Return the bands of which a contrast is published."""
    return tuple(load_instrument(_PUBLISHED).dark_hole.sensing_contrast_by_band)


def mean_contrast(metrics: PsfMetrics) -> float:
    """Return the mean raw contrast of the pixels of the dark hole."""
    return float(metrics.raw_contrast[metrics.hole].mean())


def measured_states(instrument: Instrument, band: str) -> tuple[PsfMetrics, ...]:
    """Return the measured states of a band, from the darkest hole to the brightest.

    Parameters
    ----------
    instrument : Instrument
        Whose own errors of sensing do not matter.
    band : str

    Raises
    ------
    InputError
        If the coronagraph is a table.

    Notes
    -----
    Those of the default instrument ship; of other optics each is dug and measured once, about half a minute a state.
    """
    if instrument.coronagraph.table is not None:
        hint = "of a table no states of a mirror are known, on which an ensemble of instruments draws the contrast"
        raise InputError("coronagraph.table", instrument.name, allowed="modelled optics", hint=hint)
    own = sensed_with(instrument, band, 0.0)
    return _states(Keyed(metrics_key(own, band), own), band)


def at_contrast(states: Sequence[PsfMetrics], contrast: float) -> PsfMetrics:
    """Return the figures of a band whose dark hole has a mean raw contrast, or the darkest it can have.

    Parameters
    ----------
    states : sequence of PsfMetrics
        Of one band, of `measured_states`.
    contrast : float
        Above 0. Below that of the darkest state the hole is the darkest.

    Raises
    ------
    InputError
        For a contrast above that of the brightest state.
    """
    known = [mean_contrast(state) for state in states]
    if not 0.0 < contrast <= known[-1]:
        raise InputError("contrast", contrast, allowed=f"above 0, at most {known[-1]:.3g} in {states[0].band}")
    if contrast <= known[0]:
        return states[0]
    above = int(np.searchsorted(known, contrast))
    share = (contrast - known[above - 1]) / (known[above] - known[above - 1])
    return mixed(states[above - 1], states[above], share)


def mixed(first: PsfMetrics, second: PsfMetrics, share: float) -> PsfMetrics:
    """Return the figures between two states of one instrument: ``share`` of the second and the rest of the first."""

    def between(name: str) -> Any:
        """Return one figure; words are those of the state that is worse."""
        low, high = getattr(first, name), getattr(second, name)
        if low is high or isinstance(low, str):
            return high
        if low is None or high is None:
            return None
        value = low + share * (high - low)  # geometry, the same in both, stays to the last bit
        if isinstance(value, np.ndarray):
            value.flags.writeable = False
        return value

    return PsfMetrics(**{field.name: between(field.name) for field in fields(PsfMetrics)})


@functools.lru_cache(maxsize=32)
def _states(keyed: Keyed[Instrument], band: str) -> tuple[PsfMetrics, ...]:
    own = psf_metrics(keyed.value, band)
    states = [own]
    for level in LEVELS[1:]:
        instrument = sensed_with(keyed.value, band, level)
        path = shipped_file("state", metrics_key(instrument, band), band)
        states.append(_of_file(read_npz(path), own) if path.is_file() else psf_metrics(instrument, band))
    return tuple(sorted(states, key=mean_contrast))


def _of_file(stored: Mapping[str, NDArray[Any]], own: PsfMetrics) -> PsfMetrics:
    """Return a state from its file, and the far wings from the instrument's own state."""
    shared = {name: getattr(own, name) for name in SHARED}
    made = PsfMetrics.from_arrays(unpacked(shared | dict(stored)))
    return replace(made, pupil_steps=own.pupil_steps, **shared)
