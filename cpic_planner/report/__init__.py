"""Reports: tables, figures, the HTML page and terminal tables.

Names load on first use, so that importing the package costs nothing.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from cpic_planner.report.console import print_plan
    from cpic_planner.report.console_confirm import print_confirm
    from cpic_planner.report.console_etc import print_etc
    from cpic_planner.report.console_rank import print_explanation, print_rank, print_sensitivity
    from cpic_planner.report.contrast_figure import HoleEdges, LimitCurve
    from cpic_planner.report.html import plan_html, render_confirm, render_plan
    from cpic_planner.report.names import pretty_name
    from cpic_planner.report.panels import Panels
    from cpic_planner.report.tables import measurements_csv, ranking_csv, ranking_ecsv
    from cpic_planner.report.write import write_report
    from cpic_planner.report.write_confirm import write_confirm_report

__all__ = [
    "HoleEdges",
    "LimitCurve",
    "Panels",
    "measurements_csv",
    "plan_html",
    "pretty_name",
    "print_confirm",
    "print_etc",
    "print_explanation",
    "print_plan",
    "print_rank",
    "print_sensitivity",
    "ranking_csv",
    "ranking_ecsv",
    "render_confirm",
    "render_plan",
    "write_confirm_report",
    "write_report",
]

_HOME = {
    "HoleEdges": "contrast_figure",
    "LimitCurve": "contrast_figure",
    "Panels": "panels",
    "measurements_csv": "tables",
    "plan_html": "html",
    "pretty_name": "names",
    "print_confirm": "console_confirm",
    "print_etc": "console_etc",
    "print_explanation": "console_rank",
    "print_plan": "console",
    "print_rank": "console_rank",
    "print_sensitivity": "console_rank",
    "ranking_csv": "tables",
    "ranking_ecsv": "tables",
    "render_confirm": "html",
    "render_plan": "html",
    "write_confirm_report": "write_confirm",
    "write_report": "write",
}


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return sorted(__all__)
