"""Strategies with values of keys that are varied: ``--vary drift=0.1nm,x2``."""

import itertools
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from cpic_core import InputError
from cpic_planner.queries import Written, get, keys_of, put, read_value, scaled, two_spellings, with_unit
from cpic_planner.results import VariedSetting
from cpic_planner.survey.strategy import SurveyStrategy
from cpic_planner.survey.strategy_file import MAX_STRATEGIES, SHARES, StrategiesConfig, budgeted
from simulator.config import Instrument, nearest, unit_of, validate

SHORT_NAMES = {
    "contrast": "assumptions.contrast",
    "drift": "assumptions.drift",
    "throughput": "assumptions.throughput",
    "exozodi": "assumptions.exozodi",
    "budget_h": "time_budget_h",
    "time_s": "visit.time_s",
    "max_visits": "revisits.max_visits",
    "max_targets": "targets.max_targets",
    "rule": "detection.rule",
    "library": "reduction.library",
}
"""Short names of keys of a strategy."""
_DRIFT, _THROUGHPUT, _EXOZODI = "assumptions.drift", "assumptions.throughput", "assumptions.exozodi"
_UNITS = {_DRIFT: "nm", _THROUGHPUT: "", _EXOZODI: "zodi"}
"""Units of keys whose names do not end in them: they take a unit or an x."""


@dataclass(frozen=True)
class _Sweep:
    """One ``--vary``: the option, the key, its name as it was written, and its values."""

    option: str
    key: str
    name: str
    values: tuple[Written, ...]

    @property
    def where(self) -> str:
        """The key in refusals."""
        return f"{self.option} {self.name}"

    def setting(self, text: str, value: Any, unit: str, meaning: str) -> VariedSetting:
        """Return one of its values as results tell it."""
        return VariedSetting(name=self.name, key=self.key, text=text, value=value, unit=unit, meaning=meaning)


def varied(
    config: StrategiesConfig, sweeps: Sequence[str], *, facts: bool = False, option: str = "--vary"
) -> StrategiesConfig:
    """Return every strategy with every combination of values of some keys.

    Parameters
    ----------
    config : StrategiesConfig
    sweeps : sequence of str
        ``KEY=VALUE,VALUE...``: a dotted key of a strategy, or a short name of one (`SHORT_NAMES`). A value is a number
        with a unit (``time_s=1h``), a factor on the strategy's own value (``budget_h=x0.5``), a number alone where the
        key ends in its unit or the quantity has none, a word, or a list as ``[A,B]``. ``drift``, ``throughput`` and
        ``exozodi`` need a unit or an x, and their factors are on the numbers of the instrument: ``drift=x2`` doubles
        the offset of a visit and the walk within it; ``drift=0.1nm`` makes the offset 0.1 nm and scales the walk in the
        same ratio.
    facts : bool
        Whether every variant is also compared without each fact that is known, which takes several times as long.
    option : str
        What refusals call the values.

    Returns
    -------
    StrategiesConfig
        Strategies are named ``NAME KEY=VALUE`` with the unit or the x; the first one comes first for all values.

    Raises
    ------
    InputError
        For an unknown key, a value that it cannot have, and a number that could be a value or a factor.
    """
    parsed = [_sweep(text, config, option) for text in sweeps]
    keys = [item.key for item in parsed]
    for item in parsed:
        if keys.count(item.key) > 1:
            raise InputError(option, item.key, allowed="each key once")
    if {"time_budget_h", "share_of_time"} <= set(keys):
        raise InputError(option, "budget_h and share_of_time", allowed="one of the two: each is all telescope time")
    instrument = config.universe.made_instrument() if set(keys) & set(_UNITS) else None
    made = []
    for strategy in config.strategies:
        tree = strategy.model_dump(mode="python")
        every = [[_setting(item, value, tree, strategy, instrument) for value in item.values] for item in parsed]
        for item, settings in zip(parsed, every, strict=True):
            _check_differ(item, settings)
        for chosen in itertools.product(*every):
            own = tree | ({"share_of_time": None} if "time_budget_h" in keys else {})
            for setting, value in chosen:
                own = put(own, setting.key, value)
            given = tuple(setting for setting, _ in chosen)
            label = " ".join(setting.label for setting in given)
            about = f"{strategy.description}; here with {label}" if strategy.description else ""
            named = {"name": f"{strategy.name} {label}", "description": about}
            made.append(validate(SurveyStrategy, own | named, where=option))
            made[-1]._provenance.update({key: item for key, item in strategy.provenance.items() if key not in keys})
            made[-1]._varied = (*strategy.varied, *given)
    if len(made) > MAX_STRATEGIES:
        raise InputError(option, f"{len(made)} strategies", allowed=f"at most {MAX_STRATEGIES} in all")
    universe = config.universe.model_copy(update={"facts": facts})
    return budgeted(config.model_copy(update={"strategies": tuple(made), "universe": universe}))


