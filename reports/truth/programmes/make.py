"""Programmes of visits: ``python -m tools.reports programmes`` makes this report anew.

The calculator against images: 42 and more cases that pair every two values of what makes a programme, each drawn 40
times, reduced as one and measured.
"""

from __future__ import annotations

import itertools
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from cpic_core import write_text
from cpic_planner import validation
from cpic_planner.confirm.etc_images import grey_scene
from cpic_planner.etc import EtcModel, build_model, planet_offsets
from cpic_planner.queries import Strategy
from cpic_planner.queries.shared import ReferenceStar
from cpic_planner.targets import find_target
from simulator.config import load_instrument
from simulator.knobs import FIDELITIES
from simulator.ledger import SUM_EPOCHS
from tools.report_parts import columns, table

HERE = Path(__file__).resolve().parent
REALISATIONS = 40
ASKED_MEAN, ASKED_CASE = 0.03, 0.05
# The last two are named in no other report.
STARS = ("bet Hyi", "del Pav", "61 Cyg A", "tau Cet", "gam Pav", "12 Oph")
LIBRARIES = ("same_star_planet_free", "brighter_twin", "reference_star", "roll", "interleaved", "archive")
PLACES = ("inner", "middle", "corner")
FACTORS: dict[str, tuple[Any, ...]] = {
    "visits": (1, 4, 16),
    "n_modes": (0, 4, 12),
    "library": LIBRARIES,
    "star": STARS,
    "band": ("F520", "F662", "F720", "F850"),
    "place": PLACES,
    "common_fraction": (0.0, 0.2),
    "snr": (8.0, 12.0, 20.0),
}
EDGE_ROLL_DEG = 16.0
VISIT_S, OTHER_V_MAG, TWIN_MAG = 1800.0, 2.5, 2.0
Case = dict[str, Any]


def reference_visits(case: Case) -> int | None:
    """More than there are modes; None for as many as science visits."""
    needed = {0: 0, 4: 8, 12: 16}[case["n_modes"]]
    if case["library"] == "archive":
        return max(needed, 20)
    return None if needed <= case["visits"] or case["library"] == "roll" else needed


def allowed(case: Case) -> bool:
    """Each roll is the other's reference: there are no more modes than other visits."""
    return case["library"] != "roll" or case["n_modes"] < case["visits"]


def covering_cases() -> list[Case]:
    """Cases in which every two values of two factors meet, but for those that exclude each other; greedy, no chance."""
    names = list(FACTORS)
    wanted = {((a, x), (b, y)) for a, b in itertools.combinations(names, 2) for x in FACTORS[a] for y in FACTORS[b]}
    rng, found = np.random.default_rng(23), []
    while wanted:
        tries = []
        for _ in range(400):
            case = {name: FACTORS[name][rng.integers(len(FACTORS[name]))] for name in names}
            (a, x), (b, y) = sorted(wanted, key=str)[rng.integers(len(wanted))]
            case |= {a: x, b: y}
            if allowed(case):
                tries.append((len(wanted & pairs_of(case)), case))
        if not tries or (best := max(tries, key=lambda one: one[0]))[0] == 0:
            break
        found.append(best[1])
        wanted -= pairs_of(best[1])
    return found


def pairs_of(case: Case) -> set[tuple[tuple[str, Any], tuple[str, Any]]]:
    """Pairs of values that a case holds."""
    return {((a, case[a]), (b, case[b])) for a, b in itertools.combinations(FACTORS, 2)}


def name_of(case: Case) -> str:
    """Every value in one line."""
    return " ".join(f"{case[name]}" for name in FACTORS)


def strategy_of(case: Case) -> Strategy:
    """How the case is observed and reduced."""
    library = "same_star_planet_free" if case["library"] == "interleaved" else case["library"]
    other = ReferenceStar(v_mag=OTHER_V_MAG, teff_k=8000.0) if library == "reference_star" else None
    scheme = "swapped" if case["library"] == "interleaved" else "interleaved"
    return Strategy(
        library=library,
        reference_star=other,
        visits=case["visits"],
        reference_visits=reference_visits(case),
        n_modes=case["n_modes"],
        reference_scheme=scheme,
        roll_deg=30.0 if case["place"] == "middle" else EDGE_ROLL_DEG,
    )


