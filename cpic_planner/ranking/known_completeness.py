"""Completeness of known planets, star by star, and the filters that choose the stars of a question."""

import hashlib
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from catalogs import Catalogue, KnownPlanetTable, load_known_planets
from cpic_core import ArrayLike, BoolArray, InputError, check_finite, check_whole
from cpic_planner.etc import EtcModel
from cpic_planner.planets import (
    Planets,
    PopulationChoice,
    StarLimits,
    draw_known,
    known_uniforms,
    planets_of,
    star_masses_msun,
)
from cpic_planner.queries import RankedQuestion, ReferencePlanet, called, observed_utc
from cpic_planner.ranking.completeness import BandCompleteness, completeness
from cpic_planner.ranking.in_zone import ZonePlanets
from cpic_planner.ranking.settings import OptimalSetting
from cpic_planner.results import KNOWN_PLANETS, PopulationRecord
from cpic_planner.targets import Targets, named_among, rank_sample, sample_text
from simulator.config import AlbedoSpec, Instrument, checked_utc, unit_of
from simulator.products import mjd_of

MAX_DRAWS = 100_000
N_DRAWS = 4000
KNOWN_ONLY = "those with known planets only"
"""What a sample is called whose stars all have known planets."""


def known_rows(table: KnownPlanetTable, targets: Targets) -> list[tuple[int, ...]]:
    """Return the rows of the counted planets of each star, by any of its names; empty where it has none."""
    return [table.rows_of(str(name)) for name in targets.name]


def hosts_among(targets: Targets, table: KnownPlanetTable) -> BoolArray:
    """Tell which targets have known planets that are counted."""
    return np.array([bool(rows) for rows in known_rows(table, targets)], bool)


@dataclass(frozen=True, eq=False)
class KnownSample:
    """Draws of the known planets of ``n`` stars at one date: for each star, its planets with their draws."""

    planets: tuple[tuple[Planets, ...], ...]
    n_draws: int


@dataclass(frozen=True, eq=False)
class KnownChoice:
    """A table of known planets, a date, and how often each planet is drawn.

    Attributes
    ----------
    table : KnownPlanetTable
    date_utc : str
        As written into results.
    mjd : float
        The same date.
    albedo : AlbedoSpec
        What the planets reflect.
    n_draws, seed : int
    """

    table: KnownPlanetTable
    date_utc: str
    mjd: float
    albedo: AlbedoSpec
    n_draws: int = N_DRAWS
    seed: int = 1

    @classmethod
    def at(
        cls,
        source: str | Path,
        date: str | None,
        albedo: AlbedoSpec,
        instrument: Instrument,
        *,
        n_draws: int,
        seed: int,
        candidates: bool = False,
    ) -> "KnownChoice":
        """Return the choice of a table and a date as people write them.

        Parameters
        ----------
        source : str or Path
            As `catalogs.known_planets.load_known_planets` reads it.
        date : str or None
            UTC; None for the start of the instrument's mission.
        albedo : AlbedoSpec
        instrument : Instrument
        n_draws, seed : int
        candidates : bool
            Whether candidates are counted.

        Raises
        ------
        InputError
            For a table that cannot be used, or a text that is no date.
        """
        utc = checked_utc("--date", instrument.mission.start_utc if date is None else date)
        return cls(load_known_planets(source, candidates=candidates), utc, mjd_of(utc), albedo, n_draws, seed)

    def stars(self, targets: Targets) -> Targets:
        """Return the targets that have known planets which are counted.

        Raises
        ------
        InputError
            If none has.
        """
        hosts = hosts_among(targets, self.table)
        if not hosts.any():
            raise InputError("known_planets", self.table.provenance, allowed="planets of stars of the sample")
        return targets.select(hosts)

    def draw(self, targets: Targets) -> KnownSample:
        """Return the draws of the planets of each star.

        Raises
        ------
        InputError
            If a number is out of range.
        """
        n = check_whole("n_draws", self.n_draws, 1, MAX_DRAWS)
        mjd = float(check_finite("mjd", self.mjd, "d"))
        made = []
        masses = star_masses_msun(targets.name.tolist(), targets.log_g, targets.luminosity_lsun, targets.teff_k)
        for rows, mass in zip(known_rows(self.table, targets), masses, strict=True):
            uniforms = known_uniforms(self.table, rows, n, self.seed)
            drawn = draw_known(self.table, rows, uniforms, epoch_mjd=mjd, star_mass_msun=mass)
            made.append(tuple(planets_of(drawn, k, self.albedo) for k in range(len(rows))))
        return KnownSample(tuple(made), n)

    def record(self) -> PopulationRecord:
        """Return what is written into results, where the population of a ranking is."""
        return PopulationRecord(
            name=KNOWN_PLANETS,
            description=f"{self.table.provenance}, on {self.date_utc}",
            n_planets=self.n_draws,
            seed=self.seed,
            planets_per_star=None,
            columns_not_used=list(self.table.unused),
        )

    def content(self) -> dict[str, Any]:
        """Return what decides the probability, for content hashes."""
        tables = [self.table, *self.table.solutions.values()]
        cells = [[(name, column.tolist()) for name, column in table.columns.items()] for table in tables]
        digest = hashlib.sha256(repr((cells, self.table.candidates)).encode()).hexdigest()
        albedo = ReferencePlanet(albedo=self.albedo).content()["albedo"]
        return {"table": digest, "mjd": self.mjd, "n_draws": self.n_draws, "seed": self.seed, "albedo": albedo}


