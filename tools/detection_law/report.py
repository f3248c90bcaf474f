"""Report of the law of detection: planets found against predicted, and false alarms, over random scenes."""

import itertools
import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from cpic_core import FloatArray, write_bytes
from cpic_planner.etc import speckled_share
from cpic_planner.validation import Frames
from tools.detection_law.cells import LEVELS, VISITS, Cell, Programme, unpacked
from tools.report_parts import machine, png, table

MODES = {"found": "blind", "placed": "at a known place"}
_WORST = 8
_BRIGHTER = 0.02


def predicted(cells: Iterable[Mapping[str, Any] | None]) -> list[dict[str, Any]]:
    """Return one row a cell with what its planets were promised, as arrays by mode, beside what was found.

    Parameters
    ----------
    cells : iterable of mapping or None
        As of `tools.detection_law.cells.measured`.
    """
    rows = []
    for item in cells:
        if item is None:
            continue
        cell = Cell(**item["cell"])
        exposure_s, n_frames, em_gain = item["frames"]
        programme = Programme.of(cell, Frames(exposure_s, n_frames, em_gain, cell.visits))
        if programme is None:
            continue
        x, y, contrast = unpacked(item["planets"])
        shown = np.array([int(one) for one in item["shown"]])
        prospect, brighter = (programme.prospect(x, y, factor * contrast) for factor in (1.0, 1.0 + _BRIGHTER))
        promised, more = (
            {"found": seen.chances.blind[0], "placed": seen.chances.known_place[0]} for seen in (prospect, brighter)
        )
        own = {"cell": cell, "separation": np.hypot(x, y), "promised": promised, "alarms": item["alarms"]}
        own |= {"slope": {mode: float((more[mode] - promised[mode]).mean()) / _BRIGHTER for mode in MODES}}
        own |= {"speckled": np.broadcast_to(speckled_share(prospect.noise), (1, x.size))[0]}
        seen = {mode: (shown >> bit & 1).astype(float) for bit, mode in enumerate(MODES)}
        rows.append(own | {"elements": item["elements"]} | seen)
    return rows


def _line(name: str, chance: FloatArray, hit: FloatArray) -> list[str]:
    error = math.sqrt(max(float(np.sum(chance * (1.0 - chance))), 0.25)) / len(chance)
    cells = [f"{chance.mean():.3f}", f"{hit.mean():.3f}", f"{hit.mean() - chance.mean():+.3f}", f"{error:.3f}"]
    return [name, str(len(chance)), *cells]


def groups(rows: list[dict[str, Any]], mode: str) -> list[list[str]]:
    """Return the lines of the table of planets found and promised: all, and by what cells differ in."""
    chance = np.concatenate([row["promised"][mode] for row in rows])
    hit = np.concatenate([row[mode] for row in rows])

    def each(key: Any) -> Any:
        return np.concatenate([np.broadcast_to(key(row), row[mode].shape) for row in rows])

    lines = [_line("all", chance, hit)]
    for low in np.arange(0.0, 1.0, 0.2):
        inside = (chance >= low) & (chance < low + 0.2 + 1e-9 * (low > 0.7))
        lines += [_line(f"promised {low:.1f} to {low + 0.2:.1f}", chance[inside], hit[inside])] if inside.any() else []
    bands, visits = each(lambda row: row["cell"].band), each(lambda row: row["cell"].visits)
    lines += [_line(band, chance[bands == band], hit[bands == band]) for band in np.unique(bands)]
    lines += [_line(f"{n} visits", chance[visits == n], hit[visits == n]) for n in VISITS if (visits == n).any()]
    speckled, drift = each(lambda row: row["speckled"]), each(lambda row: row["cell"].drift_nm)
    place = each(lambda row: (row["separation"] - row["separation"].min()) / np.ptp(row["separation"]))
    for name, values, edges in (
        ("speckles in the variance", speckled, (0.0, 0.1, 0.5, 0.9, 1.0)),
        ("drift, nm", drift, (0.01, 0.05, 0.15, 0.5)),
        ("from inner to outer corner", place, (0.0, 0.2, 0.4, 0.6, 0.8, 1.0)),
    ):
        for low, high in itertools.pairwise(edges):
            inside = (values >= low) & (values <= high)
            lines += [_line(f"{name} {low:g} to {high:g}", chance[inside], hit[inside])] if inside.any() else []
    for name, there in (
        ("with a companion", each(lambda row: row["cell"].companion is not None)),
        ("with a star behind", each(lambda row: row["cell"].background is not None)),
    ):
        lines += [_line(name, chance[there], hit[there])] if there.any() else []
    return lines


def differences(rows: list[dict[str, Any]], mode: str) -> FloatArray:
    """Return found less promised of every cell, and its standard error, shape (2, cells)."""
    promised = [row["promised"][mode] for row in rows]
    error = [math.sqrt(max(float(np.sum(part * (1.0 - part))), 0.25)) / part.size for part in promised]
    return np.array([[row[mode].mean() - row["promised"][mode].mean() for row in rows], error])


