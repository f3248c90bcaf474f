"""Results of a plan.

Result of confirming one scene.
"""

from typing import Any, ClassVar, Literal

from cpic_planner.results.answers import ModellingRecord
from cpic_planner.results.base import (
    Column,
    FramesColumns,
    OfTables,
    RankedSample,
    Result,
    Row,
    RunResult,
    SampleResult,
    StarRow,
    StatusText,
    VerdictText,
    column,
    optional,
)
from cpic_planner.results.ranked import RankedTarget, SeasonRecord
from simulator.knobs import Quantity

_CHOSEN_FOR = column(
    "planet for which visits and frames of the band were chosen; empty where they were given, and in older results",
    default="",
)


class AuditRecord(Row):
    """One realisation with every effect of the camera, calibrated, particles taken out.

    A part of its frames is run one by one; what the effects do to them is carried to all of them.
    """

    n_frames: int = column("science frames; reference frames are as many times the strategy's ratio")
    frames_run: int = column("science and reference frames that were run one by one", label="frames run", format="d")
    frames_in_all: int = column("science and reference frames of the programme", label="of frames", format="d")
    predicted_snr: float | None = optional(
        "frames that particles void are counted; null for a reduction without a closed form", label="predicted SNR"
    )
    recovered_snr: float = column(label="measured SNR")
    recovered_significance: float
    contrast: float = column(label="measured contrast", format=".2e ± .1e")
    contrast_error: float = column("1 sigma")
    deviation_sigma: float = column("measured less true contrast over its error", label="deviation in σ", format=".1f")
    detected: bool = column("the blind search finds the planet at its place", label="blind search")
    false_detections: int = column("what the search finds elsewhere", label="detections elsewhere", format="d")
    hits: int = column(
        "pixel-frames of particles that were found in the frames that were run", label="hits of particles", format="d"
    )
    rejected_fraction: float = column(
        "share of the pixel-frames of the hole that were left out", label="left out of the hole", format="%"
    )
    saturated_in_hole: int = column(label="saturated in the hole", format="d")
    saturated_outside: float = column("mean per frame", label="saturated around it, per frame", format=".0f")


class ObservationRow(Row):
    """One observation of a planet in one band: one realisation, all its visits reduced together.

    Realisations are draws of one and the same observation: a fit of an orbit or a spectrum takes one of them.
    """

    realisation: int = column("number of the draw of drift and noise, from 1")
    epoch_mjd: float = column("middle of the observation, from its first visit to its last", format=".4f")
    detected: bool = column(
        "the blind search finds the planet; of two rolls, its significance at the place reaches the threshold"
    )
    contrast: float = column("measured at the planet's place", format=".2e ± .1e")
    contrast_error: float = column("1 sigma of the planet's noise and the background's; not that of the star's flux")
    contrast_limit: float = column("contrast whose significance at the place is the threshold")
    star_flux_error: float = column("relative error of the star's measured light, the same in all realisations")
    separation_arcsec: float | None = optional("fitted; null without a detection and a fit that comes to rest")
    separation_error_arcsec: float | None = None
    pa_deg: float | None = optional("position angle, east of north")
    pa_error_deg: float | None = None
    separation_pa_correlation: float | None = optional("of the errors of separation and position angle")
    east_arcsec: float | None = optional("offset from the star in right ascension times the cosine of declination")
    east_error_arcsec: float | None = None
    north_arcsec: float | None = optional("offset from the star in declination")
    north_error_arcsec: float | None = None
    east_north_covariance: float | None = optional("of the errors of both offsets", unit="arcsec2")
    flags: tuple[str, ...] = column("of the fit: low_snr, edge, whole_region (cpic_planner.Astrometry)", default=())


