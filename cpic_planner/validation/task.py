"""The task of a confirmation: a scene, its frames, and their predictions, as plain data for any process."""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, NamedTuple, Required, TypedDict, Unpack

import numpy as np

from cpic_core import Reason, Status
from cpic_planner import etc
from cpic_planner.queries import MAX_FRAMES, ReferencePlanet, SimulatorOverrides
from cpic_planner.ranking import best_in_band, no_frame_status
from cpic_planner.results import BandConfirmation
from cpic_planner.targets import Targets
from simulator.config import Instrument, Planet, Scene, SceneStar, Timing, companion_of
from simulator.knobs import Dial, dial_of
from simulator.ledger import NOT_IN_SUMS
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


class Frames(NamedTuple):
    """Frames of a science visit, and how many such visits are reduced together."""

    exposure_s: float
    n_frames: int
    em_gain: float
    visits: int = 1


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
        Whether one more realisation has every effect of single frames (`cpic_planner.validation.audit`); not by
        default.
    """

    seed: Required[int]
    fidelity: str | None
    tolerance: float | None
    realisations: int
    audit: bool


@dataclass(frozen=True)
class ConfirmTask:
    """One scene in one band, ready to be simulated anywhere: plain data only.

    Attributes
    ----------
    name, band : str
        Of the piece of work.
    simulator : dict
        Instrument of the images: the nominal one, altered where the simulator is overridden.
    scene : dict
        What the images show.
    exposure_s, n_frames, em_gain
        Frames of a science visit.
    strategy : dict
        How it is observed and reduced (`cpic_planner.etc.model.Strategy`).
    predictions : list of dict
        What `expected_of` says of each planet that is measured.
    planets : list of str
        Their names in the scene.
    seed, fidelity, tolerance, realisations, audit
        `ImageSettings`.
    visits, reference_visits : int
        Science visits that are reduced together, and visits that all the references are spread over.
    gap_s : float
        From the start of a science visit to that of the next, s.
    unused_s : float or None
        Part of the given wall time that the visits leave unused.
    chosen_for : str
        Planet for which visits and frames were chosen; empty where they were given.
    """

    name: str
    band: str
    simulator: dict[str, Any]
    scene: dict[str, Any]
    exposure_s: float
    n_frames: int
    em_gain: float
    strategy: dict[str, Any]
    predictions: list[dict[str, Any]]
    planets: list[str]
    seed: int
    fidelity: str | None = None
    tolerance: float | None = None
    realisations: int = 1
    audit: bool = False
    visits: int = 1
    reference_visits: int = 1
    gap_s: float = 0.0
    unused_s: float | None = None
    chosen_for: str = ""

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
    model: etc.EtcModel, target: Targets, band: str, place_arcsec: tuple[Any, Any], contrast: float, frames: Frames
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

    Returns
    -------
    dict
        ``contrast``, ``separation_arcsec``, ``pa_deg`` (at roll 0), ``threshold``,
        ``n_modes`` that the prediction is for, ``snr`` and ``significance`` of sums of frames, which no particle hits,
        with the ``verdict`` and the probabilities of a detection (``chance_blind``, ``chance_known_place``) that
        follow, and ``snr_full`` and ``significance_full`` with the frames that particles void; None of these for a
        reduction without a closed form.
    """
    x = np.asarray(place_arcsec[0], float).reshape(1, 1)
    y = np.asarray(place_arcsec[1], float).reshape(1, 1)
    faint = np.full((1, 1), contrast, dtype=np.float64)
    separation, pa_deg = detector_to_sky(x, y, parity=model.instrument.detector.parity)
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
    made = task_of(model, scene, band, frames, [expected], overrides=overrides, **settings)
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
    **settings: Unpack[ImageSettings],
) -> ConfirmTask:
    """Return the work itself; what is overridden changes the images alone. All planets unless some are named."""
    altered = overrides or SimulatorOverrides()
    return ConfirmTask(
        name=scene.name,
        band=band,
        simulator=altered.instrument(model.instrument).model_dump(mode="json"),
        scene=altered.scene(scene).model_dump(mode="json"),
        exposure_s=frames.exposure_s,
        n_frames=frames.n_frames,
        em_gain=frames.em_gain,
        visits=frames.visits,
        reference_visits=model.strategy.references_of(frames.visits),
        gap_s=gap_s(model, band, frames),
        strategy=model.strategy.model_dump(mode="json"),
        predictions=list(predictions),
        planets=[planet.name for planet in scene.planets] if planets is None else list(planets),
        **settings,
    )


def images_of(instrument: Instrument) -> Instrument:
    """Return the instrument as sums of frames see it: without what only a full reduction can take out."""
    return instrument.switched(dict.fromkeys(NOT_IN_SUMS, False))
