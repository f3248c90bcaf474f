"""The settings of survey strategies as people read them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from cpic_planner.models.surveyed import AssumedInstrument, WhatIfResult
from cpic_planner.registry.libraries import LIBRARIES
from cpic_planner.report.numbers import contrast_text, count_text, duration_text, percent_text, significant
from cpic_planner.written_values import with_unit
from simulator.config.base import unit_of

_FACTORS = ("assumptions.drift", "assumptions.throughput")
_UNITS = {"assumptions.exozodi": "zodi"}
"""Units of keys that do not end in them."""
_GOALS = {
    "time": "as long as it pays, at most",
    "detect": "until the reference planet is detected, at most",
    "snr": "until the reference planet has the SNR asked for, at most",
}
_RULES = {
    "blind": "a search that does not know where planets are",
    "known_place": "significance at the planet's place, taken as known",
    "expected": "predicted significance reaches the threshold; no chance in it",
}
_HOSTS = {"any": "", "first": "stars with known planets come first", "only": "only stars with known planets"}
_METHODS = {"greedy": "best gain per hour first, with look-ahead", "milp": "mixed-integer programme"}


def universe_facts(result: WhatIfResult) -> list[tuple[str, str]]:
    """Return what all strategies share, as terms and texts."""
    shared = result.universe
    days = float(shared["duration_days"])
    facts = [
        (
            "Time",
            f"{count_text(round(days))} days ({significant(days / 365.25, 2)} years) from "
            f"{str(shared['start_utc'])[:10]}, planned in slots of {shared['slot_days']:g} days",
        ),
        ("Instrument", f"{shared['instrument']}. Every default value has its source and confidence in the preset."),
        (
            "Orbit and pointing limits",
            f"{shared['visibility']}: Sun, Moon, Earth limb, solar panels, South Atlantic Anomaly, in low Earth orbit",
        ),
        ("Stars", result.catalogue),
        ("Known planets", result.known_planets or "left out"),
        ("Background stars", "not drawn" if shared["background"] == "off" else "drawn, as false alarms"),
    ]
    if result.observed:
        facts.append(("Already observed", result.observed))
    facts.append(("Universes", f"{count_text(result.n_universes)}, seed {shared['seed']}"))
    return facts


def shared_facts(settings: Mapping[str, Any], used: AssumedInstrument | None = None) -> list[tuple[str, str]]:
    """Return the rules and assumptions of a strategy, with numbers of the instrument if given, as terms and texts."""
    return [
        ("Population of unknown planets", _population(settings["population"])),
        ("Targets", _targets(settings["targets"])),
        ("Visit", _visit(settings["visit"])),
        ("Revisits", _revisits(settings["revisits"])),
        ("Follow-up", _follow_up(settings["follow_up"])),
        ("Reference frames", LIBRARIES[settings["reduction"]["library"]].meaning),
        ("Detection", _detection(settings["detection"])),
        ("Changes to the instrument", _assumed(settings["assumptions"], used)),
        ("Stop rules", _stops(settings["stop"])),
        ("Calendar", _calendar(settings)),
    ]


def _population(population: Mapping[str, Any] | None) -> str:
    if population is None:
        return "none: only known planets are looked for"
    often = population.get("planets_per_star")
    told = [str(population.get("description") or "")] + ([f"{often:g} planets per star"] if often is not None else [])
    return f"{population.get('name') or 'own'}: {', '.join(filter(None, told))}"


def _targets(cuts: Mapping[str, Any]) -> str:
    parts = [f"at most {cuts['max_targets']}"]
    if cuts["v_mag_max"] is not None:
        parts.append(f"V up to {cuts['v_mag_max']:g} mag")
    if cuts["distance_max_pc"] is not None:
        parts.append(f"within {cuts['distance_max_pc']:g} pc")
    parts += [
        word for key, word in (("dwarfs_only", "dwarfs only"), ("singles_only", "no close companions")) if cuts[key]
    ]
    parts += [f"{len(cuts['names'])} named stars"] if cuts["names"] else []
    parts += [f"{len(cuts['exclude'])} stars left out by name"] if cuts["exclude"] else []
    return ", ".join([*parts, *filter(None, [_HOSTS[cuts["known_planets"]]])])


def _visit(visit: Mapping[str, Any]) -> str:
    times = " or ".join(duration_text(value) for value in visit["time_s"])
    bands = visit["bands"]
    chosen = bands[0] if len(bands) == 1 else f"the best of {', '.join(bands)}"
    fixed = [f"frames of {visit['exposure_s']:g} s"] if visit["exposure_s"] is not None else []
    fixed += [f"EM gain {visit['em_gain']:g}"] if visit["em_gain"] is not None else []
    return "; ".join([f"{chosen}, {_GOALS[visit['goal']]} {times} of wall time", *fixed])


def _revisits(rule: Mapping[str, Any]) -> str:
    if rule["max_visits"] == 1:
        return "none"
    return f"up to {rule['max_visits']} visits of a star, at least {rule['min_gap_days']:g} days apart"


def _follow_up(rule: Mapping[str, Any]) -> str:
    if not rule["bands"]:
        return "none"
    return (
        f"of planets found, in {', '.join(rule['bands'])}: {duration_text(rule['time_s'])} each, up to "
        f"{rule['attempts']} attempts"
    )


def _detection(rule: Mapping[str, Any]) -> str:
    text = f"{_RULES[rule['rule']]}; {rule['sigma']:g}σ per resolution element"
    if rule["visits_needed"] > 1:
        text += f", in {rule['visits_needed']} visits"
    if rule["rule"] == "expected":
        return text
    law = {
        which: f"{rule[f'{which}_margin']:.2f} (± {rule[f'{which}_margin_error']:.1%})" for which in ("blind", "known")
    }
    tails = rule["blind_margin"] * math.exp(rule["blind_tails"])
    half = (
        f"{law['blind']} in Gaussian noise ten resolution elements from the star, {tails:.2f} where all noise is light "
        f"of the wavefront's errors, more further in; known planets at their place where it is {law['known']}"
    )
    return (
        f"{text}. Measured on images: half of the planets are found where predicted significance over threshold is "
        f"{half if rule['rule'] == 'blind' else law['known']}; recovered over predicted SNR is "
        f"{rule['calibration']:g} ± {rule['calibration_error']:g}. These errors are drawn anew in each universe"
    )


def _assumed(assumed: Mapping[str, Any], used: AssumedInstrument | None) -> str:
    parts = []
    if assumed["contrast"] is not None:
        parts.append(f"median raw contrast of the dark hole {contrast_text(assumed['contrast'], 2)}")
    if assumed["drift"] != 1.0:
        parts.append(f"wavefront drift × {assumed['drift']:g}")
        if used is not None:
            parts[-1] += f" ({used.visit_drift_nm:g} nm visit offset, {used.walk_nm_per_sqrt_hour:g} nm/√h walk)"
    if assumed["throughput"] != 1.0:
        told = "" if used is None else ", ".join(f"{value:g} in {band}" for band, value in used.throughput.items())
        parts.append(f"throughput of the optics × {assumed['throughput']:g}{f' ({told})' if told else ''}")
    if assumed["exozodi"] is not None:
        parts.append(f"dust of {assumed['exozodi']:g} solar systems (zodi)")
    return ", ".join(parts) or "none"


def _stops(rule: Mapping[str, Any]) -> str:
    parts = ["a star is left once it has shown a planet"] if rule["after_detection"] else []
    if rule["after_empty"] is not None:
        parts.append(f"or after {rule['after_empty']} empty visits")
    if rule["after_planets"] is not None:
        parts.append(f"the survey ends with {rule['after_planets']} planets")
    return ", ".join(parts) or "none"


def _calendar(settings: Mapping[str, Any]) -> str:
    rule = settings["scheduler"]
    method = _METHODS.get(rule["method"], rule["method"])
    return (
        f"{method}; at most {percent_text(settings['slot_share'])} of any slot; no visit worth less than "
        f"{rule['min_gain']:g} planets"
    )


def changed_settings(settings: Mapping[str, Any], reference: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    """Return key, value and value of the reference of every setting that differs, name and description aside."""
    own, other = dict(_leaves(settings)), dict(_leaves(reference))
    keys = [key for key in {**own, **other} if key not in ("name", "description")]
    return [
        (key, setting_text(own.get(key), key), setting_text(other.get(key), key))
        for key in keys
        if own.get(key) != other.get(key)
    ]


def _leaves(tree: Mapping[str, Any], above: str = "") -> list[tuple[str, Any]]:
    found: list[tuple[str, Any]] = []
    for key, value in tree.items():
        inside = isinstance(value, Mapping) and value
        found += _leaves(value, f"{above}{key}.") if inside else [(f"{above}{key}", value)]
    return found


def setting_text(value: Any, key: str = "") -> str:
    """Return a value of a setting as people read it: with the unit of its key, factors with their x."""
    if value is None or value in ([], {}, ""):
        return "none"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list):
        return ", ".join(setting_text(item, key) for item in value)
    if not isinstance(value, int | float):
        return str(value)
    text = f"{value:g}" if isinstance(value, float) else str(value)
    return f"x{text}" if key in _FACTORS else with_unit(text, _UNITS.get(key, unit_of(key)))
