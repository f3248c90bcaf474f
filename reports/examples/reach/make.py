"""Stars within reach: ``python -m tools.reports reach`` makes this report anew.

Around how many stars a planet like Jupiter is detected, by the number of visits, the drift of the
wavefront, the instrument, the time, and by whether the search knows the place.
"""

from __future__ import annotations

import io
import json
from collections import Counter
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from cpic_core import BoolArray, write_bytes, write_text
from cpic_planner.etc import EtcModel, build_model, programme_days
from cpic_planner.queries import Change, Strategy, changed
from cpic_planner.ranking import OptimalSetting, detection_statuses, limits_of, optimise
from cpic_planner.report import new_figure
from cpic_planner.report.words import LIMITED_BY
from cpic_planner.targets import Targets, rank_sample
from simulator.config import Instrument, load_instrument

HERE = Path(__file__).resolve().parent
INSTRUMENTS = ("cpic_default", "as_published")
DRIFTS_NM = (0.02, 0.05, 0.1, 0.3)
VISITS: tuple[int | None, ...] = (1, 4, 16, None)
TIMES_S = (36_000.0,)
SEARCHES = ("blind", "known_place")


@dataclass(frozen=True)
class Cell:
    """One count: of which case, and what limits the stars that are not in it.

    ``visits`` None: the best number for each star and band, up to 1000. ``span_days``, ``used_visits``, ``orbits``
    (none at known places, where they are followed) and ``motion_factor`` (on the threshold that pays for them) are
    medians of the detected ones.
    """

    instrument: str
    common: bool
    drift_nm: float
    visits: int | None
    time_s: float
    search: str
    detected: int
    orbits: float | None
    motion_factor: float | None
    span_days: float | None
    used_visits: float | None
    limited_by: dict[str, int]
    stars: list[str]

    @property
    def command(self) -> str:
        """Command whose rows with verdict ``detected`` are these."""
        words = ["cpic rank", f"--instrument {self.instrument}", f"--drift-nm {self.drift_nm:g}"]
        words += [] if self.visits is None else [f"--visits {self.visits}"]
        return " ".join([*words, f"--time-s {self.time_s:g}", f"--search {self.search}", "--json"])


def instruments() -> tuple[str, ...]:
    """Return those of `INSTRUMENTS` that are shipped."""
    shipped = {path.stem for path in (Path(__file__).parents[2] / "simulator/presets/instrument").glob("*.yaml")}
    return tuple(name for name in INSTRUMENTS if name in shipped)


def instrument_of(name: str, drift_nm: float, *, common: bool = True) -> Instrument:
    """Return an instrument with another drift, as ``--drift-nm`` does, with or without what all visits share."""
    built = changed(load_instrument(name), (Change(key="drift", value=drift_nm),))
    return built if common else built.changed({"drift": {"common_fraction": 0.0}})


def cell(
    targets: Targets, name: str, drift_nm: float, visits: int | None, time_s: float, search: str, common: bool
) -> Cell:
    """Count the stars whose reference planet is detected."""
    model = build_model(
        instrument_of(name, drift_nm, common=common),
        None,
        Strategy.model_validate({"visits": visits, "search": search}),
    )
    best = optimise(model, targets, time_s=time_s)
    return _counted(
        model, targets, best, Cell(name, common, drift_nm, visits, time_s, search, 0, None, None, None, None, {}, [])
    )


def _counted(model: EtcModel, targets: Targets, best: OptimalSetting, of: Cell) -> Cell:
    found = best.detected
    days = programme_days(model, best.visits, best.time_s)[found]
    limits = Counter(limits_of(detection_statuses(best, model), best))
    told = {
        "detected": int(found.sum()),
        "orbits": float(np.median(best.orbits_searched[found])) if found.any() and of.search == "blind" else None,
        "motion_factor": float(np.median(best.motion_factor[found])) if found.any() else None,
        "span_days": float(np.median(days)) if found.any() else None,
        "used_visits": float(np.median(best.visits[found])) if found.any() else None,
        "limited_by": dict(sorted(limits.items())),
        "stars": sorted(targets.name[found].tolist()),
    }
    return Cell(**(asdict(of) | told))


def hopeful(targets: Targets, name: str) -> BoolArray:
    """Stars that are not too faint for the longest time and the calmest wavefront, whatever the search and the visits.

    Of the others photons are the limit in all cases: a larger drift, less time and more overhead make nothing easier.
    """
    near = np.zeros(len(targets), bool)
    for search in SEARCHES:
        for visits in (1, None):
            strategy = Strategy.model_validate({"visits": visits, "search": search})
            model = build_model(instrument_of(name, DRIFTS_NM[0], common=False), None, strategy)
            best = optimise(model, targets, time_s=TIMES_S[-1])
            limits = limits_of(detection_statuses(best, model), best)
            near |= np.array([limit != "photons" for limit in limits])
    return near


def cells() -> list[Cell]:
    """Count every case of the report."""
    every, made = rank_sample(), []
    for name in instruments():
        near = hopeful(every, name)
        targets, faint = every.select(near), int(np.count_nonzero(~near))
        for drift_nm in DRIFTS_NM:
            for time_s in TIMES_S:
                for search in SEARCHES:
                    made += [cell(targets, name, drift_nm, visits, time_s, search, True) for visits in VISITS]
            made += [cell(targets, name, drift_nm, None, time_s, "blind", False) for time_s in TIMES_S]
        for item in made:
            if item.instrument == name:
                item.limited_by["photons"] = item.limited_by.get("photons", 0) + faint
        print(name, f"done, {len(targets)} stars looked at closely", flush=True)
    return made


def picked(every: list[Cell], **what: object) -> Cell:
    """Return the one cell of a case."""
    (found,) = (item for item in every if all(getattr(item, name) == value for name, value in what.items()))
    return found