def law_error(rows: list[dict[str, Any]], mode: str) -> float:
    """Return the relative standard error of the significance at which half are found, without what counting makes."""
    slope = np.array([row["slope"][mode] for row in rows])
    apart, error = differences(rows, mode)
    known = slope > 0.3 * slope.max()
    square = (apart[known] ** 2 - error[known] ** 2) / slope[known] ** 2
    return math.sqrt(max(float(square.mean()), 0.0))


def _worst(rows: list[dict[str, Any]]) -> list[list[str]]:
    apart = differences(rows, "found")
    lines = []
    for index in np.argsort(-np.abs(apart[0]))[:_WORST]:
        cell, row = rows[index]["cell"], rows[index]
        others = ", ".join(
            name for name, there in (("companion", cell.companion), ("star behind", cell.background)) if there
        )
        what = [cell.band, f"{cell.v_mag:.1f}", str(cell.visits), f"{cell.drift_nm:.3f}", others or "none"]
        lines.append([*what, *_line("", row["promised"]["found"], row["found"])[2:]])
    return lines


def alarm_rows(rows: list[dict[str, Any]]) -> list[list[str]]:
    """Return the lines of the table of false alarms."""
    from scipy.stats import norm, poisson

    lines, elements = [], sum(row["elements"] for row in rows)
    for level in LEVELS:
        count, mean = sum(row["alarms"][f"{level:g}"] for row in rows), elements * float(norm.sf(level))
        low, high = poisson.interval(0.95, mean)
        inside = "yes" if low <= count <= high else "no"
        cells = [f"{level:g}", f"{elements:.0f}", str(count), f"{mean:.1f}", f"{low:.0f} to {high:.0f}", inside]
        lines.append(cells)
    return lines


def write_map(rows: list[dict[str, Any]], path: Path) -> None:
    """Draw found against promised shares, one point a cell, blind and at a known place."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 5.0), layout="constrained")
    colours = dict(zip(("F520", "F662", "F720", "F850"), ("C0", "C2", "C1", "C3"), strict=True))
    for axes, (mode, name) in zip(figure.subplots(1, 2, sharey=True), MODES.items(), strict=True):
        axes.plot([0, 1], [0, 1], color="0.6", lw=1)
        for band, colour in colours.items():
            own = [row for row in rows if row["cell"].band == band]
            if own:
                promised = [row["promised"][mode].mean() for row in own]
                found, error = [row[mode].mean() for row in own], differences(own, mode)[1]
                axes.errorbar(promised, found, error, fmt="o", ms=4, lw=1, color=colour, label=band)
        axes.set(xlabel="mean probability promised", title=name[0].upper() + name[1:], xlim=(0, 1), ylim=(0, 1))
        axes.set_aspect("equal")
    figure.axes[0].set_ylabel("share of planets found")
    figure.axes[0].legend()
    write_bytes(path, png(figure))


def text(rows: list[dict[str, Any]], known: Mapping[str, Any]) -> str:
    """Return the report."""
    planets = sum(row["found"].size for row in rows)
    parts = []
    for mode, name in MODES.items():
        apart = differences(rows, mode)
        alone = float(np.mean(apart[1])) * math.sqrt(2.0 / math.pi)
        head = ["planets", "number", "promised", "found", "difference", "its error"]
        half = 100.0 * law_error(rows, mode)
        parts.append(
            f"## Found {name}\n\nThe mean difference of a cell is {np.abs(apart[0]).mean():.3f} in size, of which "
            f"counting alone makes {alone:.3f}; the largest is {np.abs(apart[0]).max():.3f}. The significance at which "
            f"half are found has a relative standard error of {half:.1f} % by cell, counting taken out.\n\n"
            f"{table(head, groups(rows, mode))}\n"
        )
    head = ["band", "V (mag)", "visits", "drift (nm)", "other stars", "promised", "found", "difference", "its error"]
    alarms = ["level (sigma)", "resolution elements", "found", "expected", "95 % of Poisson", "within"]
    return f"""# The law of detection on images of random scenes

Regenerate with `python -m tools.detection_law`; everything below is written by it ({known["minutes"]:.0f} min of two
processes; {machine()}).

{len(rows)} cells are drawn at random: band, star (V 0 to 8), 1 to 64 visits of 1 to 4 h, drift of 0.01 to 0.5 nm, a
companion at 2 to 20 arcsec in three of ten, a star behind the hole in one of seven. Each has {known["stacks"]}
programmes of images, into which {planets} planets in all are put one at a time, at random places and with a brightness
about that at which half are found: planets of one cell share its programmes. The promise is the probability of the
calculator for that place
(`cpic_planner.etc.detection_law`); no number in it is fitted to these images.

![found against promised](map.png)

{"".join(parts)}
## Cells that are farthest off

{table(head, _worst(rows))}

## False alarms

Peaks above the level in the same programmes without planets, stars that are there left out.

{table(alarms, alarm_rows(rows))}
"""
