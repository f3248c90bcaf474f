"""Sentences of the report that are computed from its numbers.

What was modelled, for people: the dial in words, and one table of the effect ledger for each distinct content.
"""

import statistics
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from cpic_planner import results
from cpic_planner.registry import LIBRARIES
from cpic_planner.report.numbers import count_text, pretty_name, significant, unused_text
from cpic_planner.report.words import EXCLUSIONS, LIMITED_BY, SEARCHES, counted, orbits_text, overrides_text, sentence
from simulator.knobs import Quantity


def chosen(target: results.ConfirmedTarget) -> results.BandConfirmation | None:
    """Return the confirmation of the chosen band, if any."""
    return next((band for band in target.bands if band.band == target.chosen_band), None)


_MOST_NAMED = 5


def planet_text(result: results.PlanResult | results.RankResult) -> str:
    """Return the reference planet in words."""
    planet = result.reference_planet
    albedo = planet.albedo[:1].upper() + planet.albedo[1:]
    return f"{planet.radius_rjup:g} Jupiter radius, phase {planet.phase_deg:g}°, {albedo} albedo, {planet.position}"


def population_text(population: results.PopulationRecord) -> str:
    """Return the population in words."""
    often = "" if population.planets_per_star is None else f"{population.planets_per_star:g} planets per star"
    if often and population.planets_per_star_range is not None:
        low, high = population.planets_per_star_range
        often = f"{often}, {low:g} to {high:g} by different surveys"
    details = ", ".join(filter(None, (population.description, often)))
    name = f"{population.name} ({details})" if details else population.name
    meaning = "fraction of it that one observation detects"
    if population.name == results.KNOWN_PLANETS:
        meaning = "probability that at least one of the star's own planets is detected"
    elif population.exclusions:
        meaning = f"{meaning} and that {_joined(population.exclusions)} do not exclude"
    drawn = f"{count_text(population.n_planets)} drawn with seed {population.seed}"
    return f"{name}, {drawn}; completeness is the {meaning}"


def _joined(exclusions: Sequence[str]) -> str:
    *first, last = (EXCLUSIONS[name] for name in exclusions)
    return f"{', '.join(first)} and {last}" if first else last


def expected_sentence(rank: results.RankResult) -> str:
    """Return how many planets one observation of every star would find, with and without what is known; may be empty.

    The interval is that of the occurrence alone, by which surveys differ.
    """
    found = [row.expected_planets for row in rank.targets if row.expected_planets is not None]
    of_all = [row.expected_planets_unconditional for row in rank.targets]
    rate, between = rank.population.planets_per_star, rank.population.planets_per_star_range
    if not found or rate is None:
        return ""
    total = sum(found)
    interval = "" if between is None else " ({} to {})".format(*(significant(total * end / rate, 2) for end in between))
    words = f"One observation of each star would find {significant(total, 2)}{interval} planets"
    if not rank.population.exclusions or None in of_all:
        return f"{words}."
    without = significant(sum(filter(None, of_all)), 2)
    return f"{words} that nobody knows; {without} if nothing were known of the stars."


def unprobed_stars(rank: results.RankResult, first: int) -> list[results.RankedTarget]:
    """Return where among the first stars more radial velocities would change the ranking, most completeness first.

    Their reference planets are those that velocities do not exclude yet.
    """
    exclusions = rank.population.exclusions
    open_stars = [
        row
        for row in rank.targets[:first]
        if row.completeness > 0.0 and row.rv_amplitude_m_s is not None and "excluded_by_rv" not in row.flags
    ]
    return sorted(open_stars, key=lambda row: -row.completeness) if "rv" in exclusions else []


def velocities_sentence(rank: results.RankResult, first: int) -> str:
    """Return around which of the first stars velocities exclude the reference planet, and where more would help."""
    found = []
    excluded = [pretty_name(row.name) for row in rank.targets[:first] if "excluded_by_rv" in row.flags]
    if excluded:
        found.append(f"Radial velocities already exclude the reference planet around {', '.join(excluded)}.")
    stars = [
        f"{pretty_name(row.name)} {significant(row.rv_amplitude_m_s, 2)} m/s at "
        f"{significant(row.ref_planet_distance_au, 2)} au"
        for row in unprobed_stars(rank, first)[:_MOST_NAMED]
    ]
    if stars:
        found.append(
            "More radial velocities would change the ranking most where none exclude the reference planet yet; they "
            f"have to show amplitudes of: {', '.join(stars)}."
        )
    return " ".join(found)


