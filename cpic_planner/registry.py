"""Registries: scores of a ranking, reductions by reference frames, and filters of a planet's flux, an entry each.

An entry of a reduction says what is subtracted before modes are projected out, what that leaves of a planet, the noise
that it adds, and the words for it; images and the calculator take it from here. `Reduction` itself is the mean of the
references, with the principal components around it (Amara & Quanz 2012, MNRAS 427, 948); the others differ from it.
Images are rows of pixels, shape (images, pixels). Two rolls are reduced by the same entry, each the other's reference.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated

import numpy as np

from cpic_core import FloatArray, Record, Registry


class Reduction:
    """The mean reference image is subtracted; the base of the other reductions.

    Attributes
    ----------
    name : str
        Word for it in options, configurations and results (``centring``).
    meaning : str
        What is taken off before the modes.
    follows_references : bool
        Whether light that all references show alike leaves every image with what is subtracted, and cannot reach the
        modes: then the forward model of a planet in the references is exact.
    needs_images : bool
        Whether the references are needed one by one even where no modes are projected out, and not their sum alone.
    predicted : bool
        Whether the closed forms of the calculator hold: those of the mean of the references and of its modes. The
        calculator refuses a reduction without them.
    """

    name = "temporal"
    meaning = "the mean of the reference frames in every pixel"
    follows_references = True
    needs_images = False
    predicted = True

    def centre(self, science: FloatArray, references: FloatArray) -> None:
        """Take off science and reference images what is subtracted before the modes, in place.

        Parameters
        ----------
        science, references : ndarray, shapes (n, pixels) and (m, pixels)
        """
        centre = self.combined(references)
        science -= centre
        references -= centre

    def combined(self, references: FloatArray) -> FloatArray:
        """Return the image that the references make together, shape (pixels,)."""
        return np.asarray(references.mean(axis=0))

    def left_of(self, planet: FloatArray) -> FloatArray:
        """Return what is left, before the modes, of images of a planet that no reference shows; shape (n, pixels)."""
        return planet

    def reference_variance(self, images: int, n_modes: int) -> float:
        """Return the variance of white noise that the references add, over that of the mean of all of them.

        Parameters
        ----------
        images : int
            Reference images that are combined.
        n_modes : int
            Modes that are projected out after that.
        """
        return 1.0


class SpatialMean(Reduction):
    """Every image loses its own mean over the region, as in KLIP (Soummer et al. 2012, ApJ 755, L28)."""

    name = "spatial"
    meaning = "the mean of each image over the region"
    follows_references = False
    needs_images = True
    predicted = False

    def centre(self, science: FloatArray, references: FloatArray) -> None:
        """Take off every image its own mean; see `Reduction.centre`."""
        science -= science.mean(axis=1, keepdims=True)
        references -= references.mean(axis=1, keepdims=True)

    def left_of(self, planet: FloatArray) -> FloatArray:
        """Return the planet less its mean over the region; see `Reduction.left_of`."""
        return np.asarray(planet - planet.mean(axis=1, keepdims=True))

    def reference_variance(self, images: int, n_modes: int) -> float:
        """Return that of the first mode, which is nearly the mean image; nothing without modes."""
        return float(n_modes > 0)


class Uncentred(SpatialMean):
    """Nothing is taken off before the modes, the first of which is nearly the mean image."""

    name = "none"
    meaning = "nothing"

    def centre(self, science: FloatArray, references: FloatArray) -> None:
        """Leave the images as they are; see `Reduction.centre`."""

    def left_of(self, planet: FloatArray) -> FloatArray:
        """Return all of it; see `Reduction.left_of`."""
        return planet


REDUCTIONS: Registry[Reduction] = Registry("centring", (Reduction(), SpatialMean(), Uncentred()))

ReductionName = Annotated[str, REDUCTIONS]
"""Name of a reduction, as a type."""
DEFAULT_REDUCTION = Reduction.name


class FluxFilter(Record):
    """One entry: how the flux of a planet at its place is measured in images.

    Attributes
    ----------
    name : str
        As options, configurations and results have it.
    meaning : str
        What is done and taken for granted, for the middle of a sentence.
    weighs_by_image : bool
        Whether the sum weighs by the planet's image, and not by a circle.
    takes_opposite : bool
        Whether what the opposite place explains is taken off before.
    takes_covariance : bool
        Whether pixels weigh by the inverse covariance of noise and speckles, which stands for modes.
    """

    name: str
    meaning: str
    weighs_by_image: bool = False
    takes_opposite: bool = False
    takes_covariance: bool = False

    @property
    def of_two_rolls(self) -> bool:
        """Tell whether it can measure two rolls, which show the planet's negative at a second place."""
        return not (self.takes_opposite or self.takes_covariance)


FILTERS: Registry[FluxFilter] = Registry(
    "filter",
    (
        FluxFilter("aperture", "the sum over a circle"),
        FluxFilter("matched", "weighing by the planet's image", weighs_by_image=True),
        FluxFilter(
            "mirror",
            "aperture sums after what the opposite place explains is taken off, which takes for granted that wavefront "
            "errors are of phase and no source stands there",
            takes_opposite=True,
        ),
        FluxFilter(
            "whitened",
            "weighing by the inverse covariance of noise and speckles, which takes for granted that the optical model "
            "is that of this very instrument: the star's field in the dark hole, the state of the mirror, and errors "
            "of phase with the spectrum of the drift",
            takes_covariance=True,
        ),
    ),
)

FilterName = Annotated[str, FILTERS]
"""Name of a filter, as a type."""
DEFAULT_FILTER = "aperture"


class StarNumbers(Record):
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


class Score(Record):
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
        Unit of the number, empty for none.
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
    def written(self) -> tuple[float, str]:
        """Factor from the number to what people read, and its unit: fractions are read in per cent."""
        return (100.0, self.unit.replace("1", "%") or "%") if "%" in self.label else (1.0, self.unit)

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
            unit="1/h",
            value=lambda numbers: _most(numbers.completeness_per_hour),
        ),
        Score(
            name="completeness",
            label="compl %",
            meaning="fraction of the population that one observation detects, in the band where that is most",
            aim="{share}",
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
