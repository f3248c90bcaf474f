"""Choose the cheapest way to model an observation that keeps every quantity within its tolerance, and say so in rows.

Which quantities a tolerance holds for. Times are rough ones of one core: only their ratios matter, which decide what is
left out first.
"""

import dataclasses
import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import field
from typing import Any, Literal, get_args

from cpic_core import InputError, Outcome, Reason, Record, Status
from simulator.config import Instrument, Scene
from simulator.detectors import VISIBLE, Sizes, rows_of
from simulator.knobs import FIDELITIES, Dial, Knobs, Quantity
from simulator.ledger.inventory import EffectRow
from simulator.ledger.visit import MAX_EPOCHS, NOT_IN_SUMS, Forecast, forecast

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


SUM_EPOCHS = 6
"""Epochs of a visit drawn as sums: the variance of the mean of a walk is 1/(2 epochs^2), 1.4 %, too large."""
# Hidden by others: dark current takes its structure and the charge of hot pixels and bad columns with it.
_NEEDS = {effect.switch: effect.hides for effect in rows_of(VISIBLE)}


class Shortcuts(Record):
    """Everything that makes a model of an observation cheaper.

    Attributes
    ----------
    draw : {"sums", "frames"}
        Sums of frames over the dark hole, or every frame.
    region : {"hole", "full"}
        Pixels that are simulated: the stamp around the mask, or whole frames.
    knobs : Knobs
        Settings of the optics.
    epochs : int
        At which the drift of a visit is sampled, at most.
    switches : dict of str to bool
        Effects of the camera to switch off.
    left_out : tuple of str
        Names of sources.
    sky : bool
        Whether the light of the sky is modelled.
    still : tuple of str
        Numbers of the drift that are taken as 0.
    """

    draw: Literal["sums", "frames"]
    region: Literal["hole", "full"]
    knobs: Knobs
    epochs: int
    switches: Mapping[str, bool] = field(default_factory=dict)
    left_out: tuple[str, ...] = ()
    sky: bool = True
    still: tuple[str, ...] = ()

    def kept_sources(self, scene: Scene) -> Scene:
        """Return the scene with the sources that are modelled."""
        kept = {
            kind: tuple(body for body in getattr(scene, kind) if body.name not in self.left_out)
            for kind in ("planets", "stars", "extended")
        }
        return scene.model_copy(update=kept) if self.left_out else scene


class Choice(Shortcuts, kw_only=True):
    """The way in which an observation is modelled; made by `choose`.

    Attributes
    ----------
    rows : tuple of EffectRow
        Every effect, setting and source: kept or skipped, with its size.
    predicted_error : dict
        Bound of the error of each quantity asked for.
    outcome : Outcome of float
        ``ok`` with the largest predicted error; ``invalid`` where a named tier misses its own tolerance.
    """

    rows: tuple[EffectRow, ...]
    predicted_error: dict[Quantity, float]
    outcome: Outcome[float]

    def drifting(self, instrument: Instrument) -> Instrument:
        """Return an instrument with as much of its drift as is modelled."""
        if not self.still:
            return instrument
        drift = instrument.drift.model_copy(update=dict.fromkeys(self.still, 0.0))
        return instrument.model_copy(update={"drift": drift})


