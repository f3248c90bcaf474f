"""What is to be confirmed: a scene, its frames, and what was predicted of them, as plain data for any process."""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from cpic_core import Reason, Status
from cpic_planner.etc import (
    EtcModel,
    StackNoise,
    aperture_rates,
    build_model,
    diagonal_pa_deg,
    needed_margin,
    planet_offsets,
    reference_distance_au,
    stack_noise,
    threshold_array,
    verdict_of,
    visit_chances,
)
from cpic_planner.queries import MAX_FRAMES, ReferencePlanet, SimulatorOverrides
from cpic_planner.ranking import best_in_band, no_frame_status
from cpic_planner.results import BandConfirmation
from cpic_planner.targets import Targets
from simulator.config import Instrument, Planet, Scene, SceneStar, companion_of
from simulator.knobs import Dial, dial_of
from simulator.ledger import NOT_IN_SUMS
from simulator.signal import exozodi_disc
from simulator.target import detector_to_sky

_REFUSALS = {
    Status.SATURATED: "every frame saturates",
    Status.UNREACHABLE: "the time holds no frame",
    Status.INVALID: f"more than {MAX_FRAMES} frames: give less time or longer exposures",
}


@dataclass(frozen=True)
class Frames:
    """Frames of the science visit."""

    exposure_s: float
    n_frames: int
    em_gain: float


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
        Frames of the science visit.
    strategy : dict
        How it is observed and reduced (`cpic_planner.etc.model.Strategy`).
    seed, realisations
        Of the images; every realisation has its own drift and noise.
    fidelity, tolerance
        The dial (`simulator.knobs.dial_of`): a name or a tolerance; ``standard`` without any.
    audit : bool
        Whether one more realisation runs frame by frame with every effect of the camera.
    predictions : list of dict
        What `expected_of` says of each planet that is measured.
    planets : list of str
        Their names in the scene.
    """

    name: str
    band: str
    simulator: dict[str, Any]
    scene: dict[str, Any]
    exposure_s: float
    n_frames: int
    em_gain: float
    strategy: dict[str, Any]
    seed: int
    fidelity: str | None
    realisations: int
    audit: bool
    predictions: list[dict[str, Any]]
    planets: list[str]
    tolerance: float | None = None

    @property
    def dial(self) -> Dial:
        """Speed against accuracy."""
        return dial_of(self.fidelity, self.tolerance)

    @property
    def key(self) -> str:
        """Name of the finished piece of work."""
        return f"{self.name} {self.band}"

    def to_dict(self) -> dict[str, Any]:
        """Plain dict."""
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
    """Scene of one star with its reference planet; see `star_scene`.

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
    """Scene of one star with planets, and its nearest known companion if that is near and located.

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
    star = SceneStar(
        name=str(target.name[0]),
        v_mag=float(target.v_mag[0]),
        teff_k=float(target.teff_k[0]),
        log_g=float(target.log_g[0]),
        metallicity=float(target.metallicity[0]),
        distance_pc=_known(target.distance_pc[0]),
        luminosity_lsun=_known(target.luminosity_lsun[0]),
        ra_deg=_known(target.ra_deg[0]),
        dec_deg=_known(target.dec_deg[0]),
    )
    near = companion_of(
        star.model_dump(),
        separation_arcsec=_known(target.companion_separation_arcsec[0]),
        pa_deg=_known(target.companion_pa_deg[0]),
        v_mag=_known(target.companion_v_mag[0]),
        teff_k=_known(target.companion_teff_k[0]),
    )
    stars = tuple(SceneStar(**body) for body in near)
    disc = exozodi_disc(exozodi_zodis)
    return Scene(
        name=name or star.name,
        cstar=star,
        planets=planets,
        stars=stars,
        extended=() if disc is None else (disc,),
        companions=target.companions,
    )


def _known(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def expected_of(
    model: EtcModel, target: Targets, band: str, place_arcsec: tuple[Any, Any], contrast: float, frames: Frames
) -> dict[str, Any]:
    """What the ETC expects of a planet in given frames.

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
        ``contrast``, ``separation_arcsec``, ``pa_deg`` (at roll 0), ``time_s``, ``threshold``, ``snr`` and
        ``significance`` of sums of frames, which no particle hits, with the ``verdict`` and the probabilities of a
        detection (``chance_blind``, ``chance_known_place``; None where no law was measured) that follow, and
        ``snr_full`` and ``significance_full`` with the frames that particles void.
    """
    x, y = (np.asarray(part, float).reshape(1, 1) for part in place_arcsec)
    separation, pa_deg = detector_to_sky(x, y, parity=model.instrument.detector.parity)
    elements = model.metrics[band].resolution_elements(separation)
    found: dict[str, Any] = {
        "contrast": float(contrast),
        "separation_arcsec": float(separation[0, 0]),
        "pa_deg": float(pa_deg[0, 0]),
        "time_s": _wall_s(model, band, frames),
    }
    found["threshold"] = float(threshold_array(elements, model.strategy.sigma)[0, 0])
    sums = build_model(images_of(model.instrument), [band], model.strategy)
    for suffix, seen in (("", sums), ("_full", model)):
        noise = _noise(seen, target, band, (x, y), contrast, frames)
        found["snr" + suffix] = float(noise.snr[0, 0])
        found["significance" + suffix] = float(noise.significance[0, 0])
        if seen is sums:
            margin = noise.significance / found["threshold"]
            visit_s = frames.n_frames * (frames.exposure_s + model.camera(band).readout_s)
            chances = visit_chances(seen, band, separation, visit_s, noise, margin)
            found["chance_blind"] = _known(chances.blind[0, 0])
            found["chance_known_place"] = _known(chances.known_place[0, 0])
            found["verdict"] = verdict_of(Status.OK, bool(margin[0, 0] >= needed_margin(model, band)))
    return found


def _wall_s(model: EtcModel, band: str, frames: Frames) -> float:
    return float(model.time_s(frames.n_frames * (frames.exposure_s + model.camera(band).readout_s)))


def _noise(
    model: EtcModel, target: Targets, band: str, place_arcsec: tuple[Any, Any], contrast: float, frames: Frames
) -> StackNoise:
    rates = aperture_rates(model, target, band, *place_arcsec, np.full((1, 1), contrast))
    setting = frames.exposure_s, frames.n_frames, frames.em_gain
    return stack_noise(rates, *setting, model.camera(band), model.strategy)


def prepare_task(
    model: EtcModel,
    target: Targets,
    band: str,
    *,
    time_s: float,
    planet: ReferencePlanet,
    seed: int,
    fidelity: str | None = None,
    tolerance: float | None = None,
    realisations: int = 1,
    audit: bool = False,
    overrides: SimulatorOverrides | None = None,
) -> ConfirmTask | BandConfirmation:
    """Predict one band's reference planet where that band sees it best: a final refusal, or work to do.

    Parameters
    ----------
    model : EtcModel
    target : Targets
    band : str
        Name of a band of the instrument, such as ``F520``.
    time_s : float
        Wall time, s, overheads and reference frames included.
    planet : ReferencePlanet
    seed : int
        Seed of all random streams.
    fidelity : str, optional
        ``quick``, ``standard`` or ``reference``.
    tolerance : float, optional
        Largest error of planet flux and SNR that is accepted, 0 to 0.5.
    realisations : int, optional
        Draws of drift and noise.
    audit : bool, optional
        Whether one more realisation runs frame by frame.
    overrides : SimulatorOverrides, optional
    """
    best = best_in_band(model, target, band, time_s, planet)
    separation = float(best.separation_arcsec[0])
    parity = model.instrument.detector.parity
    # Two rolls put it to either side of the diagonal; the ETC counts one of them.
    pa_deg = diagonal_pa_deg(model.metrics[band].zone, parity)
    if not 1 <= best.n_frames[0] <= MAX_FRAMES:
        status, reason = no_frame_status(best, 0, model.camera(band))
        if best.n_frames[0] > MAX_FRAMES:
            status, reason = Status.INVALID, Reason.TOO_MANY_FRAMES
        return BandConfirmation(
            band=band,
            status=status.value,
            reason=reason.value,
            message=_REFUSALS[status],
            separation_arcsec=separation,
            pa_deg=pa_deg,
            true_contrast=float(best.contrast[0]),
            verdict="not observed",
        )
    distance = float(reference_distance_au(target, np.array([separation]), planet)[0, 0])
    frames = Frames(float(best.exposure_s[0]), int(best.n_frames[0]), float(best.em_gain[0]))
    # Dust is part of the scene: where the simulator's differs, it is in the images alone.
    zodis = (overrides or SimulatorOverrides()).instrument(model.instrument).sky.exozodi_zodis
    scene = target_scene(target, planet, separation, distance, pa_deg, exozodi_zodis=zodis)
    expected = expected_of(
        model, target, band, planet_offsets(model, band, separation), float(best.contrast[0]), frames
    )
    return task_of(
        model,
        scene,
        band,
        frames,
        [expected],
        seed=seed,
        fidelity=fidelity,
        tolerance=tolerance,
        realisations=realisations,
        audit=audit,
        overrides=overrides,
    )


def task_of(
    model: EtcModel,
    scene: Scene,
    band: str,
    frames: Frames,
    predictions: Sequence[dict[str, Any]],
    *,
    seed: int,
    fidelity: str | None = None,
    tolerance: float | None = None,
    realisations: int,
    audit: bool,
    overrides: SimulatorOverrides | None,
    planets: Sequence[str] | None = None,
) -> ConfirmTask:
    """The work itself; what is overridden changes the images and nothing else. All planets unless some are named."""
    altered = overrides or SimulatorOverrides()
    shown = altered.scene(scene)
    return ConfirmTask(
        name=scene.name,
        band=band,
        simulator=altered.instrument(model.instrument).model_dump(mode="json"),
        scene=shown.model_dump(mode="json"),
        exposure_s=frames.exposure_s,
        n_frames=frames.n_frames,
        em_gain=frames.em_gain,
        strategy=model.strategy.model_dump(mode="json"),
        seed=seed,
        fidelity=fidelity,
        realisations=realisations,
        audit=audit,
        predictions=list(predictions),
        planets=[planet.name for planet in scene.planets] if planets is None else list(planets),
        tolerance=tolerance,
    )


def images_of(instrument: Instrument) -> Instrument:
    """The instrument as sums of frames see it: without what only a full reduction can take out."""
    return instrument.switched(dict.fromkeys(NOT_IN_SUMS, False))
