"""Stars within reach: ``python -m tools.reports reach`` makes this report anew.

Around how many stars a planet like Jupiter is detected, by the number of visits, the drift of the wavefront, the
instrument, and by whether the search knows the place.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from cpic_core import write_text
from cpic_planner.etc import build_model, programme_days
from cpic_planner.queries import Change, Strategy, changed
from cpic_planner.ranking import optimise
from cpic_planner.targets import Targets, rank_sample
from simulator.config import load_instrument
from tools.report_parts import table

HERE = Path(__file__).resolve().parent
INSTRUMENTS = ("cpic_default", "as_published")
DRIFTS_NM = (0.02, 0.05, 0.1, 0.3)
VISITS: tuple[int | None, ...] = (1, 4, 16, None)
TIME_S = 36_000.0
WHY = """Where more planets are found blind than at known places: the law of a look at a known place is that of single
visits, whose few resolution elements make its threshold; a search of many visits has their scatter as well."""


def detected(
    targets: Targets, name: str, drift_nm: float, visits: int | None, search: str, *, common: bool = True
) -> tuple[int, str]:
    """Count the stars whose reference planet is detected, and say what their programmes are like in the median.

    Parameters
    ----------
    targets : Targets
    name : str
        Of the instrument.
    drift_nm : float
        Offset of a visit, and the walk changes with it, as by ``--drift-nm``.
    visits : int or None
        None: the best number for each star and band.
    search : str
        ``blind`` or ``known_place``.
    common : bool, optional
        Whether visits share a part of the offset.
    """
    instrument = changed(load_instrument(name), (Change(key="drift", value=drift_nm),))
    if not common:
        instrument = instrument.changed({"drift": {"common_fraction": 0.0}})
    model = build_model(instrument, None, Strategy.model_validate({"visits": visits, "search": search}))
    best = optimise(model, targets, time_s=TIME_S)
    found = best.detected
    if not found.any():
        return 0, ""
    days = programme_days(model, best.visits, best.time_s)[found]
    median = [float(np.median(values)) for values in (days, best.orbits_searched[found], best.motion_factor[found])]
    return int(found.sum()), " ({:.2g} d, {:.0f}, x{:.3g})".format(*median)


def rows(targets: Targets, name: str) -> Iterator[list[str]]:
    """Yield the counts of an instrument, a row for each drift."""
    for drift_nm in DRIFTS_NM:
        cells = []
        for visits in VISITS:
            (blind, about), (placed, _) = (
                detected(targets, name, drift_nm, visits, search) for search in ("blind", "known_place")
            )
            cells.append(f"{blind} / {placed}{about}")
        alone, _ = detected(targets, name, drift_nm, None, "blind", common=False)
        print(name, drift_nm, flush=True)
        yield [f"{drift_nm:g}", *cells, str(alone)]


def main() -> None:
    """Count and write the report."""
    targets, drift = rank_sample(), load_instrument("cpic_default").drift
    heads = ["drift (nm)", *(f"V = {visits}" if visits else "best V" for visits in VISITS), "best V, nothing common"]
    parts = [
        f"""# Stars within reach

Around how many of {len(targets)} stars a planet of one Jupiter radius, at phase 90 degrees where it is seen
best, is detected by half of such observations or more, in its best band. Each cell: by a search that does
not know the place / at the known place; in brackets, in the median of the blind ones, the days that they
span, occultations included, the orbits that the search goes through, and the factor on its threshold.
The walk in a visit changes with the drift. Science and reference differ by {drift.common_fraction:g}
of the rms of the offset in all visits, which no number of visits averages; the last column leaves it out.
Reference frames take half of the time. A blind search goes through velocities up to that of escape, and its
threshold pays for them (`cpic_planner.planets.motion`); visits follow each other at once.

Each number is the count of rows with verdict `detected` of one command, as
`cpic rank --instrument cpic_default --drift-nm 0.1 --visits 16 --time-s {TIME_S:g} --search blind --json`."""
    ]
    for name in INSTRUMENTS:
        parts.append(f"## {name}, {TIME_S / 3600:g} h of wall time a star and band")
        parts.append(table(heads, list(rows(targets, name))))
    parts.append(WHY)
    write_text(HERE / "report.md", "\n\n".join(parts) + "\n")


if __name__ == "__main__":
    main()
