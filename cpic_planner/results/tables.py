"""Results on tables of a user's own: what their columns are taken for, and what is left out of them."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal, Self

from pydantic import Field

from cpic_planner.results.base import Result, Row, column

if TYPE_CHECKING:
    from catalogs import LeftOut, Taken


class OfTables(Result):
    """Base of results of questions that tables of a user's own can be part of."""

    notes: list[str] = Field(
        default_factory=list,
        description="remarks on tables of your own: columns that are not used, rows that are left out, by reason; empty "
        "for shipped tables and in older results",
    )


class LeftOutCell(Row):
    """A row of a user's table that is not used, or a cell that is taken as missing."""

    table: str = column("name of the file")
    row: int = column("number of the row below the heading, from 1")
    name: str = column("what the row is about; empty if it does not say")
    column: str = column("heading of the file, or several joined by or")
    value: str = column("what stands there")
    reason: str = column("what may stand there, or what is wrong")
    done: str = column("row left out, or taken as missing")


class ColumnTaken(Row):
    """A column of a user's table, and what it is taken for."""

    heading: str = column("heading of the file", label="column of the file")
    quantity: str = column("our column that it is taken for; empty: not used", label="taken for")
    unit: str = column("unit in which it is read; empty: none")
    unit_assumed: bool = column("whether the file names no unit, so that this one is assumed")
    convention: str = column("what its numbers mean beyond their unit, in words; empty: nothing else")
    reason: str = column("why it is not used; empty where it is", label="remark")


class ReasonLeftOut(Row):
    """A reason for which rows or cells of a user's table are not used."""

    done: str = column("row left out, or taken as missing", label="what is done")
    count: int = column("rows or cells", label="how many", short="number")
    column: str = column("heading of the file, or several joined by or")
    reason: str = column("what may stand there, or what is wrong", label="reason")
    row: int = column("number of the first such row", label="first row")
    name: str = column("what that row is about; empty if it does not say", label="of")
    value: str = column("what stands there", label="with")


class TableTaken(Result):
    """What a file is taken for as a table of stars or of planets."""

    taken_as: Literal["stars", "planets"]
    n_rows: int = Field(description="rows of the file")
    n_usable: int = Field(description="rows that are used")
    columns: list[ColumnTaken]
    left_out: list[ReasonLeftOut] = Field(description="rows and cells that are not used, by reason")
    notes: list[str] = Field(description="remarks on the reading")

    @classmethod
    def of_file(cls, taken: Taken) -> Self:
        """Return the result of what `catalogs.taken_for` returns."""
        from catalogs import CONVENTIONS

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
    """What the columns of a file are taken for, and how many of its rows can be used."""

    main_rows: ClassVar[str] = "tables"
    schema_version: Literal[1] = 1
    kind: Literal["columns"] = "columns"
    file: str = Field(description="name of the file, without folders")
    tables: list[TableTaken] = Field(description="one; two where it can be read both as stars and as planets")


def left_out_cells(left_out: list[tuple[str, LeftOut]]) -> list[LeftOutCell]:
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
