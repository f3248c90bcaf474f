"""Limits from radial velocities for the shipped tables, fitted to the injections of the California Legacy Survey.

``python -m tools.velocity_limits FOLDER`` reads a copy of the survey's repository (github.com/leerosenthalj/CLSI,
commit 689d491; Rosenthal et al. 2021, ApJS 255, 8) and writes its stars into ``catalogs/data/velocity_limits.csv``,
where the rows of other sources, which are kept by hand, stay as they are, and the medians over these stars into
``velocity_rules.csv``. Of each star the survey publishes 1000 planets that it put into the measured velocities, and
whether its search found them again.
"""

import argparse
import csv
import itertools
import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import minimize

from catalogs import load_stars
from catalogs.names import snapshot_aliases
from catalogs.nomenclature import designation_key
from catalogs.velocity_limits import ANNULI_AU, LIMITS_FILE, NUMBERS, RULES_FILE, VELOCITY_AXES_AU, amplitude_m_s
from cpic_core import FloatArray

EARTHS_IN_MJUP = 317.828
OF_SYSTEM = 1
"""Kind of an alias that names a whole system."""
REFERENCE = "Rosenthal et al. 2021 (2021ApJS..255....8R), injections of github.com/leerosenthalj/CLSI 689d491"
NO_LIMIT_FROM = {"eps Eri": 2.4, "sig Dra": 0.6, "omi2 Eri": 2.4, "HD 219134": 0.6}
"""Inner edge, au, of the annuli where the survey's search confused injections with a known signal or the star's cycle:
half of the heaviest planets were missed there, which the velocities show plainly."""
_USUAL_RATIO, _RATIO_SCATTER = 1.6, 0.7
_CEILING_WEIGHT = 4.0


def _by_annulus(*names: str) -> list[str]:
    """Return the columns of quantities, whose names end in the number of the annulus, from 1."""
    return [f"{name}_{number}" for name in names for number in range(1, len(VELOCITY_AXES_AU) + 1)]


LIMIT_COLUMNS = ("star", "rule", "n_velocities", "baseline_years", *_by_annulus(*NUMBERS), "reference", "note")
RULE_COLUMNS = ("rule", "n_stars", *_by_annulus("k50_m_s", "m90_over_m50", "ceiling"), "reference")


@dataclass(frozen=True)
class Sensitivity:
    """``P(found) = ceiling / (1 + (m50 / m)^s)`` with ``s = ln 9 / ln(m90 / m50)``; masses are m sin i in M_Jup."""

    m50_mjup: float
    m90_mjup: float
    ceiling: float


def fitted(msini_mjup: FloatArray, found: FloatArray) -> Sensitivity:
    """Fit the sensitivity of one star in one annulus to planets that were put in, and found or not.

    Parameters
    ----------
    msini_mjup : ndarray
        Shape ``(n,)``, above 0.
    found : ndarray
        Shape ``(n,)``, 1 for found and 0 for missed.

    Notes
    -----
    Most likely values, with two weak priors that decide only where the injections do not: m90 / m50 is 1.6 within a
    factor of ``exp(0.7)`` of its logarithm (the median of the survey), and the ceiling has a Beta(5, 1) density.
    """
    log_mass = np.log(msini_mjup)

    def penalty(values: FloatArray) -> float:
        middle, log_width, lost = values
        share = 1.0 / (1.0 + np.exp(lost))
        logit = np.clip(np.log(9.0) / np.exp(log_width) * (log_mass - middle), -500.0, 500.0)
        chance = np.clip(share / (1.0 + np.exp(-logit)), 1e-12, 1.0 - 1e-12)
        likelihood = np.sum(found * np.log(chance) + (1.0 - found) * np.log1p(-chance))
        usual = (log_width - np.log(np.log(_USUAL_RATIO))) / _RATIO_SCATTER
        return float(-likelihood + 0.5 * usual**2 - _CEILING_WEIGHT * np.log(share))

    starts = [[middle, np.log(np.log(_USUAL_RATIO)), -3.0] for middle in np.quantile(log_mass, (0.2, 0.4, 0.6, 0.8))]
    options = {"xatol": 1e-5, "fatol": 1e-7, "maxiter": 4000}
    best = min(
        (minimize(penalty, start, method="Nelder-Mead", options=options) for start in starts), key=lambda r: r.fun
    )
    middle, log_width, lost = best.x
    m50 = float(np.exp(middle))
    return Sensitivity(m50, float(m50 * np.exp(np.exp(log_width))), float(1.0 / (1.0 + np.exp(lost))))


