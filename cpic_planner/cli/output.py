"""Forms of an answer: the options by which a command is asked for them, and how it is printed, drawn and written.

A command has the options of its question and those of one model here, both declared field by field.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import typer
from pydantic import BaseModel

from cpic_core import InputError
from cpic_planner import report
from cpic_planner.cli import command
from cpic_planner.cli.progress import is_verbose
from cpic_planner.queries.question import asked, asked_changes
from simulator.config import FrozenModel

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NOTHING_FOUND = 3
"""Exit status of --strict where there is no answer, or no detection."""
FORM_OF_ENDING = {".csv": "csv", ".ecsv": "ecsv", ".json": "json", ".tex": "latex", ".md": "markdown"}
"""Forms in which a table of the terminal is written to a file, by the ending of its name."""


class JsonOutput(FrozenModel):
    """The output of a command that is for people, or JSON: ``cpic cache info``, ``catalog info``."""

    as_json: bool = asked(False, "Machine-readable result on stdout.", option="--json")


class Output(JsonOutput):
    """The form in which a command writes its answer.

    Raises
    ------
    InputError
        For options that contradict each other.
    """

    form: Literal["table", "csv", "ecsv", "json", "latex", "markdown"] = asked(
        "table", "How the main table is written: for people, or for other programs.", option="--format"
    )
    columns: str | None = asked(
        None,
        "Columns of the main table, in this order and alone, by their names in files; help lists them.",
        metavar="NAME,...",
    )
    caption: str | None = asked(None, "Caption of the table in LaTeX.", unset="what it is, data, version")
    label: str | None = asked(None, "Label of the table in LaTeX.", unset="tab: and the kind of answer")
    brief: bool = asked(False, "The main table alone, without what explains it.")

    def _check_values(self) -> None:
        given = "--json" if self.as_json else f"--format {self.form}"
        if self.as_json and self.form not in ("table", "json"):
            raise InputError("--json", "given with --format", allowed="one of the two")
        if self.brief and self.written != "table":
            hint = f"{given}, which has the main table alone in any case"
            raise InputError("--brief", f"given with {given}", allowed="one of the two", hint=hint)
        if self.columns is not None and self.written == "json":
            raise InputError("--columns", self.columns, allowed="with tables: JSON has every field")
        to_latex = self.written == "latex" or str(getattr(self, "out", None)).endswith(".tex")
        for option, text in (("--caption", self.caption), ("--label", self.label)):
            if text is not None and not to_latex:
                raise InputError(option, text, allowed="with --format latex, or --out FILE.tex where there is one")
        if self.label is not None and not re.fullmatch(r"[\w:.+-]+", self.label, re.ASCII):
            raise InputError("--label", self.label, allowed="letters, digits and : . + - _")

    @property
    def written(self) -> str:
        """The form, that of ``--json`` too."""
        return "json" if self.as_json else self.form

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns that are asked for; those of the terminal where none is."""
        return () if self.columns is None else tuple(item.strip() for item in self.columns.split(","))

    @property
    def plain(self) -> bool:
        """Tell whether more than a table is printed, for people."""
        return self.written == "table" and not self.brief and not self.names

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
        if self.written == "json":
            command.print_json(result)
        elif self.names == ("help",):
            sys.stdout.write(report.offered_text(self._table(blocks, "csv")))
        elif self.written != "table":
            sys.stdout.write(self.text(self.written, result, blocks))
        elif self.names:
            report.print_table(report.chosen(self._table(blocks, "table"), self.names), command.console(), chosen=True)
        else:
            shown = _up_to_table(blocks) if self.brief else blocks
            report.print_blocks(shown, command.console(), full=is_verbose() and not self.brief)
        if not found and getattr(self, "strict", False):
            raise typer.Exit(NOTHING_FOUND)

    def text(self, form: str, result: BaseModel, blocks: Iterable[report.Block]) -> str:
        """Return the first table of an answer in a form, with the columns that are asked for.

        Raises
        ------
        InputError
            If there is no table.
        """
        table, about = self._table(blocks, form), {"caption": self.caption or "", "label": self.label or ""}
        return report.form_text(form, result, table, columns=self.names, **about)

    def _table(self, blocks: Iterable[report.Block], form: str) -> report.Table:
        table = report.first_table(blocks)
        if table is None:
            option, given = ("--format", form) if form != "table" else ("--columns", ",".join(self.names))
            raise InputError(option, given, allowed="with --format table or json alone: this answer has no table")
        return table

    def tell_rows(self, rows: int, every: int) -> None:
        """Print on stderr of how many rows a table for other programs has the first ones."""
        if self.written not in ("table", "json") and rows < every:
            command.note(f"the first {rows} of {every} rows: --limit {every} gives all")


