"""A page a star in the report of a plan: what is known, what a detection asks for, and what the images show."""

from collections.abc import Iterator, Mapping, Sequence

from cpic_planner import results
from cpic_planner.report import document as doc, image_figures, numbers, words
from cpic_planner.report.decision import asks_text, seasons_texts
from cpic_planner.report.drawing import Picture
from cpic_planner.report.numbers import decimals, pretty_name, significant
from cpic_planner.report.priorities import TIERS, known_planet_name, windows_text

Facts = Sequence[tuple[doc.Inline, doc.Inline]]


def anchors_of(plan: results.PlanResult, rows: Sequence[results.RankedTarget]) -> dict[str, str]:
    """Return the anchor of every star that has a page: targets, and the other stars that are shown.

    Parameters
    ----------
    plan : PlanResult
    rows : sequence of RankedTarget
        Stars of the ranking that are shown.
    """
    targets = {target.name: f"target-{number}" for number, target in enumerate(plan.targets, 1)}
    return {row.name: f"star-{row.rank}" for row in rows} | targets


def star_pages(
    plan: results.PlanResult,
    rows: Sequence[results.RankedTarget],
    images: Mapping[str, Picture],
    known: results.KnownResult | None,
) -> Iterator[doc.Block]:
    """Yield the pages of the targets, and a folded one for every other star that is shown.

    Parameters
    ----------
    plan : PlanResult
    rows : sequence of RankedTarget
        Stars of the ranking that are shown.
    images : mapping of str to Picture
        Image panels by ``BandConfirmation.image``.
    known : KnownResult, optional
        Known planets of the first stars.
    """
    anchors = anchors_of(plan, rows)
    for target in plan.targets:
        title = f"{target.ranked.rank}. {numbers.full_name(target.name, target.hip)}"
        seasons = seasons_texts(plan, target.name)
        seen: Facts = [("Can be seen", doc.lines(*seasons))] if seasons else []
        blocks = star_blocks(target, images, [*seen, *_known_facts(target.ranked, known)])
        yield doc.Group(anchors[target.name], title, list(blocks))
    others = [row for row in rows if row.name not in {target.name for target in plan.targets}]
    if others:
        yield doc.Heading("Stars without images")
    for row in others:
        facts = [*_star_facts(row), *_priority_facts(row), *_known_facts(row, known)]
        title = f"{row.rank}. {numbers.full_name(row.name, row.hip)}"
        tier = "" if row.tier is None else f", tier {row.tier}"
        yield doc.Fold(f"{title}{tier}", [doc.Facts(facts, wide=False), *_caveats(row)], anchor=anchors[row.name])


def _caveats(star: results.RankedTarget) -> list[doc.Block]:
    return [doc.Facts([("Caveats", "; ".join(map(words.flag_text, star.flags)))])] if star.flags else []


def _companion_text(star: results.RankedTarget) -> str:
    """Return where the nearest companion stands, with the error of its place."""
    angle, error = star.companion_pa_deg, star.companion_position_error_arcsec
    text = f"{significant(star.companion_separation_arcsec, 3)} arcsec"
    text += "" if error is None else f" ± {significant(error, 1)}"
    return text + (", position angle not known" if angle is None else f", position angle {round(angle)} deg")


def _star_facts(star: results.RankedTarget) -> Facts:
    facts: list[tuple[doc.Inline, doc.Inline]] = [
        ("Catalogue name", star.name),
        ("Position (ICRS)", f"{words.ra_text(star.ra_deg)}, {words.dec_text(star.dec_deg)}"),
        ("Type, V", f"{star.sp_type}, {decimals(star.v_mag, 2)} mag"),
        ("Distance", f"{significant(star.distance_pc, 4)} pc"),
    ]
    if star.luminosity_lsun is not None:
        facts.append(("Luminosity", [f"{significant(star.luminosity_lsun)} L", doc.Mark("sub", "☉")]))
    if star.companion_separation_arcsec is not None:
        facts.append(("Nearest known companion", _companion_text(star)))
    sunlight = star.ref_planet_insolation_au
    lit = "" if sunlight is None else f" (sunlight of {significant(sunlight)} au)"
    reference = f"{significant(star.ref_planet_distance_au)} au from the star{lit}"
    return [*facts, ("Reference planet", f"{reference}, contrast {numbers.contrast_text(star.contrast)}")]


