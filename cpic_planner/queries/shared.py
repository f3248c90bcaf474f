"""Fields that several questions share: the stated planet, the reduction, the instrument, the stars, runs.

How an observation is made and reduced, as configuration: one name of each setting for commands, YAML and Python.

An entry of a library says what its frames show, in the exposure-time calculator and in the images alike, what it costs,
and the words for it. `Library` itself is the library of the same star without its planet; the others differ from it.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self, TypeVar

import numpy as np
from pydantic import BeforeValidator, Field, model_validator

from catalogs import Catalogue, checked_table_name, load_stars
from cpic_core import FloatArray, InputError, Record, Registry, check_address, digest_of, is_file
from cpic_planner import registry
from cpic_planner.queries.changes import SkyParts, read_instrument
from cpic_planner.queries.question import Parts, Question, asked, called, check_visits
from simulator import config
from simulator.config import FrozenModel, Instrument, Scene, SceneStar, load_instrument

if TYPE_CHECKING:
    from cpic_planner.jobs import RunSettings
    from simulator.knobs import Dial

EXCLUSIONS = ("rv", "stability", "known_giants")
"""Facts that can exclude planets: velocities of the star, its companion star, and its giant planets."""


class AlbedoParts(Parts):
    """Options of an albedo; parameters without a name mean the parametric model, with a file a grid of models."""

    albedo: str | None = asked(
        None,
        "jupiter, saturn, uranus, neptune, parametric, a number, or a file with wavelength and geometric albedo.",
        unset="jupiter, or parametric where its parameters are given",
        names_file=config.names_file,
    )
    log10_mh: float | None = asked(None, "Parametric albedo: log10 of metallicity over solar, 0 to 2.")
    log10_fsed: float | None = asked(None, "Parametric albedo: log10 of the clouds' sedimentation efficiency, -2 to 2.")
    insolation_au: float | None = asked(
        None, "Parametric albedo: distance from the Sun of equal insolation.", unset="r / sqrt(L) of the star"
    )
    phase_function: Literal["lambert", "grid"] | None = asked(
        None, "Parametric albedo: Lambert's, or that of the model grid.", unset="lambert"
    )

    def made(self, base: Any) -> config.AlbedoSpec:
        """Return the albedo that the options name."""
        parameters = self.model_dump(exclude={"albedo"}, exclude_none=True)
        name = self.albedo
        if name is None or name == "parametric":
            return config.albedo_spec({"model": "parametric"} | parameters)
        if config.names_file(name):
            if not is_file(name):
                raise InputError("albedo", name, allowed="an existing file")
            return config.albedo_spec({"model": "grid" if parameters else "table", "file": name} | parameters)
        if parameters:
            option = called("albedo")
            hint = f"parameters are those of {option} parametric or of a grid of models"
            raise InputError(next(iter(parameters)), f"given with {option} {name}", allowed="one of the two", hint=hint)
        try:
            number = float(name)
        except ValueError:
            return config.albedo_spec(name)
        return config.albedo_spec(number)


class ReferencePlanet(FrozenModel):
    """1 R_J at phase 90 deg on a hole diagonal, with the measured albedo of Jupiter.

    At phase 90 deg the true distance equals the projected one; at other phases it is ``rho / sin(phase)``. An albedo
    that follows the insolation takes it as ``r / sqrt(L)``.
    """

    radius_rjup: float = asked(1.0, "Planet radius in R_J = 71 492 km.", gt=0, le=10, option="--planet-radius-rjup")
    phase_deg: float = asked(90.0, "Phase angle.", ge=1e-12, lt=180)
    albedo: config.AlbedoValue = asked(
        config.MeasuredAlbedo(model="jupiter"), "What the planet reflects.", parts=AlbedoParts
    )

    def content(self) -> dict[str, Any]:
        """Return everything that decides its light, for content hashes: a file counts by what is in it."""
        tree = self.model_dump(mode="json")
        file = getattr(self.albedo, "file", None)
        if file is not None:
            tree["albedo"]["file"] = digest_of(file)
        return tree


def asked_planet(text: str = "The reference planet.", **settings: Any) -> Any:
    """Declare the field of a reference planet; ``settings`` as of `asked`."""
    return asked(ReferencePlanet(), text, accepts="ReferencePlanet or mapping", **settings)


def asked_out(folder: str) -> Any:
    """Declare the output folder of a command that always has one."""
    return asked(Path(folder), "Output folder; an interrupted run continues there.", physics=False, metavar="DIR")


def _of_star(name: str, default: Any, text: str, low: float, high: float) -> Any:
    """Declare a number of the star of a reference library."""
    option = f"--reference-{name}"
    return asked(default, text, ge=low, le=high, option=option, only_with=("library", "reference_star"))


MAX_VISITS = 1000
"""Most visits of a programme."""
SearchMode = Literal["blind", "known_place"]
_OF_ROLL, _COUNTED = ("library", "roll"), ("mode", "photon_counting")


class ReferenceStar(FrozenModel):
    """Star of a reference library."""

    v_mag: float = _of_star("v-mag", ..., "V magnitude of the star of {library} reference_star.", -30, 40)
    teff_k: float = _of_star("teff-k", 5772.0, "Temperature of that star.", 1000, 100_000)
    log_g: float = _of_star("log-g", 4.4, "log10 of its surface gravity in cm/s2.", -1, 7)
    metallicity: float = _of_star("metallicity", 0.0, "log10 of its metallicity over the Sun's.", -5, 1)


Visits = TypeVar("Visits", int, FloatArray)


class LibraryNoise(Record):
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

    def check(self, settings: Reduction, choice: str) -> None:
        """Refuse a strategy that the library cannot serve.

        Parameters
        ----------
        settings : Reduction
        choice : str
            How the user chose the library, for the message.

        Raises
        ------
        InputError
            Naming the field of the strategy.
        """

    def time_factor(self, settings: Reduction) -> float:
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

    def rolls_deg(self, settings: Reduction) -> tuple[float, ...]:
        """Return the rolls at which frames show the planet, relative to that of the observation; one or two.

        With two, each visit is the other's reference, the first being the science visit.
        """
        return (0.0,)

    def wings_deg(self, settings: Reduction) -> tuple[float, ...]:
        """Return the rolls at which the difference shows a companion's wings; the second, if any, is subtracted."""
        return ()

    def noise(
        self, settings: Reduction, star_e_s: FloatArray, rate_e_s: Callable[[ReferenceStar], FloatArray]
    ) -> LibraryNoise:
        """Return the noise of the reference frames in the exposure-time calculator.

        Parameters
        ----------
        settings : Reduction
        star_e_s : ndarray
            Rates of the science stars, e-/s.
        rate_e_s : callable
            Rate of another star in the same band, e-/s.
        """
        one = np.ones(1)
        return LibraryNoise(one, one, one, 1.0, one, 1.0, 1.0 / len(self.rolls_deg(settings)))

    def reference_scene(self, settings: Reduction, scene: Scene) -> Scene:
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

    def check(self, settings: Reduction, choice: str) -> None:
        """Refuse a strategy without a star."""
        if settings.reference_star is None:
            allowed = "magnitude (and temperature) of the reference star, -30 to 40 mag"
            raise InputError("reference_star", "missing", allowed=allowed, hint=f"the {choice} needs it")

    def wings_deg(self, settings: Reduction) -> tuple[float, ...]:
        """Return the one roll: the references have no companion."""
        return (0.0,)

    def noise(
        self, settings: Reduction, star_e_s: FloatArray, rate_e_s: Callable[[ReferenceStar], FloatArray]
    ) -> LibraryNoise:
        """Return the noise scaled by the ratio of rates; see `Library.noise`."""
        return self._scaled(rate_e_s(_star_of(settings)) / star_e_s)

    def _scaled(self, ratio: FloatArray) -> LibraryNoise:
        return LibraryNoise(1.0 / ratio, 1.0 / ratio**2, 1.0 / ratio**2, 0.0, np.maximum(ratio, 1.0), 1.0, 1.0)

    def reference_scene(self, settings: Reduction, scene: Scene) -> Scene:
        """Return the other star with its copy of the dust."""
        own, name = scene.cstar, f"reference star of {scene.name}"
        dust = tuple(
            source.model_copy(update={"contrast": source.contrast_to(own.v_mag), "v_mag": None})
            for source in scene.extended
        )
        return Scene(name=name, cstar=self._star(settings, own, name), extended=dust)

    def _star(self, settings: Reduction, science: SceneStar, name: str) -> SceneStar:
        """Return the reference star of a science star, at the same place."""
        star = _star_of(settings)
        looks = {key: getattr(star, key) for key in ("v_mag", "teff_k", "log_g", "metallicity")}
        return SceneStar(name=name, ra_deg=science.ra_deg, dec_deg=science.dec_deg, **looks)