def calibration_sentence(result: results.ImagedResult) -> str:
    """Return predicted over recovered SNR and what it says; a bias is named only beyond two standard errors."""
    return sentence(result.calibration_text)


def outcome_text(bands: Sequence[results.BandConfirmation]) -> str:
    """Return whether simulated images confirm planets: in how many bands, or that nothing was measured.

    Parameters
    ----------
    bands : sequence of BandConfirmation
        At least one: of one planet, or of several, each of whose bands counts.
    """
    if all(band.recovered_snr is None for band in bands):
        return "not measured in simulated images"
    found, tried = sum(bool(band.detected) for band in bands), len(bands)
    of = counted(tried, "band" if len({band.planet for band in bands}) == 1 else "measurement")
    where = bands[0].band if tried == 1 else f"{found or 'any'} of {of}"
    return f"{'' if found else 'not '}confirmed by simulated images in {where}"


def overrides_sentence(result: results.ImagedResult) -> str:
    """Return what is altered in the images; empty if nothing is."""
    altered = overrides_text(result.simulator_overrides)
    return f"Images altered: {altered}. Predictions are nominal." if altered else ""


def limits_text(counts: Mapping[str, int]) -> str:
    """Return how many stars are limited by what, most first but for the detected ones."""
    order = sorted(counts, key=lambda name: (name != "none", -counts[name], name))
    words = {name: "detected" if name == "none" else f"limited by {LIMITED_BY[name][1]}" for name in order}
    return ", ".join(f"{count_text(counts[name])} {words[name]}" for name in order)


def mode_of(rank: results.RankResult) -> results.DetectionMode:
    """Return how the reference planets of a ranking are looked for; at their known place in older results."""
    return next((row.verdict_mode for row in rank.targets if row.verdict_mode), "known_place")


def programme_text(rank: results.RankResult) -> str:
    """Return how reference planets are looked for, in how many visits, and under which drift."""
    visits = "the best number of visits for each" if rank.visits is None else counted(rank.visits, "visit")
    if all(row.visits is None for row in rank.targets):
        visits = "1 visit"
    drift = "" if rank.drift_nm is None else f", a wavefront that drifts by {rank.drift_nm:g} nm between visits"
    return f"{SEARCHES[mode_of(rank)]}, {visits}{drift}"


def detected_sentence(rank: results.RankResult) -> str:
    """Return how many reference planets are detected blind and at known places, and in how many visits and days.

    Empty where no law tells.
    """
    told = [row for row in rank.targets if row.detection_probability is not None and row.visits is not None]
    if not told:
        return ""
    blind = [row for row in told if (row.detection_probability or 0.0) >= 0.5]
    placed = [row for row in told if (row.detection_probability_known_place or 0.0) >= 0.5]
    words = f"Half of such observations or more show {counted(len(blind), 'reference planet')} blind"
    words = f"{words} and {len(placed)} at {'its known place' if len(told) == 1 else 'their known places'}"
    if not (seen := blind or placed):
        return f"{words}."
    visits = sorted(row.visits or 1 for row in seen)
    extent = f"{visits[0]} to {counted(visits[-1], 'visit')}" if visits[0] < visits[-1] else counted(visits[0], "visit")
    days = [row.span_days for row in seen if row.span_days is not None]
    span = f", which span {significant(statistics.median(days), 2)} days in the median, without slews" if days else ""
    paid = orbits_text(seen)
    return f"{words}, in {extent}{span}{f'; {paid}' if paid else ''}."


