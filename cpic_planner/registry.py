"""Registries: scores of a ranking, libraries of reference frames, and reductions by them, in one entry each.

An entry of a library says what its frames show, in the exposure-time calculator and in the images alike, what it costs,
and the words for it. `Library` itself is the library of the same star without its planet; the others differ from it.

An entry of a reduction says what is subtracted before modes are projected out, what that leaves of a planet, the noise
that it adds, and the words for it; images and the calculator take it from here. `Reduction` itself is the mean of the
references, with the principal components around it (Amara & Quanz 2012, MNRAS 427, 948); the others differ from it.
Images are rows of pixels, shape (images, pixels). Two rolls are reduced by the same entry, each the other's reference.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, TypeVar

import numpy as np

from cpic_core import FloatArray, InputError, Registry
from simulator.config import Scene, SceneStar

if TYPE_CHECKING:
    from cpic_planner.queries.shared import Reduction as LibrarySettings, ReferenceStar

Visits = TypeVar("Visits", int, FloatArray)


@dataclass(frozen=True)
class LibraryNoise:
    """Noise of reference frames once their star is scaled to that of the science frames.

    Attributes
    ----------
    halo, even : ndarray
        Factors of the variance of star light, and of light that does not come from the star.
    scale : ndarray
        Factor of the variance that every frame has (clock-induced charge, read noise).
    companion : float
        1 where the library shows the companion's light too.
    peak : ndarray
        Brightness of the brighter of the two stars, over the science star: it must not saturate either.
    speckle : float
        1, or 0 for an idealised library.
    variance_factor : float
        1, or 1/2 where science and reference frames both show the planet.
    """

    halo: FloatArray
    even: FloatArray
    scale: FloatArray
    companion: float
    peak: FloatArray
    speckle: float
    variance_factor: float

    def light(self, halo_e_s: FloatArray, companion_e_s: FloatArray, even_e_s: FloatArray) -> FloatArray:
        """Return the light and dark charge of a reference frame as they enter the variance, e-/s."""
        return self.halo * halo_e_s + self.even * even_e_s + self.scale * self.companion * companion_e_s


class Library:
    """The star itself, at another time, without its planet (Zhu et al. 2025); the base of the other libraries.

    Attributes
    ----------
    name : str
        As options, configurations and results have it.
    meaning : str
        What the reference frames are.
    found, searched : str
        When a realisation counts as a detection, and what is done with images after the reduction.
    caveats : mapping of str to str
        Flags of every answer with this library, with their words.
    noise_free : bool
        Whether expectations stand for reference frames, without noise or drift between the visits.
    """

    name = "same_star_planet_free"
    meaning = "the same star without its planet, with its own noise and visit drift; as much time as the science frames"
    found = "the blind search finds the planet"
    searched = "searched blind and measured"
    caveats: Mapping[str, str] = MappingProxyType({})
    noise_free = False

    @property
    def flags(self) -> tuple[str, ...]:
        """Flags of every answer with this library."""
        return tuple(self.caveats)

    def check(self, settings: LibrarySettings, choice: str) -> None:
        """Refuse a strategy that the library cannot serve.

        Parameters
        ----------
        settings : LibrarySettings
        choice : str
            How the user chose the library, for the message.

        Raises
        ------
        InputError
            Naming the field of the strategy.
        """

    def time_factor(self, settings: LibrarySettings) -> float:
        """Return the wall time of science and reference frames over that of the science frames."""
        return 1.0 + settings.reference_ratio

    def reference_visits(self, given: int | None, visits: Visits) -> Visits:
        """Return the number of visits that the reference frames of so many science visits are spread over.

        Parameters
        ----------
        given : int, optional
            What the strategy asks for.
        visits : int or ndarray
            Science visits.
        """
        return visits if given is None else 0 * visits + given

    def reference_length(self, visits: FloatArray, references: FloatArray) -> FloatArray:
        """Return the length of a reference visit over that of as many of them as science visits.

        Parameters
        ----------
        visits, references : ndarray
            Science visits, and visits of the reference frames.
        """
        return visits / references

    def rolls_deg(self, settings: LibrarySettings) -> tuple[float, ...]:
        """Return the rolls at which frames show the planet, relative to that of the observation; one or two.

        With two, each visit is the other's reference, the first being the science visit.
        """
        return (0.0,)

    def wings_deg(self, settings: LibrarySettings) -> tuple[float, ...]:
        """Return the rolls at which the difference shows a companion's wings; the second, if any, is subtracted."""
        return ()

    def noise(
        self, settings: LibrarySettings, star_e_s: FloatArray, rate_e_s: Callable[[ReferenceStar], FloatArray]
    ) -> LibraryNoise:
        """Return the noise of the reference frames in the exposure-time calculator.

        Parameters
        ----------
        settings : LibrarySettings
        star_e_s : ndarray
            Rates of the science stars, e-/s.
        rate_e_s : callable
            Rate of another star in the same band, e-/s.
        """
        one = np.ones(1)
        return LibraryNoise(one, one, one, 1.0, one, 1.0, 1.0 / len(self.rolls_deg(settings)))

    def reference_scene(self, settings: LibrarySettings, scene: Scene) -> Scene:
        """Return what reference frames show of the science scene."""
        return scene.without_planets()


