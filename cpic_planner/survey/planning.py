"""Planets with which schedules are made, where they stand, and how likely visits are to show them."""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Generic, TypeVar

import numpy as np

from catalogs import ORBIT, KnownPlanetTable
from cpic_core import BoolArray, FloatArray, IntArray, NDArray
from cpic_planner.etc import LEAST_PROBABILITY, EtcModel
from cpic_planner.planets import PopulationConfig
from cpic_planner.survey.detection import Pairs, Setting, detection_chance, faintest_of, pair_signals
from cpic_planner.survey.strategy import SurveyStrategy
from cpic_planner.survey.universe import PlanetSample, at_known_place, chance, draw_planet_sample, star_mass_msun
from cpic_planner.targets import Targets
from simulator.config import AlbedoSpec, MeasuredAlbedo, content_hash

N_DRAWS, N_KNOWN = 2000, 1000
"""Planets of each star, and draws of each known one, with which a schedule is made; its yield is that of others."""
_PLANETS_BYTES, _PAIRS_BYTES = 40_000_000, 250_000_000  # the default what-if has 190 MB of pairs
_CHANCES_BYTES, _SHOWN_BYTES = 150_000_000, 100_000_000
KNOWN_ALBEDO = MeasuredAlbedo(model="jupiter")


def albedos_of(population: PopulationConfig | None) -> tuple[AlbedoSpec, ...]:
    """Return the albedos by kind: those of the population, then that of known planets, Jupiter's."""
    own = () if population is None else tuple(kind.albedo for kind in population.mixture)
    return (*(spec for spec in own if spec is not None), KNOWN_ALBEDO)


def dust_of(
    strategy: SurveyStrategy, planets: PlanetSample, seed: int, star: str, block: int | str
) -> FloatArray | None:
    """Return the dust around a star in the universe of each planet, zodi; None where it is the same everywhere.

    Parameters
    ----------
    strategy : SurveyStrategy
    planets : PlanetSample
        Of that star.
    seed : int
    star : str
        Name, which with ``block`` names the random stream: all strategies see the same luck.
    block : int or str
        Number of the block of universes, or ``planning``.
    """
    law = strategy.assumptions.dust
    if law is None:
        return None
    n = int(planets.universe.max(initial=0)) + 1
    return law.zodis(chance(seed, "dust", star, block, shape=(n,)))[planets.universe]


@dataclass(frozen=True, eq=False)
class Host:
    """A star with what may be found there: new planets of a population, and known ones.

    Attributes
    ----------
    star : Targets
        One star.
    population : PopulationConfig or None
        None: known planets alone.
    known : KnownPlanetTable or None
    known_rows : tuple of int
        Rows of the star's planets in that table.
    """

    star: Targets
    population: PopulationConfig | None
    known: KnownPlanetTable | None
    known_rows: tuple[int, ...]

    def parts(self) -> list[Host]:
        """Return the star with each of its known planets alone, then with its population alone."""
        known = [replace(self, population=None, known_rows=(row,)) for row in self.known_rows if self.known is not None]
        return known if self.population is None else [*known, replace(self, known=None, known_rows=())]

    def content(self) -> dict[str, Any]:
        """Return what decides the planets and their light; known planets by what their published orbits say."""
        orbits = [] if self.known is None else [self.known.orbits_of(row).columns for row in self.known_rows]
        return {
            "star": self.star.content(),
            "population": _digest(self.population),
            "known": [{name: cells.astype(str).tolist() for name, cells in rows.items()} for rows in orbits],
        }


@functools.lru_cache(maxsize=16)
def _digest(population: PopulationConfig | None) -> str:
    """Return the digest of a population; empty for none."""
    return "" if population is None else content_hash(population.content())


@dataclass(frozen=True, eq=False)
class Looks:
    """Visits that a star can have.

    Attributes
    ----------
    options : tuple of Setting
        Ways to make a visit: band and time.
    open : ndarray of bool, shape (o, b)
        Slots in which each is possible.
    day, roll_deg : ndarray, shape (b,)
        When a visit in each slot takes place, after the start, and the roll of the first one there.
    """

    options: tuple[Setting, ...]
    open: BoolArray
    day: FloatArray
    roll_deg: FloatArray


@dataclass(frozen=True, eq=False)
class Shown:
    """The planets that visits of a star are likely to show.

    Attributes
    ----------
    planets : PlanetSample
        All planets drawn that any date can show.
    seen : ndarray of int, shape (m,)
        Those of them that a visit can show.
    chance : ndarray, shape (o, b, m)
        Probability that a visit in a slot detects each of these.
    """

    planets: PlanetSample
    seen: IntArray
    chance: NDArray[np.float32]


_T = TypeVar("_T")


