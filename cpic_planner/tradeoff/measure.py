"""The work that is timed on a fixed scene: both visits drawn, calibrated and measured, and the closed form.

Measure one row, or several that share a process: wall clock, processor time, memory, flux and noise.
"""

import contextlib
import dataclasses
import functools
import gc
import math
import resource
import sys
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self, cast

import numpy as np

from cpic_core import BoolArray, FloatArray, InputError, NDArray, Status, stream
from cpic_planner import etc, validation
from cpic_planner.confirm import scene_target
from cpic_planner.results import TradeoffRow
from cpic_planner.targets import Targets
from cpic_planner.tradeoff.scenes import (
    ANNULUS_LAMBDA_D,
    PLANET,
    REFERENCE,
    SEED,
    Effort,
    FixedScene,
    Point,
    Setup,
    choice_of,
    chosen_by,
    reference_setup,
    visit,
)
from cpic_planner.validation import Measurement, Modelling, calibrated_frames, contrasts_of, pedestal_e
from cpic_planner.validation.task import gap_s
from cpic_planner.version import __version__
from simulator.camera import Frame, FrameNoise
from simulator.imaging import (
    Psf,
    aperture_sums,
    centred_axis,
    forget_starlight,
    overlap_weights,
    psf_metrics,
    single_band_psf,
    visit_frames,
)
from simulator.knobs import FIDELITIES, Knobs, dial_of
from simulator.observing import Observation, hole_stacks
from simulator.target import scene_sources

_AWAY_RADII = 2.5


@dataclass(frozen=True, eq=False)
class Places:
    """Apertures on the stamp around the mask; made by `Places.of`.

    Attributes
    ----------
    white : ndarray of bool, shape (n, n)
        Centres of apertures wholly inside the hole, none of which touches the planet.
    near : ndarray of bool, shape (n, n)
        Those of them near the planet's separation.
    annulus : ndarray of bool, shape (n, n)
        Pixels of the hole near that separation.
    weights : ndarray
        Of the pixels of an aperture.
    level : ndarray, shape (n, n)
        Expected white variance of the planet's aperture, without its own light, over that of the aperture on each
        pixel: halo and companions differ from place to place.
    star_e_s, source_noise_fraction : float
        Light of the star on the clear disc, and `PsfMetrics.source_noise_fraction`.
    """

    white: BoolArray
    near: BoolArray
    annulus: BoolArray
    weights: FloatArray
    level: FloatArray
    star_e_s: float
    source_noise_fraction: float

    @classmethod
    def of(cls, case: FixedScene) -> Self:
        """Return the frames of a scene: the same for every way, so that ways can be compared."""
        metrics = psf_metrics(case.instrument, case.band)
        alone = case.scene.model_copy(update={"stars": (), "extended": ()})
        star, planet, *_ = scene_sources(alone, case.instrument, case.band)
        pixel, radius = metrics.pixel_scale_arcsec, metrics.aperture_radius_arcsec
        offset = centred_axis(len(metrics.raw_contrast), pixel)
        separation = np.hypot(planet.x_arcsec, planet.y_arcsec)
        distance = np.abs(np.hypot(offset[:, None], offset) - separation)
        around = distance <= ANNULUS_LAMBDA_D * metrics.lambda_d_arcsec
        away = np.hypot(offset[:, None] - planet.y_arcsec, offset - planet.x_arcsec) > _AWAY_RADII * radius
        white = metrics.zone.covers(offset, offset, -radius) & away
        weights = overlap_weights(radius / pixel)
        at = int(np.abs(offset - planet.y_arcsec).argmin()), int(np.abs(offset - planet.x_arcsec).argmin())
        return cls(
            white=white,
            near=white & around,
            annulus=metrics.zone.covers(offset, offset) & around,
            weights=weights,
            level=_level(case, weights, at),
            star_e_s=star.rate_e_s,
            source_noise_fraction=metrics.source_noise_fraction,
        )


def _level(case: FixedScene, weights: FloatArray, at: tuple[int, int]) -> FloatArray:
    """Return the closed-form variance at the planet over that at each place, from the expected light at quick knobs."""
    setup = Setup("frames", "hole", FIDELITIES["quick"], 1, scene_model=case.scene_model)
    observed = visit(case, setup, planets=False, n_frames=1)
    noise = FrameNoise.of(observed.instrument.detector_of(case.band), case.em_gain, case.exposure_s)
    sums = aperture_sums(noise.charge_variance_e2(observed.expected_e + noise.clock_e), weights**2)
    return np.where(sums > 0, sums[at] / np.where(sums > 0, sums, 1.0), 1.0)


_NOT_PLACE = ("background_mean",)