class BandConfirmation(FramesColumns):
    """One band of one target: prediction beside the measurement in simulated images.

    Recovered numbers are those of one observation, averaged over the realisations: mean contrast over the quadratic
    mean of its error is the SNR, as variances are unbiased where ratios are not.
    """

    column_order: ClassVar[str] = (
        "band planet status reason message separation_arcsec pa_deg exposure_s visits reference_visits "
        "frames_per_visit n_frames em_gain integration_s time_s telescope_h unused_s"
    )
    band: str
    planet: str = column("name of the planet", default="reference planet")
    status: StatusText
    reason: str
    message: str
    separation_arcsec: float
    pa_deg: float = column(label="position angle", format=".1f")
    visits: int | None = optional(format="d")
    frames_per_visit: int | None = None
    telescope_h: float | None = optional(
        "telescope time as surveys count it: slews, settling and occultations of all visits, at the mean visibility of "
        "the star's days in the period of a plan; null where there is none, and where it does not fit them",
        label="telescope time",
        format=".1f",
    )
    chosen_for: str = _CHOSEN_FOR
    realisations: int | None = optional("independent draws of drift and noise")
    drawn_as: Literal["sums", "frames", "files"] | None = optional(
        "sums of frames over the hole, or every frame, where sums cannot stand for them; files that were measured"
    )
    predicted_snr: float | None = optional(
        "of one observation, noise of the planet included", label="predicted SNR", short="SNR pred", format=".3g"
    )
    predicted_significance: float | None = None
    recovered_snr: float | None = optional(
        "the same from the images, mean of the realisations",
        label="recovered SNR ± error of the mean",
        short="SNR rec",
        format=".3g ± .2g",
    )
    recovered_snr_error: float | None = optional("1 sigma of this mean")
    recovered_significance: float | None = None
    threshold: float | None = optional("small-sample threshold for significance")
    predicted_verdict: VerdictText | None = optional(
        "what the calculator expects of these frames: detected where half of such observations detect the planet, by "
        "the search that was asked for, else measured_not_detected; detected and verdict are what the images say; null "
        "without frames"
    )
    predicted_detection_probability: float | None = None
    predicted_detection_probability_known_place: float | None = None
    etc_ratio: float | None = optional(
        "predicted over recovered SNR: above 1 is optimistic; null where the planet is missed or too faint to tell",
        label="predicted over recovered SNR",
        short="pred/rec",
        format=".2f ± .2f",
    )
    etc_ratio_error: float | None = optional("1 sigma, with the accuracy of the prediction itself")
    true_contrast: float | None = optional("planet over star in the scene", short="contrast true", format=".2e")
    recovered_contrast: float | None = optional("mean contrast of the images", short="recovered", format=".2e")
    contrast_error: float | None = optional("1 sigma of one observation, from aperture-sized samples in the hole")
    contrast_mean_error: float | None = optional("1 sigma of recovered_contrast")
    star_flux: Literal["off_mask", "field_star", "known"] | None = optional(
        "what contrasts refer to: a series off the mask, a field star, or the scene's own rate",
        label="the star's light, from",
    )
    star_flux_error: float | None = optional("relative, common to all realisations")
    star_flux_density: float | None = optional(
        "mean flux density of the star by its V magnitude and spectrum, weighted by photons and throughput",
        unit="W m-2 um-1",
    )
    effective_wavelength_nm: float | None = optional("of the star's photons in the band")
    band_center_nm: float | None = optional("middle of the band")
    band_width_nm: float | None = optional("full width of the band")
    rdi_throughput: float | None = optional(label="RDI throughput", format="%")
    rdi_modes_used: int | None = optional("beside the mean, around the planet", label="RDI modes")
    core_throughput: float | None = optional(format="%")
    n_background_apertures: int | None = optional(label="background apertures")
    saturated_in_hole: int | None = optional(
        "pixels of the hole that a limit cut off, in all frames", label="saturated in the hole, all frames", format="d"
    )
    saturated_outside: float | None = optional(
        "pixels around the hole that a limit cut off, mean per frame; they do not reach the hole",
        label="saturated around it, per frame",
        format=".0f",
    )
    n_detected: int | None = optional(
        "realisations in which the blind search finds the planet", label="found by the blind search", short="found"
    )
    search_snr: float | None = optional(
        "matched-filter SNR there, mean of the realisations in which the search has a peak", label="SNR of the search"
    )
    search_threshold: float | None = optional(
        "SNR that the search asks for there: heavy tails of the speckles and all positions are in it",
        label="threshold of the search",
    )
    n_significant: int | None = optional(
        "realisations whose significance at the known place reaches the threshold: another statistic with another "
        "threshold than those of the search, which decides",
        label="significant at the known place",
    )
    false_detections: int | None = optional(
        "what it finds elsewhere, all realisations", label="detections elsewhere, all realisations"
    )
    detected: bool | None = optional("found in at least half of the realisations")
    found_separation_arcsec: float | None = optional("fitted, first realisation that shows it")
    found_separation_error_arcsec: float | None = None
    found_pa_deg: float | None = None
    found_pa_error_deg: float | None = None
    verdict: str = column("in words", default="")
    audit: AuditRecord | None = None
    modelled: ModellingRecord | None = optional("null where no image was asked for")
    image: str | None = optional("key of the stored panels")
    observations: list[ObservationRow] = column("one a realisation; empty in older results", default=[])


