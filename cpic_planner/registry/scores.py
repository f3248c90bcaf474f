"""The registry of scores: the numbers that can order a ranking."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from cpic_core import FloatArray, Registry


@dataclass(frozen=True)
class StarNumbers:
    """The numbers that a score is made of; arrays of ``n`` stars, or of ``b`` bands and ``n`` stars.

    Those of the stars alone are of the reference planet in its best band, and have the names of
    `cpic_planner.ranking.optimiser.OptimalSetting`.

    Attributes
    ----------
    completeness : ndarray, shape (b, n)
        Fraction of the population that one observation detects; -1 in bands that must not win.
    completeness_per_hour : ndarray, shape (b, n)
        The same over the wall time, per hour; -1 in bands that must not win.
    detections_per_hour : ndarray, shape (n,)
        One over the least wall time of a detection, per hour; 0 for none, and for scores that do not ask for it
        (`Score.timed`).
    margin, snr, significance : ndarray, shape (n,)
        Significance over threshold, photometric SNR, significance.
    contrast, deepest_limit : ndarray, shape (n,)
        Contrast of the reference planet, and the faintest one detected anywhere in the dark hole (inf for none).
    time_s : ndarray, shape (n,)
        Wall time of the observation; 0 for none.
    """

    completeness: FloatArray
    completeness_per_hour: FloatArray
    detections_per_hour: FloatArray
    margin: FloatArray
    snr: FloatArray
    significance: FloatArray
    contrast: FloatArray
    deepest_limit: FloatArray
    time_s: FloatArray


def _most(of_bands: FloatArray) -> FloatArray:
    return np.asarray(of_bands.max(axis=0))


def _hourly(numbers: StarNumbers) -> FloatArray:
    return numbers.completeness_per_hour


@dataclass(frozen=True)
class Score:
    """One entry: how stars are scored, and the words for it.

    Attributes
    ----------
    name : str
        As options, configurations and results have it.
    label : str
        Heading of a narrow column.
    meaning : str
        What the number is, without a full stop.
    aim : str
        What stars are ranked by, for the middle of a sentence; ``{share}`` stands for the fraction of the population
        that one observation detects, ``{hourly}`` for "per hour" of it.
    unit : str
        Unit of the number as people read it, empty for none; a fraction is written in per cent.
    value : callable
        Score of each star from `StarNumbers`, shape (n,); more is better.
    by_band : callable
        Number, shape (b, n), whose largest picks the band that the completeness of a row is for.
    timed : bool
        Whether the least time of a detection has to be found.
    from_zero : bool
        Whether 0 says that there is nothing, so that such stars have no order by the score.
    column : str
        Column of `RankedTarget` that has the same number; empty for none.
    decimals : int or None
        Decimals of the number as text; None for significant digits.
    """

    name: str
    label: str
    meaning: str
    aim: str
    value: Callable[[StarNumbers], FloatArray]
    unit: str = ""
    by_band: Callable[[StarNumbers], FloatArray] = _hourly
    timed: bool = False
    from_zero: bool = True
    column: str = ""
    decimals: int | None = None

    @property
    def scale(self) -> float:
        """Factor from the number to what is written in its unit."""
        return 100.0 if self.unit.startswith("%") else 1.0

    @property
    def title(self) -> str:
        """The name as words."""
        return self.name.replace("_", " ")


def _depth(numbers: StarNumbers) -> FloatArray:
    deepest = numbers.deepest_limit
    with np.errstate(divide="ignore"):
        return np.where(np.isfinite(deepest), -np.log10(deepest), -99.0)


SCORES: Registry[Score] = Registry(
    "score",
    (
        Score(
            name="completeness_per_hour",
            label="% per h",
            meaning="fraction of the population that one observation detects, per hour of it, in the band where that "
            "is most",
            aim="{share} {hourly}",
            unit="%/h",
            value=lambda numbers: _most(numbers.completeness_per_hour),
        ),
        Score(
            name="completeness",
            label="compl %",
            meaning="fraction of the population that one observation detects, in the band where that is most",
            aim="{share}",
            unit="%",
            value=lambda numbers: _most(numbers.completeness),
            by_band=lambda numbers: numbers.completeness,
            column="completeness",
        ),
        Score(
            name="detection_margin",
            label="margin",
            meaning="significance of the reference planet over the detection threshold",
            aim="how clearly a reference planet is detected",
            value=lambda numbers: numbers.margin,
            column="detection_margin",
        ),
        Score(
            name="detection_time",
            label="1/time",
            meaning="reference planets detected per hour: one over the least wall time that does",
            aim="how soon a reference planet is detected",
            unit="1/h",
            value=lambda numbers: numbers.detections_per_hour,
            timed=True,
        ),
        Score(
            name="photometric_snr",
            label="SNR",
            meaning="photometric SNR of the reference planet in its best band",
            aim="how precisely the light of a reference planet is measured",
            value=lambda numbers: numbers.snr,
            column="snr",
        ),
        Score(
            name="contrast_limit",
            label="−log C",
            meaning="minus log10 of the faintest contrast detected anywhere in the dark hole",
            aim="the faintest contrast that is detected",
            value=_depth,
            from_zero=False,
            decimals=2,
        ),
    ),
)

ScoreName = Annotated[str, SCORES]
"""Name of a score, as a type."""
DEFAULT_SCORE = "completeness_per_hour"