@dataclass(frozen=True)
class ClosedForm:
    """A fixed scene as the calculator sees it: a star, its planet's contrast and place, and the frames."""

    model: etc.EtcModel
    target: Targets
    case: FixedScene
    x_arcsec: float
    y_arcsec: float
    contrast: float

    def noise(self, n_cases: int = 1) -> etc.StackNoise:
        """Return one question, or as many at once, of planets that differ."""
        case, place = self.case, np.ones((1, n_cases))
        x, y, contrast = self.x_arcsec * place, self.y_arcsec * place, self.contrast * np.linspace(1.0, 2.0, n_cases)
        rates = etc.aperture_rates(self.model, self.target, case.band, x, y, contrast[None])
        frames, camera = (case.exposure_s, case.n_frames, case.em_gain), self.model.camera(case.band)
        if not case.is_programme:
            return etc.stack_noise(rates, *frames, camera)
        gap = gap_s(self.model, case.band, validation.Frames(*frames, case.visits))
        visits = etc.Programme.of(case.how, case.visits, gap)
        programme = etc.with_modes(self.model, case.band, np.hypot(x, y), rates, visits, *frames)
        return etc.stack_noise(rates, *frames, camera, case.how, programme)

    def answer(self) -> dict[str, float]:
        """Return the flux and variance of the visit, e- and e-^2, as the images are measured.

        A single visit has no error of the mean background; of a programme ``white_e2`` is all of the variance.
        """
        noise = self.noise()
        if self.case.is_programme:
            flux_e, snr = float(np.ravel(noise.signal_e)[0]), float(np.ravel(noise.snr)[0])
            return {"flux_e": flux_e, "white_e2": (flux_e / snr) ** 2, "speckle_e2": 0.0}
        terms = {name: float(np.ravel(part)[0]) for name, part in noise.terms.items() if name not in _NOT_PLACE}
        speckle = terms.pop("speckle")
        return {"flux_e": float(np.ravel(noise.signal_e)[0]), "white_e2": sum(terms.values()), "speckle_e2": speckle}


def closed_form(case: FixedScene) -> ClosedForm:
    """Prepare the calculator for a fixed scene."""
    # Programmes are drawn as sums of frames, which no particle hits.
    instrument = validation.images_of(case.instrument) if case.is_programme else case.instrument
    model, target = etc.build_model(instrument, [case.band], case.how), scene_target(case.scene)
    planet = next(item for item in scene_sources(case.scene, case.instrument, case.band) if item.kind == "planet")
    x, y = planet.x_arcsec, planet.y_arcsec
    if case.is_programme:  # one of two rolls stands for both
        x, y = etc.planet_offsets(model, target, case.band, float(np.hypot(x, y)))
    return ClosedForm(model, target, case, float(x), float(y), planet.contrast or 0.0)


class NotApplicable(Exception):
    """A way that a scene does not allow, with its reason."""

    def __init__(self, message: str, reason: str = "not_applicable") -> None:
        super().__init__(message)
        self.reason = reason


def images_of_programme(case: FixedScene, point: Point) -> tuple[Modelling, Callable[[int], Measurement]]:
    """Set up the visits of a programme, to be drawn, reduced as one and measured any number of times.

    Parameters
    ----------
    case : FixedScene
    point : Point
        Its setup says what is drawn, of which pixels, by which knobs and with how many wavefronts a visit; what the
        effect ledger chooses for its dial without.

    Returns
    -------
    modelling : Modelling
        How they are made.
    measured : callable
        Of the number of a realisation, the same for all ways that draw sums with as many wavefronts.

    Raises
    ------
    NotApplicable
        If the tier is too coarse for the scene, sums cannot stand for its frames, or nothing is left of the planet's
        place.
    """
    closed, frames = closed_form(case), validation.Frames(case.exposure_s, case.n_frames, case.em_gain, case.visits)
    model = etc.build_model(case.instrument, [case.band], case.how)
    place = closed.x_arcsec, closed.y_arcsec
    expected = validation.expected_of(model, closed.target, case.band, place, closed.contrast, frames)
    dial: validation.ImageSettings = {"seed": SEED, "fidelity": point.fidelity, "tolerance": point.tolerance}
    task = validation.task_of(model, case.scene, case.band, frames, [expected], planets=[PLANET], **dial)
    how = validation.modelling_of(task)
    if point.setup is not None:
        changes = {name: getattr(point.setup, name) for name in ("draw", "region", "knobs", "epochs")}
        how = replace(how, **changes, switches={}, left_out=(), still=())
    elif how.outcome.value is None:
        raise NotApplicable(how.outcome.message, how.outcome.reason.value)
    visits = validation.visit_pair(task, modelling=how)
    if how.draw == "sums" and visits.stackable.value is None:
        raise NotApplicable(visits.stackable.message)
    planets, sums = validation.planet_templates(visits), visits if how.draw == "sums" else None

    def measured(number: int) -> Measurement:
        shown, drawn, _ = next(validation.realisations(task, how, [number], sums))
        star = validation.StarFlux.known(shown.science.truth.sources[0].rate_e_s)
        (one,), _ = validation.measure_planets(shown, drawn, list(planets), star, searched=False)
        if one is None:
            raise NotApplicable("limits cut off the planet's aperture or what is around it")
        return one

    return how, measured


