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

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeAlias, cast

from pydantic import StrictBool, StrictFloat, StrictInt, StrictStr, field_validator, model_validator

from catalogs.errors import InputError
from catalogs.strict_yaml import load_mapping
from cpic_planner.override_keys import advice, children, is_optical, matching, sections
from cpic_planner.written_values import read_value, two_spellings, with_unit
from simulator.config import FrozenModel, Instrument, Scene, canonical_json
from simulator.config.base import unit_of
from simulator.config.keys import to_unit
from simulator.config.optics import Drift

__all__ = ["ALIASES", "Change", "Override", "OverrideSource", "SimulatorOverrides"]

ALIASES = {
    "throughput": "bands.*.t_opt",
    "quantum_efficiency": "bands.*.qe",
    "read_noise": "detector.read_noise_e",
    "dark_current": "detector.dark_e_s",
    "clock_charge": "detector.cic_e",
    "visit_drift": "drift.visit_nm",
    "walk": "drift.walk_nm_per_sqrt_hour",
    "jitter": "wavefront.jitter_mas",
    "exozodi": "sky.exozodi_zodis",
}
"""Short names of keys of the instrument; those of the detector are the visible camera's.

Their names have no units: numbers are given with one, or with an x as factors. `_DRIFT` is short for two keys.
"""
_DRIFT, _VISIT, _WALK = "drift", "drift.visit_nm", "drift.walk_nm_per_sqrt_hour"

_WHERE = "simulator_overrides"
_COMPANIONS = "companions"
_NAMES = {key: name for name, key in ALIASES.items()}
Plain: TypeAlias = StrictBool | StrictInt | StrictFloat | StrictStr | None
OnOff: TypeAlias = Literal["on", "off"]


class Override(FrozenModel):
    """One alteration: ``set`` a key of the instrument to a value, or ``scale`` its number by a factor.

    ``key`` is dotted and may hold ``*``; the key ``companions``, set to ``on`` or ``off``, is the scene's.
    """

    key: str
    action: Literal["set", "scale"] = "set"
    value: Plain

    @model_validator(mode="after")
    def _possible(self) -> Override:
        if self.action == "scale" and not (_is_number(self.value) and cast(float, self.value) >= 0):
            raise InputError(self.key, self.value_text, allowed="a finite factor, at least 0")
        if self.key == _COMPANIONS and (self.action == "scale" or self.value not in ("on", "off")):
            raise InputError(self.key, self.value_text, allowed="on, off")
        return self

    @property
    def value_text(self) -> str:
        """What becomes of the value, as it is written: ``x0.7``, ``160``; that of drift has its unit, ``0.1 nm``."""
        text = f"{'x' if self.action == 'scale' else ''}{canonical_json(self.value).strip(chr(34))}"
        return with_unit(text, unit_of(_VISIT)) if self.key == _DRIFT and self.action == "set" else text

    @property
    def text(self) -> str:
        """In words: ``throughput x0.7``, ``detector.cic_e = 0.05 e-``, ``companions on``."""
        name = _NAMES.get(self.key, self.key)
        if self.action == "scale" or self.key == _COMPANIONS:
            return f"{name} {self.value_text}"
        return f"{name} = {with_unit(self.value_text, unit_of(self.key) if _is_number(self.value) else '')}"


@dataclass(frozen=True)
class Change:
    """A number or word of the instrument before and after, and the override that changes it."""

    key: str
    nominal: Any
    altered: Any
    override: Override


