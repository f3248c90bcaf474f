"""How firm answers of the closed forms are: the dial of the exposure-time calculator and its records."""

from __future__ import annotations

from collections.abc import Sequence

from cpic_planner.etc.answer import EtcAnswer
from cpic_planner.etc.stated_error import stated_error
from cpic_planner.models import AnswerFidelity, EtcFidelity
from simulator.knobs import Dial, dial_of

__all__ = ["closed_form_fidelity", "etc_dial", "etc_fidelity"]


def etc_dial(fidelity: str | None = None, tolerance: float | None = None) -> Dial:
    """The dial of the exposure-time calculator: as `simulator.knobs.dial_of`, but ``quick`` without any.

    ``quick`` are the closed forms alone, ``standard`` checks every answer in sums of frames, ``reference`` frame by
    frame. A tolerance takes the closed forms where their stated error meets it, and images elsewhere.

    Raises
    ------
    InputError
        If both are given, the name is unknown, or the tolerance is out of range.
    """
    return dial_of("quick" if fidelity is None and tolerance is None else fidelity, tolerance)


def closed_form_fidelity(index: int, answer: EtcAnswer) -> AnswerFidelity:
    """Record of one answer of the closed forms."""
    error = stated_error(answer.band, answer.separation_arcsec, answer.budget)
    return AnswerFidelity(
        answer=index,
        fidelity="quick",
        status="ok",
        reason="",
        message="",
        predicted_error=None if error is None else dict(error),
        closed_form_error=error,
        images=None,
    )


def etc_fidelity(answers: Sequence[EtcAnswer], dial: Dial, *, seed: int | None = None) -> EtcFidelity:
    """Record of all answers that have frames; of those without one of their own, that of the closed forms."""
    records = [
        answer.fidelity or closed_form_fidelity(index, answer)
        for index, answer in enumerate(answers)
        if answer.n_frames is not None
    ]
    return EtcFidelity(
        fidelity=dial.fidelity,
        tolerance=max(dial.tolerance.values()) if dial.fidelity == "custom" else None,
        seed=None if all(record.fidelity == "quick" for record in records) else seed,
        answers=records,
    )