def budget_of(quantity: Quantity, tolerance: float) -> float:
    """Return what the sizes of all that is left out may sum to, so that the error stays within a tolerance.

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
    """Return the inverse of `budget_of`: the error that a sum of sizes stands for; infinite where it is no bound."""
    if quantity == "planet_flux" or total == 0.0:
        return total
    if quantity == "pixel_map":
        return 1.0 - math.sqrt(1.0 - 2.0 * total) if total < 0.5 else math.inf
    return 1.0 / math.sqrt(1.0 - 2.0 * total) - 1.0 if total < 0.5 else math.inf


class _Item(Record):
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
    return _Chooser(forecast, dial, fixed, finest).made()


class _Chooser:
    """The decisions of one choice: what is modelled so far, and what it cost; parameters as of `choose`."""

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
        self.budget = {name: budget_of(name, tolerance) for name, tolerance in dial.tolerance.items()}
        self.rows_spent = 0.0

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

    def made(self) -> Choice:
        """Return everything."""
        tier = self.dial.fidelity
        if any(self.dial.tolerance.values()):
            for name in SETTINGS:
                sizes = self.knob_sizes(name, getattr(self.knobs, name))
                if any(sizes[quantity] for quantity in self.asked):
                    self._spend(name, sizes)
            within = all(self.spent[name] <= self.budget[name] for name in self.asked)
            if within or tier == "standard":
                self._leave_out(tier)
        return self._choice()

    def _spend(self, key: str, sizes: Sizes) -> None:
        for name in self.asked:
            self.spent[name] += sizes[name]
        self.rows_spent += self.size(sizes)
        self.skipped[key] = self.skipped.get(key, 0.0) + self.size(sizes)

    def _leave_out(self, tier: str) -> None:
        if tier == "custom":
            self.knobs = self.knobs.model_copy(update={"pupil_samples": 64})
        while items := [item for item in self._items(tier) if self._fits(item.sizes)]:
            self._take(min(items, key=self._rank))

    def _fits(self, sizes: Sizes) -> bool:
        within = all(self.spent[name] + sizes[name] <= self.budget[name] for name in self.asked)
        return within and self.rows_spent + self.size(sizes) <= max(self.dial.tolerance.values(), default=0.0)

    def _rank(self, item: _Item) -> float:
        share = max((item.sizes[name] / self.budget[name] for name in self.asked), default=0.0)
        return share / max(item.saved_s, 1e-9)

    def _take(self, item: _Item) -> None:
        self._spend(item.key, item.sizes)
        if item.key in SETTINGS:
            self.knobs = self.knobs.model_copy(update={item.key: item.value})
        elif item.key == "drift_epochs":
            self.epochs = item.value
        elif item.key == "hole_region":
            self.full = False
        elif item.key == "summed_frames":
            self.draw, self.epochs = "sums", min(self.epochs, SUM_EPOCHS)
            for key in NOT_IN_SUMS:
                if key in self.forecast.sizes:
                    self.skipped.setdefault(key, self.size(self.forecast.sizes[key]))

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
            if any(need not in self.skipped and self.exists(need) for need in _NEEDS.get(key, ())):
                continue
            if key in DRIFT_TERMS:
                yield _Item(key, 0.0, self.forecast.sizes[key], SCREEN_S)
            if key in FRAME_S or key in SET_UP_S:
                saved = FRAME_S.get(key, 0.0) * frames * pixels + SET_UP_S.get(key, 0.0) * pixels
                yield _Item(key, False, self.forecast.sizes[key], saved)
        for name, kind in self.forecast.sources.items():
            key = f"{kind}:{name}"
            if key not in self.skipped and key not in self.fixed:
                saved = {"planet": SOURCE_S, "star": FAR_SOURCE_S, "extended": EXTENDED_S}[kind]
                yield _Item(key, name, self.forecast.sizes[key], saved * math.sqrt(pixels))

    def _whole(self) -> Iterator[_Item]:
        """Yield the sums of frames, and the window alone."""
        frames = self.forecast.n_frames
        if self.draw == "frames" and "summed_frames" not in self.fixed and self.forecast.sums.status is Status.OK:
            sizes = dict.fromkeys(self.asked, 0.0)
            for key in NOT_IN_SUMS:
                if self.exists(key) and key not in self.skipped:
                    for name in self.asked:
                        sizes[name] += self.forecast.sizes[key][name]
            if self.epochs > SUM_EPOCHS:
                missing = self.fewer_epochs(self.epochs, SUM_EPOCHS)
                sizes = {name: sizes[name] + missing[name] for name in self.asked}
            yield _Item("summed_frames", "sums", sizes, frames * WHOLE_FRAME_S + 1.0)
        if self.full and "hole_region" not in self.fixed:
            saved = frames * WHOLE_FRAME_S * FULL_PIXELS
            yield _Item("hole_region", "hole", self.forecast.sizes["hole_region"], saved)

    def _settings(self, tier: str) -> Iterator[_Item]:
        """Yield the fewer epochs; where a tolerance chooses the knobs, fewer nodes and single precision."""
        each = stamp_s(self.knobs)
        for value in self.forecast.knob_sizes["drift_epochs"]:
            if value < self.epochs and "drift_epochs" not in self.fixed:
                sizes = self.fewer_epochs(self.epochs, value)
                yield _Item("drift_epochs", value, sizes, each * (self.epochs - value))
        if tier != "custom":
            return
        stamps = self.epochs + 2
        for name in ("wavelength_nodes", "pixel_nodes"):
            now = getattr(self.knobs, name)
            for value in self.forecast.knob_sizes[name]:
                if value < now and name not in self.fixed:
                    cheaper = stamp_s(self.knobs.model_copy(update={name: value}))
                    before, after = self.knob_sizes(name, now), self.knob_sizes(name, value)
                    sizes = {key: max(after[key] - before[key], 0.0) for key in self.asked}
                    yield _Item(name, value, sizes, stamps * (each - cheaper))
        if self.knobs.precision == "double" and "precision" not in self.fixed:
            cheaper = stamp_s(self.knobs.model_copy(update={"precision": "single"}))
            yield _Item("precision", "single", self.knob_sizes("precision", "single"), stamps * (each - cheaper))

    def _choice(self) -> Choice:
        errors = {name: error_of(name, self.spent[name]) for name in self.asked}
        worst = max(errors.values(), default=0.0)
        outcome = Outcome.ok(worst)
        late = [name for name in self.asked if self.spent[name] > self.budget[name] and self.dial.tolerance[name] > 0]
        if late:
            name = max(late, key=lambda one: errors[one] / self.dial.tolerance[one])
            errs = f"{WORDS[name]} to {errors[name]:.2g}, asked {self.dial.tolerance[name]:g}"
            message = f"{self.dial.fidelity} misses its tolerance here: {errs}"
            outcome = Outcome.refuse(Status.INVALID, Reason.TIER_TOO_COARSE, message)
        if not any(self.dial.tolerance.values()):
            self.epochs = min(self.forecast.n_frames, max(self.forecast.max_epochs, MAX_EPOCHS))
        known = {*FRAME_S, *SET_UP_S} - {"sky"}
        kept = [row.key for row in self.forecast.rows if row.decision == "kept"]
        switches = {key: False for key in kept if key in self.skipped and key in known}
        left_out = tuple(name for name, kind in self.forecast.sources.items() if f"{kind}:{name}" in self.skipped)
        region: Literal["full", "hole"] = "full" if self.full else "hole"
        return Choice(
            rows=choice_rows(self),
            knobs=self.knobs,
            switches=switches,
            left_out=left_out,
            sky="sky" not in self.skipped,
            still=tuple(number for key, number in DRIFT_TERMS.items() if key in self.skipped),
            epochs=self.epochs,
            draw=self.draw,
            region=region,
            predicted_error=errors,
            outcome=outcome,
        )


def choice_rows(chosen: _Chooser) -> tuple[EffectRow, ...]:
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


def _optics(chosen: _Chooser) -> Iterator[EffectRow]:
    for key, words in SETTINGS.items():
        value, most = getattr(chosen.knobs, key), getattr(chosen.finest, key)
        size = chosen.size(chosen.knob_sizes(key, value))
        reason = f"{value}" if value == most else f"{value} instead of {most}"
        yield EffectRow(words, _decision(size), reason, key, size)
    exact = "exact on the grid of steps and static wavefront"
    yield EffectRow("samples across the pupil", "kept", exact, "pupil_samples", 0.0)


def _drawing(chosen: _Chooser) -> Iterator[EffectRow]:
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


def checked_quantities(quantity: Quantity | Sequence[Quantity] | None, *, planets: bool) -> tuple[Quantity, ...]:
    """Return the quantities that a tolerance holds for; by default the pixel map, and with planets all three.

    Raises
    ------
    InputError
        For a name that is no quantity, or that of a planet where there is none.
    """
    known: tuple[Quantity, ...] = get_args(Quantity)
    possible = known if planets else tuple(name for name in known if name == "pixel_map")
    if quantity is None:
        return possible
    names = tuple(quantity) if isinstance(quantity, list | tuple | set | frozenset) else (quantity,)
    for name in names:
        if not isinstance(name, str) or name not in possible:
            hint = "" if planets or str(name) not in known else "the scene has no planet"
            raise InputError("quantity", name, allowed=", ".join(possible), hint=hint)
    if not names:
        raise InputError("quantity", quantity, allowed=f"at least one of {', '.join(possible)}")
    return tuple(name for name in known if name in names)


def observation_choice(
    scene: Scene,
    instrument: Instrument,
    *,
    tolerance: float,
    quantity: Quantity | Sequence[Quantity] | None,
    finest: Knobs,
    **settings: Any,
) -> Choice:
    """Return what an observation leaves out; drawn frame by frame, on the window that was asked for.

    Parameters
    ----------
    scene, instrument
        As `simulator.ledger.forecast`.
    tolerance, quantity
        As `simulator.observing.observation.observe`.
    finest : Knobs
        Settings of the optics without a tolerance.
    **settings
        As `simulator.ledger.forecast`.
    """
    asked = checked_quantities(quantity, planets=bool(scene.planets))
    dial = Dial(fidelity="custom", tolerance=dict.fromkeys(asked, tolerance), knobs=None)
    predicted = forecast(scene, instrument, **settings)
    return choose(predicted, dial, fixed=("summed_frames", "hole_region"), finest=finest)