@dataclass(frozen=True, eq=False)
class Drawn:
    """Frames of one visit over the stamp, in electrons at the register input.

    Attributes
    ----------
    electrons : ndarray, shape (n, y, x)
        Calibrated; the mean of its pixel where a particle or a limit voids a pixel-frame.
    usable : ndarray of bool, shape (n, y, x)
    """

    electrons: FloatArray
    usable: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Work:
    """The outcome of the work.

    Attributes
    ----------
    science : Observation
    flux_e : float
        Planet's aperture in the science visit less that in the reference visit, electrons of the visit.
    drawn : tuple of Drawn
        Frames of both visits; none where sums were drawn.
    """

    science: Observation
    flux_e: float
    drawn: tuple[Drawn, ...]


def stamp_of(observation: Observation) -> tuple[slice, slice]:
    """Return the rows and columns of the stamp around the mask."""
    rows, columns, _ = observation.area.stamp(observation.psf.on_axis.shape[0])
    return rows, columns


def aperture_flux_e(observation: Observation, stamp_e: FloatArray) -> float:
    """Return the sum in the planet's aperture on a stamp."""
    planet = next(k for k, source in enumerate(observation.truth.sources) if source.kind == "planet")
    rows, columns = stamp_of(observation)
    y, x = observation.truth.y_pixel[planet] - rows.start, observation.truth.x_pixel[planet] - columns.start
    row, column = round(y), round(x)
    geometry = observation.psf.geometry
    weights = overlap_weights(geometry.aperture_radius_arcsec / geometry.pixel_scale_arcsec, y - row, x - column)
    half = len(weights) // 2
    return float((weights * stamp_e[row - half : row + half + 1, column - half : column + half + 1]).sum())


def drawn_frames(observation: Observation) -> Drawn:
    """Draw and calibrate the frames of a visit, particles taken out, as ``cpic confirm`` does."""
    frames = validation.calibrated_frames(observation, cropped=True)
    usable = validation.cleaned(frames)[1] if frames.detector.switches.cosmic_rays else frames.usable
    return Drawn(validation.filled(frames.electrons, usable)[0], usable)


def both_visits(case: FixedScene, setup: Setup) -> tuple[Observation, Observation]:
    """Return the science and reference visit, with new light of field stars: work that is timed begins without it."""
    forget_starlight()
    return visit(case, setup), visit(case, setup, role="reference")


def worked(case: FixedScene, setup: Setup, visits: tuple[Observation, Observation] | None = None) -> Work:
    """Do the whole work once.

    Parameters
    ----------
    case : FixedScene
    setup : Setup
    visits : tuple of Observation, optional
        Science and reference visit where they are there already.

    Returns
    -------
    Work

    Raises
    ------
    NotApplicable
        If the scene does not allow this way.
    """
    science, reference = visits or both_visits(case, setup)
    if setup.draw == "sums":
        try:
            epochs = setup.n_epochs(case)
            sums = [hole_stacks(observed, epochs=epochs).draw(summed=True)[0] for observed in (science, reference)]
        except InputError as error:
            raise NotApplicable(error.hint or str(error)) from None
        return Work(science, aperture_flux_e(science, sums[0] - sums[1]), ())
    drawn = tuple(drawn_frames(observed) for observed in (science, reference))
    means = [part.electrons.mean(axis=0) for part in drawn]
    return Work(science, case.n_frames * aperture_flux_e(science, means[0] - means[1]), drawn)


_LEAST_COVERED = 0.4


class _Noiseless(Observation):
    """An observation whose one frame is the expectation."""

    def frame(self, index: int) -> Frame:
        return Frame(adu=cast(Any, self.expected), mask=np.zeros(self.shape, dtype=np.uint8))


def expected_flux_e(case: FixedScene, setup: Setup, shown: Observation, bare_e_s: FloatArray) -> float:
    """Return the planet's aperture in the expected visit: with the planet minus without it, no noise.

    Frames are calibrated as noisy ones are; the expectation of sums is divided by the gain alone.

    Parameters
    ----------
    case : FixedScene
    setup : Setup
    shown : Observation
        Science visit.
    bare_e_s : ndarray
        What `light_without` makes.
    """
    bare = replace(shown, light=replace(shown.light, static_e_s=bare_e_s))
    return case.n_frames * aperture_flux_e(shown, _calibrated(shown, setup) - _calibrated(bare, setup))


