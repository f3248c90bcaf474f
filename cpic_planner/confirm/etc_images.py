"""Observe one answer of the exposure-time calculator in simulated images with its own frames."""

import dataclasses
import itertools
import math
from collections.abc import Callable, Iterator

import numpy as np

from cpic_core import FloatArray, InputError, Outcome, Reason, Status
from cpic_planner import validation
from cpic_planner.etc import EtcModel, aperture_rates, diagonal_pa_deg, planet_offsets, reference_distance_au
from cpic_planner.queries import MAX_FRAMES, ReferencePlanet, refuse_counting
from cpic_planner.results import EtcAnswer, ImageCheck
from cpic_planner.targets import Targets
from simulator.config import Planet, Scene, albedo_spec
from simulator.knobs import Dial
from simulator.observing import observe
from simulator.target import contrast_at

AIM = 0.05
"""Relative error to which the SNR of images is known by default."""
FEWEST, MOST, MOST_FOR_TOLERANCE = 8, 400, 2000
"""Realisations as sums of frames: a jackknife needs eight, and four hundred take a minute; a tolerance may ask for
more."""
FEWEST_BY_FRAMES, MOST_FRAMES = 2, 2000
"""Realisations frame by frame, and frames of all of them together unless more are asked for."""
# Of a tolerance, knobs and skipped effects have this share, and chance what is left in quadrature.
_SHARE_OF_KNOBS = 0.5
_SHARE_OF_CHANCE = math.sqrt(1.0 - _SHARE_OF_KNOBS**2)
_GREY, _PHASE_DEG = 0.5, 90.0

Progress = Callable[[float], None]


def check_in_images(
    model: EtcModel,
    star: Targets,
    answer: EtcAnswer,
    planet: ReferencePlanet | None,
    dial: Dial,
    *,
    seed: int = 1,
    realisations: int | None = None,
    stated_snr_error: float = 0.0,
    progress: Progress = lambda done: None,
) -> Outcome[ImageCheck]:
    """Observe the planet of an answer in simulated images, with the frames of the answer, and measure it.

    Parameters
    ----------
    model : EtcModel
        That gave the answer.
    star : Targets
        One star.
    answer : EtcAnswer
        With frames and a contrast.
    planet : ReferencePlanet or None
        What reflects the light; None for a grey planet of the answer's contrast.
    dial : Dial
        ``reference`` draws every frame with every effect of the camera, ``standard`` and a tolerance sums of frames.
    seed : int
        Of the images.
    realisations : int, optional
        As many as `AIM` asks for by default, 8 to 400 (frame by frame at least 2, of 2000 frames); with a tolerance as
        many as that asks for.
    stated_snr_error : float
        Of the closed form, for the verdict.
    progress : callable
        Told the finished share, 0 to 1.

    Returns
    -------
    Outcome of ImageCheck
        ``invalid`` or ``saturated`` with reason and sentence where images cannot check the answer.
    """
    try:
        refuse_counting(model.strategy, dial)
        task = _task(model, star, answer, planet, dial, seed)
        modelling = validation.modelling_of(task)
        done, visits, template = _measured(task, modelling, dial, realisations, progress)
    except _Refused as refusal:
        return Outcome.refuse(refusal.status, refusal.reason, str(refusal))
    except InputError as error:
        return Outcome.refuse(Status.INVALID, Reason.NOT_MEASURED, f"images refuse it: {error}")
    light = _light_ratio(model, star, answer, visits, template)
    return Outcome.ok(_compared(task, modelling, done, light, stated_snr_error))


class _Refused(Exception):
    """Images do not check the answer."""

    def __init__(self, status: Status, reason: Reason, message: str) -> None:
        super().__init__(message)
        self.status, self.reason = status, reason


def _task(
    model: EtcModel, star: Targets, answer: EtcAnswer, planet: ReferencePlanet | None, dial: Dial, seed: int
) -> validation.ConfirmTask:
    frames = validation.Frames.of(answer)
    assert frames is not None
    assert answer.contrast is not None
    place = planet_offsets(model, star, answer.band, answer.separation_arcsec)
    expected = validation.expected_of(model, star, answer.band, place, answer.contrast, frames)
    chosen: validation.ImageSettings = {"seed": seed, "fidelity": dial.fidelity}
    if dial.fidelity == "custom":
        chosen = {"seed": seed, "tolerance": _SHARE_OF_KNOBS * max(dial.tolerance.values())}
    scene = grey_scene(model, star, answer.band, answer.separation_arcsec, answer.contrast, planet)
    return validation.task_of(model, scene, answer.band, frames, [expected], **chosen)


