"""Options that are made from the fields of a question, the forms of an answer, and what all commands print.

The options are built when a command is called, not when help lists it. Tables of a user's own are read as strictly as
is asked; a file takes what was left out of them.
"""

from __future__ import annotations

import contextlib
import functools
import inspect
import pkgutil
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum, StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias, TypeVar, cast, get_args, get_origin

import typer
from pydantic import BaseModel
from typer.core import TyperCommand

from cpic_core import InputError, at_home, check_writable, dump_json, faults_by_line, one_line, visible, write_named
from cpic_planner import report
from cpic_planner.cli.progress import (
    QuietOption,
    VerboseOption,
    is_quiet,
    is_verbose,
    progress,
    rest,
    set_loudness,
    write_line,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.figure import Figure
    from rich.console import Console

    from catalogs import LeftOut
    from cpic_planner.jobs import Finished, Job
    from cpic_planner.queries import SimulatorOverrides


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


NOTHING_FOUND = 3
"""Exit status of --strict where there is no answer, or no detection."""


@dataclass(frozen=True)
class Output:
    """The form in which a command writes its answer.

    Attributes
    ----------
    form : str
        One of `Form`.
    brief : bool
        The main table alone.
    columns : tuple of str
        Names of its columns; those of the terminal where none is given.
    caption, label : str
        Of the table in LaTeX.
    strict : bool
        Whether the exit status tells that there is no answer.
    """

    form: str = "table"
    brief: bool = False
    columns: tuple[str, ...] = ()
    caption: str = ""
    label: str = ""
    strict: bool = False

    @property
    def as_json(self) -> bool:
        """Tell whether the answer is JSON."""
        return self.form == "json"

    @property
    def plain(self) -> bool:
        """Tell whether more than a table is printed, for people."""
        return self.form == "table" and not self.brief and not self.columns

    def show(self, result: BaseModel, blocks: Iterable[report.Block], found: bool = True) -> None:
        """Print a result as JSON, or in ``blocks``, or the first table of these in another form.

        Parameters
        ----------
        result : BaseModel
        blocks : iterable of Block
            Made as they are printed.
        found : bool
            Whether there is an answer, and of a planet a detection; without, ``strict`` leaves with `NOTHING_FOUND`.

        Raises
        ------
        InputError
            If a form is asked for that the answer has no table for.
        """
        if self.as_json:
            print_json(result)
        elif self.columns == ("help",):
            sys.stdout.write(report.offered_text(self._table(blocks, "csv")))
        elif self.form != "table":
            sys.stdout.write(self.text(self.form, result, blocks))
        elif self.plain:
            report.print_blocks(blocks, console(), full=is_verbose())
        elif self.columns:
            table = report.chosen(self._table(blocks, self.form), self.columns)
            report.print_table(table, console(), chosen=True)
        else:
            report.print_blocks(_up_to_table(blocks), console())
        if self.strict and not found:
            raise typer.Exit(NOTHING_FOUND)

    def text(self, form: str, result: BaseModel, blocks: Iterable[report.Block]) -> str:
        """Return the first table of an answer in a form, with the columns that are asked for.

        Raises
        ------
        InputError
            If there is no table.
        """
        table, columns = self._table(blocks, form), self.columns
        return report.form_text(form, result, table, columns=columns, caption=self.caption, label=self.label)

    def _table(self, blocks: Iterable[report.Block], form: str) -> report.Table:
        table = report.first_table(blocks)
        if table is None:
            option, given = ("--format", form) if form != "table" else ("--columns", ",".join(self.columns))
            raise InputError(option, given, allowed="with --format table or json alone: this answer has no table")
        return table


def _up_to_table(blocks: Iterable[report.Block]) -> Iterator[report.Block]:
    """Yield blocks up to the first table."""
    for block in blocks:
        yield block
        if isinstance(block, report.Table):
            return


class Answer(Output):
    """The output of a command that asks for something that may not be there: it has an option ``--strict``."""


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
            print_json(cost) if output.as_json else say(text)
            return None
        steps = int(cost[str(steps)])
    return with_progress(title, steps, functools.partial(run, job, out, **question.how), piece).result


def with_progress(title: str, total: int, start: Callable[..., Finished[R]], piece: str = "piece") -> Finished[R]:
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
    with progress(title, total=total, enabled=total > 0) as advance:
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


class Form(StrEnum):
    """Forms in which a command writes its main table."""

    TABLE = "table"
    CSV = "csv"
    ECSV = "ecsv"
    JSON = "json"
    LATEX = "latex"
    MARKDOWN = "markdown"


STRICT = "Leave with status 3 where there is no answer, or no planet is detected."
JsonOption: TypeAlias = Annotated[bool, typer.Option("--json", help="Machine-readable result on stdout.")]
PlotOption: TypeAlias = Annotated[
    Path | None, typer.Option("--plot", help="Draw the answer into FILE.png, .pdf or .svg as well.")
]
DryRunOption: TypeAlias = Annotated[bool, typer.Option("--dry-run", help="Estimate time, memory and disk, then stop.")]


_OUTPUT: dict[str, Any] = {
    "form": Annotated[
        Form, typer.Option("--format", help="How the main table is written: for people, or for other programs.")
    ],
    "columns": Annotated[
        str | None,
        typer.Option(
            "--columns",
            metavar="NAME,...",
            help="Columns of the main table, in this order and alone, by their names in files; help lists them.",
        ),
    ],
    "caption": Annotated[
        str | None,
        typer.Option("--caption", help="Caption of the table in LaTeX [default: what it is, data, version]."),
    ],
    "label": Annotated[
        str | None,
        typer.Option("--label", help="Label of the table in LaTeX [default: tab: and the kind of answer]."),
    ],
    "brief": Annotated[bool, typer.Option("--brief", help="The main table alone, without what explains it.")],
    "as_json": JsonOption,
}
"""Options of an `Output`."""


def output_of(
    *,
    form: Form | None,
    columns: str | None,
    caption: str | None,
    label: str | None,
    brief: bool | None,
    as_json: bool | None,
    strict: bool | None = False,
    to_latex: bool = False,
) -> Output:
    """Return the output that the options of a command ask for; ``to_latex`` tells that a file of it is LaTeX.

    Raises
    ------
    InputError
        For options that contradict each other.
    """
    name = str(form or "table")
    if as_json and name not in ("table", "json"):
        raise InputError("--json", "given with --format", allowed="one of the two")
    if brief and (as_json or name != "table"):
        asked, hint = "--json" if as_json else f"--format {name}", "which has the main table alone in any case"
        raise InputError("--brief", f"given with {asked}", allowed="one of the two", hint=f"{asked}, {hint}")
    name = "json" if as_json else name
    if columns is not None and name == "json":
        raise InputError("--columns", columns, allowed="with tables: JSON has every field")
    for option, text in (("--caption", caption), ("--label", label)):
        if text is not None and name != "latex" and not to_latex:
            raise InputError(option, text, allowed="with --format latex, or --out FILE.tex where there is one")
    if label is not None and not re.fullmatch(r"[\w:.+-]+", label, re.ASCII):
        raise InputError("--label", label, allowed="letters, digits and : . + - _")
    chosen = () if columns is None else tuple(item.strip() for item in columns.split(","))
    return Output(name, bool(brief), chosen, caption or "", label or "", bool(strict))


def tell_overrides(overrides: SimulatorOverrides) -> None:
    """Say that altered optics take their time."""
    if overrides.alters_optics:
        note("the optics of the simulator are altered: they are computed anew, once, up to a minute a band")


def refuse_together(options: dict[str, object], why: str) -> None:
    """Refuse two options that contradict each other; ``None`` and ``False`` are not given.

    Parameters
    ----------
    options : dict
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


def write_plot(plot: Path, figure: Figure, remark: str = "") -> None:
    """Write a figure and say so.

    Parameters
    ----------
    plot : Path
    figure : Figure
    remark : str
        What is said of it beside its name.
    """
    report.write_figure(figure, plot)
    note(f"wrote {place_of(plot)}{remark}")


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


FORM_OF_ENDING = {".csv": "csv", ".ecsv": "ecsv", ".json": "json", ".tex": "latex", ".md": "markdown"}
"""Forms in which a table of the terminal is written to a file, by the ending of its name."""


def tell_rows(output: Output, rows: int, every: int) -> None:
    """Print on stderr of how many rows a table for other programs has the first ones."""
    if output.form not in ("table", "json") and rows < every:
        note(f"the first {rows} of {every} rows: --limit {every} gives all")


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

    rows = results.left_out_cells(left_out)
    columns = results.taken_of(results.LeftOutCell)
    write: dict[str, Callable[[], str | bytes]] = {
        ".csv": lambda: results.csv_text(results.names_of(results.LeftOutCell), map(results.values_of, rows)),
        ".ecsv": lambda: results.ecsv_text(columns, rows, {"title": "left out of tables"}),
        ".parquet": lambda: results.parquet_bytes(columns, rows),
    }
    write_out(path, write[path.suffix], len(rows), len(rows), "--rejects")


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
        app.command(name)(command(run))
    return app


def _help_alone(context: typer.Context) -> None:
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


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
    app.command()(command(run, model))
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


def command(run: Callable[..., None], model: Any = None) -> Callable[..., None]:
    """Return a function with the options of a command in the place of what they are put together to.

    Parameters
    ----------
    run : callable
        Its parameter ``question``, if it has one, is asked field by field, and ``output`` is an `Output`. Others have
        the annotations of `typer`. Every command takes -v and -q, as ``cpic`` does before its name.
    model : type of Question, optional
        Whose fields ``question`` has.
    """
    from cpic_planner import queries

    where = {"queries": queries}
    own = dict(inspect.signature(run, locals=where, eval_str=True).parameters)
    question, output = own.pop("question", None), own.pop("output", None)
    forms = {} if output is None else dict(_OUTPUT)
    # Who asks strictly takes neither a part of a table nor the lack of an answer.
    tables = model is not None and _STRICT in model.model_fields
    may_lack = output is not None and issubclass(output.annotation, Answer)
    if may_lack and not tables:
        forms[_STRICT] = Annotated[bool, typer.Option("--strict", help=STRICT)]
    asked = None if question is None else _Asked(model, also_lack=may_lack and tables)

    def called(**given: Any) -> None:
        verbose, quiet = given.pop("verbose"), given.pop("quiet")
        if verbose or quiet:
            set_loudness(verbose, quiet)
        arguments = {name: given.pop(name) for name in own}

        def start(question: Any = None) -> None:
            if output is not None:
                how = {name: given.pop(name) for name in forms}
                how |= {_STRICT: question.strict} if may_lack and tables else {}
                arguments["output"] = output_of(**how, to_latex=str(arguments.get("out") or "").endswith(".tex"))
            run(**arguments) if question is None else run(question, **arguments)

        start() if asked is None else asked.ask(given, start)

    only = inspect.Parameter.KEYWORD_ONLY
    parameters = [] if asked is None else asked.parameters()
    parameters += [item.replace(kind=only) for item in own.values()]
    parameters += [inspect.Parameter(name, only, default=None, annotation=kind) for name, kind in forms.items()]
    parameters.append(inspect.Parameter("verbose", only, default=0, annotation=VerboseOption))
    parameters.append(inspect.Parameter("quiet", only, default=False, annotation=QuietOption))
    called.__name__, called.__doc__ = run.__name__, run.__doc__
    called.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    called.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    return called


class _Asked:
    """The options of a question, and the question that they ask.

    Parameters
    ----------
    model : type of Question
    also_lack : bool
        Whether its ``strict`` is about the lack of an answer too.
    """

    def __init__(self, model: Any, *, also_lack: bool) -> None:
        from cpic_planner.queries import option_names, options_of

        self.model, self.also_lack, self.tables = model, also_lack, _STRICT in model.model_fields
        self.options, self.names = tuple(options_of(model)), option_names(model)

    def parameters(self) -> list[inspect.Parameter]:
        """Return the parameters of a command, those that every question has last."""
        from cpic_planner.queries import spelled

        parameter = functools.partial(inspect.Parameter, kind=inspect.Parameter.KEYWORD_ONLY)
        parameters = []
        for option in self.options:
            text = spelled(option.text, self.names)
            text += f" {STRICT}" if self.also_lack and option.path == (_STRICT,) else ""
            default = inspect.Parameter.empty if option.required and option.asked.argument else None
            parameters.append(parameter(option.name, annotation=_annotation(option, text), default=default))
        file = Annotated[Path | None, typer.Option("--question", help=_FILE_HELP)]
        parameters.append(parameter(_FILE, annotation=file, default=None))
        return parameters + [parameter(_REJECTS, annotation=RejectsOption, default=None)] * self.tables

    def ask(self, given: dict[str, Any], start: Callable[[Any], None]) -> None:
        """Call a function with the question of some options, which are taken out of what is given."""
        from cpic_planner.queries import called_as, tree_of

        file, rejects = given.pop(_FILE), given.pop(_REJECTS, None)
        values = {option.name: _value(given.pop(option.name)) for option in self.options}
        # A value that is made of parts is called by the first of them that is given.
        parts = [item for item in reversed(self.options) if item.parts is not None and values[item.name] is not None]
        with called_as(self.names | {".".join(option.path[:-1]): option.flag for option in parts}):
            with called_as({"file": "--question"}):
                answered = {} if file is None else self.model.load(file)
            tree = tree_of(self.options, values, answered, self.names)
            # What an option says is no fault of the file.
            said = {option.path[0] for option in self.options if values[option.name] not in (None, (), [])}
            with faults_by_line(None if said & set(answered) else file, whole=False):
                question = self.model.of(tree)
                with tables_of(question, rejects) if self.tables else contextlib.nullcontext():
                    start(question)


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
