"""Questions to the exposure-time calculator, and ``cpic etc`` whole about one star.

Known planets asked for by name: their place and light at a date, and what the errors of both mean for an answer.
"""

from __future__ import annotations

import contextlib
import functools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import replace
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from catalogs import Catalogue, open_catalogue, resolve_star
from cpic_core import Advance, FloatArray, InputError, Record, shortened, untold
from cpic_planner import etc, report
from cpic_planner.api.functions import catalogue_of, model_of, shipped_star, stars_named
from cpic_planner.etc import EtcModel, etc_result, questions, reference_notes
from cpic_planner.queries import MAX_VISITS, EtcQuestion, ReferencePlanet, called, differing_values, observed_utc
from cpic_planner.queries.etc import PLACES
from cpic_planner.results import (
    AnsweredStar,
    EtcAnswer,
    EtcFidelity,
    EtcResult,
    EtcStarsResult,
    KnownPlanetLook,
    OpenQuantiles,
    Quantiles,
)
from cpic_planner.results.compared import leaves
from cpic_planner.targets import Targets, find_target
from simulator.config import content_hash, load_instrument
from simulator.target import albedo_source

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from cpic_planner.planets import Planets
    from cpic_planner.queries.rank import EnsembleChoice
    from cpic_planner.ranking import KnownChoice


N_DRAWS = 4000
"""Draws of a planet."""
N_LOOKS = 100
"""Draws of a planet of which each is asked about, evenly among all of them by contrast."""
_PLACE = ("separation_arcsec", "separation_au", "semi_major_axis_au", "contrast", "distance_pc")


class NamedPlanet(Record, eq=False):
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

    def question(self, question: EtcQuestion) -> EtcQuestion:
        """Return a question about the planet: it is looked for at its place unless the question says otherwise."""
        strategy = question.strategy
        if "search" not in strategy.model_fields_set:
            strategy = strategy.model_copy(update={"search": "known_place"})
        return question.model_copy(update={"strategy": strategy})

    def answers(self, question: EtcQuestion, model: EtcModel, star: Targets) -> list[EtcAnswer]:
        """Return the answers about it, band by band: at the medians of place and contrast, with what these leave open.

        Parameters
        ----------
        question : EtcQuestion
            As `question` has it.
        model : EtcModel
        star : Targets
            The planet's, as asked for.
        """
        from cpic_planner.ranking.known_answer import planets_contrast

        drawn = self.drawn()
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
            first, *others = closed_forms(question.model_copy(update=place), one, star)
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


def star_or_planet(question: EtcQuestion, name: str, catalogue: Catalogue) -> tuple[Targets, str, NamedPlanet | None]:
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
    date_utc, planet = observed_utc(question), None
    try:
        resolve_star(name, catalogue.table)
    except InputError as error:
        planet = planet_of_name(_choice(question), name, error)
    called_star, companions = name if planet is None else planet.star, question.companions
    if catalogue.kind == "snapshot" and question.catalog == "snapshot" and question.v_mag is None:
        star, remark = shipped_star(called_star, companions, date_utc)
    else:
        star, remark = find_target(called_star, companions=companions, catalog=catalogue, date_utc=date_utc)
    if planet is None:
        return star, remark, None
    for field in (*_PLACE, "planet.radius_rjup", "planet.phase_deg"):
        if question.is_given(*field.split(".")):
            allowed = f"without it: {called('known_planets')} has place, size and light of {planet.name}"
            raise InputError(field, "given with the name of a planet", allowed=allowed)
    return star, remark, planet


def planet_of_name(choice: KnownChoice, name: str, unknown: InputError) -> NamedPlanet:
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


_ENDLESS_S = 1e12


def as_asked(question: EtcQuestion, star: Targets) -> Targets:
    """Return a star at the roll of a question, and at its distance if it has one.

    Parameters
    ----------
    question : EtcQuestion
        The star's luminosity follows the square of its ``distance_pc``.
    star : Targets
        One star.
    """
    if star.roll_deg is not question.observation_roll_deg and star.roll_deg != question.observation_roll_deg:
        star = replace(star, roll_deg=question.observation_roll_deg)
    if question.distance_pc is None:
        return star
    brighter = (question.distance_pc / star.distance_pc) ** 2
    return replace(star, distance_pc=np.array([question.distance_pc]), luminosity_lsun=star.luminosity_lsun * brighter)