def light_without(case: FixedScene, setup: Setup) -> FloatArray:
    """Return the electrons per second of everything but the central star and the planets."""
    return visit(case, setup, planets=False, n_frames=1, epochs=1).light.static_e_s


def _calibrated(shown: Observation, setup: Setup) -> FloatArray:
    if setup.draw == "frames":
        values = {item.name: getattr(shown, item.name) for item in dataclasses.fields(shown) if item.init}
        return np.asarray(calibrated_frames(_Noiseless(**values | {"n_frames": 1}), cropped=True).electrons[0])
    gain = shown.instrument.channel(shown.camera).detector.gain_e_adu
    return shown.expected[stamp_of(shown)] * (gain / shown.em_gain)


def white_of_frames(places: Places, drawn: Sequence[Drawn]) -> FloatArray:
    """Return aperture sums' variance from frame to frame at the planet's place, one value a frame, e-^2 of one.

    Every aperture of the hole counts, scaled to the planet's place as closed forms expect (`Places.level`).

    Frames that lose a pixel count for less: a pixel that was seen in the fraction ``c`` of the frames has ``1 / c``
    times the variance in their filled mean.
    """
    weights, samples = places.weights, []
    for part in drawn:
        n = len(part.electrons)
        covered = part.usable.mean(axis=0)
        kept = aperture_sums(covered, weights) / weights.sum()
        chosen = places.white & (kept > _LEAST_COVERED)
        if not chosen.any():
            raise NotApplicable("a limit or particles void every aperture of the hole")
        left = np.where(part.usable, part.electrons - part.electrons.mean(axis=0), 0.0) * (n / (n - 1.0)) ** 0.5
        squares = aperture_sums(left, weights)[:, chosen] ** 2 * (places.level[chosen] / kept[chosen] ** 2)
        samples.append(squares.mean(axis=1))
    return np.concatenate(samples)


def white_of_sums(case: FixedScene, setup: Setup, places: Places, n_draws: int) -> FloatArray:
    """Return the same from sums of frames, one value a draw: draws less what they are expected to be.

    Parameters
    ----------
    case : FixedScene
    setup : Setup
    places : Places
    n_draws : int
        Draws of each planet.
    """
    observed = visit(case, setup)
    stacks = hole_stacks(observed, epochs=1)
    dark_e = pedestal_e(observed.instrument.detector_of(case.band), case.exposure_s)
    samples = []
    for number in range(n_draws):
        mean = (stacks.mean_rates(number)[0] * case.exposure_s + dark_e) * case.n_frames
        left = np.where(stacks.region, stacks.draw(number)[0] - mean, 0.0)
        squares = aperture_sums(left, places.weights) ** 2 * places.level
        samples.append(squares[places.white].mean() / case.n_frames)
    return np.array(samples)


def own_noise_e2(case: FixedScene, setup: Setup, places: Places, flux_e: float) -> float:
    """Return the variance that the planet's own light adds to its aperture in the visit, e-^2."""
    noise = FrameNoise.of(setup.instrument(case).detector_of(case.band), case.em_gain, case.exposure_s)
    return noise.factor2 * noise.photons * places.source_noise_fraction * flux_e


def speckle_samples(case: FixedScene, setup: Setup, places: Places, n_pairs: int) -> FloatArray:
    """Return the variance of aperture sums that subtracting the references leaves, one value a pair, (e-/s)^2.

    Both visits have one wavefront; `walk_samples` tells what more of them change.
    """
    return _residuals(case, setup, places, setup.knobs, 1, n_pairs)


def walk_samples(case: FixedScene, setup: Setup, places: Places, n_pairs: int) -> tuple[FloatArray, FloatArray]:
    """Return the same at the cheapest knobs: at the way's epochs, and at one epoch with the same offsets."""
    cheap, count = FIDELITIES["quick"], setup.n_epochs(case)
    one = _residuals(case, setup, places, cheap, 1, n_pairs)
    return (one if count == 1 else _residuals(case, setup, places, cheap, count, n_pairs)), one


