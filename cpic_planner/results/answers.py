"""Results of the exposure-time calculator, with their stated errors and their checks in images.

What stands behind answers of the exposure-time calculator: stated errors, and checks in images.
"""

from typing import Any, ClassVar, Literal, Self

from pydantic import PrivateAttr

from cpic_core import Reason, Status
from cpic_planner.registry import REDUCTIONS
from cpic_planner.results.base import (
    LimitColumns,
    OfTables,
    OfTarget,
    ProgrammeColumns,
    ReferencePlanetRecord,
    Result,
    Row,
    StarHeader,
    StatusText,
    VerdictColumns,
    column,
    optional,
)
from simulator.knobs import Knobs, Quantity


class Quantiles(Result):
    """The quantiles that published errors leave: 16, 50 and 84 % of the draws lie below."""

    low: float
    median: float
    high: float


class EffectRecord(Result):
    """One row of the effect ledger."""

    key: str = column("code of the effect", default="")
    effect: str
    decision: Literal["kept", "skipped"]
    reason: str
    size: float | None = optional(
        "predicted relative size on the measured quantities, the largest of them; null: no bound"
    )


class ModellingRecord(Result):
    """The way in which the images of one band were made."""

    fidelity: Literal["quick", "standard", "reference", "custom"] = column("custom: by a tolerance")
    tolerance: dict[Quantity, float] = column("largest relative error of each quantity that is asked for")
    predicted_error: dict[Quantity, float | None] = column(
        "relative error that knobs and skipped effects are predicted to cost, beside the reference; null: no bound"
    )
    draw: Literal["sums", "frames"] = column("sums of frames over the dark hole, or every frame")
    region: Literal["hole", "full"] = column("pixels that are simulated: around the hole, or whole frames")
    epochs: int = column("epochs of a visit at which the walk of the wavefront is sampled")
    knobs: Knobs
    effects: list[EffectRecord] = column("the effect ledger, in the order of the simulation")


class ImageCheck(Row):
    """One answer, observed in simulated images with its own frames; its SNR beside that of the closed form."""

    draw: Literal["sums", "frames"] = column("sums of frames over the dark hole, or every frame")
    realisations: int = column("draws of drift and noise, each reduced and measured by itself", short="runs")
    light_ratio: float = column("planet's light in images without noise over closed form", short="light", format=".4f")
    flux_ratio: float = column("mean measured over true flux of the planet", short="flux / true", format=".3f ± .3f")
    flux_ratio_error: float = column("1 sigma")
    predicted_snr: float = column(
        "closed form, of what the images hold: sums have no hits of particles", short="SNR", format=".3g"
    )
    snr: float = column(
        "mean measured flux over the quadratic mean of its measured errors", short="of images", format=".3g ± .2g"
    )
    snr_error: float = column("1 sigma")
    etc_ratio: float | None = optional(
        "predicted over recovered SNR: above 1 is optimistic; null where the planet is missed",
        label="predicted over recovered SNR",
        short="pred/rec",
        format=".2f ± .2f",
    )
    etc_ratio_error: float | None = optional("1 sigma, of the images alone; at least what is expected of so many draws")
    predicted_significance: float = column("closed form, of noise without the planet's own")
    significance: float
    agrees: bool = column("whether the SNR of images is within two of its errors and the stated one of the closed form")
    n_found: int = column("realisations in which a blind search finds the planet", short="found")
    modelled: ModellingRecord


class AnswerFidelity(Result):
    """The stated errors of one answer."""

    answer: int = column("place in `answers`, from 0")
    fidelity: Literal["quick", "standard", "reference"] = column(
        "quick: closed forms; standard: checked in sums of frames; reference: checked frame by frame"
    )
    status: StatusText = column("ok, or why images do not check it, or the tolerance is not met")
    reason: str
    message: str
    predicted_error: dict[Quantity, float | None] | None = column(
        "relative error of what answers: of the closed forms, or of the images where they check them, their chance "
        "included; null where none is known"
    )
    closed_form_error: dict[Quantity, float] | None = column(
        "largest relative error of the closed forms beside images; null where that is not measured"
    )
    images: ImageCheck | None


class EtcFidelity(Result):
    """The stated errors of the answers; answers without frames are passed over."""

    fidelity: Literal["quick", "standard", "reference", "custom"] = column("custom: by a tolerance")
    tolerance: float | None = column("largest relative error that was asked for; null for a named tier")
    seed: int | None = column("of the images; null for closed forms alone")
    answers: list[AnswerFidelity]


class OpenQuantiles(Result):
    """The quantiles of answers that what is not known leaves open: 16, 50 and 84 % of draws lie below.

    A draw without a value (outside the dark hole, out of reach) counts as an SNR of 0, and as a time or a limit without
    end, which is null.
    """

    low: float | None
    median: float | None
    high: float | None
    answered_share: float = column("share of the draws that have a value")


