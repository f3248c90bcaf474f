"""The question of ``cpic confirm``, and the settings of measured images that plans and single stars share.

Images may have a reality worse than the model: an override alters the simulator alone, while predictions keep the
nominal instrument. It is a key and what becomes of its value::

    throughput=x0.7                 every band loses 30 % of its light
    read_noise=x1.5  visit_drift=x3
    drift=0.1nm                     offset of a visit 0.1 nm rms, and the walk within it in the same ratio
    drift.visit_nm=0.1              any number or word of the instrument, by its dotted key, whose name has the unit
    bands.F850.qe=x0.8              "*" stands for any name: bands.*.qe, bands.F5*.qe
    detector.switches.cosmic_rays=off
    companions=on                   light of companions, which the prediction leaves out
"""

import os
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self, TypeAlias, cast

from pydantic import Field, field_validator, model_validator

from catalogs import resolve_star
from cpic_core import InputError, is_file, load_mapping
from cpic_planner.queries import shared
from cpic_planner.queries.base import Parts, called, check_visits
from cpic_planner.queries.changes import (
    ALIASES,
    COMPANIONS,
    DRIFT,
    NAMES,
    Alteration,
    Change,
    alterations,
    changed,
    long_key,
    read_instrument,
    tree_of,
)
from cpic_planner.queries.fields import asked, asked_visit_time
from simulator.config import FrozenModel, Instrument, Scene, Utc, at, checked_utc, load_scene, to_unit, unit_of
from simulator.knobs import Dial, dial_of

_WHERE = "simulator_overrides"
OnOff: TypeAlias = Literal["on", "off"]


class SimulatorOverrides(FrozenModel):
    """Alterations of the simulator alone. Equal content has an equal `content_hash`, however it was written."""

    entries: tuple[Change, ...] = ()

    @field_validator("entries")
    @classmethod
    def _each_once(cls, entries: tuple[Change, ...]) -> tuple[Change, ...]:
        keys = [entry.key for entry in entries]
        for key in keys:
            if keys.count(key) > 1:
                hint = f"{NAMES[key]} is the same key" if key in NAMES else ""
                raise InputError(key, "given twice", allowed="each key once", hint=hint)
        return tuple(sorted(entries, key=lambda entry: entry.key))

    @classmethod
    def of(cls, source: "OverrideSource", nominal: Instrument | None = None) -> "SimulatorOverrides":
        """Read alterations as people give them.

        Parameters
        ----------
        source : mapping, str, Path, sequence of str or Path, SimulatorOverrides, None
            A mapping of keys to values, flat (``{"detector.read_noise_e": "x1.5"}``) or nested as an instrument's file;
            ``"KEY=VALUE"``; the path of a YAML file with such a mapping; or several of the last two. A value is a
            number, with a unit or without (``"0.1nm"``), a word, or a factor on the present value: ``"x0.7"`` or
            ``"*0.7"``. `ALIASES` are short keys, whose numbers need a unit or an x, in files too; so does ``drift``,
            which is the offset of a visit, and scales the walk within it in the same ratio.
        nominal : Instrument, optional
            Instrument of the prediction, whose numbers are named where a value is refused.

        Returns
        -------
        SimulatorOverrides
            Keys are compared with those of an instrument by `instrument`.

        Raises
        ------
        InputError
            For what cannot be read, a key given twice, values that no key takes, and a number that could be a value or
            a factor.
        """
        if isinstance(source, SimulatorOverrides):
            return source
        try:
            return cls(entries=tuple(Change.read(key, value, nominal) for key, value in _pairs(source)))
        except InputError as error:
            raise _named(error) from None
        except ValueError as error:  # pydantic's, around a refusal of ours
            raise _named(_inner(error)) from None

    @property
    def alters_optics(self) -> bool:
        """Whether point-spread functions differ: they are computed anew, which takes up to a minute a band once."""
        return any(entry.is_optical for entry in self.entries)

    def text(self) -> str:
        """Return the overrides in one line, for reports."""
        return ", ".join(entry.text for entry in self.entries) or "none"

    def as_mapping(self) -> dict[str, Any]:
        """Return a mapping of keys to values, which `of` reads."""
        return {
            entry.key: entry.value_text if entry.action == "scale" or entry.key == DRIFT else entry.value
            for entry in self.entries
        }

    def companions(self, nominal: OnOff) -> OnOff:
        """Return whether the light of companions is in the images, given whether the prediction counts it."""
        return next((cast(OnOff, entry.value) for entry in self.entries if entry.key == COMPANIONS), nominal)

    def scene(self, nominal: Scene) -> Scene:
        """Return the scene that is simulated, given the one of the prediction."""
        chosen = self.companions(nominal.companions)
        return nominal if chosen == nominal.companions else nominal.model_copy(update={"companions": chosen})

    def changes(self, nominal: Instrument) -> tuple[Alteration, ...]:
        """Return every number and word of an instrument that is altered, by key.

        Raises
        ------
        InputError
            For a key that the instrument does not have, a factor on what is no number, and a value altered twice.
        """
        try:
            return alterations(nominal, (entry for entry in self.entries if entry.key != COMPANIONS))
        except InputError as error:
            raise _named(error) from None

    def instrument(self, nominal: Instrument) -> Instrument:
        """Return the instrument that is simulated, given the one of the prediction.

        Raises
        ------
        InputError
            As `changes`; and for a value that the instrument cannot have, naming it.
        """
        changes = self.changes(nominal)
        if not changes:
            return nominal
        tree = {"name": f"{nominal.name}+overrides"} | tree_of(changes, _sourced)
        try:
            return nominal.changed(tree)
        except InputError as error:
            raise _refused(error, changes, self.text()) from None


