"""Result of confirming one scene."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field

from cpic_planner.models.base import Result
from cpic_planner.models.planned import BandConfirmation
from simulator.knobs import Quantity

__all__ = ["AlbedoRecord", "CandidateRecord", "ConfirmResult", "PositionRecord", "SearchRecord"]


class CandidateRecord(Result):
    """One place that a blind search names."""

    x_arcsec: float = Field(description="offset on the detector, right")
    y_arcsec: float = Field(description="offset on the detector, up")
    separation_arcsec: float
    pa_deg: float = Field(description="position angle on the sky")
    snr: float = Field(description="of the matched filter")
    threshold: float
    detected: bool
    planet: str = Field(description="planet of the scene that stands there; empty for none")


class SearchRecord(Result):
    """The blind search of the first realisation in one band."""

    band: str
    exposure_s: float
    n_frames: int
    em_gain: float
    realisations: int
    false_detections: int = Field(description="detections that are no planet of the scene, all realisations")
    resolution_elements: float = Field(description="searched area over (lambda/D)^2")
    sigma: float = Field(description="false-alarm probability per element is that of so many sigma in a normal law")
    candidates: list[CandidateRecord]


class PositionRecord(Result):
    """Position of a planet, mean of the bands that show it, first realisation of each."""

    planet: str
    bands: list[str]
    separation_arcsec: float
    separation_error_arcsec: float
    pa_deg: float
    pa_error_deg: float
    true_separation_arcsec: float
    true_pa_deg: float


class AlbedoRecord(Result):
    """What band contrasts say of metallicity and clouds: mean contrasts, errors of one observation a band."""

    planet: str
    bands: list[str]
    status: Literal["constrained", "not_constrained", "degenerate"]
    log10_mh: float = Field(description="best fit")
    log10_fsed: float = Field(description="best fit")
    mean: list[float] = Field(description="of the posterior: log10_mh, log10_fsed")
    covariance: list[list[float]]
    correlation: float
    log10_mh_interval: list[float] = Field(description="68 %")
    log10_fsed_interval: list[float] = Field(description="68 %")
    chi2: float
    degrees_of_freedom: int
    p_value: float | None
    open_edges: list[str] = Field(description="ends of the allowed ranges that the 95 % region reaches")
    flags: list[str]


class ConfirmResult(Result):
    """A scene, observed and measured: reproducible from configuration and seed."""

    schema_version: Literal[1] = 1
    kind: Literal["confirm"] = "confirm"
    version: str
    config_hash: str
    scene: str
    instrument: str
    seed: int
    fidelity: str = Field(description="quick, standard, reference; custom where a tolerance was given")
    tolerance: dict[Quantity, float] = Field(
        default_factory=dict, description="largest relative error that may be traded for speed"
    )
    realisations: int
    sigma: float
    reference_library: str
    rdi_modes: int
    simulator_overrides: dict[str, Any]
    calibration: dict[str, float | int | None]
    calibration_text: str
    not_modelled: list[str] = Field(description="effects that the realisations leave out, but for the audited one")
    bands: list[BandConfirmation] = Field(description="one a band and planet")
    searches: list[SearchRecord]
    positions: list[PositionRecord]
    albedos: list[AlbedoRecord]
