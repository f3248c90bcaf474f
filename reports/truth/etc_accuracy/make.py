"""How far the exposure-time calculator can be trusted: ``python -m tools.reports etc_accuracy`` makes this report anew.

Its noise against Monte Carlo, its choice of frames against trying everything, and its contrast limit against the
imaging model.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from brute_force import least_time as try_everything
from counting import EXPOSURE_S, FRAMES, counted_cases, predicted_counting, recover_counts
from figures import limit_figure, monte_carlo_figure
from limits import LIMIT_BAND, VISITS, WALK_FRAMES, Curve, FloorRow, floor_rows, limit_curves
from monte_carlo import recover
from random_problems import random_problem
from real_stars import PLANETS, prepared
from regimes import GAINS, Case, apertures, cases, predicted
from threadpoolctl import threadpool_limits

from cpic_core import write_bytes, write_text
from cpic_planner.etc import EtcModel, FrameProblem, build_model, cases_of, least_time, planets_of
from cpic_planner.report import style
from cpic_planner.targets import rank_sample
from simulator.config import load_instrument
from tools.report_parts import columns, csv_text, png, verdict

HERE = Path(__file__).resolve().parent
TRIALS = 20_000
WHITE, SPECKLED, ERRORS = 0.03, 0.05, 4.5  # tolerances asked, and standard errors granted
COST_ASKED = 1.001
RANDOM_STARS, RANDOM_SEED = 700, 0
LEVELS = (1.0, 5.0, 8.0, 20.0)
SEPARATION_ARCSEC = 0.75

Row = dict[str, Any]


def monte_carlo_rows() -> list[Row]:
    """Every regime, gain and library: SNR and significance of the ETC over those of the trials."""
    found, places = [], apertures()
    for index, case in enumerate(cases()):
        trials = recover(case.stack, places, case.readout, np.random.default_rng([1, index]), TRIALS)
        found.append(
            _compared(
                case.regime,
                case.stack.em_gain,
                case.stack.reference_ratio,
                trials,
                predicted(case, places),
                white=case.white,
            )
        )
    return found


def counting_rows() -> list[Row]:
    """The same where photons are counted."""
    found, places = [], apertures()
    for index, (stack, readout, sigma) in enumerate(counted_cases()):
        trials = recover_counts(stack, places, readout, sigma, np.random.default_rng([3, index]), TRIALS)
        mean = stack.background_e_s * stack.exposure_s / places[0].pixels
        said = predicted_counting(stack, places, readout, sigma)
        name = f"counted above {sigma:g} sigma, {mean:.2g} e- per pixel and frame"
        analogue = predicted(Case("halo", stack, readout), places)
        row = _compared(name, stack.em_gain, 1.0, trials, said, white=True)
        found.append(row | {"over_analogue": float(said.significance[0] / analogue.significance[0])})
    return found


def star_rows(model: EtcModel) -> list[Row]:
    """The same for planets of real stars."""
    found = []
    for index, planet in enumerate(PLANETS):
        said = prepared(model, planet)
        trials = recover(said.stack, said.places, said.readout, np.random.default_rng([2, index]), TRIALS)
        name = f"{planet.star}, {planet.band}, {planet.separation_arcsec:g} arcsec, {planet.contrast:.0e}"
        found.append(_compared(name, planet.em_gain, 1.0, trials, said.noise, white=False))
    return found


def _compared(regime: str, gain: float, ratio: float, trials: Any, said: Any, *, white: bool) -> Row:
    terms = {name: float(np.ravel(part)[0]) for name, part in said.terms.items()}
    largest = max(terms, key=lambda name: terms[name])
    allowed = (WHITE if white else SPECKLED) + ERRORS * trials.relative_error
    off = [float(said.snr[0]) / trials.snr - 1.0, float(said.significance[0]) / trials.significance - 1.0]
    return {
        "case": regime,
        "em_gain": gain,
        "reference_ratio": ratio,
        "snr": float(said.snr[0]),
        "snr_etc_over_mc": 1.0 + off[0],
        "significance_etc_over_mc": 1.0 + off[1],
        "standard_error": trials.relative_error,
        "allowed": allowed,
        "bias_in_standard_errors": trials.bias,
        "largest_term": largest,
        "its_share": terms[largest] / sum(terms.values()),
        "met": max(map(abs, off)) <= allowed,
    }


def optimiser_rows(model: EtcModel) -> list[Row]:
    """Random problems and the catalogue, solved both ways."""
    rows = []
    for level in LEVELS:
        problem = random_problem(RANDOM_STARS, model.camera(LIMIT_BAND), seed=RANDOM_SEED)
        rows.append(_both(f"{RANDOM_STARS} random stars x 8 bands", f"SNR {level:g}", [(problem, level)]))
    every, planets = rank_sample(), planets_of(SEPARATION_ARCSEC)
    wide = build_model(model.instrument, tuple(model.instrument.bands))
    bands = [cases_of(wide, every, [band], planets) for band in wide.bands]
    name = f"catalogue ({len(every)}) x {len(wide.bands)} bands, 1 R_J at {SEPARATION_ARCSEC:g} arcsec"
    rows.append(_both(name, "SNR 5", [(part.problem("snr"), 5.0) for part in bands]))
    rows.append(_both(name, "SNR 1", [(part.problem("snr"), 1.0) for part in bands]))
    detection = [(part.problem("significance"), float(part.threshold[0, 0, 0])) for part in bands]
    rows.append(_both(name, "detection", detection))
    bright = planets_of(SEPARATION_ARCSEC, None, 1e-7)
    near = [cases_of(wide, every, [band], bright).problem("snr") for band in wide.bands]
    for level in (5.0, 20.0):
        rows.append(_both("the same stars and bands, contrast 1e-7", f"SNR {level:g}", [(one, level) for one in near]))
    return rows


def _both(name: str, question: str, parts: list[tuple[FrameProblem, float]]) -> Row:
    """Solver and brute force on the same problems."""
    began = time.perf_counter()
    solved = [least_time(problem, level) for problem, level in parts]
    middle = time.perf_counter()
    tried = [try_everything(problem, level) for problem, level in parts]
    ended = time.perf_counter()
    ours, theirs = (np.concatenate([np.ravel(part.visit_s) for part in found]) for found in (solved, tried))
    mine, other = (np.concatenate([np.ravel(part.n_frames) for part in found]) > 0 for found in (solved, tried))
    both = mine & other
    ratio = ours[both] / theirs[both]
    return {
        "problems": name,
        "asked for": question,
        "cases": ours.size,
        "possible": int(both.sum()),
        "possible for one only": int((mine != other).sum()),
        "least": ratio.min(initial=np.inf),
        "median": float(np.median(ratio)) if ratio.size else np.nan,
        "largest": ratio.max(initial=0.0),
        "above": int((ratio > COST_ASKED).sum()),
        "solver_s": middle - began,
        "brute_force_s": ended - middle,
    }


def span(rows: list[Row], name: str) -> str:
    """Least and largest of a column."""
    values = [row[name] for row in rows]
    return f"{min(values):.4f} to {max(values):.4f}"


def regime_table(rows: list[Row]) -> str:
    """Worst of all gains and libraries of each regime."""
    groups = [[row for row in rows if row["case"] == case] for case in dict.fromkeys(row["case"] for row in rows)]
    return columns(
        groups,
        {
            "regime": "{0[0][case]}",
            "cases": len,
            "SNR, ETC / trials": lambda own: span(own, "snr_etc_over_mc"),
            "significance, ETC / trials": lambda own: span(own, "significance_etc_over_mc"),
            "largest bias (standard errors)": lambda own: f"{max(abs(r['bias_in_standard_errors']) for r in own):.1f}",
            "largest term": lambda own: ", ".join(sorted({row["largest_term"] for row in own})),
            "met": lambda own: "yes" if all(row["met"] for row in own) else "**no**",
        },
    )


RATIOS = {"SNR, ETC / trials": "{snr_etc_over_mc:.4f}", "significance, ETC / trials": "{significance_etc_over_mc:.4f}"}
STARS = {"planet": "{case}", "gain": "{em_gain:g}", "SNR": "{snr:.2f}", **RATIOS}
STARS |= {"largest term": "{largest_term}", "its share": "{its_share:.0%}"}
COUNTED = {"pixels": "{case}", "gain": "{em_gain:g}", **RATIOS}
COUNTED |= {"significance over that of measured charge": "{over_analogue:.2f}"}
OPTIMISED = {
    **{name: f"{{{name}}}" for name in ("problems", "asked for", "cases", "possible", "possible for one only")},
    "least": "{least:.5f}",
    "median": "{median:.5f}",
    "largest": "{largest:.6f}",
    f"above {COST_ASKED:g}": "{above}",
    "solver (s)": "{solver_s:.3f}",
    "brute force (s)": "{brute_force_s:.1f}",
}
FLOORS = {
    "band": "{0.band}",
    "separation (arcsec)": "{0.separation_arcsec:g}",
    "visit offset (nm)": "{0.visit_nm:g}",
    "walk (nm)": "{0.walk}",
    "ETC, per unit star": "{0.said:.3e}",
    "images": "{0.measured.rms:.3e}",
    "ETC / images": "{0.ratio:.3f} ± {0.ratio_error:.3f}",
}


def slope_table(curves: list[Curve]) -> str:
    """Logarithmic slopes and plateaus."""

    def ends(form: str, without: str = "") -> Callable[[Curve], str]:
        """Write what only a curve with a plateau has."""
        return lambda curve: without if curve.model_limit is None else form.format(curve)

    return columns(
        curves,
        {
            "visit offset (nm)": "{0.visit_nm:g}",
            "slope, 1 to 10 frames": "{0.first_slope:.3f}",
            "slope, last decade": "{0.last_slope:.4f}",
            "plateau of the ETC": ends("{0.plateau:.3e}", "none"),
            "of the images": ends("{0.model_limit:.3e} ± {0.model_error:.1e}"),
            "ETC / images": lambda curve: (
                "" if curve.model_limit is None else f"{curve.plateau / curve.model_limit:.3f}"
            ),
        },
    )


def verdict_table(trials: list[Row], frames: list[Row], curves: list[Curve], floors: list[FloorRow]) -> str:
    """What was asked, and what was found."""
    worst = max(abs(row[name] - 1.0) for row in trials for name in ("snr_etc_over_mc", "significance_etc_over_mc"))
    longest, single = max(row["largest"] for row in frames), sum(row["possible for one only"] for row in frames)
    plateaus = [curve.plateau / curve.model_limit - 1.0 for curve in curves if curve.model_limit is not None]
    apart = max(plateaus, key=abs)
    off = max(floors, key=lambda row: abs(row.ratio - 1.0))
    steepest = max(abs(curve.first_slope + 0.5) for curve in curves if not curve.visit_nm)
    return verdict(
        [
            (
                f"noise against Monte Carlo, {len(trials)} cases",
                f"{WHITE:.0%} ({SPECKLED:.0%} with speckles) + 4.5 errors",
                f"{worst:.1%} at most, errors of the trials included",
                all(row["met"] for row in trials),
            ),
            (
                f"least time against brute force, {sum(row['cases'] for row in frames)} cases",
                f"at most {COST_ASKED:g} times",
                f"{longest:.6f} times at most",
                longest <= COST_ASKED,
            ),
            ("cases in which only one of the two finds a solution", "none", str(single), not single),
            ("slope of the contrast limit without any offset", "-1/2", f"-1/2 to {steepest:.0e}", steepest < 1e-6),
            ("plateaus of the contrast limit against images", "10 %", f"{apart:+.1%} at most", abs(apart) < 0.1),
            (
                "residual in other bands and places, and with walk",
                "",
                f"{off.ratio - 1.0:+.1%} at most ({off.band}, {off.separation_arcsec:g} arcsec)",
                None,
            ),
        ]
    )


def report(
    trials: list[Row],
    counted: list[Row],
    stars: list[Row],
    frames: list[Row],
    curves: list[Curve],
    floors: list[FloorRow],
) -> str:
    """Text of the report."""
    return f"""# Accuracy of the exposure-time calculator

