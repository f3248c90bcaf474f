"""Names of stars and settings of the instrument, turned into targets and models.

Functions whose keywords are the fields of a question.
"""

import functools
import inspect
import textwrap
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Literal, TypeVar, get_args, get_origin

from pydantic.fields import FieldInfo

from catalogs import Catalogue, catalogue_of_star, tables_read
from cpic_core import InputError, numeric_context
from cpic_planner import queries
from cpic_planner.etc import EtcModel, build_model
from cpic_planner.targets import Targets, as_catalogue, find_target, find_targets
from simulator.config import FrozenModel, limits_of, load_instrument, nearest, unit_of


def model_of(question: Any) -> EtcModel:
    """Return the model of the instrument, the bands and the strategy of a question; that of the shipped one is kept."""
    if question.instrument is load_instrument():
        return _default_model(question.bands, question.strategy)
    return build_model(question.instrument, question.bands, question.strategy)


@functools.lru_cache(maxsize=16)
def _default_model(bands: tuple[str, ...] | None, strategy: queries.Strategy | None) -> EtcModel:
    """Return the model of the shipped instrument, which no file of the user's can change."""
    return build_model(load_instrument(), bands, strategy)


def catalogue_of(question: Any) -> Catalogue:
    """Return the table of stars of a question: of one star alone where the question describes it."""
    if getattr(question, "v_mag", None) is None:
        return as_catalogue(question.catalog)
    about = {name: getattr(question, name) for name in ("sp_type", "teff_k", "distance_pc")}
    return catalogue_of_star(question.target[0], question.v_mag, **about)


def stars_named(question: Any) -> list[Targets]:
    """Return each star that a question names as a target of its own."""
    date_utc, companions = queries.observed_utc(question), question.companions
    if len(question.target) == 1 and question.catalog == "snapshot" and getattr(question, "v_mag", None) is None:
        return [shipped_star(question.target[0], companions, date_utc)[0]]
    about: dict[str, Any] = {"catalog": catalogue_of(question), "companions": companions, "date_utc": date_utc}
    return [star for star, _ in find_targets(question.target, **about)]


@functools.lru_cache(maxsize=256)
def shipped_star(name: str, companions: Literal["on", "off"], date_utc: str | None) -> tuple[Targets, str]:
    """Return a star of the shipped catalogue, which no file of the user's can change, as `find_target` does.

    Parameters
    ----------
    name : str
        Any name of the star.
    companions : {"on", "off"}
        Whether the light of companions counts.
    date_utc : str or None
        Of the places.
    """
    return find_target(name, companions=companions, date_utc=date_utc)


R = TypeVar("R")
Q = TypeVar("Q", bound=queries.Question)


def takes(
    model: type[Q],
    *,
    first: Sequence[str] = (),
    needs: Sequence[str] = (),
    without: Sequence[str] = (),
    defaults: Mapping[str, Any] | None = None,
    of_strategy: Sequence[str] = (),
) -> Callable[[Callable[[Q], R]], Callable[..., R]]:
    """Give a function of a question the fields of the question as its keywords, and document them.

    Parameters
    ----------
    model : type of Question
    first : sequence of str
        Fields that may also be given by position, in this order.
    needs : sequence of str
        Fields that have to be given although the question has a default.
    without : sequence of str
        Fields that the function does not take.
    defaults : mapping, optional
        Values of fields that the function does not take, or other defaults of those that it takes.
    of_strategy : sequence of str
        Fields of the question's strategy that are keywords as well.
    """
    fixed = dict(defaults or {})
    names = [*first, *(name for name in model.model_fields if name not in (*first, *without))]

    def made(function: Callable[[Q], R]) -> Callable[..., R]:
        parameters = [_parameter(model, name, name in first, name in needs, fixed) for name in names]
        parameters += [_parameter(queries.Strategy, name, False, False, {}) for name in of_strategy]
        parameters.sort(key=lambda item: (item.kind, item.kind is item.POSITIONAL_OR_KEYWORD and item.default is None))
        signature = inspect.Signature(parameters, return_annotation=function.__annotations__.get("return"))

        @functools.wraps(function)
        @numeric_context()
        def wrapped(*args: Any, **keywords: Any) -> R:
            named = _by_field(model, function.__name__, signature, keywords)
            given = dict(signature.bind(*args, **named).arguments)
            own = {name: given.pop(name) for name in of_strategy if given.get(name) is not None}
            if own:
                base = given.get("strategy") or {}
                tree = base.model_dump(exclude_unset=True) if isinstance(base, queries.Strategy) else base
                if not isinstance(tree, Mapping):
                    raise InputError("strategy", base, allowed="a Strategy or a mapping")
                for name in own.keys() & tree.keys():
                    raise InputError(name, "given twice", allowed="once: as a keyword or in strategy")
                given["strategy"] = dict(tree) | own
            question = model.of(fixed | given)
            with tables_read(strict=getattr(question, "strict", False)):
                return function(question)

        wrapped.__signature__ = signature  # type: ignore[attr-defined]
        wrapped.__doc__ = _documented(function.__doc__ or "", model, parameters)
        return wrapped

    return made


