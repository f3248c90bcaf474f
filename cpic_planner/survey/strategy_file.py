"""Strategies as people write them: a YAML file or preset, and what it leaves out."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, model_validator

from catalogs import split_source
from cpic_core import InputError, Provenance, by_line, is_file, load_yaml, split_sourced
from cpic_planner.queries import UniverseSettings, changed_instrument, get
from cpic_planner.results import SettingSource
from cpic_planner.survey.strategy import SurveyStrategy
from simulator.config import FrozenModel, Instrument, Real, Sourced, deep_merge, preset_path, preset_tree, validate
from simulator.config.scene import paths_beside

PACKAGE = "cpic_planner"
MAX_STRATEGIES = 200
FILES = ("instrument", "visibility", "catalog", "known_planets", "observed")
"""What a survey names by preset or file."""
SHARES = (
    "slot_share is the most of any one slot of the calendar that the coronagraph may take, and was called share "
    "before; share_of_time is all its telescope time over the length of the survey, 0.05 for 5 %"
)
"""What tells the two shares of a strategy apart."""
_BUDGETS = ("time_budget_h", "share_of_time")
_OF_SURVEY = ("kind", "universe", "doubt", "defaults", "strategies")


class UniverseConfig(UniverseSettings, Sourced):
    """The settings that strategies share, as their file says them.

    Attributes
    ----------
    start_utc : str
        Start of the survey.
    date_utc : str
        Date of the places of stars and their companions in all visits; the start where it is not given.
    duration_days, slot_days : float
        Length of the survey, and step of its calendar.
    instrument, visibility, catalog, known_planets : str
        Presets or files; ``known_planets`` as `catalogs.known_planets.load_known_planets` reads it, ``off`` leaves
        them out.
    changes : tuple of str
        What is changed of the instrument for all strategies, ``KEY=VALUE`` as `cpic_planner.queries.changes` reads it.
    candidates : bool
        Whether candidates count among the known planets.
    exclusions : tuple of {"rv", "stability", "known_giants"}
        What excludes planets of the population (`cpic_planner.planets.allowed`); ``none``: nothing.
    observed : str
        Observation log of what was done already (`cpic_planner.survey.observed`); empty for none.
    facts : bool
        Whether strategies are planned and played again without each fact that is known
        (`cpic_planner.survey.facts`).
    background : {"off", "on"}
        Whether background stars make false alarms.
    universes : int
        Synthetic universes; at least 2, or no interval is defined.
    seed : int
    """

    @property
    def n_slots(self) -> int:
        """Slots of the calendar; the last one may be shorter."""
        return max(1, int(-(-self.duration_days // self.slot_days)))

    def made_instrument(self) -> Instrument:
        """Return the instrument with what is changed of it."""
        return changed_instrument(self.instrument, self.changes)

    @model_validator(mode="after")
    def _slots(self) -> "UniverseConfig":
        if self.slot_days > self.duration_days:
            allowed = f"at most duration_days, {self.duration_days:g}"
            raise InputError("slot_days", self.slot_days, unit="d", allowed=allowed)
        return self


class DoubtRule(FrozenModel):
    """A number that nobody knows before launch: strategies are planned for each of its values, and played under each.

    Attributes
    ----------
    key : str
        What is assumed of the instrument or of the planets, dotted or short: drift, throughput, exozodi, contrast,
        population.
    values : tuple of str
        What it may be, as ``--vary`` takes them: with a unit, or with an x.
    weights : tuple of float, optional
        How likely each of them is, in any unit; not given: by the law of the default ensemble, if it has one of the
        number, else all the same.
    quantity : {"planets", "new_planets"}
        What the choice is made by.
    """

    key: Annotated[str, Field(min_length=1)]
    values: Annotated[
        tuple[
            Annotated[str, BeforeValidator(lambda value: f"{value:g}" if isinstance(value, float) else str(value))], ...
        ],
        Field(min_length=2),
    ]
    weights: tuple[Annotated[Real, Field(ge=0)], ...] | None = None
    quantity: Literal["planets", "new_planets"] = "planets"

    @classmethod
    def of(cls, text: str) -> "DoubtRule":
        """Return the rule of ``KEY=VALUE,VALUE...``."""
        key, _, listed = text.partition("=")
        values = [item.strip() for item in listed.split(",")]
        if not key.strip() or len(values) < 2 or not all(values):
            raise InputError("--doubt", text, allowed="KEY=VALUE,VALUE..., as drift=0.02nm,0.1nm")
        return cls(key=key.strip(), values=tuple(values))

    @property
    def text(self) -> str:
        """The rule as ``--doubt`` takes it."""
        return f"{self.key}={','.join(self.values)}"

    @model_validator(mode="after")
    def _weighed(self) -> "DoubtRule":
        if self.weights is not None and (len(self.weights) != len(self.values) or not sum(self.weights) > 0.0):
            raise InputError("doubt.weights", list(self.weights), allowed=f"{len(self.values)} numbers, one above 0")
        return self


class StrategiesConfig(FrozenModel):
    """Strategies to compare; the first one is what the others are compared with."""

    name: str = ""
    description: str = ""
    universe: UniverseConfig = UniverseConfig()
    doubt: DoubtRule | None = None
    strategies: Annotated[tuple[SurveyStrategy, ...], Field(min_length=1, max_length=MAX_STRATEGIES)]

    @model_validator(mode="after")
    def _named(self) -> "StrategiesConfig":
        names = [item.name for item in self.strategies]
        for name in names:
            if names.count(name) > 1:
                raise InputError("strategies.name", name, allowed="each name once")
        return self


@by_line
def load_strategies(source: Mapping[str, Any] | str | Path = "survey_default") -> StrategiesConfig:
    """Load strategies.

    Parameters
    ----------
    source : mapping, str or Path
        Preset name, YAML path, or mapping with ``universe``, ``doubt``, ``defaults`` and ``strategies``, or one
        strategy alone.
        What a strategy leaves out is that of ``defaults``, and what these leave out that of the preset ``default``.

    Returns
    -------
    StrategiesConfig

    Raises
    ------
    InputError
        Naming key, value, unit and allowed range of the first fault.

    Examples
    --------
    >>> from cpic_planner.survey.strategy_file import load_strategies
    >>> [item.name for item in load_strategies("survey_default").strategies][:2]
    ['single_visit', 'multi_band']
    """
    tree, folder = preset_tree(
        "strategies", source, package=PACKAGE, kinds=("strategy",), keys=(*SurveyStrategy.model_fields, *_OF_SURVEY)
    )
    tree = tree if folder is None else _beside(paths_beside(tree, folder), folder)
    values, _ = split_sourced(tree)
    kind = values.pop("kind", "strategies")
    if kind == "strategy" or "strategies" not in values:
        shared = {key: values.pop(key) for key in ("universe", "doubt", "defaults") if key in values}
        values = {"name": values.get("name", "")} | shared | {"strategies": [values]}
    path = preset_path("strategy", "default", package=PACKAGE)
    assert path is not None
    default = {key: item for key, item in load_yaml(path).items() if key != "kind"}
    own = values.pop("defaults", {})
    if not isinstance(own, Mapping):
        raise InputError("strategies.defaults", own, allowed="a mapping of keys to values")
    listed = values["strategies"]
    if not isinstance(listed, list | tuple) or not all(isinstance(item, Mapping) for item in listed):
        raise InputError("strategies.strategies", listed, allowed="a list of mappings")
    base = _laid(split_sourced(default)[0], own)
    base = {key: item for key, item in base.items() if key not in ("name", "description")}
    values["strategies"] = [_laid(base, item) for item in listed]
    config = validate(StrategiesConfig, values, where="strategies")
    config.universe._provenance.update(_sourced(tree.get("universe", {})))
    written = tree.get("strategies") or [{key: item for key, item in tree.items() if key not in _OF_SURVEY}]
    for strategy, layer in zip(config.strategies, written, strict=True):
        strategy._provenance.update(_sourced(default, tree.get("defaults", {}), layer))
    return budgeted(config)


def _laid(below: Mapping[str, Any], above: Mapping[str, Any]) -> dict[str, Any]:
    """Return a layer of a strategy over another; its budget, in hours or as a share, replaces that of the other.

    Raises
    ------
    InputError
        If the layer above gives both, or ``share``, which could be either of two.
    """
    if "share" in above:
        raise InputError("strategies.share", above["share"], allowed="slot_share or share_of_time", hint=SHARES)
    given = [key for key in _BUDGETS if above.get(key) is not None]
    if len(given) > 1:
        both = f"given with {given[0]} {above[given[0]]}"
        raise InputError(f"strategies.{given[1]}", both, allowed="one of the two: each is the whole telescope time")
    kept = {key: value for key, value in below.items() if not (given and key in _BUDGETS)}
    return deep_merge(kept, above)


def budgeted(config: StrategiesConfig) -> StrategiesConfig:
    """Return the same strategies, with the hours of those that state a share of the length of the survey."""
    length_h, made = 24.0 * config.universe.duration_days, []
    for item in config.strategies:
        made.append(item)
        if item.share_of_time is not None:
            made[-1] = item.model_copy(update={"time_budget_h": item.share_of_time * length_h})
            made[-1]._provenance = {key: said for key, said in item.provenance.items() if key != "time_budget_h"}
    return config.model_copy(update={"strategies": tuple(made)})


def _sourced(*layers: Any) -> dict[str, Provenance]:
    """Return the sources of the values that are left when trees are laid over each other."""
    found: dict[str, Provenance] = {}
    for layer in layers:
        values, provenance = split_sourced(layer)
        found = {key: item for key, item in found.items() if not _holds(values, key)} | provenance
    return found


def _holds(tree: Any, key: str) -> bool:
    """Return whether a tree says what a dotted key is, or what one above it is."""
    head, _, rest = key.partition(".")
    if not isinstance(tree, Mapping):
        return True
    return head in tree and (not rest or _holds(tree[head], rest))


def _beside(tree: Any, folder: Path) -> Any:
    """Return the files of the survey and of populations that exist beside the strategies' file, made whole."""
    if isinstance(tree, list):
        return [_beside(item, folder) for item in tree]
    if not isinstance(tree, dict):
        return tree
    found = {key: _beside(item, folder) for key, item in tree.items()}
    for key, item in tree.items():
        if key in (*FILES, "population") and isinstance(item, str):
            name = split_source(item)[1] if key == "known_planets" else item
            if name and is_file(folder / name):
                found[key] = f"{item.removesuffix(name)}{folder / name}"
    return found


