"""Measure one row, or several that share a process: wall clock, processor time, memory, flux and noise."""

import contextlib
import dataclasses
import gc
import math
import resource
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

from cpic_core import FloatArray, Status
from cpic_planner.results import TradeoffRow
from cpic_planner.tradeoff.chain import (
    Images,
    NotApplicable,
    Places,
    Work,
    both_visits,
    closed_form,
    drawn_frames,
    images_of_programme,
    worked,
)
from cpic_planner.tradeoff.points import (
    REFERENCE,
    Point,
    expected_flux_e,
    light_without,
    own_noise_e2,
    speckle_samples,
    walk_samples,
    white_of_frames,
    white_of_sums,
)
from cpic_planner.tradeoff.setup import Effort, FixedScene, Setup, choice_of, chosen_by, reference_setup, visit
from cpic_planner.validation import Measurement, contrasts_of
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


@dataclass
class _Row:
    """A row while it is made."""

    case: FixedScene
    point: Point
    machine: str
    places: Places | None = None
    predicted: dict[Any, float] = field(default_factory=dict)
    reason: str = "not_applicable"

    def made(self, **more: Any) -> TradeoffRow:
        """Return the row."""
        return TradeoffRow(
            scene=self.case.name,
            point=self.point.name,
            title=self.point.title,
            group=self.point.group,
            predicted_error=self.predicted,
            n_frames=self.case.n_frames,
            machine=self.machine,
            version=__version__,
            **more,
        )

    def ok(
        self, setup: Setup, timing: Timing, flux_e: float, samples: dict[str, list[float]], cold_s: float | None = None
    ) -> TradeoffRow:
        """Return the row of images."""
        settings = {
            "draw": setup.draw,
            "region": setup.region,
            "epochs": setup.n_epochs(self.case),
            "knobs": setup.knobs.model_dump(mode="json"),
            "switches": dict(setup.switches),
            "left_out": list(setup.left_out),
            "sky": setup.sky,
            "drift": setup.drift,
            "scene_model": setup.scene_model,
        }
        assert self.places is not None  # images have places
        own_e2 = own_noise_e2(self.case, setup, self.places, flux_e)
        return self.made(
            status="ok",
            cold_s=cold_s,
            flux_e=flux_e,
            settings=settings,
            samples=samples | {"own_e2": [own_e2]},
            **dataclasses.asdict(timing),
        )


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
    row = _Row(case, point, machine)
    if point.group == "closed_form":
        return _closed_form(row, effort, launched_s)
    if case.is_programme:
        return _programme(row, effort, launched_s)
    held: list[tuple[Setup, Work]] = []

    def job() -> None:
        setup = point.setup or _by_ledger(row)
        held[:] = [(setup, worked(case, setup))]

    try:
        job()
        cold_s = time.monotonic() - launched_s
        timing = timed(job, budget_s=effort.budget_s)
    except NotApplicable as error:
        return row.made(status="invalid", reason=row.reason, message=str(error))
    row.places = Places.of(case)
    return _imaged(row, *held[0], timing, effort, cold_s)


