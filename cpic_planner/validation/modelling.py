"""Estimate the cost of the images of a task before any is made.

How the images of a task are made: sums or frames, hole or whole frames, which knobs, what is left out.
"""

import dataclasses
import math
from dataclasses import dataclass
from typing import Any, Literal

from cpic_core import Outcome
from cpic_planner.queries import Strategy
from cpic_planner.results import EffectRecord, ModellingRecord
from cpic_planner.validation.libraries import library_plan
from cpic_planner.validation.task import ConfirmTask, images_of
from simulator.config import Instrument, Planet, Scene, validate
from simulator.imaging import LARGEST_NM, RMS_ERROR, expands, psf_metrics
from simulator.knobs import Dial, Knobs
from simulator.ledger import MAX_EPOCHS, SUM_EPOCHS, Choice, EffectRow, choose, forecast
from simulator.target import detector_to_sky

# Processor times on the core of `cpic_planner.jobs.job`, bands F520 to F850, 4 to 463 frames, 1 to 30 realisations,
# every tier: within a factor of 1.5 there.
_SETUP_S, _SETUP_STAMPS = 1.6, 25.0  # visits, star off the mask, subjects: a fixed part, and propagations
_SUMS_S = 0.03  # of one realisation of both roles, reduced, searched and measured
_VISIT_S = 1e-3  # of one visit from the expansion of its light, drawn
_FRAME_S = {"hole": 9e-3, "full": 0.085}  # drawn, calibrated, cleaned
# An audit runs a part of the frames with a plain twin each, two sequences of either role at least; and propagations.
_AUDIT_SHARE, _AUDIT_LEAST, _AUDIT_FRAME_S, _AUDIT_STAMPS = 0.2, 96, 1.5e-2, 0.2
_STAMP_S, _STAMP_S_PER_PRODUCT = 1e-3, 8e-11  # of one propagation of the star
_HOLE_SHARE = 0.4  # of the stamp, in rows and columns that the hole has
_BASE_MB, _WHOLE_FRAME_MB, _STACK_BYTES = 450.0, 200.0, 32.0


@dataclass(frozen=True)
class TaskCost:
    """Expected cost of one task.

    Attributes
    ----------
    work_s : float
        Processor time.
    realisations : int
        That are made.
    frames : int
        That are drawn one by one.
    memory_mb : float
    """

    work_s: float
    realisations: int
    frames: int
    memory_mb: float


def task_cost(task: ConfirmTask) -> TaskCost:
    """Return the expected cost of the images of a task and of measuring them.

    Notes
    -----
    Sums of frames are taken at their word: where a limit turns out to be reached in the hole, two realisations run
    frame by frame instead.
    """
    how = modelling_of(task)
    frames = round(task.n_all_frames)
    stamp_s = _stamp_s(how.knobs)
    work = _SETUP_S + _SETUP_STAMPS * stamp_s
    one_by_one, largest = 0, 0
    if how.draw == "sums":
        runs = task.realisations
        visits = task.visits + task.reference_visits
        light_s = min(how.epochs, task.n_frames) * _HOLE_SHARE * stamp_s if how.exact else 0.0
        work += runs * (_SUMS_S + visits * (_VISIT_S + light_s))
        if task.audit:
            one_by_one = min(max(round(_AUDIT_SHARE * frames), _AUDIT_LEAST), frames)
            largest = min(task.n_frames, _AUDIT_LEAST)
            work += one_by_one * (_AUDIT_FRAME_S + _AUDIT_STAMPS * stamp_s)
    else:
        runs = how.runs_by_frames(task.realisations)
        one_by_one, largest = runs * frames, task.n_frames
        work += runs * _frames_s(how, how.region, task, frames, stamp_s)
    stack = largest * how.knobs.stamp_pixels**2 * 2 * _STACK_BYTES / 1e6
    whole = _WHOLE_FRAME_MB if how.draw == "frames" and how.region == "full" else 0.0
    return TaskCost(work, runs, one_by_one, _BASE_MB + whole + stack)