class BrighterTwin(OtherStar):
    """Another star of the same type and place, two magnitudes brighter: what a well-chosen reference star is."""

    name = "brighter_twin"
    meaning = "a star of the same type, two magnitudes brighter"
    _BRIGHTER_MAG = 2.0

    def check(self, settings: Reduction, choice: str) -> None:
        """Accept every strategy: the star follows from the target."""

    def noise(
        self, settings: Reduction, star_e_s: FloatArray, rate_e_s: Callable[[ReferenceStar], FloatArray]
    ) -> LibraryNoise:
        """Return the noise scaled by the ratio of rates, the same in every band; see `Library.noise`."""
        return self._scaled(np.full(np.shape(star_e_s), 10.0 ** (0.4 * self._BRIGHTER_MAG)))

    def _star(self, settings: Reduction, science: SceneStar, name: str) -> SceneStar:
        return science.model_copy(update={"name": name, "v_mag": science.v_mag - self._BRIGHTER_MAG})


def _star_of(settings: Reduction) -> ReferenceStar:
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

    def check(self, settings: Reduction, choice: str) -> None:
        """Refuse halves of different length."""
        ratio, given, hint = settings.reference_ratio, settings.reference_visits, "each roll is the other's reference"
        if ratio != 1.0:
            raise InputError("reference_ratio", ratio, allowed=f"1 for the {choice}", hint=hint)
        if given is not None:
            raise InputError("reference_visits", given, allowed=f"as many as visits for the {choice}", hint=hint)

    def rolls_deg(self, settings: Reduction) -> tuple[float, ...]:
        """Return both rolls."""
        return -settings.roll_deg / 2.0, settings.roll_deg / 2.0

    def wings_deg(self, settings: Reduction) -> tuple[float, ...]:
        """Return both rolls."""
        return self.rolls_deg(settings)

    def reference_scene(self, settings: Reduction, scene: Scene) -> Scene:
        """Return the scene itself."""
        return scene


