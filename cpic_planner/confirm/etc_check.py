"""Answers of the exposure-time calculator at a setting of the dial: closed forms alone, or checked in images."""

import math
from collections.abc import Callable, Sequence

from cpic_core import InputError, Outcome, check_whole
from cpic_planner.etc import EtcModel, closed_form_fidelity
from cpic_planner.queries import ReferencePlanet
from cpic_planner.results import AnswerFidelity, EtcAnswer, ImageCheck
from cpic_planner.targets import Targets
from simulator.knobs import Dial

MAX_REALISATIONS = 100_000


def needs_images(answer: EtcAnswer, dial: Dial) -> bool:
    """Return whether an answer is checked in images at a setting of the dial."""
    if answer.n_frames is None or dial.fidelity == "quick":
        return False
    error = closed_form_fidelity(0, answer).closed_form_error
    if dial.fidelity != "custom" or error is None:
        return True
    return any(value > dial.tolerance[name] for name, value in error.items())


def checked_answers(
    model: EtcModel,
    stars: Sequence[Targets],
    answers: Sequence[EtcAnswer],
    planets: Sequence[ReferencePlanet | None],
    dial: Dial,
    *,
    seed: int = 1,
    realisations: int | None = None,
    advance: Callable[[str, int], None] = lambda text, steps: None,
) -> list[EtcAnswer]:
    """Return the same answers with their stated errors, checked in images where the dial asks for it.

    Parameters
    ----------
    model : EtcModel
        That gave the answers.
    stars : sequence of Targets
        The star of each answer.
    answers : sequence of EtcAnswer
    planets : sequence of ReferencePlanet or None
        The planet of each answer; None for a given contrast and for a contrast limit, whose planet is grey.
    dial : Dial
        `simulator.knobs.dial_of`.
    seed : int
        Of the images, 0 to 2**63 - 1.
    realisations : int, optional
        Draws of drift and noise of each answer in images, 1 to 100000; as many as tell the SNR to 5 % by default (see
        `cpic_planner.confirm.etc_images`).
    advance : callable
        Told the name of an answer and the per cent of its images that were done since.

    Returns
    -------
    list of EtcAnswer
        In order, values as they were; ``fidelity`` is set for those that have frames.

    Raises
    ------
    InputError
        For realisations out of range, or given where the dial leaves no choice of them.
    """
    check_whole("seed", seed, 0, 2**63 - 1)
    if realisations is not None:
        check_whole("realisations", realisations, 1, MAX_REALISATIONS)
        if dial.fidelity in ("quick", "custom"):
            allowed = "with fidelity standard or reference"
            hint = "closed forms draw none, and a tolerance sets their number"
            raise InputError("realisations", realisations, allowed=allowed, hint=hint)
    found = []
    for index, (star, answer, planet) in enumerate(zip(stars, answers, planets, strict=True)):
        if answer.n_frames is None:
            found.append(answer)
            continue
        record = closed_form_fidelity(index, answer, of_table=model.of_table)
        if needs_images(answer, dial):
            from cpic_planner.confirm.etc_images import check_in_images

            progress = _Progress(f"{answer.target} {answer.band}", advance)
            outcome = check_in_images(
                model,
                star,
                answer,
                planet,
                dial,
                seed=seed,
                realisations=realisations,
                stated_snr_error=(record.closed_form_error or {}).get("snr", 0.0),
                progress=progress,
            )
            progress(1.0)
            record = _checked(record, outcome, dial)
        found.append(answer.checked(record))
    return found


class _Progress:
    """Shares of the work of an answer, told in whole per cent since the last time."""

    def __init__(self, name: str, advance: Callable[[str, int], None]) -> None:
        self._name, self._advance, self._percent = name, advance, 0

    def __call__(self, done: float) -> None:
        before, self._percent = self._percent, int(100 * done)
        self._advance(self._name, self._percent - before)


def _checked(record: AnswerFidelity, outcome: Outcome[ImageCheck], dial: Dial) -> AnswerFidelity:
    """Return what is said of an answer once images were asked for."""
    images = outcome.value
    if images is None:  # nothing but the closed forms answers
        refused = {"status": outcome.status.value, "reason": outcome.reason.value, "message": outcome.message}
        return record.model_copy(update=refused)
    error, chance = dict(images.modelled.predicted_error), images.snr_error / images.predicted_snr
    bound = error["snr"]
    error["snr"] = None if bound is None else math.hypot(bound, chance)
    tier = "reference" if dial.fidelity == "reference" else "standard"
    return record.model_copy(update={"fidelity": tier, "predicted_error": error, "images": images})