def _frames_s(how: "Modelling", region: str, task: ConfirmTask, frames: int, stamp_s: float) -> float:
    visits = task.visits + task.reference_visits
    return visits * min(how.epochs, task.n_frames) * stamp_s + frames * _FRAME_S[region]


def _stamp_s(knobs: Knobs) -> float:
    """Return the seconds of one propagation of the star onto a stamp: two matrix products a wavelength."""
    nodes, pupil = knobs.stamp_pixels * knobs.pixel_nodes, knobs.pupil_samples
    products = knobs.wavelength_nodes * (nodes * pupil**2 + nodes**2 * pupil)
    return _STAMP_S + _STAMP_S_PER_PRODUCT * products


# Not for the ledger to decide: the noise and the limits that images are made to measure, which save next to nothing,
# and the pixels, which are those around the hole, or all for the reference.
_GIVEN = (
    *("hole_region", "photon_noise", "em_register", "read_noise", "dark", "clock_charge", "register_clock_charge"),
    *("blooming", "register_full_well", "sky", "smear"),
)
# Whether they are reached the images themselves decide, pixel by pixel
# (`simulator.observing.hole_stack.hole_stackable`); where they are, every frame is drawn.
LIMITS = ("blooming", "register_full_well")
_SEARCHED, _SEARCHED_MAG = "what is searched for", 20.0
MAX_RUNS_OF_FRAMES = 2
"""Realisations where every frame has to be run, but for the reference."""


@dataclass(frozen=True, kw_only=True)
class Modelling(Choice):
    """The choice of the ledger for the images of a task, with the dial that it follows; made by `modelling_of`.

    Attributes
    ----------
    dial : Dial
        With the tolerances of what is measured.
    exact : bool
        Whether sums have a transform of each wavefront, and not the expansion of `simulator.imaging.visit_light`.
    """

    dial: Dial
    exact: bool

    def instrument(self, instrument: Instrument) -> Instrument:
        """Return the camera with what is modelled of it."""
        seen = self.drifting(instrument)
        if self.draw == "sums":
            return images_of(seen)
        if seen.coronagraph.table is not None:  # no shadow of a mask tells the level of a frame: it counts as known
            seen = seen.switched(dict.fromkeys(("bias_drift", "interference"), False))
        return seen.switched(self.switches) if self.switches else seen

    def scene(self, scene: Scene) -> Scene:
        """Return the sources that are modelled."""
        kept = {
            kind: tuple(body for body in getattr(scene, kind) if body.name not in self.left_out)
            for kind in ("planets", "stars", "extended")
        }
        return scene.model_copy(update=kept) if self.left_out else scene

    def whole(self) -> "Modelling":
        """Return every frame with every effect, by the same knobs."""
        epochs = max(self.epochs, MAX_EPOCHS)
        return dataclasses.replace(self, draw="frames", epochs=epochs, switches={}, left_out=(), still=())

    def runs_by_frames(self, realisations: int) -> int:
        """Return how many realisations are drawn frame by frame: all of them for the reference alone."""
        return realisations if self.dial.fidelity == "reference" else min(realisations, MAX_RUNS_OF_FRAMES)

    def record(self) -> ModellingRecord:
        """Return the cost for the results."""
        return modelling_record(self, fidelity=self.dial.fidelity, tolerance=self.dial.tolerance)


def modelling_record(choice: Choice, **given: Any) -> ModellingRecord:
    """Return a choice of the ledger as results hold it, with the fields that it does not have, or has otherwise."""
    sizes = choice.predicted_error
    # A size that is no bound is none.
    errors = {key: None if size is None or not math.isfinite(size) else float(size) for key, size in sizes.items()}
    effects = [EffectRecord.of(row) for row in choice.rows]
    return ModellingRecord.of(choice, predicted_error=errors, effects=effects, **given)


