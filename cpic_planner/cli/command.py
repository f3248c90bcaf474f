"""Options that are made from the fields of a question, the forms of an answer, and what all commands print.

The options are built when a command is called, not when help lists it. Tables of a user's own are read as strictly as
is asked; a file takes what was left out of them.
"""

from __future__ import annotations

import contextlib
import functools
import inspect
import pkgutil
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from enum import Enum, StrEnum
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeVar, cast, get_args, get_origin

import typer
from pydantic import BaseModel
from typer.core import TyperCommand

from cpic_core import InputError, at_home, check_writable, dump_json, faults_by_line, one_line, visible, write_named
from cpic_planner import report
from cpic_planner.cli.progress import QuietOption, VerboseOption, is_quiet, progress, rest, set_loudness, write_line

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import Console

    from catalogs import LeftOut
    from cpic_planner.cli.output import Output
    from cpic_planner.jobs import Job, Runner
    from cpic_planner.queries import Option, SimulatorOverrides


R = TypeVar("R", bound=BaseModel)


def error_line(text: str, status: int) -> int:
    """Write one line to stderr and hand back the exit status."""
    write_line(f"cpic: {one_line(text)}")
    return status


def note(*texts: str) -> None:
    """Write remarks to stderr, a line each, unless quiet."""
    for text in () if is_quiet() else texts:
        write_line(f"cpic: {one_line(text)}")


def print_json(result: BaseModel | Mapping[str, Any]) -> None:
    """Print the result as JSON on stdout and nothing else there."""
    rest()
    sys.stdout.write(dump_json(result.model_dump(mode="json") if isinstance(result, BaseModel) else dict(result)))


def cost_line(what: str, cost: Mapping[str, float], workers: int) -> str:
    """Return what a run of simulated images would take."""
    return (
        f"{what}, {cost['n_realisations']} realisations, {cost['n_frames']} frames drawn one by one, about "
        f"{time_text(cost, workers)}, {cost['memory_mb']:.0f} MB memory a worker, {cost['disk_mb']:.1f} MB disk"
    )


def time_text(cost: Mapping[str, float], workers: int) -> str:
    """Return the expected time of a run on this machine."""
    text = f"{cost['wall_s']:.0f} s with {workers} worker(s)"
    return text if workers == 1 else f"{text}, {cost['cpu_s']:.0f} s of processor time"


def say(*lines: str) -> None:
    """Print lines on stdout that are no table; names in them may hold anything."""
    rest()
    typer.echo(visible("\n".join(lines), "\n"))


def result_of(
    question: Any,
    job: Job[R],
    output: Output,
    title: str,
    line: Callable[[Mapping[str, float]], str],
    *,
    steps: int | str,
    piece: str = "piece",
    out: Path | None,
    dry_run: bool = False,
) -> R | None:
    """Return the result of a job that is run with progress; None where only its cost was asked for, which is printed.

    Parameters
    ----------
    question : RunQuestion
        How it is run.
    job : Job
    output : Output
    title : str
        What is done.
    line : callable
        Says the cost.
    steps : int or str
        Steps of progress, or which count of the cost they are.
    piece : str
        What its tasks are called.
    out : Path, optional
        Folder of the run.
    dry_run : bool
    """
    from cpic_planner.jobs import estimate, run

    if dry_run or isinstance(steps, str):
        cost = estimate(job, workers=question.workers)
        if dry_run:
            text = line(cost)
            print_json(cost) if output.written == "json" else say(text)
            return None
        steps = int(cost[str(steps)])
    return with_progress(title, steps, functools.partial(run, job, out, **question.how), piece).result


def with_progress(title: str, total: int, start: Callable[..., Runner[R]], piece: str = "piece") -> Runner[R]:
    """Run a job with progress on stderr, and say how much of it was there already.

    Parameters
    ----------
    title : str
        What is done.
    total : int
        Steps of progress; none is shown without.
    start : callable
        Runs the job, given ``advance`` and ``command`` as `cpic_planner.jobs.job.run` takes them.
    piece : str
        What its tasks are called.
    """
    with progress(title, total) as advance:
        done = start(advance=advance, command=sys.argv[1:])
    if done.resumed_parts:
        note(f"reused {done.resumed_parts} finished {piece}{'s' * (done.resumed_parts != 1)} of an earlier run")
    return done


