"""Measure the law of detection on stacks of visits: ``python -m tools.detection_law`` (half an hour on one core).

Stacks of V science and V reference visits are searched blind, without planets for false alarms and with four planets
each for the probability of a detection. A visit is the star behind the mask to second order in its own wavefront
offset, drawn from a pool, plus white noise of the camera; science and reference have nothing in common.

Writes ``reports/detection_law/law.json`` and ``report.md``; the fitted numbers go by hand to the preset strategy
``default``. ``--write`` writes the report of what ``law.json`` holds.
"""

import argparse
import dataclasses
import json
import math
import platform
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cpic_core import ArrayLike, FloatArray, IntArray, stream, write_text
from cpic_planner.etc import EtcModel, Programme, aperture_rates, build_model, stack_noise, threshold_array
from cpic_planner.etc.detection import (
    INWARD,
    DetectionLaw,
    default_law,
    detection_probability,
    half_margin,
    tail_share,
)
from cpic_planner.queries import ReferencePlanet, Strategy
from cpic_planner.targets import Targets, find_target
from cpic_planner.validation import ConfirmTask, Frames, RdiResult, ReducedStack, prepare_task, visit_pair
from cpic_planner.validation.detection import BlindSearch, search
from cpic_planner.validation.injection import recovered
from cpic_planner.validation.search import search_threshold
from cpic_planner.validation.speckle_maps import SpeckleMaps, speckle_maps
from simulator.config import load_instrument
from simulator.detectors import excess_noise_factor2
from simulator.imaging import Psf, centred_axis, visit_responses
from simulator.observing import hole_stacks

HERE = Path(__file__).resolve().parents[1] / "reports" / "detection_law"
VISITS = (1, 4, 16)
LEVELS = (3.0, 3.5, 4.0, 5.0)
POOL, DRAWN, PLACES = 800, 48, 160  # visits of a band that are combined, drawn by frames, and places of planets
MARGINS = (0.35, 3.5)
NULLS = {1: 30, 4: 100, 16: 100}  # stacks of each case without planets
INJECTED = {1: (150, 1), 4: (150, 1), 16: (40, 4)}  # stacks with planets, and planets in each
_SEED, _RAREST = 4, 1e-12


@dataclass(frozen=True)
class Case:
    """Star (its light scaled to ``v_mag``), band, rms of the offset of a visit, wall time of one visit.

    ``part`` is ``fit``, ``test`` (stars, bands, drifts and lengths that the fit knows nothing of), or ``frames``:
    visits are sums of frames of the image simulator, with a walk within each, instead of those of the pool.
    """

    part: str
    star: str
    band: str
    v_mag: float
    drift_nm: float
    time_s: float


CASES = (
    Case("fit", "tau Cet", "F520", 3.5, 0.05, 7200.0),
    Case("fit", "tau Cet", "F520", 0.0, 0.05, 7200.0),
    Case("fit", "tau Cet", "F520", 5.0, 0.03, 7200.0),
    Case("fit", "tau Cet", "F520", 3.0, 0.3, 7200.0),
    Case("frames", "tau Cet", "F520", 3.5, 0.05, 7200.0),
    Case("fit", "eps Eri", "F662", 3.7, 0.05, 7200.0),
    Case("fit", "eps Eri", "F662", 1.0, 0.1, 7200.0),
    Case("fit", "eps Eri", "F662", 5.0, 0.1, 7200.0),
    Case("fit", "alf CMi", "F850", 0.4, 0.05, 7200.0),
    Case("fit", "alf CMi", "F850", 3.0, 0.3, 7200.0),
    Case("test", "bet Hyi", "F520", 3.5, 0.1, 7200.0),
    Case("test", "bet Hyi", "F520", 1.0, 0.03, 3600.0),
    Case("test", "alf Cen B", "F720", 1.3, 0.05, 5400.0),
    Case("test", "alf Cen B", "F720", 4.0, 0.1, 10800.0),
    Case("test", "61 Cyg A", "F850", 2.5, 0.07, 5400.0),
    Case("test", "61 Cyg A", "F850", 5.2, 0.2, 7200.0),
)