Regenerate with `python -m tools.reports etc_accuracy`; everything below is written by it.

{verdict_table(trials, frames, curves, floors)}

## Noise against Monte Carlo

{TRIALS} trials a case: charge is Poisson in every pixel, the register is the exact cascade, read noise is added and the
converter rounds at its output, pixels that the edge of the aperture cuts count in part, the mean reference frame is
subtracted, and then the mean of 30 other apertures. Frames that a particle hits are left out. Levels are set such that
the named noise is most of the variance at each gain ({", ".join(f"{gain:g}" for gain in GAINS)}); three of the regimes
also have reference libraries of half and three times the science frames. SNR is the signal over its own scatter,
significance the signal over the scatter without the planet; each carries {trials[0]["standard_error"]:.1%} of error.

{regime_table(trials)}

![SNR of the ETC over that of the trials](monte_carlo.png)

*Bars: one standard error; grey: 3 %. Every case is in [monte_carlo.csv](monte_carlo.csv).*

Planets of real stars, 30 frames, with the rates of the ETC and the planet's light on the pixels of the images:

{columns(stars, STARS)}

Photons counted instead of measured: {FRAMES} frames of {EXPOSURE_S:g} s, a planet of a third of the background. How
often a pixel passes the threshold is drawn from the register, and the counts of each pixel are inverted by that curve.
The last column is what counting wins; below 1 it loses, where pixels hold more than one photon.

