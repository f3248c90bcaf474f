"""What the numbers of survey what-ifs rest on: each study returns plain data that the report prints."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import brute_force
import numpy as np

from cpic_planner.jobs.job import run_tasks
from cpic_planner.planets import Planets
from cpic_planner.ranking.completeness import completeness
from cpic_planner.survey import StrategiesConfig, load_strategies
from cpic_planner.survey.detection import detection_chance, expected_signals
from cpic_planner.survey.outcome import difference_interval
from cpic_planner.survey.prepare import prepare
from cpic_planner.survey.simulate import Survey, simulate_survey
from cpic_planner.survey.strategy import DetectionRule
from cpic_planner.survey.universe import NEW, albedos_of, draw_planet_sample, star_mass_msun

WORKERS = 1
REPEATS, PER_REPEAT = 1000, 100
BRUTE = 1_000_000
COMPARED = ("single_visit", "wide_and_shallow", "few_and_deep")
STARS = ("alf Cen A", "eps Eri", "tau Cet")


def changed(config: StrategiesConfig, **universe: Any) -> StrategiesConfig:
    """The same strategies over another calendar, catalogue or number of universes."""
    return config.model_copy(update={"universe": config.universe.model_copy(update=universe)})


def played_block(surveys: tuple[Survey, ...], block: int) -> list[dict[str, Any]]:
    """Universes of one block of every survey."""
    return [
        {
            name: values.tolist()
            for name, values in simulate_survey(survey, block=block, n=PER_REPEAT, seed=1).universes.items()
        }
        for survey in surveys
    ]


def coverage() -> dict[str, Any]:
    """How often the interval of a paired difference of a hundred universes holds the mean of all of them."""
    surveys = tuple(survey for survey in prepare(load_strategies()).surveys if survey.strategy.name in COMPARED)
    names = [survey.strategy.name for survey in surveys]
    every: list[list[dict[str, Any]]] = [[] for _ in range(REPEATS)]
    for block, found in run_tasks(
        played_block, [(block,) for block in range(REPEATS)], common=(surveys,), workers=WORKERS
    ):
        every[block] = found
    rows = []
    for quantity in ("new_planets", "planets"):
        yields = np.array([[_quantity(block[k], quantity) for block in every] for k in range(len(surveys))])
        for first in range(len(names)):
            for second in range(first + 1, len(names)):
                differences = yields[second] - yields[first]
                truth = float(differences.mean())
                intervals = [difference_interval(values) for values in differences]
                inside = sum(item.low <= truth <= item.high for item in intervals)
                rows.append(
                    {
                        "quantity": quantity,
                        "first": names[second],
                        "second": names[first],
                        "truth": truth,
                        "covered": inside / REPEATS,
                        "correlation": float(np.corrcoef(yields[first].ravel(), yields[second].ravel())[0, 1]),
                    }
                )
    return {"repeats": REPEATS, "universes": PER_REPEAT, "rows": rows}


def _quantity(block: dict[str, Any], name: str) -> list[float]:
    if name == "planets":
        return [a + b for a, b in zip(block["new_planets"], block["known_planets"], strict=True)]
    return [float(value) for value in block[name]]


def one_star(name: str, *, visits: int = 1, **strategy: Any) -> Survey:
    """A survey of one star, no planets known or excluded, in which a visit detects what its significance says."""
    tree = {
        "name": name,
        "targets": {"names": [name]},
        "visit": {"bands": ["F520"]},
        "detection": {"rule": "expected"},
        "revisits": {"max_visits": visits, "roll": "north"},
        "stop": {"after_detection": False},
    } | strategy
    config = changed(load_strategies({"strategies": [tree]}), known_planets="off", exclusions=())
    return prepare(config).surveys[0]


def one_visit() -> list[dict[str, Any]]:
    """Detections to be expected of one visit of one star, by the survey and by the ranking, of the same planets."""
    rows = []
    for name in STARS:
        survey = one_star(name)
        visit = survey.schedule.visits[0]
        option = survey.options[0][visit.option]
        population = survey.strategy.population
        assert population is not None
        bodies = draw_planet_sample(
            name,
            float(star_mass_msun(survey.targets)[0]),
            float(survey.targets.luminosity_lsun[0]),
            population,
            epoch_mjd=survey.calendar.start_mjd,
            n=20_000,
            seed=1,
            block=0,
        )
        places = bodies.places([survey.calendar.day[0, visit.slot]])
        planets = Planets(
            population=population.name,
            kind=bodies.kind,
            radius_rjup=bodies.radius_rjup,
            mass_mjup=bodies.mass_mjup,
            semi_major_axis_au=bodies.semi_major_axis_au,
            eccentricity=bodies.eccentricity,
            inclination_deg=bodies.inclination_deg,
            argument_of_pericentre_deg=bodies.argument_of_pericentre_deg,
            node_deg=bodies.node_deg,
            mean_anomaly_deg=bodies.mean_anomaly_deg,
            east_au=places.east_au[0],
            north_au=places.north_au[0],
            distance_au=places.distance_au[0],
            phase_deg=places.phase_deg[0],
            kind_names=(population.name,),
            albedos=albedos_of(population)[:1],
            semi_major_axis_scale="none",
            planets_per_star=population.planets_per_star,
        )
        found = completeness(
            survey.model,
            survey.targets,
            option.band,
            planets,
            exposure_s=option.exposure_s,
            n_frames=option.n_frames,
            em_gain=option.em_gain,
        )
        seen = expected_signals(
            survey.model, survey.targets, option, bodies, albedos_of(population), places, np.zeros(1)
        )
        rule = DetectionRule()
        chance = detection_chance(seen, rule, bodies.known != NEW, calibration=rule.calibration)
        rows.append(
            {
                "star": name,
                "planets": len(bodies),
                "detected_by_ranking": float(found.completeness[0]) * len(bodies),
                "detected_in_survey": float(chance.sum()),
            }
        )
    return rows


def completeness_check() -> list[dict[str, Any]]:
    """Completeness of stars after one and four visits against brute force that shares no code with the survey."""
    rows = []
    for name in STARS:
        survey = one_star(name, visits=4)
        days = sorted({float(survey.calendar.day[0, visit.slot]) for visit in survey.schedule.visits})
        option = survey.options[0][0]
        population = survey.strategy.population
        assert population is not None
        mass, luminosity = float(star_mass_msun(survey.targets)[0]), float(survey.targets.luminosity_lsun[0])
        found = [0, 0]
        for block in range(10):
            bodies = draw_planet_sample(
                name,
                mass,
                luminosity,
                population,
                epoch_mjd=survey.calendar.start_mjd,
                n=BRUTE // 10,
                seed=1,
                block=block,
                one_each=True,
            )
            seen = expected_signals(
                survey.model,
                survey.targets,
                option,
                bodies,
                albedos_of(population),
                bodies.places(days),
                np.zeros(len(days)),
            )
            hit = detection_chance(seen, survey.strategy.detection, bodies.known != NEW) > 0.5
            found[0] += int(hit[0].sum())
            found[1] += int(hit.any(axis=0).sum())
        other = brute_force.detected(survey.model, survey.targets, option, mass, days, BRUTE, seed=7)
        for label, ours, theirs in zip(("one visit", f"{len(days)} visits"), found, other, strict=True):
            rows.append(
                {
                    "star": name,
                    "visits": label,
                    "survey": ours / BRUTE,
                    "brute_force": theirs / BRUTE,
                    "error": float(np.sqrt(ours + theirs)) / max(theirs, 1),
                }
            )
    return rows


def geometry(separations_arcsec: Sequence[float] = (0.30, 0.40, 0.50, 0.65, 0.80, 0.90)) -> list[dict[str, Any]]:
    """Share of planets on a circle that stand where a visit without noise shows them, against the closed form."""
    rows = []
    survey = one_star("alf Cen A")
    option = survey.options[0][0]
    metrics = survey.model.metrics[option.band]
    n = 200_000
    for rho in separations_arcsec:
        bodies = brute_force.circle(rho * float(survey.targets.distance_pc[0]), n)
        seen = expected_signals(
            survey.model,
            survey.targets,
            option,
            bodies,
            albedos_of(survey.strategy.population),
            bodies.places([0.0]),
            [0.0],
        )
        zone, radius = metrics.zone, metrics.aperture_radius_arcsec
        closed = brute_force.azimuth_share(rho, zone.inner_arcsec + radius, zone.outer_arcsec - radius)
        rows.append(
            {
                "separation_arcsec": rho,
                "survey": float(np.mean(seen.margin > 0.0)),
                "closed_form": closed,
                "whole_zone": brute_force.azimuth_share(rho, zone.inner_arcsec, zone.outer_arcsec),
            }
        )
    return rows
