"""Processor time that the parts of an observation take, as far as leaving them out saves it.

Rough times of one core; only their ratios matter, which decide what is left out first.

A choice in words: the row of every effect, source and setting.
"""

import dataclasses
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from simulator.detectors import VISIBLE, rows_of
from simulator.knobs import Knobs, Quantity
from simulator.ledger.inventory import EffectRow
from simulator.ledger.prediction import Forecast

FRAME_S = {effect.switch: effect.frame_s for effect in rows_of(VISIBLE) if effect.frame_s}
"""Seconds a frame of each effect on the window around the hole (137 x 137)."""
SET_UP_S = {effect.switch: effect.set_up_s for effect in rows_of(VISIBLE) if effect.set_up_s} | {"sky": 1e-3}
"""Seconds a sequence of what is worked out once."""
WHOLE_FRAME_S = 3e-3
"""Seconds a frame with everything."""
FULL_PIXELS = 60.0
"""Pixels of the whole frame over those of the window around the hole."""
SOURCE_S, FAR_SOURCE_S, EXTENDED_S = 4e-3, 2e-2, 6e-2
"""Seconds of a source in the window, of a star that needs wavelengths of its own, and of an extended source."""
_STAMP_S, _PUPIL_S = 3e-4, 1e-3


def stamp_s(knobs: Knobs) -> float:
    """Seconds of one image of the star behind the mask."""
    products = knobs.wavelength_nodes * (_STAMP_S * knobs.pixel_nodes**2 + _PUPIL_S)
    return products * (0.55 if knobs.precision == "single" else 1.0) * (1.0 if knobs.pupil_samples <= 128 else 2.0)


Sizes = Mapping[Quantity, float]
WORDS: dict[Quantity, str] = {"planet_flux": "planet flux", "snr": "SNR", "pixel_map": "pixel map"}
_SOURCES = {"star": "star", "planet": "planet", "extended": "extended source"}


@dataclass(frozen=True)
class Chosen:
    """What was decided.

    Attributes
    ----------
    asked : tuple of str
        Quantities.
    knobs, finest : Knobs
        Settings, and those without a tolerance.
    skipped : collection of str
        Keys of what is left out.
    epochs : int
    sums, full, given_region : bool
        Sums instead of frames; whole frames; whether the caller named the region.
    knob_sizes : callable
        Sizes of a setting by name and value.
    fewer_epochs : Mapping
        Sizes of the epochs.
    """

    asked: tuple[Quantity, ...]
    knobs: Knobs
    finest: Knobs
    skipped: Collection[str]
    epochs: int
    sums: bool
    full: bool
    given_region: bool
    knob_sizes: Callable[[str, Any], Sizes]
    fewer_epochs: Sizes

    def size(self, sizes: Sizes) -> float:
        """Largest size on what was asked for."""
        return max((sizes[name] for name in self.asked), default=0.0)

    def reason(self, sizes: Sizes) -> str:
        """Why something is left out."""
        if not self.size(sizes):
            return "changes nothing that was asked for"
        most = max(self.asked, key=lambda name: sizes[name])
        return f"predicted to change the {WORDS[most]} by {sizes[most]:.2g}"


def choice_rows(forecast: Forecast, chosen: Chosen) -> tuple[EffectRow, ...]:
    """Rows of what the configuration contains, of the sources one by one, and of the settings.

    Parameters
    ----------
    forecast : Forecast
    chosen : Chosen
    """
    rows = []
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
        rows.append(
            EffectRow(f"{_SOURCES[kind]} {name}", "skipped" if gone else "kept", reason, key, chosen.size(sizes))
        )
    return (*rows, *_optics(chosen), *_drawing(forecast, chosen))


def _optics(chosen: Chosen) -> Iterator[EffectRow]:
    for key, words in (
        ("wavelength_nodes", "wavelengths a band"),
        ("pixel_nodes", "nodes a pixel"),
        ("precision", "precision of the field"),
    ):
        value, most = getattr(chosen.knobs, key), getattr(chosen.finest, key)
        size = chosen.size(chosen.knob_sizes(key, value))
        reason = f"{value}" if value == most else f"{value} instead of {most}"
        yield EffectRow(words, "skipped" if size else "kept", reason, key, size)
    exact = "exact on the grid of steps and static wavefront"
    yield EffectRow("samples across the pupil", "kept", exact, "pupil_samples", 0.0)


def _drawing(forecast: Forecast, chosen: Chosen) -> Iterator[EffectRow]:
    fewer = chosen.epochs < forecast.max_epochs
    reason = f"{chosen.epochs} instead of {forecast.max_epochs}" if fewer else f"{chosen.epochs}"
    yield EffectRow(
        "epochs of the wavefront",
        "skipped" if fewer else "kept",
        reason,
        "drift_epochs",
        chosen.size(chosen.fewer_epochs),
    )
    frames = "frames one by one"
    if chosen.sums:
        yield EffectRow(frames, "skipped", "one draw an epoch has the law of its frames", "summed_frames", 0.0)
    else:
        yield EffectRow(frames, "kept", forecast.sums.message or "frame by frame", "summed_frames")
    around, size = "pixels around the window of the hole", chosen.size(forecast.sizes["hole_region"])
    if chosen.full:
        yield EffectRow(around, "kept", "whole frames", "hole_region", size)
    elif chosen.given_region:
        yield EffectRow(around, "kept", "none beyond the window that was asked for", "hole_region")
    else:
        yield EffectRow(around, "skipped", chosen.reason(forecast.sizes["hole_region"]), "hole_region", size)
    place = "place of every source behind the mask"
    yield EffectRow(
        place,
        "kept",
        "exact costs no more than one image for all",
        "off_mask_psf",
        chosen.size(forecast.sizes["off_mask_psf"]),
    )
