"""Changes of an instrument: a dotted key, and what becomes of its value.

The one way in which simulator overrides, assumptions of rankings and surveys, and options alter a number::

    throughput=x0.7                 every band loses 30 % of its light
    drift=0.1nm                     offset of a visit 0.1 nm rms, and the walk within it in the same ratio
    drift.visit_nm=0.1              any number or word of the instrument, by its dotted key, whose name has the unit
    bands.F850.qe=x0.8              "*" stands for any name: bands.*.qe, bands.F5*.qe
    detector.switches.cosmic_rays=off
    companions=on                   light of companions, which the prediction leaves out

A value carries a unit or is a factor with an x before it. A number alone is taken by a key whose name ends in its unit
(``time_s=3600``), and by a quantity that has none (counts, fractions, contrasts). Where it could be read both ways, as
a value and as a factor, it is refused with both spellings (`two_spellings`).

Images may have a reality worse than the model: `SimulatorOverrides` are changes of the simulator alone, while
predictions keep the nominal instrument.
"""

import math
import re
from collections.abc import Iterable, Iterator, Mapping
from fnmatch import fnmatchcase
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal, Self, TypeAlias, cast

from pydantic import StrictBool, StrictFloat, StrictInt, StrictStr, model_validator

from cpic_core import InputError, Record, converted, is_file, load_mapping, number_and_unit, parse_yaml, units_like
from cpic_planner.queries.question import Parts, advice, asked, asked_changes, children, matching, put, sections
from simulator import config

if TYPE_CHECKING:
    from cpic_planner.results import InstrumentValue


_FACTOR = re.compile(r"[x*×]\s*([-+.\d].*)")


class Written(Record):
    """A value as it was written.

    Attributes
    ----------
    action : {"set", "scale"}
        ``scale`` for a factor on the present value.
    value : object
        The factor; or the number in the unit of its key, a list, or a word.
    text : str
        How tables and legends write it: ``x2``, ``0.1 nm``, ``1e-8``.
    bare : bool
        Whether it is a number with neither a unit nor an x.
    """

    action: Literal["set", "scale"]
    value: Any
    text: str
    bare: bool = False


def read_value(key: str, text: str, unit: str = "") -> Written:
    """Read a value.

    Parameters
    ----------
    key : str
        Its key, for refusals.
    text : str
        A number, a number with a unit, a factor as ``x0.7``, a list, or a word.
    unit : str
        Unit of the key's number, in the spelling of `simulator.config.base.unit_of`; empty where it has none.

    Returns
    -------
    Written

    Raises
    ------
    InputError
        For a factor that is negative or not finite, and for a unit that does not convert to that of the key.

    Examples
    --------
    >>> from cpic_planner.queries.changes import read_value
    >>> read_value("drift.visit_nm", "100pm", "nm")
    Written(action='set', value=0.1, text='100 pm', bare=False)
    >>> read_value("throughput", "x0.7").action
    'scale'
    """
    text = text.strip()
    factor = _FACTOR.fullmatch(text)
    if factor is not None:
        number = _plain(key, factor[1])
        if not is_number(number) or not 0 <= number < math.inf:
            raise InputError(key, text, allowed="a factor on the present value, as x0.7: finite, at least 0")
        return Written("scale", number, f"x{factor[1].strip()}")
    if (unit or text.endswith("%")) and (parts := number_and_unit(text)):
        value = converted(text, unit)
        if value is None:
            allowed = f"a number with a unit: {', '.join(filter(None, units_like(unit)))}"
            raise InputError(key, text, allowed=allowed)
        return Written("set", value, " ".join(parts))
    value = _plain(key, text)
    if isinstance(value, list):
        items = [
            read_value(key, item, unit) if isinstance(item, str) else Written("set", item, str(item), True)
            for item in value
        ]
        plain = all(item.bare and is_number(item.value) for item in items)
        return Written("set", [item.value for item in items], with_unit(text, unit) if plain else text)
    if is_number(value):
        return Written("set", value, with_unit(text, unit), bare=True)
    return Written("set", value, text)