def closed_forms(question: EtcQuestion, model: etc.EtcModel, star: Targets) -> list[EtcAnswer]:
    """Return the answers of the closed forms about one star, or about several at given separations.

    Parameters
    ----------
    question : EtcQuestion
    model : EtcModel
        Of the question's instrument, bands and strategy.
    star : Targets

    Returns
    -------
    list of EtcAnswer
        Stars in order, bands within each, then separations and planets.
    """
    places = places_of(question, star)
    # Numbers of frames take another time with each camera.
    groups = [model.bands] if question.n_frames is None else [(band,) for band in model.bands]
    answers = []
    for bands in groups:
        there = best_places(question, model, star, bands) if places is None else dict.fromkeys(bands, places)
        answers += _ask(question, model, star, there)
    return answers


def places_of(question: EtcQuestion, star: Targets) -> Sequence[float] | None:
    """Return the separations that are asked for in arcsec, of a star at its distance; None for the best ones."""
    pc = float(star.distance_pc[0])
    if question.separation_au is not None:
        largest = pc * etc.FARTHEST_ARCSEC
        return [etc.check_range("separation_au", place, 0.0, largest, "au") / pc for place in question.separation_au]
    if question.semi_major_axis_au is None:
        return question.separation_arcsec
    planet = question.planet[0] if isinstance(question.planet, tuple) else question.planet
    across = math.sin(math.radians(planet.phase_deg)) / pc
    largest = min(etc.FARTHEST_ARCSEC / across, 1e5)
    return [etc.check_range("semi_major_axis_au", question.semi_major_axis_au, 1e-3, largest, "au") * across]


def _ask(
    question: EtcQuestion, model: etc.EtcModel, star: Targets, places: Mapping[str, Sequence[float]]
) -> list[EtcAnswer]:
    frames = {"exposure_s": question.exposure_s, "em_gain": question.em_gain}
    common: dict[str, Any] = {"bands": tuple(places), "separation_arcsec": places} | frames
    given: dict[str, Any] = {"exact": question.exact} | questions.times_of(question, model, next(iter(places)))
    if question.contrast_limit:
        return questions.contrast_limit(model, star, sigma=question.sigma, snr=question.snr, **given, **common)
    planet = list(question.planet) if isinstance(question.planet, tuple) else question.planet
    common |= {"planet": planet, "contrast": None if question.contrast is None else list(question.contrast)}
    if question.asks_time:
        level: dict[str, Any] = {"snr": question.snr, "sigma": question.sigma, "detect": question.detect}
        return questions.exposure_time(model, star, visit_time_s=question.visit_time_s, **level, **common)
    return questions.signal_to_noise(model, star, **given, **common)


def best_places(
    question: EtcQuestion, model: etc.EtcModel, star: Targets, bands: Sequence[str]
) -> dict[str, list[float]]:
    """Return the separation of least time, of clearest detection or of faintest limit, for each contrast or planet.

    Where the level is out of reach it is the separation that comes nearest to it. Frames need not be whole in this
    search, which is on the grid of the ranking.

    Parameters
    ----------
    question : EtcQuestion
    model : EtcModel
    star : Targets
    bands : sequence of str
        Bands of the model.

    Returns
    -------
    dict of str to list of float
        By band.
    """
    planets = question.planet if isinstance(question.planet, tuple) else (question.planet,)
    ratios = (questions.TRIAL_CONTRAST,) if question.contrast_limit else question.contrast
    best: dict[str, list[float]] = {band: [] for band in bands}
    questions.check_levels(question.snr, question.sigma, largest=1e3 if question.contrast_limit else 1e6)
    for planet, contrast in [(planets[0], ratio) for ratio in ratios] if ratios else [(one, None) for one in planets]:
        light = albedo_source(planet.albedo)  # another one where its file has been written anew
        how = question.exposure_s, question.em_gain
        for cases in _on_grids(model, star, tuple(bands), planet, light, contrast, *how):
            cost = _cost(question, model, cases.asked_for(snr=question.snr, sigma=question.sigma))
            for band, there, own in zip(cases.bands, cases.planets, cost, strict=True):
                best[band].append(float(there.separation_arcsec[int(np.argmin(own))]))
    return best