def with_universe(
    config: StrategiesConfig, given: Mapping[str, Any], share_of_time: float | None = None
) -> StrategiesConfig:
    """Return the same strategies over another calendar, catalogue, number of universes, or telescope time.

    A survey that is shorter than a slot has one slot. ``share_of_time`` is that of all strategies; a share that is
    kept means more or fewer hours where the survey gets another length.

    Raises
    ------
    InputError
        For an unknown key, or a value that it cannot have.
    """
    if share_of_time is not None:
        given_share = {"share_of_time": share_of_time}
        strategies = tuple(item.model_copy(update=given_share) for item in config.strategies)
        config = budgeted(config.model_copy(update={"strategies": strategies}))
        for item in config.strategies:
            item._provenance.pop("share_of_time", None)
    if not given:
        return config
    tree = config.universe.model_dump() | dict(given)
    length = given.get("duration_days")
    if "slot_days" not in given and isinstance(length, int | float):
        tree["slot_days"] = min(tree["slot_days"], float(length))
    universe = validate(UniverseConfig, tree, where="universe")
    if universe.changes:
        universe.made_instrument()  # refuses what the instrument cannot have before anything is worked out
    old = config.universe
    kept = {key: item for key, item in old.provenance.items() if getattr(universe, key) == getattr(old, key)}
    universe._provenance.update(kept)
    return budgeted(config.model_copy(update={"universe": universe}))