def _residuals(case: FixedScene, setup: Setup, places: Places, knobs: Knobs, epochs: int, n_pairs: int) -> FloatArray:
    instrument, scene = setup.instrument(case), setup.scene(case)
    if instrument.drift.visit_nm == 0 and instrument.drift.walk_nm_per_sqrt_hour == 0:
        return np.zeros(n_pairs)
    annulus, weights = places.annulus, places.weights
    psf: Psf = single_band_psf(case.band, fidelity=knobs, instrument=instrument)
    rows, columns = (np.flatnonzero(annulus.any(axis=axis)) for axis in (1, 0))
    offset = centred_axis(len(annulus), psf.imager.pixel_scale_arcsec)
    grid = psf.imager.focal_grid(*(psf.imager.axis(offset[part], masked=True) for part in (rows, columns)))
    cadence_s = (case.exposure_s + instrument.detector_of(case.band).readout_s) * case.n_frames / epochs
    samples = []
    for number in range(n_pairs):
        means = []
        for role in ("science", "reference"):
            path = (scene.name, "SCI", role, case.band, number)
            streams = (stream(SEED, *path, part) for part in ("visit", "walk"))
            means.append(visit_frames(grid, instrument.drift, epochs, cadence_s, *streams).mean(axis=0))
        left = np.zeros(annulus.shape)
        left[np.ix_(rows, columns)] = means[0] - means[1]
        sums = aperture_sums(left, weights)[places.near] - left[annulus].mean() * weights.sum()
        samples.append((sums**2).mean())
    return np.array(samples) * places.star_e_s**2


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
        wall, cpu = _block(job, calls)
        spent += wall
        if wall < _BLOCK_S and calls == 1:
            calls = max(2, int(1.2 * _BLOCK_S / max(wall, 1e-7)))
            continue
        times.append((wall / calls, cpu / calls))
    wall_s, cpu_s = min(times)
    return {"wall_s": wall_s, "cpu_s": cpu_s, "peak_memory_mb": peak_memory_mb(), "repeats": len(times)}


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


def measured_rows(
    case: FixedScene,
    points: Sequence[Point],
    effort: Effort,
    machine: str,
    launched_s: float,
) -> list[TradeoffRow]:
    """Measure points of one group on a scene, one after the other in this process.

    Every way is timed after its first call; those that change one thing of the reference are called once, and take the
    light of the reference, and its time, where they leave the light as it is.

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
    shared = _Shared(case, effort) if points[0].shares_process else None

    def times(job: Callable[[], object], first: Callable[[], object] | None = None) -> dict[str, Any]:
        (first or job)()
        cold_s = time.monotonic() - launched_s
        return {"cold_s": cold_s} | timed(job, budget_s=effort.budget_s)

    rows = []
    for point in points:
        predicted: dict[Any, float] = {}
        try:
            if shared is not None:
                found = shared.measured(point)
            elif point.group == "closed_form":
                found = _closed_form(closed_form(case), point.n_cases, times)
            elif case.is_programme:
                found = _programme(case, point, effort, times)
            else:
                found = _single(case, point, effort, times, predicted)
            found["status"] = "ok"
        except NotApplicable as error:
            found = {"status": "invalid", "reason": error.reason, "message": str(error)}
        about = {"title": point.title, "group": point.group, "n_frames": case.n_frames, "predicted_error": predicted}
        about |= {"machine": machine, "version": __version__}
        rows.append(TradeoffRow(scene=case.name, point=point.name, **about, **found))
    return rows


def _closed_form(question: ClosedForm, n_cases: int, times: Callable[..., dict[str, Any]]) -> dict[str, Any]:
    told: list[dict[str, float]] = []
    found = times(lambda: question.noise(n_cases), lambda: told.append(question.answer()))
    samples = {"whole_e2": [told[0]["white_e2"]], "fixed_speckle_e2": [told[0]["speckle_e2"]]}
    one = {name: found[name] / n_cases for name in ("wall_s", "cpu_s")}
    return found | one | {"flux_e": told[0]["flux_e"], "samples": samples}


def _programme(case: FixedScene, point: Point, effort: Effort, times: Callable[..., dict[str, Any]]) -> dict[str, Any]:
    """Time one realisation of a programme, its set-up included, and draw more of them."""
    held: list[Any] = []

    def job() -> None:
        how, measured = images_of_programme(case, point)
        held[:] = how, measured, measured(0)

    found = times(job)
    how, measured, first = held
    count = effort.realisations if how.draw == "sums" else max(2, effort.visits_by_frames // case.visits)
    contrast, contrast_error, _ = contrasts_of([first, *map(measured, range(1, count))])
    question = closed_form(case)
    return found | {
        "flux_e": float(contrast.mean()) / question.contrast * question.answer()["flux_e"],
        "settings": _settings(how, "draw", "region", "epochs", "knobs"),
        "samples": {"contrast": _listed(contrast), "contrast_error": _listed(contrast_error)},
    }


def _single(
    case: FixedScene, point: Point, effort: Effort, times: Callable[..., dict[str, Any]], predicted: dict[Any, float]
) -> dict[str, Any]:
    """Time a single visit with its reference; ``predicted`` is filled with what the ledger says of a dial."""
    held: list[tuple[Setup, Work]] = []

    def job() -> None:
        setup = point.setup
        if setup is None:
            choice = choice_of(case, dial_of(point.fidelity, point.tolerance))
            # A size without a bound is told by the message alone.
            predicted.update((name, size) for name, size in choice.predicted_error.items() if math.isfinite(size))
            if choice.outcome.status is not Status.OK:
                raise NotApplicable(choice.outcome.message, choice.outcome.reason.value)
            setup = chosen_by(case, choice)
        held[:] = [(setup, worked(case, setup))]

    found = times(job)
    return found | _imaged(case, point, *held[0], effort, Places.of(case))


class _Shared:
    """Ways that change one thing of the reference, with its light once it is needed."""

    def __init__(self, case: FixedScene, effort: Effort) -> None:
        self.case, self.effort, self.base = case, effort, reference_setup(case)
        worked(case, replace(self.base, region="hole", epochs=1))  # compiles and reads what all of them need
        self.places = Places.of(case)

    @functools.cached_property
    def light(self) -> tuple[tuple[float, float], tuple[Observation, Observation], FloatArray]:
        """Wall clock and processor time of the reference's light, its visits, and their light without the planet."""
        visits: list[tuple[Observation, Observation]] = []
        times = _block(lambda: visits.append(both_visits(self.case, self.base)), 1)
        return times, visits[0], light_without(self.case, self.base)

    def measured(self, point: Point) -> dict[str, Any]:
        """Do the work once, of the light of the reference or with light of its own."""
        case, setup, places, held = self.case, point.setup, self.places, []
        assert setup is not None  # of knobs and effects
        if point.light_changes:
            found = timed(lambda: held.append(worked(case, setup)), budget_s=0.0)
            return found | _imaged(case, point, setup, held[0], self.effort, places)
        (wall_s, cpu_s), visits, bare_e_s = self.light
        science, reference = (replace(seen, instrument=setup.instrument(case)) for seen in visits)
        found = timed(lambda: held.append(worked(case, setup, (science, reference))), budget_s=0.0)
        found |= {"wall_s": found["wall_s"] + wall_s, "cpu_s": found["cpu_s"] + cpu_s}
        samples = {"white_e2": white_of_frames(places, held[0].drawn)}
        return found | _of_images(case, setup, held[0], samples, places, bare_e_s)


