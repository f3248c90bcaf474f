"""What stands behind answers of the exposure-time calculator: stated errors, and checks in images."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from cpic_planner.models.base import Result, Row, StatusText
from cpic_planner.models.columns import column
from cpic_planner.models.modelled import ModellingRecord
from simulator.knobs import Quantity


class ImageCheck(Row):
    """One answer, observed in simulated images with its own frames; ratios are images over closed form."""

    draw: Literal["sums", "frames"] = Field(description="sums of frames over the dark hole, or every frame")
    realisations: int = column("draws of drift and noise, each reduced and measured by itself", short="runs")
    light_ratio: float = column("planet's light in its aperture, in images without noise", short="light", format=".4f")
    flux_ratio: float = column(
        "mean measured flux of the planet, after the reduction", short="flux / true", format=".3f ± .3f"
    )
    flux_ratio_error: float = Field(description="1 sigma")
    predicted_snr: float = column(
        "closed form, of what the images hold: sums have no hits of particles", short="SNR", format=".3g"
    )
    snr: float = column(
        "mean measured flux over the quadratic mean of its measured errors", short="of images", format=".3g ± .2g"
    )
    snr_error: float = Field(description="1 sigma")
    snr_ratio: float = column("SNR over predicted_snr", short="images / SNR", format=".2f ± .2f")
    snr_ratio_error: float = Field(
        description="1 sigma, of the images alone; at least what is expected of so many draws"
    )
    predicted_significance: float = Field(description="closed form, of noise without the planet's own")
    significance: float
    agrees: bool = Field(
        description="whether the SNR of images is within two of its errors and the stated one of the closed form"
    )
    n_found: int = column("realisations in which a blind search finds the planet", short="found")
    modelled: ModellingRecord


class AnswerFidelity(Result):
    """How firm one answer is."""

    answer: int = Field(description="place in `answers`, from 0")
    fidelity: Literal["quick", "standard", "reference"] = Field(
        description="quick: closed forms; standard: checked in sums of frames; reference: checked frame by frame"
    )
    status: StatusText = Field(description="ok, or why images do not check it, or the tolerance is not met")
    reason: str
    message: str
    predicted_error: dict[Quantity, float | None] | None = Field(
        description="relative error of what answers: of the closed forms, or of the images where they check them, "
        "their chance included; null where none is known"
    )
    closed_form_error: dict[Quantity, float] | None = Field(
        description="largest relative error of the closed forms beside images; null where that is not measured"
    )
    images: ImageCheck | None


class EtcFidelity(Result):
    """How firm the answers are; answers without frames are passed over."""

    fidelity: Literal["quick", "standard", "reference", "custom"] = Field(description="custom: by a tolerance")
    tolerance: float | None = Field(description="largest relative error that was asked for; null for a named tier")
    seed: int | None = Field(description="of the images; null for closed forms alone")
    answers: list[AnswerFidelity]