def tell_report(output: Output, out: Path | None) -> None:
    """Say where the report of a run is, if it has one."""
    if output.plain and out is not None:
        say(f"report: {out / 'report.html'}")


def console() -> Console:
    """Return the console for tables on stdout; honours NO_COLOR and pipes."""
    from rich.console import Console

    rest()
    plain = None if sys.stdout.isatty() else 110
    return Console(width=plain, highlight=False, markup=False, emoji=False)


STRICT = "Leave with status 3 where there is no answer, or no planet is detected."
"""Help of ``--strict`` where an answer may not be there."""


def tell_overrides(overrides: SimulatorOverrides) -> None:
    """Say that altered optics take their time."""
    if overrides.alters_optics:
        note("the optics of the simulator are altered: they are computed anew, once, up to a minute a band")


def refuse_together(options: Mapping[str, object], why: str) -> None:
    """Refuse two options that contradict each other; ``None`` and ``False`` are not given.

    Parameters
    ----------
    options : mapping
        Values by option.
    why : str
        What is wrong with them together.

    Raises
    ------
    InputError
        Naming the first two.
    """
    given = [name for name, value in options.items() if value is not None and value is not False]
    if len(given) > 1:
        raise InputError(given[0], f"given with {given[1]}", allowed="one of the two", hint=why)


def check_plot(plot: Path | None) -> None:
    """Refuse the file of a figure before any work, where it cannot be written."""
    if plot is not None:
        report.check_figure_name(plot)
        check_writable(plot, key="--plot")


def check_file(path: Path | None, endings: Sequence[str], option: str) -> None:
    """Refuse the file of an answer before any work: by a name that does not end in what is written, or its place."""
    if path is None:
        return
    if path.suffix not in endings:
        raise InputError(
            option,
            str(path),
            allowed=f"a name that ends in {' or '.join(filter(None, [', '.join(endings[:-1]), endings[-1]]))}",
        )
    check_writable(path, key=option)


def write_out(path: Path, text: Callable[[], str | bytes], rows: int, every: int, option: str = "--out") -> None:
    """Write a table to the file of an option, and say so and how many of all rows it has.

    Raises
    ------
    InputError
        If it cannot be written.
    """
    try:
        write_named(path, text(), key=option)
    except OSError as error:
        raise InputError(option, str(path), allowed="a writable file", hint=error.strerror or "") from None
    note(f"wrote {rows}{f' of {every}' * (rows < every)} row{'s' * (every != 1)} to {place_of(path)}")


def place_of(path: Path) -> str:
    """Return the name of a file that was written, and where it is if that is a link."""
    return f"{path.resolve()}, to which {path} is a link" if path.is_symlink() else str(path)


REJECTS = (
    "Write the rows and cells of a table of your own that are left out, each with its reason, to FILE.csv, .ecsv or "
    ".parquet."
)
"""Help of ``--rejects``."""
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
        File of ``--rejects``.

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
    with tables_read(strict=getattr(question, "strict", False), tell=note) as read:
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
    check_file(rejects, REJECTS_ENDINGS, "--rejects")
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

    rows = [results.LeftOutCell.of(item, table=table, reason=item.why) for table, item in left_out]
    columns = results.taken_of(results.LeftOutCell)
    write: dict[str, Callable[[], str | bytes]] = {
        ".csv": lambda: results.csv_text(results.names_of(results.LeftOutCell), map(results.values_of, rows)),
        ".ecsv": lambda: results.ecsv_text(columns, rows, {"title": "left out of tables"}),
        ".parquet": lambda: results.parquet_bytes(columns, rows),
    }
    write_out(path, write[path.suffix], len(rows), len(rows), "--rejects")