def _imaged(case: FixedScene, point: Point, setup: Setup, work: Work, effort: Effort, places: Places) -> dict[str, Any]:
    """Return what a row of images says, with what its noise is measured from."""
    base, is_reference = reference_setup(case), point.name == REFERENCE
    samples: dict[str, FloatArray] = {}
    if work.drawn:
        samples["white_e2"] = white_of_frames(places, work.drawn)
    else:
        samples["white_e2"] = white_of_sums(case, setup, places, effort.draws)
    # Windows and whole frames have different random numbers, and sums others again: more of them where they differ.
    if work.drawn and effort.more_frames > 1 and (is_reference or setup.region == "hole"):
        # Another realisation, at one wavefront: more of the same noise.
        longer = visit(case, setup, n_frames=effort.more_frames, epochs=1, realisation=1)
        samples["more_white_e2"] = white_of_frames(places, (drawn_frames(longer),))
    # Speckles where optics or drift differ from the reference's, and the walk where the epochs do.
    if is_reference or setup.knobs != base.knobs or setup.drift != base.drift:
        samples["speckle_e2_s2"] = speckle_samples(case, setup, places, effort.pairs)
    if is_reference or setup.n_epochs(case) != base.n_epochs(case):
        samples["walk_e2_s2"], samples["one_epoch_e2_s2"] = walk_samples(case, setup, places, effort.walk_pairs)
    return _of_images(case, setup, work, samples, places, light_without(case, setup))


def _of_images(
    case: FixedScene, setup: Setup, work: Work, samples: dict[str, FloatArray], places: Places, bare_e_s: FloatArray
) -> dict[str, Any]:
    flux_e = expected_flux_e(case, setup, work.science, bare_e_s)
    names = ("draw", "region", "epochs", "knobs", "switches", "left_out", "sky", "drift", "scene_model")
    settings = _settings(setup, *names) | {"epochs": setup.n_epochs(case)}
    listed = {name: _listed(values) for name, values in samples.items()}
    listed["own_e2"] = [own_noise_e2(case, setup, places, flux_e)]
    return {"flux_e": flux_e, "settings": settings, "samples": listed}


def _settings(how: Setup | Modelling, *names: str) -> dict[str, Any]:
    plain = {"knobs": how.knobs.model_dump(mode="json"), "left_out": list(how.left_out)}
    return {name: plain.get(name, getattr(how, name)) for name in names}


def _listed(values: FloatArray) -> list[float]:
    """Return seven digits of each: enough to compare them pair by pair."""
    return [float(f"{value:.7g}") for value in values]


FLUX_LIMIT = 1e-9
"""Rounding of the difference of two expected images, relative to a planet."""