@functools.lru_cache(maxsize=32)
def _on_grids(
    model: etc.EtcModel,
    star: Targets,
    bands: tuple[str, ...],
    planet: ReferencePlanet,
    light: object,
    contrast: float | None,
    exposure_s: float | None,
    em_gain: float | None,
) -> list[etc.Cases]:
    """Return the cases of a planet at all separations of the bands; kept, as who asks about a star asks again.

    What its albedo is at present, ``light``, is in the key alone.
    """
    grids = {band: etc.separation_grid(model, band) for band in bands}
    most = max(len(grid) for grid in grids.values())
    grids = {band: np.pad(grid, (0, most - len(grid)), "edge") for band, grid in grids.items()}
    them = {band: etc.planets_of(list(grid), planet, contrast) for band, grid in grids.items()}
    return etc.cases_by_camera(model, star, bands, them, exposure_s=exposure_s, em_gain=em_gain)


def _cost(question: EtcQuestion, model: etc.EtcModel, cases: etc.Cases) -> FloatArray:
    """Return what to make small, one number a band and separation; places outside the field cost ``inf``."""
    given = model.strategy.visits
    if not question.asks_time:
        times = questions.times_of(question, model, cases.bands[0])
        return cases.missed_in(etc.Span.of(model, times["time_s"], times["visit_time_s"]))
    fixed = np.full(cases.contrast.shape, float(given or 1))
    if question.visit_time_s is not None:
        time_s = cases.fewest(model.visit_s(question.visit_time_s)) * question.visit_time_s
    else:
        # Modes change the best number of visits less than the time that it takes.
        visits, time_s = cases.by_mean.quickest() if given is None else (fixed, fixed)
        if given is not None or model.strategy.n_modes:
            time_s = visits * model.time_s(cases.solved(visits, about=True)[0])
    cost = np.where(cases.possible, time_s, np.inf)
    answered = np.isfinite(cost).any(axis=(1, 2), keepdims=True)
    if answered.all():
        return cost
    return np.where(answered, cost, cases.missed_in(etc.Span(given or MAX_VISITS, time_s=_ENDLESS_S)))


Working: TypeAlias = Callable[[str, int], AbstractContextManager[Advance]]
"""Shows work by its title and the number of its pieces, while it is done: yields who is told about finished ones."""


def _unseen(title: str, total: int) -> AbstractContextManager[Advance]:
    return contextlib.nullcontext(untold)


def checked(
    question: EtcQuestion,
    model: etc.EtcModel,
    stars: Sequence[Targets],
    answers: Sequence[EtcAnswer],
    working: Working = _unseen,
) -> list[EtcAnswer]:
    """Return the answers with their stated errors, checked in images where the question asks for it.

    Parameters
    ----------
    question : EtcQuestion
    model : EtcModel
    stars : sequence of Targets
        One star each, as many answers for each as for the others.
    answers : sequence of EtcAnswer
    working : callable
        Shows how far the images are, see `Working`.
    """
    from cpic_planner.confirm import checked_answers, needs_images

    each = len(answers) // len(stars)
    around = [star for star in stars for _ in range(each)]
    bodies: list[ReferencePlanet | None] = [None] * len(answers)
    if not question.contrast_limit and question.contrast is None:
        planets = question.planet if isinstance(question.planet, tuple) else (question.planet,)
        bodies = [planets[index % len(planets)] for index in range(len(answers))]
    settings = {"seed": question.seed, "realisations": question.realisations}
    given: dict[str, Any] = {name: value for name, value in settings.items() if value is not None}
    with working("images, per cent", 100 * sum(needs_images(answer, question.dial) for answer in answers)) as advance:
        return checked_answers(model, around, answers, bodies, question.dial, advance=advance, **given)


