"""The question of ``cpic etc`` about stars and known planets: time for a level, SNR for a time, or a contrast limit."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Self

from pydantic import BeforeValidator, model_validator

from cpic_core import InputError
from cpic_planner.queries import shared
from cpic_planner.queries.question import asked, called
from simulator.config import validate
from simulator.knobs import Dial, dial_of

if TYPE_CHECKING:
    from cpic_planner.queries.rank import EnsembleChoice

Numbers = Annotated[tuple[float, ...], BeforeValidator(shared.several)]
PLACES = ("separation_arcsec", "separation_au", "semi_major_axis_au")
"""What places a planet."""
_LEVELS = ("snr", "sigma", "detect")
_QUICK = dial_of("quick")
OWN_STAR = "my star"
"""Name of a star of one's own that is given none."""


def planets_of(given: Any) -> Any:
    """Return the planets from what people write: one or several, objects or mappings."""
    if isinstance(given, Sequence) and not isinstance(given, str):
        return tuple(planets_of(body) for body in given)
    planet = shared.ReferencePlanet
    return given if isinstance(given, planet) else validate(planet, given, where="planet")


def _ensemble(given: Any) -> Any:
    from cpic_planner.queries.rank import load_ensemble  # most questions have none

    return load_ensemble(given)


class EtcQuestion(
    shared.ProgrammeQuestion, shared.InstrumentQuestion, shared.StarsQuestion, shared.KnownPlanetsQuestion
):
    """Ask the exposure-time calculator.

    With ``contrast_limit`` the answer is the faintest contrast that reaches the level, else with a level the least
    time that reaches it, else the SNR in a time. Without a separation the planet stands where the answer is best.
    """

    KIND: ClassVar[str] = "etc"

    target: shared.Texts = asked(
        (),
        'Stars: "HIP 8102", "tau Cet", "alpha Cen B", "HD 10700" ...; or known planets: "eps Eri b", "47 UMa c" ..., '
        "at their places and contrasts of {date_utc}; or any name of a star of your own, with {v_mag}.",
        argument=True,
        unset=f"{OWN_STAR}, where {{v_mag}} is given",
        accepts="str or sequence of str",
        completes=shared.star_names,
    )
    snr: float | None = asked(None, "Level: photometric SNR.")
    sigma: float | None = asked(
        None,
        "Level: plain significance, of noise without the planet (the level that detection thresholds keep is "
        "another number: --threshold-sigma, strategy.sigma).",
    )
    detect: bool = asked(
        False, "Level: half of such programmes detect the planet at that separation, searched for as {search} says."
    )
    contrast_limit: bool = asked(False, "Ask for the faintest contrast that reaches the level in {time_s}.")
    separation_arcsec: Numbers | None = asked(
        None,
        "Projected separation, on the diagonal of a quadrant; repeat for several.",
        accepts="float or sequence of float",
        unset="where the answer is best",
    )
    separation_au: Numbers | None = asked(
        None, "The same in au, at the distance of the star; repeat for several.", accepts="float or sequence of float"
    )
    semi_major_axis_au: float | None = asked(
        None, "Radius of a circular orbit; gives separation and distance at the phase angle."
    )
    contrast: Numbers | None = asked(
        None,
        "Contrast of the planet instead of a model of it; repeat for several (as many as separations, or one of them).",
        accepts="float or sequence of float",
    )
    planet: shared.ReferencePlanet | tuple[shared.ReferencePlanet, ...] = asked(
        shared.ReferencePlanet(),
        "The planet whose light is asked for.",
        read=planets_of,
        accepts="ReferencePlanet, mapping, or sequence of them",
    )
    exposure_s: float | None = asked(None, "Frame exposure, instead of the best.")
    n_frames: int | None = asked(
        None, "Science frames of {exposure_s} in a visit; sets its time.", ge=1, option="--frames"
    )
    em_gain: float | None = asked(None, "EM gain, instead of the best.")
    exact: bool = asked(
        False, "Use all of the time, although the walk of the wavefront can make a shorter visit better."
    )
    observation_roll_deg: float = asked(
        0.0, "Roll of the telescope: it turns companions, and with them the quadrant that is darkest.", ge=-360, le=360
    )
    distance_pc: float | None = asked(None, "Distance, instead of the catalogue's.", ge=0.01, le=1e5)
    # A star of one's own counts by what is made of it, as one of a table.
    v_mag: float | None = asked(
        None, "V of a star that is in no table; with {sp_type} or {teff_k}.", physics=False, ge=-30, le=30, unit="mag"
    )
    sp_type: str | None = asked(None, "Its spectral type, as G8V.", physics=False)
    teff_k: float | None = asked(
        None, "Its temperature, instead of that of its spectral type.", physics=False, ge=2000, le=50_000
    )
    fidelity: shared.Fidelity | None = asked(None, "Closed forms alone, or checked in images.", unset="quick")
    tolerance: float | None = asked(
        None, "Instead of {fidelity}: images only where the stated error of planet flux or SNR exceeds this, 0 to 0.5."
    )
    realisations: int | None = asked(
        None, "Draws of the images of each answer.", ge=1, le=shared.MAX_REALISATIONS, unset="what tells the SNR to 5 %"
    )
    instruments: int | None = asked(
        None,
        "Answer with so many instruments too, drawn from {ensemble}: what is not known of the instrument leaves open.",
        unset="none",
        ge=2,
        le=100_000,
    )
    ensemble: Any = asked(
        None,
        "What is not known of the instrument: the preset default, or a YAML file with what differs from it.",
        read=_ensemble,
        command=str,
        unset="default",
        accepts="Ensemble, mapping, str or Path",
    )
    seed: shared.Seed | None = asked(None, "Seed of the images, and of {instruments}.", unset="1")

    @model_validator(mode="after")
    def _possible(self) -> Self:
        self._check_star()
        self._check_level()
        self._check_planet()
        self._check_images()
        return self

    @classmethod
    def _read(cls, tree: dict[str, Any]) -> dict[str, Any]:
        tree = super()._read(tree)
        if "v_mag" in tree and not tree.get("target"):
            tree["target"] = (OWN_STAR,)
        return tree

    def _check_star(self) -> None:
        if self.v_mag is None:
            if "target" not in self.model_fields_set:
                hint = "see cpic etc --help" if called("target") == "TARGET" else ""
                raise InputError(
                    "target", "missing", allowed=f"a star, a known planet, or {called('v_mag')}", hint=hint
                )
            for name in ("sp_type", "teff_k"):
                if self.is_given(name):
                    raise InputError(name, getattr(self, name), allowed=f"together with {called('v_mag')}")
            return
        if self.sp_type is None and self.teff_k is None:
            raise InputError("sp_type", "missing", allowed=f"a spectral type as G8V, or {called('teff_k')}")
        if len(self.target) > 1:
            raise InputError("target", f"{len(self.target)} names", allowed=f"one with {called('v_mag')}")
        if self.catalog != "snapshot":
            raise InputError("v_mag", self.v_mag, allowed=f"without {called('catalog')}, which has its own stars")

    def _check_level(self) -> None:
        self.refuse_together(_LEVELS, "one level at a time")
        if not self.contrast_limit:
            for name in _LEVELS:
                self.refuse_together((name, "time_s"), "one asks for a time, the other gives it")
                self.refuse_together((name, "n_frames"), f"{called('n_frames')} sets the time that is asked for")
        for name in ("time_s", "visit_time_s"):
            self.refuse_together((name, "n_frames"), "both set the time")
        if self.n_frames is not None and self.exposure_s is None:
            raise InputError("n_frames", self.n_frames, allowed=f"together with {called('exposure_s')}")

    def _check_planet(self) -> None:
        self.refuse_together(PLACES, "both place the planet")
        self.refuse_together(("contrast_limit", "contrast"), "the limit is the answer")
        planet = self.planet
        paths = ["planet"] if isinstance(planet, tuple) else [f"planet.{name}" for name in planet.model_fields_set]
        for path in paths:
            if path == "planet.phase_deg" and self.semi_major_axis_au is not None:
                continue
            self.refuse_together((path, "contrast"), "a given contrast needs no planet")
            self.refuse_together((path, "contrast_limit"), "the limit holds for any planet")
        given = "separation_au" if self.separation_arcsec is None else "separation_arcsec"
        places, ratios = len(getattr(self, given) or ()), len(self.contrast or ())
        if min(places, ratios) > 1 and places != ratios:
            allowed = f"once, or {places} times as {called(given)}"
            raise InputError("contrast", f"{ratios} times", allowed=allowed)

    def _check_images(self) -> None:
        self.refuse_together(("tolerance", "fidelity"), "they are two names of one dial")
        dial, several = self.dial.fidelity, self.instruments is not None
        tiers = f"{called('fidelity')} standard or reference"
        for name, allowed, there in (
            ("realisations", tiers, dial in ("standard", "reference")),
            ("seed", f"{tiers}, {called('tolerance')} or {called('instruments')}", dial != "quick" or several),
            ("ensemble", called("instruments"), several),
        ):
            if self.is_given(name) and not there:
                value = "given" if name == "ensemble" else getattr(self, name)
                raise InputError(name, value, allowed=f"together with {allowed}")

    @property
    def dial(self) -> Dial:
        """How firm answers have to be: ``quick`` without a fidelity or a tolerance."""
        plain = self.fidelity is None and self.tolerance is None
        return _QUICK if plain else dial_of(self.fidelity, self.tolerance)

    @property
    def drawn_instruments(self) -> "EnsembleChoice | None":
        """The instruments that answer too; None where none are asked."""
        if self.instruments is None:
            return None
        from cpic_planner.queries.rank import EnsembleChoice, load_ensemble

        return EnsembleChoice(self.ensemble or load_ensemble(), self.instruments, 1 if self.seed is None else self.seed)

    @property
    def asks_time(self) -> bool:
        """Whether the answer is a time."""
        return not self.contrast_limit and (self.snr is not None or self.sigma is not None or self.detect)

    def hashed(self) -> dict[str, Any]:
        """Return what decides numbers: the dial by what it does, and only what the answer depends on."""
        tree = super().hashed()
        del tree["fidelity"], tree["tolerance"]
        tree["time_s"] = None if self.asks_time or self.n_frames is not None else self.wall_s
        drawn = self.drawn_instruments
        if drawn is None:
            del tree["instruments"], tree["ensemble"]
        else:
            tree |= {"ensemble": drawn.ensemble.model_dump(mode="json"), "seed": drawn.seed}
        if self.dial.fidelity == "quick":
            return tree
        return tree | {"dial": self.dial.model_dump(mode="json"), "seed": 1 if self.seed is None else self.seed}
