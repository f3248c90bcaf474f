"""The task of a confirmation: scene, frames and predictions as plain data, how its images are made, and what they cost.

How they are made: sums or frames, hole or whole frames, which knobs, what is left out.
"""

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import asdict, replace
from typing import Any, Literal, Required, TypedDict, Unpack

import numpy as np

from cpic_core import Outcome, Reason, Record, Status, check_whole
from cpic_planner import etc
from cpic_planner.planets import span_days
from cpic_planner.queries import MAX_FRAMES, ReferencePlanet, SimulatorOverrides, Strategy
from cpic_planner.ranking import best_in_band, no_frame_status
from cpic_planner.results import BandConfirmation, EffectRecord, EtcAnswer, ModellingRecord
from cpic_planner.targets import Targets
from simulator.config import (
    MAX_FRAMES as MOST_FRAMES,
    Instrument,
    Planet,
    Scene,
    SceneStar,
    Timing,
    companion_of,
    validate,
)
from simulator.imaging import LARGEST_NM, RMS_ERROR, SceneModel, expands, psf_metrics
from simulator.knobs import Dial, Knobs, dial_of
from simulator.ledger import MAX_EPOCHS, NOT_IN_SUMS, SUM_EPOCHS, Choice, EffectRow, choose, forecast
from simulator.observing import Role
from simulator.products import mjd_of
from simulator.signal import exozodi_disc
from simulator.target import detector_to_sky

TOO_MANY = f"more than {MAX_FRAMES} frames a visit: give less time, more visits or longer exposures"
"""Why a programme has no images although it has frames."""
_REFUSALS = {
    Status.SATURATED: "every frame saturates",
    Status.UNREACHABLE: "the time holds no frame",
    Status.INVALID: TOO_MANY,
}


UNPREDICTED = (
    *("n_modes", "snr", "significance", "chance_blind", "chance_known_place", "verdict"),
    *("snr_full", "significance_full"),
)
"""Predictions of a planet that are not known for every reduction."""


class Frames(Record):
    """Frames of a science visit, and how many such visits are reduced together."""

    exposure_s: float
    n_frames: int
    em_gain: float
    visits: int = 1

    @staticmethod
    def of(answer: EtcAnswer) -> "Frames | None":
        """Return those of an answer of the calculator; None where it has no frame."""
        per_visit = answer.frames_per_visit or answer.n_frames
        if answer.exposure_s is None or not per_visit or answer.em_gain is None:
            return None
        return Frames(answer.exposure_s, per_visit, answer.em_gain, answer.visits or 1)


class ImageSettings(TypedDict, total=False):
    """The settings by which images are drawn.

    Attributes
    ----------
    seed : int
        Seed of all random streams; always given.
    fidelity, tolerance
        The dial (`simulator.knobs.dial_of`): ``quick``, ``standard`` or ``reference``, or the largest error of planet
        flux and SNR that is accepted, 0 to 0.5; ``standard`` without any.
    realisations : int
        Draws of drift and noise; 1 by default.
    audit : bool
        Whether one more realisation has every effect of single frames (`cpic_planner.validation.realise`); not by
        default.
    """

    seed: Required[int]
    fidelity: str | None
    tolerance: float | None
    realisations: int
    audit: bool