@dataclass(frozen=True, eq=False)
class Field:
    """Optics of a star in a band: responses to offsets of 1 nm at the pixels of the hole, and images of planets."""

    psf: Psf
    maps: SpeckleMaps
    linear: FloatArray
    square: FloatArray
    place_arcsec: FloatArray
    planet: FloatArray

    @classmethod
    def of(cls, psf: Psf, maps: SpeckleMaps, slope: float) -> "Field":
        """Draw the pool; other screens than those of the maps."""
        hole, imager = psf.geometry.hole, psf.imager
        rows, columns = np.flatnonzero(hole.any(axis=1)), np.flatnonzero(hole.any(axis=0))
        offset = centred_axis(len(hole), imager.pixel_scale_arcsec)
        axes = [imager.axis(offset[part], masked=True) for part in (rows, columns)]
        inside = hole[np.ix_(rows, columns)]
        _, linear, square = visit_responses(imager, axes[0], axes[1], slope, POOL, _SEED)
        rng, metrics = stream(_SEED, "places"), psf.metrics
        low = metrics.zone.inner_arcsec + metrics.aperture_radius_arcsec
        high = metrics.zone.outer_arcsec - metrics.aperture_radius_arcsec
        signs = np.array([(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)])[np.arange(PLACES) % 4]
        place = signs * rng.uniform(low, high, (PLACES, 2))
        planet = np.stack([np.asarray(psf.at(*one))[hole] for one in place])
        return cls(psf, maps, linear[:, inside].astype("f4"), square[:, inside].astype("f4"), place, planet)

    def places(self, rng: np.random.Generator) -> IntArray:
        """Places of four planets, one a quadrant, no two near each other's mirror image."""
        reach = 2.0 * self.psf.geometry.lambda_d_arcsec
        while True:
            chosen = 4 * rng.integers(PLACES // 4, size=4) + np.arange(4)
            at = self.place_arcsec[chosen]
            if all(np.hypot(*(at[k] + at[k + 2])) > reach for k in (0, 1)):
                return chosen


@dataclass(frozen=True, eq=False)
class Scene:
    """A case with its optics, frames and white noise of one visit."""

    case: Case
    field: Field
    model: EtcModel
    target: Targets
    frames: Frames
    rate_e_s: float
    white_e2: FloatArray
    stages: int
    drawn: tuple[FloatArray, FloatArray] | None

    def visits_of(self, visits: int, rng: np.random.Generator) -> FloatArray:
        """Science visits less the mean of as many reference visits, electrons, shape (visits, pixels of the hole)."""
        if self.drawn is not None:
            science, reference = (part[rng.choice(len(part), visits, replace=False)] for part in self.drawn)
            return np.asarray(science - reference.mean(axis=0))
        chosen = rng.choice(len(self.field.linear), 2 * visits, replace=False)
        light_e = self.rate_e_s * self.frames.exposure_s * self.frames.n_frames * self.case.drift_nm
        light = light_e * (self.field.linear[chosen] + self.case.drift_nm * self.field.square[chosen])
        light = light + np.sqrt(0.5 * self.white_e2) * rng.standard_normal(light.shape)
        return np.asarray(light[:visits] - light[visits:].mean(axis=0))

    def stack(self, visits: int, rng: np.random.Generator, planets: Any = None) -> ReducedStack:
        """V science visits less the mean of as many reference visits, with planets of so many electrons a visit."""
        hole, left = self.field.psf.geometry.hole, self.visits_of(visits, rng)
        if planets is not None:
            mean = visits * planets
            drawn = rng.poisson(np.maximum(mean, 0.0)).astype(float)
            spread = float(excess_noise_factor2(self.frames.em_gain, self.stages)) - 1.0
            left += (drawn + np.sqrt(spread * drawn) * rng.standard_normal(drawn.shape)) / visits
        images = np.zeros((visits, *hole.shape))
        images[:, hole] = left
        variance = np.zeros(hole.shape)
        variance[hole] = visits * self.white_e2
        none = np.zeros((0, int(hole.sum())))
        rdi = RdiResult(images, 0, 0, False, "temporal", hole, none, np.zeros(0))
        gain, total_s = self.frames.em_gain, visits * self.frames.exposure_s * self.frames.n_frames
        return ReducedStack(images.sum(axis=0), hole, variance, variance, rdi, total_s, gain, self.stages)

    def searched(self, stack: ReducedStack, visits: int, sigma: float) -> BlindSearch:
        """Blind search of a stack."""
        return search(
            stack,
            self.field.psf,
            self.field.maps,
            star_rate_e_s=self.rate_e_s,
            sigma=sigma,
            visits=visits,
            reference_visits=visits,
        )

    def expected(self, visits: int, x: FloatArray, y: FloatArray) -> dict[str, FloatArray]:
        """Margin of a planet of contrast 1, share of tails, and element over separation, at places."""
        band, separation = self.case.band, np.hypot(x, y)
        camera, metrics = self.model.camera(band), self.model.metrics[band]
        rates = aperture_rates(self.model, self.target, band, x[None], y[None], np.full((1, x.size), 1e-9))
        made = Programme(np.array(float(visits)), np.array(float(visits)))
        noise = stack_noise(rates, *_setting(self.frames), camera, self.model.strategy, made)
        threshold = threshold_array(metrics.resolution_elements(separation), self.model.strategy.sigma)
        visit_s = self.frames.n_frames * (self.frames.exposure_s + camera.readout_s)
        tails = tail_share(self.model, band, separation[None], np.array(visit_s), noise)[0]
        return {
            "margin": noise.significance[0] / threshold / 1e-9,
            "tails": tails,
            "inward": metrics.lambda_d_arcsec / separation,
        }


def _setting(frames: Frames) -> tuple[float, float, float]:
    return frames.exposure_s, float(frames.n_frames), frames.em_gain


def scenes() -> Iterator[Scene]:
    """All cases; those of one star and band share their optics."""
    instrument, field, key = load_instrument(), None, None
    for case in CASES:
        walk_nm = case.drift_nm if case.part == "frames" else 0.0
        drift = {"visit_nm": case.drift_nm, "walk_nm_per_sqrt_hour": walk_nm, "common_fraction": 0.0, "orbital_nm": 0.0}
        # Frames and white noise of one visit, of which stacks are made.
        one = instrument.changed({"drift": drift, "overhead_s": 0.0})
        model = build_model(one, [case.band], Strategy(visits=1))
        target = dataclasses.replace(find_target(case.star)[0], v_mag=np.array([case.v_mag]))
        task = prepare_task(
            model, target, case.band, time_s=case.time_s, planet=ReferencePlanet(), seed=1, fidelity="standard",
            realisations=1, audit=False, overrides=None,
        )  # fmt: skip
        if not isinstance(task, ConfirmTask):
            raise RuntimeError(f"{case}: {task.message}")
        pair = visit_pair(dataclasses.replace(task, scene=task.scene | {"planets": []}, predictions=[], planets=[]))
        if field is None or key != (case.star, case.band):
            maps = speckle_maps(pair.optics, model.instrument.drift)
            field, key = Field.of(pair.optics, maps, model.instrument.drift.psd_slope), (case.star, case.band)
        field = dataclasses.replace(field, psf=pair.optics, maps=speckle_maps(pair.optics, model.instrument.drift))
        reduced, hole, drawn = pair.draw(0).reduced, pair.geometry.hole, None
        if case.part == "frames":
            roles = (hole_stacks(seen, epochs=2) for seen in (pair.science, pair.reference))
            sums = [np.stack([role.draw(k).sum(axis=0)[hole] for k in range(DRAWN)]) for role in roles]
            drawn = sums[0], sums[1]
        yield Scene(
            case=case,
            field=field,
            model=model,
            target=target,
            frames=Frames(task.exposure_s, task.n_frames, task.em_gain),
            rate_e_s=pair.science.truth.sources[0].rate_e_s,
            white_e2=reduced.white_variance_e2[hole],
            stages=reduced.stages,
            drawn=drawn,
        )


def nulls(scene: Scene, visits: int, count: int, rng: np.random.Generator) -> dict[str, Any]:
    """False alarms of stacks without planets."""
    found: dict[str, Any] = {"elements": 0.0, "dof": [], "drift_nm": []} | {f"{level:g}": 0 for level in LEVELS}
    for _ in range(count):
        answer = scene.searched(scene.stack(visits, rng), visits, LEVELS[0])
        found["elements"] += answer.region.n_elements
        found["dof"].append(answer.dof)
        found["drift_nm"].append(answer.drift_nm)
        for level in LEVELS:
            asked = search_threshold(answer.region, answer.roughness, sigma=level).unwrap()
            found[f"{level:g}"] += sum(one.significance >= asked for one in answer.candidates)
    return found | {"dof": float(np.median(found["dof"])), "drift_nm": float(np.median(found["drift_nm"]))}


def injections(scene: Scene, visits: int, rng: np.random.Generator) -> list[dict[str, float]]:
    """Planets put into stacks, and whether a blind search finds them.

    One stack holds several only where its visits tell the noise without them: others raise the noise of a single visit.
    """
    count, planets = INJECTED[visits]
    field, rows = scene.field, []
    known = scene.expected(visits, *field.place_arcsec.T)
    integration_s = scene.frames.exposure_s * scene.frames.n_frames
    reach = field.psf.geometry.lambda_d_arcsec
    for _ in range(count):
        chosen = rng.permutation(field.places(rng))[:planets]
        margin = np.exp(rng.uniform(math.log(MARGINS[0]), math.log(MARGINS[1]), planets))
        flux_e = margin / known["margin"][chosen] * scene.rate_e_s * integration_s
        answer = scene.searched(scene.stack(visits, rng, flux_e @ field.planet[chosen]), visits, 5.0)
        for k, place in enumerate(chosen):
            x, y = (float(part) for part in field.place_arcsec[place])
            best = recovered(answer, x, y, reach)
            rows.append(
                {
                    "margin": float(margin[k]),
                    **{name: float(known[name][place]) for name in ("tails", "inward")},
                    "found": float(best is not None and best.detected),
                }
            )
    return rows


def measured() -> dict[str, Any]:
    """All stacks, and how long they took."""
    start, stacks = time.monotonic(), []
    for number, scene in enumerate(scenes()):
        for visits in VISITS:
            rng = stream(_SEED, "alarms", number, visits)
            alarms = nulls(scene, visits, NULLS[visits], rng) if scene.drawn is None else None
            rows = injections(scene, visits, stream(_SEED, "planets", number, visits))
            columns = {name: [float(f"{row[name]:.3g}") for row in rows] for name in rows[0]}
            stacks.append({"case": number, "visits": visits, "nulls": alarms} | columns)
        print(f"{scene.case}: {time.monotonic() - start:.0f} s", flush=True)
    minutes = (time.monotonic() - start) / 60.0
    return {"stacks": stacks, "minutes": round(minutes), "machine": f"{platform.machine()}, one core"}


COLUMNS = ("case", "visits", "margin", "tails", "inward", "found")


def table_of(found: dict[str, Any], parts: tuple[str, ...]) -> dict[str, FloatArray]:
    """Columns of all planets of some parts of the cases."""
    chosen = [one for one in found["stacks"] if CASES[one["case"]].part in parts]
    size = [len(one["found"]) for one in chosen]
    return {
        name: np.concatenate([np.broadcast_to(one[name], n) for one, n in zip(chosen, size, strict=True)]).astype(float)
        for name in COLUMNS
    }


_NUMBERS = "blind_margin blind_tails blind_inward blind_visits blind_width stack_margin stack_inward stack_width"
FITTED = tuple(_NUMBERS.split())
_START = (-0.3, 1.0, 3.0, 0.25, -1.1, -0.4, 0.0, -1.4)  # logarithms of margins and widths


def law_of_numbers(numbers: FloatArray) -> DetectionLaw:
    """Return the law of fitted numbers, where margins and widths are logarithms."""
    pairs = zip(FITTED, map(float, numbers), strict=True)
    own: dict[str, Any] = {name: math.exp(x) if name.endswith(("margin", "width")) else x for name, x in pairs}
    return DetectionLaw.model_construct(**own)


def most_likely(rows: dict[str, FloatArray], start: ArrayLike = _START) -> FloatArray:
    """Numbers of `law_of_numbers` of maximum likelihood."""
    from scipy.optimize import minimize

    hits = rows["found"] > 0.5

    def loss(numbers: FloatArray) -> float:
        chance = np.clip(chances(law_of_numbers(numbers), rows), _RAREST, 1.0 - _RAREST)
        return -float(np.log(np.where(hits, chance, 1.0 - chance)).sum())

    return np.asarray(minimize(loss, np.asarray(start, float), method="BFGS", options={"gtol": 0.05}).x)


def fitted(rows: dict[str, FloatArray]) -> dict[str, list[float]]:
    """Fitted numbers of the law, with errors of a jackknife over cases: their planets share star, band and drift."""
    best, cases = most_likely(rows), np.unique(rows["case"])
    parts = [{name: part[rows["case"] != case] for name, part in rows.items()} for case in cases]
    others, groups = np.array([most_likely(part, best) for part in parts]), len(parts)
    spread = np.sqrt((groups - 1) / groups * ((others - others.mean(axis=0)) ** 2).sum(axis=0))
    own = rows["tails"], rows["inward"], rows["visits"]
    # The middle of the sample is known best.
    middles = [float(np.log(half_margin(law_of_numbers(one), False, *own)).mean()) for one in others]
    error = math.sqrt((groups - 1) / groups * float(np.sum((np.array(middles) - np.mean(middles)) ** 2)))
    law = law_of_numbers(best)
    found = {}
    for name, deviation in zip(FITTED, spread, strict=True):
        value = float(getattr(law, name))
        found[name] = [value, float(deviation) * (value if name.endswith(("margin", "width")) else 1.0)]
    return found | {"blind_margin_error": [error, 0.0]}


def chances(law: DetectionLaw, rows: dict[str, FloatArray]) -> FloatArray:
    """Probabilities that a law gives to the planets."""
    expected = rows["margin"], False, rows["tails"], rows["inward"]
    return detection_probability(law, *expected, visits=rows["visits"])


LEAST = 400  # planets in a bin


def bins_of(law: DetectionLaw, rows: dict[str, FloatArray]) -> list[list[float]]:
    """Visits, planets, and their predicted and found fraction in bins of the predicted probability."""
    made = []
    for visits in VISITS:
        own = rows["visits"] == visits
        chance, hits = chances(law, rows)[own], rows["found"][own]
        for part in np.array_split(np.argsort(chance), max(int(own.sum()) // LEAST, 1)):
            made.append([visits, part.size, float(chance[part].mean()), float(hits[part].mean())])
    return made


def _table(head: list[str], rows: list[list[str]]) -> str:
    return "\n".join(f"| {' | '.join(line)} |" for line in [head, ["---"] * len(head), *rows])


def _alarms(found: dict[str, Any]) -> list[list[str]]:
    from scipy.stats import norm, poisson

    rows = []
    for many in ((1,), (4,), (16,), (4, 16)):
        own = [one["nulls"] for one in found["stacks"] if one["nulls"] and one["visits"] in many]
        elements = sum(one["elements"] for one in own)
        for level in LEVELS:
            count, mean = sum(one[f"{level:g}"] for one in own), elements * float(norm.sf(level))
            low, high = poisson.interval(0.95, mean)
            inside = "yes" if low <= count <= high else "no"
            visits = " and ".join(map(str, many))
            cells = [visits, f"{elements:.0f}", f"{level:g}", str(count), f"{mean:.1f}", f"{low:.0f} to {high:.0f}"]
            rows.append([*cells, inside])
    return rows


def _cases(found: dict[str, Any], law: DetectionLaw) -> list[list[str]]:
    every = table_of(found, ("fit", "test", "frames"))
    chance, rows = chances(law, every), []
    for number, case in enumerate(CASES):
        cells = [case.part, case.star, case.band, f"{case.v_mag:g}", f"{case.drift_nm:g}", f"{case.time_s / 3600.0:g}"]
        for visits in VISITS:
            own = (every["case"] == number) & (every["visits"] == visits)
            hits, mean = float(every["found"][own].sum()), float(chance[own].sum())
            apart = (hits - mean) / math.sqrt(float((chance[own] * (1.0 - chance[own])).sum()))
            cells.append(f"{hits:.0f} of {mean:.1f} ({apart:+.1f})")
        rows.append(cells)
    return rows


def text(found: dict[str, Any]) -> str:
    """The report."""
    law = default_law()
    rows = [
        [f"`{name}`", f"{value:.3f}" + (f" ± {error:.3f}" if error else ""), f"{getattr(law, name):g}"]
        for name, (value, error) in found["law"].items()
    ]
    parts = {part: bins_of(law, table_of(found, (part,))) for part in ("fit", "test", "frames")}
    shown = [
        [part, str(line[0]), str(line[1]), f"{line[2]:.3f}", f"{line[3]:.3f}", f"{line[3] - line[2]:+.3f}"]
        for part, lines in parts.items()
        for line in lines
    ]
    squares = [float(cell.split("(")[1][:-1]) ** 2 for line in _cases(found, law) for cell in line[6:]]
    return (
        "# The law of detection on stacks of visits\n\n"
        "Regenerate with `python -m tools.detection_law`; everything below is written by it "
        f"({found['minutes']} min; {found['machine']}).\n\n"
        "Stacks of V science visits less the mean of V reference visits, every visit with a wavefront offset of its "
        "own and nothing in common, searched blind with `visits` and `reference_visits` stated. Visits are the star "
        f"behind the mask to second order in the offset, from {POOL} offsets a star and band, with white noise of the "
        f"camera; those of the part `frames` are sums of frames of the image simulator ({DRAWN} of science and of "
        "reference), with a walk as large as the offset in an hour. The part `test` has stars, bands and drifts that "
        "the fit knows nothing of.\n\n"
        "## False alarms\n\nPeaks above the level in stacks without planets, all cases but `frames`.\n\n"
        + _table(
            ["visits", "resolution elements", "level (sigma)", "found", "expected", "95 % of Poisson", "within"],
            _alarms(found),
        )
        + "\n\n## The law\n\nA blind search finds a planet of margin x (predicted significance over threshold) with "
        "the probability `Phi(ln(x / m) / w)`, `ln m = t blind_tails V^-blind_visits + g(blind) / V + g(stack) "
        f"(1 - 1/V)`, `g = ln(margin) + inward (i - {INWARD:g})`, `w^2 = blind_width^2 / V + stack_width^2 (1 - 1/V)`, "
        "with t the share of the noise (as rms) that is light of the wavefront's errors, and i the resolution element "
        "over the separation. Fitted to the part `fit`; errors of a jackknife over its cases.\n\n"
        + _table(["number of the preset", "fitted", "preset"], rows)
        + "\n\n## Found against predicted\n\nBy the numbers of the preset, in bins of the predicted probability with "
        f"at least {LEAST} planets where there are as many.\n\n"
        + _table(["part", "visits", "planets", "predicted", "found", "found - predicted"], shown)
        + "\n\nBy case: planets found, of expected, and standard deviations of their difference; the mean of its "
        f"square is {np.mean(squares):.2f}. \n\n".replace(". \n", ".\n")
        + _table(
            ["part", "star", "band", "V (mag)", "drift (nm)", "wall hours a visit", *(f"V = {n}" for n in VISITS)],
            _cases(found, law),
        )
        + "\n"
    )


def main() -> None:
    """Measure, or write the report of what was measured."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--write", action="store_true", help="fit and write the report of what law.json holds")
    file = HERE / "law.json"
    found = json.loads(file.read_text(encoding="utf-8")) if parser.parse_args().write else measured()
    found["law"] = fitted(table_of(found, ("fit",)))
    write_text(file, json.dumps(found, separators=(",", ":")).replace('{"case"', '\n{"case"') + "\n")
    write_text(HERE / "report.md", text(found))


if __name__ == "__main__":
    main()