class SimulatorOverrides(FrozenModel):
    """Alterations of the simulator alone. Equal content has an equal `content_hash`, however it was written."""

    entries: tuple[Override, ...] = ()

    @field_validator("entries")
    @classmethod
    def _each_once(cls, entries: tuple[Override, ...]) -> tuple[Override, ...]:
        keys = [entry.key for entry in entries]
        for key in keys:
            if keys.count(key) > 1:
                raise InputError(
                    key,
                    "given twice",
                    allowed="each key once",
                    hint=f"{_NAMES[key]} is the same key" if key in _NAMES else "",
                )
        return tuple(sorted(entries, key=lambda entry: entry.key))

    @classmethod
    def of(cls, source: OverrideSource, nominal: Instrument | None = None) -> SimulatorOverrides:
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
            return cls(entries=tuple(_override(key, value, nominal) for key, value in _pairs(source)))
        except InputError as error:
            raise _named(error.key, error) from None
        except ValueError as error:  # pydantic's, around a refusal of ours
            inner = _inner(error)
            raise _named(inner.key, inner) from None

    @property
    def is_none(self) -> bool:
        """Whether nothing is altered."""
        return not self.entries

    @property
    def alters_optics(self) -> bool:
        """Whether point-spread functions differ: they are computed anew, which takes up to a minute a band once."""
        return any(is_optical(entry.key) for entry in self.entries)

    def text(self) -> str:
        """In one line, for reports."""
        return ", ".join(entry.text for entry in self.entries) or "none"

    def as_mapping(self) -> dict[str, Any]:
        """As a mapping of keys to values, which `of` reads."""
        return {
            entry.key: entry.value_text if entry.action == "scale" or entry.key == _DRIFT else entry.value
            for entry in self.entries
        }

    def companions(self, nominal: OnOff) -> OnOff:
        """Whether the light of companions is in the images, given whether the prediction counts it."""
        for entry in self.entries:
            if entry.key == _COMPANIONS:
                return cast(OnOff, entry.value)
        return nominal

    def scene(self, nominal: Scene) -> Scene:
        """The scene that is simulated, given the one of the prediction."""
        chosen = self.companions(nominal.companions)
        return nominal if chosen == nominal.companions else nominal.model_copy(update={"companions": chosen})

    def changes(self, nominal: Instrument) -> tuple[Change, ...]:
        """Every number and word of an instrument that is altered, by key.

        Raises
        ------
        InputError
            For a key that the instrument does not have, a factor on what is no number, and a value altered twice.
        """
        found: dict[str, Change] = {}
        for entry in self.entries:
            if entry.key == _COMPANIONS:
                continue
            for key, value in _leaves(nominal, entry):
                if key in found:
                    raise InputError(
                        f"{_WHERE}.{entry.key}",
                        entry.value_text,
                        allowed="each value altered once",
                        hint=f"{key} is altered by {found[key].override.key} too",
                    )
                found[key] = Change(key, value, _altered(entry, key, value, nominal), entry)
        return tuple(found[key] for key in sorted(found))

    def instrument(self, nominal: Instrument) -> Instrument:
        """The instrument that is simulated, given the one of the prediction.

        Raises
        ------
        InputError
            As `changes`; and for a value that the instrument cannot have, naming it.
        """
        changes = self.changes(nominal)
        if not changes:
            return nominal
        tree: dict[str, Any] = {"name": f"{nominal.name}+overrides"}
        for change in changes:
            *sections, last = change.key.split(".")
            place = tree
            for section in sections:
                place = place.setdefault(section, {})
            place[last] = {
                "value": change.altered,
                "source": f"override of the simulator, {change.override.text}; nominal {change.nominal}",
                "confidence": "A",
            }
        try:
            return nominal.changed(tree)
        except InputError as error:
            raise _refused(error, changes, self.text()) from None


OverrideSource: TypeAlias = SimulatorOverrides | Mapping[str, Any] | str | Path | Iterable[str | Path] | None


def _pairs(source: OverrideSource) -> Iterator[tuple[str, Any]]:
    """Keys and values of a source, as they are written."""
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
        if not Path(source).is_file():
            raise InputError("", str(source), allowed="KEY=VALUE, as throughput=x0.7, or a YAML file that exists")
        tree = load_mapping(source, _WHERE, (*ALIASES, _COMPANIONS, *Instrument.model_fields))
        if tree.pop("kind", _WHERE) != _WHERE:
            raise InputError("kind", str(source), allowed=f"a file of kind: {_WHERE}")
        yield from _flat(tree)
    elif isinstance(source, Iterable):
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
    """A value of a mapping, one of `astropy.units` as a text with the unit of its key."""
    if not hasattr(value, "to_value"):
        return value
    unit = unit_of(_long(key))
    number = to_unit(_long(key), value)
    return f"{number!r} {unit}" if unit else number


def _long(key: str) -> str:
    """The key that has the unit: that of a short name, of drift the offset of a visit."""
    return _VISIT if key == _DRIFT else ALIASES.get(key, key)