def separation_arcsec(model: EtcModel, case: Case) -> float:
    """Near the inner corner, in the middle, and where the outer corner begins."""
    metrics, zone = model.metrics[case["band"]], model.metrics[case["band"]].zone
    if case["library"] == "roll" and case["place"] != "middle":
        # Both places of the planet lie in the hole, half a roll to either side of its diagonal.
        away = np.radians(45.0 - 0.5 * EDGE_ROLL_DEG)
        near, far = (
            zone.inner_arcsec + metrics.aperture_radius_arcsec,
            zone.outer_arcsec - metrics.aperture_radius_arcsec,
        )
        return float(1.02 * near / np.sin(away) if case["place"] == "inner" else 0.98 * far / np.cos(away))
    inner, outer = metrics.hole_inner_corner_arcsec, metrics.owa_arcsec
    margin = metrics.aperture_radius_arcsec * np.sqrt(2.0)
    if case["place"] == "inner":
        return float(inner + margin + 0.5 * metrics.lambda_d_arcsec)
    return float(0.5 * (inner + outer) if case["place"] == "middle" else outer - margin - 0.5 * metrics.lambda_d_arcsec)


def task_of(case: Case, seed: int) -> tuple[validation.ConfirmTask, dict[str, Any], float]:
    """The images of a case, with a planet of the predicted SNR that it asks for.

    And what is predicted for the mean of its references, and the planet's separation.
    """
    band = case["band"]
    instrument = load_instrument({"drift": {"common_fraction": case["common_fraction"]}})
    model = build_model(instrument, [band], strategy_of(case))
    star, _ = find_target(case["star"])
    separation = separation_arcsec(model, case)
    place = planet_offsets(model, star, band, separation)
    own = float(star.v_mag[0])
    brightest = {"reference_star": min(OTHER_V_MAG, own), "brighter_twin": own - TWIN_MAG}.get(case["library"], own)
    exposure_s = float(np.clip(10.0 ** (1.0 + 0.4 * (brightest - 2.8)), 1.0, 30.0))
    frames = validation.Frames(exposure_s, round(VISIT_S / exposure_s), 300.0, case["visits"])
    contrast = 1e-8
    for _ in range(60):
        expected = validation.expected_of(model, star, band, place, contrast, frames)
        if abs(expected["snr"] / case["snr"] - 1.0) < 1e-4:
            break
        contrast *= case["snr"] / expected["snr"]
    scene = grey_scene(model, star, band, separation, contrast)
    plain = build_model(instrument, [band], model.strategy.model_copy(update={"n_modes": 0}))
    mean = validation.expected_of(plain, star, band, place, contrast, frames)
    task = validation.task_of(model, scene, band, frames, [expected], seed=seed, fidelity="standard")
    return task, mean, separation


def measured(case: Case, number: int) -> dict[str, Any]:
    """Predicted over recovered SNR of a case, with its error."""
    task, mean_alone, separation = task_of(case, 1000 + number)
    # Two wavelengths and four samples a pixel tell speckles to 1 %, at a third of the cost.
    how = replace(validation.modelling_of(task), draw="sums", knobs=FIDELITIES["quick"], epochs=SUM_EPOCHS)
    visits = validation.visit_pair(task, modelling=how)
    if visits.stackable.value is None:
        raise RuntimeError(f"{name_of(case)}: {visits.stackable.message}")
    planets = validation.planet_templates(visits)
    star = validation.StarFlux.known(visits.science.truth.sources[0].rate_e_s)
    plain = replace(visits, strategy=visits.strategy.model_copy(update={"n_modes": 0}))
    found: dict[str, list[validation.Measurement]] = {"modes": [], "mean": []}
    for number_drawn in range(REALISATIONS):
        drawn = visits.draw(number_drawn)
        region = drawn.reduced.region
        mean = replace(drawn, reduced=drawn.reduced.within(region, 0), roll=drawn.roll and drawn.roll.within(region, 0))
        for name, seen, realisation in (("modes", visits, drawn), ("mean", plain, mean)):
            (one,), _ = validation.measure_planets(seen, realisation, planets, star, searched=False)
            if one is None:
                raise RuntimeError(f"{name_of(case)}: the planet cannot be measured")
            found[name].append(one)
    expected = task.predictions[0]
    predicted = {"modes": expected, "mean": mean_alone}
    row = case | {
        "reference_visits": task.reference_visits,
        "separation_arcsec": separation,
        "exposure_s": task.exposure_s,
        "n_frames": task.n_frames,
        "contrast": expected["contrast"],
        "predicted_snr": expected["snr"],
        "predicted_snr_mean": mean_alone["snr"],
        "background_apertures": found["mean"][0].n_apertures,
    }
    for name, runs in found.items():
        row |= {f"{key}_{name}": value for key, value in compared(predicted[name], runs).items()}
    return row