class OtherStar(Library):
    """Another star alone, at the same place of the sky.

    Its frames are scaled by ``1 / rho`` with ``rho = reference / science`` the ratio of rates: the variance of its star
    light counts ``1 / rho``, that of everything else ``1 / rho^2``. In images it has the sky background of the science
    star; the dust around it is a copy of that star's, scaled with its light. It has no companions.
    """

    name = "reference_star"
    meaning = "another star, with its own magnitude and colour"

    def check(self, settings: LibrarySettings, choice: str) -> None:
        """Refuse a strategy without a star."""
        if settings.reference_star is None:
            allowed = "magnitude (and temperature) of the reference star, -30 to 40 mag"
            raise InputError("reference_star", "missing", allowed=allowed, hint=f"the {choice} needs it")

    def wings_deg(self, settings: LibrarySettings) -> tuple[float, ...]:
        """Return the one roll: the references have no companion."""
        return (0.0,)

    def noise(
        self, settings: LibrarySettings, star_e_s: FloatArray, rate_e_s: Callable[[ReferenceStar], FloatArray]
    ) -> LibraryNoise:
        """Return the noise scaled by the ratio of rates; see `Library.noise`."""
        return self._scaled(rate_e_s(_star_of(settings)) / star_e_s)

    def _scaled(self, ratio: FloatArray) -> LibraryNoise:
        return LibraryNoise(1.0 / ratio, 1.0 / ratio**2, 1.0 / ratio**2, 0.0, np.maximum(ratio, 1.0), 1.0, 1.0)

    def reference_scene(self, settings: LibrarySettings, scene: Scene) -> Scene:
        """Return the other star with its copy of the dust."""
        own, name = scene.cstar, f"reference star of {scene.name}"
        dust = tuple(
            source.model_copy(update={"contrast": source.contrast_to(own.v_mag), "v_mag": None})
            for source in scene.extended
        )
        return Scene(name=name, cstar=self._star(settings, own, name), extended=dust)

    def _star(self, settings: LibrarySettings, science: SceneStar, name: str) -> SceneStar:
        """Return the reference star of a science star, at the same place."""
        star = _star_of(settings)
        looks = {key: getattr(star, key) for key in ("v_mag", "teff_k", "log_g", "metallicity")}
        return SceneStar(name=name, ra_deg=science.ra_deg, dec_deg=science.dec_deg, **looks)


