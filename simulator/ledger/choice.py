"""What is left out: the cheapest way to model an observation that keeps every quantity within its tolerance."""

import math
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from typing import Any, Literal

from cpic_core import Outcome, Reason, Status
from simulator.detectors import VISIBLE, rows_of
from simulator.knobs import FIDELITIES, Dial, Knobs, Quantity
from simulator.ledger.case import NOT_IN_SUMS
from simulator.ledger.choice_rows import (
    EXTENDED_S,
    FAR_SOURCE_S,
    FRAME_S,
    FULL_PIXELS,
    SET_UP_S,
    SOURCE_S,
    WHOLE_FRAME_S,
    WORDS,
    Chosen,
    choice_rows,
    stamp_s,
)
from simulator.ledger.inventory import EffectRow
from simulator.ledger.prediction import MAX_EPOCHS, Forecast

Sizes = dict[Quantity, float]
SUM_EPOCHS = 6
"""Epochs of a visit drawn as sums: the variance of the mean of a walk is 1/(2 epochs^2), 1.4 %, too large."""
# Hidden by others: dark current takes its structure and the charge of hot pixels and bad columns with it.
_NEEDS = {effect.switch: effect.hides for effect in rows_of(VISIBLE)}


@dataclass(frozen=True)
class Choice:
    """How an observation is modelled; made by `choose`.

    Attributes
    ----------
    rows : tuple of EffectRow
        Every effect, setting and source: kept or skipped, with its size.
    knobs : Knobs
        Settings of the optics.
    switches : dict of str to bool
        Effects of the camera to switch off.
    left_out : tuple of str
        Names of sources.
    sky : bool
        Whether the light of the sky is modelled.
    epochs : int
        At which the drift of a visit is sampled.
    draw : {"sums", "frames"}
    region : {"hole", "full"}
    predicted_error : dict
        Bound of the error of each quantity asked for.
    outcome : Outcome of float
        ``ok`` with the largest predicted error; ``invalid`` where a named tier misses its own tolerance.
    """

    rows: tuple[EffectRow, ...]
    knobs: Knobs
    switches: dict[str, bool]
    left_out: tuple[str, ...]
    sky: bool
    epochs: int
    draw: Literal["sums", "frames"]
    region: Literal["hole", "full"]
    predicted_error: dict[Quantity, float]
    outcome: Outcome[float]


def budget_of(quantity: Quantity, tolerance: float) -> float:
    """What the sizes of all that is left out may sum to, so that the error stays within a tolerance.

    Sizes are first order. Variances do not add up like that: without the share A of its variance a standard deviation
    is lower by ``1 - sqrt(1 - A)``, and a ratio to it higher by ``1 / sqrt(1 - A) - 1``, both more than ``A / 2``. With
    the sum of sizes ``A / 2 <= T - T^2 / 2`` the first stays within T, with ``A / 2 <= T (1 + T / 2) / (1 + T)^2`` the
    second.

    Parameters
    ----------
    quantity : Quantity
    tolerance : float
        Largest error of planet flux and SNR that is accepted, 0 to 0.5.
    """
    if quantity == "planet_flux":
        return tolerance
    if quantity == "pixel_map":
        return tolerance * (1.0 - 0.5 * tolerance)
    return tolerance * (1.0 + 0.5 * tolerance) / (1.0 + tolerance) ** 2


def error_of(quantity: Quantity, total: float) -> float:
    """Inverse of `budget_of`: the error that a sum of sizes stands for; infinite where it is no bound."""
    if quantity == "planet_flux" or total == 0.0:
        return total
    if quantity == "pixel_map":
        return 1.0 - math.sqrt(1.0 - 2.0 * total) if total < 0.5 else math.inf
    return 1.0 / math.sqrt(1.0 - 2.0 * total) - 1.0 if total < 0.5 else math.inf


@dataclass(frozen=True)
class _Item:
    """Something to leave out, or a setting to lower to a value."""

    key: str
    value: Any
    sizes: Sizes
    saved_s: float


def choose(forecast: Forecast, dial: Dial, *, fixed: Collection[str] = (), finest: Knobs | None = None) -> Choice:
    """Decide what is modelled.

    Parameters
    ----------
    forecast : Forecast
    dial : Dial
        A named tier keeps its knobs: ``reference`` leaves nothing out, ``standard`` only draws sums where they may
        stand for frames, ``quick`` leaves out what its tolerance allows. A tolerance chooses the knobs too.
    fixed : collection of str
        Keys that are not to be decided: ``summed_frames``, ``hole_region``, or any other.
    finest : Knobs, optional
        For a tolerance: the settings to start from, against which errors count; those of the reference by default.

    Returns
    -------
    Choice

    Notes
    -----
    Greedy: what costs least of the tolerance for the time that it saves goes first, until nothing more fits. The sizes
    of all that is left out sum to at most `budget_of` for every quantity of ``dial.tolerance``.
    """
    return _Chooser(forecast, dial, frozenset(fixed), finest).made()