@dataclass(frozen=True)
class _Ratio:
    """A mean or a ratio, and its standard error."""

    value: float
    error: float

    @classmethod
    def of(cls, values: Sequence[float] | FloatArray) -> Self:
        """Return the mean of samples."""
        mean = float(np.mean(values))
        return cls(mean, mean * _relative(values))

    def over(self, other: Self) -> Self:
        """Return the ratio to another one, whose samples have nothing to do with these."""
        if not other.value > 0:
            return type(self)(1.0, 0.0)
        value = self.value / other.value
        own = self.error / self.value if self.value > 0 else 0.0
        return type(self)(value, value * math.hypot(own, other.error / other.value))


def compared(rows: Iterable[TradeoffRow], *, exposure_s: float) -> list[TradeoffRow]:
    """Return the rows of one scene with their errors; None where there is no reference to compare with.

    Parameters
    ----------
    rows : iterable of TradeoffRow
        Of one scene.
    exposure_s : float
        Of a frame.

    Returns
    -------
    list of TradeoffRow

    Notes
    -----
    ``variance = 2 N white + own + (N t)^2 speckle``: science and reference visit of ``N`` frames each, the planet's own
    light, and what subtraction leaves of the star. A part whose random numbers are those of the reference, frame by
    frame or pair by pair, is compared with it sample by sample; the others carry the errors of both.
    """
    every = list(rows)
    best = next((row for row in every if row.point == REFERENCE and row.status == "ok"), None)
    if best is None:
        return [row.model_copy(update=dict.fromkeys(_ERRORS)) for row in every]
    return [_one(row, best, exposure_s) if row.status == "ok" else row for row in every]


_ERRORS = ("variance_e2", "snr", "flux_error", "flux_uncertainty", "snr_error", "snr_uncertainty")


def _one(row: TradeoffRow, best: TradeoffRow, exposure_s: float) -> TradeoffRow:
    assert row.flux_e is not None  # as ok says
    assert best.flux_e is not None
    if "contrast" in best.samples:
        return compared_programme(row, best)
    white_best, speckle_best = _white(best), _speckle(best, best).value * (best.n_frames * exposure_s) ** 2
    parts = np.array([2.0 * best.n_frames * white_best.value, best.samples["own_e2"][0], speckle_best])
    whole = float(parts.sum())
    if row.group == "closed_form":
        variance = row.samples["whole_e2"][0] + row.samples["fixed_speckle_e2"][0]
        error = _variance_error(parts, white_best.error / white_best.value, _relative(best.samples["speckle_e2_s2"]))
    else:
        white, ratio = _white_ratio(row, best), _speckle(row, best).over(_speckle(best, best))
        new = parts * [white.value, 1.0, ratio.value]
        new[1] = row.samples["own_e2"][0]
        variance = float(new.sum())
        error = _variance_error(new, white.error / max(white.value, 1e-300), ratio.error / max(ratio.value, 1e-300))
    flux, noise = row.flux_e / best.flux_e, math.sqrt(variance / whole)
    return row.model_copy(
        update={
            "variance_e2": variance,
            "snr": row.flux_e / math.sqrt(variance),
            "flux_error": flux - 1.0,
            "flux_uncertainty": 0.0 if row is best else FLUX_LIMIT,
            "snr_error": flux / noise - 1.0,
            "snr_uncertainty": 0.0 if row is best else flux / noise * 0.5 * error,
        }
    )


def _variance_error(parts: FloatArray, white: float, speckle: float) -> float:
    return float(np.hypot(parts[0] * white, parts[2] * speckle) / parts.sum())


def _relative(values: Sequence[float] | FloatArray) -> float:
    array = np.asarray(values, float)
    if array.size < 2 or not array.mean() > 0:
        return 0.0
    return float(array.std(ddof=1) / array.mean() / math.sqrt(array.size))


def _white(row: TradeoffRow) -> _Ratio:
    return _Ratio.of([*row.samples["white_e2"], *row.samples.get("more_white_e2", [])])


def _white_ratio(row: TradeoffRow, best: TradeoffRow) -> _Ratio:
    """Return the white noise over the reference's: frame by frame where the frames have the same random numbers."""
    ours, theirs = row.samples["white_e2"], best.samples["white_e2"]
    alike = all(row.settings.get(key) == best.settings.get(key) for key in ("draw", "region"))
    return _paired(ours, theirs) if alike and len(ours) == len(theirs) else _white(row).over(_white(best))


def _speckle(row: TradeoffRow, best: TradeoffRow) -> _Ratio:
    """Return the variance of the residual of the star, (e-/s)^2; its error is that of the ratio to the reference.

    What a row does not hold is as in the reference.
    """
    samples, others = row.samples, best.samples
    fixed = samples.get("speckle_e2_s2", others["speckle_e2_s2"])
    walk, one = (samples.get(name, others[name]) for name in ("walk_e2_s2", "one_epoch_e2_s2"))
    epochs = float(np.mean(walk) / np.mean(one)) if np.mean(one) > 0 else 1.0
    value = float(np.mean(fixed)) * epochs
    if not value > 0:
        return _Ratio(0.0, 0.0)
    knobs, moved = _paired(fixed, others["speckle_e2_s2"]), _paired(walk, others["walk_e2_s2"])
    return _Ratio(value, value * math.hypot(knobs.error / knobs.value, moved.error / moved.value))