def catalogue_name(survey_name: str) -> str | None:
    """Return the catalogue's name of a star of the survey, an HD number with or without a component; None without."""
    match = re.fullmatch(r"(\d+)([ab]?)", survey_name)
    if match is None:
        return None
    number, component = match.groups()
    aliases = snapshot_aliases()
    own, system = aliases.get(designation_key(f"HD {number} {component}".strip())), aliases.get(f"hd {number}")
    if own is None or (component == "b" and own[1] == OF_SYSTEM):
        # A name of the system stands for its brightest star, which is not the companion.
        own = system if component == "a" else None
    return None if own is None else own[0]


def _rows(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(line for line in stream if not line.startswith("#")))


def star_row(folder: Path, survey_name: str, star: str, statistics: dict[str, str]) -> dict[str, str]:
    """Return the row of one star, with its fits in all annuli that have injections on both sides of its limit."""
    injections = _rows(folder / "completeness" / "recoveries_all" / f"{survey_name}_recoveries.csv")
    axis = np.array([float(row["inj_au"]) for row in injections])
    mass = np.array([float(row["inj_msini"]) for row in injections]) / EARTHS_IN_MJUP
    found = np.array([float(row["recovered"] == "True") for row in injections])
    row = dict.fromkeys(LIMIT_COLUMNS, "")
    row |= {
        "star": star,
        "n_velocities": statistics["Nobs"],
        "baseline_years": f"{float(statistics['baseline']) / 365.25:.1f}",
        "reference": REFERENCE,
    }
    first_lost = NO_LIMIT_FROM.get(star, np.inf)
    if np.isfinite(first_lost):
        row |= {
            "rule": "all",
            "note": f"rule beyond {first_lost:g} au: the search confused injections with a known signal",
        }
    for number, (low, high) in enumerate(itertools.pairwise(ANNULI_AU)):
        mine = (axis >= low) & (axis < high)
        if low >= first_lost or not found[mine].any():
            continue
        fit = fitted(mass[mine], found[mine])
        for name in NUMBERS:
            row[f"{name}_{number + 1}"] = f"{getattr(fit, name):.4g}"
    return row


def rule_rows(rows: Iterable[dict[str, str]]) -> list[dict[str, str]]:
    """Return medians over the survey's stars: amplitude at 50 %, ratio of the limits at 90 and 50 %, and ceiling."""
    stars = load_stars()
    index = {name: number for number, name in enumerate(stars.column("name").tolist())}
    mass, kind = stars.column("mass_msun"), stars.column("sp_type").tolist()
    known = [row for row in rows if row["reference"] == REFERENCE]
    groups = {
        "all": known,
        "many": [row for row in known if int(row["n_velocities"]) >= 150],
        "few": [row for row in known if int(row["n_velocities"]) < 60],
        "F": [row for row in known if kind[index[row["star"]]].startswith("F")],
    }
    table = []
    for name, members in groups.items():
        row = {"rule": name, "n_stars": str(len(members)), "reference": f"medians of the rows of {REFERENCE}"}
        for number, axis in enumerate(VELOCITY_AXES_AU, 1):
            limits = [item for item in members if item[f"m50_mjup_{number}"]]
            m50, m90, ceiling = (np.array([float(item[f"{key}_{number}"]) for item in limits]) for key in NUMBERS)
            own = np.array([float(mass[index[item["star"]]]) for item in limits])
            row[f"k50_m_s_{number}"] = f"{np.median(amplitude_m_s(m50, axis, own)):.3g}"
            row[f"m90_over_m50_{number}"] = f"{np.median(m90 / m50):.3g}"
            row[f"ceiling_{number}"] = f"{np.median(ceiling):.3g}"
        table.append(row)
    return table


def _write(path: Path, columns: Iterable[str], rows: Iterable[dict[str, str]]) -> None:
    with path.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.DictWriter(stream, list(columns), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


def main() -> None:
    """Write both tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="copy of the survey's repository")
    folder = parser.parse_args().folder
    statistics = {row["name"]: row for row in _rows(folder / "legacy_tables" / "observation_stats.csv")}
    by_hand = [row for row in _rows(LIMITS_FILE) if row["reference"] != REFERENCE] if LIMITS_FILE.exists() else []
    rows = {row["star"]: row for row in by_hand}
    for path in sorted((folder / "completeness" / "recoveries_all").glob("*_recoveries.csv")):
        survey_name = path.name.removesuffix("_recoveries.csv")
        star = catalogue_name(survey_name)
        if star is not None and star not in rows and survey_name in statistics:
            rows[star] = star_row(folder, survey_name, star, statistics[survey_name])
    table = [rows[star] for star in sorted(rows, key=str.casefold)]
    _write(RULES_FILE, RULE_COLUMNS, rule_rows(table))
    _write(LIMITS_FILE, LIMIT_COLUMNS, table)


if __name__ == "__main__":
    main()
