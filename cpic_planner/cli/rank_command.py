"""``cpic rank``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cpic_planner.cli.options import (
    DEFAULT_TIME_S,
    AlbedoOption,
    BandOption,
    CompanionsOption,
    DwarfsOption,
    InstrumentOption,
    JsonOption,
    OnOff,
    PhaseOption,
    RadiusOption,
    SinglesOption,
    TimeOption,
    VMaxOption,
    planet_from,
)
from cpic_planner.cli.output import console, note, print_json

__all__ = ["HELP", "rank"]

HELP = """Rank the whole catalogue by how clearly each star's reference planet is detected (analytic, about a second).

Examples:

  cpic rank

  cpic rank --band F662 --time-s 7200 --dwarfs --singles --limit 50

  cpic rank --json | python -m json.tool | head -40

  cpic rank --out ranking.csv"""


def rank(
    bands: BandOption = None,
    time_s: TimeOption = DEFAULT_TIME_S,
    limit: Annotated[int, typer.Option("--limit", min=1, help="Rows to print (--json and --out hold all).")] = 20,
    dwarfs: DwarfsOption = False,
    singles: SinglesOption = False,
    v_mag_max: VMaxOption = 7.0,
    companions: CompanionsOption = OnOff.ON,
    radius_rjup: RadiusOption = 1.0,
    phase_deg: PhaseOption = 90.0,
    albedo: AlbedoOption = "jupiter",
    instrument: InstrumentOption = None,
    out: Annotated[Path | None, typer.Option("--out", help="Also write all rows to FILE.csv or FILE.ecsv.")] = None,
    as_json: JsonOption = False,
) -> None:
    """Rank and print."""
    from catalogs.errors import InputError
    from cpic_planner.etc.model import build_model
    from cpic_planner.ranking import rank_targets, sample_text
    from cpic_planner.targets import rank_sample
    from simulator.config import load_instrument

    if out is not None and out.suffix not in (".csv", ".ecsv"):
        raise InputError("--out", str(out), allowed="a name that ends in .csv or .ecsv")
    model = build_model(load_instrument(instrument), bands)
    targets = rank_sample(v_mag_max=v_mag_max, dwarfs_only=dwarfs, singles_only=singles, companions=companions.value)
    result = rank_targets(model, targets, time_s=time_s, planet=planet_from(radius_rjup, phase_deg, albedo),
                          sample=sample_text(v_mag_max, dwarfs, singles))  # fmt: skip
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
