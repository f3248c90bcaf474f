"""Contrast limits against the number of frames, and their plateaus against images."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from floors import Residual, scatter, visit_images
from numpy.typing import NDArray

from cpic_planner.etc import EtcModel, build_model, contrast_limit, diagonal
from cpic_planner.queries import Strategy
from cpic_planner.targets import find_target
from simulator.config import Drift, load_instrument
from simulator.signal import programme_law

LIMIT_STAR, LIMIT_BAND, LIMIT_ARCSEC, EXPOSURE_S, SIGMA = "tau Cet", "F520", 0.6, 20.0, 5.0
OFFSETS_NM = (0.0, 0.05, 0.1, 0.5)
FRAMES = np.unique(np.round(np.geomspace(1, 1e6, 25)))
VISITS = 640
SEPARATIONS = {
    "F520": (0.4, 0.5, 0.6, 0.7, 0.8, 0.9),
    "F662": (0.5, 0.6, 0.7, 0.8, 0.9),
    "F720": (0.5, 0.6, 0.7, 0.8, 0.9),
    "F850": (0.5, 0.6, 0.7, 0.8, 0.9),
}
# Of one visit and its reference alone: nothing that a programme has in common, nor the orbit.
ALONE = {"common_fraction": 0.0, "orbital_nm": 0.0}
WALK_FRAMES, WALK_HOURS, WALK_VISITS = 8, 10.0, 160

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Curve:
    """Contrast limit against frames at one visit offset; the plateau of the images where there is one."""

    star: str
    separation_arcsec: float
    exposure_s: float
    visit_nm: float
    n_frames: FloatArray
    limit: FloatArray
    plateau: float
    model_limit: float | None
    model_error: float | None

    def _slope(self, chosen: NDArray[np.bool_]) -> float:
        return float(np.polyfit(np.log(self.n_frames[chosen]), np.log(self.limit[chosen]), 1)[0])

    @property
    def first_slope(self) -> float:
        """Logarithmic slope from 1 to 10 frames."""
        return self._slope(self.n_frames <= 10)

    @property
    def last_slope(self) -> float:
        """Logarithmic slope over the last decade of frames."""
        return self._slope(self.n_frames >= self.n_frames[-1] / 10)


@dataclass(frozen=True)
class FloorRow:
    """Residual of the ETC and of the images, per unit star."""

    band: str
    separation_arcsec: float
    visit_nm: float
    walk: str
    said: float
    measured: Residual

    @property
    def ratio(self) -> float:
        """ETC over images."""
        return self.said / self.measured.rms

    @property
    def ratio_error(self) -> float:
        """Its standard error."""
        return self.ratio * self.measured.error / self.measured.rms


def _model(offset_nm: float) -> EtcModel:
    drift = {"visit_nm": offset_nm, "walk_nm_per_sqrt_hour": 0.0, **ALONE}
    return build_model(load_instrument({"drift": drift}), LIMIT_BAND, Strategy(visits=1))


@functools.lru_cache(maxsize=3)
def _images(band: str, drift: Drift, frames: int, cadence_s: float, visits: int) -> FloatArray:
    return visit_images(load_instrument(), band, drift, visits, seed=31, frames=frames, cadence_s=cadence_s)


def _drift(visit_nm: float, walk: float = 0.0) -> Drift:
    return load_instrument().drift.model_copy(update={"visit_nm": visit_nm, "walk_nm_per_sqrt_hour": walk, **ALONE})


def limit_curves() -> list[Curve]:
    """Limits at every offset."""
    star, _ = find_target(LIMIT_STAR)
    curves = []
    for offset in OFFSETS_NM:
        model = _model(offset)
        readout = model.camera(LIMIT_BAND).readout_s

        def limit(frames: float, model: EtcModel = model, readout: float = readout) -> float:
            time_s = float(model.time_s(frames * (EXPOSURE_S + readout))) * (1.0 + 1e-12)
            answer = contrast_limit(
                model,
                star,
                time_s=time_s,
                separation_arcsec=LIMIT_ARCSEC,
                sigma=SIGMA,
                exposure_s=EXPOSURE_S,
                exact=True,
            )[0]
            if answer.n_frames != frames or answer.value is None:
                raise RuntimeError(f"asked for {frames:g} frames, got {answer}")
            return answer.value

        found = np.array([limit(float(frames)) for frames in FRAMES])
        plateau = error = None
        if offset:
            metrics = model.metrics[LIMIT_BAND]
            residual = scatter(
                _images(LIMIT_BAND, _drift(offset), 1, 60.0, VISITS),
                metrics,
                LIMIT_ARCSEC,
                model.strategy.annulus_lambda_d,
            )
            core = float(metrics.core_throughput(*diagonal(metrics.zone, np.array(LIMIT_ARCSEC))))
            plateau, error = SIGMA * residual.rms / core, SIGMA * residual.error / core
        curves.append(
            Curve(LIMIT_STAR, LIMIT_ARCSEC, EXPOSURE_S, offset, FRAMES, found, float(found[-1]), plateau, error)
        )
    return curves


def floor_rows() -> list[FloorRow]:
    """Residuals in every band and at several separations, at the default offset; then larger ones, and with walk."""
    model = build_model(load_instrument())
    width, rows = model.strategy.annulus_lambda_d, []

    def row(band: str, place: float, drift: Drift, walk: str, images: FloatArray, visit_s: float) -> FloorRow:
        said = float(np.sqrt(programme_law(model.metrics[band], drift, place, width).law().variance(visit_s)))
        return FloorRow(band, place, drift.visit_nm, walk, said, scatter(images, model.metrics[band], place, width))

    for band, places in SEPARATIONS.items():
        drift = _drift(load_instrument().drift.visit_nm)
        images = _images(band, drift, 1, 60.0, VISITS)
        rows += [row(band, place, drift, "0", images, 0.0) for place in places]
    for offset in OFFSETS_NM[2:]:
        drift = _drift(offset)
        rows.append(row(LIMIT_BAND, LIMIT_ARCSEC, drift, "0", _images(LIMIT_BAND, drift, 1, 60.0, VISITS), 0.0))
    for offset, walk in ((0.05, 0.05), (0.0, 0.2)):
        drift, visit_s = _drift(offset, walk), WALK_HOURS * 3600.0
        images = _images(LIMIT_BAND, drift, WALK_FRAMES, visit_s / WALK_FRAMES, WALK_VISITS)
        rows.append(row(LIMIT_BAND, LIMIT_ARCSEC, drift, f"{walk:g} per √h, {WALK_HOURS:g} h", images, visit_s))
    return rows
