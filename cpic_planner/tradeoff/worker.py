"""Measure one row, or several that share a process: wall clock, processor time, memory, flux and noise."""

import contextlib
import functools
import gc
import math
import resource
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Self

from cpic_core import FloatArray, Status
from cpic_planner.results import TradeoffRow
from cpic_planner.tradeoff import chain, points as ways
from cpic_planner.tradeoff.chain import ClosedForm, Images, NotApplicable, Places, Work
from cpic_planner.tradeoff.points import REFERENCE, Point
from cpic_planner.tradeoff.setup import Effort, FixedScene, Setup, choice_of, chosen_by, reference_setup, visit
from cpic_planner.validation import Measurement, Modelling, contrasts_of
from cpic_planner.version import __version__
from simulator.knobs import dial_of
from simulator.observing import Observation

MOST_REPEATS = 5
_BLOCK_S = 0.02


@dataclass(frozen=True)
class Timing:
    """Least wall clock of some calls with the processor time of that one, and the peak memory of all.

    Attributes
    ----------
    wall_s, cpu_s : float
    peak_memory_mb : float
        Largest resident set of the process meanwhile, interpreter and libraries included.
    repeats : int
        Calls, or blocks of calls, that were timed.
    """

    wall_s: float
    cpu_s: float
    peak_memory_mb: float
    repeats: int


def timed(job: Callable[[], object], *, budget_s: float = 1.5) -> Timing:
    """Time a job: the best of up to five calls, as many as the budget allows and at least one.

    Calls of less than a fiftieth of a second are timed in blocks, long enough for the clocks.
    """
    gc.collect()
    reset_peak_memory()
    calls, spent = 1, 0.0
    times: list[tuple[float, float]] = []
    while len(times) < MOST_REPEATS and (not times or spent < budget_s):
        wall, cpu = _block(job, calls)
        spent += wall
        if wall < _BLOCK_S and calls == 1:
            calls = max(2, int(1.2 * _BLOCK_S / max(wall, 1e-7)))
            continue
        times.append((wall / calls, cpu / calls))
    return Timing(*min(times), peak_memory_mb(), len(times))


def _block(job: Callable[[], object], calls: int) -> tuple[float, float]:
    cpu, wall = time.process_time(), time.perf_counter()
    for _ in range(calls):
        job()
    return time.perf_counter() - wall, time.process_time() - cpu


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


def _row(
    case: FixedScene,
    point: Point,
    machine: str,
    way: Callable[[], dict[str, Any]],
    predicted: dict[Any, float] | None = None,
) -> TradeoffRow:
    """Return the row of what a way finds, or of why the scene does not allow it."""
    try:
        found = {"status": "ok"} | way()
    except NotApplicable as error:
        found = {"status": "invalid", "reason": error.reason, "message": str(error)}
    about = {name: getattr(point, name) for name in ("title", "group")}
    about |= {"n_frames": case.n_frames, "machine": machine, "version": __version__}
    return TradeoffRow(scene=case.name, point=point.name, predicted_error=predicted or {}, **about, **found)


def measured_rows(
    case: FixedScene,
    points: tuple[Point, ...],
    effort: Effort,
    machine: str,
    launched_s: float,
    advance: Callable[[str], None] = lambda name: None,
) -> list[TradeoffRow]:
    """Measure points of one group on a scene: `measure_point`, or `measure_shared` where they share a process.

    Parameters
    ----------
    case : FixedScene
    points : tuple of Point
    effort : Effort
    machine : str
        Key of the machine.
    launched_s : float
        ``time.monotonic()`` when the process was started.
    advance : callable
        Told the name of each point that is done.
    """
    if points[0].shares_process:
        return measure_shared(case, points, effort, machine, advance)
    rows = []
    for point in points:
        rows.append(measure_point(case, point, effort, machine, launched_s))
        advance(point.name)
    return rows


