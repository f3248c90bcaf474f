"""Results on tables of a user's own: what their columns are taken for, and what is left out of them."""

from collections.abc import Sequence
from typing import ClassVar, Literal, Self

from pydantic import Field

from catalogs import CONVENTIONS, LeftOut, Taken
from cpic_planner.results.base import Result, Row, column as told  # a row here has a field of that name


class LeftOutCell(Row):
    """A row of a user's table that is not used, or a cell that is taken as missing."""

    table: str = told("name of the file")
    row: int = told("number of the row below the heading, from 1")
    name: str = told("what the row is about; empty if it does not say")
    column: str = told("heading of the file, or several joined by or")
    value: str = told("what stands there")
    reason: str = told("what may stand there, or what is wrong")
    done: str = told("row left out, or taken as missing")


class ColumnTaken(Row):
    """A column of a user's table, and what it is taken for."""

    heading: str = told("heading of the file", label="column of the file")
    quantity: str = told("our column that it is taken for; empty: not used", label="taken for")
    unit: str = told("unit in which it is read; empty: none")
    unit_assumed: bool = told("whether the file names no unit, so that this one is assumed")
    convention: str = told("what its numbers mean beyond their unit, in words; empty: nothing else")
    reason: str = told("why it is not used; empty where it is", label="remark")


class ReasonLeftOut(Row):
    """A reason for which rows or cells of a user's table are not used."""

    done: str = told("row left out, or taken as missing", label="what is done")
    count: int = told("rows or cells", label="how many", short="number")
    column: str = told("heading of the file, or several joined by or")
    reason: str = told("what may stand there, or what is wrong", label="reason")
    row: int = told("number of the first such row", label="first row")
    name: str = told("what that row is about; empty if it does not say", label="of")
    value: str = told("what stands there", label="with")


class TableTaken(Result):
    """The meaning of a file as a table of stars or of planets."""

    taken_as: Literal["stars", "planets"]
    n_rows: int = Field(description="rows of the file")
    n_usable: int = Field(description="rows that are used")
    columns: list[ColumnTaken]
    left_out: list[ReasonLeftOut] = Field(description="rows and cells that are not used, by reason")
    notes: list[str] = Field(description="remarks on the reading")

    @classmethod
    def of_file(cls, taken: Taken) -> Self:
        """Return the result of what `catalogs.taken_for` returns."""
        columns = [
            ColumnTaken(
                heading=use.heading,
                quantity=use.quantity,
                unit=use.unit.removeprefix("[").removesuffix("]") if use.quantity else use.unit,
                unit_assumed=bool(use.quantity) and use.unit.startswith("["),
                convention=CONVENTIONS.get(use.convention, use.convention),
                reason=use.why,
            )
            for use in taken.uses
        ]
        reasons = [
            ReasonLeftOut(
                done=item.done,
                count=count,
                column=item.column,
                reason=item.why,
                row=item.row,
                name=item.name,
                value=item.value,
            )
            for item, count in taken.reasons
        ]
        rest = {"n_rows": taken.rows, "n_usable": taken.usable, "notes": list(taken.notes)}
        return cls(taken_as=taken.kind, columns=columns, left_out=reasons, **rest)


class ColumnsResult(Result):
    """The meaning of the columns of a file, and how many of its rows can be used."""

    main_rows: ClassVar[str] = "tables"
    schema_version: Literal[1] = 1
    kind: Literal["columns"] = "columns"
    file: str = Field(description="name of the file, without folders")
    tables: list[TableTaken] = Field(description="one; two where it can be read both as stars and as planets")

    @classmethod
    def of_files(cls, found: Sequence[Taken]) -> Self:
        """Return the result of what `catalogs.taken_for` returns of one file."""
        return cls(file=found[0].file, tables=[TableTaken.of_file(one) for one in found])


def left_out_cells(left_out: Sequence[tuple[str, LeftOut]]) -> list[LeftOutCell]:
    """Return rows and cells that were not used, after the name of their table, as rows of a file."""
    return [
        LeftOutCell(
            table=table,
            row=item.row,
            name=item.name,
            column=item.column,
            value=item.value,
            reason=item.why,
            done=item.done,
        )
        for table, item in left_out
    ]