def confirm_sentences(result: results.ConfirmResult) -> list[str]:
    """Return the summary of a confirmed scene, one sentence an item."""
    planets = list(dict.fromkeys(band.planet for band in result.bands))
    bands = list(dict.fromkeys([*(search.band for search in result.searches), *(band.band for band in result.bands)]))
    sentences = [
        f"{counted(len(planets), 'planet')} in {', '.join(bands) or 'no band'}, "
        f"{counted(result.realisations, 'realisation')} each: simulated, reduced, "
        f"{LIBRARIES[result.reference_library].searched}."
    ]
    for planet in planets:
        own = [band for band in result.bands if band.planet == planet]
        measured = [band for band in own if band.recovered_snr is not None]
        if not measured:
            sentences.append(f"{planet} was not observed: {', '.join(sorted({band.message for band in own}))}.")
            continue
        detected = [f"{one.band} ({one.n_detected} of {one.realisations})" for one in measured if one.detected]
        sentences.append(f"{planet} is found in {', '.join(detected) or 'no band'}.")
    if not planets:
        sentences.append("The scene has no planet in the field: there is nothing to compare with a prediction.")
    return [*sentences, *programme_sentences(result)]


def programme_sentences(result: results.ConfirmResult) -> list[str]:
    """Return for whom visits and frames of a scene were chosen, and what they leave unused of the time."""
    every: list[results.SearchRecord | results.BandConfirmation] = [*result.searches, *result.bands]
    rows = {row.band: row for row in every if row.exposure_s is not None}
    chosen: dict[str, list[str]] = {}
    for row in rows.values():
        if row.chosen_for:
            each = row.frames_per_visit if isinstance(row, results.BandConfirmation) else row.n_frames
            text = f"{row.band} {counted(row.visits or 1, 'visit')} of {each} × {significant(row.exposure_s)} s"
            chosen.setdefault(row.chosen_for, []).append(text)
    said = [
        f"Programme of highest SNR for {name}, as cpic etc chooses it: {', '.join(each)}."
        for name, each in chosen.items()
    ]
    unused = unused_text(rows.values())
    return [*said, *[f"{unused}."] * bool(unused)]


def pointing_sentence(pointing: results.PointingRecord) -> str:
    """Return the limits of pointing in one sentence."""
    turned = f"turning by up to {pointing.panel_turn_deg:g}" if pointing.panel == "one_axis" else "fixed"
    return (
        f"Limits {pointing.name}: {pointing.sun_deg:g} deg from the Sun, {pointing.moon_deg:g} from the Moon, "
        f"{pointing.dark_limb_deg:g} from a dark limb of the Earth, {pointing.bright_limb_deg:g} from a sunlit one; "
        f"panels {turned} deg, within {pointing.panel_deg:g} of the Sun; {100 * pointing.saa_fraction:g} % of all time "
        "lost to the South Atlantic Anomaly."
    ).replace("fixed deg", "fixed")


QUANTITIES: dict[Quantity, str] = {"planet_flux": "planet flux", "snr": "SNR", "pixel_map": "pixels of a frame"}
"""Names of the quantities that errors refer to."""
_REGIONS = {"hole": "pixels around the dark hole", "full": "whole frames, of which the dark hole is kept"}
_DRAWS = {"sums": "sums of frames over the dark hole", "frames": "every frame, one by one"}
_COARSER = ("wavelength_nodes", "pixel_nodes", "precision", "drift_epochs", "pupil_samples")
_LEAST = 1e-6


@dataclass(frozen=True)
class ModelledRow:
    """One effect of a table.

    Attributes
    ----------
    effect : EffectRecord
        With its largest size.
    where : str
        Image set in which it is that large; empty where all are alike.
    size : str
        In per cent.
    word : str
        What became of it.
    """

    effect: results.EffectRecord
    where: str
    size: str
    word: str


@dataclass(frozen=True)
class ModelledGroup:
    """Image sets that are made alike.

    Attributes
    ----------
    title : str
        How they are made.
    names : tuple of str
        Their names.
    knobs, errors : str
        Settings of the optics; largest predicted errors, and what was asked for.
    rows : tuple of ModelledRow
        Largest size first.
    """

    title: str
    names: tuple[str, ...]
    knobs: str
    errors: str
    rows: tuple[ModelledRow, ...]

    @property
    def members(self) -> str:
        """Their names, with commas."""
        return ", ".join(self.names)


