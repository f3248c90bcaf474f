"""Cases of products: Level-0 trees, point-spread functions, mirror surfaces and folders of runs, mutated."""

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from astropy.io import fits
from hypothesis import strategies as st

from cpic_planner.jobs import Job, Task, run
from simulator.products import check_level0, write_level0
from tests.fuzz.values import WORDS
from tests.fuzz.watched import Case, of_function
from tests.simulator.products.conftest import FakeSequence

_CARDS = (
    *(
        "NAXIS1 ",
        "NAXIS2 ",
        "NAXIS  ",
        "BITPIX ",
        "PCOUNT ",
        "GCOUNT ",
        "TFIELDS",
        "TFORM1 ",
        "TTYPE1 ",
        "ZNAXIS1",
        "ZTILE1 ",
    ),
    *(
        "EXPTIME",
        "DATE-OBS",
        "EXPSTART",
        "CRVAL1 ",
        "CD1_1  ",
        "BSCALE ",
        "BZERO  ",
        "OBSID  ",
        "EXTNAME",
        "CHECKSUM",
        "NFRAME ",
    ),
    *(
        "SIMPLE ",
        "XTENSION",
        "EXTEND ",
        "END    ",
        "DATASUM",
        "BLANK  ",
        "THEAP  ",
        "ZBITPIX",
        "ZCMPTYPE",
        "FILTER ",
        "GAIN   ",
    ),
)
_VALUES = (
    *(
        "0",
        "-1",
        "1",
        "99999",
        "9999999999",
        "9" * 60,
        "1E308",
        "1E999",
        "NaN",
        "T",
        "F",
        "''",
        "'x'",
        "'" + "x" * 60,
        "(1, 2)",
    ),
    *(
        "-32",
        "16",
        "8",
        "64",
        "12",
        "'1PB(1)'",
        "'999999999J'",
        "'A0'",
        "'2028-01-01'",
        "'RICE_1'",
        "'GZIP_9'",
        "'HCOMPRESS_1'",
    ),
    *("", "0x10", "1_0", "+-1", "1.0.0", "\x01\x02", "é"),
)
_JSON = (
    "{",
    "[",
    "null",
    "9" * 5000,
    '"\\ud800"',
    "NaN",
    "1e999",
    "{}",
    "[]",
    '""',
    "-1",
    "[[[[" * 500,
    "true",
    '{"a":' * 800,
)


def prepare(folder: Path) -> None:
    """Write the good products that the cases change."""
    write_level0(replace(FakeSequence(), made=[], n_frames=2), folder / "good" / "tree", obsid=40000000012)
    axis = np.arange(21) - 10.0
    stamp = np.exp(-np.add.outer(axis**2, axis**2) / 8.0) / 60.0
    np.savez(folder / "good" / "psf.npz", off_axis=stamp, on_axis=stamp * 1e-6, pixel_scale_arcsec=0.016153)
    units = [fits.PrimaryHDU(), fits.ImageHDU(stamp, name="OFF_AXIS"), fits.ImageHDU(stamp * 1e-6, name="ON_AXIS")]
    for unit in units:
        unit.header["PIXSCALE"] = 0.016153
    fits.HDUList(units).writeto(folder / "good" / "psf.fits")
    surface = fits.PrimaryHDU(np.outer(axis, axis) / 10.0)
    surface.header["BUNIT"] = "nm"
    surface.writeto(folder / "good" / "surface.fits")
    np.savez(folder / "good" / "surface.npz", surface_nm=np.outer(axis, axis) / 10.0)
    run(_job(), folder / "good" / "run")


def _double(number: int, progress: Any = None) -> dict[str, int]:
    return {"double": 2 * number}


def _job() -> Job[Any]:
    from cpic_planner.results import CheckResult

    def work(runner: Any) -> CheckResult:
        found = runner.finish(_double, [Task(f"double {i}", (i,)) for i in range(2)])
        total = sum(body["double"] for body in found.values())
        return CheckResult(paths=[], n_files=total, n_errors=0, n_warnings=0, findings=[])

    return Job("doubles", 1, lambda: {"n": 2}, work)


def read(kind: str, place: Path) -> Any:
    """Read products of a kind as their users do."""
    from cpic_planner import load_dm_surface, load_psf

    if kind == "level 0":
        for finding in check_level0(place):
            str(finding)
        return None
    if kind == "psf":
        return load_psf(place)
    if kind == "surface":
        return load_dm_surface(place)
    return run(_job(), place)