OverrideSource: TypeAlias = SimulatorOverrides | Mapping[str, Any] | str | Path | Iterable[str | Path] | None


def _pairs(source: OverrideSource) -> Iterator[tuple[str, Any]]:
    """Yield the keys and values of a source, as they are written."""
    if source is None:
        return
    if isinstance(source, Mapping):
        yield from _flat(source)
    elif isinstance(source, str) and "=" in source:
        key, _, text = source.partition("=")
        if not key.strip() or not text.strip():
            raise InputError("", source, allowed="KEY=VALUE, as throughput=x0.7, or a YAML file")
        yield key.strip(), text.strip()
    elif isinstance(source, str | Path):
        if not is_file(source):
            raise InputError("", str(source), allowed="KEY=VALUE, as throughput=x0.7, or a YAML file that exists")
        tree = load_mapping(source, _WHERE, (*ALIASES, COMPANIONS, *Instrument.model_fields))
        if tree.pop("kind", _WHERE) != _WHERE:
            raise InputError("kind", str(source), allowed=f"a file of kind: {_WHERE}")
        yield from _flat(tree)
    elif isinstance(source, Iterable) and getattr(source, "ndim", True):  # an array of one number has no items
        for item in source:
            if not isinstance(item, str | Path):
                raise InputError("", item, allowed="KEY=VALUE or the path of a YAML file")
            yield from _pairs(item)
    else:
        raise InputError("", source, allowed="a mapping, KEY=VALUE, or the path of a YAML file")


def _flat(tree: Mapping[Any, Any], above: str = "") -> Iterator[tuple[str, Any]]:
    for name, value in tree.items():
        key = f"{above}.{name}" if above else str(name)
        if isinstance(value, Mapping):
            yield from _flat(value, key)
        else:
            yield key, _stated(key, value)


def _stated(key: str, value: Any) -> Any:
    """Return a value of a mapping, one of `astropy.units` as a text with the unit of its key."""
    if not hasattr(value, "to_value"):
        return value
    unit = unit_of(long_key(key))
    number = to_unit(long_key(key), value)
    return f"{number!r} {unit}" if unit else number


def _sourced(item: Alteration) -> dict[str, Any]:
    """Return an altered value with its standing, as an instrument's file has it."""
    source = f"override of the simulator, {item.change.text}; nominal {item.nominal}"
    return {"value": item.altered, "source": source, "confidence": "A"}


def _named(error: InputError) -> InputError:
    """Return a refusal with the name of the overrides before its key."""
    if error.key:
        return at(_WHERE, error)
    return InputError(_WHERE, error.value, unit=error.unit, allowed=error.allowed, hint=error.hint)


def _inner(error: ValueError) -> InputError:
    """Return our refusal that pydantic reports."""
    for item in getattr(error, "errors", list)():
        cause = item.get("ctx", {}).get("error")
        if isinstance(cause, InputError):
            return cause
    raise error


def _refused(error: InputError, changes: tuple[Alteration, ...], text: str) -> InputError:
    """Return the instrument's refusal in the words of the overrides."""
    key = error.key.removeprefix("instrument.")
    for item in changes:
        if key == item.key or key.startswith(f"{item.key}."):
            change = item.change
            scaled = f"{key} is {_short(item.nominal)}, and would be {_short(error.value)}"
            hint = scaled if change.action == "scale" else error.hint
            refusal = InputError(change.key, change.value_text, unit=error.unit, allowed=error.allowed, hint=hint)
            return at(_WHERE, refusal)
    return InputError(_WHERE, text, allowed=error.allowed, hint=f"{key} would be {_short(error.value)}")