{columns(counted, COUNTED)}

## Frames against trying everything

Brute force takes 2000 exposures, every whole number of frames and 1500 gains for each of them, under the same limits of
saturation written out once more. Time of the solver over that of brute force; below 1 the solver stands between two
exposures of the grid. The planets of the catalogue are tried in every band, whether or not the place is dark there.

{columns(frames, OPTIMISED)}

## Contrast limit against the number of frames

{curves[0].star}, {LIMIT_BAND}, {curves[0].separation_arcsec:g} arcsec, frames of {curves[0].exposure_s:g} s, 5 sigma
without small-sample threshold, no walk of the wavefront within a visit. Only without any offset between the visits does
the limit fall with the square root of the number of frames; otherwise it ends on a plateau, which no time lowers.

![contrast limit against the number of frames](contrast_limit.png)

{slope_table(curves)}

The plateau comes from the scatter of aperture sums in the annulus that the background is taken from. Here it is
measured once more in images without noise, propagated in full: {VISITS} independent visits, circles wholly inside the
dark squares and the annulus, less the mean of the annulus around each. Common parts of the wavefront and the orbit are
left out of both. With walk, the image of a visit is the mean of {WALK_FRAMES} moments. Far out, where squares cut the
annulus to their corners, its mean goes up and down with the circle and takes off more than the mean of the whole hole,
which the ETC reckons with.

{columns(floors, FLOORS)}
"""


def main() -> None:
    """Measure, compare, draw."""
    model = build_model(load_instrument())
    with threadpool_limits(1):
        trials, counted, stars = monte_carlo_rows(), counting_rows(), star_rows(model)
        frames = optimiser_rows(model)
        curves, floors = limit_curves(), floor_rows()
    write_text(HERE / "monte_carlo.csv", csv_text(trials + stars))
    with style():
        write_bytes(HERE / "monte_carlo.png", png(monte_carlo_figure(trials, WHITE)))
        write_bytes(HERE / "contrast_limit.png", png(limit_figure(curves)))
    write_text(HERE / "report.md", report(trials, counted, stars, frames, curves, floors))


if __name__ == "__main__":
    main()