RENAMED = {"--photon-counting": ("--mode", "photon_counting"), "--draws": ("--planets",)}
"""Former options, and what each is now."""
_FILE, _REJECTS, _STRICT, _OUTPUT = "question_file", "rejects", "strict", "output__"
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


HELP_OPTIONS = {"help_option_names": ["-h", "--help"]}
"""Said to every command: each keeps the help option of the context that first asks for its parameters."""


class Commands(typer.Typer):
    """A group of commands, each of them `Once`."""

    def command(
        self, name: str | None = None, *, cls: type[TyperCommand] | None = None, **how: Any
    ) -> Callable[[Run], Run]:
        """Add a command."""
        return super().command(name, cls=cls or Once, context_settings=HELP_OPTIONS, **how)

    @functools.cached_property
    def built(self) -> Any:
        """The command line of all that was added, made once for a process."""
        return typer.main.get_command(self)

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        """Run it."""
        return self.built(*args, **kwargs)


def group(help_text: str, **commands: Callable[..., None]) -> Commands:
    """Return a group of commands by their names, which shows its help where it is called without any."""
    app = Commands(help=help_text, invoke_without_command=True)
    app.callback(invoke_without_command=True)(_help_alone)
    for name, run in commands.items():
        add(app, name, run)
    return app


def add(app: Commands, name: str, run: Callable[..., None], question: str = "", *more: str) -> None:
    """Add a command by its name; its help is its docstring and ``more``, its options come late from its models.

    Parameters
    ----------
    app : Commands
    name : str
    run : callable
        As of `command_of`.
    question : str
        Where its question is, as ``package.module:Model``; empty where it has none.
    *more : str
        Paragraphs of its help behind the docstring.
    """
    app.command(name, cls=late(run, question, more))(lambda: None)


def _help_alone(context: typer.Context) -> None:
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


def late(run: Callable[..., None], name: str = "", more: Sequence[str] = ()) -> type[TyperCommand]:
    """Return the kind of command that takes its options from the models of a function, once it is called.

    Parameters
    ----------
    run : callable
        As of `command_of`.
    name : str
        Where its question is, as ``package.module:Model``; empty where it has none.
    more : sequence of str
        Paragraphs of its help behind the docstring.
    """

    class Late(Once):
        @property
        def help(self) -> str:
            return "\n\n".join((inspect.getdoc(run) or "", *more))

        @help.setter
        def help(self, text: str | None) -> None:
            """Keep the help that is read when it is asked for."""

        def make_context(self, info_name: str | None, args: list[str], parent: Any = None, **extra: Any) -> Any:
            built = command_of(run, pkgutil.resolve_name(name) if name else None)
            self.params, self.callback = built.params, built.callback
            asked = args if extra.get("resilient_parsing") else _present(args, self.params)
            return super().make_context(info_name, asked, parent, **extra)

    return Late


def _present(args: Sequence[str], params: Sequence[Any]) -> list[str]:
    """Return the arguments with the present names of options and times in seconds; say what is called otherwise now."""
    arguments: list[str] = []
    known = {name for param in params for name in param.opts}
    rest = iter(args)
    for arg in rest:
        name, equals, text = arg.partition("=")
        if name in known and f"{name}-s" in known:
            from cpic_planner.queries import seconds_text

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