class _Latest(Generic[_T]):
    """The latest values by a key, up to some number of bytes of their arrays."""

    def __init__(self, most_bytes: int) -> None:
        self._most, self._bytes = most_bytes, 0
        self._kept: dict[Hashable, _T] = {}

    def get(self, key: Hashable, make: Callable[[], _T]) -> _T:
        """Return what is kept under a key; what is not is made."""
        if key not in self._kept:
            self._kept[key] = made = make()
            self._bytes += _size(made)
            while self._bytes > self._most and len(self._kept) > 1:
                self._bytes -= _size(self._kept.pop(next(iter(self._kept))))
        return self._kept[key]


def _size(made: object) -> int:
    return sum(part.nbytes if isinstance(part, np.ndarray) else _size(part) for part in vars(made).values())


@dataclass(frozen=True, eq=False)
class _Seen:
    """Planets that visits of one kind can show, by their number among those drawn, and the chances, shape (b, m)."""

    planets: IntArray
    chance: NDArray[np.float32]


class PlanningSky:
    """Planets with which schedules are made, and what visits show of them.

    What the same visits show of the same planets is worked out once, for all strategies and for all states of what is
    known (`cpic_planner.survey.facts`).

    Parameters
    ----------
    seed : int
    reach_arcsec : tuple of float
        Separations between which any band shows a planet; others are left out.
    """

    def __init__(self, seed: int, reach_arcsec: tuple[float, float]) -> None:
        self.seed = seed
        self._reach = reach_arcsec
        self._planets = _Latest[PlanetSample](_PLANETS_BYTES)
        self.stored_pairs = _Latest[Pairs](_PAIRS_BYTES)
        self.stored_chances = _Latest[_Seen](_CHANCES_BYTES)
        self._view: PlanningView | None = None

    def planets(self, host: Host, epoch_mjd: float) -> PlanetSample:
        """Return a star's planets that any date shows, of `N_KNOWN` draws of each known one and `N_DRAWS` new ones.

        Parameters
        ----------
        host : Host
        epoch_mjd : float
            Start of the survey.
        """
        found = [self.of_part(part, _content(part), epoch_mjd) for part in host.parts()]
        return PlanetSample.joined(_known_as(found, host))

    def pairs(self, planets: PlanetSample, days: FloatArray, distance_pc: float) -> Pairs:
        """Return the planets of a star at the dates on which any band may show them.

        Parameters
        ----------
        planets : PlanetSample
        days : ndarray
            After the start of the survey.
        distance_pc : float
        """
        orbits = hashlib.sha256(b"".join(getattr(planets, name).tobytes() for name in (*ORBIT, "period_days")))
        reach = [edge * distance_pc for edge in self._reach]
        key = orbits.hexdigest(), days.tobytes(), *reach
        return self.stored_pairs.get(key, lambda: Pairs.between(planets.places(days), *reach))

    def view(self, strategy: SurveyStrategy, model: EtcModel) -> PlanningView:
        """Return what visits by a strategy and its model show; that of the last one is kept."""
        if self._view is None or not self._view.is_of(strategy, model):
            self._view = PlanningView(self, strategy, model)
        return self._view

    def of_part(self, part: Host, content: str, epoch_mjd: float) -> PlanetSample:
        """Return the planets of one of the parts of a star.

        Parameters
        ----------
        part : Host
        content : str
            Digest of its content.
        epoch_mjd : float
            Start of the survey.
        """

        def drawn() -> PlanetSample:
            star = part.star
            who = str(star.name[0]), float(star_mass_msun(star)[0]), float(star.luminosity_lsun[0])
            planets = draw_planet_sample(
                *who,
                part.population,
                known=part.known,
                known_rows=part.known_rows,
                epoch_mjd=epoch_mjd,
                n=N_KNOWN if part.population is None else N_DRAWS,
                seed=self.seed,
                stage="planning",
                one_each=True,
            )
            distance = float(star.distance_pc[0])
            return planets.select(planets.within(*(edge * distance for edge in self._reach)))

        return self._planets.get((content, epoch_mjd), drawn)


