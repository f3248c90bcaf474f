"""The registry of reference libraries: where the reference frames of the subtraction come from.

An entry says what its frames show, in the exposure-time calculator and in the images alike, what it costs, and the
words for it. `Library` itself is the library of the same star without its planet; the others differ from it.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Annotated, Protocol, TypeVar

import numpy as np

from cpic_core import FloatArray, InputError, Registry
from simulator.config import Scene, SceneStar

Visits = TypeVar("Visits", int, FloatArray)


class StarSettings(Protocol):
    """The settings of another star that a library reads (`cpic_planner.queries.shared.ReferenceStar`)."""

    @property
    def v_mag(self) -> float:
        """V magnitude."""

    @property
    def teff_k(self) -> float:
        """Temperature."""

    @property
    def log_g(self) -> float:
        """log10 of the surface gravity in cm/s2."""

    @property
    def metallicity(self) -> float:
        """log10 of the metallicity over the Sun's."""


class LibrarySettings(Protocol):
    """The settings of a strategy that a library reads (`cpic_planner.queries.shared.Strategy`)."""

    @property
    def reference_ratio(self) -> float:
        """Reference frames per science frame."""

    @property
    def reference_star(self) -> StarSettings | None:
        """Star of a library of another star."""

    @property
    def roll_deg(self) -> float:
        """Angle between two rolls."""

    @property
    def reference_visits(self) -> int | None:
        """Visits of the references, where the user says it."""


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
        self, settings: LibrarySettings, star_e_s: FloatArray, rate_e_s: Callable[[StarSettings], FloatArray]
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
        self, settings: LibrarySettings, star_e_s: FloatArray, rate_e_s: Callable[[StarSettings], FloatArray]
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
        self, settings: LibrarySettings, star_e_s: FloatArray, rate_e_s: Callable[[StarSettings], FloatArray]
    ) -> LibraryNoise:
        """Return the noise scaled by the ratio of rates, the same in every band; see `Library.noise`."""
        return self._scaled(np.full(np.shape(star_e_s), 10.0 ** (0.4 * self._BRIGHTER_MAG)))

    def _star(self, settings: LibrarySettings, science: SceneStar, name: str) -> SceneStar:
        return science.model_copy(update={"name": name, "v_mag": science.v_mag - self._BRIGHTER_MAG})


def _star_of(settings: LibrarySettings) -> StarSettings:
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
        self, settings: LibrarySettings, star_e_s: FloatArray, rate_e_s: Callable[[StarSettings], FloatArray]
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
