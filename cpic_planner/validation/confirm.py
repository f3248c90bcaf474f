"""Confirm a prediction: simulate science and reference sequences, subtract, measure, compare."""

from __future__ import annotations

import base64
import io
import math
from dataclasses import asdict, dataclass
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from cpic_planner.etc.exozodi import exozodi_disc
from cpic_planner.etc.model import EtcModel, build_model
from cpic_planner.etc.noise import StackNoise, stack_noise
from cpic_planner.etc.place import diagonal_pa_deg, stand
from cpic_planner.etc.planet import ReferencePlanet, reference_contrast, reference_distance_au
from cpic_planner.etc.rates import aperture_rates
from cpic_planner.models import BandConfirmation
from cpic_planner.optimiser import Best, best_in_band
from cpic_planner.ranking import no_frame
from cpic_planner.targets import Targets
from cpic_planner.validation.apertures import aperture_weights
from cpic_planner.validation.calibration import snr_scatter
from cpic_planner.validation.photometry import Photometry, aperture_photometry
from cpic_planner.validation.rdi import rdi_subtract
from simulator.camera.emccd import to_electrons
from simulator.config import Instrument, Planet, Scene, SceneStar
from simulator.config.base import validate
from simulator.config.geometry import place
from simulator.config.scene_table import companion_of
from simulator.imaging.psf import Psf
from simulator.observation import Observation, observe
from simulator.outcome import Reason, Status

__all__ = [
    "ConfirmTask",
    "confirm_task",
    "decode_arrays",
    "encode_arrays",
    "images_of",
    "prepare_task",
    "target_scene",
]

FloatArray = NDArray[np.float64]
MAX_FRAMES = 4000
"""Frames of one sequence that are held in memory at once (0.6 GB of stamps)."""
# Flaws that calibration takes out, and particles that rejection does: neither is part of the measurement yet.
_NOT_IN_IMAGES = ("flat", "dark_structure", "bad_pixels", "bad_columns", "smear", "cosmic_rays", "nonlinearity",
                  "parallel_cti", "serial_cti", "stripes", "interference", "bias_drift")  # fmt: skip
_REFUSALS = {
    Status.SATURATED: "every frame saturates",
    Status.UNREACHABLE: "the time holds no frame",
    Status.INVALID: f"more than {MAX_FRAMES} frames: give less time or longer exposures",
}


@dataclass(frozen=True)
class ConfirmTask:
    """One target in one band, ready to be simulated anywhere: plain data only."""

    name: str
    band: str
    instrument: dict[str, Any]
    scene: dict[str, Any]
    exposure_s: float
    n_frames: int
    em_gain: float
    seed: int
    fidelity: str
    n_reference: int
    n_modes: int
    annulus_lambda_d: float
    prediction: dict[str, Any]

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
    """Scene of one star with its reference planet, and its nearest known companion if that is near and located.

    The default position angle is that of the example of Zhu et al. 2025, on a diagonal of the hole. ``exozodi_zodis``
    adds a face-on disc of dust (`cpic_planner.etc.exozodi`).
    """
    name = str(target.name[0])
    star = SceneStar(
        name=name,
        v_mag=float(target.v_mag[0]),
        teff_k=float(target.teff_k[0]),
        log_g=float(target.log_g[0]),
        metallicity=float(target.metallicity[0]),
        distance_pc=_known(target.distance_pc[0]),
        luminosity_lsun=_known(target.luminosity_lsun[0]),
    )
    body = Planet(
        name="reference planet",
        radius_rjup=planet.radius_rjup,
        distance_au=distance_au,
        phase_deg=planet.phase_deg,
        separation_arcsec=separation_arcsec,
        pa_deg=pa_deg,
        albedo=planet.albedo,
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
        name=name,
        cstar=star,
        planets=(body,),
        stars=stars,
        extended=() if disc is None else (disc,),
        companions=target.companions,
    )