@functools.cache
def command_of(run: Callable[..., None], model: Any = None) -> Any:
    """Return the command whose options are put together to the parameters of a function; the same one each time.

    Parameters
    ----------
    run : callable
        Its parameters, if it has any, are asked field by field: ``question``, and ``output`` or ``options``, a model of
        `cpic_planner.cli.output`. Every command takes -v and -q, as ``cpic`` does before its name.
    model : type of Question, optional
        Whose fields ``question`` has.
    """
    forms = {name: item.annotation for name, item in inspect.signature(run).parameters.items() if name != "question"}
    name = next(iter(forms), "")
    shown: Any = pkgutil.resolve_name(f"cpic_planner.cli.output:{forms[name]}") if name else None
    # Who asks strictly takes neither a part of a table nor the lack of an answer.
    tables = model is not None and _STRICT in model.model_fields
    lacking = shown is not None and _STRICT in shown.model_fields
    parameters = [] if model is None else _parameters_of(model, "", STRICT if lacking else "")
    if model is not None:
        parameters.append(_parameter(_FILE, Annotated[Path | None, typer.Option("--question", help=_FILE_HELP)]))
        rejects = Annotated[Path | None, typer.Option("--rejects", metavar="FILE", help=REJECTS)]
        parameters += [_parameter(_REJECTS, rejects)] * tables
    if shown is not None:
        parameters += [item for item in _parameters_of(shown, _OUTPUT) if not tables or item.name != _OUTPUT + _STRICT]
    parameters += [_parameter("verbose", VerboseOption, 0), _parameter("quiet", QuietOption, False)]

    def called(**given: Any) -> None:
        from cpic_planner.queries import called_as
        from simulator.config import validate

        if given["verbose"] or given["quiet"]:
            set_loudness(given["verbose"], given["quiet"])
        with contextlib.ExitStack() as stack:
            arguments = {} if model is None else {"question": stack.enter_context(_asked(model, given))}
            if shown is not None:
                with called_as(_options(shown)[1]):
                    strict = {_STRICT: arguments["question"].strict} if lacking and tables else {}
                    arguments[name] = validate(shown, _answered(shown, _OUTPUT, given)[0] | strict)
                if model is None:
                    stack.enter_context(called_as(_options(shown)[1]))
            run(**arguments)

    called.__name__, called.__doc__ = run.__name__, run.__doc__
    called.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    called.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    app = typer.Typer(add_completion=False, rich_markup_mode=None)
    app.command()(called)
    return typer.main.get_command(app)


@functools.cache
def _options(model: Any) -> tuple[tuple[Option, ...], dict[str, str]]:
    """Return the options of a model, and the option of each of its fields."""
    from cpic_planner.queries import option_names, options_of

    return options_of(model), option_names(model)


def _parameter(name: str, annotation: Any, default: Any = None) -> inspect.Parameter:
    return inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=annotation)


def _parameters_of(model: Any, before: str, of_strict: str = "") -> list[inspect.Parameter]:
    """Return the parameters of a command for the fields of a model, their names behind ``before``."""
    from cpic_planner.queries import spelled

    (options, names), parameters = _options(model), []
    for option in options:
        text = f"{spelled(option.text, names)} {of_strict if option.path == (_STRICT,) else ''}".rstrip()
        default = inspect.Parameter.empty if option.required and option.asked.argument else None
        parameters.append(_parameter(before + option.name, _annotation(option, text), default))
    return parameters


def _answered(
    model: Any, before: str, given: Mapping[str, Any], file: Mapping[str, Any] = MappingProxyType({})
) -> tuple[dict[str, Any], dict[str, str], set[str]]:
    """Return what options and a file say of a model, the option of each value, and which fields options are about."""
    from cpic_planner.queries import called_as, tree_of

    options, names = _options(model)
    values = {option.name: _value(given.get(before + option.name)) for option in options}
    said = [option for option in options if values[option.name] not in (None, (), [])]
    # A value that is made of parts is called by the first of them that is given.
    parts = {".".join(item.path[:-1]): item.flag for item in reversed(said) if item.parts is not None}
    names = names | parts
    with called_as(names):
        return tree_of(options, values, file, names), names, {option.path[0] for option in said}


@contextlib.contextmanager
def _asked(model: Any, given: Mapping[str, Any]) -> Iterator[Any]:
    """Yield the question that options ask; refusals in the body name options, or the line of a file."""
    from cpic_planner.queries import called_as

    file, rejects = given[_FILE], given.get(_REJECTS)
    with called_as({"file": "--question"}):
        answers = {} if file is None else model.load(file)
    tree, names, said = _answered(model, "", given, answers)
    # What an option says is no fault of the file.
    with called_as(names), faults_by_line(None if said & set(answers) else file, whole=False):
        question = model.of(tree)
        with tables_of(question, rejects) if _STRICT in model.model_fields else contextlib.nullcontext():
            yield question


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