def grey_scene(
    model: EtcModel, star: Targets, band: str, separation: float, contrast: float, planet: ReferencePlanet | None = None
) -> Scene:
    """Return the star with its planet on the diagonal; a grey one stands as far from it as gives it the contrast.

    Parameters
    ----------
    model : EtcModel
    star : Targets
        One star.
    band : str
    separation : float
        Projected separation from the star, arcsec.
    contrast : float
        Of a grey planet.
    planet : ReferencePlanet, optional
        Instead of a grey one.
    """
    body = planet or ReferencePlanet(phase_deg=_PHASE_DEG, albedo=albedo_spec(_GREY))
    distance = float(reference_distance_au(star, np.array([separation]), body)[0, 0])
    pa_deg = diagonal_pa_deg(model, star, band)
    zodis = model.instrument.sky.exozodi_zodis
    scene = validation.target_scene(star, body, separation, distance, pa_deg, exozodi_zodis=zodis)
    if planet is not None:
        return scene
    there = float(contrast_at(body.radius_rjup, distance, body.phase_deg, _GREY))
    grey = scene.planets[0].model_copy(update={"distance_au": distance * math.sqrt(there / contrast)})
    # Its true distance then contradicts the star's: nothing else depends on that.
    nowhere = scene.cstar.model_copy(update={"distance_pc": None})
    return scene.model_copy(update={"cstar": nowhere, "planets": (Planet.model_validate(grey.model_dump()),)})


def _drawn(
    task: validation.ConfirmTask, modelling: validation.Modelling
) -> Iterator[tuple[validation.VisitPair, validation.Realisation, validation.FrameStatistics | None]]:
    """Return the realisations without end, one in memory at a time."""
    if modelling.outcome.value is None:
        raise _Refused(modelling.outcome.status, modelling.outcome.reason, modelling.outcome.message)
    if modelling.dial.fidelity == "reference":
        if task.n_science_frames > MAX_FRAMES:
            text = (
                f"{task.n_science_frames} frames one by one, at most {MAX_FRAMES}: give less time or longer exposures"
            )
            raise _Refused(Status.INVALID, Reason.TOO_MANY_FRAMES, text)
        return validation.realisations(task, modelling, itertools.count(), None)
    visits = validation.visit_pair(task, modelling=dataclasses.replace(modelling, draw="sums"))
    if visits.stackable.value is None:
        text = f"no sums of frames: {visits.stackable.message}; fidelity reference draws every frame"
        raise _Refused(visits.stackable.status, visits.stackable.reason, text)
    if modelling.draw != "sums":
        text = "sums of frames are not accurate enough for this scene; fidelity reference draws every frame"
        raise _Refused(Status.INVALID, Reason.TOLERANCE_NOT_MET, text)
    return validation.realisations(task, modelling, itertools.count(), visits)


def _measured(
    task: validation.ConfirmTask,
    modelling: validation.Modelling,
    dial: Dial,
    realisations: int | None,
    progress: Progress,
) -> tuple[list[validation.Measurement], validation.VisitPair, validation.PlanetTemplate]:
    """Return the measurements of as many realisations as it takes, with the last visits."""
    found: list[validation.Measurement] = []
    total = realisations
    for visits, realisation, statistics in _drawn(task, modelling):
        if not found:
            template = validation.planet_templates(visits)[0]
        star = validation.StarFlux.known(visits.science.truth.sources[0].rate_e_s)
        (one,), _ = validation.measure_planets(visits, realisation, [template], star)
        if one is None or (statistics is not None and statistics.lost_in):
            where = "pixels of the dark hole" if one else "the aperture or what is around it"
            raise _Refused(Status.SATURATED, Reason.PIXEL_FULL_WELL, f"limits cut off {where}")
        found.append(one)
        if total is None:
            total = _wanted(task, dial, one.n_apertures)
        progress(min(len(found) / total, 1.0))
        if len(found) >= total:
            break
    return found, visits, template


