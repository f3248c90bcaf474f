"""Write the report of a comparison of survey strategies into its folder."""

from __future__ import annotations

from cpic_planner.jobs.folder import RunFolder
from cpic_planner.models.surveyed import WhatIfResult
from cpic_planner.report.tables import targets_csv

PRODUCTS = ("targets.csv", "report.html")
"""Names of the files of a report."""


def write_whatif(folder: RunFolder, result: WhatIfResult) -> None:
    """Write ``targets.csv`` and ``report.html``, each whole; the same bytes for the same result.

    Parameters
    ----------
    folder : RunFolder
    result : WhatIfResult
    """
    from cpic_planner.report.html import render_whatif
    from cpic_planner.report.whatif_figures import whatif_figures

    folder.write("targets.csv", targets_csv(result))
    folder.write("report.html", render_whatif(result, whatif_figures(result)))
