"""Results on the programmes of one star: contrast curves, completeness, injected planets, operating characteristics."""

from typing import ClassVar, Literal

from cpic_planner.results.base import (
    DetectionMode,
    OfTarget,
    ProgrammeColumns,
    ReferencePlanetRecord,
    Result,
    Row,
    RunResult,
    StarHeader,
    StatusText,
    column,
    optional,
)

_CHANCE = "probability that a blind search finds such a planet"


_THRESHOLD = "threshold of small samples (Mawet et al. 2014) at a place that is tested alone"


class SearchedProgramme(ProgrammeColumns):
    """The programme that a band's numbers are for: the one that sees faintest, or that sees the planet clearest."""

    band: str
    status: StatusText
    reason: str = ""
    message: str = ""
    separation_arcsec: float | None = column("where the programme is the best one, or where the planet stands")
    contrast: float | None = column("of the planet; of a curve the limit there")
    resolution_elements: float | None = optional(
        "areas of (lambda/D)^2 that a blind search goes through", label="elements", format=".0f"
    )
    flags: tuple[str, ...] = ()
    images: int = column("programmes that were simulated as images", default=0)
    images_message: str = column("why there are no images, where some were asked for", default="")


class CurveRow(Row):
    """Contrast limits of a programme at one separation, on the diagonal of a quadrant; null where there is none."""

    band: str
    separation_arcsec: float
    status: StatusText
    reason: str = ""
    contrast_limit_blind: float | None = column(
        "contrast of planets that a blind search finds half of", label="half found blind", short="blind", format=".2e"
    )
    contrast_limit_known_place: float | None = column(
        "contrast of planets half of which are found where their place is known",
        label="half found at their place",
        short="at place",
        format=".2e",
    )
    contrast_limit_threshold: float | None = column(
        f"contrast whose predicted significance is the {_THRESHOLD}",
        label="at the threshold",
        short="thresh",
        format=".2e",
    )
    measured_limit: float | None = optional(
        "the same in simulated images: threshold times the scatter of sums like that of a planet in the annulus, over "
        "what mask, aperture and subtraction leave of it; quadratic mean of the images",
        label="in images",
        format=".2e",
    )
    measured_limit_error: float | None = optional("standard error of measured_limit, by the scatter of the images")
    measured_throughput: float | None = optional(
        "part of an injected planet's aperture sum that the subtraction leaves", label="left", format=".3f"
    )
    threshold: float | None = column(short="thresh σ")
    core_throughput: float | None = column("part of a planet's light in its aperture", short="core", format=".3f")
    azimuth_share: float = column(
        "share of the circle on which the whole aperture lies in the dark hole",
        label="azimuths",
        short="azim %",
        format="%",
    )


class CompletenessMap(Result):
    """Probability that one programme of a star finds planets, by separation and contrast."""

    band: str
    separation_arcsec: list[float]
    contrast: list[float]
    azimuth_share: list[float] = column(
        "by separation: share of the circle on which the whole aperture lies in the dark hole"
    )
    chance: list[list[float]] = column(
        f"by separation, then contrast: {_CHANCE}; mean of the azimuths inside the dark hole. "
        "Times azimuth_share it is the probability for a planet whose position angle is not known"
    )
    chance_known_place: list[list[float]] = column("the same for a search at the place of the planet")


class RecoveredRow(Row):
    """Planets that were put into images one at a time, at a drawn azimuth in the dark hole, and searched for blind."""

    band: str
    separation_arcsec: float
    contrast: float
    n_injected: int = column("planets put into images", label="injected")
    n_recovered: int = column("planets that the search detects within lambda/D", label="found")
    recovered: float = column("found over injected", label="found", short="found %", format="%")
    recovered_low: float = column("with recovered_high: interval of 68 % (Jeffreys)", short="from %", format="%")
    recovered_high: float = column("end of that interval", short="to %", format="%")
    predicted: float = column(
        "mean probability of these planets by the law of detection, at their places",
        label="predicted",
        short="predicted %",
        format="%",
    )


class SearchedResult(StarHeader, OfTarget, RunResult):
    """The fields that every result on the programmes of a star has."""

    version: str
    date_utc: str
    instrument: str
    time_s: float = column("wall time that each band may take")
    sigma: float = column("level of a detection whose false-alarm probability the thresholds keep")
    search: DetectionMode = column("search for which the programmes are the best ones")
    reference_library: str
    n_modes: int
    images: int = column("programmes that were asked for as images in each band")
    seed: int = column("of the images")


class CurveResult(SearchedResult):
    """Contrast limits of a star against separation, completeness by separation and contrast, injected planets."""

    main_rows: ClassVar[str] = "points"
    kind: Literal["curve"] = "curve"
    injections: int = column("planets that were asked for at each separation and contrast")
    bands: list[SearchedProgramme]
    points: list[CurveRow]
    maps: list[CompletenessMap]
    recovered: list[RecoveredRow]


class RocRow(Row):
    """One level of a search: its false alarms, and how likely it finds the planet."""

    band: str
    sigma: float = column("level of a detection, as significance of a normal law", label="level", short="level σ")
    false_alarms: float = column(
        "expected in one blind search: resolution elements times the tail of a normal law beyond the level",
        label="false alarms a search",
        short="alarms",
        format=".2e",
    )
    detection_probability: float = column(_CHANCE, short="blind %")
    false_alarms_known_place: float = column(
        "expected where one place is tested alone", label="false alarms a place", short="at place", format=".2e"
    )
    detection_probability_known_place: float
    n_searches: int = column(
        "images without planets that were searched", label="images without it", short="searches", default=0
    )
    n_false: int = column("detections in images without planets", label="false alarms", short="false", default=0)
    n_planets: int = column(
        "images with the planet that were searched", label="images with it", short="planets", default=0
    )
    n_detected: int = column("images in which the planet is detected", label="planets found", short="found", default=0)
    recovered: float | None = optional("n_detected over n_planets", label="in images", short="images %", format="%")
    recovered_low: float | None = optional("with recovered_high: interval of 68 % (Jeffreys)")
    recovered_high: float | None = optional("end of that interval")


class RocProgramme(SearchedProgramme):
    """The programme of a band, and what is expected of the planet in it."""

    significance: float | None = None
    threshold: float | None = column("of small samples at the level of the strategy")


class RocResult(SearchedResult):
    """Probability of a detection against false alarms, for one planet of a star."""

    main_rows: ClassVar[str] = "levels"
    kind: Literal["roc"] = "roc"
    reference_planet: ReferencePlanetRecord | None = column("the planet; null for a given contrast")
    bands: list[RocProgramme]
    levels: list[RocRow]