def _closed_forms_of(
    question: EtcQuestion, star: Targets, planet: NamedPlanet | None, working: Working = _unseen
) -> tuple[EtcQuestion, Targets, EtcModel, list[EtcAnswer]]:
    """Return a question as it is answered about a star or its known planet, the star at its roll, model and answers."""
    star = as_asked(question, star)
    question = question if planet is None else planet.question(question)
    ask = functools.partial(closed_forms if planet is None else planet.answers, question)
    model, drawn = model_of(question), question.drawn_instruments
    answers = ask(model, star)
    if drawn is not None:
        others = _with_instruments(lambda other: ask(other, star), model, drawn, working)
        answers = [
            answer.model_copy(update={"over_instruments": _open(found)})
            for answer, *found in zip(answers, *others, strict=True)
        ]
    return question, star, model, answers


def _with_instruments(
    ask: Callable[[EtcModel], list[EtcAnswer]], model: EtcModel, choice: EnsembleChoice, working: Working
) -> Iterator[list[EtcAnswer]]:
    """Yield what each drawn instrument answers."""
    from cpic_planner.ranking.sensitivity import check_modelled, instrument_of, states_of

    check_modelled(model)
    states, draws = states_of(model, choice.ensemble), choice.draws()
    with working("instruments", choice.n_instruments) as advance:
        for number, values in enumerate(zip(*draws.values(), strict=True), 1):
            yield ask(instrument_of(model, choice.ensemble, states, dict(zip(draws, values, strict=True))))
            advance(f"instrument {number}")


def answers_of(question: EtcQuestion) -> list[EtcAnswer]:
    """Return the answers about all stars of a question."""
    plain = question.fidelity is None and question.tolerance is None
    try:
        stars = stars_named(question)
        named: list[tuple[Targets, NamedPlanet | None]] = [(star, None) for star in stars]
    except InputError:
        # A name that no star has may be that of a planet.
        stars, catalogue = [], catalogue_of(question)
        found = (star_or_planet(question, name, catalogue) for name in question.target)
        named = [(star, planet) for star, _, planet in found]
    if question.instruments is not None or not stars:
        answers: list[EtcAnswer] = []
        for named_star, planet in named:
            one, star, model, own = _closed_forms_of(question, named_star, planet)
            answers += own if plain else checked(one, model, [star], own)
        return answers
    model = model_of(question)
    stars = [as_asked(question, star) for star in stars]
    together = question.separation_arcsec is not None and question.n_frames is None
    groups = [Targets.joined(stars)] if together else stars
    answers = [answer for group in groups for answer in closed_forms(question, model, group)]
    return answers if plain else checked(question, model, stars, answers)


class Answered(Record, eq=False):
    """A question about one star with its answer.

    Attributes
    ----------
    question : EtcQuestion
        As it is answered: a known planet is looked for at its place.
    model : EtcModel
    star : Targets
    result : EtcResult
    placed : bool
        Whether the question gives the separation.
    """

    question: EtcQuestion
    model: EtcModel
    star: Targets
    result: EtcResult
    placed: bool

    @property
    def found(self) -> bool:
        """Tell whether there is an answer, and of a planet a detection."""
        rows = self.result.answers
        return any(row.status == "ok" if row.verdict is None else row.verdict == "detected" for row in rows)

    def blocks(self, *, every_budget: bool = False, explain: bool = False) -> Iterator[report.Block]:
        """Return the answer as a document, see `cpic_planner.report.etc_blocks`."""
        about: dict[str, Any] = {"asked": report.question_text(self.question), "placed": self.placed}
        return report.etc_blocks(self.result, every_budget=every_budget, explain=explain, **about)

    def figure(self) -> Figure:
        """Draw SNR against time, the contrast limit against separation, and the noise budgets."""
        question, result = self.question, self.result
        best, allowed = report.best_row(result), question.wall_s
        if best is not None and best.time_s is not None and (question.asks_time or question.n_frames is not None):
            allowed = best.time_s
        settings: dict[str, Any] = {name: getattr(question, name) for name in ("snr", "sigma", "exposure_s", "em_gain")}
        rows = result.answers
        curves = report.etc_curves(self.model, self.star, rows, time_s=allowed, best_band=result.best_band, **settings)
        return report.etc_figure(result, curves)


