"""The work that is timed on a fixed scene, as ``cpic confirm`` does it: both visits drawn, reduced and measured.

Measure one row, or several that share a process: wall clock, processor time, memory, flux and noise.
"""

import contextlib
import dataclasses
import gc
import math
import resource
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np

from cpic_core import FloatArray, InputError, Record
from cpic_planner import etc, validation
from cpic_planner.confirm import scene_target
from cpic_planner.results import TradeoffRow
from cpic_planner.targets import Targets
from cpic_planner.tradeoff.scenes import PLANET, REFERENCE, SEED, Effort, FixedScene, Point, reference_setup
from cpic_planner.validation import Modelling, VisitPair, calibrated_frames
from cpic_planner.validation.task import gap_s
from cpic_planner.version import __version__
from simulator.camera import Frame
from simulator.config import Instrument
from simulator.imaging import forget_starlight
from simulator.observing import Observation
from simulator.target import scene_sources


class ClosedForm(Record):
    """A fixed scene as the calculator sees it: a star, its planet's contrast and place, and the frames."""

    model: etc.EtcModel
    target: Targets
    case: FixedScene
    x_arcsec: float
    y_arcsec: float
    contrast: float

    @classmethod
    def of(cls, case: FixedScene, instrument: Instrument) -> "ClosedForm":
        """Prepare the calculator for a fixed scene and an instrument."""
        model, target = etc.build_model(instrument, [case.band], case.how), scene_target(case.scene)
        planet = next(item for item in scene_sources(case.scene, instrument, case.band) if item.kind == "planet")
        x, y = planet.x_arcsec, planet.y_arcsec
        if len(case.how.rolls_deg) > 1:  # one of two rolls stands for both
            x, y = etc.planet_offsets(model, target, case.band, float(np.hypot(x, y)))
        return cls(model, target, case, float(x), float(y), planet.contrast or 0.0)

    @property
    def frames(self) -> validation.Frames:
        """Frames of one visit, and the visits."""
        case = self.case
        return validation.Frames(case.exposure_s, case.n_frames, case.em_gain, case.visits)

    def noise(self, n_cases: int = 1) -> etc.StackNoise:
        """Return one question, or as many at once, of planets that differ."""
        case, place = self.case, np.ones((1, n_cases))
        x, y, contrast = self.x_arcsec * place, self.y_arcsec * place, self.contrast * np.linspace(1.0, 2.0, n_cases)
        rates = etc.aperture_rates(self.model, self.target, case.band, x, y, contrast[None])
        frames, camera = (case.exposure_s, case.n_frames, case.em_gain), self.model.camera(case.band)
        visits = etc.Programme.of(case.how, case.visits, gap_s(self.model, case.band, self.frames))
        programme = etc.with_modes(self.model, case.band, np.hypot(x, y), rates, visits, *frames)
        return etc.stack_noise(rates, *frames, camera, case.how, programme)

    def answer(self) -> tuple[float, float]:
        """Return the planet's flux, electrons of all visits in its aperture, and its SNR."""
        noise = self.noise()
        return float(np.ravel(noise.signal_e)[0]), float(np.ravel(noise.snr)[0])

    def task(self, point: Point) -> validation.ConfirmTask:
        """Return the images of the scene as a confirmation makes them, by the dial of a way."""
        place = self.x_arcsec, self.y_arcsec
        expected = validation.expected_of(self.model, self.target, self.case.band, place, self.contrast, self.frames)
        dial: validation.ImageSettings = {"seed": SEED, "fidelity": point.fidelity, "tolerance": point.tolerance}
        about = self.model, self.case.scene, self.case.band, self.frames, [expected]
        return validation.task_of(*about, planets=[PLANET], **dial)


class NotApplicable(Exception):
    """A way that a scene does not allow, with its reason."""

    def __init__(self, message: str, reason: str = "not_applicable") -> None:
        super().__init__(message)
        self.reason = reason


_CUT_OFF = "limits cut off the planet's aperture or what is around it"


