"""A choice in words: the row of every effect, source and setting, with the processor time that it saves.

Rough times of one core; only their ratios matter, which decide what is left out first.
"""

import dataclasses
from collections.abc import Collection, Iterator
from typing import Any, Literal

from simulator.detectors import VISIBLE, Sizes, rows_of
from simulator.knobs import FIDELITIES, Dial, Knobs, Quantity
from simulator.ledger.inventory import EffectRow
from simulator.ledger.prediction import Forecast

FRAME_S = {effect.switch: effect.frame_s for effect in rows_of(VISIBLE) if effect.frame_s}
"""Seconds a frame of each effect on the window around the hole (137 x 137)."""
SET_UP_S = {effect.switch: effect.set_up_s for effect in rows_of(VISIBLE) if effect.set_up_s} | {"sky": 1e-3}
"""Seconds a sequence of what is worked out once."""
DRIFT_TERMS = {"drift_common": "common_fraction", "orbital_drift": "orbital_nm"}
"""Numbers of the drift that are 0 where an effect is left out; a screen takes a millisecond."""
SCREEN_S = 1e-3
WHOLE_FRAME_S = 3e-3
"""Seconds a frame with everything."""
FULL_PIXELS = 60.0
"""Pixels of the whole frame over those of the window around the hole."""
SOURCE_S, FAR_SOURCE_S, EXTENDED_S = 4e-3, 2e-2, 6e-2
"""Seconds of a source in the window, of a star that needs wavelengths of its own, and of an extended source."""
_STAMP_S, _PUPIL_S = 3e-4, 1e-3


def stamp_s(knobs: Knobs) -> float:
    """Return the seconds of one image of the star behind the mask."""
    products = knobs.wavelength_nodes * (_STAMP_S * knobs.pixel_nodes**2 + _PUPIL_S)
    return products * (0.55 if knobs.precision == "single" else 1.0) * (1.0 if knobs.pupil_samples <= 128 else 2.0)


WORDS: dict[Quantity, str] = {"planet_flux": "planet flux", "snr": "SNR", "pixel_map": "pixel map"}
SETTINGS = {"wavelength_nodes": "wavelengths a band", "pixel_nodes": "nodes a pixel"}
SETTINGS |= {"precision": "precision of the field"}
_SOURCES = {"star": "star", "planet": "planet", "extended": "extended source"}


class Chosen:
    """The state of one choice: what is modelled so far, and what it cost.

    Parameters
    ----------
    forecast : Forecast
    dial : Dial
    fixed : collection of str
        Keys that are not to be decided.
    finest : Knobs, optional
        Settings without a tolerance; those of the reference by default.
    """

    def __init__(self, forecast: Forecast, dial: Dial, fixed: Collection[str], finest: Knobs | None) -> None:
        self.forecast, self.dial, self.fixed = forecast, dial, frozenset(fixed)
        self.asked: tuple[Quantity, ...] = tuple(dial.tolerance)
        self.spent = dict.fromkeys(self.asked, 0.0)
        self.skipped: dict[str, float] = {}
        self.finest = FIDELITIES["reference"] if finest is None else finest
        self.knobs = self.finest if dial.knobs is None else dial.knobs
        self.epochs = min(forecast.max_epochs, forecast.n_frames)
        self.draw: Literal["sums", "frames"] = "frames"
        self.full = forecast.full if "hole_region" in self.fixed else True

    def knob_sizes(self, name: str, value: Any) -> Sizes:
        """Return the size of a setting against the finest: at most the sum of what both are away from the reference.

        Parameters
        ----------
        name : str
            Of the setting.
        value : object
        """
        start = getattr(self.finest, name)
        if value == start or (not isinstance(value, str) and value > start):
            return dict.fromkeys(self.asked, 0.0)
        ours, theirs = (self._known(name, part) for part in (value, start))
        return {quantity: ours[quantity] + theirs[quantity] for quantity in self.asked}

    def fewer_epochs(self, now: int, then: int) -> Sizes:
        """Return the size of sampling the drift of the wavefront at fewer epochs.

        Parameters
        ----------
        now, then : int
            Epochs before and after.
        """
        known = self.forecast.knob_sizes["drift_epochs"]
        before, after = self._known("drift_epochs", now), known[max(n for n in known if n <= then)]
        return {key: max(after[key] - before[key], 0.0) for key in self.asked}

    def _known(self, name: str, value: Any) -> Sizes:
        known = self.forecast.knob_sizes[name]
        return known[value if value in known else max(candidate for candidate in known if candidate < value)]

    def size(self, sizes: Sizes) -> float:
        """Return the largest size on what was asked for."""
        return max((sizes[name] for name in self.asked), default=0.0)

    def exists(self, key: str) -> bool:
        """Return whether an effect is part of the observation."""
        return any(row.key == key and row.decision == "kept" for row in self.forecast.rows)

    def reason(self, sizes: Sizes) -> str:
        """Return why something is left out."""
        if not self.size(sizes):
            return "changes nothing that was asked for"
        most = max(self.asked, key=lambda name: sizes[name])
        return f"predicted to change the {WORDS[most]} by {sizes[most]:.2g}"