def _known(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def prepare_task(
    model: EtcModel, target: Targets, band: str, *, time_s: float, planet: ReferencePlanet, seed: int, fidelity: str
) -> ConfirmTask | BandConfirmation:
    """Predict one band's reference planet where that band sees it best: a final refusal, or work to do."""
    best = best_in_band(model, target, band, time_s, planet)
    separation = float(best.separation_arcsec[0])
    pa_deg = diagonal_pa_deg(model.metrics[band].zone, model.instrument.detector.parity)
    seen = _in_images(model, target, band, best, planet)
    prediction = {
        "snr": float(seen.snr[0]),
        "significance": float(seen.significance[0]),
        "threshold": float(best.threshold[0]),
        "contrast": float(best.contrast[0]),
        "time_s": float(best.time_s[0]),
    }
    if not 1 <= best.n_frames[0] <= MAX_FRAMES:
        status, reason = no_frame(best, 0, model.camera(band))
        if best.n_frames[0] > MAX_FRAMES:
            status, reason = Status.INVALID, Reason.TOO_MANY_FRAMES
        return BandConfirmation(
            band=band,
            status=status.value,
            reason=reason.value,
            message=_REFUSALS[status],
            separation_arcsec=separation,
            pa_deg=pa_deg,
            true_contrast=prediction["contrast"],
            verdict="not observed",
        )
    distance = float(reference_distance_au(target, np.array([separation]), planet)[0, 0])
    zodis = model.instrument.sky.exozodi_zodis
    scene = target_scene(target, planet, separation, distance, pa_deg, exozodi_zodis=zodis)
    return ConfirmTask(
        name=str(target.name[0]),
        band=band,
        instrument=model.instrument.model_dump(mode="json"),
        scene=scene.model_dump(mode="json"),
        exposure_s=float(best.exposure_s[0]),
        n_frames=int(best.n_frames[0]),
        em_gain=float(best.em_gain[0]),
        seed=seed,
        fidelity=fidelity,
        n_reference=max(round(int(best.n_frames[0]) * model.strategy.reference_ratio), 1),
        n_modes=model.strategy.n_modes,
        annulus_lambda_d=model.strategy.annulus_lambda_d,
        prediction=prediction,
    )


def _in_images(model: EtcModel, target: Targets, band: str, best: Best, planet: ReferencePlanet) -> StackNoise:
    """Noise of the chosen frames without what the images leave out (particles void no aperture there)."""
    strategy = model.strategy
    simulated = build_model(images_of(model.instrument), [band], strategy)
    separation = best.separation_arcsec[:, None]
    contrast = reference_contrast(model, target, band, separation, planet)
    rates = aperture_rates(simulated, target, band, *stand(simulated, band, separation), contrast)
    noise = stack_noise(rates, best.exposure_s[:, None], best.n_frames[:, None], best.em_gain[:, None],
                        simulated.camera(band), reference_ratio=strategy.reference_ratio)  # fmt: skip
    return StackNoise(noise.signal_e[:, 0], noise.terms, noise.snr[:, 0], noise.significance[:, 0])


def images_of(instrument: Instrument) -> Instrument:
    """The instrument as the images of a confirmation see it: without what only a full reduction can take out."""
    return instrument.switched(dict.fromkeys(_NOT_IN_IMAGES, False))


def confirm_task(tree: dict[str, Any]) -> dict[str, Any]:
    """Simulate, subtract and measure one target in one band.

    Parameters
    ----------
    tree : dict
        `ConfirmTask.to_dict`.

    Returns
    -------
    dict
        ``confirmation`` (a `BandConfirmation` as plain data) and ``panels`` (images, encoded).
    """
    task = ConfirmTask(**tree)
    instrument = validate(Instrument, task.instrument, where="instrument")
    scene = validate(Scene, task.scene, where="scene")
    settings: dict[str, Any] = {
        "band": task.band,
        "exposure_s": task.exposure_s,
        "n_frames": task.n_frames,
        "em_gain": task.em_gain,
        "seed": task.seed,
        "fidelity": task.fidelity,
        "instrument": images_of(instrument),
        "window": "hole",
    }
    science = observe(scene, role="science", **settings)
    reference = observe(scene.without_planets(), role="reference", **(settings | {"n_frames": task.n_reference}))
    metrics = cast(Psf, science.psf).metrics
    region = metrics.hole
    science_e, science_lost = _electrons(science, region)
    reference_e, reference_lost = _electrons(reference, region)
    cut = rdi_subtract(science_e, reference_e, task.n_modes, region=region, centering="temporal")
    stack = cut.residuals.sum(axis=0)
    x, y = science.truth.x_pixel[1], science.truth.y_pixel[1]
    radius = instrument.aperture_radius_arcsec(task.band) / instrument.detector.pixel_scale_arcsec
    planet = science.truth.sources[1]
    template = science.psf.at(planet.x_arcsec, planet.y_arcsec)
    weights = aperture_weights(stack.shape, x, y, radius)
    separation = place(scene.cstar, scene.planets[0]).separation_arcsec
    annulus = metrics.annulus(separation, task.annulus_lambda_d)
    throughput = cut.throughput(template, weights, background=_background(annulus, x, y, radius))
    measured = aperture_photometry(
        stack,
        x,
        y,
        radius,
        background_region=annulus,
        throughput=throughput,
        em_gain=task.em_gain,
        stages=instrument.detector.register_stages,
    )
    core = float(np.sum(template * weights))
    ratio = measured.contrast(core, science.truth.sources[0].rate_e_s, task.exposure_s * task.n_frames)
    confirmation = _compare(
        task, measured, ratio.value, ratio.error, throughput, cut.modes_used, core, science_lost + reference_lost
    )
    panels = {
        "science": science_e.sum(axis=0),
        "reference": reference_e.sum(axis=0),
        "residual": np.where(region, stack, np.nan),
    }
    return {
        "confirmation": confirmation.model_dump(mode="json"),
        "panels": encode_arrays({name: image.astype(np.float32) for name, image in panels.items()}),
        "planet_offset_arcsec": [planet.x_arcsec, planet.y_arcsec],
    }


def _background(region: NDArray[np.bool_], x: float, y: float, radius: float) -> NDArray[np.bool_]:
    rows, columns = np.indices(region.shape)
    return region & (np.hypot(columns - x, rows - y) > 1.5 * radius)


def _electrons(sequence: Observation, hole: NDArray[np.bool_]) -> tuple[FloatArray, NDArray[np.int64]]:
    """All frames in electrons at the register input; pixels cut off by a limit, inside the hole and outside it."""
    stack = np.empty((sequence.n_frames, *sequence.shape))
    lost = np.zeros(2, np.int64)
    for index in range(sequence.n_frames):
        frame = sequence.frame(index)
        stack[index] = to_electrons(frame.adu, sequence.instrument.detector, sequence.em_gain)
        lost += np.count_nonzero(frame.lost & hole), np.count_nonzero(frame.lost & ~hole)
    return stack, lost


def _compare(
    task: ConfirmTask,
    measured: Photometry,
    contrast: float,
    error: float,
    throughput: float,
    modes: int,
    core: float,
    lost: NDArray[np.int64],
) -> BandConfirmation:
    prediction = task.prediction
    threshold = prediction["threshold"]
    detected = bool(measured.significance >= threshold and not lost[0])
    planet = task.scene["planets"][0]
    return BandConfirmation(
        band=task.band,
        status="saturated" if lost[0] else "ok",
        reason=Reason.PIXEL_FULL_WELL.value if lost[0] else "",
        message=f"{lost[0]} pixels of the hole were cut off by a limit" if lost[0] else "",
        separation_arcsec=planet["separation_arcsec"],
        pa_deg=planet["pa_deg"],
        exposure_s=task.exposure_s,
        n_frames=task.n_frames,
        em_gain=task.em_gain,
        integration_s=task.exposure_s * task.n_frames,
        time_s=prediction["time_s"],
        predicted_snr=prediction["snr"],
        predicted_significance=prediction["significance"],
        recovered_snr=measured.snr,
        recovered_significance=measured.significance,
        threshold=threshold,
        true_contrast=prediction["contrast"],
        recovered_contrast=contrast,
        contrast_error=error,
        rdi_throughput=throughput,
        rdi_modes_used=modes,
        core_throughput=core,
        n_background_apertures=measured.n_background_apertures,
        saturated_in_hole=int(lost[0]),
        saturated_outside=float(lost[1]) / (task.n_frames + task.n_reference),
        detected=detected,
        verdict=_verdict(prediction, measured.snr, detected, measured.n_background_apertures),
        image=task.key,
    )


def _verdict(prediction: dict[str, Any], recovered_snr: float, detected: bool, n_apertures: int) -> str:
    """In words: a difference in SNR is named only beyond two of its standard errors."""
    expected = prediction["significance"] >= prediction["threshold"]
    if detected:
        word = "confirmed" if expected else "detected, though predicted below threshold"
    else:
        word = "not confirmed" if expected else "not detected, as predicted"
    deviation = (recovered_snr - prediction["snr"]) / snr_scatter(
        prediction["snr"], prediction["significance"], n_apertures
    )
    if abs(deviation) > 2.0:
        word += (
            f"; prediction {'pessimistic' if deviation > 0 else 'optimistic'} by {abs(deviation):.1f} standard errors"
        )
    return word


def encode_arrays(arrays: dict[str, NDArray[Any]]) -> str:
    """Arrays as base64 text of a compressed npz."""
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)  # type: ignore[arg-type]
    return base64.b64encode(buffer.getvalue()).decode("ascii")


def decode_arrays(text: str) -> dict[str, NDArray[Any]]:
    """Inverse of `encode_arrays`."""
    with np.load(io.BytesIO(base64.b64decode(text)), allow_pickle=False) as stored:
        return {name: stored[name] for name in stored.files}
