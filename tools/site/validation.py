"""The table of what was checked: claim, reference, tolerance asked and found, from the committed reports."""

import re
from dataclasses import dataclass

from tools.readme import report
from tools.site.markdown import cell

HEADING = "| claim | reference | tolerance asked | found | report |\n| --- | --- | --- | --- | --- |\n"
_SPECK = r"\d+(?:\.\d+)?(?:e-?\d+)?"


@dataclass(frozen=True)
class Check:
    """A claim, and where its report says what was asked and what was found.

    Attributes
    ----------
    claim, reference : str
        What is claimed, and what it was compared with.
    report : str
        Name of the report.
    pattern : str
        Regular expression with the groups ``asked`` and ``found``, perhaps ``met``, a cell that says "yes" if it is. A
        pattern without a group is the begin of a row of the report's table ``asked | found | met``.
    asked : str
        The tolerance, where the report states it in other words.
    """

    claim: str
    reference: str
    report: str
    pattern: str
    asked: str = ""


CHECKS: dict[str, tuple[Check, ...]] = {
    "The noise model and the calculator": (
        Check(
            "noise of an observation", "Monte Carlo, electron by electron", "etc_accuracy", "noise against Monte Carlo"
        ),
        Check(
            "least time of an observation",
            "brute-force search of exposures, frames and gains",
            "etc_accuracy",
            "least time against brute force",
        ),
        Check("every solution is found", "the same search", "etc_accuracy", "cases in which only one of the two"),
        Check(
            "contrast limit against time, no drift", "its exact slope", "etc_accuracy", "slope of the contrast limit"
        ),
        Check("speckle floor", "simulated images", "etc_accuracy", "plateaus of the contrast limit"),
    ),
    "Predictions against simulated images, measured blind": (
        Check("flux of planets", "planets that were injected", "blind_validator", "mean flux of injected planets"),
        Check("error of the flux", "scatter of injected planets", "blind_validator", "pull width of fluxes"),
        Check("error of the position", "scatter of injected planets", "blind_validator", "pull width of positions"),
        Check("false alarms", "the normal law", "blind_validator", "false alarms at 3 sigma"),
        Check(
            "no confirmation without a planet", "images without planets", "blind_validator", "confirmations at 5 sigma"
        ),
        Check("SNR of the calculator", "the whole chain of images", "blind_validator", "ETC against the chain"),
        Check("SNR of ranked stars", "blind measurement", "blind_validator", "predicted over recovered SNR"),
        Check("errors of the model are noticed", "a simulator altered on purpose", "blind_validator", "known factor"),
        Check(
            "SNR of programmes of visits",
            "images of programmes, reduced as one",
            "programmes",
            r"Asked: (?P<asked>[\d.]+ to [\d.]+) in[\s\S]*?^\| mean of the references \| \d+ \| (?P<found>[^|]+) \|",
        ),
    ),
    "Shortcuts against the whole": (
        Check(
            "scenes in which an omission exceeds its tolerance, 95 % bound",
            "the same scenes with every effect",
            "effect_ledger",
            r"upper 95 % bound of their rate",
        ),
        Check("speed of the closed forms", "the reference tier", "speed_accuracy", "wall clock of the reference"),
        Check("tier `standard`", "the reference tier", "speed_accuracy", "`standard` against the reference"),
        Check("tier `quick`", "the reference tier", "speed_accuracy", "`quick` against the reference"),
        Check(
            "images of scenes",
            "every source propagated by itself",
            "imaging_speed",
            rf"\| ours, the faintest and the brightest[^|]*\| (?P<asked>{_SPECK}) \| (?P<found>{_SPECK}) \|",
        ),
    ),
    "Surveys": (
        Check("90 % intervals of differences", "1000 repeats of surveys", "whatif", "nominal 90 % intervals"),
        Check("completeness", "brute-force draws", "whatif", "completeness against brute force"),
        Check("share of a circle in the dark hole", "closed form of the squares", "whatif", "share of a circle"),
        Check("one visit of one star", "completeness of the ranking", "whatif", "one visit of one star"),
    ),
}


def row(check: Check) -> str:
    """Return the row of a claim.

    Parameters
    ----------
    check : Check

    Raises
    ------
    ValueError
        If its report no longer says it.
    """
    pattern = check.pattern
    if "(?P<" not in pattern:
        pattern = rf"\| {re.escape(pattern)}[^|]*\| (?P<asked>[^|]+?) \| (?P<found>[^|]+?) \| (?P<met>[^|]*?) \|"
    said = re.search(rf"^.*?{pattern}", report(check.report), re.MULTILINE)
    if said is None:
        raise ValueError(f"no row of the report {check.report} says {check.pattern!r}")
    groups = said.groupdict()
    asked = check.asked or groups["asked"]
    found = groups["found"] + ("" if groups.get("met", "yes") == "yes" else " (**not met**)")
    link = f"[{check.report}](../reports/{check.report}.md)"
    return f"| {' | '.join(map(cell, (check.claim, check.reference, asked, found, link)))} |"


def page() -> str:
    """Return all claims by section."""
    return "\n".join(
        f"## {title}\n\n{HEADING}" + "\n".join(map(row, checks)) + "\n" for title, checks in CHECKS.items()
    )