def figure_of(every: list[Cell]) -> Figure:
    """Stars within reach against the drift, blind, for each number of visits."""
    figure = new_figure(4.0)
    panels = figure.subplots(1, len(TIMES_S), squeeze=False)[0]
    for panel, time_s in zip(panels, TIMES_S, strict=True):
        for visits, colour in zip(VISITS, ("#444444", "#1f77b4", "#2ca02c", "#d62728"), strict=True):
            for name, look in zip(instruments(), ("-", "--"), strict=False):
                case = {"instrument": name, "common": True, "visits": visits, "time_s": time_s, "search": "blind"}
                counts = [picked(every, drift_nm=drift, **case).detected for drift in DRIFTS_NM]
                label = (f"V = {visits}" if visits else "best V") if look == "-" else None
                panel.plot(DRIFTS_NM, counts, look, marker="o", ms=3, color=colour, label=label)
        panel.set(xscale="log", xlabel="wavefront offset of a visit (nm rms)", title=f"{time_s / 3600:g} h a star")
        panel.set_xticks(DRIFTS_NM, [f"{drift:g}" for drift in DRIFTS_NM])
        panel.minorticks_off()
        panel.grid()
    panels[0].set_ylabel("stars with a planet like Jupiter detected blind")
    for name, look in zip(instruments(), ("-", "--"), strict=False):
        panels[0].plot([], [], look, color="black", label=name)
    panels[0].legend(fontsize=7)
    return figure


def _table(every: list[Cell], name: str, time_s: float) -> list[str]:
    heads = [f"V = {visits}" if visits else "best V" for visits in VISITS]
    lines = ["| drift (nm) | " + " | ".join(heads) + " | best V, nothing common |", "|---" * (len(VISITS) + 2) + "|"]
    for drift in DRIFTS_NM:
        case = {"instrument": name, "drift_nm": drift, "time_s": time_s}
        row = []
        for visits in VISITS:
            blind, placed = (picked(every, common=True, visits=visits, search=mode, **case) for mode in SEARCHES)
            days = (
                ""
                if blind.span_days is None
                else f" ({blind.span_days:.2g} d, {blind.orbits:.0f}, x{blind.motion_factor:.3g})"
            )
            row.append(f"{blind.detected} / {placed.detected}{days}")
        row.append(str(picked(every, common=False, visits=None, search="blind", **case).detected))
        lines.append(f"| {drift:g} | " + " | ".join(row) + " |")
    return lines


def _limits(every: list[Cell], name: str, time_s: float) -> list[str]:
    names = [key for key in LIMITED_BY if any(key in item.limited_by for item in every)]
    lines = ["| drift (nm) | visits | " + " | ".join(LIMITED_BY[key][0] for key in names) + " |"]
    lines.append("|---" * (len(names) + 2) + "|")
    for drift in DRIFTS_NM:
        for visits in (1, None):
            case = {"instrument": name, "drift_nm": drift, "time_s": time_s, "visits": visits, "common": True}
            found = picked(every, search="blind", **case)
            used = "1" if visits else f"best (median {found.used_visits or 0:.0f})"
            lines.append(f"| {drift:g} | {used} | " + " | ".join(str(found.limited_by.get(k, 0)) for k in names) + " |")
    return lines


def report(every: list[Cell], n_stars: int) -> str:
    """Return the text of the report."""
    sample = picked(
        every, instrument="cpic_default", common=True, drift_nm=0.1, visits=16, time_s=TIMES_S[0], search="blind"
    )
    drift = load_instrument("cpic_default").drift
    lines = [
        "# Stars within reach",
        "",
        f"Around how many of {n_stars} stars a planet of one Jupiter radius, at phase 90 degrees where it is seen",
        "best, is detected by half of such observations or more, in its best band. Each cell: by a search that does",
        "not know the place / at the known place; in brackets, in the median of the blind ones, the days that they",
        "span, occultations included, the orbits that the search goes through, and the factor on its threshold.",
        f"The walk in a visit changes with the drift. Science and reference differ by {drift.common_fraction:g}",
        "of the rms of the offset in all visits, which no number of visits averages; the last column leaves it out.",
        "Reference frames take half of the time. A blind search goes through velocities up to that of escape, and its",
        "threshold pays for them (`cpic_planner.planets.motion`); visits follow each other at once.",
        "",
        f"Each number is the count of rows with verdict `detected` of one command, as `{sample.command}` for the",
        f"{sample.detected} in the table.",
    ]
    for name in instruments():
        for time_s in TIMES_S:
            lines += [
                "",
                f"## {name}, {time_s / 3600:g} h of wall time a star and band",
                "",
                *_table(every, name, time_s),
            ]
            lines += ["", "What limits the other stars, by a blind search:", "", *_limits(every, name, time_s)]
    lines += [
        "",
        "![Stars within reach against drift](reach.png)",
        "",
        "Photons: too faint in that time even if the wavefront did not drift, or if there were no background.",
        "Where more planets are found blind than at known places: the law of a look at a known place is that of single",
        "visits, whose few resolution elements make its threshold; a search of many visits has their scatter as well.",
        "All cells with their stars are in `reach.json`.",
    ]
    return "\n".join(lines) + "\n"


def main() -> None:
    """Write report, figure and numbers."""
    every = cells()
    picture = io.BytesIO()
    figure_of(every).savefig(picture, format="png", dpi=110)
    write_bytes(HERE / "reach.png", picture.getvalue())
    told = [asdict(item) | {"command": item.command if item.common else None} for item in every]
    write_text(HERE / "reach.json", json.dumps(told, indent=1) + "\n")
    write_text(HERE / "report.md", report(every, len(rank_sample())))


if __name__ == "__main__":
    main()