def _short(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)


REALISATIONS = 8
"""Draws of drift and noise of every target and band: an SNR of 10 from 12 apertures is then known to 9 %."""


class ImageQuestion(shared.InstrumentQuestion):
    """The settings that decide images that are measured.

    ``fidelity`` or ``tolerance`` set the dial of speed against accuracy, ``standard`` without any.
    ``simulator_overrides`` alter the images alone.
    """

    strategy: shared.Strategy = shared.asked_strategy()
    realisations: int = asked(
        REALISATIONS,
        "Simulated observations of every planet and band, each with its own drift and noise.",
        ge=1,
        le=shared.MAX_REALISATIONS,
    )
    simulator_overrides: SimulatorOverrides = asked(
        SimulatorOverrides(),
        "Alter the simulator alone, as throughput=x0.7, companions=on or detector.cic_e=0.05; repeat for several. Or a "
        "YAML file.",
        metavar="KEY=VALUE",
        several=True,
        option="--simulator-overrides",
        accepts="mapping, str, Path or sequence",
    )
    fidelity: shared.Fidelity | None = asked(None, "Speed against accuracy of the images.", unset="standard")
    tolerance: float | None = asked(
        None,
        "Instead of {fidelity}: the cheapest images whose planet flux and SNR are predicted to be this close to the "
        "reference, 0 to 0.5.",
    )
    seed: shared.Seed = asked(1, "Seed of every random number.")

    @classmethod
    def _read(cls, tree: dict[str, Any]) -> dict[str, Any]:
        tree = super()._read(tree)
        if "simulator_overrides" in tree:
            tree["simulator_overrides"] = SimulatorOverrides.of(tree["simulator_overrides"], tree.get("instrument"))
        return tree

    @model_validator(mode="after")
    def _imaged(self) -> Self:
        self.simulator_overrides.instrument(self.instrument)  # refuses unknown keys
        self.refuse_together(("tolerance", "fidelity"), "they are two names of one dial")
        refuse_counting(self.strategy, self.dial)
        return self

    @property
    def dial(self) -> Dial:
        """Speed against accuracy."""
        return dial_of(self.fidelity, self.tolerance)

    def hashed(self) -> dict[str, Any]:
        """Return what decides numbers; the dial by what it does, not by the name that it was given."""
        tree = super().hashed()
        del tree["fidelity"], tree["tolerance"]
        return tree | {"dial": self.dial.model_dump(mode="json")}

    @property
    def image_settings(self) -> dict[str, Any]:
        """Settings of `cpic_planner.validation.task.task_of`."""
        same = {name: getattr(self, name) for name in ("seed", "fidelity", "tolerance", "realisations")}
        return same | {"overrides": self.simulator_overrides}


class StarImagesQuestion(ImageQuestion, shared.StarsQuestion, shared.RunQuestion):
    """Images of named stars, each with its reference planet at the best separation."""

    KIND: ClassVar[str] = "confirm_targets"

    target: shared.Texts = asked(..., "Star names.", accepts="str or sequence of str")
    time_s: float = asked(
        36000.0, "Wall time per target and band, readouts and reference frames included.", ge=1e-3, le=1e9
    )
    planet: shared.ReferencePlanet = shared.asked_planet()


def audited(dial: Dial, asked_for: bool | None = None) -> bool:
    """Return whether one more realisation has every effect of single frames, beside those that are drawn as sums.

    Parameters
    ----------
    dial : Dial
    asked_for : bool, optional
        What was asked for; ``standard`` has an audit and no other setting without.

    Raises
    ------
    InputError
        Where one is asked of the reference.
    """
    if asked_for and dial.fidelity == "reference":
        hint, allowed = "the reference runs every realisation frame by frame", "quick, standard or a tolerance"
        raise InputError("audit", "given", allowed=allowed, hint=hint)
    return dial.fidelity == "standard" if asked_for is None else asked_for


def refuse_counting(strategy: shared.Strategy, dial: Dial) -> None:
    """Refuse photon counting frame by frame.

    Raises
    ------
    InputError
        Naming the mode.
    """
    if strategy.mode != "analogue" and dial.fidelity == "reference":
        hint = "photons are counted in sums of frames, not yet frame by frame: quick, standard or a tolerance"
        raise InputError("strategy.mode", strategy.mode, allowed="analogue", hint=hint)