def counted_planets(question: RankedQuestion) -> PopulationChoice | KnownChoice:
    """Return the population, or the known planets, that the completeness of a ranking refers to.

    Raises
    ------
    InputError
        If there is no such table of known planets, or it cannot be used.
    """
    if question.known_planets is None:
        return PopulationChoice(question.population, question.n_planets, question.seed, question.exclusions)
    n_draws, albedo = check_whole("n_planets", question.n_planets, 1, MAX_DRAWS), question.planet.albedo
    where = question.known_planets, question.date_utc, albedo, question.instrument
    return KnownChoice.at(*where, n_draws=n_draws, seed=question.seed, candidates=question.candidates)


def chosen_targets(targets: Targets, question: RankedQuestion, catalogue: Catalogue) -> tuple[BoolArray, str]:
    """Return which targets pass the filters of a question, and what these are in words.

    Parameters
    ----------
    targets : Targets
        ``n`` stars of the catalogue, at the date.
    question : RankedQuestion
    catalogue : Catalogue

    Returns
    -------
    ndarray of bool, shape (n,)
    str

    Raises
    ------
    InputError
        For names that are unknown, mean several stars or are no target, all of them in one line; and for a filter that
        leaves no star.
    """
    asked = {name: getattr(question, name) for name in question.filters}
    texts = {
        "stars": "named",
        "sp_type": f"of type {' or '.join(question.sp_type)}",
        "distance_max_pc": "within {:g} pc",
        "dec_min_deg": "at {:g} deg of declination or north of it",
        "dec_max_deg": "at {:g} deg of declination or south of it",
        "known_hosts": "hosts of known planets",
    }
    tests: dict[str, Callable[[], Any]] = {
        "stars": lambda: named_among(targets, question.stars, catalogue),
        "sp_type": lambda: [_class_first(text).startswith(question.sp_type) for text in targets.sp_type.tolist()],
        "distance_max_pc": lambda: targets.distance_pc <= asked["distance_max_pc"],
        "dec_min_deg": lambda: targets.dec_deg >= asked["dec_min_deg"],
        "dec_max_deg": lambda: targets.dec_deg <= asked["dec_max_deg"],
        "known_hosts": lambda: [
            bool(rows) for rows in known_rows(load_known_planets(candidates=question.candidates), targets)
        ],
    }
    keep, left = np.ones(len(targets), bool), f"none of the {len(targets)} ranked stars passes"
    for name, value in asked.items():
        keep = keep & np.asarray(tests[name](), bool)
        if not keep.any():
            shown = "given" if value is True else value
            raise InputError(name, shown, unit=unit_of(name), allowed="a filter that leaves a star", hint=left)
        left = f"none of the {keep.sum()} stars that {called(name)} leaves passes"
    return keep, ", ".join(texts[name].format(value) for name, value in asked.items())


def _class_first(sp_type: str) -> str:
    """Return a spectral type from its class on, without blanks and without what stands before it (sd, d, a bracket)."""
    return re.sub(r"^[^OBAFGKM]*", "", "".join(sp_type.split()))


@dataclass(frozen=True, eq=False)
class AskedStars:
    """The stars that a question ranks.

    Attributes
    ----------
    targets : Targets
        All ``n`` that are ranked.
    counted : PopulationChoice or KnownChoice
        The planets that completeness counts.
    chosen : ndarray of bool, shape (n,), or None
        Those that pass the filters of the question; None without filters.
    text : str
        In words, those that are chosen.
    notes : tuple of str
        Remarks on the tables, for the person who asked.
    """

    targets: Targets
    counted: PopulationChoice | KnownChoice
    chosen: BoolArray | None
    text: str
    notes: tuple[str, ...]

    @property
    def answered(self) -> Targets:
        """The stars that an answer is about."""
        return self.targets if self.chosen is None else self.targets.select(self.chosen)


def asked_stars(question: RankedQuestion, catalogue: Catalogue) -> AskedStars:
    """Return the stars that a question ranks and the planets that count around them.

    Raises
    ------
    InputError
        For tables that cannot be read, and cuts or filters that leave no star.
    """
    cuts = {name: getattr(question, name) for name in ("v_mag_max", "dwarfs_only", "singles_only")}
    date_utc = observed_utc(question)
    targets = rank_sample(catalog=catalogue, companions=question.companions, date_utc=date_utc, **cuts)
    text, counted, notes = sample_text(catalogue, *cuts.values()), counted_planets(question), catalogue.notes
    if isinstance(counted, KnownChoice):
        targets, text = counted.stars(targets), f"{text}; {KNOWN_ONLY}"
        notes = (*notes, *counted.table.notes)
    if not question.filters:
        return AskedStars(targets, counted, None, text, tuple(notes))
    chosen, words = chosen_targets(targets, question, catalogue)
    return AskedStars(targets, counted, chosen, f"{text}; of these only those that are {words}", tuple(notes))


