"""Report of the law of detection: false alarms, fitted numbers, and planets found against predicted."""

import math
from typing import Any

import numpy as np

from cpic_planner.etc import DetectionLaw, default_law
from cpic_planner.etc.detection import INWARD
from tools.detection_law.fit import LEAST, MODES, bins_of, chances, table_of
from tools.detection_law.measure import LEVELS, NULLS
from tools.detection_law.stacks import CASES, DRAWN, POOL, VISITS


def _table(head: list[str], rows: list[list[str]]) -> str:
    return "\n".join(f"| {' | '.join(line)} |" for line in [head, ["---"] * len(head), *rows])


def alarm_rows(found: dict[str, Any]) -> list[list[str]]:
    """Return the lines of the table of false alarms, of each number of visits and of all."""
    from scipy.stats import norm, poisson

    rows = []
    for many in (*((visits,) for visits in VISITS), VISITS):
        own = [one for one in found["alarms"] if one["visits"] in many]
        elements = sum(one["elements"] for one in own)
        for level in LEVELS:
            count, mean = sum(one[f"{level:g}"] for one in own), elements * float(norm.sf(level))
            low, high = poisson.interval(0.95, mean)
            inside = "yes" if low <= count <= high else "no"
            visits = " and ".join(", ".join(map(str, many)).rsplit(", ", 1))
            cells = [visits, f"{elements:.0f}", f"{level:g}", str(count), f"{mean:.1f}", f"{low:.0f} to {high:.0f}"]
            rows.append([*cells, inside])
    return rows


def _alarms_by_case(found: dict[str, Any]) -> list[list[str]]:
    from scipy.stats import norm

    rows = []
    for number, case in enumerate(CASES):
        own = [one for one in found["alarms"] if one["case"] == number]
        cells = [case.star, case.band, f"{case.v_mag:g}", f"{case.drift_nm:g}"]
        for visits in VISITS:
            parts = [one for one in own if one["visits"] == visits]
            mean = sum(one["elements"] for one in parts) * float(norm.sf(LEVELS[0]))
            cells.append(f"{sum(one[f'{LEVELS[0]:g}'] for one in parts)} of {mean:.1f}")
        rows += [cells] if own else []
    return rows


def clustering(found: dict[str, Any]) -> dict[int, float]:
    """Return variance over mean of a stack's false alarms at 3 sigma, by visits, each case about its own mean."""
    ratios = {}
    for visits in VISITS:
        own = [one for one in found["alarms"] if one["visits"] == visits]
        mean = sum(one[f"{LEVELS[0]:g}"] for one in own)
        variance = sum(
            (one["spread"] - one[f"{LEVELS[0]:g}"] ** 2 / one["stacks"]) * one["stacks"] / (one["stacks"] - 1)
            for one in own
        )
        ratios[visits] = variance / mean if mean else math.nan
    return ratios


def _cases(found: dict[str, Any], law: DetectionLaw, mode: str) -> list[list[str]]:
    every = table_of(found, ("fit", "test", "frames"))
    chance, rows = chances(law, every, mode), []
    for number, case in enumerate(CASES):
        cells = [case.part, case.star, case.band, f"{case.v_mag:g}", f"{case.drift_nm:g}", f"{case.time_s / 3600.0:g}"]
        for visits in VISITS:
            own = (every["case"] == number) & (every["visits"] == visits)
            hits, mean = float(every[mode][own].sum()), float(chance[own].sum())
            apart = (hits - mean) / math.sqrt(max(float((chance[own] * (1.0 - chance[own])).sum()), 1e-9))
            cells.append(f"{hits:.0f} of {mean:.1f} ({apart:+.1f})")
        rows.append(cells)
    return rows


def _found(found: dict[str, Any], law: DetectionLaw, mode: str) -> str:
    """Return the bins of all parts, and the planets of every case."""
    shown = [
        [part, str(line[0]), str(line[1]), f"{line[2]:.3f}", f"{line[3]:.3f}", f"{line[3] - line[2]:+.3f}"]
        for part in ("fit", "test", "frames")
        for line in bins_of(law, table_of(found, (part,)), mode)
    ]
    rows = _cases(found, law, mode)
    squares = [float(cell.split("(")[1][:-1]) ** 2 for line in rows for cell in line[6:]]
    return (
        _table(["part", "visits", "planets", "predicted", "found", "found - predicted"], shown)
        + "\n\nBy case: planets found, of expected, and standard deviations of their difference; the mean of its "
        f"square is {np.mean(squares):.2f}.\n\n"
        + _table(
            ["part", "star", "band", "V (mag)", "drift (nm)", "wall hours a visit", *(f"V = {n}" for n in VISITS)], rows
        )
    )


