"""``cpic rank``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cpic_planner.cli.options import (
    DEFAULT_TIME_S,
    AlbedoOption,
    BandOption,
    CatalogOption,
    CloudsOption,
    CompanionsOption,
    DwarfsOption,
    InsolationOption,
    InstrumentOption,
    JsonOption,
    MetallicityOption,
    OnOff,
    PhaseFunctionOption,
    PhaseOption,
    RadiusOption,
    SinglesOption,
    TimeOption,
    VMaxOption,
    albedo_from,
    planet_from,
)
from cpic_planner.cli.output import console, note, print_json

__all__ = ["HELP", "rank"]

HELP = """Rank the whole catalogue by how clearly each star's reference planet is detected (analytic, about a second).

Examples:

  cpic rank

  cpic rank --band F662 --time-s 7200 --dwarfs --singles --limit 50

  cpic rank --json | python -m json.tool | head -40

  cpic rank --out ranking.csv

  cpic rank --catalog my_stars.csv

--catalog takes a table with the columns name, distance_pc or parallax_mas, v_mag, and sp_type or teff_k (or the usual
other names of these); cpic catalog columns lists all that are read."""


def rank(
    bands: BandOption = None,
    time_s: TimeOption = DEFAULT_TIME_S,
    limit: Annotated[int, typer.Option("--limit", min=1, help="Rows to print (--json and --out hold all).")] = 20,
    dwarfs: DwarfsOption = False,
    singles: SinglesOption = False,
    v_mag_max: VMaxOption = None,
    catalog: CatalogOption = "snapshot",
    companions: CompanionsOption = OnOff.ON,
    radius_rjup: RadiusOption = 1.0,
    phase_deg: PhaseOption = 90.0,
    albedo: AlbedoOption = None,
    log10_mh: MetallicityOption = None,
    log10_fsed: CloudsOption = None,
    insolation_au: InsolationOption = None,
    phase_function: PhaseFunctionOption = None,
    instrument: InstrumentOption = None,
    out: Annotated[Path | None, typer.Option("--out", help="Also write all rows to FILE.csv or FILE.ecsv.")] = None,
    as_json: JsonOption = False,
) -> None:
    """Rank and print."""
    from catalogs.catalogue import open_catalogue
    from catalogs.errors import InputError
    from cpic_planner.etc.model import build_model
    from cpic_planner.ranking import rank_targets
    from cpic_planner.targets import rank_sample, sample_text
    from simulator.config import load_instrument

    if out is not None and out.suffix not in (".csv", ".ecsv"):
        raise InputError("--out", str(out), allowed="a name that ends in .csv or .ecsv")
    model = build_model(load_instrument(instrument), bands)
    table = open_catalogue(catalog)
    for remark in table.notes:
        note(remark)
    targets = rank_sample(
        catalog=table, v_mag_max=v_mag_max, dwarfs_only=dwarfs, singles_only=singles, companions=companions.value
    )
    reflects = albedo_from(albedo, log10_mh, log10_fsed, insolation_au, phase_function)
    result = rank_targets(model, targets, time_s=time_s, planet=planet_from(radius_rjup, phase_deg, reflects),
                          sample=sample_text(table, v_mag_max, dwarfs, singles),
                          catalogue=table.provenance)  # fmt: skip
    if out is not None:
        from cpic_planner.report.tables import ranking_csv, ranking_ecsv
        from simulator.files import write_text

        try:
            write_text(out, ranking_csv(result) if out.suffix == ".csv" else ranking_ecsv(result))
        except OSError as error:
            raise InputError("--out", str(out), allowed="a writable file", hint=error.strerror or "") from None
        note(f"wrote {len(result.targets)} rows to {out}")
    if as_json:
        print_json(result)
        return
    from cpic_planner.report.console import print_rank

    print_rank(result, console(), limit=limit)
