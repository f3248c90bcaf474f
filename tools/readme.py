"""Write ``README.md`` from ``README.template.md`` and the figures of the committed reports: ``python -m tools.readme``.

The template holds the words, with ``{{ name.figure }}`` where a figure of a report stands (`FIGURES` says which there
are) and ``{{ table.report }}`` for a table. ``--check`` writes nothing and fails if the README is another one. Who has
changed words in ``README.md`` brings them into the template with ``--adopt``: lines that differ are taken over as they
are, figures that stand in them included, so that ``--check`` holds again; put the names back where they belong.
"""

import argparse
import csv
import difflib
import itertools
import json
import math
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from statistics import median
from typing import Any

from jinja2 import Environment, StrictUndefined
from scipy.stats import beta

from tools.reports import REPORT, ROOT, folders

TEMPLATE, README = ROOT / "README.template.md", ROOT / "README.md"
BASELINE = ROOT / "tests/benchmarks/baseline.json"

Figures = Mapping[str, str]


def report(name: str) -> str:
    """Return the text of a committed report."""
    return (folders()[name] / REPORT).read_text(encoding="utf-8")


def data(name: str, file: str) -> Any:
    """Return a committed JSON file of a report."""
    return json.loads((folders()[name] / file).read_text(encoding="utf-8"))


def rows(name: str, file: str) -> list[dict[str, str]]:
    """Return the rows of a committed CSV file of a report."""
    with (folders()[name] / file).open(encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(stream))


def search(pattern: str, text: str) -> re.Match[str]:
    """Return the first match of a pattern.

    Parameters
    ----------
    pattern : str
        Regular expression; ``^`` is the start of a line.
    text : str
        Text of a report.

    Raises
    ------
    ValueError
        If the report no longer says it.
    """
    found = re.search(pattern, text, re.MULTILINE)
    if found is None:
        raise ValueError(f"no report says {pattern!r}")
    return found


def tables() -> Figures:
    """Return tables of reports, without rows that nothing was asked of."""
    headings = {"first_plan": "| instead | reference planets detected"}
    headings["reach"] = "| drift (nm) | V = 1"
    headings["whatif"] = "|  | asked | found | met |"
    return {name: table_of(report(name), heading) for name, heading in headings.items()}


def table_of(text: str, heading: str) -> str:
    """Return the table of a report that begins with a heading, without rows that nothing was asked of.

    Parameters
    ----------
    text : str
        Text of a report.
    heading : str
        Start of the table's first line.
    """
    lines = text.splitlines()
    start = next(number for number, line in enumerate(lines) if line.startswith(heading))
    table = itertools.takewhile(lambda line: line.startswith("|"), lines[start:])
    return "\n".join(line for line in table if "|  | +" not in line)


def plan() -> Figures:
    """Return figures of the first plan."""
    text = report("first_plan")
    ratio = search(r"SNR: ([\d.]+) \+- ([\d.]+) over (\d+) measurements", text)
    counts = search(r"(\d+) stars ranked, (\d+) with a reference planet", text)
    seconds = {
        what: float(search(pattern, text)[1])
        for what, pattern in (("etc_s", r"`cpic etc .*?\| ([\d.]+) \|"), ("rank_s", r"`cpic rank`.*?\| ([\d.]+) \|"))
    }
    return {
        "ratio": f"{ratio[1]} ± {ratio[2]}",
        "measurements": ratio[3],
        "stars": counts[1],
        "detected": counts[2],
        **{name: count for count, name in re.findall(r"(\d+) limited by (\w+)", text)},
        **{name: f"{value:.1f}" for name, value in seconds.items()},
        "plan_s": search(r"plan of 5 targets x 4 bands, .*?1 run \| (\d+) \|", text)[1],
    }