class ConfirmedTarget(Result):
    """One target that was simulated and measured."""

    name: str
    hip: int | None
    ranked: RankedTarget
    planet_distance_au: float
    roll_deg: float | None = optional(
        "roll that a schedule asks for, by which companions stand in the images; position angles of the bands are then "
        "counted from the detector's +y axis; null: none, north is up"
    )
    chosen_band: str | None = column(
        "of the bands in which the blind search finds the planet, that of highest predicted margin; without any, of "
        "those that show it at its known place; null if none does"
    )
    verdict: str = column("of all bands, in words", default="")
    etc_ratio: float | None = optional("predicted over recovered SNR, mean of the bands")
    etc_ratio_error: float | None = None
    detection_telescope_h: float | None = optional(
        "telescope time, as that of the bands, of ranked.detection_time_s, with frames as long as those of the ranking"
    )
    rank_lowest: int | None = optional("lowest number of its rank in sensitivity.json; null where that has none")
    rank_highest: int | None = optional("highest number of it")
    bands: list[BandConfirmation]


class ImagedResult(RunResult):
    """The findings in the images of a plan or scene: reproducible from configuration and seed."""

    version: str
    config_hash: str
    seed: int
    fidelity: str = column("quick, standard, reference; custom where a tolerance was given")
    tolerance: dict[Quantity, float] = column("largest relative error that may be traded for speed", default={})
    instrument: str
    sigma: float
    reference_library: str
    rdi_modes: int
    realisations: int = column("draws of drift and noise of every target and band", default=1)
    simulator_overrides: dict[str, Any] = column(
        "what is altered in the images alone; predictions keep the nominal instrument", default={}
    )
    calibration: dict[str, float | int | None] = column(
        "etc_ratio, etc_ratio_error: mean of predicted over recovered SNR over the n_bands that tell; null where none "
        "does; etc_ratio_least: exceeded where planets are missed; n_faint: bands too faint to tell"
    )
    calibration_text: str = column(
        "the same in words: whether the ETC is optimistic or pessimistic, and by how much", default=""
    )
    not_modelled: list[str] = column(
        "effects that neither the prediction nor the images contain, but for an audited realisation"
    )


class LeftOutRow(StarRow):
    """A star that is not proposed because it cannot be observed in the period of the plan."""

    rank: int = column("in the ranking, which knows no visibility", label="#")
    limited_by: Literal["visibility"] = "visibility"
    usable_h: float = column("time of the period in which it is seen and may be pointed at", label="seen", format=".1f")
    needed_h: float | None = optional("wall time of its best observation; null: none has frames", format=".1f")
    message: str = column("why it is left out, in words", label="why")


class SeenRow(StarRow):
    """The times when a target of a plan can be seen in its period."""

    usable_h: float = column("time of the period in which it is seen and may be pointed at", label="seen", format=".1f")
    seasons: list[SeasonRecord]


class PeriodRecord(Result):
    """The period in which the stars of a plan have to be seen, and which of the first stars are not."""

    start_utc: str
    n_days: int
    pointing: str = column("limits of pointing: preset or name in the file")
    seen: list[SeenRow] = column("the targets that are seen, in their order; empty in older results", default=[])
    left_out: list[LeftOutRow] = column("they would have been among the confirmed targets")
    not_checked: list[str] = column("targets without coordinates")