def _up_to_table(blocks: Iterable[report.Block]) -> Iterator[report.Block]:
    """Yield blocks up to the first table, which explains none of its headings."""
    for block in blocks:
        if isinstance(block, report.Table):
            yield replace(block, legend=False)
            return
        yield block


class Drawn(Output):
    """An answer that has a figure."""

    plot: Path | None = asked(None, "Draw the answer into FILE.png, .pdf or .svg as well.")

    def _check_values(self) -> None:
        super()._check_values()
        command.check_plot(self.plot)  # before any work

    def draw(self, figure: Callable[[], Figure], remark: str = "") -> None:
        """Write the figure, where one is asked for, and say so; ``remark`` stands behind its name."""
        if self.plot is not None:
            report.write_figure(figure(), self.plot)
            command.note(f"wrote {command.place_of(self.plot)}{remark}")


class Answer(Output):
    """The output of a command that asks for something that may not be there."""

    strict: bool = asked(False, command.STRICT)


class EtcOutput(Drawn, Answer):
    """The answer of ``cpic etc``."""

    budget: bool = asked(False, "Print the noise budget of every answer.", unset="of the best")
    explain: bool = asked(
        False, "Say more: probabilities, visits and orbits, and the EM gain that each saturation limit allows."
    )

    def _check_values(self) -> None:
        super()._check_values()
        about = {"--brief": self.brief, "--format": self.written != "table"}
        for name, value, held in (
            ("--budget", self.budget, "JSON holds every budget"),
            ("--explain", self.explain, "JSON holds all"),
        ):
            command.refuse_together({name: value, "--json": self.written == "json"}, held)
            command.refuse_together({name: value} | about, "it has one table")


class SearchOutput(Drawn, Answer):
    """The answer of ``cpic curve`` or ``roc``."""

    dry_run: bool = asked(False, "Estimate time, memory and disk, then stop.")


class RankOutput(Drawn, Answer):
    """The answer of ``cpic rank``."""

    limit: int | None = asked(
        None, "Stars of every table, of {out} too, and of the figure. JSON has all.", ge=1, unset="20, and all in {out}"
    )
    explain: str | None = asked(None, "Say why this star stands where it stands, instead of the table.")
    sensitivity: bool = asked(
        False, "Say how the order depends on assumptions, instead of the table; of one star with {explain}."
    )
    compare: str | None = asked(
        None,
        "Say what moves from OTHER to this ranking and why, instead of the table: the file of an earlier ranking (of "
        "{out}, or .json of --json), or an instrument (preset or YAML file) asked the same.",
        metavar="OTHER",
    )
    plot: Path | None = asked(None, "Draw the first {limit} stars, at most 100, into FILE.png, .pdf or .svg as well.")
    out: Path | None = asked(
        None,
        "Also write the rows to FILE.csv or .ecsv (every column, or those of {columns}), .tex or .md (as on the "
        "screen), or everything to FILE.json.",
        metavar="FILE",
    )

    def _check_values(self) -> None:
        super()._check_values()
        command.check_file(self.out, tuple(FORM_OF_ENDING), "--out")


class KnownOutput(Drawn):
    """The answer of ``cpic known``."""

    limit: int = asked(40, "Rows to print (--json holds all).", ge=1)
    plot: Path | None = asked(None, "Draw separation against time into FILE.png, .pdf or .svg as well.")
    scene: Path | None = asked(
        None, "Write one draw of the star's planets into FILE.yaml, for cpic simulate or confirm."
    )

    def _check_values(self) -> None:
        super()._check_values()
        command.check_file(self.scene, (".yaml", ".yml"), "--scene")


class VisibilityOutput(Drawn, Answer):
    """The answer of ``cpic visibility``."""

    plot: Path | None = asked(None, "Draw FILE.png, .pdf or .svg: the days of one star, a calendar of several.")
    out: Path | None = asked(None, "Also write every step of every star to FILE.csv.", metavar="FILE")

    def _check_values(self) -> None:
        super()._check_values()
        command.check_file(self.out, (".csv",), "--out")


class RunOutput(Output):
    """The answer of a run that may be asked what it would cost: ``cpic whatif``."""

    dry_run: bool = asked(False, "Estimate time, memory and disk, then stop.")


class ImagesOutput(RunOutput, Answer):
    """The answer of ``cpic plan`` or ``confirm``."""


class SimulateOutput(RunOutput):
    """The answer of ``cpic simulate``."""

    list_presets: bool = asked(False, "Show the presets, then stop.")


class TradeoffOutput(Output):
    """The answer of ``cpic tradeoff``."""

    listed: bool = asked(False, "Say which scenes and ways there are, and stop.", option="--list")


def _asked_instrument() -> Any:
    return asked("cpic_default", "Preset name or YAML file.", argument=True, metavar="INSTRUMENT")