class ConfirmTask(Frames, kw_only=True):
    """One scene and its frames in one band, ready to be simulated anywhere: plain data only.

    Attributes
    ----------
    name, band : str
        Of the piece of work.
    simulator : dict
        Instrument of the images: the nominal one, altered where the simulator is overridden.
    scene : dict
        What the images show.
    strategy : dict
        How it is observed and reduced (`cpic_planner.etc.model.Strategy`).
    predictions : list of dict
        What `expected_of` says of each planet that is measured.
    planets : list of str
        Their names in the scene.
    seed, fidelity, tolerance, realisations, audit
        `ImageSettings`.
    reference_visits : int
        Visits that all the references are spread over.
    gap_s : float
        From the start of a science visit to that of the next, s.
    unused_s : float or None
        Part of the given wall time that the visits leave unused.
    chosen_for : str
        Planet for which visits and frames were chosen; empty where they were given.
    epoch_mjd : float
        Middle of the visits, MJD (UTC).
    roll_deg : float
        Roll of the observation, degrees; planets stand at the places that it gives them.
    files : dict or None
        Level-1 files that are measured in place of simulated images, by what they show
        (`cpic_planner.validation.level1.Level1Programme.files`).
    bare : bool
        Whether the scene is no more than the headers of these files say: nothing of its star's light is known.
    """

    name: str
    band: str
    simulator: dict[str, Any]
    scene: dict[str, Any]
    strategy: dict[str, Any]
    predictions: list[dict[str, Any]]
    planets: list[str]
    seed: int
    fidelity: str | None = None
    tolerance: float | None = None
    realisations: int = 1
    audit: bool = False
    reference_visits: int = 1
    gap_s: float = 0.0
    unused_s: float | None = None
    chosen_for: str = ""
    epoch_mjd: float = 0.0
    roll_deg: float = 0.0
    files: dict[str, Any] | None = None
    bare: bool = False

    @property
    def n_science_frames(self) -> int:
        """Science frames of all visits of one realisation."""
        return self.n_frames * self.visits

    @property
    def n_all_frames(self) -> float:
        """Science and reference frames of one realisation."""
        return self.n_science_frames * (1.0 + float(self.strategy["reference_ratio"]))

    @property
    def time_s(self) -> float:
        """Wall time of all visits, s."""
        return self.visits * (self.gap_s - 3600.0 * float(self.strategy["visit_gap_h"]))

    @property
    def timing(self) -> Timing:
        """When the visits are; of a single one, that its references follow at once."""
        return Timing(scheme=self.strategy["reference_scheme"], gap_s=self.gap_s if self.visits > 1 else None)

    @property
    def dial(self) -> Dial:
        """Speed against accuracy."""
        return dial_of(self.fidelity, self.tolerance)

    @property
    def key(self) -> str:
        """Name of the finished piece of work."""
        return f"{self.name} {self.band}"

    def to_dict(self) -> dict[str, Any]:
        """Return the plain dict."""
        return asdict(self)


def target_scene(
    target: Targets,
    planet: ReferencePlanet,
    separation_arcsec: float,
    distance_au: float,
    pa_deg: float = 315.0,
    *,
    exozodi_zodis: float = 0.0,
) -> Scene:
    """Return the scene of one star with its reference planet; see `star_scene`.

    The default position angle is that of the example of Zhu et al. 2025, on a diagonal of the hole.

    Parameters
    ----------
    target : Targets
    planet : ReferencePlanet
    separation_arcsec : float
        Projected separation from the star, arcsec, above 0.
    distance_au : float
        True distance between star and planet, au, above 0.
    pa_deg : float, optional
        Position angle of the planet, degrees east of north.
    exozodi_zodis : float, optional
        Dust around the star, in units of the solar system's.
    """
    body = Planet(
        name="reference planet",
        radius_rjup=planet.radius_rjup,
        distance_au=distance_au,
        phase_deg=planet.phase_deg,
        separation_arcsec=separation_arcsec,
        pa_deg=pa_deg,
        albedo=planet.albedo,
    )
    return star_scene(target, (body,), exozodi_zodis=exozodi_zodis)


def star_scene(target: Targets, planets: tuple[Planet, ...], *, name: str = "", exozodi_zodis: float = 0.0) -> Scene:
    """Return the scene of one star with planets, and its nearest known companion if that is near and located.

    Images of it are at roll 0: the companion stands where the target's roll puts it, as the planets have to.
    ``name`` is that of the scene, the star's by default; ``exozodi_zodis`` adds a face-on disc of dust
    (`simulator.signal.light`).

    Parameters
    ----------
    target : Targets
    planets : tuple of Planet
        Planets of the scene.
    name : str, optional
        Name of the scene.
    exozodi_zodis : float, optional
        Dust around the star, in units of the solar system's.
    """
    always = {key: float(getattr(target, key)[0]) for key in ("v_mag", "teff_k", "log_g", "metallicity")}
    columns = ("distance_pc", "luminosity_lsun", "ra_deg", "dec_deg")
    sometimes = {key: _known(getattr(target, key)[0]) for key in columns}
    star = SceneStar.model_validate({"name": str(target.name[0])} | always | sometimes)
    place = ("separation_arcsec", "pa_deg", "v_mag", "teff_k")
    seen = {key: _known(getattr(target, f"companion_{key}")[0]) for key in place}
    if seen["pa_deg"] is not None:
        seen["pa_deg"] = (seen["pa_deg"] - float(target.roll_deg)) % 360.0
    stars = tuple(SceneStar(**body) for body in companion_of(star.model_dump(), **seen))
    disc = exozodi_disc(exozodi_zodis)
    shown = {"planets": planets, "stars": stars, "extended": () if disc is None else (disc,)}
    return Scene(name=name or star.name, cstar=star, companions=target.companions, **shown)