class NotImagedRow(Row):
    """A line of a schedule that has no images."""

    row: int = column("number of the line in the file, its heading not counted", label="row")
    star: str = column("as the file names it")
    band: str
    message: str = column("why there are none, in words", label="why")


class ScheduleImages(Result):
    """The visits of a schedule that were confirmed with images."""

    source: str = column("number of visits, strategy, name and checksum of the file")
    n_visits: int = column("lines without an outcome: visits still to be made")
    n_imaged: int = column("of them, those that the images stand for")
    n_stars: int = column("stars of the lines that can be imaged; those beyond the first --top are left")
    not_imaged: list[NotImagedRow] = column("empty: every visit of these stars is in the images")


class PlanResult(RankedSample, OfTables, ImagedResult):
    """The plan: reproducible from configuration and seed."""

    kind: Literal["plan"] = "plan"
    companions: Literal["on", "off"] = column("whether the light of known companions counts", default="on")
    reference_star_v_mag: float | None = optional("V magnitude of the reference star; null where the library has none")
    reference_star_teff_k: float | None = optional("temperature of the reference star, K")
    n_ranked: int = column("stars of the ranking that pass the filters")
    period: PeriodRecord | None = optional("null for a schedule, which has dates of its own, and in older results")
    schedule: ScheduleImages | None = optional("null where the ranking chooses the targets, and in older results")
    targets: list[ConfirmedTarget]


class CandidateRecord(Row):
    """One place that a blind search names."""

    x_arcsec: float = column("offset on the detector, right")
    y_arcsec: float = column("offset on the detector, up")
    separation_arcsec: float
    pa_deg: float = column("position angle on the sky", short="PA °", format=".1f")
    snr: float = column("of the matched filter")
    threshold: float = column("SNR that the search asks for", short="threshold")
    detected: bool
    planet: str = column("planet of the scene that stands there; empty for none")


class LimitRow(Row):
    """Contrast limit of the first realisation at one separation, on a diagonal of the dark hole, at a known place."""

    separation_arcsec: float
    threshold: float = column("of small samples at the level of the strategy")
    throughput: float = column("part of a planet's sum that the subtraction leaves")
    contrast_limit: float = column("threshold times the scatter of sums like that of a planet around the place")


class SearchRecord(Row):
    """The blind search of the first realisation in one band."""

    band: str
    exposure_s: float
    n_frames: int = column("science frames of a visit")
    em_gain: float
    visits: int | None = None
    time_s: float | None = None
    unused_s: float | None = None
    chosen_for: str = _CHOSEN_FOR
    realisations: int
    false_detections: int | None = column(
        "detections that are no planet of the scene, all realisations; null for files without a scene"
    )
    resolution_elements: float = column("searched area over (lambda/D)^2")
    sigma: float = column("false-alarm probability per element is that of so many sigma in a normal law")
    candidates: list[CandidateRecord]
    curve: list[LimitRow] = column("empty without the star's light, and in older results", default=[])


class ProductVisitRecord(Row):
    """One visit whose frames were read from files, and how far its star was from the place that the headers state."""

    band: str
    role: Literal["science", "reference"]
    visit: int = column("its number among those of its role, from 1", format="d")
    files: list[str]
    n_frames: int = column("frames that were read", format="d")
    exposure_s: float
    em_gain: float
    roll_deg: float = column("position angle of the detector's +y axis", short="roll °", format=".2f")
    mjd: float | None = optional("begin of its first exposure, UTC")
    shift_x_pixel: float | None = optional(
        "shift of the star's light along columns beside the mean of all visits; null where the light tells none",
        label="shift in x",
        short="shift x px",
        format=".4f",
    )
    shift_x_error_pixel: float | None = optional("1 sigma: noise, and speckles that changed")
    shift_y_pixel: float | None = optional("the same along rows", label="shift in y", short="shift y px", format=".4f")
    shift_y_error_pixel: float | None = optional("1 sigma")
    moved: bool = column(
        "frames were moved by this shift, which is significant; else the place of the headers holds",
        label="visit moved",
    )
    frames_moved: int = column(
        "frames that were moved beside the mean of their visit, by as much as each shows",
        label="frames moved",
        format="d",
    )