def _either(found: dict[str, Any]) -> list[list[str]]:
    """Return the planets that the search, photometry at the place, either of them and both find, by visits."""
    every = table_of(found, ("fit", "test", "frames"))
    rows = []
    for visits in VISITS:
        own = every["visits"] == visits
        searched, placed = (every[mode][own] > 0.5 for mode in MODES)
        counts = [searched, placed, searched | placed, searched & placed]
        rows.append([str(visits), str(int(own.sum())), *(f"{float(part.mean()):.3f}" for part in counts)])
    return rows


def text(found: dict[str, Any]) -> str:
    """Return the report."""
    law, clustered = default_law(), clustering(found)
    rows = [
        [f"`{name}`", f"{value:.3f}" + (f" ± {error:.3f}" if error else ""), f"{getattr(law, name):g}"]
        for name, (value, error) in found["law"].items()
    ]
    minutes, ten, least = found["minutes"], f"{INWARD:g}", LEAST
    alarms = _table(
        ["visits", "resolution elements", "level (sigma)", "found", "expected", "95 % of Poisson", "within"],
        alarm_rows(found),
    )
    by_case = _table(["star", "band", "V (mag)", "drift (nm)", *(f"V = {n}" for n in VISITS)], _alarms_by_case(found))
    ratios = ", ".join(f"{ratio:.2f} (V = {visits})" for visits, ratio in clustered.items())
    either = _table(["visits", "planets", "search", "photometry at the place", "either", "both"], _either(found))
    return f"""# The law of detection on stacks of visits

Regenerate with `python -m tools.detection_law`; everything below is written by it ({minutes["planets"]:.0f} min of a
processor for planets, {minutes["alarms"]:.0f} min for false alarms; {found["machine"]}).

Stacks of V science visits less the mean of V reference visits, every visit with a wavefront offset of its own and
nothing in common, searched blind with `visits` and `reference_visits` stated. Visits are the star behind the mask to
second order in the offset, from {POOL} offsets, with white noise of the camera; those of the part `frames` are sums of
frames of the image simulator ({DRAWN} of science and of reference), with a walk as large as the offset in an hour. The
part `test` has stars, bands and drifts that the fit knows nothing of. What the calculator expects of a planet of the
contrast that was put in is worked out anew whenever this report is written.

## False alarms

Peaks above the level in stacks without planets, all cases but `frames`; each {NULLS} stacks of a case and number of
visits are made of {POOL} visits of their own.

{alarms}

By case, at 3 sigma, found of expected:

{by_case}

Fewer alarms than expected are thresholds on the safe side: 10 % fewer at 3 sigma are a threshold that is higher by 0.03
sigma. They are fewest where light of the wavefront's errors is nearly all of the noise of few visits (large drift,
bright star): such a field is smoother where it is high than in the mean, and the number of its peaks is reckoned from
the mean. Alarms of one stack share one estimate of the noise and, where light of phase errors rules, repeat at the
mirror place; still the variance of their number in a stack over its mean, 1 for independent alarms, is
{ratios}.

## The law

A planet of margin x (predicted significance over threshold) is found with the probability `Phi(ln(x / m) / w)`. For a
blind search `ln m = t blind_tails V^-blind_visits + g(blind) / V + g(stack) (1 - 1/V)` with
`g = ln(margin) + inward (i - {ten})`, and `w^2 = blind_width^2 / V + stack_width^2 (1 - 1/V)`; t is the share of the
noise (as rms) that is light of the wavefront's errors, and i the resolution element over the separation. Photometry at
a known place has the middle `known_margin` for any V, and `w^2 = known_width^2 / V + known_stack_width^2 (1 - 1/V)`.
Fitted to the part `fit`; errors of a jackknife over its cases.

{_table(["number of the preset", "fitted", "preset"], rows)}

## Found by a blind search against predicted

By the numbers of the preset, in bins of the predicted probability with at least {least} planets where they suffice.

{_found(found, law, "found")}

## Found by photometry at a known place against predicted

Aperture photometry at the true place, whose noise is the scatter of apertures in the annulus of the same image, against
the threshold of small samples. It does not use how the visits scatter, which the search does.

{_found(found, law, "placed")}

## Which finds more

Whoever knows the place takes photometry there or the search, whichever has the larger probability. Fractions of all
planets that were put in:

{either}
"""