def _programme(row: _Row, effort: Effort, launched_s: float) -> TradeoffRow:
    """Time one realisation of a programme, its set-up included, and draw more of them."""
    case, point = row.case, row.point
    held: list[Images] = []

    def job() -> Measurement:
        held[:] = [images_of_programme(case, point.setup, point.fidelity, point.tolerance)]
        return held[0].measured(0)

    try:
        first = job()
        cold_s = time.monotonic() - launched_s
        timing = timed(job, budget_s=effort.budget_s)
        how, drawn = held[0].modelling, held[0].modelling.draw
        count = effort.realisations if drawn == "sums" else max(2, effort.visits_by_frames // case.visits)
        found = [first, *(held[0].measured(number) for number in range(1, count))]
    except NotApplicable as error:
        return row.made(status="invalid", reason=error.reason, message=str(error))
    contrast, contrast_error, _ = contrasts_of(found)
    question = closed_form(case)
    return row.made(
        status="ok",
        cold_s=cold_s,
        flux_e=float(contrast.mean()) / question.contrast * question.answer()["flux_e"],
        settings={
            "draw": drawn,
            "region": how.region,
            "epochs": how.epochs,
            "knobs": how.knobs.model_dump(mode="json"),
        },
        samples={"contrast": _listed(contrast), "contrast_error": _listed(contrast_error)},
        **dataclasses.asdict(timing),
    )


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
    worked(case, base.changed(region="hole", epochs=1))  # compiles and reads what all of them need
    light: _Light | None = None
    places, rows = Places.of(case), []
    for point in points:
        assert point.setup is not None  # of knobs and effects
        row = _Row(case, point, machine, places)
        if point.light_changes:
            rows.append(_changed(row, point.setup, effort))
        else:
            light = light or _Light.of(case, base)
            rows.append(_recast(row, point.setup, places, light))
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
        wall_s, cpu_s = _block(lambda: visits.append(both_visits(case, base)), 1)
        return cls(wall_s, cpu_s, visits[0], light_without(case, base))


def _changed(row: _Row, setup: Setup, effort: Effort) -> TradeoffRow:
    held: list[Work] = []
    timing = timed(lambda: held.append(worked(row.case, setup)), budget_s=0.0)
    return _imaged(row, setup, held[0], timing, effort)


def _imaged(
    row: _Row, setup: Setup, work: Work, timing: Timing, effort: Effort, cold_s: float | None = None
) -> TradeoffRow:
    """Return the row of images that were timed, with what their noise is measured from."""
    assert row.places is not None  # images have places
    case, places = row.case, row.places
    # Windows and whole frames have different random numbers, and sums others again: more of them where they differ.
    more = effort.more_frames if row.point.name == REFERENCE or setup.region == "hole" else 0
    samples = _white(row, setup, places, work, effort, more)
    samples |= _residual(row, setup, places, effort, reference_setup(case))
    flux_e = expected_flux_e(case, setup, work.science, light_without(case, setup))
    return row.ok(setup, timing, flux_e, samples, cold_s)


def _recast(row: _Row, setup: Setup, places: Places, light: _Light) -> TradeoffRow:
    instrument = setup.instrument(row.case)
    science, reference = (dataclasses.replace(seen, instrument=instrument) for seen in light.visits)
    held: list[Work] = []
    timing = timed(lambda: held.append(worked(row.case, setup, (science, reference))), budget_s=0.0)
    timing = dataclasses.replace(timing, wall_s=timing.wall_s + light.wall_s, cpu_s=timing.cpu_s + light.cpu_s)
    samples = {"white_e2": _listed(white_of_frames(places, held[0].drawn))}
    return row.ok(setup, timing, expected_flux_e(row.case, setup, science, light.bare_e_s), samples)


def _by_ledger(row: _Row) -> Setup:
    choice = choice_of(row.case, dial_of(row.point.fidelity, row.point.tolerance))
    # A size without a bound is told by the message alone.
    row.predicted = {name: size for name, size in choice.predicted_error.items() if math.isfinite(size)}
    if choice.outcome.status is not Status.OK:
        row.reason = choice.outcome.reason.value
        raise NotApplicable(choice.outcome.message)
    return chosen_by(row.case, choice)


def _white(row: _Row, setup: Setup, places: Places, work: Work, effort: Effort, more: int) -> dict[str, list[float]]:
    if not work.drawn:
        return {"white_e2": _listed(white_of_sums(row.case, setup, places, effort.draws))}
    samples = {"white_e2": _listed(white_of_frames(places, work.drawn))}
    if more > 1:
        # Another realisation, at one wavefront: more of the same noise.
        longer = visit(row.case, setup, n_frames=more, epochs=1, realisation=1)
        samples["more_white_e2"] = _listed(white_of_frames(places, (drawn_frames(longer),)))
    return samples


def _residual(row: _Row, setup: Setup, places: Places, effort: Effort, base: Setup) -> dict[str, list[float]]:
    """Return the speckles where optics or drift differ from the reference's, and the walk where the epochs do."""
    case, own = row.case, row.point.name == REFERENCE
    samples: dict[str, list[float]] = {}
    if own or setup.knobs != base.knobs or setup.drift != base.drift:
        samples["speckle_e2_s2"] = _listed(speckle_samples(case, setup, places, effort.pairs))
    if own or setup.n_epochs(case) != base.n_epochs(case):
        walk, one = walk_samples(case, setup, places, effort.walk_pairs)
        samples |= {"walk_e2_s2": _listed(walk), "one_epoch_e2_s2": _listed(one)}
    return samples


def _listed(values: FloatArray) -> list[float]:
    """Return seven digits of each: enough to compare them pair by pair."""
    return [float(f"{value:.7g}") for value in values]


def _closed_form(row: _Row, effort: Effort, launched_s: float) -> TradeoffRow:
    question, n_cases = closed_form(row.case), row.point.n_cases
    answer = question.answer()
    cold_s = time.monotonic() - launched_s
    timing = timed(lambda: question.noise(n_cases), budget_s=effort.budget_s)
    timing = dataclasses.replace(timing, wall_s=timing.wall_s / n_cases, cpu_s=timing.cpu_s / n_cases)
    samples = {"whole_e2": [answer["white_e2"]], "fixed_speckle_e2": [answer["speckle_e2"]]}
    times = dataclasses.asdict(timing)
    return row.made(status="ok", cold_s=cold_s, flux_e=answer["flux_e"], samples=samples, **times)