class PlanningView:
    """The view that a strategy's visits have of the planets that schedules are made with.

    Parameters
    ----------
    sky : PlanningSky
    strategy : SurveyStrategy
    model : EtcModel
        That of the strategy.
    """

    def __init__(self, sky: PlanningSky, strategy: SurveyStrategy, model: EtcModel) -> None:
        self._sky, self._strategy, self._model = sky, strategy, model
        self._stored = _Latest[Shown](_SHOWN_BYTES)
        assumed, content = strategy.assumptions, model.content()
        of_all = content | {
            "detection": strategy.detection.model_dump(mode="json"),
            "dust": None if assumed.dust is None else assumed.dust.model_dump(mode="json"),
        }
        self._rules = {band: content_hash(of_all | {"optics": key}) for band, key in content["optics"].items()}

    def is_of(self, strategy: SurveyStrategy, model: EtcModel) -> bool:
        """Return whether a strategy and its model show the same."""
        return model is self._model and strategy == self._strategy

    def shown(self, host: Host, looks: Looks, epoch_mjd: float) -> Shown:
        """Return what the visits that a star can have are likely to show.

        Parameters
        ----------
        host : Host
        looks : Looks
        epoch_mjd : float
            Start of the survey.
        """
        when = (item.tobytes() for item in (looks.open, looks.day, looks.roll_deg))
        key = (_content(host), host.known_rows, looks.options, epoch_mjd, *when)
        return self._stored.get(key, lambda: self._shown(host, looks, epoch_mjd))

    def _shown(self, host: Host, looks: Looks, epoch_mjd: float) -> Shown:
        samples: list[PlanetSample] = []
        columns, seen = [], []
        faintest = [functools.cache(functools.partial(self._faintest, host.star, option)) for option in looks.options]
        for part in host.parts():
            content = _content(part)
            planets = self._sky.of_part(part, content, epoch_mjd)
            of_options = [
                self._looked(
                    part, content, planets, replace(looks, options=(option,), open=open_[None]), epoch_mjd, faint
                )
                for option, open_, faint in zip(looks.options, looks.open, faintest, strict=True)
            ]
            some = np.unique(np.concatenate([item.planets for item in of_options]))
            chance = np.zeros((*looks.open.shape, some.size), np.float32)
            for o, item in enumerate(of_options):
                chance[o][:, np.searchsorted(some, item.planets)] = item.chance
            columns.append(chance)
            seen.append(some + sum(len(item) for item in samples))
            samples.append(planets)
        planets = PlanetSample.joined(_known_as(samples, host))
        return Shown(planets, np.concatenate(seen), np.concatenate(columns, axis=2))

    def _looked(
        self,
        part: Host,
        content: str,
        planets: PlanetSample,
        looks: Looks,
        epoch_mjd: float,
        faintest: Callable[[], FloatArray],
    ) -> _Seen:
        """Return what visits in one way show of the planets of a part of a star."""
        (option,), (open_,) = looks.options, looks.open
        sky, strategy = self._sky, self._strategy

        def made() -> _Seen:
            days, slots = looks.day[open_], np.flatnonzero(open_)
            if not (days.size and len(planets)):
                return _Seen(np.zeros(0, np.int64), np.zeros((open_.size, 0), np.float32))
            pairs = sky.pairs(planets, days, float(part.star.distance_pc[0]))
            zodis = dust_of(strategy, planets, sky.seed, str(part.star.name[0]), "planning")
            albedos, roll = albedos_of(part.population), looks.roll_deg[open_]
            signals = pair_signals(self._model, part.star, option, planets, albedos, pairs, roll, zodis, faintest())
            rule, placed = strategy.detection, at_known_place(planets, part.known)[pairs.planet]
            odds = detection_chance(signals, rule, placed, calibration=rule.calibration)
            likely = odds >= LEAST_PROBABILITY
            some, column = np.unique(pairs.planet[likely].astype(np.int64), return_inverse=True)
            chance = np.zeros((open_.size, some.size), np.float32)
            chance[slots[pairs.visit[likely]], column] = odds[likely]
            return _Seen(some, chance)

        when = (item.tobytes() for item in (open_, looks.day, looks.roll_deg))
        return sky.stored_chances.get((self._rules[option.band], option, content, epoch_mjd, *when), made)

    def _faintest(self, star: Targets, option: Setting) -> FloatArray:
        """Return the contrast below which a visit shows no planet, by ring."""
        return np.asarray(faintest_of(self._model, star, [option], self._strategy.detection)[0])


def _content(part: Host) -> str:
    """Return what decides the planets of a part of a star, in words."""
    return repr(part.content())


def _known_as(samples: Sequence[PlanetSample], host: Host) -> list[PlanetSample]:
    """Return the planets of a star's parts, known ones with their rows in its table, and of the last kind."""
    kind = 0 if host.population is None else len(host.population.mixture)
    rows = [part.known_rows for part in host.parts()]
    return [
        replace(item, known=np.full(len(item), row[0]), kind=np.full(len(item), kind)) if row else item
        for item, row in zip(samples, rows, strict=True)
    ]


@functools.lru_cache(maxsize=1)
def planning_sky(seed: int, reach_arcsec: tuple[float, float]) -> PlanningSky:
    """Return the sky that this process plans with; parameters as of `PlanningSky`."""
    return PlanningSky(seed, reach_arcsec)
