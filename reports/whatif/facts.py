"""Which fact moved which number: the default strategies before and after each correction of what is known."""

from __future__ import annotations

import csv
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import catalogs
from catalogs import load_known_planets
from cpic_planner.survey import StrategiesConfig, load_strategies, run_whatif, with_universe
from cpic_planner.survey.estimates import difference_interval, mean_interval
from cpic_planner.survey.store import read_table

PLANET = "eps Eri b"
QUANTITIES = {"planets": "all planets", "new": "new planets", "planet": "ε Eri b alone"}
UPDATES = Path(catalogs.__file__).parent / "data" / "known_planets_updates.csv"


@dataclass(frozen=True)
class Step:
    """A state of what is known: tables of stars and of known planets."""

    label: str
    catalog: str
    known_planets: str


def steps(folder: Path) -> tuple[Step, ...]:
    """What was known before, and each fact added to those before it; `folder` takes a table with one orbit."""
    one = folder / "eps_eri_b.csv"
    lines = [line for line in UPDATES.read_text(encoding="utf-8").splitlines() if not line.startswith("#")]
    place = next(csv.reader(lines[:1])).index("planet")
    rows = [line for line in lines[1:] if next(csv.reader([line]))[place] == PLANET]
    one.write_text("\n".join([lines[0], *rows]) + "\n", encoding="utf-8")
    return (
        Step("before", "simbad_2012", "archive_2019"),
        Step("current orbit of ε Eri b", "simbad_2012", f"archive_2019+{one}"),
        Step("refuted planets removed", "simbad_2012", "snapshot"),
        Step("companions of 2028.5", "snapshot", "snapshot"),
    )


def counts(folder: Path, known_planets: str, universes: int) -> dict[str, dict[str, NDArray[np.int64]]]:
    """Planets found in each universe of a finished run, by strategy and by the keys of `QUANTITIES`."""
    played = read_table(folder / "universes.parquet").columns
    seen = read_table(folder / "detections.parquet").columns
    row = list(load_known_planets(known_planets).text("planet")).index(PLANET)
    found = {}
    for strategy in dict.fromkeys(played["strategy"].tolist()):
        mine = played["strategy"] == strategy
        order = np.argsort(played["universe"][mine])
        new, known = (played[name][mine][order].astype(np.int64) for name in ("new_planets", "known_planets"))
        hits = seen["universe"][(seen["strategy"] == strategy) & (seen["known_row"] == row)]
        alone = np.bincount(hits.astype(np.int64), minlength=universes)
        found[strategy] = {"planets": new + known, "new": new, "planet": alone}
    return found


def measure(config: StrategiesConfig, states: Sequence[Step], folder: Path, *, workers: int = 2) -> dict[str, Any]:
    """Every state played in the same universes: means, and the change from the state before it."""
    names = [item.name for item in config.strategies]
    rows: list[dict[str, Any]] = [
        {"strategy": name, "quantity": key, "states": []} for key in QUANTITIES for name in names
    ]
    last: dict[str, dict[str, NDArray[np.int64]]] = {}
    for number, state in enumerate(states):
        chosen = with_universe(config, {"catalog": state.catalog, "known_planets": state.known_planets})
        out = folder / f"state_{number}"
        run_whatif(chosen, out, workers=workers, pages=False)
        found = counts(out, state.known_planets, config.universe.universes)
        for row in rows:
            values = found[row["strategy"]][row["quantity"]]
            cell = {"value": _plain(mean_interval(values)), "change": None}
            if last:
                cell["change"] = _plain(difference_interval(values - last[row["strategy"]][row["quantity"]]))
            row["states"].append(cell)
        last = found
    return {"labels": [state.label for state in states], "universes": config.universe.universes, "rows": rows}


def run() -> dict[str, Any]:
    """The five default strategies."""
    with tempfile.TemporaryDirectory() as scratch:
        return measure(load_strategies(), steps(Path(scratch)), Path(scratch))


def _plain(estimate: Any) -> dict[str, float]:
    return {name: getattr(estimate, name) for name in ("mean", "error", "low", "high")}


def _value(cell: Mapping[str, Any]) -> str:
    value = cell["value"]
    return f"{value['mean']:.2f} ± {value['error']:.2f}"


def _change(cell: Mapping[str, Any]) -> str:
    change = cell["change"]
    if change["error"] == 0.0:
        return "none"
    return f"{change['mean']:+.3f} ({change['low']:+.3f} to {change['high']:+.3f})"


def tables(found: Mapping[str, Any]) -> list[tuple[str, list[str], list[list[str]]]]:
    """Title, head and rows of each table of the report."""
    first, *facts = found["labels"]
    value_head = ["strategy", first, *(f"+ {label}" for label in facts)]
    made = []
    for key, title in QUANTITIES.items():
        rows = [
            [row["strategy"], *(_value(cell) for cell in row["states"])]
            for row in found["rows"]
            if row["quantity"] == key
        ]
        made.append((f"Found in a survey, {title} (mean ± standard error)", value_head, rows))
    changes = [
        [row["strategy"], QUANTITIES[row["quantity"]], *(_change(cell) for cell in row["states"][1:])]
        for row in found["rows"]
    ]
    made.append(("What each fact changes, in the same universes (90 % interval)", ["strategy", "of", *facts], changes))
    return made


def means(found: Mapping[str, Any], key: str, state: int) -> list[float]:
    """One quantity of every strategy in one state."""
    return [row["states"][state]["value"]["mean"] for row in found["rows"] if row["quantity"] == key]


def share(found: Mapping[str, Any], state: int) -> str:
    """Which part of the planets of a strategy is that one planet, least to most."""
    alone, of = means(found, "planet", state), means(found, "planets", state)
    parts = [one / whole if whole else 0.0 for one, whole in zip(alone, of, strict=True)]
    return f"{min(parts):.0%} to {max(parts):.0%}"


def text(found: Mapping[str, Any]) -> str:
    """What the tables show, in words."""
    planets, new = ([max(means(found, key, state)) for state in (0, -1)] for key in ("planets", "new"))
    return (
        "## Which fact moved which number\n\n"
        f"The five default strategies in the same {found['universes']} universes, planned and played anew after "
        "each correction; each column holds those to its left too. *Before*: known planets of May 2019, companions "
        "where the catalogues of 1991 to 2000 have them (`known_planets: archive_2019`, `catalog: simbad_2012`). The "
        f"most that any strategy finds goes from {planets[0]:.2f} to {planets[1]:.2f} planets, and from {new[0]:.2f} "
        f"to {new[1]:.2f} new ones. ε Eri b is {share(found, 0)} of the planets of a strategy before and "
        f"{share(found, -1)} after."
    )
