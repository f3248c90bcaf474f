"""Answer ``cpic etc`` whole about one star or known planet, for the command line and for pages alike."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from catalogs import open_catalogue
from cpic_planner import report
from cpic_planner.api.etc import as_asked, checked, closed_forms
from cpic_planner.api.keywords import catalogue_of, model_of
from cpic_planner.api.named import named
from cpic_planner.etc import EtcModel, etc_result
from cpic_planner.queries import EtcQuestion
from cpic_planner.queries.etc import PLACES
from cpic_planner.results import EtcAnswer, EtcResult
from cpic_planner.targets import Targets

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from rich.console import Console

Check = Callable[[EtcQuestion, EtcModel, Sequence[Targets], Sequence[EtcAnswer]], Sequence[EtcAnswer]]
"""Checks answers in images, as `cpic_planner.api.checked`."""


@dataclass(frozen=True, eq=False)
class Answered:
    """A question about one star with its answer.

    Attributes
    ----------
    question : EtcQuestion
        As it is answered: a known planet is looked for at its place.
    model : EtcModel
    star : Targets
    result : EtcResult
    placed : bool
        Whether the question gives the separation.
    """

    question: EtcQuestion
    model: EtcModel
    star: Targets
    result: EtcResult
    placed: bool

    @property
    def found(self) -> bool:
        """Tell whether there is an answer, and of a planet a detection."""
        rows = self.result.answers
        return any(row.status == "ok" if row.verdict is None else row.verdict == "detected" for row in rows)

    def print(self, console: Console, *, every_budget: bool = False, explain: bool = False) -> None:
        """Print the answer, see `cpic_planner.report.print_etc`."""
        asked = report.question_text(self.question)
        about: dict[str, Any] = {"asked": asked, "placed": self.placed}
        report.print_etc(self.result, console, every_budget=every_budget, explain=explain, **about)
        report.print_fidelity(self.result, console)

    def figure(self) -> Figure:
        """Draw SNR against time, the contrast limit against separation, and the noise budgets."""
        question, result = self.question, self.result
        best, allowed = report.best_row(result), question.wall_s
        if best is not None and best.time_s is not None and (question.asks_time or question.n_frames is not None):
            allowed = best.time_s
        settings: dict[str, Any] = {name: getattr(question, name) for name in ("snr", "sigma", "exposure_s", "em_gain")}
        rows = result.answers
        curves = report.etc_curves(self.model, self.star, rows, time_s=allowed, best_band=result.best_band, **settings)
        return report.etc_figure(result, curves)


def answered(
    question: EtcQuestion, *, check: Check = checked, tell: Callable[..., None] = lambda *texts: None
) -> Answered:
    """Answer a question about one star or known planet.

    Parameters
    ----------
    question : EtcQuestion
        Its first target counts.
    check : callable
        Called where the question asks for images.
    tell : callable
        Told the notes of the star table before the work.

    Raises
    ------
    InputError
        For an unknown star or band, or a value out of range.
    """
    table = open_catalogue(question.catalog) if question.v_mag is None else catalogue_of(question)
    star, about, known = named(question, question.target[0], table)
    if table.kind != "snapshot":
        about = "; ".join(filter(None, (about, f"star data: {table.provenance}")))
    star, asked_for = as_asked(question, star), question.hashed()
    if known is None:
        model = model_of(question)
        found: Sequence[EtcAnswer] = closed_forms(question, model, star)
    else:
        question = known.question(question)
        model, found = model_of(question), known.answers(question, star)
        asked_for |= {"known_planet": known.content()}
    if question.dial.fidelity != "quick":
        found = check(question, model, [star], found)
    planet = question.planet[0] if isinstance(question.planet, tuple) else question.planet
    hypothetical = None if question.contrast_limit or question.contrast is not None or known else planet
    notes = [*table.notes, *(() if known is None else known.choice.table.notes)]
    labels: dict[str, Any] = {"note": about, "notes": notes, "catalogue": table.provenance, "planet": hypothetical}
    seed = 1 if question.seed is None else question.seed
    result = etc_result(model, star, found, asked=asked_for, dial=question.dial, seed=seed, **labels)
    placed = known is not None or any(getattr(question, place) is not None for place in PLACES)
    return Answered(question, model, star, result, placed)
