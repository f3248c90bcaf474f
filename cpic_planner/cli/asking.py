"""Commands whose options are the fields of a question; built when a command is called, not when help lists it.

Tables of a user's own are read as strictly as is asked; a file takes what was left out of them.
"""

from __future__ import annotations

import contextlib
import functools
import inspect
import pkgutil
from collections.abc import Callable, Iterator, Sequence
from enum import Enum, StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias, TypeVar, cast, get_args, get_origin

import typer
from typer.core import TyperCommand

from cpic_core import InputError, at_home, faults_by_line
from cpic_planner.cli import options
from cpic_planner.cli.options import STRICT, note, shown
from cpic_planner.cli.progress import heard

if TYPE_CHECKING:
    from catalogs import LeftOut


RejectsOption: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        "--rejects",
        metavar="FILE",
        help="Write the rows and cells of a table of your own that are left out, each with its reason, to FILE.csv, "
        ".ecsv or .parquet.",
    ),
]
REJECTS_ENDINGS = (".csv", ".ecsv", ".parquet")
"""Endings of the names that ``--rejects`` takes."""


@contextlib.contextmanager
def tables_of(question: Any, rejects: Path | None) -> Iterator[None]:
    """Read tables of a user's own as a question asks, and write what was left out of them, also where they are refused.

    Parameters
    ----------
    question : Question
        It may say how strictly, and name tables.
    rejects : Path or None
        File of `RejectsOption`.

    Raises
    ------
    InputError
        If there is nothing to write about, or the file cannot be written.
    """
    from catalogs import tables_read

    tables = _named_tables(question)
    check_rejects(rejects, tables)
    if rejects is not None and not tables and getattr(question, "strategies", None) is None:
        raise _no_table(rejects)
    with tables_read(strict=getattr(question, "strict", False), tell=options.note) as read:
        try:
            yield
        finally:
            if rejects is not None and read.tables:
                write_rejects(rejects, read.left_out)
    if rejects is not None and not read.tables:
        raise _no_table(rejects)


def _named_tables(question: Any) -> list[Any]:
    """Return the files that a question names as tables; a file of strategies may name others."""
    from catalogs import NAMED_TABLES, split_source

    stars, planets = getattr(question, "catalog", None), getattr(question, "known_planets", None)
    laid_over = "" if planets in (None, "off") else split_source(planets)[1]
    return [
        *([] if stars in (None, *NAMED_TABLES) else [stars]),
        *filter(None, [laid_over]),
        *getattr(question, "what", ()),
    ]


def check_rejects(rejects: Path | None, tables: Sequence[Any]) -> None:
    """Refuse a file of ``--rejects`` that cannot be written, or that is one of the tables themselves.

    Parameters
    ----------
    rejects : Path or None
    tables : sequence
        Files that are read.

    Raises
    ------
    InputError
    """
    options.check_file(rejects, REJECTS_ENDINGS, "--rejects")
    names = [table for table in tables if isinstance(table, str | Path)]
    if rejects is not None and rejects.resolve() in [at_home(name).resolve() for name in names]:
        raise InputError("--rejects", str(rejects), allowed="another file than the table that is read")


def _no_table(rejects: Path) -> InputError:
    allowed = "with a table of your own: --catalog FILE, --known-planets FILE, or the table that is simulated"
    return InputError("--rejects", str(rejects), allowed=allowed)


def write_rejects(path: Path, left_out: Sequence[tuple[str, LeftOut]]) -> None:
    """Write what was left out of tables, in the form that the ending of the name asks for.

    Parameters
    ----------
    path : Path
    left_out : sequence of (str, LeftOut)
        Each after the name of its table.
    """
    from cpic_planner import results

    rows = results.left_out_cells(left_out)
    columns = results.taken_of(results.LeftOutCell)
    write: dict[str, Callable[[], str | bytes]] = {
        ".csv": lambda: results.csv_text(results.names_of(results.LeftOutCell), map(results.values_of, rows)),
        ".ecsv": lambda: results.ecsv_text(columns, rows, {"title": "left out of tables"}),
        ".parquet": lambda: results.parquet_bytes(columns, rows),
    }
    options.write_out(path, write[path.suffix], len(rows), len(rows), "--rejects")