def whatif() -> Figures:
    """Return figures of the report of what-ifs: strategies, seasons, assumed contrasts."""
    strategies = {item["name"]: item for item in data("whatif", "whatif.json")["strategies"]}
    best = max(strategies.values(), key=lambda item: item["new_planets"]["mean"])
    single = strategies["single_visit"]
    results = data("whatif", "results.json")
    seasons, optics = results["seasons"], results["optics"]

    def ends(key: str) -> str:
        return " to ".join(f"{end(row[key] for row in optics):.2f}" for end in (min, max))

    return {
        "best": best["name"],
        "best_planets": f"{best['new_planets']['mean']:.2f}",
        "best_h": f"{best['hours']['mean']:.0f}",
        "single_planets": f"{single['new_planets']['mean']:.2f}",
        "single_h": f"{single['hours']['mean']:.0f}",
        "alarms": f"{best['background_alarms']['mean']:.1f}",
        "start": seasons["start_utc"][:10],
        "stars": str(seasons["stars"]),
        "days": f"{seasons['days'][2]:.0f}",
        "minutes": f"{seasons['minutes'][2]:.0f}",
        "period": f"{seasons['period_min']:.1f}",
        "optics": ends("ratio"),
        "scaled": ends("scaled"),
    }


def visits() -> Figures:
    """Return how the calculator stands against images of programmes of visits."""
    found = search(r"^\| mean of the references \| \d+ \| ([\d.]+ ± [\d.]+) \|", report("programmes"))
    return {"ratio": found[1]}


def albedo() -> Figures:
    """Return the largest errors of the parametric albedo; "at most" rounds up."""
    errors = rows("spectra", "errors.csv")
    worst = {kind: max(float(row[f"{kind}_median_2au"]) for row in errors) for kind in ("fitted", "held_out")}
    return {kind: f"{math.ceil(1000 * value) / 1000:.3f}" for kind, value in worst.items()}


def imaging() -> Figures:
    """Return the rows of the tiers: time of four bands, and the largest error of any band."""
    text, found = report("imaging_speed"), {}
    for tier in ("quick", "standard", "reference"):
        bands = re.findall(rf"^\| `{tier}` \| F\d+ \| (.*) \|$", text, re.MULTILINE)
        errors = zip(*([float(value) for value in row.split("|")] for row in bands), strict=True)
        seconds = search(rf"^\| four bands, 137 px, `{tier}` \| ([\d.]+) \|", text)[1]
        found[tier] = f"| `{tier}` | {seconds} | {' | '.join(f'{max(column):.0e}' for column in errors)} |"
    return found


def dial() -> Figures:
    """Return the table of the tiers over all scenes, and how random scenes fared under a tolerance."""
    text = report("speed_accuracy").split("## Tiers over ")[1]
    tiers = re.findall(r"^\| (?:closed form|`\w+`) \|.*\|$", text, re.MULTILINE)[:4]
    scenes, sums = rows("effect_ledger", "scenes.csv"), rows("effect_ledger", "sums.csv")
    missed = sum(row["kept"] != "True" for row in scenes)
    return {
        "tiers": "\n".join(tiers),
        "scenes": str(len(scenes)),
        "missed": str(missed or "none"),
        "bound": f"{100 * beta.ppf(0.95, missed + 1, len(scenes) - missed):.2f}",
        "faster": f"{median(float(row['speed_up']) for row in scenes):.1f}",
        "summed": f"{median(float(row['speed_up']) for row in sums):.0f}",
    }


def camera() -> Figures:
    """Return times of whole frames in ms, from the baseline of the benchmarks."""
    jobs = json.loads(BASELINE.read_text(encoding="utf-8"))["jobs"]
    seconds = {name: job["seconds"] for name, job in jobs.items()}
    frames = {
        "dark": "dark, 30 s, gain 300",
        "star": "V = 5, 30 s, gain 300",
        "paper": "paper's example, 17 s, gain 20",
        "blooms": "paper's example, 300 s, gain 20",
    }
    flats = [1000 * value for job, value in seconds.items() if job.startswith("flat:")]
    return {
        **{name: f"{1000 * seconds[f'frame: {job}']:.0f}" for name, job in frames.items()},
        "flats": f"{min(flats):.0f} to {max(flats):.0f}",
    }


