"""Dark holes between measured states of the mirror: the figures of a band for any mean raw contrast.

The mirror of a state is set from a field that is sensed with errors, from none to ten times those that leave the
contrast which is published of the instrument (preset ``as_published``). Every state is measured on images of the whole
optical model. Between two of them the masked starlight is a mixture of both: where the errors of the field add to what
is left without them, intensities are linear in the square of the errors. No state's light is scaled.

Files of the states of the default instrument hold no maps of the far wings of an unmasked source, which are those of
its own state: they differ by some per cent, and only light of companions is read from them.
"""

import functools
from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from typing import Any

import numpy as np

from cpic_core import InputError, NDArray, read_npz
from simulator.config import Instrument, load_instrument
from simulator.imaging.metrics import PsfMetrics
from simulator.imaging.store import Unkeyed, metrics_key, psf_metrics, shipped_file, unpacked

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
    return _states(metrics_key(own, band), band, Unkeyed(own))


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
def _states(key: str, band: str, held: Unkeyed) -> tuple[PsfMetrics, ...]:
    own = psf_metrics(held.instrument, band)
    states = [own]
    for level in LEVELS[1:]:
        instrument = sensed_with(held.instrument, band, level)
        path = shipped_file("state", metrics_key(instrument, band), band)
        states.append(_of_file(read_npz(path), own) if path.is_file() else psf_metrics(instrument, band))
    return tuple(sorted(states, key=mean_contrast))


def _of_file(stored: Mapping[str, NDArray[Any]], own: PsfMetrics) -> PsfMetrics:
    """Return a state from its file, and the far wings from the instrument's own state."""
    shared = {name: getattr(own, name) for name in SHARED}
    made = PsfMetrics.from_arrays(unpacked(shared | dict(stored)))
    return replace(made, pupil_steps=own.pupil_steps, **shared)
