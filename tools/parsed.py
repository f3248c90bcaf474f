"""Rewrite what ships beside its source because reading it is quicker than making it: ``python -m tools.parsed``."""

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from catalogs.catalogue import vintage_of_files
from catalogs.shipped import PARSED
from catalogs.stars import load_stars, with_updates
from cpic_core import NDArray, parse_yaml, write_npz, write_text
from cpic_core.yaml_files import PARSED as FOLDER, digest, in_units
from cpic_planner.etc.detection_law import TAILS_FILE, equivalents

ROOT = Path(__file__).resolve().parents[1]
STEPS = range(5, 24)
"""Steps of signal over noise that levels of 4 to 5 sigma need."""


def packed(columns: Mapping[str, NDArray[Any]], about: Mapping[str, str]) -> dict[str, NDArray[Any]]:
    """Return columns, and texts about their table, as the arrays that `catalogs.shipped.parsed` reads."""
    texts = {
        name: np.unique(column, return_inverse=True) for name, column in columns.items() if column.dtype.kind == "U"
    }
    head = {
        "columns": {name: column.dtype.str for name, column in columns.items()},
        "words": {name: found[0].tolist() for name, found in texts.items()},
        "about": dict(about),
    }
    numbers = np.array([column for name, column in columns.items() if name not in texts], float)
    tens = 10.0 ** np.arange(16)[:, None]
    exact = [np.nonzero((np.round(tens * row) / tens == row)[:, np.isfinite(row)].all(axis=1))[0][0] for row in numbers]
    whole = np.round(numbers * 10.0 ** np.array(exact)[:, None])
    return {
        "whole": np.where(np.isfinite(whole), whole, np.iinfo(np.int64).min).astype(np.int64),
        "decimals": np.array(exact),
        "places": np.array([found[1] for found in texts.values()], np.uint16),
        "head": np.frombuffer(json.dumps(head).encode(), np.uint8),
    }


def stars() -> dict[str, NDArray[Any]]:
    """Return the star table with its updates, and its vintage with them and without."""
    vintage = {"updated": vintage_of_files(updates=True), "plain": vintage_of_files(updates=False)}
    return packed(with_updates(load_stars(updates=False)).columns, vintage)


def tails() -> dict[str, NDArray[Any]]:
    """Return significances of heavy tails by step of the signal over noise."""
    return {"step": np.array(STEPS), "sigma": np.stack([equivalents(step) for step in STEPS])}


FILES: Mapping[Path, Callable[[], dict[str, NDArray[Any]]]] = {PARSED / "stars.npz": stars, TAILS_FILE: tails}
"""Functions that make the arrays of each file."""

PLACES = (
    "simulator/presets/instrument",
    "catalogs/data",
    "simulator/products/data",
    *(f"cpic_planner/presets/{kind}" for kind in ("population", "strategy")),
)
YAML = [path for place in PLACES for path in (ROOT / place).rglob("*.yaml")]
"""Documents that ship as JSON too, of what answers within a second asks; the others are long, and their answers too."""


def documents() -> dict[Path, str]:
    """Return each of `YAML` as JSON, by the file that it ships in."""
    texts = [path.read_text(encoding="utf-8") for path in YAML]
    return {
        FOLDER / f"{digest(text)}.json": json.dumps(in_units(parse_yaml(text)), separators=(",", ":")) + "\n"
        for text in texts
    }


if __name__ == "__main__":
    for stale in FOLDER.glob("*.json"):
        stale.unlink()
    for path, text in documents().items():
        print(write_text(path, text))
    for path, made in FILES.items():
        write_npz(path, made())
        print(path)
