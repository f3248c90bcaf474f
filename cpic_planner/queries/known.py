"""The question of ``cpic known``: where the known planets are at a date."""

from __future__ import annotations

from typing import ClassVar

from pydantic import model_validator

from catalogs.errors import InputError
from cpic_planner.queries.base import called
from cpic_planner.queries.fields import asked
from cpic_planner.queries.planet import AlbedoParts
from cpic_planner.queries.shared import CatalogQuestion, InstrumentQuestion, KnownPlanetsQuestion, Seed
from simulator.config.albedo import AlbedoValue, MeasuredAlbedo

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