def choice_rows(chosen: Chosen) -> tuple[EffectRow, ...]:
    """Return the rows of what the configuration contains, of the sources one by one, and of the settings."""
    rows, forecast = [], chosen.forecast
    for row in forecast.rows:
        sizes = forecast.sizes.get(row.key)
        if sizes is None:
            rows.append(row)
        elif row.key in chosen.skipped and row.decision == "kept":
            reason, size = chosen.reason(sizes), chosen.size(sizes)
            rows.append(dataclasses.replace(row, decision="skipped", reason=reason, size=size))
        else:
            rows.append(dataclasses.replace(row, size=chosen.size(sizes)))
    for name, kind in forecast.sources.items():
        key = f"{kind}:{name}"
        sizes, gone = forecast.sizes[key], key in chosen.skipped
        reason = chosen.reason(sizes) if gone else "light of its own"
        effect, decision = f"{_SOURCES[kind]} {name}", _decision(gone)
        rows.append(EffectRow(effect, decision, reason, key, chosen.size(sizes)))
    return (*rows, *_optics(chosen), *_drawing(chosen))


def _decision(skipped: object) -> Literal["kept", "skipped"]:
    return "skipped" if skipped else "kept"


def _optics(chosen: Chosen) -> Iterator[EffectRow]:
    for key, words in SETTINGS.items():
        value, most = getattr(chosen.knobs, key), getattr(chosen.finest, key)
        size = chosen.size(chosen.knob_sizes(key, value))
        reason = f"{value}" if value == most else f"{value} instead of {most}"
        yield EffectRow(words, _decision(size), reason, key, size)
    exact = "exact on the grid of steps and static wavefront"
    yield EffectRow("samples across the pupil", "kept", exact, "pupil_samples", 0.0)


def _drawing(chosen: Chosen) -> Iterator[EffectRow]:
    forecast, epochs = chosen.forecast, chosen.epochs
    fewer, size = epochs < forecast.max_epochs, chosen.size(chosen.fewer_epochs(forecast.max_epochs, epochs))
    reason = f"{epochs} instead of {forecast.max_epochs}" if fewer else f"{epochs}"
    yield EffectRow("epochs of the wavefront", _decision(fewer), reason, "drift_epochs", size)
    frames = "frames one by one"
    if chosen.draw == "sums":
        yield EffectRow(frames, "skipped", "one draw an epoch has the law of its frames", "summed_frames", 0.0)
    else:
        yield EffectRow(frames, "kept", forecast.sums.message or "frame by frame", "summed_frames")
    around, size = "pixels around the window of the hole", chosen.size(forecast.sizes["hole_region"])
    if chosen.full:
        yield EffectRow(around, "kept", "whole frames", "hole_region", size)
    elif "hole_region" in chosen.fixed:
        yield EffectRow(around, "kept", "none beyond the window that was asked for", "hole_region")
    else:
        yield EffectRow(around, "skipped", chosen.reason(forecast.sizes["hole_region"]), "hole_region", size)
    reason, size = "exact costs no more than one image for all", chosen.size(forecast.sizes["off_mask_psf"])
    yield EffectRow("place of every source behind the mask", "kept", reason, "off_mask_psf", size)