def _known(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def expected_of(
    model: etc.EtcModel,
    target: Targets,
    band: str,
    place_arcsec: tuple[Any, Any],
    contrast: float,
    frames: Frames,
    roll_deg: float = 0.0,
) -> dict[str, Any]:
    """Return what the ETC expects of a planet in given frames.

    Parameters
    ----------
    model : EtcModel
    target : Targets
        One star.
    band : str
    place_arcsec : tuple
        Offsets x and y on the detector.
    contrast : float
    frames : Frames
    roll_deg : float
        At which the place is on the detector.

    Returns
    -------
    dict
        ``contrast``, ``separation_arcsec``, ``pa_deg``, ``threshold``,
        ``n_modes`` that the prediction is for, ``snr`` and ``significance`` of sums of frames, which no particle hits,
        with the ``verdict`` and the probabilities of a detection (``chance_blind``, ``chance_known_place``) that
        follow, and ``snr_full`` and ``significance_full`` with the frames that particles void; None of these for a
        reduction without a closed form.
    """
    x = np.asarray(place_arcsec[0], float).reshape(1, 1)
    y = np.asarray(place_arcsec[1], float).reshape(1, 1)
    faint = np.full((1, 1), contrast, dtype=np.float64)
    separation, pa_deg = detector_to_sky(x, y, roll_deg=roll_deg, parity=model.instrument.detector.parity)
    elements = model.metrics[band].resolution_elements(np.hypot(x, y))
    about = {
        "contrast": float(contrast),
        "separation_arcsec": float(separation[0, 0]),
        "pa_deg": float(pa_deg[0, 0]),
        "threshold": float(etc.threshold_array(elements, model.strategy.sigma)[0, 0]),
    }
    if not model.strategy.reduction.predicted:
        return about | dict.fromkeys(UNPREDICTED)
    sums = etc.build_model(images_of(model.instrument), [band], model.strategy)
    visits = etc.Programme.of(model.strategy, frames.visits, gap_s(model, band, frames))
    setting = frames.exposure_s, frames.n_frames, frames.em_gain
    expected = etc.prospect_of(sums, target, band, x, y, faint, setting, visits, moving=False)
    chances = expected.chances
    # Of a table the calculator counts whole pixels, and images what of them lies in the aperture.
    seen = expected
    if model.of_table:
        seen = etc.prospect_of(sums.measured(), target, band, x, y, faint, setting, visits, moving=False)
    noise, others = seen.noise, etc.aperture_rates(model.measured(), target, band, x, y, faint)
    full = etc.stack_noise(others, *setting, model.camera(band), model.strategy, expected.programme)
    at_place = model.strategy.search == "known_place"
    chance = float((chances.known_place if at_place else chances.blind)[0, 0])
    return about | {
        "n_modes": int(expected.programme.n_modes.max()),
        "snr": float(noise.snr[0, 0]),
        "significance": float(noise.significance[0, 0]),
        "chance_blind": _known(chances.blind[0, 0]),
        "chance_known_place": _known(chances.known_place[0, 0]),
        "verdict": etc.verdict_of(Status.OK, chance >= 0.5),
        "snr_full": float(full.snr[0, 0]),
        "significance_full": float(full.significance[0, 0]),
    }


def gap_s(model: etc.EtcModel, band: str, frames: Frames) -> float:
    """Return the time from the start of a science visit to that of the next, s."""
    visit_s = frames.n_frames * (frames.exposure_s + model.camera(band).readout_s)
    return float(model.time_s(visit_s)) + 3600.0 * model.strategy.visit_gap_h


def prepare_task(
    model: etc.EtcModel,
    target: Targets,
    band: str,
    *,
    time_s: float,
    planet: ReferencePlanet,
    frames: Frames | None = None,
    overrides: SimulatorOverrides | None = None,
    **settings: Unpack[ImageSettings],
) -> ConfirmTask | BandConfirmation:
    """Predict one band's reference planet where that band sees it best: a final refusal, or work to do.

    Parameters
    ----------
    model : EtcModel
    target : Targets
    band : str
        Name of a band of the instrument, such as ``F520``.
    time_s : float
        Wall time of all visits, s, overheads and reference frames included.
    planet : ReferencePlanet
    frames : Frames, optional
        Those that are taken, whose time is ``time_s``; the best ones of that time by default. They do not move the
        planet: it stands where the best ones see it best.
    overrides : SimulatorOverrides, optional
        What the images have otherwise.
    **settings
        `ImageSettings`; at least the seed.
    """
    best = best_in_band(model, target, band, time_s, planet)
    separation = float(best.separation_arcsec[0])
    # Two rolls put it to either side of the diagonal; the ETC counts one of them.
    pa_deg = etc.diagonal_pa_deg(model, target, band)
    given = frames is not None
    if frames is None and not 1 <= best.frames_per_visit[0] <= MAX_FRAMES:
        status, reason = no_frame_status(best, 0, model.camera(band))
        if best.frames_per_visit[0] > MAX_FRAMES:
            status, reason = Status.INVALID, Reason.TOO_MANY_FRAMES
        where = {"separation_arcsec": separation, "pa_deg": pa_deg, "true_contrast": float(best.contrast[0])}
        return not_observed(status, reason, _REFUSALS[status], band=band, **where)
    distance = float(etc.reference_distance_au(target, np.array([separation]), planet)[0, 0])
    if frames is None:
        per_visit, visits = int(best.frames_per_visit[0]), int(best.visits[0])
        frames = Frames(float(best.exposure_s[0]), per_visit, float(best.em_gain[0]), visits)
    # Dust is part of the scene: where the simulator's differs, it is in the images alone.
    zodis = (overrides or SimulatorOverrides()).instrument(model.instrument).sky.exozodi_zodis
    scene = target_scene(target, planet, separation, distance, pa_deg, exozodi_zodis=zodis)
    expected = expected_of(
        model, target, band, etc.planet_offsets(model, target, band, separation), float(best.contrast[0]), frames
    )
    when = target.date_utc
    made = task_of(model, scene, band, frames, [expected], overrides=overrides, start_utc=when, **settings)
    if given:
        return made
    return replace(made, unused_s=max(time_s - made.time_s, 0.0), chosen_for=made.planets[0])


def not_observed(status: Status, reason: Reason, message: str, **more: Any) -> BandConfirmation:
    """Return the answer for a planet of which no images are made.

    Parameters
    ----------
    status : Status
    reason : Reason
    message : str
        One sentence for people.
    **more
        Other fields of the answer; at least the band.
    """
    standing = {"status": status.value, "reason": reason.value, "message": message, "verdict": "not observed"}
    return BandConfirmation(**(standing | more))


def task_of(
    model: etc.EtcModel,
    scene: Scene,
    band: str,
    frames: Frames,
    predictions: Sequence[dict[str, Any]],
    *,
    planets: Sequence[str] | None = None,
    overrides: SimulatorOverrides | None = None,
    start_utc: str = "",
    **settings: Unpack[ImageSettings],
) -> ConfirmTask:
    """Return the work itself; what is overridden changes the images alone.

    All planets unless some are named, and the first visit begins with the mission unless ``start_utc`` is given. Its
    middle is half of `cpic_planner.planets.span_days` later.
    """
    altered = overrides or SimulatorOverrides()
    task = ConfirmTask(
        name=scene.name,
        band=band,
        simulator=altered.instrument(model.instrument).model_dump(mode="json"),
        scene=altered.scene(scene).model_dump(mode="json"),
        **asdict(frames),
        reference_visits=model.strategy.references_of(frames.visits),
        gap_s=gap_s(model, band, frames),
        strategy=model.strategy.model_dump(mode="json"),
        predictions=list(predictions),
        planets=[planet.name for planet in scene.planets] if planets is None else list(planets),
        **settings,
    )
    days = span_days(task.time_s, task.visits, model.strategy.visit_gap_h)
    return replace(task, epoch_mjd=mjd_of(start_utc or model.instrument.mission.start_utc) + 0.5 * float(days))


def images_of(instrument: Instrument) -> Instrument:
    """Return the instrument as sums of frames see it: without what only a full reduction can take out."""
    return instrument.switched(dict.fromkeys(NOT_IN_SUMS, False))


# Processor times on the core of `cpic_planner.jobs.job`, bands F520 to F850, 4 to 463 frames, 1 to 30 realisations,
# every tier: within a factor of 1.5 there.
_SETUP_S, _SETUP_STAMPS = 2.0, 25.0  # visits, star off the mask, subjects, curve: a fixed part, and propagations
_SUMS_S = 0.04  # of one realisation of both roles, reduced, searched, measured and fitted
_VISIT_S = 1e-3  # of one visit from the expansion of its light, drawn
_READ_S = 3e-2  # of a frame of a file, read and registered
_FRAME_S = {"hole": 9e-3, "full": 0.085}  # drawn, calibrated, cleaned
# An audit runs a part of the frames with a plain twin each, two sequences of either role at least; and propagations.
_AUDIT_SHARE, _AUDIT_LEAST, _AUDIT_FRAME_S, _AUDIT_STAMPS = 0.2, 96, 1.5e-2, 0.2
_STAMP_S, _STAMP_S_PER_PRODUCT = 1e-3, 8e-11  # of one propagation of the star
_HOLE_SHARE = 0.4  # of the stamp, in rows and columns that the hole has
_BASE_MB, _WHOLE_FRAME_MB, _STACK_BYTES = 450.0, 200.0, 32.0


class TaskCost(Record):
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
    frames = round(task.n_all_frames)
    if task.files is not None:
        return TaskCost(2.0 * _SETUP_S + frames * _READ_S, 1, 0, _BASE_MB)
    how = modelling_of(task)
    stamp_s = _stamp_s(how.knobs)
    work = _SETUP_S + _SETUP_STAMPS * stamp_s
    one_by_one, largest, visits = 0, 0, task.visits + task.reference_visits
    if how.draw == "sums":
        runs = task.realisations
        light_s = min(how.epochs, task.n_frames) * _HOLE_SHARE * stamp_s if how.exact else 0.0
        work += runs * (_SUMS_S + visits * (_VISIT_S + light_s))
        if task.audit:
            one_by_one = min(max(round(_AUDIT_SHARE * frames), _AUDIT_LEAST), frames)
            largest = min(task.n_frames, _AUDIT_LEAST)
            work += one_by_one * (_AUDIT_FRAME_S + _AUDIT_STAMPS * stamp_s)
    else:
        runs = how.runs_by_frames(task.realisations)
        one_by_one, largest = runs * frames, task.n_frames
        work += runs * (visits * min(how.epochs, task.n_frames) * stamp_s + frames * _FRAME_S[how.region])
    stack = largest * how.knobs.stamp_pixels**2 * 2 * _STACK_BYTES / 1e6
    whole = _WHOLE_FRAME_MB if how.draw == "frames" and how.region == "full" else 0.0
    return TaskCost(work, runs, one_by_one, _BASE_MB + whole + stack)


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


class VisitSettings(TypedDict):
    """Arguments of `simulator.observing.observation.observe` that tell one visit from the other."""

    role: Role
    roll_deg: float
    n_frames: int


class LibraryPlan(Record):
    """The visits of an observation whose references come from a named library.

    Attributes
    ----------
    science_scene, reference_scene : Scene
        What the frames of each visit show.
    science, reference : dict
        ``role``, ``roll_deg`` and ``n_frames`` of each visit, for `simulator.observing.observation.observe`. Visits of
        different role or number have wavefront offsets, walks and noise of their own.
    visits, reference_visits : int
        How many there are of each.
    shows_planet : bool
        Whether the planet is in the reference frames too: then both visits are science, each the other's reference
        (`cpic_planner.validation.rdi`).
    noise_free : bool
        Whether the expectation (`simulator.observing.FrameSequence.expected_e`) stands for the reference
        frames. It is that of the science visit without planets, wavefront included: neither noise nor drift between
        the visits.
    """

    science_scene: Scene
    reference_scene: Scene
    science: VisitSettings
    reference: VisitSettings
    visits: int = 1
    reference_visits: int = 1
    shows_planet: bool = False
    noise_free: bool = False


def library_plan(
    strategy: Strategy, scene: Scene, n_frames: int, *, visits: int = 1, roll_deg: float = 0.0
) -> LibraryPlan:
    """Return what to simulate for the library that a strategy names (`cpic_planner.registry`).

    Parameters
    ----------
    strategy : Strategy
        ``library``, ``reference_ratio``, ``reference_visits``, ``reference_star``, ``roll_deg``: those of the ETC.
    scene : Scene
        With its planets.
    n_frames : int
        Science frames of a visit, at least 1; for ``roll`` those of each roll.
    visits : int
        Science visits, at least 1.
    roll_deg : float
        Roll of the observation, to which that of two rolls is relative.

    Returns
    -------
    LibraryPlan
        With ``round(n_frames * reference_ratio * V / R)`` reference frames, at least 1, in each of R reference visits
        of V science visits; without the factor ``V / R`` for a library whose visits are there already.
    """
    count = check_whole("n_frames", n_frames, 1, MOST_FRAMES)
    library, rolls = strategy.reference_library, [roll_deg + turn for turn in strategy.rolls_deg]
    role: Role = "science" if library.noise_free else "reference"
    # Expectations are those of the very visits that they stand beside.
    number = visits if library.noise_free else strategy.references_of(visits)
    length = float(library.reference_length(np.asarray(float(visits)), np.asarray(float(number))))
    references = count if library.noise_free else max(round(count * strategy.reference_ratio * length), 1)
    science: VisitSettings = {"role": "science", "roll_deg": rolls[0], "n_frames": count}
    reference: VisitSettings = {"role": role, "roll_deg": rolls[-1], "n_frames": references}
    return LibraryPlan(
        science_scene=scene,
        reference_scene=library.reference_scene(strategy, scene),
        science=science,
        reference=reference,
        visits=visits,
        reference_visits=number,
        shows_planet=len(rolls) > 1,
        noise_free=library.noise_free,
    )


class Modelling(Choice, kw_only=True):
    """The choice of the ledger for the images of a task, with the dial that it follows; made by `modelling_of`.

    Attributes
    ----------
    dial : Dial
        With the tolerances of what is measured.
    exact : bool
        Whether sums have a transform of each wavefront, and not the expansion of `simulator.imaging.visit_light`.
    scene_model : {"exact", "paper"}
        As of `simulator.observe`.
    """

    dial: Dial
    exact: bool
    scene_model: SceneModel = "exact"

    def instrument(self, instrument: Instrument) -> Instrument:
        """Return the camera with what is modelled of it."""
        seen = self.drifting(instrument)
        if self.draw == "sums":
            return images_of(seen)
        if seen.coronagraph.table is not None:  # no shadow of a mask tells the level of a frame: it counts as known
            seen = seen.switched(dict.fromkeys(("bias_drift", "interference"), False))
        return seen.switched(self.switches) if self.switches else seen

    def whole(self) -> "Modelling":
        """Return every frame with every effect, by the same knobs."""
        epochs = max(self.epochs, MAX_EPOCHS)
        return dataclasses.replace(self, draw="frames", epochs=epochs, switches={}, left_out=(), still=())

    def of_files(self) -> "Modelling":
        """Return what files are compared with: every effect, by the same knobs, and one wavefront."""
        return dataclasses.replace(self.whole(), region="hole", epochs=1)

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
    plan = library_plan(strategy, scene, task.n_frames, visits=task.visits, roll_deg=task.roll_deg)
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
