"""``cpic instrument``: what an instrument is, which of its values can be changed, how two differ, and its tables."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated, TypeAlias

import typer

from cpic_core import InputError
from cpic_planner import report
from cpic_planner.cli.asking import Commands
from cpic_planner.cli.options import Output, help_alone, note, place_of, shown
from cpic_planner.cli.progress import heard

HELP = "Show what an instrument is, which of its values --set can change, and how two instruments differ."
app = Commands(help=HELP, invoke_without_command=True)
app.callback(invoke_without_command=True)(help_alone)

NameArgument: TypeAlias = Annotated[str, typer.Argument(metavar="INSTRUMENT", help="Preset name or YAML file.")]
SetOption: TypeAlias = Annotated[
    list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Change a value, as drift.visit_nm=0.1nm.")
]
KeyOption: TypeAlias = Annotated[
    str, typer.Option("--key", metavar="KEY", help="Only keys that begin so, or match it: drift, bands.*.qe.")
]


def _tell(
    output: Output, layout: str, name: str, changes: list[str] | None, key: str, other: str | None = None
) -> None:
    """Show the values of an instrument, or those in which it differs from another."""
    from cpic_planner.queries import called_as, changed_instrument, instrument_rows, instrument_title
    from cpic_planner.results import InstrumentResult

    with called_as({"changes": "--set", "key": "--key"}):
        one = changed_instrument(name, changes or ())
        two = None if other is None else changed_instrument(other, ())
        title = instrument_title(one) if two is None else f"{instrument_title(one)} beside {instrument_title(two)}"
        result = InstrumentResult(title=title, values=instrument_rows(one, key, other=two))
    output.show(result, partial(report.print_instrument, result, layout))


@app.command("show")
@heard
@shown
def show(output: Output, name: NameArgument = "cpic_default", changes: SetOption = None, key: KeyOption = "") -> None:
    """Show every value of an instrument, with its source and how sure it is (P published, I inferred, A assumed).

    Examples:

      cpic instrument show

      cpic instrument show as_published --key drift

      cpic instrument show --set drift=0.1nm --key drift --json
    """
    _tell(output, "key value unit confidence source", name, changes, key)


@app.command("keys")
@heard
@shown
def keys(output: Output, key: Annotated[str, typer.Argument(metavar="[KEY]", help="As --key of show.")] = "") -> None:
    """List the keys that --set and --simulator-overrides take, with short names and the values of the default.

    Examples:

      cpic instrument keys

      cpic instrument keys drift
    """
    _tell(output, "key short_name value unit", "cpic_default", None, key)


@app.command("diff")
@heard
@shown
def diff(
    output: Output,
    name: NameArgument,
    other: Annotated[str, typer.Argument(metavar="[OTHER]", help="The one that it is compared with.")] = "cpic_default",
    changes: SetOption = None,
    key: KeyOption = "",
) -> None:
    """List the values in which an instrument differs from another; --set changes the first.

    Examples:

      cpic instrument diff as_published

      cpic instrument diff cpic_default --set throughput=x0.7
    """
    _tell(output, "key value other unit", name, changes, key, other)


@app.command("table")
@heard
def table(
    name: NameArgument = "cpic_default",
    band: Annotated[str, typer.Option("--band", metavar="BAND", help="Band of the table.")] = "",
    out: Annotated[Path, typer.Option("--out", metavar="FILE", help="CSV file to write.")] = Path("coronagraph.csv"),
    changes: SetOption = None,
) -> None:
    """Write what the coronagraph of an instrument does by separation: a table that coronagraph.table reads.

    Examples:

      cpic instrument table --band F662 --out f662.csv

      cpic instrument table cpic_2q --band F520 --set wavefront.jitter_mas=10 --out f520.csv
    """
    from cpic_planner.queries import called_as, changed_instrument
    from simulator import write_coronagraph_table

    with called_as({"changes": "--set"}):
        instrument = changed_instrument(name, changes or ())
    if not band:
        raise InputError("--band", "missing", allowed=", ".join(instrument.bands))
    try:
        with called_as({"path": "--out"}):
            write_coronagraph_table(instrument, band, out)
    except OSError as error:
        raise InputError("--out", str(out), allowed="a writable file", hint=error.strerror or "") from None
    note(f"wrote {place_of(out)}")