def modelling_of(task: ConfirmTask, *, by_frames: bool = False) -> Modelling:
    """Decide how the images of a task are made, from its dial and the effect ledger of its scene.

    Parameters
    ----------
    task : ConfirmTask
    by_frames : bool
        Every frame has to be drawn, whatever the ledger says: sums cannot stand for them.

    Notes
    -----
    Sizes are those after the reduction that follows: flat, bias structure and flaws calibrated, particles rejected.
    Where nothing is measured but searched, they refer to a planet of 1e-8 at the middle of the hole.
    """
    instrument = validate(Instrument, task.simulator, where="instrument")
    strategy = validate(Strategy, task.strategy, where="strategy")
    scene = validate(Scene, task.scene, where="scene")
    plan = library_plan(strategy, scene, task.n_frames, visits=task.visits)
    dial = task.dial.of("planet_flux", "snr")
    shown, measured = plan.science_scene, tuple(task.planets)
    if not measured:
        shown, measured = _with_planet(shown, instrument, task.band)
    whole = all(value == 0 for value in dial.tolerance.values())
    limits = [name for name in LIMITS if getattr(instrument.detector_of(task.band).switches, name, False)]
    sizes = forecast(
        shown,
        instrument,
        band=task.band,
        exposure_s=task.exposure_s,
        n_frames=task.n_frames,
        em_gain=task.em_gain,
        roll_deg=plan.science["roll_deg"],
        planets=measured,
        reduced=True,
        full=whole,
        visits=task.visits,
        timing=task.timing,
        switches=None if by_frames or whole else dict.fromkeys(limits, False),
    )
    if not by_frames:
        sizes = dataclasses.replace(sizes, sums=Outcome.ok(0.0))
    choice = choose(sizes, dial, fixed=(*_GIVEN, "summed_frames") if by_frames else _GIVEN)
    rows = {row.key: row for row in choice.rows}
    why = "none is reached in the hole, and no charge flows into it"
    for name in () if by_frames or whole else limits:
        rows[name] = dataclasses.replace(rows[name], decision="kept", size=0.0, reason=why)
    # A tier that is too coarse is refused where images are asked for; who draws all the same gets what it stands for.
    counted = strategy.mode != "analogue"  # of whose counts only sums are drawn
    draw = choice.draw if by_frames or (choice.outcome.value is not None and not counted) else "sums"
    epochs = min(choice.epochs, SUM_EPOCHS) if draw == "sums" else choice.epochs
    visit_s = task.n_frames * (task.exposure_s + instrument.detector_of(task.band).readout_s)
    small, accepted = expands(instrument.drift, visit_s), dial.tolerance["snr"]
    exact = draw == "frames" or not small or accepted < RMS_ERROR
    if draw == "sums":
        why = f"an expansion in the error has the rms of aperture sums within {RMS_ERROR:.1%}"
        if exact:
            limit = f"the tolerance of {accepted:g}" if small else f"errors of {LARGEST_NM:g} nm rms"
            why = f"an expansion in the error does not hold beyond {limit}"
        size = 0.0 if exact else RMS_ERROR
        kept: Literal["kept", "skipped"] = "kept" if exact else "skipped"
        rows["transforms"] = EffectRow("transform of every wavefront", kept, why, "transforms", size)
    changed = {"draw": draw, "epochs": epochs, "rows": tuple(rows.values()), "dial": dial, "exact": exact}
    return Modelling(**vars(choice) | changed)


def _with_planet(scene: Scene, instrument: Instrument, band: str) -> tuple[Scene, tuple[str, ...]]:
    """Return a scene with the planet that a search is judged by, and its name."""
    middle = psf_metrics(instrument, band).zone.middle
    separation, pa_deg = detector_to_sky(*middle, parity=instrument.detector.parity)
    planet = Planet(
        name=_SEARCHED,
        spectrum="blackbody",
        teff_k=scene.cstar.teff_k or 5772.0,
        v_mag=scene.cstar.v_mag + _SEARCHED_MAG,
        separation_arcsec=float(separation),
        pa_deg=float(pa_deg),
    )
    return scene.model_copy(update={"planets": (*scene.planets, planet)}), (_SEARCHED,)