def seconds_text(key: str, text: str) -> str:
    """Return the seconds of a time with a unit (``2h``), as the shortest text of the number.

    Parameters
    ----------
    key : str
        For refusals.
    text : str
        What was written.

    Raises
    ------
    InputError
        For a number alone, and what is no time.
    """
    written = read_value(key, text, "s")
    if written.bare or written.action != "set" or not isinstance(written.value, float):
        raise InputError(key, text or "nothing", allowed="a time with a unit: s, min, h or d, as 2h")
    return repr(written.value)


def with_unit(text: str, unit: str) -> str:
    """Return a value followed by its unit, if it has one.

    Parameters
    ----------
    text : str
        What was written.
    unit : str
        Unit of the value, in words; empty without one.
    """
    return f"{text} {unit}" if unit else text


def two_spellings(
    key: str, name: str, text: str, *, unit: str, present: float | None = None, value_key: str = ""
) -> InputError:
    """Return the refusal of a number that could be a value or a factor; it names both spellings and their meanings.

    Parameters
    ----------
    key : str
        Key of the refusal.
    name : str
        Name of the value as it was written.
    text : str
        The number.
    unit : str
        Unit of the value; empty where it has none.
    present : float, optional
        What a factor multiplies.
    value_key : str
        Key that takes the number as a value where the quantity has no unit; empty where there is none.
    """
    number = _plain(key, text)
    times = f"{name}=x{text} is {text} times the instrument's"
    if present is not None:
        times += f" {with_unit(f'{present:g}', unit)}: {with_unit(f'{present * number:g}', unit)}"
    value = f"{name}={text}{unit} is {text} {unit}" if unit else f"{value_key}={text} is the value itself"
    spelled = f"{times}; {value}" if unit or value_key else times
    asked = f"a unit ({unit}), or an x before a factor" if unit else "an x before a factor"
    return InputError(key, text, allowed=asked, hint=spelled)


def _plain(key: str, text: str) -> Any:
    """Return a number, truth value, null, list or mapping as YAML reads it; other words as they are."""
    try:
        return parse_yaml(text, where=key)
    except InputError:
        if text[:1] in ("[", "{"):
            raise
        return text


def is_number(value: Any) -> bool:
    """Return whether a value is a number, which a truth value is not."""
    return isinstance(value, int | float) and not isinstance(value, bool)


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