def compared(expected: dict[str, Any], found: list[validation.Measurement]) -> dict[str, float]:
    """What one reduction of all realisations says, beside the prediction."""
    contrast, error, sigma = validation.contrasts_of(found)
    apertures = found[0].n_apertures
    snr, spread = validation.mean_snr(contrast, error, significance=expected["significance"], n_apertures=apertures)
    return {
        "snr": snr,
        "ratio": expected["snr"] / snr,
        "error": expected["snr"] * spread / snr**2,
        "significance_ratio": expected["significance"] / (contrast.mean() / float(np.sqrt((sigma**2).mean()))),
        "flux": float(contrast.mean() / expected["contrast"]),
        "flux_error": float(contrast.std(ddof=1) / np.sqrt(len(contrast)) / expected["contrast"]),
        "throughput": float(np.mean([one.throughput for one in found])),
    }


def summary(name: str, rows: list[Case], kind: str) -> list[str]:
    """Name, number of cases, mean ratio with its error, and how many are within what is asked."""
    ratio, error = (np.array([row[f"{key}_{kind}"] for row in rows]) for key in ("ratio", "error"))
    off, spread = np.abs(ratio - 1.0), ratio.std(ddof=min(len(rows) - 1, 1)) / np.sqrt(len(rows))
    within, widely = int((off <= np.maximum(ASKED_CASE, error)).sum()), int((off <= ASKED_CASE + 2.0 * error).sum())
    return [name, str(len(rows)), f"{ratio.mean():.3f} ± {spread:.3f}", str(within), str(widely)]


def summaries(rows: list[Case]) -> list[list[str]]:
    """All cases, and those of each value of some factors."""
    groups = [("mean of the references", rows, "mean")]
    for name in ("place", "library", "visits", "common_fraction", "band"):
        for value in FACTORS[name]:
            groups.append((f"mean, {name} {value}", [row for row in rows if row[name] == value], "mean"))
    for k in FACTORS["n_modes"][1:]:
        groups.append((f"with K = {k} modes", [row for row in rows if row["n_modes"] == k], "modes"))
    return [summary(*group) for group in groups if group[1]]


CELLS = {
    "star": "{star}",
    "band": "{band}",
    "arcsec": "{separation_arcsec:.2f}",
    "place": "{place}",
    "V": "{visits}",
    "R": "{reference_visits}",
    "library": "{library}",
    "f": "{common_fraction}",
    "SNR": "{predicted_snr:.0f}",
    "ratio, mean": "{ratio_mean:.3f} ± {error_mean:.3f}",
    "flux, mean": "{flux_mean:.3f}",
    "K": "{n_modes}",
    "ratio, K modes": "{ratio_modes:.3f} ± {error_modes:.3f}",
    "throughput": "{throughput_modes:.3f}",
}


def text_of(rows: list[Case]) -> str:
    """The report."""
    lines = [
        "# The calculator against images of programmes of visits",
        "",
        "`python -m tools.reports programmes` writes this report. Every case is a programme of visits of half an hour, "
        f"drawn {REALISATIONS} times with drift, orbital term and camera noise, reduced as one, and measured at the "
        "planet's place. Ratio: predicted over recovered SNR; above 1 the calculator is optimistic. R: reference "
        "visits; f: common fraction of the offset; K: modes of the annulus around the planet. Each case is reduced "
        "twice, with the mean of the references alone and with its K modes, each compared with its own prediction.",
        "",
        f"The cases pair every two values of {', '.join(FACTORS)}, but that two rolls have no more modes than visits. "
        "`interleaved` is the library of the same star whose order turns from visit to visit (scheme `swapped`); "
        "`reference_star` is of V 2.5 and 8000 K; rolls are 30 deg apart, in the corners 16.",
        "",
        f"Asked: {1.0 - ASKED_MEAN:.2f} to {1.0 + ASKED_MEAN:.2f} in the mean, each case within {ASKED_CASE:.0%} or "
        "its error.",
        "",
        table(
            ["cases", "number", "mean ratio", "within 5 % or the error", "within 5 % and two errors"], summaries(rows)
        ),
        "",
        columns(sorted(rows, key=lambda one: (one["place"], one["visits"], one["library"])), CELLS),
    ]
    return "\n".join(lines) + "\n"


def main() -> None:
    """Draw, measure, write."""
    rows = []
    for number, case in enumerate(covering_cases()):
        try:
            rows.append(measured(case, number))
        except RuntimeError as error:
            print(name_of(case), error, flush=True)
    write_text(HERE / "report.md", text_of(rows))


if __name__ == "__main__":
    main()