def _paired(ours: Sequence[float], theirs: Sequence[float]) -> _Ratio:
    """Return the ratio of two means of paired samples."""
    first, second = np.asarray(ours, float), np.asarray(theirs, float)
    if len(first) != len(second):
        return _Ratio.of(first).over(_Ratio.of(second))
    value = float(first.mean() / second.mean())
    difference = first / first.mean() - second / second.mean() if value > 0 else np.zeros(2)
    return _Ratio(value, value * float(difference.std(ddof=1)) / math.sqrt(difference.size))


def speed_ups(rows: Iterable[TradeoffRow], *, beside: str = "etc") -> dict[str, float]:
    """Return the wall clock of the reference over that of another way on the same machine, by scene."""
    times: dict[str, dict[str, TradeoffRow]] = {}
    for row in rows:
        if row.point in (REFERENCE, beside) and row.wall_s:
            times.setdefault(row.scene, {})[row.point] = row
    return {
        scene: (pair[REFERENCE].wall_s or 0.0) / (pair[beside].wall_s or math.inf)
        for scene, pair in times.items()
        if len(pair) == 2 and pair[REFERENCE].machine == pair[beside].machine
    }


def ratio_of_programmes(
    ours: Mapping[str, Sequence[float]],
    theirs: Mapping[str, Sequence[float]],
    what: Callable[..., float],
    *,
    paired: bool,
) -> tuple[float, float]:
    """Return the ratio of what two series of realisations say, and its error by leaving one out (jackknife).

    Parameters
    ----------
    ours, theirs : dict
        ``contrast`` and ``contrast_error``, one value a realisation.
    what : callable
        Of both: `flux_of_programme` or `snr_of_programme`.
    paired : bool
        Whether the random numbers are the same, realisation by realisation, and drop out of the ratio.
    """
    (whole, parts), (other, others) = (_left_out(series, what) for series in (ours, theirs))
    ratio = whole / other
    if paired and len(parts) == len(others):
        return ratio, _jackknife(parts / others)
    return ratio, ratio * math.hypot(_jackknife(parts) / whole, _jackknife(others) / other)


def flux_of_programme(contrast: FloatArray, contrast_error: FloatArray) -> float:
    """Return the mean contrast."""
    return float(contrast.mean())


def snr_of_programme(contrast: FloatArray, contrast_error: FloatArray) -> float:
    """Return the mean contrast over the quadratic mean of its errors (`cpic_planner.validation.mean_snr`)."""
    return float(contrast.mean() / np.sqrt((contrast_error**2).mean()))


def compared_programme(row: TradeoffRow, best: TradeoffRow) -> TradeoffRow:
    """Compare a row with the many realisations of the reference."""
    whats, names = (flux_of_programme, snr_of_programme), ("flux", "snr")
    if row.group == "closed_form":
        assert row.flux_e is not None
        variance = row.samples["whole_e2"][0]
        snr = row.flux_e / math.sqrt(variance)
        said = row.flux_e / (best.flux_e or math.nan), snr / snr_of_programme(*_series(best))
        own = [
            ratio_of_programmes(best.samples, best.samples, what, paired=False)[1] / math.sqrt(2.0) for what in whats
        ]
        ratios = [(value, value * error) for value, error in zip(said, own, strict=True)]
    else:
        snr = snr_of_programme(*_series(row))
        variance = ((row.flux_e or 0.0) / snr) ** 2
        paired = row.settings["draw"] == best.settings["draw"]
        ratios = [ratio_of_programmes(row.samples, best.samples, what, paired=paired) for what in whats]
    errors = {f"{name}_error": ratio - 1.0 for name, (ratio, _) in zip(names, ratios, strict=True)}
    errors |= {f"{name}_uncertainty": error for name, (_, error) in zip(names, ratios, strict=True)}
    return row.model_copy(update={"variance_e2": variance, "snr": snr, **errors})


def _series(row: TradeoffRow) -> FloatArray:
    return np.array([row.samples["contrast"], row.samples["contrast_error"]])


def _left_out(series: Mapping[str, Sequence[float]], what: Callable[..., float]) -> tuple[float, FloatArray]:
    values = np.array([series["contrast"], series["contrast_error"]])
    return what(*values), np.array([what(*np.delete(values, k, axis=1)) for k in range(values.shape[1])])


def _jackknife(parts: FloatArray) -> float:
    n = len(parts)
    return float(np.sqrt((n - 1) / n * np.sum((parts - parts.mean()) ** 2)))