class Images(Record, eq=False):
    """The visits of a scene, to be drawn, reduced as one and measured any number of times.

    Attributes
    ----------
    case : FixedScene
    task : ConfirmTask
    how : Modelling
        How they are made.
    visits : VisitPair
        Of the first realisation.
    contrast : float
        Of the planet.
    """

    case: FixedScene
    task: validation.ConfirmTask
    how: Modelling
    visits: VisitPair
    contrast: float

    @classmethod
    def of(cls, case: FixedScene, point: Point) -> "Images":
        """Set up the images of a way on a scene.

        Parameters
        ----------
        case : FixedScene
        point : Point
            Its setup says what is drawn, of which pixels, by which knobs and with how many wavefronts a visit; what
            the effect ledger chooses for its dial without.

        Raises
        ------
        NotApplicable
            If the tier is too coarse for the scene, or sums cannot stand for its frames.
        """
        forget_starlight()  # work that is timed begins without the light of field stars
        setup = point.setup
        closed = ClosedForm.of(case, case.instrument if setup is None else setup.sky_of(case.instrument))
        task = closed.task(point)
        how = replace(validation.modelling_of(task), scene_model=case.scene_model)
        if setup is not None:
            how = replace(how, **{item.name: getattr(setup, item.name) for item in dataclasses.fields(setup)})
        visits = validation.visit_pair(task, modelling=how)
        if how.draw == "sums" and visits.stackable.value is None:
            if setup is not None:
                raise NotApplicable(visits.stackable.message)
            how = replace(validation.modelling_of(task, by_frames=True), scene_model=case.scene_model)
            visits = validation.visit_pair(task, modelling=how)
        if setup is None and how.outcome.value is None:
            raise NotApplicable(how.outcome.message, how.outcome.reason.value)
        return cls(case, task, how, visits, closed.contrast)

    def contrast_error(self, number: int) -> float:
        """Return the measured error of the planet's contrast in one realisation, 1 sigma.

        Parameters
        ----------
        number : int
            Of the realisation; ways that draw the same pixels alike share its random numbers.

        Raises
        ------
        NotApplicable
            If nothing is left of the planet's place.
        """
        visits = self.visits
        if self.how.draw == "sums":
            drawn = visits.draw(number)
        else:
            if number:
                visits = validation.visit_pair(self.task, realisation=number, modelling=self.how)
            try:
                drawn, _ = validation.realise_frames(visits)
            except InputError:  # no pixel is left
                raise NotApplicable(_CUT_OFF) from None
        star = validation.StarFlux.known(visits.science.truth.sources[0].rate_e_s)
        planets = list(validation.planet_templates(self.visits))
        (one,), _ = validation.measure_planets(visits, drawn, planets, star, searched=False)
        if one is None:
            raise NotApplicable(_CUT_OFF)
        return one.contrast_error

    def flux_e(self) -> float:
        """Return the planet's aperture in the expected visits: with the planet minus without it, no noise.

        Expectations are calibrated as frames are.
        """
        shown, without = self.visits.science, replace(self.how, left_out=(*self.how.left_out, PLANET))
        dark = validation.visit_pair(self.task, modelling=without).science.light.static_e_s
        bare = replace(shown, light=replace(shown.light, static_e_s=dark))
        aperture = validation.planet_templates(self.visits)[0].apertures[0]
        light = float(np.sum(aperture * (_calibrated(shown) - _calibrated(bare))))
        return self.case.n_frames * self.case.visits * light


class _Noiseless(Observation):
    """An observation whose one frame is the expectation."""

    def frame(self, index: int) -> Frame:
        return Frame(adu=cast(Any, self.expected), mask=np.zeros(self.shape, dtype=np.uint8))


def _calibrated(shown: Observation) -> FloatArray:
    """Return the expected frame of a visit on the stamp, calibrated."""
    values = {item.name: getattr(shown, item.name) for item in dataclasses.fields(shown) if item.init}
    frames = calibrated_frames(_Noiseless(**values | {"n_frames": 1}), cropped=shown.window == "full")
    return np.asarray(frames.electrons[0])