def variation_lines(config: StrategiesConfig) -> list[str]:
    """Return what is varied, one value a line, with what each means: ``drift x2: 0.1 nm visit offset, ...``."""
    every = {item.label: item for strategy in config.strategies for item in strategy.varied}
    return [
        f"{item.name} {item.text.split(' (')[0]}: {item.meaning}" if item.meaning else f"{item.name} {item.text}"
        for item in every.values()
    ]


def _sweep(text: str, config: StrategiesConfig, option: str) -> _Sweep:
    name, sign, listed = text.partition("=")
    name = name.strip()
    if not sign or not name or not listed.strip():
        raise InputError(option, text, allowed="KEY=VALUE,VALUE..., as contrast=1e-8,3e-9 or drift=x0.5,x2")
    texts = [item.strip() for item in re.split(r",(?![^\[{]*[\]}])", listed)]
    if not all(texts):
        raise InputError(option, text, allowed="a value between commas; null for none")
    if name == "share":
        raise InputError(option, name, allowed="slot_share or share_of_time", hint=SHARES)
    key = SHORT_NAMES.get(name, name)
    known = tuple(key for key in keys_of(SurveyStrategy) if key not in ("name", "description"))
    if key not in known:
        drift = "drift=0.1nm sets the offset of a visit" if key.startswith("drift.") else ""
        hint = drift or nearest(name, (*SHORT_NAMES, *known)) or f"short names: {', '.join(SHORT_NAMES)}"
        raise InputError(option, name, allowed="a key of a strategy", hint=hint)
    unit = _UNITS.get(key, unit_of(key))
    return _Sweep(option, key, name, tuple(read_value(f"{option} {name}", item, unit) for item in texts))


def _setting(
    sweep: _Sweep, written: Written, tree: Mapping[str, Any], strategy: SurveyStrategy, instrument: Instrument | None
) -> tuple[VariedSetting, Any]:
    """Return one value of a key: how it is told, and what the strategy gets."""
    if instrument is not None and sweep.key in _UNITS:
        return _of_instrument(sweep, written, instrument)
    unit = unit_of(sweep.key)
    value, text = written.value, written.text
    if written.action == "scale":
        present = get(tree, sweep.key)
        value = scaled(present, written.value)
        if value is None:
            hint = f"{sweep.key} of {strategy.name} is {'not set' if present is None else present}"
            raise InputError(sweep.where, text, allowed="a value: only numbers take a factor", hint=hint)
        shown = ", ".join(f"{item:g}" for item in value) if isinstance(value, tuple) else f"{value:g}"
        text = f"{text} ({with_unit(shown, unit)})"
    most = f"at most that fraction of any slot; the telescope time in all stays {strategy.time_budget_h:g} h"
    return sweep.setting(text, value, unit, most if sweep.key == "slot_share" else ""), value


def _of_instrument(sweep: _Sweep, written: Written, instrument: Instrument) -> tuple[VariedSetting, Any]:
    """Return one value of what is assumed of the instrument, whose numbers are what factors multiply."""
    key, unit, text = sweep.key, _UNITS[sweep.key], written.text
    factor = written.action == "scale"
    optics = {band.t_opt for band in instrument.bands.values()}
    present = {
        _DRIFT: instrument.drift.visit_nm,
        _EXOZODI: instrument.sky.exozodi_zodis,
        _THROUGHPUT: min(optics) if len(optics) == 1 else None,
    }[key]
    if written.bare:
        raise two_spellings(sweep.where, sweep.name, text.removesuffix(unit).strip(), unit=unit, present=present)
    if key == _EXOZODI and written.value is None:  # as the instrument has it
        return sweep.setting(text, None, "", ""), None
    if not factor and (key == _THROUGHPUT or not isinstance(written.value, float)):
        asked = "a factor with an x, as x0.7"
        raise InputError(sweep.where, text, allowed=f"{asked}, or a number with a unit ({unit})" if unit else asked)
    said = ""
    if key == _THROUGHPUT:
        value = given = written.value
        said = "" if present is None else f"the optics pass {present * value:g} of the light"
    elif not present and (factor or key == _DRIFT):
        other = "an instrument with drift" if key == _DRIFT else f"a number with a unit: {sweep.name}=3{unit}"
        raise InputError(sweep.where, text, allowed=other, hint=f"this one has 0 {unit}: nothing can be scaled")
    else:
        value = given = present * written.value if factor else written.value
        text = f"{text} ({value:g} {unit})" if factor else text
    if key == _DRIFT:
        given = written.value if factor else value / present
        walk = given * instrument.drift.walk_nm_per_sqrt_hour
        said = f"{value:g} nm visit offset, {walk:g} nm/sqrt(h) walk, x{given:g} of the instrument's"
    return sweep.setting(text, value, unit, said), given


def _check_differ(sweep: _Sweep, settings: Sequence[tuple[VariedSetting, Any]]) -> None:
    """Refuse a value that is given twice, in two spellings or one."""
    for i, (setting, value) in enumerate(settings):
        same = next((other for other, given in settings[:i] if given == value), None)
        if same is not None:
            also = "" if same.text == setting.text else f"{same.text} is the same"
            raise InputError(sweep.where, setting.text, allowed="each value once", hint=also)