def measure_point(case: FixedScene, point: Point, effort: Effort, machine: str, launched_s: float) -> TradeoffRow:
    """Time a way after its first call, and measure its flux and noise.

    Parameters
    ----------
    case : FixedScene
    point : Point
    effort : Effort
    machine : str
        Key of the machine.
    launched_s : float
        ``time.monotonic()`` when the process was started.
    """
    predicted: dict[Any, float] = {}

    def times(job: Callable[[], object], first: Callable[[], object] | None = None) -> dict[str, Any]:
        (first or job)()
        cold_s = time.monotonic() - launched_s
        return {"cold_s": cold_s} | asdict(timed(job, budget_s=effort.budget_s))

    def way() -> dict[str, Any]:
        if point.group == "closed_form":
            return _closed_form(chain.closed_form(case), point.n_cases, times)
        if case.is_programme:
            return _programme(case, point, effort, times)
        return _single(case, point, effort, times, predicted)

    return _row(case, point, machine, way, predicted)


def _closed_form(question: ClosedForm, n_cases: int, times: Callable[..., dict[str, Any]]) -> dict[str, Any]:
    told: list[dict[str, float]] = []
    found = times(lambda: question.noise(n_cases), lambda: told.append(question.answer()))
    samples = {"whole_e2": [told[0]["white_e2"]], "fixed_speckle_e2": [told[0]["speckle_e2"]]}
    one = {name: found[name] / n_cases for name in ("wall_s", "cpu_s")}
    return found | one | {"flux_e": told[0]["flux_e"], "samples": samples}


