"""``cpic rank``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cpic_planner.cli.options import (
    DEFAULT_TIME_S,
    AlbedoOption,
    BandOption,
    CatalogOption,
    CloudsOption,
    CompanionsOption,
    DateOption,
    DwarfsOption,
    InsolationOption,
    InstrumentOption,
    JsonOption,
    KnownPlanetsOption,
    MetallicityOption,
    OnOff,
    PhaseFunctionOption,
    PhaseOption,
    PlanetsOption,
    PopulationOption,
    RadiusOption,
    ScoreOption,
    SeedOption,
    SinglesOption,
    TimeOption,
    VMaxOption,
    albedo_from,
    known_from,
    planet_from,
    population_from,
    refuse_date_alone,
)
from cpic_planner.cli.output import console, note, print_json
from cpic_planner.cli.strategy_options import (
    CountingOption,
    CountingSigmaOption,
    ExozodiOption,
    LibraryOption,
    ReferenceRatioOption,
    ReferenceTeffOption,
    ReferenceVMagOption,
    RollOption,
    model_from,
    refuse_together,
    strategy_from,
)
from cpic_planner.registry.libraries import DEFAULT_LIBRARY
from cpic_planner.registry.scores import DEFAULT_SCORE

if TYPE_CHECKING:
    from cpic_planner.etc.model import EtcModel
    from cpic_planner.models import RankResult
    from cpic_planner.targets import Targets

__all__ = ["HELP", "rank"]

HELP = """Rank the whole catalogue (analytic, a few seconds; --explain and --sensitivity rank it several times).

The ranking is by completeness per hour: which fraction of a population of planets one observation of the star detects,
over its wall time. Stars that show none of it, with a score of zero, follow by detection margin. --score chooses
another order; the other columns are about a stated reference planet: whether it is detected (at its known place), how
likely a search finds it that does not know the place, and what limits it (limited_by: the single change that would make
it detected in the given time; see cpic etc --help).

Examples:

  cpic rank

  cpic rank --score detection_margin --band F662 --time-s 7200 --dwarfs --singles --limit 50

  cpic rank --population solar_system --planets 1000 --plot ranking.png

  cpic rank --explain "tau Cet"

  cpic rank --sensitivity

  cpic rank --json | python -m json.tool | head -40

  cpic rank --out ranking.csv

  cpic rank --catalog my_stars.csv

  cpic rank --known-planets snapshot --date 2030-06-01

--catalog takes a table with the columns name, distance_pc or parallax_mas, v_mag, and sp_type or teff_k (or the usual
other names of these); cpic catalog columns lists all that are read.

