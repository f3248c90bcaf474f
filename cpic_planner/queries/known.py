"""The question of ``cpic known``: where the known planets are at a date.

The question of ``cpic visibility``: when stars can be seen from the orbit.
"""

from __future__ import annotations

from typing import Any, ClassVar

from pydantic import model_validator

from cpic_core import InputError
from cpic_planner.queries.base import called
from cpic_planner.queries.fields import asked
from cpic_planner.queries.shared import (
    AlbedoParts,
    CatalogQuestion,
    InstrumentQuestion,
    KnownPlanetsQuestion,
    Seed,
    Texts,
    default_instrument,
    read_instrument,
)
from simulator.config import AlbedoValue, Instrument, MeasuredAlbedo

DEFAULT_YEARS = 5.0


class KnownQuestion(InstrumentQuestion, CatalogQuestion, KnownPlanetsQuestion):
    """Say where the known planets are at a date, how bright, and when the dark hole covers them."""

    KIND: ClassVar[str] = "known"

    star: str | None = asked(None, 'Star: "eps Eri", "HIP 16537" ...', argument=True, metavar="[STAR]")
    years: float | None = asked(None, "How long the star's planets are followed.", default_words=f"{DEFAULT_YEARS:g}")
    albedo: AlbedoValue = asked(MeasuredAlbedo(model="jupiter"), "What the planets reflect.", parts=AlbedoParts)
    v_mag_max: float | None = asked(None, "Faintest V magnitude.", default_words="7; none for a table of your own")
    n_draws: int = asked(4000, "Draws of each planet.", ge=1, le=100_000, option="--draws")
    seed: Seed = asked(1, "Seed of every random number.")

    @model_validator(mode="after")
    def _of_a_star(self) -> KnownQuestion:
        if self.star is None and self.years is not None:
            raise InputError("years", self.years, allowed=f"only with a {called('star')}")
        if self.star is not None and self.v_mag_max is not None:
            raise InputError("v_mag_max", self.v_mag_max, allowed=f"only without a {called('star')}")
        return self


class VisibilityQuestion(CatalogQuestion):
    """Say when stars can be seen from the orbit of the telescope, and for how long per orbit."""

    KIND: ClassVar[str] = "visibility"

    target: Texts = asked(
        ...,
        'Stars: "HIP 8102", "tau Cet", "alpha Cen B" ...',
        argument=True,
        metavar="TARGET...",
        accepts="str or sequence of str",
    )
    start_utc: str | None = asked(
        None, "First day, UTC, e.g. 2028-01-01.", option="--start", default_words="that of the mission"
    )
    n_days: int = asked(365, "How many days.", option="--days")
    step_days: float = asked(1.0, "Time between orbits that are looked at; of the Moon, at most 1.")
    limits: Any = asked(
        None,
        "Limits of pointing: preset, or YAML file.",
        option="--visibility",
        command=str,
        default_words="default",
        accepts="VisibilityConfig, mapping, str or Path, optional",
    )
    instrument: Instrument = asked(
        default_instrument,
        "Preset name or YAML file with what differs; its mission has the orbit.",
        option="--instrument",
        read=read_instrument,
        default_words="cpic_default",
        accepts="Instrument, mapping, str or Path, optional",
    )