Their names have no units: numbers are given with one, or with an x as factors. `DRIFT` is short for two keys.
"""
DRIFT, _VISIT, _WALK = "drift", "drift.visit_nm", "drift.walk_nm_per_sqrt_hour"
COMPANIONS = "companions"
"""The one key that is not of the instrument: whether the light of companions is in the scene."""
SHORT_KEYS = (*ALIASES, DRIFT)
"""Short names whose numbers need a unit or an x."""
NAMES = {key: name for name, key in ALIASES.items()}
Plain: TypeAlias = StrictBool | StrictInt | StrictFloat | StrictStr | None

# What `simulator.imaging.store.metrics_key` is made of.
_IN_VISIBLE = ("telescope", "coronagraph", "wavefront", "mirror", "dark_hole", "drift.psd_slope")
_IN_INFRARED = ("pixel_scale_arcsec", "mask_half_width_arcsec", "outer_half_side_arcsec")
_IN_BAND = ("camera", "center_nm", "width_nm", "transmission_file")
_OPTICS = (
    *(*_IN_VISIBLE, "detector.pixel_scale_arcsec"),
    *(f"near_infrared.{name}" for name in _IN_INFRARED),
    *(f"bands.*.{name}" for name in _IN_BAND),
)


class Change(config.FrozenModel):
    """One change: ``set`` a key of the instrument to a value, or ``scale`` its number by a factor.

    ``key`` is dotted and may hold ``*``; the key ``companions``, set to ``on`` or ``off``, is the scene's.
    """

    key: str
    action: Literal["set", "scale"] = "set"
    value: Plain

    @model_validator(mode="after")
    def _possible(self) -> Self:
        if self.action == "scale" and not (is_number(self.value) and cast(float, self.value) >= 0):
            raise self.refused("a finite factor, at least 0")
        if self.key == COMPANIONS and (self.action == "scale" or self.value not in ("on", "off")):
            raise self.refused("on, off")
        return self

    def refused(self, allowed: str, hint: str = "") -> InputError:
        """Return the refusal of this change."""
        return InputError(self.key, self.value_text, allowed=allowed, hint=hint)

    @property
    def value_text(self) -> str:
        """What becomes of the value, as it is written: ``x0.7``, ``160``; that of drift has its unit, ``0.1 nm``."""
        text = f"{'x' if self.action == 'scale' else ''}{config.canonical_json(self.value).strip(chr(34))}"
        return with_unit(text, config.unit_of(_VISIT)) if self.key == DRIFT and self.action == "set" else text

    @property
    def text(self) -> str:
        """In words: ``throughput x0.7``, ``detector.cic_e = 0.05 e-``, ``companions on``."""
        name = NAMES.get(self.key, self.key)
        if self.action == "scale" or self.key == COMPANIONS:
            return f"{name} {self.value_text}"
        return f"{name} = {with_unit(self.value_text, config.unit_of(self.key) if is_number(self.value) else '')}"

    @classmethod
    def scaling(cls, key: str, factor: float) -> Self:
        """Return the change of a number by a factor."""
        return cls(key=key, action="scale", value=factor)

    @classmethod
    def read(cls, given: str, value: Any, nominal: config.Instrument | None = None) -> Self:
        """Return the change that a key and a value mean, as people write them.

        Parameters
        ----------
        given : str
            A dotted key, or one of `ALIASES`, whose numbers need a unit or an x.
        value : bool, int, float, str or None
        nominal : Instrument, optional
            Whose numbers are named where a value is refused.

        Raises
        ------
        InputError
            For what cannot be read, and a number that could be a value or a factor.
        """
        key, unit = ALIASES.get(given, given), config.unit_of(long_key(given))
        if not isinstance(value, bool | int | float | str | None):
            raise InputError(key, value, allowed="a number, a word, or a factor as x0.7")
        bare, text = is_number(value), str(value)
        if isinstance(value, str):
            written = read_value(key, value, unit)
            if written.action == "scale":
                return cls(key=key, action="scale", value=written.value)
            bare = written.bare
            value = written.value if isinstance(written.value, bool | int | float | None) else value
        if isinstance(value, float) and not math.isfinite(value):
            raise InputError(key, str(value), allowed="a finite number")
        if bare and given in SHORT_KEYS:
            present, value_key = _present(long_key(given), nominal), "" if unit else key
            raise two_spellings(given, given, text.strip(), unit=unit, present=present, value_key=value_key)
        if key == DRIFT and not (is_number(value) and value >= 0):
            allowed = "a factor as x2, or a number with a unit as 0.1nm, at least 0"
            raise InputError(key, text, allowed=allowed, hint=f"its keys: {', '.join(config.Drift.model_fields)}")
        if key == COMPANIONS and isinstance(value, bool):
            value = "on" if value else "off"
        return cls(key=key, value=value)

    @classmethod
    def written(cls, text: str, nominal: config.Instrument | None = None) -> Self:
        """Return the change of a text ``KEY=VALUE``; see `read`."""
        return cls.read(*_key_and_value(text, "KEY=VALUE, as drift.visit_nm=0.1nm or throughput=x0.7"), nominal)


def _key_and_value(text: str, allowed: str) -> tuple[str, str]:
    key, _, value = map(str.strip, text.partition("="))
    if not key or not value:
        raise InputError("", text, allowed=allowed)
    return key, value


def alterations(nominal: config.Instrument, changes: Iterable[Change]) -> dict[str, tuple[Change, Any, Any]]:
    """Return every number and word of an instrument that some changes alter: the change, before and after, by key.

    Raises
    ------
    InputError
        For a key that the instrument does not have, a factor on what is no number, and a value altered twice.
    """
    found: dict[str, tuple[Change, Any, Any]] = {}
    for change in changes:
        for key, value in _leaves(nominal, change):
            if key in found:
                raise change.refused("each value altered once", f"{key} is altered by {found[key][0].key} too")
            found[key] = change, value, _altered(change, key, value, nominal)
    return dict(sorted(found.items()))


def changed(nominal: config.Instrument, changes: Iterable[Change]) -> config.Instrument:
    """Return the instrument after some changes; the same object without any."""
    tree: dict[str, Any] = {}
    for key, (_, _, after) in alterations(nominal, changes).items():
        tree = put(tree, key, after)
    return nominal.changed(tree) if tree else nominal


def is_optical(key: str) -> bool:
    """Return whether a key, which may hold ``*``, can mean something that point-spread functions depend on."""
    return any(_meets(key, pattern) for pattern in _OPTICS)


def _meets(key: str, pattern: str) -> bool:
    """Return whether a key, which may hold ``*``, can mean what a pattern names or something below it."""
    ours, theirs = key.split("."), pattern.split(".")
    pairs = zip(ours, theirs, strict=False)
    return len(ours) >= len(theirs) and all(fnmatchcase(a, b) or fnmatchcase(b, a) for a, b in pairs)


def long_key(key: str) -> str:
    """Return the key that has the unit: that of a short name, of drift the offset of a visit."""
    return _VISIT if key == DRIFT else ALIASES.get(key, key)


def _present(key: str, nominal: config.Instrument | None) -> float | None:
    """Return the number of an instrument that a key means, if it means one."""
    leaves = {} if nominal is None else dict(matching(sections(nominal), key))
    values = {value for value in leaves.values() if is_number(value)}
    return values.pop() if len(values) == 1 else None


def _leaves(nominal: config.Instrument, change: Change) -> list[tuple[str, Any]]:
    """Return the keys and values of an instrument that a key means."""
    root = sections(nominal)
    if change.key == DRIFT:
        return [leaf for key in (_VISIT, _WALK) for leaf in matching(root, key)]
    leaves = list(matching(root, change.key))
    if not leaves:
        raise change.refused("a key of the instrument", advice(root, change.key, (*ALIASES, COMPANIONS)))
    for key, value in leaves:
        if (below := children(value)) is not None:
            raise change.refused(f"a single value, not all of {key}", f"its keys: {', '.join(below)}")
    return leaves


def _altered(change: Change, key: str, nominal: Any, instrument: config.Instrument) -> Any:
    if change.key == DRIFT and change.action == "set" and key == _WALK:
        offset = instrument.drift.visit_nm
        if not offset:
            hint = f"its {_VISIT} is 0: the walk cannot be scaled in the same ratio"
            raise change.refused("an instrument with drift", hint)
        return nominal * cast(float, change.value) / offset
    if change.action == "scale":
        if not is_number(nominal):
            shown = "not set" if nominal is None else str(nominal).lower()
            raise change.refused("a value: only numbers take a factor", f"{key} is {shown}")
        return nominal * cast(float, change.value)
    if isinstance(nominal, bool) and change.value in ("on", "off"):
        return change.value == "on"
    return change.value_text if isinstance(nominal, str) and is_number(change.value) else change.value


def read_instrument(source: Any) -> config.Instrument:
    """Return an instrument from what people write; see `simulator.load_instrument`."""
    return source if isinstance(source, config.Instrument) else config.load_instrument(source)


class InstrumentParts(Parts):
    """Options of the instrument; ``NAMED`` are the keys of values that have options of their own."""

    NAMED: ClassVar[dict[str, str]] = {}
    instrument: str | None = asked(
        None,
        "Preset name or YAML file with what differs.",
        unset="cpic_default",
        names_file=lambda word: word not in config.preset_names("instrument"),
    )
    changes: tuple[str, ...] = asked_changes()

    def made(self, base: Any) -> config.Instrument:
        """Return the instrument with what is changed of it."""
        given = base if self.instrument is None else self.instrument
        values = {name: value for name in self.NAMED if (value := getattr(self, name)) is not None}
        named = {name: Change(key=self.NAMED[name], value=value) for name, value in values.items()}
        return changed_instrument(given, self.changes, named)


def changed_instrument(
    source: Any, changes: Iterable[str], named: Mapping[str, Change] | None = None
) -> config.Instrument:
    """Return an instrument, as `read_instrument` reads it, after changes ``KEY=VALUE`` and those of other options."""
    built = read_instrument(source)
    with config.inside("changes"):
        every = [Change.written(text, built) for text in changes]
        made = changed(built, every)
    for name, change in (named or {}).items():
        try:
            made = changed(built, every := [*every, change])
        except InputError as error:
            raise InputError(name, change.value, unit=error.unit, allowed=error.allowed, hint=error.hint) from None
    return made


def instrument_title(instrument: config.Instrument) -> str:
    """Return the name of an instrument and its hash."""
    return f"{instrument.name} ({instrument.content_hash})"


def differing_values(instrument: config.Instrument) -> dict[str, str]:
    """Return the values of an instrument that differ from those of the shipped one, with their units, by their keys."""
    shipped = dict(_plain_values(sections(config.load_instrument())))
    values = {key: text for key, text in _plain_values(sections(instrument)) if shipped.get(key) != text}
    return {key: f"{text} {config.unit_of(key)}".strip() for key, text in values.items()}


def instrument_rows(
    instrument: config.Instrument, key: str = "", *, other: config.Instrument | None = None
) -> "list[InstrumentValue]":
    """Return values of an instrument with their sources; with another one only what differs from it.

    Parameters
    ----------
    instrument : Instrument
    key : str
        Only keys that begin so, or match it.
    other : Instrument, optional

    Raises
    ------
    InputError
        For a key that the instrument does not have.
    """
    from cpic_planner.results import InstrumentValue

    mine = dict(_plain_values(sections(instrument)))
    theirs = None if other is None else dict(_plain_values(sections(other)))
    every = dict.fromkeys((*mine, *(theirs or ())))
    names = [name for name in every if not key or name == key or name.startswith(f"{key}.") or fnmatchcase(name, key)]
    if not names:
        hint = advice(sections(instrument), key, tuple(ALIASES))
        raise InputError("key", key, allowed="a key of the instrument", hint=hint)
    rows = []
    for name in (name for name in names if theirs is None or mine.get(name) != theirs.get(name)):
        origin = instrument.provenance.get(name)
        rows.append(
            InstrumentValue(
                key=name,
                value=mine.get(name, ""),
                other=None if theirs is None else theirs.get(name, ""),
                unit=config.unit_of(name) or ("" if origin is None else origin.unit),
                short_name=next((short for short, long in ALIASES.items() if fnmatchcase(name, long)), ""),
                confidence="" if origin is None else origin.confidence,
                source=_table_words(instrument, name) if origin is None else origin.source,
            )
        )
    return rows


def _table_words(instrument: config.Instrument, name: str) -> str:
    """Return what was read from where of the tables that a key of an instrument names."""
    if not f"{name}.".startswith("coronagraph.table.") or instrument.coronagraph.table is None:
        return ""
    band = name.removeprefix("coronagraph.table").lstrip(".")
    tables = [instrument.table(one) for one in ([band] if band else instrument.bands)]
    words = [(table.origin, *table.notes) for table in tables if table is not None]
    return "; ".join(dict.fromkeys(one for table in words for one in table if one))


def _plain_values(node: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, str]]:
    """Yield the dotted keys with their values as text."""
    for name, item in node.items():
        below = children(item)
        if below:
            yield from _plain_values(below, f"{above}{name}.")
        elif below is None:
            plain = f"{item:.12g}" if isinstance(item, float) else config.canonical_json(item).strip(chr(34))
            yield f"{above}{name}", plain


class SkyParts(InstrumentParts):
    """Options of the instrument for questions about planets: two of its values have options of their own."""

    NAMED: ClassVar[dict[str, str]] = {"exozodi_zodis": ALIASES["exozodi"], "drift_nm": DRIFT}
    exozodi_zodis: float | None = asked(
        None,
        "Dust around the star, in units of the solar system's.",
        option="--exozodi",
        unset="that of the instrument, 0",
    )
    drift_nm: float | None = asked(
        None,
        "Rms of the wavefront offset between two visits; the walk within a visit changes in the same ratio.",
        option="--drift-nm",
        unset="that of the instrument, 0.05",
    )


_WHERE = "simulator_overrides"
OnOff: TypeAlias = Literal["on", "off"]


class SimulatorOverrides(config.FrozenModel):
    """Alterations of the simulator alone. Equal content has an equal `content_hash`, however it was written."""

    entries: tuple[Change, ...] = ()

    def _check_values(self) -> None:
        keys = [entry.key for entry in self.entries]
        for key in keys:
            if keys.count(key) > 1:
                hint = f"{NAMES[key]} is the same key" if key in NAMES else ""
                raise InputError(key, "given twice", allowed="each key once", hint=hint)

    @classmethod
    def of(cls, source: "OverrideSource", nominal: config.Instrument | None = None) -> "SimulatorOverrides":
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
        with config.inside(_WHERE):
            read = [Change.read(key, value, nominal) for key, value in _pairs(source)]
            return cls(entries=tuple(sorted(read, key=lambda entry: entry.key)))

    @property
    def alters_optics(self) -> bool:
        """Whether point-spread functions differ: they are computed anew, which takes up to a minute a band once."""
        return any(is_optical(entry.key) for entry in self.entries)

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

    def scene(self, nominal: config.Scene) -> config.Scene:
        """Return the scene that is simulated, given the one of the prediction."""
        chosen = self.companions(nominal.companions)
        return nominal if chosen == nominal.companions else nominal.model_copy(update={"companions": chosen})

    def instrument(self, nominal: config.Instrument) -> config.Instrument:
        """Return the instrument that is simulated, given the one of the prediction.

        Raises
        ------
        InputError
            For a key that the instrument does not have, a factor on what is no number, a value altered twice, and one
            that the instrument cannot have.
        """
        with config.inside(_WHERE):
            altered = alterations(nominal, (entry for entry in self.entries if entry.key != COMPANIONS))
        tree: dict[str, Any] = {"name": f"{nominal.name}+overrides"}
        for key, (change, before, after) in altered.items():
            source = f"override of the simulator, {change.text}; nominal {before}"
            tree = put(tree, key, {"value": after, "source": source, "confidence": "A"})
        try:
            return nominal.changed(tree) if altered else nominal
        except InputError as error:
            raise self._refused(error, altered) from None

    def _refused(self, error: InputError, altered: Mapping[str, tuple[Change, Any, Any]]) -> InputError:
        """Return the instrument's refusal in the words of the overrides."""
        key, would_be = error.key.removeprefix("instrument."), _short(error.value)
        for name, (change, before, _) in altered.items():
            if key == name or key.startswith(f"{name}."):
                scaled = f"{key} is {_short(before)}, and would be {would_be}"
                hint = scaled if change.action == "scale" else error.hint
                refusal = InputError(change.key, change.value_text, unit=error.unit, allowed=error.allowed, hint=hint)
                return config.at(_WHERE, refusal)
        return InputError(_WHERE, self.text(), allowed=error.allowed, hint=f"{key} would be {would_be}")


OverrideSource: TypeAlias = SimulatorOverrides | Mapping[str, Any] | str | Path | Iterable[str | Path] | None


def _pairs(source: OverrideSource) -> Iterator[tuple[str, Any]]:
    """Yield the keys and values of a source, as they are written."""
    if source is None:
        return
    if isinstance(source, Mapping):
        yield from _flat(source)
    elif isinstance(source, str) and "=" in source:
        yield _key_and_value(source, "KEY=VALUE, as throughput=x0.7, or a YAML file")
    elif isinstance(source, str | Path):
        if not is_file(source):
            raise InputError("", str(source), allowed="KEY=VALUE, as throughput=x0.7, or a YAML file that exists")
        tree = load_mapping(source, _WHERE, (*ALIASES, COMPANIONS, *config.Instrument.model_fields))
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
    unit = config.unit_of(long_key(key))
    number = config.to_unit(long_key(key), value)
    return f"{number!r} {unit}" if unit else number


def _short(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)