--known-planets ranks the stars that have known planets by the probability that one observation at --date detects at
least one of them, the errors of their orbits included; --planets is then the number of draws of each planet."""


def rank(
    bands: BandOption = None,
    time_s: TimeOption = DEFAULT_TIME_S,
    score: ScoreOption = DEFAULT_SCORE,
    limit: Annotated[
        int, typer.Option("--limit", min=1, help="Stars to print and to draw (--json and --out hold all).")
    ] = 20,
    dwarfs: DwarfsOption = False,
    singles: SinglesOption = False,
    v_mag_max: VMaxOption = None,
    catalog: CatalogOption = "snapshot",
    companions: CompanionsOption = OnOff.ON,
    population: PopulationOption = None,
    planets: PlanetsOption = None,
    seed: SeedOption = 1,
    known_planets: KnownPlanetsOption = None,
    date: DateOption = None,
    radius_rjup: RadiusOption = 1.0,
    phase_deg: PhaseOption = 90.0,
    albedo: AlbedoOption = None,
    log10_mh: MetallicityOption = None,
    log10_fsed: CloudsOption = None,
    insolation_au: InsolationOption = None,
    phase_function: PhaseFunctionOption = None,
    library: LibraryOption = DEFAULT_LIBRARY,
    reference_v_mag: ReferenceVMagOption = None,
    reference_teff_k: ReferenceTeffOption = None,
    reference_ratio: ReferenceRatioOption = None,
    roll_deg: RollOption = None,
    photon_counting: CountingOption = False,
    counting_sigma: CountingSigmaOption = None,
    exozodi: ExozodiOption = None,
    instrument: InstrumentOption = None,
    explain: Annotated[
        str | None, typer.Option("--explain", help="Say why this star stands where it stands, instead of the table.")
    ] = None,
    sensitivity: Annotated[
        bool, typer.Option("--sensitivity", help="Say how the order depends on assumptions, instead of the table.")
    ] = False,
    plot: Annotated[
        Path | None,
        typer.Option("--plot", help="Draw the first --limit stars, at most 100, into FILE.png, .pdf or .svg as well."),
    ] = None,
    out: Annotated[Path | None, typer.Option("--out", help="Also write all rows to FILE.csv or FILE.ecsv.")] = None,
    as_json: JsonOption = False,
) -> None:
    """Rank and print."""
    from catalogs.catalogue import open_catalogue
    from catalogs.errors import InputError
    from cpic_planner.known_completeness import KNOWN_ONLY
    from cpic_planner.ranking import rank_targets
    from cpic_planner.targets import rank_sample, sample_text

    refuse_together({"--explain": explain, "--sensitivity": sensitivity}, "two answers")
    for name, value in (("--explain", explain), ("--sensitivity", sensitivity)):
        refuse_together({name: value, "--out": out}, "it holds no ranking")
        refuse_together({name: value, "--plot": plot}, "it has no figure")
    for name, value in (("--explain", explain), ("--sensitivity", sensitivity), ("--population", population)):
        refuse_together({name: value, "--known-planets": known_planets}, "it is about a hypothetical population")
    refuse_date_alone(date, known_planets)
    if out is not None and out.suffix not in (".csv", ".ecsv"):
        raise InputError("--out", str(out), allowed="a name that ends in .csv or .ecsv")
    if plot is not None:
        from cpic_planner.report.etc_figures import check_figure_name

        check_figure_name(plot)
    strategy = strategy_from(
        library,
        reference_v_mag=reference_v_mag,
        reference_teff_k=reference_teff_k,
        reference_ratio=reference_ratio,
        roll_deg=roll_deg,
        photon_counting=photon_counting,
        counting_sigma=counting_sigma,
    )
    table = open_catalogue(catalog)
    for remark in table.notes:
        note(remark)
    targets = rank_sample(
        catalog=table, v_mag_max=v_mag_max, dwarfs_only=dwarfs, singles_only=singles, companions=companions.value
    )
    model = model_from(instrument, bands, strategy, exozodi_zodis=exozodi)
    reflects = albedo_from(albedo, log10_mh, log10_fsed, insolation_au, phase_function)
    sample = sample_text(table, v_mag_max, dwarfs, singles)
    if known_planets is None:
        chosen: Any = population_from(population, planets, seed)
    else:
        chosen = known_from(known_planets, date, planets, seed, reflects, model.instrument)
        for remark in chosen.table.notes:
            note(remark)
        targets = chosen.stars(targets)
        sample = f"{sample}; {KNOWN_ONLY}"
    asked: dict[str, Any] = {
        "time_s": time_s,
        "planet": planet_from(radius_rjup, phase_deg, reflects),
        "population": chosen,
        "score": score,
    }
    if explain is not None:
        from cpic_planner.targets import find_target

        star, remark = find_target(explain, companions=companions.value, catalog=table)
        if remark:
            note(remark)
        _explain(model, targets, str(star.name[0]), explain, asked, as_json)
        return
    if sensitivity:
        _sensitivity(model, targets, asked, as_json)
        return
    result = rank_targets(model, targets, sample=sample, catalogue=table.provenance, **asked)
    _write(result, out, plot, limit)
    if as_json:
        print_json(result)
        return
    from cpic_planner.report.console_rank import print_rank

    print_rank(result, console(), limit=limit)


def _explain(model: EtcModel, targets: Targets, name: str, given: str, asked: dict[str, Any], as_json: bool) -> None:
    """Print why a star stands where it stands."""
    from catalogs.errors import InputError
    from cpic_planner.explain import explain_star

    if name not in set(targets.name.tolist()):
        raise InputError(
            "--explain",
            given,
            allowed="a star of the sample that is ranked",
            hint="it is in the catalogue, but a cut leaves it out",
        )
    told = explain_star(model, targets, name, **asked)
    if as_json:
        print_json(told)
        return
    from cpic_planner.report.console_rank import print_explanation

    print_explanation(told, console())


def _sensitivity(model: EtcModel, targets: Targets, asked: dict[str, Any], as_json: bool) -> None:
    """Print how the order depends on assumptions."""
    from cpic_planner.sensitivity import sensitivity

    found = sensitivity(model, targets, **asked)
    if as_json:
        print_json(found)
        return
    from cpic_planner.report.console_rank import print_sensitivity

    print_sensitivity(found, console())


def _write(result: RankResult, out: Path | None, plot: Path | None, limit: int) -> None:
    """Write the table and the figure that were asked for."""
    if out is not None:
        from catalogs.errors import InputError
        from cpic_planner.report.tables import ranking_csv, ranking_ecsv
        from simulator.files import write_text

        try:
            write_text(out, ranking_csv(result) if out.suffix == ".csv" else ranking_ecsv(result))
        except OSError as error:
            raise InputError("--out", str(out), allowed="a writable file", hint=error.strerror or "") from None
        note(f"wrote {len(result.targets)} rows to {out}")
    if plot is not None:
        from cpic_planner.report.etc_figures import write_figure
        from cpic_planner.report.rank_figure import MOST_STARS, rank_figure

        write_figure(rank_figure(result, limit), plot)
        shown = min(limit, len(result.targets))
        few = f" with the first {MOST_STARS} stars only: names of {shown} could not be read" * (shown > MOST_STARS)
        note(f"wrote {plot}{few}")
