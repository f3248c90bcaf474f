"""The question of ``cpic known``: where the known planets are at a date.

The question of ``cpic visibility``: when stars can be seen from the orbit.
"""

from typing import Any, ClassVar, Self

from pydantic import model_validator

from cpic_core import InputError
from cpic_planner.queries import shared
from cpic_planner.queries.base import called
from cpic_planner.queries.fields import asked
from simulator.config import AlbedoValue, Instrument, MeasuredAlbedo

DEFAULT_YEARS = 5.0


class KnownQuestion(shared.InstrumentQuestion, shared.CatalogQuestion, shared.KnownPlanetsQuestion):
    """Say where the known planets are at a date, how bright, and when the dark hole covers them."""

    KIND: ClassVar[str] = "known"

    star: str | None = asked(None, 'Star: "eps Eri", "HIP 16537" ...', argument=True, metavar="[STAR]")
    years: float | None = asked(None, "How long the star's planets are followed.", unset=f"{DEFAULT_YEARS:g}")
    albedo: AlbedoValue = asked(MeasuredAlbedo(model="jupiter"), "What the planets reflect.", parts=shared.AlbedoParts)
    v_mag_max: float | None = asked(None, "Faintest V magnitude.", unset="7; none for a table of your own")
    n_draws: int = asked(4000, "Draws of each planet.", ge=1, le=100_000, option="--draws")
    seed: shared.Seed = asked(1, "Seed of every random number.")

    @model_validator(mode="after")
    def _of_a_star(self) -> Self:
        if self.star is None and self.years is not None:
            raise InputError("years", self.years, allowed=f"only with a {called('star')}")
        if self.star is not None and self.v_mag_max is not None:
            raise InputError("v_mag_max", self.v_mag_max, allowed=f"only without a {called('star')}")
        return self


class VisibilityQuestion(shared.CatalogQuestion):
    """Say when stars can be seen from the orbit of the telescope, and for how long per orbit.

    The places of the stars are those of ``date_utc``, which is also the first day where none is given, and of the first
    day without it.
    """

    KIND: ClassVar[str] = "visibility"

    target: shared.Texts = asked(
        ...,
        'Stars: "HIP 8102", "tau Cet", "alpha Cen B" ...',
        argument=True,
        metavar="TARGET...",
        accepts="str or sequence of str",
    )
    start_utc: str | None = asked(
        None, "First day, UTC, e.g. 2028-01-01.", option="--start", unset="{date_utc}, else that of the mission"
    )
    n_days: int = asked(365, "How many days.", option="--days")
    step_days: float = asked(1.0, "Time between orbits that are looked at; of the Moon, at most 1.")
    limits: Any = asked(
        None,
        "Limits of pointing: preset, or YAML file.",
        option="--visibility",
        command=str,
        unset="default",
        accepts="VisibilityConfig, mapping, str or Path",
    )
    instrument: Instrument = asked(
        shared.default_instrument,
        "Preset name or YAML file with what differs; its mission has the orbit.",
        option="--instrument",
        read=shared.read_instrument,
        unset="cpic_default",
        accepts="Instrument, mapping, str or Path",
    )