def dial_text(result: results.ImagedResult) -> str:
    """Return the setting of the dial in words: ``fidelity standard``, ``tolerance 2 %``."""
    if result.fidelity == "custom" and result.tolerance:
        return f"tolerance {_percent(max(result.tolerance.values()))}"
    return f"fidelity {result.fidelity}"


def error_text(errors: Mapping[Quantity, float | None]) -> str:
    """Return errors of quantities in words."""
    return ", ".join(f"{QUANTITIES[name]} {_percent(value)}" for name, value in errors.items())


def modelled_sentence(bands: Iterable[results.BandConfirmation]) -> str:
    """Return how images were drawn and the largest error that is predicted of them; empty without images."""
    made = [band.modelled for band in bands if band.modelled is not None and band.status != "invalid"]
    if not made:
        return ""
    ways = " and ".join(dict.fromkeys(_DRAWS[item.draw] for item in sorted(made, key=lambda item: item.draw)))
    return f"Images: {ways}; predicted error beside the reference: {error_text(_largest(made))}."


def modelled_groups(named: Sequence[tuple[str, results.ModellingRecord]]) -> list[ModelledGroup]:
    """Return one table for every distinct way to make images.

    Parameters
    ----------
    named : sequence of (str, ModellingRecord)
        Name of each image set, and how it was made. Sets that differ in nothing but sizes share a table, which shows
        the largest.
    """
    groups: dict[tuple[object, ...], list[tuple[str, results.ModellingRecord]]] = {}
    for name, record in named:
        kept = tuple((row.effect, row.decision) for row in record.effects)
        content = (record.draw, record.region, record.epochs, record.knobs.content_hash, kept)
        groups.setdefault(content, []).append((name, record))
    return [_group(members) for members in groups.values()]


def _group(members: list[tuple[str, results.ModellingRecord]]) -> ModelledGroup:
    record = members[0][1]
    largest = _largest([item for _, item in members])
    asked = f" (asked: at most {error_text(record.tolerance)})" if any(record.tolerance.values()) else ""
    knobs = record.knobs
    rows = [_row(index, members) for index in range(len(record.effects))]
    ways = _DRAWS[record.draw]
    return ModelledGroup(
        title=ways[:1].upper() + ways[1:],
        names=tuple(dict.fromkeys(name for name, _ in members)),
        knobs=f"{_REGIONS[record.region]}; {knobs.pupil_samples} samples across the pupil, {knobs.wavelength_nodes} "
        f"wavelength{'s' * (knobs.wavelength_nodes != 1)} a band, {knobs.pixel_nodes} × {knobs.pixel_nodes} nodes a "
        f"pixel, {knobs.precision} precision; wavefront at {record.epochs} epoch{'s' * (record.epochs != 1)} a visit",
        errors=f"{error_text(largest)}{asked}",
        rows=tuple(sorted(rows, key=lambda row: -size_order(row.effect))),
    )


def _row(index: int, members: list[tuple[str, results.ModellingRecord]]) -> ModelledRow:
    name, record = max(members, key=lambda member: size_order(member[1].effects[index]))
    sizes = {item.effects[index].size for _, item in members}
    row = record.effects[index]
    size = "" if row.size is None else _percent(row.size)
    return ModelledRow(row, name if len(sizes) > 1 else "", size, _decision_text(row))


def _decision_text(row: results.EffectRecord) -> str:
    if row.decision == "kept":
        return "kept"
    if row.key in _COARSER:
        return "coarser"
    return "as sums" if row.key == "summed_frames" else "left out"


def size_order(row: results.EffectRecord) -> float:
    """Return what effects are sorted by, largest first; those without a size stand before what is not there."""
    return row.size if row.size else 0.5 * _LEAST * _LEAST if row.size is None else 0.0


def _largest(records: Iterable[results.ModellingRecord]) -> dict[Quantity, float | None]:
    largest: dict[Quantity, float | None] = {}
    for record in records:
        for name, value in record.predicted_error.items():
            before = largest.get(name, 0.0)
            largest[name] = None if value is None or before is None else max(value, before)
    return largest


def _percent(value: float | None) -> str:
    if value is None:
        return "without a bound"
    if 0 < value < _LEAST:
        return f"below {100 * _LEAST:g} %"
    return f"{significant(100.0 * value, 2)} %"