def _override(given: str, value: Any, nominal: Instrument | None) -> Override:
    key, unit = ALIASES.get(given, given), unit_of(_long(given))
    if not isinstance(value, bool | int | float | str | None):
        raise InputError(key, value, allowed="a number, a word, or a factor as x0.7")
    bare, text = _is_number(value), str(value)
    if isinstance(value, str):
        written = read_value(key, value, unit)
        if written.action == "scale":
            return Override(key=key, action="scale", value=written.value)
        bare = written.bare
        value = written.value if isinstance(written.value, bool | int | float | None) else value
    if isinstance(value, float) and not math.isfinite(value):
        raise InputError(key, str(value), allowed="a finite number")
    if bare and given in (*ALIASES, _DRIFT):
        raise two_spellings(
            given,
            given,
            text.strip(),
            unit=unit,
            present=_present(_long(given), nominal),
            value_key="" if unit else key,
        )
    if key == _DRIFT and not (_is_number(value) and value >= 0):
        raise InputError(
            key,
            text,
            allowed="a factor as x2, or a number with a unit as 0.1nm, at least 0",
            hint=f"its keys: {', '.join(Drift.model_fields)}",
        )
    if key == _COMPANIONS and isinstance(value, bool):
        value = "on" if value else "off"
    return Override(key=key, value=value)


def _present(key: str, nominal: Instrument | None) -> float | None:
    """The number of an instrument that a key means, if it means one."""
    found = {} if nominal is None else dict(matching(sections(nominal), key))
    values = {value for value in found.values() if _is_number(value)}
    return values.pop() if len(values) == 1 else None


def _named(key: str, error: InputError) -> InputError:
    path = f"{_WHERE}.{key}" if key else _WHERE
    return InputError(path, error.value, unit=error.unit, allowed=error.allowed, hint=error.hint)


def _inner(error: ValueError) -> InputError:
    """The refusal of ours that pydantic reports."""
    for item in getattr(error, "errors", list)():
        cause = item.get("ctx", {}).get("error")
        if isinstance(cause, InputError):
            return cause
    raise error


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _leaves(nominal: Instrument, entry: Override) -> list[tuple[str, Any]]:
    """Keys and values of an instrument that a key means."""
    root = sections(nominal)
    if entry.key == _DRIFT:
        return [found for key in (_VISIT, _WALK) for found in matching(root, key)]
    found = list(matching(root, entry.key))
    if not found:
        raise InputError(
            f"{_WHERE}.{entry.key}",
            entry.value_text,
            allowed="a key of the instrument",
            hint=advice(root, entry.key, (*ALIASES, _COMPANIONS)),
        )
    for key, value in found:
        below = children(value)
        if below is not None:
            raise InputError(
                f"{_WHERE}.{entry.key}",
                entry.value_text,
                allowed=f"a single value, not all of {key}",
                hint=f"its keys: {', '.join(below)}",
            )
    return found


def _altered(entry: Override, key: str, nominal: Any, instrument: Instrument) -> Any:
    if entry.key == _DRIFT and entry.action == "set" and key == _WALK:
        offset = instrument.drift.visit_nm
        if not offset:
            raise InputError(
                f"{_WHERE}.{entry.key}",
                entry.value_text,
                allowed="an instrument with drift",
                hint=f"its {_VISIT} is 0: the walk cannot be scaled in the same ratio",
            )
        return nominal * cast(float, entry.value) / offset
    if entry.action == "scale":
        if not _is_number(nominal):
            shown = "not set" if nominal is None else str(nominal).lower()
            raise InputError(
                f"{_WHERE}.{entry.key}",
                entry.value_text,
                allowed="a value: only numbers take a factor",
                hint=f"{key} is {shown}",
            )
        return nominal * cast(float, entry.value)
    if isinstance(nominal, bool) and entry.value in ("on", "off"):
        return entry.value == "on"
    return entry.value_text if isinstance(nominal, str) and _is_number(entry.value) else entry.value


def _refused(error: InputError, changes: tuple[Change, ...], text: str) -> InputError:
    """The instrument's refusal in the words of the overrides."""
    key = error.key.removeprefix("instrument.")
    for change in changes:
        if key == change.key or key.startswith(f"{change.key}."):
            scaled = f"{key} is {_short(change.nominal)}, and would be {_short(error.value)}"
            hint = scaled if change.override.action == "scale" else error.hint
            return InputError(
                f"{_WHERE}.{change.override.key}",
                change.override.value_text,
                unit=error.unit,
                allowed=error.allowed,
                hint=hint,
            )
    return InputError(_WHERE, text, allowed=error.allowed, hint=f"{key} would be {_short(error.value)}")


def _short(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)