MAX_FRAMES = 4000
"""Frames of one sequence that are held in memory at once (0.6 GB of stamps)."""


class SceneParts(Parts):
    """Options of a scene."""

    scene: str = asked(..., "Scene: a preset or a YAML file.", argument=True)
    companions: shared.OnOff | None = asked(
        None, "Put the scene's companions on the images.", unset="as the scene says"
    )

    def made(self, base: Any) -> Scene:
        """Return the scene, with or without its companions."""
        chosen = _scene(self.scene)
        return chosen if self.companions is None else chosen.model_copy(update={"companions": self.companions})


def _scene(source: str) -> Scene:
    """Return the scene of a preset or a file; say what to do with the name of a star."""
    try:
        return load_scene(source)
    except InputError as error:
        if error.key != "scene" or os.path.exists(source):
            raise
        try:
            resolve_star(source)
        except InputError:
            raise error from None
        hint = "this is a star of the catalogue: write a scene with it as cstar, or see cpic plan"
        raise InputError(error.key, source, allowed=error.allowed, hint=hint) from None


class ConfirmQuestion(shared.Timed, ImageQuestion, shared.RunQuestion):
    """Everything that decides the confirmation of a scene.

    Frames are given by ``exposure_s`` and ``n_frames`` (of one visit where there is no number of visits), or visits and
    frames are those of most SNR within ``time_s`` of wall time, as the exposure-time calculator chooses them for the
    first planet of the scene that is in the dark hole of the band (for one of 1e-8 at the middle of the hole where it
    has none). A gain that is not given is the best one.
    ``audit`` None: as `cpic_planner.queries.images.audited` says.
    """

    KIND: ClassVar[str] = "confirm"

    scene: Scene = asked(
        ...,
        "The scene, with any number of planets and other stars; what `simulator.load_scene` reads.",
        parts=SceneParts,
        read=load_scene,
        accepts="Scene, mapping, str or Path",
    )
    date_utc: Utc | None = asked(
        None,
        "Date of the observation, UTC: that of the light of the sky; a scene has places of its own.",
        option="--date",
        unset="the mission's start",
    )
    time_s: Annotated[float, Field(ge=1e-3, le=1e9)] | None = asked(
        None, "Wall time of all visits per band, readouts, reference frames and overheads included.", unset="36000"
    )
    visit_time_s: float | None = asked_visit_time()
    exposure_s: Annotated[float, Field(ge=1e-6, le=1e6)] | None = asked(None, "Exposure of one frame.")
    n_frames: Annotated[int, Field(ge=1, le=MAX_FRAMES)] | None = asked(
        None, "Science frames of a visit; needs {exposure_s}.", option="--frames"
    )
    em_gain: Annotated[float, Field(ge=1, le=1e4)] | None = asked(None, "Actual EM gain.", unset="the best one")
    audit: bool | None = asked(
        None,
        "Make one more realisation with every effect of the camera, a part of its frames run one by one.",
        unset="with {fidelity} standard",
    )
    out: Path | None = asked(None, "Output folder.", unset="print only", physics=False, metavar="DIR")

    @classmethod
    def _read(cls, tree: dict[str, Any]) -> dict[str, Any]:
        if "date_utc" in tree:
            start = Change(key="mission.start_utc", value=checked_utc("date_utc", tree["date_utc"]))
            tree["instrument"] = changed(read_instrument(tree.get("instrument")), (start,))
        return super()._read(tree)

    @model_validator(mode="after")
    def _frames(self) -> Self:
        for name in ("time_s", "visit_time_s"):
            if getattr(self, name) is not None and self.n_frames is not None:
                allowed = f"without {called(name)}"
                raise InputError("n_frames", self.n_frames, allowed=allowed, hint="the time sets their number")
        check_visits(self.strategy.visits, self.visit_time_s, self.time_s)
        if self.n_frames is not None and self.exposure_s is None:
            raise InputError("n_frames", self.n_frames, allowed=f"together with {called('exposure_s')}")
        timed = self.time_s is not None or self.visit_time_s is not None
        if self.exposure_s is not None and self.n_frames is None and not timed:
            allowed = f"together with {called('n_frames')} or {called('time_s')}"
            raise InputError("exposure_s", self.exposure_s, unit="s", allowed=allowed)
        if self.force and self.out is None:
            raise InputError("force", "given", allowed=f"together with {called('out')}")
        audited(self.dial, self.audit)
        return self