RENAMED = {"--photon-counting": ("--mode", "photon_counting"), "--draws": ("--planets",)}
"""Former options, and what each is now."""
_FILE, _REJECTS, _STRICT = "question_file", "rejects", "strict"
_FILE_HELP = (
    "YAML file (kind: question) with answers by their keywords, see cpic schema; options on the command line stand "
    "above it."
)


Run = TypeVar("Run", bound=Callable[..., Any])


class Once(TyperCommand):
    """A command that refuses an option which is given twice, in one spelling or two, where it takes one value."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Read the arguments, each option at most once."""
        if not ctx.resilient_parsing:
            seen: list[Any] = []
            for option in self.make_parser(ctx).parse_args([*args])[2]:
                several = getattr(option, "multiple", False) or getattr(option, "count", False)
                same = getattr(option, "is_flag", False) and not option.secondary_opts  # says the same twice
                if option in seen and not several and not same:
                    name, *others = [*option.opts, *option.secondary_opts]
                    hint = f"{' and '.join([name, *others])} are one option" if others else ""
                    raise InputError(name, "given twice", allowed="once", hint=hint)
                seen.append(option)
        return super().parse_args(ctx, args)


class Commands(typer.Typer):
    """A group of commands, each of them `Once`."""

    def command(
        self, name: str | None = None, *, cls: type[TyperCommand] | None = None, **how: Any
    ) -> Callable[[Run], Run]:
        """Add a command."""
        return super().command(name, cls=cls or Once, **how)

    @functools.cached_property
    def built(self) -> Any:
        """The command line of all that was added, made once for a process."""
        return typer.main.get_command(self)

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        """Run it."""
        return self.built(*args, **kwargs)


def late(run: Callable[..., None], name: str) -> type[TyperCommand]:
    """Return the kind of command that takes its options from the question of a function, once it is called.

    Parameters
    ----------
    run : callable
        Its first parameter is the question; others have the annotations of `typer`.
    name : str
        Where its question is, as ``package.module:Model``.
    """

    class Late(Once):
        def make_context(self, info_name: str | None, args: list[str], parent: Any = None, **extra: Any) -> Any:
            built = command_of(run, pkgutil.resolve_name(name))
            self.params, self.callback = built.params, built.callback
            asked = args if extra.get("resilient_parsing") else _present(args, self.params)
            return super().make_context(info_name, asked, parent, **extra)

    return Late


@functools.cache
def command_of(run: Callable[..., None], model: Any) -> Any:
    """Return the command that asks a question and hands it to a function; the same one each time.

    Parameters
    ----------
    run : callable
        As of `late`.
    model : type of Question
    """
    app = typer.Typer(add_completion=False, rich_markup_mode=None)
    app.command()(heard(_asking(run, model)))
    return typer.main.get_command(app)


def _present(args: Sequence[str], params: Sequence[Any]) -> list[str]:
    """Return the arguments with the present names of options and times in seconds; say what is called otherwise now."""
    from cpic_planner.queries import seconds_text

    arguments: list[str] = []
    known = {name for param in params for name in param.opts}
    rest = iter(args)
    for arg in rest:
        name, equals, text = arg.partition("=")
        if name in known and f"{name}-s" in known:
            text = text if equals else next(rest, "")
            arguments += [f"{name}-s", seconds_text(name, text)]
            continue
        new = RENAMED.get(arg)
        if new is None or arg in known or new[0] not in known:
            arguments.append(arg)
            continue
        note(f"{arg} is now {' '.join(new)}")
        arguments += new
    return arguments