def paper() -> Figures:
    """Return how the numbers of the paper that the project follows stand beside ours."""
    beside = report("external")
    counts = search(r"^\| \[The paper of .*? \| .*? \| (\d+) \| (\d+) \| (\d+) \| 0 \|$", beside)
    text = report("paper_table1")
    ratios = search(r"At the contrasts of Table 1 our ratios are ([\d.]+) to\s+([\d.]+) times", text)
    off = search(r"leaves\s+one\s+row\s+(\d+)%\s+off", text)
    pairs = search(r"Of (\d+) pairs (\d+) fit within 5%", text)
    return {
        "numbers": counts[1],
        "agree": counts[2],
        "known": counts[3],
        "taken": str(beside.count("| taken from the paper") + beside.count("; taken from the paper")),
        "least": ratios[1],
        "most": ratios[2],
        "off": off[1],
        "pairs": pairs[1],
        "fitting": pairs[2],
    }


FIGURES: dict[str, Callable[[], Figures]] = {
    "table": tables,
    "plan": plan,
    "whatif": whatif,
    "visits": visits,
    "albedo": albedo,
    "imaging": imaging,
    "dial": dial,
    "camera": camera,
    "paper": paper,
}
"""Figures of the README by the name of their group."""


def filled(template: str, figures: Mapping[str, Figures]) -> str:
    """Return the text of a template with its figures.

    Parameters
    ----------
    template : str
        Text with ``{{ group.figure }}`` in it.
    figures : mapping of str to mapping of str to str
        Groups of figures.

    Raises
    ------
    jinja2.UndefinedError
        If it names a figure that is not there.
    """
    # It makes Markdown, in which nothing is escaped.
    environment = Environment(undefined=StrictUndefined, keep_trailing_newline=True, autoescape=False)  # noqa: S701
    return environment.from_string(template).render(figures)


def adopted(template: str, figures: Mapping[str, Figures], readme: str) -> str:
    """Return the template with the lines of a README that are not what it makes.

    Parameters
    ----------
    template : str
        Text with ``{{ group.figure }}`` in it.
    figures : mapping of str to mapping of str to str
        Groups of figures.
    readme : str
        What the template shall make.
    """
    # A figure of several lines is one line of the template: compare pieces, the lines of the template each filled.
    pieces = template.splitlines(keepends=True)
    made = [filled(piece, figures) for piece in pieces]
    lines = readme.splitlines(keepends=True)
    owner = [number for number, text in enumerate(made) for _ in text.splitlines()]
    matcher = difflib.SequenceMatcher(None, "".join(made).splitlines(keepends=True), lines, autojunk=False)
    taken: list[str] = []
    for kind, first, last, start, stop in matcher.get_opcodes():
        if kind != "equal":
            taken += lines[start:stop]
            continue
        for number, group in itertools.groupby(range(first, last), key=owner.__getitem__):
            held = [lines[start + place - first] for place in group]
            taken += [pieces[number]] if len(held) == owner.count(number) else held
    return "".join(taken)


def main(argv: Sequence[str] | None = None) -> int:
    """Write the README, or say that it is another one (exit code 1)."""
    parser = argparse.ArgumentParser(prog="python -m tools.readme", description="Fill the README with figures.")
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--check", action="store_true", help="write nothing, fail if README.md is another one")
    what.add_argument("--adopt", action="store_true", help="bring changed words of README.md into the template")
    options = parser.parse_args(argv)
    figures = {name: of() for name, of in FIGURES.items()}
    template, readme = TEMPLATE.read_text(encoding="utf-8"), README.read_text(encoding="utf-8")
    if options.adopt:
        TEMPLATE.write_text(adopted(template, figures, readme), encoding="utf-8")
        return 0
    made = filled(template, figures)
    if not options.check:
        README.write_text(made, encoding="utf-8")
    elif made != readme:
        names = ("README.md", "what its template makes")
        lines = difflib.unified_diff(readme.splitlines(), made.splitlines(), *names, lineterm="", n=0)
        print(*lines, "run make readme, or python -m tools.readme --adopt to keep its words", sep="\n", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