class Idealised(Library):
    """Expectations of the science visit without planets, wavefront included: neither noise nor drift."""

    name = "idealised"
    meaning = "noise-free or drift-free: idealised"
    caveats = MappingProxyType({"idealised": "noise-free or drift-free reference library"})
    noise_free = True

    def noise(
        self, settings: Reduction, star_e_s: FloatArray, rate_e_s: Callable[[ReferenceStar], FloatArray]
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

    def time_factor(self, settings: Reduction) -> float:
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


class Reduction(FrozenModel):
    """The reduction of images: the part of a `Strategy` that a simulated observation can honour.

    Notes
    -----
    What the two filters that take something for granted buy in simulated visits, in F520 at 0.4, 0.6, 0.85 and F850 at
    0.52, 0.6, 0.8 arcsec:

    ``mirror`` leaves of the residual's rms, without white noise, at an offset of 0.05 nm 0.87, 0.97, 0.85 and 0.89,
    0.92, 0.85; at 0.1 nm 0.62, 0.90, 0.95 and 0.80, 0.74, 0.64; at 0.3 nm 0.30, 0.49, 0.70 and 0.45, 0.41, 0.46. It
    adds the white noise of the opposite place, and pays from about 0.1 nm where that is weaker than the speckles.

    ``whitened`` has at 0.05 nm 3.1, 1.9, 1.4 and 3.7, 2.4, 1.5 times the SNR of aperture sums with white noise of 0.3
    of a visit's speckles at 0.6 arcsec, 1.6, 1.2, 1.2 and 1.8, 1.4, 1.2 times with as much as that. With the covariance
    of an instrument of other aberrations it has 0.9 to 1.2 in F520; in F850, where the star's field in the dark hole is
    the design's, nearly as much as with its own; with that of a mirror that leaves a brighter hole 0.5 to 0.9.
    """

    n_modes: int = asked(
        0,
        "Modes of the reference library that the subtraction projects out beside its mean. Images and predictions for "
        "one target are for them; rankings are for the mean of the references.",
        ge=0,
        le=1000,
    )
    centring: registry.ReductionName = asked(
        registry.DEFAULT_REDUCTION,
        "What the subtraction takes off before the modes: "
        + ", ".join(f"{name}, {entry.meaning}" for name, entry in registry.REDUCTIONS.items())
        + ". Images measure all of them; the calculator predicts "
        + ", ".join(name for name, entry in registry.REDUCTIONS.items() if entry.predicted)
        + " and refuses the others.",
        exclude_if=lambda name: name == registry.DEFAULT_REDUCTION,
    )
    choose_modes: bool = asked(
        False,
        "Take {n_modes} as an upper limit: at each planet's place as many modes are projected out as are expected to "
        "lower the limit, possibly none. Images choose by the references alone, predictions by the least limit.",
    )
    filter: registry.FilterName = asked(
        registry.DEFAULT_FILTER,
        "How images measure a planet at its place: "
        + "; ".join(f"{name}, {entry.meaning}" for name, entry in registry.FILTERS.items())
        + ". Predictions are those of aperture sums.",
    )
    reference_ratio: float = asked(
        1.0, "Reference frames per science frame; their time and noise are counted.", ge=0.001, le=1000
    )
    sigma: float = asked(
        5.0,
        "Level of a detection whose false-alarm probability the small-sample threshold keeps (its key is "
        "strategy.sigma; cpic etc --sigma asks for a plain significance, which is another number).",
        ge=0.01,
        le=20,
        option="--threshold-sigma",
    )
    annulus_lambda_d: float = asked(
        1.5,
        "Half width of the annulus around the planet's separation whose apertures measure background and scatter: the "
        "speckle residual changes too much across the hole for one value. It is widened where it has no room for three "
        "apertures.",
        gt=0,
        le=20,
    )
    library: LibraryName = asked(DEFAULT_LIBRARY, "Where the reference frames of the subtraction come from.")
    reference_star: ReferenceStar | None = asked(None, "Star of the library of that name.")
    roll_deg: float = asked(30.0, "Angle between the two rolls of {library} roll.", gt=0, le=180, only_with=_OF_ROLL)
    visits: int | None = asked(
        None,
        "Science visits that are reduced together, each with a wavefront of its own.",
        ge=1,
        le=MAX_VISITS,
        unset="the best number where one is chosen, else 1",
    )
    reference_visits: int | None = asked(
        None,
        "Visits that the reference frames are spread over.",
        ge=1,
        le=100_000,
        unset="as many as science visits; 100 of {library} archive",
    )
    visit_gap_h: float = asked(
        0.0, "Time between the end of a visit and the start of the next, where offsets are correlated.", ge=0, le=1e5
    )
    reference_scheme: config.ReferenceScheme = asked(
        "interleaved",
        "When references are taken: in the next orbit at the same phase, in the second half of each orbit's window, "
        "in halves whose order turns from visit to visit, or of another star a quarter of an orbit later.",
    )
    search: SearchMode = asked(
        "blind",
        "How the planets of a population are looked for: by a search that knows no place, or at a known place. Known "
        "planets are looked for at theirs.",
    )

    @model_validator(mode="after")
    def _consistent(self) -> Reduction:
        self.reference_library.check(self, f"{called('library')} {self.library}")
        entry = registry.FILTERS[self.filter]
        if len(self.rolls_deg) > 1 and not entry.of_two_rolls:
            names = " or ".join(name for name, other in registry.FILTERS.items() if other.of_two_rolls)
            hint = "rolls show the planet's negative at a second place"
            raise InputError("filter", self.filter, allowed=f"{names} with {self.library}", hint=hint)
        if self.choose_modes and entry.takes_covariance:
            hint = "the covariance of the speckles stands for their modes; a number of modes is taken"
            raise InputError("choose_modes", True, allowed=f"false with filter {self.filter}", hint=hint)
        return self

    @property
    def reference_library(self) -> Library:
        """What the package knows of the library."""
        return LIBRARIES[self.library]

    @property
    def reduction(self) -> registry.Reduction:
        """How the references are combined and subtracted."""
        return registry.REDUCTIONS[self.centring]

    def check_predicted(self) -> None:
        """Refuse a reduction whose noise the calculator has no closed form of.

        Raises
        ------
        InputError
            Naming the reduction.
        """
        if not self.reduction.predicted:
            allowed = ", ".join(name for name, entry in registry.REDUCTIONS.items() if entry.predicted)
            hint = "no closed form predicts its noise; images of given frames measure it (cpic confirm)"
            raise InputError("centring", self.centring, allowed=allowed, hint=hint)

    def references_of(self, visits: int) -> int:
        """Return the number of reference visits of a programme of so many science visits."""
        return self.reference_library.reference_visits(self.reference_visits, visits)

    @property
    def rolls_deg(self) -> tuple[float, ...]:
        """Rolls at which frames show the planet, relative to that of the observation; one or two."""
        return self.reference_library.rolls_deg(self)


class Strategy(Reduction):
    """The way in which an observation is made and reduced: `Reduction`, and how the camera counts.

    Without ``visits`` the best number is chosen where one is asked for, and elsewhere there is one.

    Attributes
    ----------
    mode : {"analogue", "photon_counting"}
        Whether charge is measured or photons are counted.
    counting_sigma : float
        Threshold of photon counting over the read noise.
    """

    mode: Literal["analogue", "photon_counting"] = asked(
        "analogue", "Measure charge, or count photons (visible camera)."
    )
    counting_sigma: float = asked(
        5.0, "Threshold of {mode} photon_counting over the read noise.", gt=0, le=20, only_with=_COUNTED
    )


MAX_FRAMES = 4000
"""Frames of one sequence that are held in memory at once (0.6 GB of stamps)."""
DEFAULT_TIME_S = 36000.0
ALL = "all"
"""Every band of the instrument, of both cameras."""
MAX_REALISATIONS = 100_000
OnOff = Literal["on", "off"]
Fidelity = Literal["quick", "standard", "reference"]
Seed = Annotated[int, Field(ge=0, lt=2**63)]


def audited(dial: Dial, asked_for: bool | None = None) -> bool:
    """Return whether one more realisation has every effect of single frames, beside those that are drawn as sums.

    Parameters
    ----------
    dial : Dial
    asked_for : bool, optional
        What was asked for; ``standard`` has an audit and no other setting without.

    Raises
    ------
    InputError
        Where one is asked of the reference.
    """
    if asked_for and dial.fidelity == "reference":
        hint, allowed = "the reference runs every realisation frame by frame", "quick, standard or a tolerance"
        raise InputError("audit", "given", allowed=allowed, hint=hint)
    return dial.fidelity == "standard" if asked_for is None else asked_for


def refuse_counting(strategy: Strategy, dial: Dial) -> None:
    """Refuse photon counting frame by frame.

    Raises
    ------
    InputError
        Naming the mode.
    """
    if strategy.mode != "analogue" and dial.fidelity == "reference":
        hint = "photons are counted in sums of frames, not yet frame by frame: quick, standard or a tolerance"
        raise InputError("strategy.mode", strategy.mode, allowed="analogue", hint=hint)


def several(value: Any) -> Any:
    """Return a single value as a tuple of one, and a list as a tuple."""
    if value is None:
        return None
    plain = value.tolist() if hasattr(value, "tolist") else value  # also of a number of numpy
    if isinstance(plain, tuple | list | set):
        return tuple(plain)
    return (value if plain is None else plain,)  # what is masked has no plain value


def star_names() -> list[str]:
    """Return the names of the embedded stars, which shells complete."""
    return [re.sub(r"^(?:\*\*?|V\*|NAME) +", "", str(name)) for name in load_stars().column("name")]


Texts = Annotated[tuple[str, ...], BeforeValidator(several)]


def asked_strategy() -> Any:
    """Declare the field of a strategy."""
    return asked(Strategy(), "How the observation is made and reduced.", accepts="Strategy or mapping")


class ProgrammeQuestion(Question):
    """A question about programmes of visits, whose number and length may set their wall time."""

    time_s: Annotated[float, Field(ge=1e-3, le=1e9)] | None = asked(
        None,
        "Wall time of all visits in a band, readouts, reference frames and overheads included.",
        unset=f"{DEFAULT_TIME_S:g}",
    )
    visit_time_s: float | None = asked(
        None,
        "Wall time of one visit with its references and overhead; with {visits} it sets {time_s}.",
        ge=1e-3,
        le=1e9,
    )
    strategy: Strategy = asked_strategy()

    @model_validator(mode="after")
    def _timed(self) -> Self:
        time_s = self.time_s if "time_s" in self.model_fields_set else None
        check_visits(self.strategy.visits, self.visit_time_s, time_s, asked=self.asks_time)
        return self

    @property
    def asks_time(self) -> bool:
        """Whether the answer is a time."""
        return False

    @property
    def wall_s(self) -> float:
        """The wall time that is given; of no meaning where it is asked for, or where frames set it."""
        if self.time_s is None and self.strategy.visits is not None and self.visit_time_s is not None:
            return float(self.strategy.visits * self.visit_time_s)
        return DEFAULT_TIME_S if self.time_s is None else float(self.time_s)


class InstrumentQuestion(Question):
    """A question about an instrument and some of its bands."""

    instrument: Instrument = asked(
        load_instrument,
        "The instrument: a preset, a YAML file or a mapping with what differs.",
        parts=SkyParts,
        read=read_instrument,
        accepts="Instrument, mapping, str or Path",
    )
    bands: Texts | None = asked(
        None,
        "Band, e.g. F662; repeat for several, or all for those of both cameras.",
        option="--band",
        unset="all visible bands",
        accepts="sequence of str",
        completes=lambda: (*load_instrument().bands, ALL),
    )

    @classmethod
    def _read(cls, tree: dict[str, Any]) -> dict[str, Any]:
        tree = super()._read(tree)
        bands = several(tree.get("bands"))
        if bands is None or not all(isinstance(name, str) for name in bands):
            return tree
        if ALL in bands:
            if len(bands) > 1:
                raise InputError("bands", ", ".join(map(str, bands)), allowed=f"{ALL} alone, or names of bands")
            bands = tuple(tree.get("instrument", load_instrument()).bands)
        return tree | {"bands": tuple(dict.fromkeys(bands))}

    def band_names(self) -> tuple[str, ...]:
        """Return the bands that are asked for, all of the visible camera without any."""
        return self.bands or self.instrument.visible_bands()


def _catalog(given: Any) -> Any:
    return given if isinstance(given, Catalogue) else checked_table_name(given)


class TablesQuestion(Question):
    """A question that tables of a user's own can be part of."""

    # It refuses a table, or changes nothing.
    strict: bool = asked(
        False,
        "Refuse a table of your own for the first row or cell that cannot be used, instead of leaving it out with a "
        "remark.",
        physics=False,
    )


class KnownPlanetsQuestion(TablesQuestion):
    """A question that known planets at a date can be part of."""

    # They count by what is read of them, which is in the hash of the ranking.
    known_planets: str | None = asked(
        None,
        "Table of known planets: snapshot (NASA Exoplanet Archive of 2019 with the updates since), archive_2019 "
        "(without them), latest (made by cpic catalog refresh --planets), or a file (CSV, VOTable, FITS or "
        "another format), which is laid over the snapshot planet by planet; none+FILE takes the file alone. In a "
        "ranking or a plan it stands instead of a population; whatif counts them beside it, and off leaves them out.",
        physics=False,
        read=str,
        names_file=lambda word: word not in ("snapshot", "archive_2019"),
    )
    candidates: bool = asked(
        False, "Count candidates among the known planets too, not only confirmed and controversial ones.", physics=False
    )


class CatalogQuestion(TablesQuestion):
    """A question about stars of a table."""

    # A table counts by what is read of it, which is in the hashes of results.
    catalog: Any = asked(
        "snapshot",
        "Star table: snapshot, latest (made by cpic catalog refresh), simbad_2012 (the snapshot with companions where "
        "they were first listed), or a file (CSV, VOTable, FITS or another format).",
        physics=False,
        read=_catalog,
        accepts="str, Path or Catalogue",
        names_file=lambda word: word not in ("snapshot", "simbad_2012"),
    )
    # It counts by the places that it gives, which are in the hashes of results.
    date_utc: config.Utc | None = asked(
        None,
        "Date of the observation, UTC: stars, companions and known planets stand where they are then.",
        option="--date",
        unset="the mission's start",
        physics=False,
    )


def observed_utc(question: Any) -> str:
    """Return the date of the observation that a question about stars is asked for."""
    return str(question.date_utc or question.instrument.mission.start_utc)


class StarsQuestion(CatalogQuestion):
    """A question about stars and the companions that they have."""

    companions: OnOff = asked("on", "Count the light of known stellar companions.")


class CutsQuestion(StarsQuestion):
    """A question about all stars of a table within some cuts."""

    v_mag_max: float | None = asked(None, "Faintest V magnitude.", unset="7; none for a table of your own")
    dwarfs_only: bool = asked(False, "Dwarfs only (luminosity class V or IV-V).", option="--dwarfs")
    singles_only: bool = asked(
        False,
        "Without stars that the table flags as close pairs (the snapshot's flag is SIMBAD's).",
        option="--singles",
    )


class RunQuestion(Question):
    """The settings of a run; none of them decides a number."""

    workers: int = asked(
        1, "Local worker processes; results do not depend on their number.", ge=1, le=256, physics=False
    )
    scheduler: str | None = asked(
        None, "Dask scheduler to use instead, tcp://host:port.", physics=False, read=check_address
    )
    force: bool = asked(
        False, "Remove what a run of another configuration wrote into {out}, and nothing else.", physics=False
    )

    @property
    def how(self) -> RunSettings:
        """Settings of `cpic_planner.jobs.job.run`."""
        return {"workers": self.workers, "scheduler": self.scheduler, "force": self.force}


class ReportQuestion(RunQuestion):
    """A run whose report and tables are written where a folder is given."""

    out: Path | None = asked(
        None,
        "Output folder of the report and the tables; an interrupted run continues there.",
        unset="print only",
        physics=False,
        metavar="DIR",
    )

    @model_validator(mode="after")
    def _of_a_folder(self) -> Self:
        if self.force and self.out is None:
            raise InputError("force", "given", allowed=f"together with {called('out')}")
        return self
