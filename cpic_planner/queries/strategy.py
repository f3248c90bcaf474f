"""How an observation is made and reduced, as configuration: one name of each setting for commands, YAML and Python."""

from __future__ import annotations

from typing import Literal

from pydantic import model_validator

from cpic_planner.queries.base import called
from cpic_planner.queries.fields import asked
from cpic_planner.registry.libraries import DEFAULT_LIBRARY, LIBRARIES, Library, LibraryName
from simulator.config.base import FrozenModel

_OF_STAR = ("library", "reference_star")
_OF_ROLL = ("library", "roll")
_COUNTED = ("mode", "photon_counting")


class ReferenceStar(FrozenModel):
    """Star of a reference library."""

    v_mag: float = asked(
        ...,
        "V magnitude of the star of {library} reference_star.",
        ge=-30,
        le=40,
        option="--reference-v-mag",
        only_with=_OF_STAR,
    )
    teff_k: float = asked(
        5772.0, "Temperature of that star.", ge=1000, le=100_000, option="--reference-teff-k", only_with=_OF_STAR
    )
    log_g: float = asked(
        4.4, "log10 of its surface gravity in cm/s2.", ge=-1, le=7, option="--reference-log-g", only_with=_OF_STAR
    )
    metallicity: float = asked(
        0.0,
        "log10 of its metallicity over the Sun's.",
        ge=-5,
        le=1,
        option="--reference-metallicity",
        only_with=_OF_STAR,
    )


class Reduction(FrozenModel):
    """How images are reduced: what a simulated observation can honour of a `Strategy`."""

    n_modes: int = asked(1, "Modes of the reference library that the subtraction projects out.", ge=0, le=1000)
    reference_ratio: float = asked(
        1.0, "Reference frames per science frame; their time and noise are counted.", gt=0, le=1000
    )
    sigma: float = asked(
        5.0,
        "Level of a detection whose false-alarm probability the small-sample threshold keeps (its key is "
        "strategy.sigma; cpic etc --sigma asks for a plain significance, which is another number).",
        gt=0,
        le=20,
        option="--threshold-sigma",
    )
    annulus_lambda_d: float = asked(
        1.5,
        "Half width of the annulus around the planet's separation whose apertures measure background and scatter: the "
        "speckle residual changes too much across the hole for one value.",
        gt=0,
        le=20,
    )
    library: LibraryName = asked(DEFAULT_LIBRARY, "Where the reference frames of the subtraction come from.")
    reference_star: ReferenceStar | None = asked(None, "Star of the library of that name.")
    roll_deg: float = asked(30.0, "Angle between the two rolls of {library} roll.", gt=0, le=180, only_with=_OF_ROLL)

    @model_validator(mode="after")
    def _consistent(self) -> Reduction:
        self.reference_library.check(self, f"{called('library')} {self.library}")
        return self

    @property
    def reference_library(self) -> Library:
        """What the package knows of the library."""
        return LIBRARIES[self.library]

    @property
    def rolls_deg(self) -> tuple[float, ...]:
        """Rolls at which frames show the planet, relative to that of the observation; one or two."""
        return self.reference_library.rolls_deg(self)


class Strategy(Reduction):
    """How an observation is made and reduced.

    Attributes
    ----------
    n_modes : int
        Modes of the reference library that RDI projects out.
    reference_ratio : float
        Reference frames per science frame (M/N); their time and noise are counted.
    sigma : float
        Detection level whose false-alarm probability a small-sample threshold keeps.
    annulus_lambda_d : float
        Half width of the annulus around the planet's separation whose apertures measure background and scatter:
        the speckle residual changes too much across the hole for one value.
    library : str
        Name of the reference library, see `cpic_planner.registry.libraries`.
    reference_star : ReferenceStar, optional
        For the library of that name.
    roll_deg : float
        Angle between the two rolls of the library of that name.
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