def with_doubt(config: StrategiesConfig, text: str | None) -> StrategiesConfig:
    """Return the same strategies with a number that is not known, ``KEY=VALUE,VALUE...``; unchanged without one.

    Raises
    ------
    InputError
        For anything else.
    """
    return config if text is None else config.model_copy(update={"doubt": DoubtRule.of(text)})


def with_exact_calendars(config: StrategiesConfig) -> StrategiesConfig:
    """Return the same strategies, whose calendars are searched for much longer."""
    exact = [
        item.model_copy(update={"scheduler": item.scheduler.model_copy(update={"method": "exact"})})
        for item in config.strategies
    ]
    return config.model_copy(update={"strategies": tuple(exact)})


def sources_of(config: StrategiesConfig) -> list[SettingSource]:
    """Return the sources of the numbers of all strategies and of what they share, equal ones once."""
    names, settings = [item.name for item in config.strategies], config.universe.model_dump(mode="json")
    shared = [
        SettingSource.of(item, key=f"universe.{key}", value=settings[key], strategies=names)
        for key, item in config.universe.provenance.items()
    ]
    found: dict[tuple[str, str, Provenance], SettingSource] = {}
    for strategy in config.strategies:
        tree = strategy.model_dump(mode="json")
        for key, item in strategy.provenance.items():
            value = get(tree, key)
            own = SettingSource.of(item, key=key, value=value, strategies=[])
            found.setdefault((key, repr(value), item), own).strategies.append(strategy.name)
    return [*shared, *found.values()]
