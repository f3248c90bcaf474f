"""Cases of tables: stars, planets, logs, rankings and spectra in every format, with cells or bytes changed."""

import io
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from astropy.table import Table
from hypothesis import strategies as st

from tests.fuzz.values import NUMBERS, WORDS
from tests.fuzz.watched import Case, of_function

_ROWS: dict[str, tuple[tuple[str, ...], list[list[Any]]]] = {
    "stars": (
        (
            "name",
            "ra_deg",
            "dec_deg",
            "distance_pc",
            "v_mag",
            "sp_type",
            "companion_separation_arcsec",
            "companion_v_mag",
        ),
        [["A one", 10.0, 20.0, 5.0, 4.0, "G2V", 3.0, 8.0], ["B two", 100.0, -20.0, 8.0, 5.0, "K2V", 9.0, 9.0]],
    ),
    "planets": (
        ("star", "planet", "semi_major_axis_au", "period_days", "eccentricity", "mass_mjup", "radius_rjup", "status"),
        [
            ["eps Eri", "eps Eri x", 3.4, 2500.0, 0.1, 1.0, 1.0, "confirmed"],
            ["tau Cet", "tau Cet x", 2.0, 800.0, 0.2, 0.5, 0.8, ""],
        ],
    ),
    "visits": (
        (
            "star",
            "start_utc",
            "outcome",
            "band",
            "exposure_s",
            "frames_per_visit",
            "em_gain",
            "telescope_h",
            "roll_deg",
        ),
        [
            ["tau Cet", "2028-02-01T00:00:00", "not_detected", "F520", 10.0, 100, 20.0, 1.0, 0.0],
            ["eps Eri", "2028-03-01T00:00:00", "detected", "F662", 10.0, 100, 20.0, 1.0, 10.0],
            ["eps Eri", "", "", "F662", 10.0, 100, 20.0, 1.0, 10.0],
        ],
    ),
    "spectrum": (("wavelength_nm", "photlam"), [[400.0 + 10.0 * i, 1.0 + 0.1 * i] for i in range(80)]),
    "albedo": (("wavelength_nm", "albedo"), [[400.0 + 10.0 * i, 0.3] for i in range(80)]),
}
FORMATS = {"csv": "ascii.csv", "ecsv": "ascii.ecsv", "vot": "votable", "fits": "fits"}
_BYTES = (
    *(
        b"",
        b"\x00",
        b"\xff",
        b"\xef\xbb\xbf",
        b"\r",
        b"\n",
        b",",
        b'"',
        b"'",
        b"<",
        b"&x;",
        b"]]>",
        b"9" * 400,
        b"#",
        b";",
    ),
    *(
        b"<!DOCTYPE x [<!ENTITY a 'b'>]>",
        b"nan",
        b"-",
        b"e999",
        b" ",
        b"\t",
        b"--",
        b"inf",
        b"END",
        b"SIMPLE",
        b"\x1f\x8b",
    ),
)


def _written(kind: str, rows: list[list[Any]], ending: str) -> bytes:
    """A table as a file of a format; cells of several types become texts."""
    names = _ROWS[kind][0]
    columns = []
    for index in range(len(names)):
        cells = [row[index] for row in rows]
        plain = all(isinstance(cell, int | float) for cell in cells)
        columns.append(np.array(cells, dtype=float) if plain else [str(cell) for cell in cells])
    table, out = Table(columns, names=names), io.BytesIO()
    if ending in ("vot", "fits"):
        table.write(out, format=FORMATS[ending])
        return out.getvalue()
    text = io.StringIO()
    table.write(text, format=FORMATS[ending])
    return text.getvalue().encode("utf-8", "surrogatepass")


def _read(kind: str, path: Path) -> Any:
    from catalogs import load_known_planets
    from cpic_planner import load_targets, signal_to_noise
    from cpic_planner.ranking.sensitivity import load_ranking
    from cpic_planner.survey.observed import read_log, read_schedule
    from simulator.target.albedo_grid import read_albedo
    from simulator.target.star_spectrum import read_spectrum

    if kind == "stars":
        found = load_targets(path)
        names = list(found["name"][:2])
        return signal_to_noise(names, catalog=path, bands=["F520"], time_s=36000, separation_arcsec=0.5)
    if kind == "visits":
        read_log(path)
        return read_schedule(path)
    readers: dict[str, Callable[[Path], Any]] = {
        "planets": lambda place: load_known_planets(place),
        "spectrum": read_spectrum,
        "albedo": read_albedo,
        "ranking": load_ranking,
    }
    return readers[kind](path)


def prepare(folder: Path) -> None:
    """Write a good ranking, which the cases of rankings change."""
    from cpic_core import dump_json
    from cpic_planner import rank_targets, report

    result = rank_targets(catalog=folder / "stars.csv", bands=["F520"], n_planets=20)
    (folder / "ranking.json").write_text(dump_json(result.model_dump(mode="json")), encoding="utf-8")
    for ending, text in ((".csv", report.ranking_csv), (".ecsv", report.ranking_ecsv)):
        (folder / f"ranking{ending}").write_text(text(result), encoding="utf-8")


@st.composite
def cases(draw: Any, folder: Path) -> Case:
    """Draw a table."""
    kind = draw(st.sampled_from([*_ROWS, "stars", "stars", "planets", "visits", "ranking"]))
    if kind == "ranking":
        ending = draw(st.sampled_from(("json", "csv", "ecsv")))
        data = (folder / f"ranking.{ending}").read_bytes()
    else:
        ending = draw(st.sampled_from(("csv", "csv", "ecsv", "vot", "fits")))
        rows = [list(row) for row in _ROWS[kind][1]]
        for _ in range(draw(st.sampled_from((0, 1, 1, 1, 2, 3)))):
            row, column = draw(st.integers(0, len(rows) - 1)), draw(st.integers(0, len(rows[0]) - 1))
            cell = draw(st.one_of(st.sampled_from(NUMBERS), st.sampled_from(WORDS), st.floats(), st.text(max_size=9)))
            rows[row][column] = cell
        try:
            data = _written(kind, rows, ending)
        except (UnicodeError, ValueError, OverflowError):  # the format has no such text
            data, ending = _written(kind, [[str(cell) for cell in row] for row in rows], "csv"), "csv"
    for _ in range(draw(st.sampled_from((0, 0, 1, 1, 2)))):
        place, change = draw(st.integers(0, len(data))), draw(st.sampled_from(("insert", "cut", "flip", "end", "line")))
        if change == "insert":
            data = data[:place] + draw(st.one_of(st.sampled_from(_BYTES), st.binary(max_size=6))) + data[place:]
        elif change == "cut":
            data = data[:place] + data[place + draw(st.integers(1, 200)) :]
        elif change == "end":
            data = data[:place]
        elif change == "flip" and place < len(data):
            data = data[:place] + bytes([data[place] ^ 1 << draw(st.integers(0, 7))]) + data[place + 1 :]
        else:
            lines = data.splitlines(keepends=True) or [b""]
            line = draw(st.sampled_from(lines[:40]))
            data = data.replace(line, line * 2, 1)
    ending = draw(st.sampled_from((ending, ending, ending, "csv", "txt", "")))
    if kind == "ranking" and ending not in ("json", "csv", "ecsv"):
        ending = "json"
    path = folder / f"{kind}-case{'.' * bool(ending)}{ending}"

    def run() -> Any:
        path.write_bytes(data)
        return _read(kind, path)

    return kind, data, lambda: of_function(run)
