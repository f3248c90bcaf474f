"""Names of stars and settings of the instrument, turned into targets and models."""

import functools
from typing import Any, Literal

from catalogs import Catalogue, catalogue_of_star
from cpic_planner import queries
from cpic_planner.etc import EtcModel, build_model
from cpic_planner.targets import Targets, as_catalogue, find_target, find_targets
from simulator.config import load_instrument


def model_of(question: Any) -> EtcModel:
    """Return the model of the instrument, the bands and the strategy of a question; that of the shipped one is kept."""
    if question.instrument is load_instrument():
        return _default_model(question.bands, question.strategy)
    return build_model(question.instrument, question.bands, question.strategy)


@functools.lru_cache(maxsize=16)
def _default_model(bands: tuple[str, ...] | None, strategy: queries.Strategy | None) -> EtcModel:
    """Return the model of the shipped instrument, which no file of the user's can change."""
    return build_model(load_instrument(), bands, strategy)


def catalogue_of(question: Any) -> Catalogue:
    """Return the table of stars of a question: of one star alone where the question describes it."""
    if getattr(question, "v_mag", None) is None:
        return as_catalogue(question.catalog)
    about = {name: getattr(question, name) for name in ("sp_type", "teff_k", "distance_pc")}
    return catalogue_of_star(question.target[0], question.v_mag, **about)


def stars_named(question: Any) -> list[Targets]:
    """Return each star that a question names as a target of its own."""
    date_utc, companions = queries.observed_utc(question), question.companions
    if len(question.target) == 1 and question.catalog == "snapshot" and getattr(question, "v_mag", None) is None:
        return [shipped_star(question.target[0], companions, date_utc)[0]]
    about: dict[str, Any] = {"catalog": catalogue_of(question), "companions": companions, "date_utc": date_utc}
    return [star for star, _ in find_targets(question.target, **about)]


@functools.lru_cache(maxsize=256)
def shipped_star(name: str, companions: Literal["on", "off"], date_utc: str | None) -> tuple[Targets, str]:
    """Return a star of the shipped catalogue, which no file of the user's can change, as `find_target` does.

    Parameters
    ----------
    name : str
        Any name of the star.
    companions : {"on", "off"}
        Whether the light of companions counts.
    date_utc : str or None
        Of the places.
    """
    return find_target(name, companions=companions, date_utc=date_utc)
