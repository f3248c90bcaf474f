"""Questions about the programmes of stars: the best setting, contrast curves and operating characteristics."""

from __future__ import annotations

from typing import ClassVar, Self

from pydantic import model_validator

from cpic_core import InputError
from cpic_planner.queries import shared
from cpic_planner.queries.etc import Numbers, planets_of
from cpic_planner.queries.question import asked, called


class OptimiseQuestion(shared.ProgrammeQuestion, shared.InstrumentQuestion, shared.StarsQuestion):
    """Ask for the best band, separation, exposure, number of frames and EM gain of stars."""

    KIND: ClassVar[str] = "optimise"

    target: shared.Texts = asked(..., "Star names.", min_length=1, accepts="str or sequence of str")
    time_s: float | None = asked(
        None, "Wall time: the clearest detection within it.", unset="36000 if no goal is given"
    )
    snr: float | None = asked(None, "Photometric SNR to reach in the least time.")
    detect: bool = asked(False, "A detection to reach in the least time.")
    separation_arcsec: float | None = asked(None, "Projected separation of the planet, instead of the best one.")
    planet: shared.ReferencePlanet = shared.asked_planet(read=planets_of)

    @model_validator(mode="after")
    def _possible(self) -> Self:
        self.refuse_together(("time_s", "snr", "detect"), "one goal at a time")
        for name in ("snr", "detect"):
            self.refuse_together((name, "visit_time_s"), "the length of the visits is chosen for the least time")
        return self


MOST_IMAGES = 10_000


_MOST_PLACES = 200


class SearchedQuestion(
    shared.ProgrammeQuestion, shared.InstrumentQuestion, shared.StarsQuestion, shared.ReportQuestion
):
    """A question about one programme of a star in each band, by closed forms and in simulated images."""

    target: str = asked(..., 'Star: "tau Cet", "HIP 8102", "alpha Cen B" ...', argument=True)
    images: int = asked(
        0,
        "Programmes without planets that are simulated as images and reduced, each with its own drift and noise; 0: "
        "closed forms alone.",
        ge=0,
        le=MOST_IMAGES,
    )
    seed: shared.Seed = asked(1, "Seed of the images.")

    @model_validator(mode="after")
    def _searched(self) -> Self:
        if self.is_given("seed") and not self.images:
            raise InputError("seed", self.seed, allowed=f"together with {called('images')}")
        if self.images and len(self.strategy.rolls_deg) > 1:
            hint = "two rolls show every planet twice: their images are not searched blind"
            raise InputError("images", self.images, allowed=f"0 with {called('library')} roll", hint=hint)
        return self


class CurveQuestion(SearchedQuestion):
    """Ask for the contrast curve of a star, the map of its completeness, and injected planets that are recovered."""

    KIND: ClassVar[str] = "curve"

    separation_arcsec: Numbers | None = asked(
        None,
        "Projected separation, on the diagonal of a quadrant; repeat for several.",
        accepts="float or sequence of float",
        unset="25 between the corners of the dark hole",
    )
    injections: int = asked(
        0,
        "Planets that are put into the images, one at a time, at each of several separations and contrasts, and "
        "searched for blind; each into an image of its own, at most as many as {images}.",
        ge=0,
        le=MOST_IMAGES,
    )

    @model_validator(mode="after")
    def _injected(self) -> Self:
        if self.injections > self.images:
            allowed = f"at most {called('images')}, {self.images}"
            raise InputError("injections", self.injections, allowed=allowed, hint="each has an image of its own")
        if self.separation_arcsec is not None and not 1 <= len(self.separation_arcsec) <= _MOST_PLACES:
            raise InputError("separation_arcsec", f"{len(self.separation_arcsec)}", allowed=f"1 to {_MOST_PLACES}")
        return self


class RocQuestion(SearchedQuestion):
    """Ask how likely a planet is found against how many false alarms a search has: its operating characteristic."""

    KIND: ClassVar[str] = "roc"

    separation_arcsec: float | None = asked(
        None,
        "Projected separation of the planet, on the diagonal of a quadrant.",
        unset="where it is clearest",
        gt=0,
        le=120,
    )
    contrast: float | None = asked(None, "Contrast of the planet, instead of a model of it.", gt=0, le=1)
    planet: shared.ReferencePlanet = shared.asked_planet("The planet that is looked for.")

    @model_validator(mode="after")
    def _of_a_planet(self) -> Self:
        for name in self.planet.model_fields_set:
            self.refuse_together((f"planet.{name}", "contrast"), "a given contrast needs no planet")
        return self