class SourceRecord(Row):
    """A source that a blind search detects in files, with what was measured of it in one band."""

    band: str
    source: str = column("planet or star of the scene that stands there; empty for none, and without a scene")
    mjd: float | None = optional("mean of the middles of the science exposures, UTC", format=".5f")
    separation_arcsec: float = column(format=".4f")
    separation_error_arcsec: float = column("1 sigma of the fit of the place")
    pa_deg: float = column("position angle on the sky", short="PA °", format=".2f")
    pa_error_deg: float
    east_arcsec: float = column("offset from the star to the east: of right ascension times cos(declination)")
    north_arcsec: float = column("offset from the star to the north")
    ra_deg: float | None = optional("null where the headers have no coordinates of the star")
    dec_deg: float | None = None
    rate_e_s: float | None = optional(
        "detected rate without mask, apodizer and aperture, by forced photometry at the fitted place",
        label="light",
        short="light e-/s",
        format=".3g",
    )
    rate_error_e_s: float | None = optional("1 sigma, of the scatter of aperture sums")
    contrast: float | None = optional("over the light of the star; null where that is not known", format=".2e ± .1e")
    contrast_error: float | None = optional("1 sigma, the error of the star's light included")
    snr: float | None = optional("of the forced photometry", format=".1f")
    search_snr: float = column(
        "of the matched filter of the search", label="SNR of the search", short="SNR", format=".1f"
    )
    search_threshold: float = column("SNR that the search asks for there", label="threshold", format=".1f")
    flags: list[str] = column("of the fit of the place: not_converged, low_snr, edge, whole_region")


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
    """Metallicity and clouds by band contrasts: mean contrasts, errors of one observation a band."""

    planet: str
    bands: list[str]
    status: Literal["constrained", "not_constrained", "degenerate"]
    log10_mh: float = column("median of the posterior, clouds integrated over")
    log10_fsed: float = column("median of the posterior, metallicity integrated over")
    best_fit: list[float] | None = optional(
        "log10_mh and log10_fsed of the least chi2 of both together: one of them may lie outside its interval"
    )
    mean: list[float] = column("of the posterior: log10_mh, log10_fsed")
    covariance: list[list[float]]
    correlation: float
    log10_mh_interval: list[float] = column("central 68 % around the median")
    log10_fsed_interval: list[float] = column("central 68 % around the median")
    chi2: float
    degrees_of_freedom: int
    p_value: float | None
    open_edges: list[str] = column("ends of the allowed ranges that the 95 % region reaches")
    flags: list[str]


class StarImagesResult(SampleResult, ImagedResult):
    """Stars with their reference planets, observed and measured: reproducible from configuration and seed."""

    kind: Literal["star_images"] = "star_images"
    date_utc: str = column("date of the places of stars and companions")
    targets: list[ConfirmedTarget]


class ConfirmResult(ImagedResult):
    """A scene, observed and measured: reproducible from configuration and seed."""

    kind: Literal["confirm"] = "confirm"
    scene: str
    bands: list[BandConfirmation] = column("one a band and planet")
    searches: list[SearchRecord]
    positions: list[PositionRecord]
    albedos: list[AlbedoRecord]
    visits: list[ProductVisitRecord] = column("of the files that were measured; empty for simulated images", default=[])
    sources: list[SourceRecord] = column(
        "what the search detects in files, measured; empty for simulated images", default=[]
    )

    def _table(self, rows: str = "") -> tuple[list[Column], list[Any]]:
        """Return the rows that are asked for; by default those of sources where no planet of a scene is compared."""
        return super()._table(rows or ("sources" if self.sources and not self.bands else ""))

    @property
    def bare(self) -> bool:
        """Whether files were measured of which no scene is known: nothing is compared."""
        return bool(self.visits) and all(search.false_detections is None for search in self.searches) and not self.bands