class BrighterTwin(OtherStar):
    """Another star of the same type and place, two magnitudes brighter: what a well-chosen reference star is."""

    name = "brighter_twin"
    meaning = "a star of the same type, two magnitudes brighter"
    _BRIGHTER_MAG = 2.0

    def check(self, settings: LibrarySettings, choice: str) -> None:
        """Accept every strategy: the star follows from the target."""

    def noise(
        self, settings: LibrarySettings, star_e_s: FloatArray, rate_e_s: Callable[[ReferenceStar], FloatArray]
    ) -> LibraryNoise:
        """Return the noise scaled by the ratio of rates, the same in every band; see `Library.noise`."""
        return self._scaled(np.full(np.shape(star_e_s), 10.0 ** (0.4 * self._BRIGHTER_MAG)))

    def _star(self, settings: LibrarySettings, science: SceneStar, name: str) -> SceneStar:
        return science.model_copy(update={"name": name, "v_mag": science.v_mag - self._BRIGHTER_MAG})


def _star_of(settings: LibrarySettings) -> ReferenceStar:
    star = settings.reference_star
    assert star is not None  # checked by the strategy
    return star


class TwoRolls(Library):
    """The whole scene half the roll to either side of the observation's; each half is the other's reference.

    Companions turn with the sky, planets as well: only the star's own speckles stay. The planet is measured in both
    halves.
    """

    name = "roll"
    meaning = "the same star at another roll angle"
    found = "the planet is significant at its known place (two rolls show it twice)"
    searched = "measured at the known place"

    def check(self, settings: LibrarySettings, choice: str) -> None:
        """Refuse halves of different length."""
        ratio, given, hint = settings.reference_ratio, settings.reference_visits, "each roll is the other's reference"
        if ratio != 1.0:
            raise InputError("reference_ratio", ratio, allowed=f"1 for the {choice}", hint=hint)
        if given is not None:
            raise InputError("reference_visits", given, allowed=f"as many as visits for the {choice}", hint=hint)

    def rolls_deg(self, settings: LibrarySettings) -> tuple[float, ...]:
        """Return both rolls."""
        return -settings.roll_deg / 2.0, settings.roll_deg / 2.0

    def wings_deg(self, settings: LibrarySettings) -> tuple[float, ...]:
        """Return both rolls."""
        return self.rolls_deg(settings)

    def reference_scene(self, settings: LibrarySettings, scene: Scene) -> Scene:
        """Return the scene itself."""
        return scene


class Idealised(Library):
    """Expectations of the science visit without planets, wavefront included: neither noise nor drift."""

    name = "idealised"
    meaning = "noise-free or drift-free: idealised"
    caveats = MappingProxyType({"idealised": "noise-free or drift-free reference library"})
    noise_free = True

    def noise(
        self, settings: LibrarySettings, star_e_s: FloatArray, rate_e_s: Callable[[ReferenceStar], FloatArray]
    ) -> LibraryNoise:
        """Return no noise at all; see `Library.noise`."""
        none, one = np.zeros(1), np.ones(1)
        return LibraryNoise(none, none, none, 0.0, one, 0.0, 1.0)


class Archive(Library):
    """Visits of other programmes to stars like this one, in the same state of the deformable mirror.

    Each is as long as a science visit times the reference ratio, scaled to this star, and takes no time of its own.
    """

    name = "archive"
    meaning = "visits of other programmes in the same state of the mirror, which take no time"
    _VISITS = 100

    def time_factor(self, settings: LibrarySettings) -> float:
        """Return 1: the references are there."""
        return 1.0

    def reference_visits(self, given: int | None, visits: Visits) -> Visits:
        """Return the number that is asked for, or 100; see `Library.reference_visits`."""
        return super().reference_visits(self._VISITS if given is None else given, visits)

    def reference_length(self, visits: FloatArray, references: FloatArray) -> FloatArray:
        """Return 1: more visits of the archive are more frames; see `Library.reference_length`."""
        return np.ones_like(references)


LIBRARIES: Registry[Library] = Registry(
    "library", (Library(), OtherStar(), BrighterTwin(), TwoRolls(), Archive(), Idealised())
)

LibraryName = Annotated[str, LIBRARIES]
"""Name of a library, as a type."""
DEFAULT_LIBRARY = Library.name


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