def _programme(case: FixedScene, point: Point, effort: Effort, times: Callable[..., dict[str, Any]]) -> dict[str, Any]:
    """Time one realisation of a programme, its set-up included, and draw more of them."""
    held: list[tuple[Images, Measurement]] = []

    def job() -> None:
        images = chain.images_of_programme(case, point.setup, point.fidelity, point.tolerance)
        held[:] = [(images, images.measured(0))]

    found = times(job)
    images, first = held[0]
    how = images.modelling
    count = effort.realisations if how.draw == "sums" else max(2, effort.visits_by_frames // case.visits)
    contrast, contrast_error, _ = contrasts_of([first, *map(images.measured, range(1, count))])
    question = chain.closed_form(case)
    return found | {
        "flux_e": float(contrast.mean()) / question.contrast * question.answer()["flux_e"],
        "settings": _settings(how, "draw", "region", "epochs", "knobs"),
        "samples": {"contrast": _listed(contrast), "contrast_error": _listed(contrast_error)},
    }


def _single(
    case: FixedScene, point: Point, effort: Effort, times: Callable[..., dict[str, Any]], predicted: dict[Any, float]
) -> dict[str, Any]:
    held: list[tuple[Setup, Work]] = []

    def job() -> None:
        setup = point.setup or _by_ledger(case, point, predicted)
        held[:] = [(setup, chain.worked(case, setup))]

    found = times(job)
    return found | _imaged(case, point, *held[0], effort, Places.of(case))


def _by_ledger(case: FixedScene, point: Point, predicted: dict[Any, float]) -> Setup:
    choice = choice_of(case, dial_of(point.fidelity, point.tolerance))
    # A size without a bound is told by the message alone.
    predicted |= {name: size for name, size in choice.predicted_error.items() if math.isfinite(size)}
    if choice.outcome.status is not Status.OK:
        raise NotApplicable(choice.outcome.message, choice.outcome.reason.value)
    return chosen_by(case, choice)


def measure_shared(
    case: FixedScene,
    points: tuple[Point, ...],
    effort: Effort,
    machine: str,
    advance: Callable[[str], None] = lambda name: None,
) -> list[TradeoffRow]:
    """Return the same for ways that change one thing of the reference, one after the other in one process.

    Each is called once. Ways that leave the light as it is take the light of the reference, and its time.
    """
    base = reference_setup(case)
    chain.worked(case, replace(base, region="hole", epochs=1))  # compiles and reads what all of them need
    places, light, rows = Places.of(case), functools.cache(lambda: _Light.of(case, base)), []
    for point in points:
        rows.append(_row(case, point, machine, functools.partial(_shared, case, point, effort, places, light)))
        advance(point.name)
    return rows


@dataclass(frozen=True, eq=False)
class _Light:
    """The reference's light, and how long it takes."""

    wall_s: float
    cpu_s: float
    visits: tuple[Observation, Observation]
    bare_e_s: FloatArray

    @classmethod
    def of(cls, case: FixedScene, base: Setup) -> Self:
        visits: list[tuple[Observation, Observation]] = []
        wall_s, cpu_s = _block(lambda: visits.append(chain.both_visits(case, base)), 1)
        return cls(wall_s, cpu_s, visits[0], ways.light_without(case, base))


def _shared(
    case: FixedScene, point: Point, effort: Effort, places: Places, light: Callable[[], _Light]
) -> dict[str, Any]:
    """Do the work once, of the light of the reference or with light of its own."""
    setup, held = point.setup, []
    assert setup is not None  # of knobs and effects
    if point.light_changes:
        timing = timed(lambda: held.append(chain.worked(case, setup)), budget_s=0.0)
        return asdict(timing) | _imaged(case, point, setup, held[0], effort, places)
    same, instrument = light(), setup.instrument(case)
    science, reference = (replace(seen, instrument=instrument) for seen in same.visits)
    timing = timed(lambda: held.append(chain.worked(case, setup, (science, reference))), budget_s=0.0)
    timing = replace(timing, wall_s=timing.wall_s + same.wall_s, cpu_s=timing.cpu_s + same.cpu_s)
    samples = {"white_e2": ways.white_of_frames(places, held[0].drawn)}
    return asdict(timing) | _of_images(case, setup, held[0], samples, places, same.bare_e_s)


def _imaged(case: FixedScene, point: Point, setup: Setup, work: Work, effort: Effort, places: Places) -> dict[str, Any]:
    """Return what a row of images says, with what its noise is measured from."""
    base, is_reference = reference_setup(case), point.name == REFERENCE
    samples: dict[str, FloatArray] = {}
    if work.drawn:
        samples["white_e2"] = ways.white_of_frames(places, work.drawn)
    else:
        samples["white_e2"] = ways.white_of_sums(case, setup, places, effort.draws)
    # Windows and whole frames have different random numbers, and sums others again: more of them where they differ.
    if work.drawn and effort.more_frames > 1 and (is_reference or setup.region == "hole"):
        # Another realisation, at one wavefront: more of the same noise.
        longer = visit(case, setup, n_frames=effort.more_frames, epochs=1, realisation=1)
        samples["more_white_e2"] = ways.white_of_frames(places, (chain.drawn_frames(longer),))
    # Speckles where optics or drift differ from the reference's, and the walk where the epochs do.
    if is_reference or setup.knobs != base.knobs or setup.drift != base.drift:
        samples["speckle_e2_s2"] = ways.speckle_samples(case, setup, places, effort.pairs)
    if is_reference or setup.n_epochs(case) != base.n_epochs(case):
        samples["walk_e2_s2"], samples["one_epoch_e2_s2"] = ways.walk_samples(case, setup, places, effort.walk_pairs)
    return _of_images(case, setup, work, samples, places, ways.light_without(case, setup))


def _of_images(
    case: FixedScene, setup: Setup, work: Work, samples: dict[str, FloatArray], places: Places, bare_e_s: FloatArray
) -> dict[str, Any]:
    flux_e = ways.expected_flux_e(case, setup, work.science, bare_e_s)
    names = ("draw", "region", "epochs", "knobs", "switches", "left_out", "sky", "drift", "scene_model")
    settings = _settings(setup, *names) | {"epochs": setup.n_epochs(case)}
    listed = {name: _listed(values) for name, values in samples.items()}
    listed["own_e2"] = [ways.own_noise_e2(case, setup, places, flux_e)]
    return {"flux_e": flux_e, "settings": settings, "samples": listed}


def _settings(how: Setup | Modelling, *names: str) -> dict[str, Any]:
    plain = {"knobs": how.knobs.model_dump(mode="json"), "left_out": list(how.left_out)}
    return {name: plain.get(name, getattr(how, name)) for name in names}


def _listed(values: FloatArray) -> list[float]:
    """Return seven digits of each: enough to compare them pair by pair."""
    return [float(f"{value:.7g}") for value in values]