class _Chooser:
    """The state of one choice."""

    def __init__(self, forecast: Forecast, dial: Dial, fixed: frozenset[str], finest: Knobs | None) -> None:
        self.forecast, self.dial, self.fixed = forecast, dial, fixed
        self.asked: tuple[Quantity, ...] = tuple(dial.tolerance)
        self.budget = {name: budget_of(name, dial.tolerance[name]) for name in self.asked}
        self.spent: Sizes = dict.fromkeys(self.asked, 0.0)
        self.skipped: dict[str, float] = {}
        self.finest = FIDELITIES["reference"] if finest is None else finest
        self.knobs = self.finest if dial.knobs is None else dial.knobs
        self.epochs = min(forecast.max_epochs, forecast.n_frames)
        self.draw: Literal["sums", "frames"] = "frames"
        self.full = forecast.full if "hole_region" in fixed else True
        self.rows_spent, self.rows_budget = 0.0, max(dial.tolerance.values(), default=0.0)

    def made(self) -> Choice:
        """Everything."""
        tier, reference = self.dial.fidelity, all(value == 0 for value in self.dial.tolerance.values())
        if reference:
            if self.dial.knobs is not None:
                self.knobs = self.dial.knobs
        else:
            for name in ("wavelength_nodes", "pixel_nodes", "precision"):
                sizes = self._knob_sizes(name, getattr(self.knobs, name))
                if any(sizes[quantity] for quantity in self.asked):
                    self._spend(name, sizes)
            within = all(self.spent[name] <= self.budget[name] for name in self.asked)
            if within or tier == "standard":
                self._leave_out(tier)
        return self._choice()

    def _knob_sizes(self, name: str, value: Any) -> Sizes:
        """Size of a setting against the finest one: at most the sum of what both are away from the reference."""
        if name in ("wavelength_nodes", "pixel_nodes", "precision"):
            start = getattr(self.finest, name)
            if value == start or (not isinstance(value, str) and value > start):
                return dict.fromkeys(self.asked, 0.0)
            ours, theirs = (self._known(name, part) for part in (value, start))
            return {quantity: ours[quantity] + theirs[quantity] for quantity in self.asked}
        return self._known(name, value)

    def _known(self, name: str, value: Any) -> Sizes:
        known = self.forecast.knob_sizes[name]
        if value in known:
            return known[value]
        return known[max(candidate for candidate in known if candidate < value)]

    def _spend(self, key: str, sizes: Sizes) -> None:
        for name in self.asked:
            self.spent[name] += sizes[name]
        self.skipped[key] = self._size(sizes)
        self.rows_spent += self._size(sizes)

    def _size(self, sizes: Sizes) -> float:
        return max((sizes[name] for name in self.asked), default=0.0)

    def _leave_out(self, tier: str) -> None:
        if tier == "custom":
            self.knobs = self.knobs.model_copy(update={"pupil_samples": 64})
        while True:
            best, ratio = None, math.inf
            for item in self._items(tier):
                if any(self.spent[name] + item.sizes[name] > self.budget[name] for name in self.asked):
                    continue
                if self.rows_spent + self._size(item.sizes) > self.rows_budget:
                    continue
                share = max((item.sizes[name] / self.budget[name] for name in self.asked), default=0.0)
                rank = share / max(item.saved_s, 1e-9)
                if rank < ratio:
                    best, ratio = item, rank
            if best is None:
                return
            self._take(best)

    def _take(self, item: _Item) -> None:
        for name in self.asked:
            self.spent[name] += item.sizes[name]
        self.rows_spent += self._size(item.sizes)
        self.skipped[item.key] = self.skipped.get(item.key, 0.0) + self._size(item.sizes)
        if item.key in ("wavelength_nodes", "pixel_nodes", "precision"):
            self.knobs = self.knobs.model_copy(update={item.key: item.value})
        elif item.key == "drift_epochs":
            self.epochs = item.value
        elif item.key == "hole_region":
            self.full = False
        elif item.key == "summed_frames":
            self.draw = "sums"
            self.epochs = min(self.epochs, SUM_EPOCHS)
            for key in NOT_IN_SUMS:
                if key in self.forecast.sizes:
                    self.skipped.setdefault(key, self._size(self.forecast.sizes[key]))

    def _items(self, tier: str) -> Iterator[_Item]:
        yield from self._whole()
        if tier == "standard":
            return
        yield from self._settings(tier)
        frames = 1 if self.draw == "sums" else self.forecast.n_frames
        pixels = FULL_PIXELS if self.full else 1.0
        for row in self.forecast.rows:
            key = row.key
            if row.decision != "kept" or key in self.skipped or key in self.fixed or key not in self.forecast.sizes:
                continue
            if any(need not in self.skipped and self._exists(need) for need in _NEEDS.get(key, ())):
                continue
            if key in FRAME_S or key in SET_UP_S:
                saved = FRAME_S.get(key, 0.0) * frames * pixels + SET_UP_S.get(key, 0.0) * pixels
                yield _Item(key, False, self.forecast.sizes[key], saved)
        for name, kind in self.forecast.sources.items():
            key = f"{kind}:{name}"
            if key not in self.skipped and key not in self.fixed:
                saved = {"planet": SOURCE_S, "star": FAR_SOURCE_S, "extended": EXTENDED_S}[kind]
                yield _Item(key, name, self.forecast.sizes[key], saved * math.sqrt(pixels))

    def _exists(self, key: str) -> bool:
        return any(row.key == key and row.decision == "kept" for row in self.forecast.rows)

    def _whole(self) -> Iterator[_Item]:
        """Sums of frames, and the window alone."""
        frames = self.forecast.n_frames
        if self.draw == "frames" and "summed_frames" not in self.fixed and self.forecast.sums.status is Status.OK:
            sizes = dict.fromkeys(self.asked, 0.0)
            for key in NOT_IN_SUMS:
                if self._exists(key) and key not in self.skipped:
                    for name in self.asked:
                        sizes[name] += self.forecast.sizes[key][name]
            if self.epochs > SUM_EPOCHS:
                missing = self._change("drift_epochs", self.epochs, SUM_EPOCHS)
                sizes = {name: sizes[name] + missing[name] for name in self.asked}
            yield _Item("summed_frames", "sums", sizes, frames * WHOLE_FRAME_S + 1.0)
        if self.full and "hole_region" not in self.fixed:
            yield _Item("hole_region", "hole", self.forecast.sizes["hole_region"], frames * WHOLE_FRAME_S * FULL_PIXELS)

    def _change(self, name: str, now: Any, then: Any) -> Sizes:
        known = self.forecast.knob_sizes[name]
        usable = [n for n in known if n <= then]
        before, after = self._known(name, now), known[max(usable)]
        return {key: max(after[key] - before[key], 0.0) for key in self.asked}

    def _settings(self, tier: str) -> Iterator[_Item]:
        """Fewer epochs; where a tolerance chooses the knobs, fewer nodes and single precision."""
        each = stamp_s(self.knobs)
        for value in self.forecast.knob_sizes["drift_epochs"]:
            if value < self.epochs and "drift_epochs" not in self.fixed:
                yield _Item(
                    "drift_epochs",
                    value,
                    self._change("drift_epochs", self.epochs, value),
                    each * (self.epochs - value),
                )
        if tier != "custom":
            return
        stamps = self.epochs + 2
        for name in ("wavelength_nodes", "pixel_nodes"):
            now = getattr(self.knobs, name)
            for value in self.forecast.knob_sizes[name]:
                if value < now and name not in self.fixed:
                    cheaper = stamp_s(self.knobs.model_copy(update={name: value}))
                    before, after = self._knob_sizes(name, now), self._knob_sizes(name, value)
                    sizes = {key: max(after[key] - before[key], 0.0) for key in self.asked}
                    yield _Item(name, value, sizes, stamps * (each - cheaper))
        if self.knobs.precision == "double" and "precision" not in self.fixed:
            cheaper = stamp_s(self.knobs.model_copy(update={"precision": "single"}))
            yield _Item("precision", "single", self._knob_sizes("precision", "single"), stamps * (each - cheaper))

    def _choice(self) -> Choice:
        errors = {name: error_of(name, self.spent[name]) for name in self.asked}
        worst = max(errors.values(), default=0.0)
        outcome = Outcome.ok(worst)
        late = [name for name in self.asked if self.spent[name] > self.budget[name] and self.dial.tolerance[name] > 0]
        if late:
            name = max(late, key=lambda one: errors[one] / self.dial.tolerance[one])
            outcome = Outcome.refuse(
                Status.INVALID,
                Reason.TIER_TOO_COARSE,
                f"{self.dial.fidelity} misses its tolerance here: {WORDS[name]} to {errors[name]:.2g}, "
                f"asked {self.dial.tolerance[name]:g}",
            )
        epochs = self.epochs
        if all(value == 0 for value in self.dial.tolerance.values()):
            epochs = min(self.forecast.n_frames, max(self.forecast.max_epochs, MAX_EPOCHS))
        known = {*FRAME_S, *SET_UP_S} - {"sky"}
        switches = {
            row.key: False
            for row in self.forecast.rows
            if row.key in self.skipped and row.decision == "kept" and row.key in known
        }
        left_out = tuple(name for name, kind in self.forecast.sources.items() if f"{kind}:{name}" in self.skipped)
        chosen = Chosen(
            asked=self.asked,
            knobs=self.knobs,
            finest=self.finest,
            skipped=frozenset(self.skipped),
            epochs=epochs,
            sums=self.draw == "sums",
            full=self.full,
            given_region="hole_region" in self.fixed,
            knob_sizes=self._knob_sizes,
            fewer_epochs=self._change("drift_epochs", self.forecast.max_epochs, epochs),
        )
        return Choice(
            rows=choice_rows(self.forecast, chosen),
            knobs=self.knobs,
            switches=switches,
            left_out=left_out,
            sky="sky" not in self.skipped,
            epochs=epochs,
            draw=self.draw,
            region="full" if self.full else "hole",
            predicted_error=errors,
            outcome=outcome,
        )