def _wanted(task: validation.ConfirmTask, dial: Dial, n_apertures: int) -> int:
    """Return the realisations that tell the SNR as well as is asked for."""
    aim = AIM if dial.fidelity != "custom" else _SHARE_OF_CHANCE * max(dial.tolerance.values())
    expected = task.predictions[0]
    snr = expected["snr"]
    scatter = validation.snr_scatter(snr, expected["significance"], n_apertures) / snr
    if dial.fidelity == "custom" and scatter > aim * math.sqrt(MOST_FOR_TOLERANCE):
        most = f"more than {MOST_FOR_TOLERANCE} realisations to know the SNR of images that well"
        text = f"it takes {most}: give a larger tolerance, or fidelity standard"
        raise _Refused(Status.INVALID, Reason.TOLERANCE_NOT_MET, text)
    wanted = math.ceil((scatter / aim) ** 2)
    if dial.fidelity == "reference":
        whole = math.floor(MOST_FRAMES / task.n_all_frames)
        return int(max(FEWEST_BY_FRAMES, min(wanted, whole)))
    return int(max(wanted, FEWEST) if dial.fidelity == "custom" else min(max(wanted, FEWEST), MOST))


def _light_ratio(
    model: EtcModel, star: Targets, answer: EtcAnswer, visits: validation.VisitPair, template: validation.PlanetTemplate
) -> float:
    """Return the planet's light in its aperture: that of images without noise over that of the closed form."""
    scene, instrument, knobs = visits.plan.science_scene, visits.instrument, visits.modelling.knobs

    def light_e_s(shown: Scene) -> FloatArray:
        seen = observe(
            shown,
            band=answer.band,
            exposure_s=visits.task.exposure_s,
            instrument=instrument,
            roll_deg=visits.plan.science["roll_deg"],
            window="hole",
            fidelity=knobs,
        )
        return seen.light.static_e_s

    planet_e_s = light_e_s(scene) - light_e_s(scene.without_planets())
    x_arcsec, y_arcsec = planet_offsets(model, star, answer.band, answer.separation_arcsec)
    x = np.full((1, 1), x_arcsec, dtype=np.float64)
    y = np.full((1, 1), y_arcsec, dtype=np.float64)
    rates = aperture_rates(model, star, answer.band, x, y, np.full((1, 1), answer.contrast))
    before = rates.planet_e_s.flat[0] / rates.planet_left.flat[0]  # the images are those before the subtraction
    return float(np.sum(planet_e_s * template.apertures[0]) / before)


def _compared(
    task: validation.ConfirmTask,
    modelling: validation.Modelling,
    done: list[validation.Measurement],
    light_ratio: float,
    stated_snr_error: float,
) -> ImageCheck:
    """Return what the realisations say together, beside the closed form."""
    expected = task.predictions[0]
    suffix = "_full" if modelling.draw == "frames" else ""  # sums have no hits of particles
    contrast, error, sigma = validation.contrasts_of(done)
    predicted, significance = expected["snr" + suffix], expected["significance" + suffix]
    snr, snr_error = validation.mean_snr(contrast, error, significance=significance, n_apertures=done[0].n_apertures)
    # What few realisations scatter by is itself uncertain: errors are at least those expected.
    expected_error = validation.snr_scatter(predicted, significance, done[0].n_apertures) / math.sqrt(len(done))
    snr_error = max(snr_error, expected_error)
    spread = float(max(contrast.std(ddof=min(len(done) - 1, 1)), np.sqrt((error**2).mean())))
    ratio, ratio_error = snr / predicted, snr_error / predicted
    mean = validation.Calibration.of(ratio, ratio_error)
    return ImageCheck(
        draw=modelling.draw,
        realisations=len(done),
        light_ratio=light_ratio,
        flux_ratio=float(contrast.mean() / expected["contrast"]),
        flux_ratio_error=spread / math.sqrt(len(done)) / expected["contrast"],
        predicted_snr=predicted,
        snr=snr,
        snr_error=snr_error,
        etc_ratio=mean.etc_ratio,
        etc_ratio_error=mean.etc_ratio_error,
        predicted_significance=significance,
        significance=float(contrast.mean() / np.sqrt((sigma**2).mean())),
        agrees=bool(abs(ratio - 1.0) <= stated_snr_error + 2.0 * ratio_error),
        n_found=sum(one.found for one in done),
        modelled=modelling.record(),
    )
