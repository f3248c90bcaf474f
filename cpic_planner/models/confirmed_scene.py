"""Result of confirming one scene."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from cpic_planner.models.base import Row
from cpic_planner.models.columns import column
from cpic_planner.models.planned import BandConfirmation, ImagedResult


class CandidateRecord(Row):
    """One place that a blind search names."""

    x_arcsec: float = Field(description="offset on the detector, right")
    y_arcsec: float = Field(description="offset on the detector, up")
    separation_arcsec: float
    pa_deg: float = column("position angle on the sky", short="PA °", format=".1f")
    snr: float = column("of the matched filter")
    threshold: float = column("SNR that the search asks for", short="threshold")
    detected: bool
    planet: str = Field(description="planet of the scene that stands there; empty for none")


class SearchRecord(Row):
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


class PositionRecord(Row):
    """Position of a planet, mean of the bands that show it, first realisation of each."""

    planet: str
    bands: list[str]
    separation_arcsec: float
    separation_error_arcsec: float
    pa_deg: float
    pa_error_deg: float
    true_separation_arcsec: float
    true_pa_deg: float


class AlbedoRecord(Row):
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


class ConfirmResult(ImagedResult):
    """A scene, observed and measured: reproducible from configuration and seed."""

    kind: Literal["confirm"] = "confirm"
    scene: str
    bands: list[BandConfirmation] = Field(description="one a band and planet")
    searches: list[SearchRecord]
    positions: list[PositionRecord]
    albedos: list[AlbedoRecord]