MOST_REPEATS = 5
_BLOCK_S = 0.02


def timed(job: Callable[[], object], *, budget_s: float = 1.5) -> dict[str, Any]:
    """Time a job: the best of up to five calls, as many as the budget allows and at least one.

    Calls of less than a fiftieth of a second are timed in blocks, long enough for the clocks.

    Returns
    -------
    dict
        ``wall_s`` (least wall clock of a call) and ``cpu_s`` (processor time of that call), ``peak_memory_mb`` (largest
        resident set of the process meanwhile, interpreter and libraries included), ``repeats`` (calls, or blocks of
        calls, that were timed).
    """
    gc.collect()
    reset_peak_memory()
    calls, spent = 1, 0.0
    times: list[tuple[float, float]] = []
    while len(times) < MOST_REPEATS and (not times or spent < budget_s):
        cpu, wall = time.process_time(), time.perf_counter()
        for _ in range(calls):
            job()
        wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
        spent += wall
        if wall < _BLOCK_S and calls == 1:
            calls = max(2, int(1.2 * _BLOCK_S / max(wall, 1e-7)))
            continue
        times.append((wall / calls, cpu / calls))
    wall_s, cpu_s = min(times)
    return {"wall_s": wall_s, "cpu_s": cpu_s, "peak_memory_mb": peak_memory_mb(), "repeats": len(times)}


def reset_peak_memory() -> None:
    """Let the peak count from now on, where the system can (Linux)."""
    with contextlib.suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")