def _priority_facts(star: results.RankedTarget) -> Facts:
    """Return what a detection asks for, what is missing, and how sure that is."""
    facts: list[tuple[doc.Inline, doc.Inline]] = []
    if star.tier is not None:
        facts.append(("Tier", f"{star.tier}: {TIERS[star.tier]}"))
    facts.append(("A detection asks for", asks_text(star)))
    if star.limited_by is not None and star.limited_by != "none":
        facts.append(("Limited by", words.LIMITED_BY[star.limited_by][1]))
    missing = [
        f"a drift ×{significant(star.required_drift_factor, 2)}" if star.required_drift_factor else "",
        f"a planet ×{significant(star.required_contrast_factor, 2)} as bright" if star.required_contrast_factor else "",
    ]
    if any(missing):
        facts.append(("Enough would be", " or ".join(filter(None, missing))))
    facts.append(("Completeness", _completeness_text(star)))
    if star.expected_planets is not None:
        of_all = star.expected_planets_unconditional
        known = "" if of_all is None else f"; {significant(of_all, 2)} if nothing were known of the star"
        facts.append(("Expected planets of one observation", f"{significant(star.expected_planets, 2)}{known}"))
    if star.p_reachable is not None and star.rank_p05 is not None and star.rank_p95 is not None:
        share = f"detected by {numbers.percent_text(star.p_reachable)} of them"
        facts.append(("Under the ensemble of instruments", f"{share}, rank {star.rank_p05:.0f} to {star.rank_p95:.0f}"))
    return facts


def _completeness_text(star: results.RankedTarget) -> str:
    fact = f"{numbers.share_text(star.completeness)} % in {star.completeness_band}"
    of_all, placed = star.completeness_unconditional, star.completeness_known_place
    if placed is not None:
        fact = f"{fact} by a blind search, {numbers.share_text(placed)} % at known places"
    return fact if of_all is None else f"{fact}; blind {numbers.share_text(of_all)} % whatever is known of the star"


def _known_facts(star: results.RankedTarget, known: results.KnownResult | None) -> Facts:
    """Return the known planets of the star, each with its next days in the dark hole."""
    rows = [] if known is None else [row for row in known.planets if row.counted and row.star == star.name]
    none = "at no time more likely than not in a dark hole"
    return [(f"Known planet {known_planet_name(row)}", windows_text(row) if row.windows else none) for row in rows]


def star_blocks(
    target: results.ConfirmedTarget, images: Mapping[str, Picture], more: Facts = ()
) -> Iterator[doc.Block]:
    """Yield what images show of one star: facts, verdict, measurements in each band, pictures.

    Parameters
    ----------
    target : ConfirmedTarget
    images : mapping of str to Picture
        By ``BandConfirmation.image``.
    more : sequence of tuple
        Further facts of the star.
    """
    star, name = target.ranked, pretty_name(target.name)
    facts = [*_star_facts(star), *_priority_facts(star)]
    facts.append(("Predicted margin", f"{significant(star.detection_margin)} in {star.band}"))
    facts += [(title, text) for title, text in image_figures.visits_facts(target).items()]
    yield doc.Facts([*facts, *more], wide=False)
    yield from _caveats(star)
    if target.verdict:
        yield doc.Paragraph(doc.strong(words.sentence(target.verdict)))
    picked = f"The chosen band is {target.chosen_band}." if target.chosen_band else "No band was chosen."
    yield image_figures.measure_table(name, target.bands, f"{name} by band. {picked}", target.chosen_band)
    yield from image_figures.audit_blocks(name, target.bands)
    yield from image_figures.picture_blocks(images, [band.image for band in target.bands if band.image], name)