def _asking(run: Callable[..., None], model: Any) -> Callable[..., None]:
    """Return the function with an option for every field of the question in the place of its first parameter."""
    from cpic_planner.queries import called_as, option_names, options_of, spelled, tree_of

    options, names = tuple(options_of(model)), option_names(model)
    run = shown(run, **{model.__name__: model})
    own = list(inspect.signature(run, locals={model.__name__: model}, eval_str=True).parameters.values())[1:]
    # Who asks strictly takes neither a part of a table nor the lack of an answer.
    tables, both = _STRICT in model.model_fields, any(parameter.name == _STRICT for parameter in own)
    own = [parameter for parameter in own if not tables or parameter.name != _STRICT]

    def command(**given: Any) -> None:
        others = {parameter.name: given.pop(parameter.name) for parameter in own}
        file, rejects = given.pop(_FILE), given.pop(_REJECTS, None)
        given = {name: _value(value) for name, value in given.items()}
        # A value that is made of parts is called by the first of them that is given.
        parts = [option for option in reversed(options) if option.parts is not None and given[option.name] is not None]
        with called_as(names | {".".join(option.path[:-1]): option.flag for option in parts}):
            with called_as({"file": "--question"}):
                answered = {} if file is None else model.load(file)
            tree = tree_of(options, given, answered, names)
            # What an option says is no fault of the file.
            said = {option.path[0] for option in options if given[option.name] not in (None, (), [])}
            with faults_by_line(None if said & set(answered) else file, whole=False):
                question = model.of(tree)
                others |= {_STRICT: question.strict} if tables and both else {}
                with tables_of(question, rejects) if tables else contextlib.nullcontext():
                    run(question, **others)

    def text_of(option: Any) -> str:
        said = spelled(option.text, names)
        return f"{said} {STRICT}" if tables and both and option.path == (_STRICT,) else said

    parameter = functools.partial(inspect.Parameter, kind=inspect.Parameter.KEYWORD_ONLY, default=None)
    parameters = [parameter(option.name, annotation=_annotation(option, text_of(option))) for option in options]
    for i, option in enumerate(options):
        if option.required and option.asked.argument:
            parameters[i] = parameters[i].replace(default=inspect.Parameter.empty)
    file = Annotated[Path | None, typer.Option("--question", help=_FILE_HELP)]
    parameters.append(parameter(_FILE, annotation=file))
    parameters += [parameter(_REJECTS, annotation=RejectsOption)] * tables
    parameters += [given.replace(kind=inspect.Parameter.KEYWORD_ONLY) for given in own]
    command.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    command.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    command.__doc__ = run.__doc__
    return command


def _annotation(option: Any, text: str) -> Any:
    """Return the `typer` annotation of an option; a choice of words is an enumeration, which every version reads."""
    kind: Any = option.kind
    if get_origin(kind) is Literal:
        words = [(f"WORD_{i}", word) for i, word in enumerate(get_args(kind))]
        kind = cast(Any, StrEnum)(option.name.title(), words)
    kind = list[kind] if option.several else kind
    own = option.asked
    if own.argument:
        metavar = own.metavar or option.flag
        argument = typer.Argument(metavar=metavar, help=text, show_default=False, autocompletion=_completed(own))
        return Annotated[kind if option.required else kind | None, argument]
    flags = [f"{option.flag}/--no-{option.flag[2:]}" if option.switchable else option.flag]
    metavar = own.metavar or None
    if kind is float and option.flag.endswith("-s"):  # the same with a unit: --time 2h
        flags.append(option.flag.removesuffix("-s"))
        metavar = metavar or "S|TIME"
        text += f" {flags[1]} takes a unit: s, min, h or d, as 2h."
    told = typer.Option(
        *flags, help=text, metavar=metavar, hidden=own.hidden, show_default=False, autocompletion=_completed(own)
    )
    return Annotated[kind | None, told]


def _completed(own: Any) -> Callable[[str], list[str]] | None:
    """Return what a shell completes a value to; None for nothing."""
    if own.completes is None:
        return None
    return lambda incomplete: [word for word in own.completes() if word.casefold().startswith(incomplete.casefold())]


def _value(value: Any) -> Any:
    """Return a value of the option parser as plain data."""
    if isinstance(value, list | tuple):
        return tuple(map(_value, value))
    return value.value if isinstance(value, Enum) else value