def answered(question: EtcQuestion, working: Working = _unseen) -> Answered:
    """Answer a question about one star or known planet.

    Parameters
    ----------
    question : EtcQuestion
        Its first target counts.
    working : callable
        Shows how far images are, where the question asks for them.

    Raises
    ------
    InputError
        For an unknown star or band, or a value out of range.
    """
    table = open_catalogue(question.catalog) if question.v_mag is None else catalogue_of(question)
    star, about, known = star_or_planet(question, question.target[0], table)
    if table.kind != "snapshot":
        about = "; ".join(filter(None, (about, f"star data: {table.provenance}")))
    asked_for = question.hashed() | ({} if known is None else {"known_planet": known.content()})
    stated = _stated(question)
    question, star, model, found = _closed_forms_of(question, star, known, working)
    if question.dial.fidelity != "quick":
        found = checked(question, model, [star], found, working)
    planet = question.planet[0] if isinstance(question.planet, tuple) else question.planet
    hypothetical = None if question.contrast_limit or question.contrast is not None or known else planet
    notes = [*table.notes, *(() if known is None else known.choice.table.notes)]
    labels: dict[str, Any] = {"note": about, "notes": notes, "catalogue": table.provenance, "planet": hypothetical}
    seed = 1 if question.seed is None else question.seed
    how: dict[str, Any] = {"asked": asked_for, "stated": stated, "dial": question.dial, "seed": seed}
    result = etc_result(model, star, found, **how, **labels)
    placed = known is not None or any(getattr(question, place) is not None for place in PLACES)
    return Answered(question, model, star, result, placed)


_NOT_STATED = {"target", "instrument", "ensemble", "catalog", "known_planets"}
"""Fields of which results say more elsewhere, or that hold a whole file."""


def _stated(question: EtcQuestion) -> dict[str, str]:
    """Return what is asked other than by default, as texts by the dotted names of the fields."""
    tree = question.model_dump(mode="json", exclude_defaults=True, exclude=_NOT_STATED)
    shipped, name = load_instrument(), question.instrument.name
    if question.instrument is not shipped:
        own = {} if name.startswith(shipped.name) else {"name": name}
        tree["instrument"] = own | differing_values(question.instrument)
    if question.fidelity == "quick":  # is the default in words
        del tree["fidelity"]
    if question.ensemble is not None:
        tree["ensemble"] = question.ensemble.name
    return {key: shortened(text, _LONGEST) for key, text in leaves(tree)}


_LONGEST = 80


def answered_stars(question: EtcQuestion, working: Working = _unseen) -> tuple[EtcStarsResult, bool]:
    """Answer a question about several stars or known planets, each as `answered` does; and whether one is found.

    Parameters
    ----------
    question : EtcQuestion
    working : callable
        As of `answered`.

    Raises
    ------
    InputError
        As `answered`, for the first fault.
    """
    try:
        each = [answered(question.model_copy(update={"target": (name,)}), working) for name in question.target]
    except InputError as error:
        if error.key not in ("star", "target"):
            raise
        hint = f"{error.hint}; {called('target')} of several words stands in quotation marks"
        raise InputError(error.key, error.value, allowed=error.allowed, hint=hint) from None
    stars: list[AnsweredStar] = []
    answers: list[EtcAnswer] = []
    firm: list[EtcFidelity] = []
    for one in (item.result for item in each):
        look = one.answers[0].known_planet
        stars.append(AnsweredStar.of(one, planet=None if look is None else look.planet))
        if one.fidelity is not None:
            moved = [item.model_copy(update={"answer": len(answers) + item.answer}) for item in one.fidelity.answers]
            firm.append(one.fidelity.model_copy(update={"answers": moved}))
        answers += one.answers
    first = next((item.result for item in each if item.result.reference_planet is not None), each[0].result)
    every = [item for fidelity in firm for item in fidelity.answers]
    seed = next((fidelity.seed for fidelity in firm if fidelity.seed is not None), None)
    result = EtcStarsResult(
        asked=first.asked,
        config_hash=content_hash([item.result.config_hash for item in each]),
        catalogue=first.catalogue,
        date_utc=first.date_utc,
        notes=list(dict.fromkeys(note for item in each for note in item.result.notes)),
        reference_planet=first.reference_planet,
        stars=stars,
        answers=answers,
        fidelity=firm[0].model_copy(update={"answers": every, "seed": seed}),
    )
    return result, any(item.found for item in each)
