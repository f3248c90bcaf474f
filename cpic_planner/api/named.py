"""Known planets asked for by name: their place and light at a date, and what the errors of both mean for an answer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from catalogs import Catalogue, resolve_star
from cpic_core import FloatArray, InputError
from cpic_planner.api.keywords import model_of
from cpic_planner.etc import reference_notes
from cpic_planner.queries import EtcQuestion, ReferencePlanet, called, observed_utc
from cpic_planner.results import EtcAnswer, KnownPlanetLook, OpenQuantiles, Quantiles
from cpic_planner.targets import Targets, find_target

if TYPE_CHECKING:
    from cpic_planner.planets import Planets
    from cpic_planner.ranking import KnownChoice

N_DRAWS = 4000
"""Draws of a planet."""
N_LOOKS = 100
"""Draws of a planet of which each is asked about, evenly among all of them by contrast."""
_PLACE = ("separation_arcsec", "separation_au", "semi_major_axis_au", "contrast", "distance_pc")


@dataclass(frozen=True, eq=False)
class NamedPlanet:
    """A known planet of a question about one star.

    Attributes
    ----------
    choice : KnownChoice
        Table, date, draws and albedo.
    row : int
        Of the table.
    """

    choice: KnownChoice
    row: int

    @property
    def name(self) -> str:
        """Name in the table."""
        return self.choice.table.text("planet")[self.row]

    @property
    def star(self) -> str:
        """Name of its star in the table."""
        return self.choice.table.text("star")[self.row]

    def drawn(self) -> Planets:
        """Return its draws at the date."""
        from cpic_planner.planets import draw_known, known_uniforms, planets_of

        choice = self.choice
        uniforms = known_uniforms(choice.table, [self.row], choice.n_draws, choice.seed)
        return planets_of(draw_known(choice.table, [self.row], uniforms, epoch_mjd=choice.mjd), 0, choice.albedo)

    def question(self, question: EtcQuestion, **place: Any) -> EtcQuestion:
        """Return a question about the planet at a place, where it is looked for unless the question says otherwise."""
        strategy = question.strategy
        if "search" not in strategy.model_fields_set:
            strategy = strategy.model_copy(update={"search": "known_place"})
        return question.model_copy(update={"strategy": strategy} | place)

    def answers(self, question: EtcQuestion, star: Targets) -> list[EtcAnswer]:
        """Return the answers about it, band by band: at the medians of place and contrast, with what these leave open.

        Parameters
        ----------
        question : EtcQuestion
        star : Targets
            The planet's, as asked for.
        """
        from cpic_planner.api.one_star import closed_forms
        from cpic_planner.ranking.known_answer import planets_contrast

        plain = self.question(question)
        model, drawn = model_of(plain), self.drawn()
        separation = np.hypot(drawn.east_au, drawn.north_au) / float(star.distance_pc[0])
        answers = []
        for band in model.bands:
            contrast = planets_contrast(model, star, band, drawn, self.choice.albedo)
            order = np.argsort(contrast, kind="stable")
            some = order[((np.arange(N_LOOKS) + 0.5) * len(order) / N_LOOKS).astype(int)]
            places, ratios = (np.append(np.median(all_of), all_of[some]).tolist() for all_of in (separation, contrast))
            place = {"separation_arcsec": tuple(places)}
            if not question.contrast_limit:
                place["contrast"] = tuple(ratios)
            one = replace(model, metrics={band: model.metrics[band]})
            first, *others = closed_forms(self.question(question, **place), one, star)
            notes = reference_notes(one, star, band, places[0], ReferencePlanet(albedo=self.choice.albedo))
            flags = tuple(dict.fromkeys((*first.flags, *notes)))
            look = self._look(model.metrics[band].zone, drawn, separation, contrast, _open(others))
            answers.append(first.model_copy(update={"known_planet": look, "flags": flags}))
        return answers

    def _look(
        self, zone: Any, drawn: Planets, separation: FloatArray, contrast: FloatArray, value: OpenQuantiles
    ) -> KnownPlanetLook:
        choice, table = self.choice, self.choice.table
        inside = (separation >= zone.inner_corner_arcsec) & (separation <= zone.outer_corner_arcsec)
        texts = {name: table.text(name)[self.row] for name in ("planet", "status", "reference")}
        numbers = {name: _three(getattr(drawn, name)) for name in ("distance_au", "phase_deg", "radius_rjup")}
        return KnownPlanetLook(
            **texts,
            **numbers,
            flags=list(table.flags(self.row)),
            columns_not_used=list(table.unused),
            date_utc=choice.date_utc,
            planets_table=table.provenance,
            separation_arcsec=_three(separation),
            contrast=_three(contrast),
            value=value,
            hole_share=float(np.mean(inside)),
            n_draws=choice.n_draws,
            seed=choice.seed,
            albedo=choice.albedo.label,
        )

    def content(self) -> dict[str, Any]:
        """Return what decides the planets, for content hashes."""
        return self.choice.content() | {"planet": self.name}


def named(question: EtcQuestion, name: str, catalogue: Catalogue) -> tuple[Targets, str, NamedPlanet | None]:
    """Return the star that a name means, a remark on it, and its planet where the name is one of a known planet.

    Parameters
    ----------
    question : EtcQuestion
    name : str
        Any name of a star, or that of a known planet: any name of its star, and its letter.
    catalogue : Catalogue
        Table of stars.

    Raises
    ------
    InputError
        For a name that is neither, and for a known planet together with what it sets.
    """
    about: dict[str, Any] = {"companions": question.companions, "catalog": catalogue}
    about["date_utc"] = observed_utc(question)
    planet = None
    try:
        resolve_star(name, catalogue.table)
    except InputError as error:
        planet = planet_named(_choice(question), name, error)
    star, remark = find_target(name if planet is None else planet.star, **about)
    if planet is None:
        return star, remark, None
    for field in (*_PLACE, "planet.radius_rjup", "planet.phase_deg"):
        if question.is_given(*field.split(".")):
            allowed = f"without it: {called('known_planets')} has place, size and light of {planet.name}"
            raise InputError(field, "given with the name of a planet", allowed=allowed)
    return star, remark, planet


def planet_named(choice: KnownChoice, name: str, unknown: InputError) -> NamedPlanet:
    """Return the known planet of a name that no star has.

    Parameters
    ----------
    choice : KnownChoice
    name : str
    unknown : InputError
        What is said of the name as that of a star; raised where the table does not know a planet of the star either.
    """
    try:
        return NamedPlanet(choice, choice.table.row_of(name))
    except InputError as error:
        if not error.hint:
            raise unknown from None
        raise InputError("target", name, allowed=f"a star, or {error.allowed}", hint=error.hint) from None


def _choice(question: EtcQuestion) -> KnownChoice:
    """Return the known planets of a question, at its date."""
    from cpic_planner.ranking import KnownChoice

    planet = question.planet[0] if isinstance(question.planet, tuple) else question.planet
    return KnownChoice.at(
        question.known_planets or "snapshot",
        question.date_utc,
        planet.albedo,
        question.instrument,
        n_draws=N_DRAWS,
        seed=1,
        candidates=question.candidates,
    )


def _three(draws: FloatArray) -> Quantiles:
    from cpic_planner.planets import quantiles

    low, median, high = quantiles(draws).tolist()
    return Quantiles(low=low, median=median, high=high)


def _open(answers: Sequence[EtcAnswer]) -> OpenQuantiles:
    """Return the quantiles of values; without one an SNR is 0, and a time or a limit has no end."""
    none = 0.0 if answers[0].question == "signal_to_noise" else np.inf
    values = np.sort([none if answer.value is None else answer.value for answer in answers])
    ends = [float(values[round(share * (len(values) - 1))]) for share in (0.16, 0.5, 0.84)]
    low, median, high = (end if np.isfinite(end) else None for end in ends)
    share = float(np.mean([answer.value is not None for answer in answers]))
    return OpenQuantiles(low=low, median=median, high=high, answered_share=share)