def _cards_changed(draw: Any, data: bytes) -> bytes:
    """A FITS file with the value of a card, or a whole card, changed."""
    places = [place for word in _CARDS for place in _found(data, f"{word}"[:8].ljust(8).encode())]
    if not places:
        return data
    place = draw(st.sampled_from(places))
    change = draw(st.sampled_from(("value", "value", "name", "drop", "twice")))
    if change == "value":
        value = draw(st.sampled_from(_VALUES)).encode("latin-1")[:70]
        return data[: place + 10] + value.rjust(20)[:70].ljust(70) + data[place + 80 :]
    card = {"name": b"X" + data[place + 1 : place + 80], "drop": b" " * 80, "twice": data[place : place + 80]}[change]
    return data[:place] + card + (data[place + 160 :].rjust(0) if change == "twice" else data[place + 80 :])


def _found(data: bytes, word: bytes) -> list[int]:
    found, start = [], data.find(word)
    while start >= 0 and len(found) < 4:
        if start % 80 == 0:
            found.append(start)
        start = data.find(word, start + 1)
    return found


def _bytes_changed(draw: Any, data: bytes) -> bytes:
    place = draw(st.integers(0, len(data)))
    change = draw(st.sampled_from(("flip", "insert", "cut", "end", "more")))
    if change == "flip" and place < len(data):
        return data[:place] + bytes([data[place] ^ 1 << draw(st.integers(0, 7))]) + data[place + 1 :]
    if change == "insert":
        return data[:place] + draw(st.binary(min_size=1, max_size=20)) + data[place:]
    if change == "cut":
        return data[:place] + data[place + draw(st.integers(1, 3000)) :]
    if change == "more":
        return data + draw(st.sampled_from((b"x", b"\x00" * 2880, b"END" + b" " * 77, b" " * 2880)))
    return data[:place]


def _text_changed(draw: Any, data: bytes) -> bytes:
    """A text with something else in the place of a piece of it."""
    place, length = draw(st.integers(0, len(data))), draw(st.sampled_from((0, 1, 4, 10, 30)))
    new = draw(st.one_of(st.sampled_from(_JSON), st.sampled_from(WORDS))).encode("utf-8", "surrogatepass")
    return data[:place] + new + data[place + length :]


_KINDS = ("level 0", "level 0", "level 0", "psf", "surface", "run")


@st.composite
def cases(draw: Any, folder: Path) -> Case:
    """Draw products."""
    kind = draw(st.sampled_from(_KINDS))
    good = folder / "good"
    if kind in ("psf", "surface"):
        name = f"{kind}.{draw(st.sampled_from(('fits', 'npz')))}"
        data = (good / name).read_bytes()
        for _ in range(draw(st.sampled_from((1, 1, 2)))):
            data = (_cards_changed if name.endswith("fits") and draw(st.booleans()) else _bytes_changed)(draw, data)

        def changed() -> Any:
            (folder / name).write_bytes(data)
            return read(kind, folder / name)

        return kind, data[:2000], lambda: of_function(changed)
    source = good / ("tree" if kind == "level 0" else "run")
    names = sorted(path.relative_to(source).as_posix() for path in source.rglob("*") if path.is_file())
    changes: dict[str, Any] = {}
    for _ in range(draw(st.sampled_from((1, 1, 2)))):
        name = draw(st.sampled_from(names))
        data = (source / name).read_bytes()
        change = draw(
            st.sampled_from(("content", "content", "content", "content", "missing", "empty", "folder", "name"))
        )
        if change == "content":
            alter = _bytes_changed
            if draw(st.booleans()):
                alter = _cards_changed if name.endswith(".fits") else _text_changed
            changes[name] = alter(draw, data)
        elif change == "name":
            changes[name], changes[name.replace("_", "-", 1) + draw(st.sampled_from(("", ".part", "x", " ")))] = (
                None,
                data,
            )
        else:
            changes[name] = {"missing": None, "empty": b"", "folder": ...}[change]

    def read_tree() -> Any:
        place = folder / "case"
        shutil.rmtree(place, ignore_errors=True)
        shutil.copytree(source, place)
        for name, data in changes.items():
            (place / name).unlink(missing_ok=True)
            if data is ...:
                (place / name).mkdir()
            elif data is not None:
                (place / name).write_bytes(data)
        return read(kind, place)

    shown = {
        name: data if not isinstance(data, bytes) else _difference((source / name), data)
        for name, data in changes.items()
    }
    return kind, shown, lambda: of_function(read_tree)


def _difference(path: Path, data: bytes) -> Any:
    """What of a file is new, for messages."""
    old = path.read_bytes() if path.is_file() else b""
    start = next(
        (i for i, pair in enumerate(zip(old, data, strict=False)) if pair[0] != pair[1]), min(len(old), len(data))
    )
    return start, len(old), len(data), data[max(0, start - 20) : start + 80]