def known_completeness(
    model: EtcModel,
    targets: Targets,
    band: str,
    known: KnownSample,
    *,
    exposure_s: ArrayLike,
    n_frames: ArrayLike,
    em_gain: ArrayLike,
    visits: ArrayLike = 1.0,
) -> BandCompleteness:
    """Return the probability that one observation of each star detects at least one of its known planets.

    Parameters
    ----------
    model, targets, band, exposure_s, n_frames, em_gain, visits
        As of `cpic_planner.ranking.completeness.completeness`.
    known : KnownSample
        Of the same stars.

    Returns
    -------
    BandCompleteness
        Completenesses, ``in_zone`` and ``observable`` are probabilities of at least one planet, those of a star's
        planets taken as independent; ``expected_planets`` is the sum of those at their places, where known planets are
        looked for. What velocities exclude does not count: these planets are known.
    """
    asked = {"exposure_s": exposure_s, "n_frames": n_frames, "em_gain": em_gain, "visits": visits}
    settings = {name: np.broadcast_to(np.asarray(value, float), (len(targets),)) for name, value in asked.items()}
    missed, (expected, variance) = np.ones((4, len(targets))), np.zeros((2, len(targets)))
    flags: dict[str, None] = {}
    for i, bodies in enumerate(known.planets):
        star = targets.select([i])
        shares, scatter = [], []
        for body in bodies:
            own = {name: values[i] for name, values in settings.items()}
            one = completeness(model, star, band, body, **own, search="known_place")
            seen = one.completeness[0], one.completeness_known_place[0], one.in_zone[0], one.observable[0]
            missed[:, i] *= 1.0 - np.array(seen)
            shares.append(float(one.counted[0]))
            scatter.append(float(one.standard_error[0]))
            flags |= dict.fromkeys(one.flags)
        expected[i] = sum(shares)
        variance[i] = _variance(shares, scatter)
    blind, placed, in_zone, observable = 1.0 - missed
    return BandCompleteness(
        band=band,
        search="known_place",
        n_planets=known.n_draws,
        completeness=blind,
        completeness_known_place=placed,
        completeness_unconditional=blind,
        completeness_known_place_unconditional=placed,
        standard_error=np.sqrt(variance),
        in_zone=in_zone,
        observable=observable,
        expected_planets=expected,
        expected_planets_unconditional=expected,
        flags=tuple(flags),
    )


@dataclass(frozen=True, eq=False)
class CountedPlanets:
    """Planets that completeness counts around ``n`` stars, the same under every instrument; made by `of`.

    Attributes
    ----------
    targets : Targets
    planets : Planets or KnownSample
        Of a population, the same at every star, or each star's own.
    limits : StarLimits or None
        What is known of the stars and excludes planets; None where the planets are the known ones.
    around : ZonePlanets or None
        Where the planets of a population stand.
    """

    targets: Targets
    planets: Planets | KnownSample
    limits: StarLimits | None
    around: ZonePlanets | None

    @classmethod
    def of(cls, choice: PopulationChoice | KnownChoice, targets: Targets, *, keep: bool = False) -> "CountedPlanets":
        """Return what a choice counts; ``keep`` it placed, for more than one instrument."""
        if isinstance(choice, KnownChoice):
            return cls(targets, choice.draw(targets), None, None)
        planets = choice.draw()
        return cls(targets, planets, choice.limits(targets.name.tolist()), ZonePlanets(targets, planets, keep=keep))

    def completeness(self, model: EtcModel, band: str, setting: OptimalSetting) -> BandCompleteness:
        """Return the completeness of the observation of each star.

        Parameters
        ----------
        model : EtcModel
        band : str
        setting : OptimalSetting
            How each star is observed in that band.
        """
        taken: dict[str, Any] = {name: getattr(setting, name) for name in ("exposure_s", "em_gain", "visits")}
        taken["n_frames"] = setting.frames_per_visit
        if isinstance(self.planets, KnownSample):
            return known_completeness(model, self.targets, band, self.planets, **taken)
        taken |= {"limits": self.limits, "around": self.around}
        return completeness(model, self.targets, band, self.planets, **taken)


def _variance(shares: Sequence[float], errors: Sequence[float]) -> float:
    """Return the variance of ``1 - prod(1 - p)`` where each p has a standard error."""
    total = 0.0
    for k, error in enumerate(errors):
        others = np.prod([1.0 - other for j, other in enumerate(shares) if j != k])
        total += error**2 * float(others) ** 2
    return total