class InstrumentOutput(Output):
    """The answer of ``cpic instrument show``, and what it is about."""

    instrument: str = _asked_instrument()
    changes: tuple[str, ...] = asked_changes()
    key: str = asked("", "Only keys that begin so, or match it: drift, bands.*.qe.", metavar="KEY")


class KeysOutput(Output):
    """The answer of ``cpic instrument keys``, and what it is about."""

    key: str = asked("", "As --key of show.", argument=True, metavar="[KEY]")


class DiffOutput(InstrumentOutput):
    """The answer of ``cpic instrument diff``, and what it is about."""

    instrument: str = _asked_instrument()
    other: str = asked("cpic_default", "The one that it is compared with.", argument=True, metavar="[OTHER]")


class TableOptions(FrozenModel):
    """The options of ``cpic instrument table``."""

    instrument: str = _asked_instrument()
    band: str = asked("", "Band of the table.", metavar="BAND")
    out: Path = asked(Path("coronagraph.csv"), "CSV file to write.", metavar="FILE")
    changes: tuple[str, ...] = asked_changes()


class SchemaOptions(FrozenModel):
    """The options of ``cpic schema``."""

    name: str = asked(
        ..., "rank, etc, plan, confirm, run, simulation or check; or etc-question ...", argument=True, metavar="NAME"
    )


class CompareOutput(Output):
    """The answer of ``cpic compare``, and what it compares."""

    before: str = asked(..., "Folder of a run, or file of an answer.", argument=True, metavar="RUN")
    after: str = asked(..., "The other one, of the same kind.", argument=True, metavar="RUN")
    limit: int = asked(30, "Values to print; of rankings the first stars of either. JSON has all.", ge=1)
    out: Path | None = asked(
        None,
        "Also write every value to FILE.csv, .ecsv, .tex or .md, everything to FILE.json, or a page to FILE.html.",
        metavar="FILE",
    )

    def _check_values(self) -> None:
        super()._check_values()
        command.check_file(self.out, (*FORM_OF_ENDING, ".html"), "--out")


class CheckOutput(JsonOutput):
    """The answer of ``cpic check``, and what it is about."""

    paths: tuple[Path, ...] = asked(..., "Level-0 files or folders of them.", argument=True, metavar="FILE|TREE...")
    strict: bool = asked(False, "Exit with 1 for warnings too.")


class ServeOptions(FrozenModel):
    """The options of ``cpic serve``."""

    host: str = asked("127.0.0.1", "Address that the server is bound to: this machine alone, unless said.")
    port: int = asked(8765, "Port.", ge=1, le=65535)
    allow_host: tuple[str, ...] = asked((), "Answer under this name too; repeat for several.", metavar="NAME")
    jobs: Path | None = asked(None, "Folder of jobs and their results.", unset="one in the cache folder", metavar="DIR")
    folder: Path | None = asked(None, "Show the plans, what-ifs and rankings beneath this folder.", metavar="DIR")


class ColumnsOutput(JsonOutput):
    """The answer of ``cpic catalog columns``, and what it is about."""

    file: Path | None = asked(None, "A table of your own, of stars or of planets.", argument=True, metavar="[FILE]")
    taken_as: Literal["stars", "planets"] | None = asked(
        None, "Take FILE as a table of this kind.", option="--as", unset="each kind that it can be"
    )
    rejects: Path | None = asked(None, command.REJECTS, metavar="FILE")
    strict: bool = asked(False, "Refuse FILE for the first row or cell that cannot be used.")


class RefreshOutput(JsonOutput):
    """The answer of ``cpic catalog refresh``, and what is asked of which archive."""

    planets: bool = asked(False, "Ask the NASA Exoplanet Archive for known planets, not SIMBAD for stars.")
    out: Path | None = asked(None, "Write FILE.ecsv.", unset="dated, in the data folder")
    v_mag_max: float | None = asked(
        None, "Faintest V of the stars; rankings end at 7, the rest is a reserve.", unset="7.5"
    )
    parallax_min_mas: float | None = asked(None, "Smallest parallax of the stars.", unset="25")
    url: str = asked(
        "", "TAP service.", unset="$CPIC_SIMBAD_URL, or astroquery's SIMBAD server; $CPIC_ARCHIVE_URL, or the archive's"
    )
    timeout_s: float = asked(180.0, "Most time for one answer, from connecting to reading its last cell.")
    retries: int = asked(3, "How often a failure on the way is tried again.")
    maxrec: int = asked(200_000, "Most rows of one answer.")
    plain_http: bool = asked(
        False, "Allow plain http, which anybody on the way can alter, elsewhere than on this machine."
    )
    other_hosts: bool = asked(False, "Follow redirects to another host.")
    dry_run: bool = asked(False, "Show the queries and the place, ask nothing.")