_SHOWN = ("limit", "format", "form", "brief", "json", "as_json", "plot", "out", "explain", "dry_run", "strict")
"""Options that decide what a command shows, not what it answers."""


def _by_field(
    model: type[queries.Question], function: str, signature: inspect.Signature, keywords: Mapping[str, Any]
) -> dict[str, Any]:
    """Return keywords with the names of options (``band``, ``planet_radius_rjup``) by the fields that these set.

    Raises
    ------
    TypeError
        For a keyword that the function does not have, naming the nearest ones.
    """
    named = model.by_field(keywords)
    others = {name: named.pop(name) for name in tuple(named) if name not in signature.parameters}
    if not others:
        return named
    options = {option.flag.removeprefix("--").replace("-", "_"): option for option in queries.options_of(model)}
    options = {word: option for word, option in options.items() if option.path[0] in signature.parameters}
    for name in others:
        if name not in options:
            shown = "it decides what the command line shows; the result has everything" if name in _SHOWN else ""
            hint = (
                shown or nearest(name, (*signature.parameters, *options)) or f"known: {', '.join(signature.parameters)}"
            )
            raise TypeError(f"{function}() has no keyword {name!r} ({hint})")
        field = options[name].path[0]
        if field in named and not (len(options[name].path) > 1 and isinstance(named[field], Mapping)):
            raise InputError(name, f"given with {field}", allowed="one of the two")
    values = {option.name: others.get(word) for word, option in options.items()}
    return queries.tree_of(tuple(options.values()), values, named, queries.option_names(model))


def _parameter(
    model: type[FrozenModel], name: str, first: bool, needed: bool, fixed: Mapping[str, Any]
) -> inspect.Parameter:
    info = model.model_fields[name]
    default: Any = inspect.Parameter.empty
    if name in fixed:
        default = fixed[name]
    elif not needed and not info.is_required():
        own = queries.asked_of(info)
        plain = isinstance(info.default, str | int | float) and not (own is not None and own.unset)
        default = info.default if plain else None
    kind = inspect.Parameter.POSITIONAL_OR_KEYWORD if first else inspect.Parameter.KEYWORD_ONLY
    return inspect.Parameter(name, kind, default=default, annotation=_words(info))


def _words(info: FieldInfo) -> str:
    """Return the type of a keyword in words, as numpydoc has it."""
    own = queries.asked_of(info)
    kind, several = queries.kind_of(info)
    if own is not None and own.accepts:
        word = own.accepts
    elif get_origin(kind) is Literal:
        word = f"{{{', '.join(repr(item) for item in get_args(kind))}}}"
    else:
        word = f"sequence of {kind.__name__}" if several else kind.__name__
    return word if info.is_required() else f"{word}, optional"


def _documented(text: str, model: type[queries.Question], parameters: Sequence[inspect.Parameter]) -> str:
    """Return the docstring with a section on the keywords behind its first paragraphs."""
    lines = ["Parameters", "----------"]
    for parameter in parameters:
        info = (model if parameter.name in model.model_fields else queries.Strategy).model_fields[parameter.name]
        own = queries.asked_of(info)
        said = [queries.spelled(info.description or "")]
        limits, unit = limits_of(info), (own.unit if own else "") or unit_of(parameter.name)
        if limits or unit:
            said.append(f"{limits} {unit}".strip() + ("" if limits else ", as its unit"))
        if own is not None and own.unset:
            said.append(f"default: {queries.spelled(own.unset)}")
        lines.append(f"{parameter.name} : {parameter.annotation}")
        text_of = f"{said[0].rstrip('.')} ({'; '.join(said[1:])})." if said[1:] else said[0]
        lines += textwrap.wrap(text_of, 110, initial_indent="    ", subsequent_indent="    ")
    body = inspect.cleandoc(text)
    head, sign, rest = body.partition("\n\nReturns\n")
    return "\n".join([head, "", *lines]) + sign + rest + "\n"
