"""Comparisons of survey strategies, with a star of a hostile name and one that looks like mathematics."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from cpic_planner.results import (
    CurvePoint,
    DifferenceRecord,
    EstimateRecord,
    RankChange,
    ScheduleRecord,
    StrategyOutcome,
    SurveyTarget,
    TimeUse,
    VariedSetting,
    WhatIfResult,
)
from cpic_planner.survey import load_strategies


def _estimate(mean: float) -> EstimateRecord:
    return EstimateRecord(
        mean=mean, error=0.03, low=0.9 * mean, high=1.1 * mean + 0.01, survey_low=0.0, survey_high=2.0 * mean
    )


def _varied(name: str) -> list[VariedSetting]:
    """What a name says was varied: ``deep drift=x2 (0.1 nm) rule=blind``."""
    found = []
    for part in re.split(r" (?=[\w.]+=)", name)[1:]:
        key, _, text = part.partition("=")
        number = re.search(r"(\d[\d.e+-]*)(?: (nm|zodi|h|s)\b)?\)?$", text)
        found.append(
            VariedSetting(
                name=key,
                key=key,
                text=text,
                value=float(number[1]) if number else text,
                unit=(number and number[2]) or "",
                meaning="",
            )
        )
    return found


def _target(rank: int, name: str, ra_deg: float, slots: list[int], planets: float, hosts: list[str]) -> SurveyTarget:
    return SurveyTarget(
        name=name,
        rank=rank,
        v_mag=3.7 + 0.1 * rank,
        distance_pc=3.2,
        ra_deg=ra_deg,
        dec_deg=-9.5,
        known_planets=hosts,
        bands=["F520", "F662"],
        visit_time_s=7200.0,
        visit_h=6.25,
        planned_visits=len(slots),
        slots=slots,
        first_utc="2028-03-01" if slots else "",
        visits=0.9 * len(slots),
        search_h=5.6 * len(slots),
        follow_up_h=1.5,
        alarm_h=0.25,
        new_planets=planets,
        new_planets_unconditional=2.0 * planets,
        known_seen=0.5 * len(hosts),
        orbits_known=0.1 * planets,
        planets_per_100h=10.0 * planets,
    )


def _strategy(i: int, name: str, settings: dict[str, Any], n: int, empty: bool, hostile: str) -> StrategyOutcome:
    mean = 0.0 if empty else 0.512 + 0.3 * i
    budget, hours = settings["time_budget_h"], 0.0 if empty else 100.0 + 50.0 * min(i, 10)
    stars = [("* eps Eri", 53.2, ["eps Eri b"]), (hostile, 26.0, []), ("5 $ star $", 330.0, [])]
    points = [CurvePoint(x=x, mean=mean * min(x / 100.0, 1.0), low=0.0, high=mean) for x in (0.0, 50.0, 100.0, budget)]
    return StrategyOutcome(
        name=name,
        description=f"Way {i} of {hostile}",
        varied=_varied(name),
        settings=settings | {"name": name},
        schedule=ScheduleRecord(
            method="greedy", visits=3 + i, reserve_visits=i, hours=hours, value=0.9, bound=1.0, distance=0.1
        ),
        planets=_estimate(mean),
        new_planets=_estimate(0.3 * mean),
        new_planets_unconditional=_estimate(0.6 * mean),
        known_planets=_estimate(0.7 * mean),
        stars_with_planet=_estimate(mean),
        characterised_planets=_estimate(0.0),
        orbits_known=_estimate(0.1 * mean),
        confirmed_planets=_estimate(0.0),
        noise_alarms=_estimate(0.004),
        background_alarms=_estimate(0.0),
        hours=_estimate(hours),
        any_planet=0.4 if mean else 0.0,
        any_new_planet=0.2 if mean else 0.0,
        time_use=TimeUse(
            exposing_h=0.5 * hours,
            occulted_h=0.3 * hours,
            settling_h=0.2 * hours,
            follow_up_h=0.0,
            alarm_h=0.0,
            unused_h=budget - hours,
            budget_h=budget,
            budget_share=budget / (24.0 * 360.0),
        ),
        curve=points,
        convergence=[CurvePoint(x=float(k), mean=mean, low=0.8 * mean, high=1.2 * mean) for k in (10, 50, n)],
        quantiles={}
        if empty
        else {
            key: [scale * q for q in (1.0, 2.0, 3.0, 4.0, 9.0)]
            for key, scale in (
                ("snr", 3.0),
                ("contrast", 2e-9),
                ("separation_arcsec", 0.1),
                ("margin", 0.8),
                ("day", 300.0),
            )
        },
        targets=[]
        if empty
        else [
            _target(k + 1, star, ra, list(range(k, 12, 4 + i)), 0.1 / (k + 1), hosts)
            for k, (star, ra, hosts) in enumerate(stars)
        ],
    )


def comparer(hostile: str) -> Callable[..., WhatIfResult]:
    """Comparisons of strategies with the given names; ``empty`` ones find and visit nothing."""
    bands = {"bands": ["F520", "F662", "F720", "F850"]}
    config = load_strategies(
        {
            "universe": {"seed": 1, "start_utc": "2028-01-01"},
            "strategies": [
                {"name": "a", "time_budget_h": 1752, "visit": bands | {"time_s": 36000}, "revisits": {"max_visits": 1}},
                {"name": "b", "time_budget_h": 1752, "visit": {"bands": ["F520"]}, "revisits": {"max_visits": 4}},
            ],
        }
    )
    trees = [item.model_dump(mode="json") for item in config.strategies]

    def make(names: Sequence[str] = ("single", "deep & long", "wide"), *, empty: bool = False) -> WhatIfResult:
        strategies = [_strategy(i, name, trees[i % len(trees)], 200, empty, hostile) for i, name in enumerate(names)]
        changes = [
            RankChange(strategy=name, star=hostile, first_rank=2, rank=None if i else 1, why="2 visits, not 1")
            for i, name in enumerate(names[1:])
        ]
        return WhatIfResult(
            version="0.1.0",
            config_hash="0123456789abcdef",
            name="a survey",
            description="What if",
            universe=config.universe.model_dump(mode="json") | {"duration_days": 360.0, "slot_days": 30.0},
            catalogue="SIMBAD extract of 2012-12-06 (stars.csv 0123456789ab)",
            known_planets="NASA Exoplanet Archive of 2019-05-31, 176 planets (known_planets.csv 0123456789ab)",
            observed="",
            n_universes=200,
            slot_utc=[str(np.datetime64("2028-01-01") + 30 * k) for k in range(12)],
            strategies=strategies,
            differences=[
                _difference(one, strategies[0], key)
                for one in strategies[1:]
                for key in ("planets", "new_planets", "characterised_planets", "orbits_known", "hours")
            ],
            rank_changes=[] if empty else changes,
            statement=f"{names[-1]} finds most planets",
            not_modelled=["weather of space"],
        )

    return make


def _difference(one: StrategyOutcome, other: StrategyOutcome, quantity: Any) -> DifferenceRecord:
    mean = getattr(one, quantity).mean - getattr(other, quantity).mean
    return DifferenceRecord(
        first=one.name,
        second=other.name,
        quantity=quantity,
        mean=mean,
        error=0.05,
        low=mean - 0.11,
        high=mean + 0.12,
        correlation=0.62,
        verdict="more",
    )