def peak_memory_mb() -> float:
    """Return the peak of the resident set, MB: since `reset_peak_memory` on Linux, of the whole process elsewhere."""
    with contextlib.suppress(OSError):
        for line in Path("/proc/self/status").read_text(encoding="ascii", errors="replace").splitlines():
            if line.startswith("VmHWM:"):
                return float(line.split()[1]) * 1024 / 1e6
    peak = float(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
    return peak / 1e6 if sys.platform == "darwin" else peak * 1024 / 1e6


def measured_rows(
    case: FixedScene, points: Sequence[Point], effort: Effort, machine: str, launched_s: float
) -> list[TradeoffRow]:
    """Measure points of one group on a scene, one after the other in this process.

    Ways that have a process of their own are timed after their first call, the others once.

    Parameters
    ----------
    case : FixedScene
    points : sequence of Point
    effort : Effort
    machine : str
        Key of the machine.
    launched_s : float
        ``time.monotonic()`` when the process was started.
    """
    if points[0].shares_process:  # compiles and reads what all of them need
        with contextlib.suppress(NotApplicable):
            Images.of(case, replace(points[0], setup=replace(reference_setup(case), region="hole"))).contrast_error(0)

    def times(point: Point, job: Callable[[], object]) -> dict[str, Any]:
        if point.shares_process:
            return timed(job, budget_s=0.0)
        job()
        cold_s = time.monotonic() - launched_s
        return {"cold_s": cold_s} | timed(job, budget_s=effort.budget_s)

    rows = []
    for point in points:
        measure = _closed_form if point.group == "closed_form" else _images
        try:
            found: dict[str, Any] = {"status": "ok"} | measure(case, point, effort, times)
        except NotApplicable as error:
            found = {"status": "invalid", "reason": error.reason, "message": str(error)}
        about = {"title": point.title, "group": point.group, "n_frames": case.n_frames}
        about |= {"machine": machine, "version": __version__}
        rows.append(TradeoffRow(scene=case.name, point=point.name, **about, **found))
    return rows


_Times = Callable[[Point, Callable[[], object]], dict[str, Any]]


def _closed_form(case: FixedScene, point: Point, effort: Effort, times: _Times) -> dict[str, Any]:
    # Programmes are drawn as sums of frames, which no particle hits.
    question = ClosedForm.of(case, validation.images_of(case.instrument) if case.is_programme else case.instrument)
    found = times(point, lambda: question.noise(point.n_cases))
    flux_e, snr = question.answer()
    one = {name: found[name] / point.n_cases for name in ("wall_s", "cpu_s")}
    return found | one | {"flux_e": flux_e, "snr": snr}


def _images(case: FixedScene, point: Point, effort: Effort, times: _Times) -> dict[str, Any]:
    """Time one realisation, its set-up included, and draw more of them."""
    held: list[tuple[Images, float]] = []

    def job() -> None:
        images = Images.of(case, point)
        held[:] = [(images, images.contrast_error(0))]

    found = times(point, job)
    images, first = held[0]
    how = images.how
    errors = [first, *map(images.contrast_error, range(1, effort.number_of(point, how.draw, case.visits)))]
    names = ("draw", "region", "switches", "sky", "still", "scene_model")
    settings: dict[str, Any] = {name: getattr(how, name) for name in names}
    settings |= {"knobs": how.knobs.model_dump(mode="json"), "left_out": list(how.left_out)}
    return found | {
        "flux_e": images.flux_e(),
        "snr": images.contrast / math.sqrt(float(np.mean(np.square(errors)))),
        "settings": settings | {"epochs": min(how.epochs, case.n_frames)},
        "samples": {"contrast_error": [float(f"{error:.7g}") for error in errors]},
        # A size without a bound is told by the message alone.
        "predicted_error": {} if point.setup else {k: v for k, v in how.predicted_error.items() if math.isfinite(v)},
    }


FLUX_LIMIT = 1e-9
"""Rounding of the difference of two expected images, relative to a planet."""


def compared(rows: Iterable[TradeoffRow]) -> list[TradeoffRow]:
    """Return the rows of one scene with their errors; None where there is no reference to compare with.

    Ways with the random numbers of the reference are compared with it realisation by realisation; the others carry the
    scatter of both.
    """
    every = list(rows)
    best = next((row for row in every if row.point == REFERENCE and row.status == "ok"), None)
    if best is None:
        return [row.model_copy(update=dict.fromkeys(_ERRORS)) for row in every]
    return [_one(row, best) if row.status == "ok" else row for row in every]


_ERRORS = ("variance_e2", "flux_error", "flux_uncertainty", "snr_error", "snr_uncertainty")


def _one(row: TradeoffRow, best: TradeoffRow) -> TradeoffRow:
    flux_e, snr, best_flux_e, best_snr = (
        float(part or math.nan) for part in (row.flux_e, row.snr, best.flux_e, best.snr)
    )
    ours, theirs = (np.square(item.samples.get("contrast_error", [])) for item in (row, best))
    if all(row.settings.get(key) == best.settings.get(key) for key in ("draw", "region")):
        common = min(len(ours), len(theirs))
        ours, theirs = ours[:common], theirs[:common]
        variance = float(ours.mean() / theirs.mean())
        scatter = _relative(1.0 + ours / ours.mean() - theirs / theirs.mean())
    else:
        variance = (best_snr / snr) ** 2
        scatter = math.hypot(_relative(ours), _relative(theirs))
    ratio = variance**-0.5
    return row.model_copy(
        update={
            "snr": best_snr * ratio,
            "variance_e2": (flux_e / (best_snr * ratio)) ** 2,
            "flux_error": flux_e / best_flux_e - 1.0,
            "flux_uncertainty": 0.0 if row is best else FLUX_LIMIT,
            "snr_error": ratio - 1.0,
            "snr_uncertainty": 0.0 if row is best else ratio * 0.5 * scatter,
        }
    )


def _relative(values: FloatArray) -> float:
    """Return the standard error of a mean, relative to it."""
    return float(values.std(ddof=1) / values.mean() / math.sqrt(values.size)) if values.size > 1 else 0.0


def speed_ups(rows: Iterable[TradeoffRow]) -> dict[str, float]:
    """Return the wall clock of the reference over that of a closed form on the same machine, by scene."""
    times = {(row.scene, row.machine, row.point): row.wall_s for row in rows if row.wall_s}
    return {
        scene: wall_s / times[scene, machine, "etc"]
        for (scene, machine, point), wall_s in times.items()
        if point == REFERENCE and (scene, machine, "etc") in times
    }
