"""Reality worse than the model: what is altered in the simulator alone, while predictions keep the nominal instrument.

An override is a key and what becomes of its value::

    throughput=x0.7                 every band loses 30 % of its light
    read_noise=x1.5  visit_drift=x3
    drift=0.1nm                     offset of a visit 0.1 nm rms, and the walk within it in the same ratio
    drift.visit_nm=0.1              any number or word of the instrument, by its dotted key, whose name has the unit
    bands.F850.qe=x0.8              "*" stands for any name: bands.*.qe, bands.F5*.qe
    detector.switches.cosmic_rays=off
    companions=on                   light of companions, which the prediction leaves out
"""

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, Literal, TypeAlias, cast

from pydantic import field_validator

from cpic_core import InputError, is_file, load_mapping
from cpic_planner.queries.changes import (
    ALIASES,
    COMPANIONS,
    DRIFT,
    NAMES,
    Alteration,
    Change,
    alterations,
    long_key,
    tree_of,
)
from simulator.config import FrozenModel, Instrument, Scene, at, to_unit, unit_of

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