class KnownPlanetLook(Result):
    """A known planet that was asked for by its name, in one band, at the date."""

    planet: str
    status: str = column("confirmed, controversial, candidate or refuted")
    reference: str = column("where the orbit was published; of several the one of the largest weight")
    planets_table: str
    flags: list[str] = column("what the table lacks or marks, see catalogs.known_planets.FLAGS")
    columns_not_used: list[str] = column("headings of a user's table of planets", default=[])
    date_utc: str
    separation_arcsec: Quantiles = column("projected; the answer is for the median")
    contrast: Quantiles = column("true planet-to-star ratio of detected rates; the answer is for the median")
    value: OpenQuantiles = column("of the answer, place and contrast drawn together")
    distance_au: Quantiles = column("true distance from the star")
    phase_deg: Quantiles
    radius_rjup: Quantiles
    albedo: str
    hole_share: float = column("share of the draws between inner and outer corner of the dark hole")
    n_draws: int
    seed: int


Question = Literal["exposure_time", "signal_to_noise", "contrast_limit"]


class AskedColumns(Row):
    """The question about one target, and its answer."""

    target: str
    band: str
    question: Question
    value: float | None = column(label="answer")
    unit: str
    status: Status = column("ok: there is a number; verdict says whether the planet is detected")
    reason: Reason
    message: str
    separation_arcsec: float
    contrast: float | None


class ReductionColumns(Row):
    """The reduction that a number refers to, beside its reference visits."""

    reference_library: str | None = optional("where the reference frames come from; null in older results")
    n_modes: int | None = None
    centring: str | None = optional(
        "what is taken off before the modes: "
        + "; ".join(f"{name}, {entry.meaning}" for name, entry in REDUCTIONS.items())
        + "; null in older results"
    )
    annulus_lambda_d: float | None = optional(
        "half width of the annulus around the planet's separation whose apertures tell background and noise, lambda/D; "
        "null in older results"
    )


class EtcAnswer(LimitColumns, ReductionColumns, VerdictColumns, ProgrammeColumns, AskedColumns):
    """One answer of the exposure-time calculator for one target, band and planet.

    ``value`` (in ``unit``) is null unless ``status`` is ``ok``; the other numbers describe the chosen setting and are
    null where there is none. SNR by Eqs. 3 and 4 of Zhu et al. 2025 is that of `cpic_planner.etc.noise`, the
    probabilities are those of `cpic_planner.etc.detection`, ``limited_by`` is that of `cpic_planner.etc.budget`.
    """

    column_order: ClassVar[str] = "... exposure_limited_by gain_limited_by dominant flags"
    required_time_s: float | None = None
    snr: float | None = None
    significance: float | None = None
    threshold: float | None = None
    snr_paper: float | None = optional("SNR by Eqs. 3 and 4 of Zhu et al. 2025, for comparison")
    level: float | None = optional("SNR or significance that the answer reaches or refers to")
    core_throughput: float | None = None
    quadrant: str | None = optional(
        "dark quadrant on the detector whose diagonal the planet stands on, +x right and +y up: the one with the least "
        "light of a companion; null outside the hole and in older results"
    )
    roll_deg: float = column("roll of the telescope: position angle of the detector's +y axis", default=0.0)
    flags: tuple[str, ...] = ()
    known_planet: KnownPlanetLook | None = optional(
        "the known planet that the answer is about; null where it is about a place and a contrast"
    )
    over_instruments: OpenQuantiles | None = optional(
        "what instruments drawn by what is not known answer to the same question; null where none are asked"
    )
    _fidelity: AnswerFidelity | None = PrivateAttr(default=None)

    @property
    def fidelity(self) -> AnswerFidelity | None:
        """Stated error and check in images, where a fidelity or a tolerance was asked for."""
        return self._fidelity

    def checked(self, fidelity: AnswerFidelity) -> Self:
        """Return the same answer with its stated error and its check in images."""
        answer = self.model_copy()
        answer._fidelity = fidelity
        return answer

    def to_dict(self) -> dict[str, Any]:
        """Return a plain dict for JSON; ``fidelity`` is in it where it was asked for."""
        tree = self.model_dump(mode="json")
        return tree if self.fidelity is None else tree | {"fidelity": self.fidelity.model_dump(mode="json")}


_ASKED = optional(
    "what was asked other than by default, beside the targets: texts by the keyword, or by instrument and the key of "
    "what differs from the shipped one; null in older results"
)


class EtcResult(StarHeader, OfTarget):
    """Answers of the exposure-time calculator for one target."""

    kind: Literal["etc"] = "etc"
    asked: dict[str, str] | None = _ASKED
    reference_planet: ReferencePlanetRecord | None
    best_band: str | None
    answers: list[EtcAnswer]
    fidelity: EtcFidelity | None = optional("how firm the answers are; null in older results")


class AnsweredStar(Row):
    """One of several stars, or known planets, that a question is about."""

    target: str
    planet: str | None = optional("the known planet that was asked for by its name; null for a star")
    hip: int | None
    v_mag: float
    distance_pc: float
    best_band: str | None
    note: str = column("on the name that was given; empty for none")


class EtcStarsResult(OfTables):
    """Answers of the exposure-time calculator for several targets, each as it is answered alone."""

    main_rows: ClassVar[str] = "answers"
    kind: Literal["etc_stars"] = "etc_stars"
    asked: dict[str, str] | None = _ASKED
    catalogue: str
    date_utc: str = column("date of the places of stars and companions")
    reference_planet: ReferencePlanetRecord | None = column("null where all answers are about other planets")
    stars: list[AnsweredStar] = column("in the order in which they were asked for")
    answers: list[EtcAnswer] = column("stars in order, bands within each, then separations and planets")
    fidelity: EtcFidelity = column("how firm the answers are")
