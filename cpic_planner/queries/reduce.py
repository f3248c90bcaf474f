"""The question of ``cpic reduce``: which Level-0 files, with which calibrations."""

from pathlib import Path
from typing import Annotated, ClassVar

from pydantic import BeforeValidator

from cpic_planner.queries.changes import InstrumentParts, read_instrument
from cpic_planner.queries.question import asked
from cpic_planner.queries.shared import RunQuestion, asked_out, several
from simulator.config import Instrument, load_instrument

Paths = Annotated[tuple[Path, ...], BeforeValidator(several)]


class ReduceQuestion(RunQuestion):
    """Reduce Level-0 frames to electrons of light with errors and masks."""

    KIND: ClassVar[str] = "reduce"

    what: Paths = asked(
        ...,
        "Level-0 files of any writer, or folders of them.",
        argument=True,
        metavar="WHAT...",
        accepts="path, or a list of them",
        names_file=lambda word: True,
    )
    masters: Paths | None = asked(
        None,
        "Calibrations: Level-0 files of kind BIAS, DARK and FLAT, FITS maps (flat, dark, cic, bad_columns, bias), or "
        "folders of them; repeat for several.",
        unset="those that {what} holds",
        metavar="PATH",
        accepts="path, or a list of them",
        names_file=lambda word: True,
    )
    instrument: Instrument = asked(
        load_instrument,
        "Gives the numbers of the camera that headers do not state.",
        parts=InstrumentParts,
        read=read_instrument,
        accepts="Instrument, mapping, str or Path",
    )
    out: Path = asked_out("out/reduce")
