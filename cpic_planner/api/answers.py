"""Questions to the exposure-time calculator, the optimiser and the ranking, by star names and plain numbers."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from catalogs.errors import InputError
from cpic_planner.api.inputs import InstrumentSource, OnOff, StrategySource, model_of, planet_of, stars_named
from cpic_planner.etc import questions
from cpic_planner.etc.answer import EtcAnswer
from cpic_planner.etc.cases import planets_of
from cpic_planner.etc.fidelity import etc_dial
from cpic_planner.etc.model import EtcModel
from cpic_planner.etc.planet import ReferencePlanet
from cpic_planner.models import Explanation, RankResult, ScoreName, SensitivityResult
from cpic_planner.population_config import PopulationSource
from cpic_planner.targets import Targets, as_catalogue, find_target, rank_sample, sample_text
from simulator.numeric import numeric_context

if TYPE_CHECKING:
    import pandas as pd

__all__ = [
    "contrast_limit",
    "explain_rank",
    "exposure_time",
    "optimise",
    "rank_sensitivity",
    "rank_targets",
    "signal_to_noise",
]


def _ask(
    question: Callable[..., list[EtcAnswer]],
    target: str | Sequence[str],
    bands: Sequence[str] | None,
    companions: OnOff,
    catalog: str | Path,
    instrument: InstrumentSource,
    strategy: StrategySource,
    images: Mapping[str, Any],
    **asked: Any,
) -> list[EtcAnswer]:
    """Put one question for all named stars at once; ``images`` are the arguments of their check."""
    settings = dict(images)
    given = {name: settings.pop(name) for name in ("fidelity", "tolerance")}
    if given == {"fidelity": None, "tolerance": None}:
        for name, value in settings.items():
            if value is not None:
                raise InputError(name, value, allowed="with a fidelity or a tolerance")
        dial = None
    else:
        dial = etc_dial(**given)
    model = model_of(instrument, bands, strategy)
    if asked.get("planet") is not None:
        asked["planet"] = _planets(asked["planet"])
    stars = stars_named(target, companions, catalog)
    answers = question(model, Targets.joined(stars), **asked) if stars else []
    if dial is None or not answers:
        return answers
    from cpic_planner.etc_check import checked_answers

    each = len(answers) // len(stars)
    around = [star for star in stars for _ in range(each)]
    planets = planets_of(asked["separation_arcsec"], asked.get("planet"), asked.get("contrast"))
    grey = question is questions.contrast_limit or planets.contrast is not None
    bodies = [None if grey else planets.models[index % len(planets)] for index in range(len(answers))]
    known = {name: value for name, value in settings.items() if value is not None}
    return checked_answers(model, around, answers, bodies, dial, **known)


def _planets(given: Any) -> ReferencePlanet | list[ReferencePlanet]:
    """Planets from what people write: one or several, objects or mappings."""
    if isinstance(given, Sequence) and not isinstance(given, str):
        return [planet_of(body) for body in given]
    return planet_of(given)


@numeric_context()
def signal_to_noise(
    target: str | Sequence[str],
    *,
    time_s: float,
    separation_arcsec: float | Sequence[float],
    bands: Sequence[str] | None = None,
    companions: OnOff = "on",
    catalog: str | Path = "snapshot",
    instrument: InstrumentSource = None,
    strategy: StrategySource = None,
    fidelity: str | None = None,
    tolerance: float | None = None,
    realisations: int | None = None,
    seed: int | None = None,
    **planet_and_frame: Any,
) -> list[EtcAnswer]:
    """SNR of a planet in a given wall time.

    Parameters
    ----------
    target : str or sequence of str
        Star name(s).
    time_s : float
        Wall time of one visit, overheads and reference frames included.
    separation_arcsec : float or sequence of float
        Projected separation, on the diagonal of a quadrant.
    bands : sequence of str, optional
        All visible bands by default.
    companions : {"on", "off"}
        Whether the light of known stellar companions counts.
    catalog : str or Path
        Star table: ``"snapshot"``, ``"latest"`` (see ``cpic catalog refresh``), ``"simbad_2012"`` (the snapshot
        with companions where they were first listed) or a CSV, ECSV, VOTable or FITS file.
    instrument : Instrument, mapping, str or Path, optional
        What `simulator.load_instrument` reads.
    strategy : Strategy or mapping, optional
        How the observation is made and reduced: reference library, its size, analogue or photon counting ... (see
        `cpic_planner.etc.model.Strategy`).
    fidelity, tolerance : optional
        How firm the answers have to be: ``quick`` closed forms alone (the default), ``standard`` each checked in sums
        of simulated frames, ``reference`` frame by frame; or the largest error of planet flux and SNR, 0 to 0.5, for
        which images are made only where the stated error of the closed forms is larger. ``answer.fidelity`` then holds
        errors and checks; values stay those of the closed forms.
    realisations, seed : int, optional
        Of those images; see `cpic_planner.etc_check.checked_answers`.
    **planet_and_frame
        ``planet`` (a `ReferencePlanet`) or ``contrast``; ``exposure_s`` and ``em_gain`` to fix them. As
        `cpic_planner.etc.questions.signal_to_noise`.

    Returns
    -------
    list of EtcAnswer
        Targets in the given order, bands in theirs within each (by wavelength if none are given), then planets.

    Raises
    ------
    InputError
        For an unknown star, band or a value out of range.

    Examples
    --------
    >>> from cpic_planner import signal_to_noise
    >>> answer = signal_to_noise("tau Cet", time_s=36000, separation_arcsec=0.5, bands=["F520"])[0]
    >>> answer.status.value
    'ok'
    """
    asked = {"time_s": time_s, "separation_arcsec": separation_arcsec} | planet_and_frame
    images = {"fidelity": fidelity, "tolerance": tolerance, "realisations": realisations, "seed": seed}
    return _ask(questions.signal_to_noise, target, bands, companions, catalog, instrument, strategy, images, **asked)


@numeric_context()
def exposure_time(
    target: str | Sequence[str],
    *,
    snr: float | None = None,
    separation_arcsec: float | Sequence[float],
    bands: Sequence[str] | None = None,
    companions: OnOff = "on",
    catalog: str | Path = "snapshot",
    instrument: InstrumentSource = None,
    strategy: StrategySource = None,
    fidelity: str | None = None,
    tolerance: float | None = None,
    realisations: int | None = None,
    seed: int | None = None,
    **planet_and_frame: Any,
) -> list[EtcAnswer]:
    """Least wall time of one visit that reaches an SNR; parameters, returns and errors as `signal_to_noise`.

    Instead of ``snr`` a plain significance (``sigma``) or a detection (``detect=True``) can be asked for.
    """
    asked = {"snr": snr, "separation_arcsec": separation_arcsec} | planet_and_frame
    images = {"fidelity": fidelity, "tolerance": tolerance, "realisations": realisations, "seed": seed}
    return _ask(questions.exposure_time, target, bands, companions, catalog, instrument, strategy, images, **asked)


@numeric_context()
def contrast_limit(
    target: str | Sequence[str],
    *,
    time_s: float,
    separation_arcsec: float | Sequence[float],
    bands: Sequence[str] | None = None,
    sigma: float | None = None,
    companions: OnOff = "on",
    catalog: str | Path = "snapshot",
    instrument: InstrumentSource = None,
    strategy: StrategySource = None,
    fidelity: str | None = None,
    tolerance: float | None = None,
    realisations: int | None = None,
    seed: int | None = None,
    **frame: Any,
) -> list[EtcAnswer]:
    """Faintest contrast detected in a given wall time; parameters, returns and errors as `signal_to_noise`.

    ``sigma`` asks for a plain significance instead of the small-sample threshold, ``snr`` for a photometric SNR.
    """
    asked = {"time_s": time_s, "separation_arcsec": separation_arcsec, "sigma": sigma} | frame
    images = {"fidelity": fidelity, "tolerance": tolerance, "realisations": realisations, "seed": seed}
    return _ask(questions.contrast_limit, target, bands, companions, catalog, instrument, strategy, images, **asked)


@numeric_context()
def optimise(
    target: str | Sequence[str],
    *,
    time_s: float | None = None,
    snr: float | None = None,
    detect: bool = False,
    separation_arcsec: float | None = None,
    bands: Sequence[str] | None = None,
    planet: ReferencePlanet | Mapping[str, Any] | None = None,
    companions: OnOff = "on",
    catalog: str | Path = "snapshot",
    instrument: InstrumentSource = None,
    strategy: StrategySource = None,
) -> pd.DataFrame:
    """Best band, separation, exposure, number of frames and EM gain per target.

    Parameters
    ----------
    target : str or sequence of str
    time_s : float, optional
        Wall time: the clearest detection within it; 36000 if no goal is given.
    snr : float, optional
        Photometric SNR to reach in the least time.
    detect : bool
        A detection to reach in the least time.
    separation_arcsec : float, optional
        Projected separation of the planet, instead of the best one.
    bands, planet, companions, catalog, instrument, strategy
        As `signal_to_noise`.

    Returns
    -------
    pandas.DataFrame
        One row per target; columns of `cpic_planner.optimiser.Best`, units in their names, and ``verdict`` of the
        planet at its known place (``detected``, ``measured_not_detected``, ``unreachable``); with ``time_s`` also
        ``limited_by`` (`cpic_planner.etc.budget`).

    Raises
    ------
    InputError
        For an unknown star or band, a value out of range, or more than one goal.
    """
    import pandas as pd

    from cpic_planner.etc.detection import verdict_of
    from cpic_planner.optimiser import optimise as best_of
    from cpic_planner.ranking import judge, limits_of
    from simulator.outcome import Status

    if time_s is None and snr is None and not detect:
        time_s = 36000.0
    model = model_of(instrument, bands, strategy)
    stars = Targets.joined(stars_named(target, companions, catalog))
    best = best_of(
        model,
        stars,
        time_s=time_s,
        snr=snr,
        detect=detect,
        separation_arcsec=separation_arcsec,
        planet=None if planet is None else planet_of(planet),
    )
    standings, detected = judge(best, model), best.margin >= best.needed_margin
    statuses = [Status.OK if n >= 1 else status for (status, _), n in zip(standings, best.n_frames, strict=True)]
    said: dict[str, Any] = {"verdict": [verdict_of(*pair) for pair in zip(statuses, detected.tolist(), strict=True)]}
    if time_s is not None:
        said["limited_by"] = limits_of(standings, best)
    columns = {item.name: getattr(best, item.name) for item in fields(best) if not item.name.startswith("without_")}
    return pd.DataFrame({"name": stars.name} | columns | said)


@numeric_context()
def rank_targets(
    *,
    time_s: float = 36000.0,
    bands: Sequence[str] | None = None,
    planet: ReferencePlanet | Mapping[str, Any] | None = None,
    population: PopulationSource = None,
    n_planets: int | None = None,
    seed: int = 1,
    score: ScoreName | None = None,
    companions: OnOff = "on",
    catalog: str | Path = "snapshot",
    instrument: InstrumentSource = None,
    strategy: StrategySource = None,
    v_mag_max: float | None = None,
    dwarfs_only: bool = False,
    singles_only: bool = False,
) -> RankResult:
    """Analytic ranking of the catalogue; see `cpic_planner.ranking.rank_targets` and `cpic_planner.load_targets`.

    ``population`` (a preset name, YAML file or mapping), ``n_planets`` and ``seed`` say what completeness refers to,
    ``score`` what the ranking is by.
    """
    from cpic_planner.ranking import rank_targets as rank

    table = as_catalogue(catalog)
    targets = rank_sample(
        catalog=table, v_mag_max=v_mag_max, dwarfs_only=dwarfs_only, singles_only=singles_only, companions=companions
    )
    return rank(
        model_of(instrument, bands, strategy),
        targets,
        time_s=time_s,
        planet=None if planet is None else planet_of(planet),
        sample=sample_text(table, v_mag_max, dwarfs_only, singles_only),
        catalogue=table.provenance,
        **_ranked_by(population, n_planets, seed, score),
    )


@numeric_context()
def rank_sensitivity(**settings: Any) -> SensitivityResult:
    """How the ranking changes under other assumptions; arguments as `rank_targets`, see `cpic_planner.sensitivity`."""
    from cpic_planner.sensitivity import sensitivity

    given = _given(settings)
    return sensitivity(_model(given), _sample(given), **_ranking(given))


@numeric_context()
def explain_rank(target: str, **settings: Any) -> Explanation:
    """Why one star stands where it stands in the ranking; arguments as `rank_targets`.

    Raises
    ------
    InputError
        For an unknown star, or one that the cuts leave out.
    """
    from cpic_planner.explain import explain_star

    given = _given(settings)
    name = str(find_target(target, catalog=given["catalog"])[0].name[0])
    return explain_star(_model(given), _sample(given), name, **_ranking(given))


def _given(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Arguments of `rank_targets` with its defaults; the catalogue is opened."""
    bound = inspect.signature(rank_targets).bind(**settings)
    bound.apply_defaults()
    return bound.arguments | {"catalog": as_catalogue(bound.arguments["catalog"])}


def _model(given: Mapping[str, Any]) -> EtcModel:
    return model_of(given["instrument"], given["bands"], given["strategy"])


def _sample(given: Mapping[str, Any]) -> Targets:
    cuts = ("catalog", "companions", "v_mag_max", "dwarfs_only", "singles_only")
    return rank_sample(**{name: given[name] for name in cuts})


def _ranking(given: Mapping[str, Any]) -> dict[str, Any]:
    by = _ranked_by(given["population"], given["n_planets"], given["seed"], given["score"])
    body = None if given["planet"] is None else planet_of(given["planet"])
    return {"time_s": given["time_s"], "planet": body} | by


def _ranked_by(
    population: PopulationSource, n_planets: int | None, seed: int, score: ScoreName | None
) -> dict[str, Any]:
    """Population and score of a ranking."""
    from cpic_planner.population import N_PLANETS, PopulationChoice
    from cpic_planner.population_config import load_population
    from cpic_planner.registry.scores import DEFAULT_SCORE

    chosen = PopulationChoice(load_population(population), N_PLANETS if n_planets is None else n_planets, seed)
    return {"population": chosen, "score": score or DEFAULT_SCORE}
