"""From solved frames to typed answers."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from cpic_core import FloatArray, NDArray, Reason, Status
from cpic_planner.etc import budget
from cpic_planner.etc.cases import BandCases
from cpic_planner.etc.detection import Chances, needed_margin, verdict_of, visit_chances
from cpic_planner.etc.fidelity import speckle_error_extrapolated
from cpic_planner.etc.frames import FrameChoice, FrameProblem, best_exposure_s, best_in_visit, smooth_least_visit_s
from cpic_planner.etc.noise import StackNoise, own_noise, snr_paper
from cpic_planner.results import EtcAnswer, Question
from simulator.signal import frame_limit

_NO_THRESHOLD = "fewer than three resolution elements at this separation: no threshold is defined (give a plain sigma)"
_LONGEST_S = 1e12
_ROUNDING = 1e-9
_UNIT: dict[Question, str] = {"exposure_time": "s", "signal_to_noise": "", "contrast_limit": "contrast"}


@dataclass(frozen=True, eq=False)
class Solved:
    """Frames that answer a question in one band, planets within stars.

    Attributes
    ----------
    cases, problem, choice
        What was asked, and the frames found.
    question : str
    value : ndarray
        The answers; ``inf`` where a contrast limit lies above 1.
    time_s : float, optional
        Wall time that was given.
    level : ndarray, optional
        SNR or significance to reach.
    with_planet : bool
        Whether the level is an SNR, with the planet's own noise.
    """

    cases: BandCases
    problem: FrameProblem
    choice: FrameChoice
    question: Question
    value: FloatArray
    time_s: float | None = None
    level: FloatArray | None = None
    with_planet: bool = True

    def answers(self) -> list[EtcAnswer]:
        """Return the answers, planets within stars."""
        cases, problem, choice, question = self.cases, self.problem, self.choice, self.question
        model, time_s, limit = cases.model, self.time_s, question == "contrast_limit"
        camera = model.camera(cases.band)
        noise = cases.noise(choice)
        factors = budget.remedies(cases, choice, noise)
        setting = choice.exposure_s, choice.n_frames, choice.em_gain
        paper = snr_paper(cases.rates, *setting, camera, reference_ratio=model.strategy.reference_ratio)
        wall = model.time_s(choice.visit_s)
        if time_s is not None:  # never more than what was given, not even by rounding
            wall = np.minimum(wall, time_s)
        shown = {"exposure_s": choice.exposure_s, "em_gain": choice.em_gain, "time_s": wall, "snr_paper": paper}
        shown |= {"snr": noise.snr, "significance": noise.significance}
        lost = (choice.n_frames < 1) & cases.usable
        most = _Most.of(cases, problem, lost, self.level if question == "exposure_time" else None)
        detection = None if limit else _Detection.of(cases, choice, noise, time_s)
        answers = []
        for case in np.ndindex(*cases.contrast.shape):
            head = cases.head(*case) | {"question": question, "unit": _UNIT[question]}
            head["contrast"] = None if limit else float(cases.contrast[case])
            level = None if self.level is None else float(self.level[case])
            head["level"] = level if level is not None and math.isfinite(level) else None
            status, reason, message = self._standing(most, case, level)
            if detection is not None:
                head |= detection.fields(status, reason, most, case)
            head |= {"status": status, "reason": reason, "message": message}
            if status is not Status.OK:
                answers.append(EtcAnswer(value=None, **head))
                continue
            if not limit:
                head["flags"] += cases.planet_notes(*case)
            left_s = 0.0 if time_s is None else float(model.visit_s(time_s)) - float(choice.visit_s[case])
            room = left_s > float(choice.exposure_s[case]) + camera.readout_s  # for another frame
            if time_s is not None and wall[case] < 0.999 * time_s and room:
                head["flags"] += ("shorter_visit_is_better",)
            if choice.exposure_s[case] > camera.exposure_max_s * (1.0 + 1e-12):
                head["flags"] += ("exposure_beyond_max",)
            if speckle_error_extrapolated(cases.band, head["separation_arcsec"]):
                head["flags"] += ("speckle_error_extrapolated",)
            binding = budget.binding_limits(problem, cases.rates, choice, case)
            value, frames = float(self.value[case]), int(choice.n_frames[case])
            terms = {f"{name}_e2": float(term[case]) for name, term in noise.terms.items()}
            fields: dict[str, Any] = head | {name: float(array[case]) for name, array in shown.items()}
            fields |= {
                "contrast": value if limit else head["contrast"],
                "n_frames": frames,
                "integration_s": frames * fields["exposure_s"],
                "exposure_limited_by": binding.exposure,
                "gain_limited_by": binding.gain,
                "gain_caps": binding.caps,
                "budget": {"signal_e": float(noise.signal_e[case])} | terms,
                "dominant": budget.largest_term(noise, case),
                "remedies": {name: float(factor[case]) for name, factor in factors.items()},
            }
            answers.append(EtcAnswer(value=value, **fields))
        return answers

    def _standing(self, most: "_Most", index: tuple[int, ...], level: float | None) -> tuple[Status, Reason, str]:
        """Status of one case, with the reason and a sentence where it is not ok."""
        place = self.cases.places[index[1]]
        if place[0] is not Status.OK:
            return place
        if self.question != "contrast_limit" and self.cases.contrast[index] <= 0.0:
            return Status.UNREACHABLE, Reason.NO_LIGHT, "the planet sends no light in this band and phase"
        if level is not None and not math.isfinite(level):
            return Status.UNREACHABLE, Reason.TOO_FEW_ELEMENTS, _NO_THRESHOLD
        if self.choice.n_frames[index] >= 1:
            if not math.isfinite(self.value[index]):
                return Status.UNREACHABLE, Reason.INSUFFICIENT_TIME, "no contrast below 1 is detected in this time"
            return Status.OK, Reason.NONE, ""
        camera, fixed = self.problem.camera, self.cases.fixed
        gain = self.problem.fixed_gain() or 1.0
        saturated = frame_limit(*self.problem.peaks_e_s(index), camera.exposure_min_s, gain, camera)
        if saturated is not Reason.NONE:
            longest = float(most.longest_s[index])
            shorter = fixed.exposure_s is not None or longest > 0
            advice = f"up to {longest:.3g} s does not" if shorter else "no exposure does"
            text = f"a frame of {camera.exposure_min_s:g} s at EM gain {gain:g} saturates; {advice}"
            return Status.SATURATED, saturated, text
        if math.isinf(most.cost[index]):
            text = f"at EM gain {gain:g} every pixel of the aperture counts in each frame: photons cannot be told apart"
            return Status.SATURATED, Reason.TOO_BRIGHT_TO_COUNT, text
        if self.question == "exposure_time" and _LONGEST_S < most.visit_s[index] < math.inf:
            text = "it takes more frames than can be planned"
            return Status.UNREACHABLE, Reason.TOO_MANY_FRAMES, text
        if self.question == "exposure_time":
            name = "SNR" if self.with_planet else "significance"
            wanted = f"{level:.4g}" if level is not None and level < 1e4 else f"{level:g}"
            text = f"the speckle residual keeps the {name} below {wanted} whatever the time"
            calm_s = float(self.cases.model.time_s(most.calm_visit_s[index]))
            calm = "the planet would still be too faint"
            if calm_s <= budget.LONGEST_TIME_S:
                calm = f"it would take {calm_s:.3g} s"
            text = f"{text}; the most is {most.snr[index]:.4g}, and without drift of the wavefront {calm}"
            return Status.UNREACHABLE, Reason.SPECKLE_FLOOR, text
        text = "the time does not hold one science frame with its share of reference frames"
        return Status.UNREACHABLE, Reason.NO_TIME, text


@dataclass(frozen=True)
class _Most:
    """What cases without an answer could reach, solved together; 0 for the others.

    Longest exposure, least ``G`` (`inf` for none), visit for the level if frames need not be whole, highest SNR of any
    visit, and the visits for the level without speckles and without background.
    """

    longest_s: FloatArray
    cost: FloatArray
    visit_s: FloatArray
    snr: FloatArray
    calm_visit_s: FloatArray
    dark_visit_s: FloatArray

    @classmethod
    def of(cls, cases: BandCases, problem: FrameProblem, lost: NDArray[np.bool_], level: FloatArray | None) -> "_Most":
        parts = np.zeros((6, *lost.shape))
        parts[4:] = np.inf
        if lost.any():
            part = problem.at(lost)
            cost = best_exposure_s(part)[1]
            parts[0, lost], parts[1, lost] = part.longest_s(), cost
            if level is not None:
                wanted = np.where(np.isfinite(level), level, 1.0)[lost]
                parts[2, lost] = smooth_least_visit_s(part, wanted, cost)
                best = best_in_visit(part, np.full(wanted.shape, _LONGEST_S))
                parts[3, lost] = np.where(best.n_frames >= 1, best.inverse_snr2**-0.5, 0.0)
                parts[4, lost] = smooth_least_visit_s(budget.without_speckles(part), wanted, cost)
                own = np.broadcast_to(own_noise(cases.rates, problem.camera), lost.shape)[lost]
                parts[5, lost] = smooth_least_visit_s(budget.without_background(part, own), wanted)
        return cls(*parts)


@dataclass(frozen=True)
class _Detection:
    """Whether the planets of answers are detected, how likely, and what would make them so; arrays of the cases."""

    detected: NDArray[np.bool_]
    chances: Chances
    calm: NDArray[np.bool_]
    dark: NDArray[np.bool_]
    longest_s: float

    @classmethod
    def of(cls, cases: BandCases, choice: FrameChoice, noise: StackNoise, time_s: float | None) -> "_Detection":
        model, band = cases.model, cases.band
        possible = (choice.n_frames >= 1) & cases.usable
        with np.errstate(invalid="ignore"):
            margin = np.where(possible, noise.significance / cases.threshold, 0.0)
        wanted = np.broadcast_to(needed_margin(model, band) * cases.threshold, margin.shape)
        detected = margin >= needed_margin(model, band) * (1.0 - _ROUNDING)
        chances = visit_chances(model, band, np.hypot(cases.x_arcsec, cases.y_arcsec), choice.visit_s, noise, margin)
        calm, dark = np.zeros((2, *margin.shape), bool)
        lost = possible & ~detected
        if lost.any():
            problem = cases.problem("significance")
            part, level = problem.at(lost), wanted[lost]
            visit = choice.visit_s[lost] if time_s is None else np.full(level.shape, float(model.visit_s(time_s)))
            own = np.broadcast_to(own_noise(cases.rates, problem.camera), lost.shape)[lost]
            changed = budget.without_speckles(part), budget.without_background(part, own)
            # Counting is a background, too: only without it are both problems of one kind.
            together = [FrameProblem.stacked(changed)] if part.counting is None else changed
            calm[lost], dark[lost] = np.reshape([budget.reached(one, visit, level) for one in together], (2, -1))
        return cls(detected, chances, calm, dark, float(model.visit_s(budget.LONGEST_TIME_S)))

    def fields(self, status: Status, reason: Reason, most: _Most, index: tuple[int, ...]) -> dict[str, Any]:
        """Fields of one answer."""
        answered, detected = status is Status.OK, bool(self.detected[index])
        blind, known = (float(part[index]) for part in (self.chances.blind, self.chances.known_place))
        calm, dark = self.calm[index], self.dark[index]
        if not answered:
            calm, dark = (visit[index] <= self.longest_s for visit in (most.calm_visit_s, most.dark_visit_s))
        return {
            "verdict": verdict_of(status, detected),
            "verdict_mode": "known_place",
            "detection_probability": blind if answered and math.isfinite(blind) else None,
            "detection_probability_known_place": known if answered and math.isfinite(known) else None,
            "limited_by": budget.limit_of(
                status, reason, detected=detected, without_speckles=bool(calm), without_background=bool(dark)
            ),
        }
