"""The three questions of an exposure-time calculator, answered by type, for targets x bands x planets at once.

An observation is a programme of visits that are reduced together. Where the strategy does not say how many, the best
number is chosen for every case (`cpic_planner.etc.cases`), and frames are whole.
"""

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from cpic_core import FloatArray, InputError, NDArray, Reason, Record, Status
from cpic_planner.etc import budget
from cpic_planner.etc.cases import (
    Cases,
    Solution,
    Span,
    cases_by_camera,
    motion_factor,
    programme_columns,
    programme_fields,
)
from cpic_planner.etc.detection import verdict_of
from cpic_planner.etc.fidelity import etc_fidelity, speckle_error_extrapolated
from cpic_planner.etc.frames import FrameChoice, best_exposure_s, best_in_visit, smooth_least_visit_s
from cpic_planner.etc.model import EtcModel, Programme, check_range
from cpic_planner.etc.noise import MODES_LIMITED, StackNoise, error_noise, modes_obstacle, own_noise, snr_paper
from cpic_planner.etc.rates import Planets, planets_of
from cpic_planner.etc.searches import last_true, spread, whole_steps
from cpic_planner.queries import MAX_VISITS, ReferencePlanet
from cpic_planner.results import EtcAnswer, EtcResult, Question, ReferencePlanetRecord
from cpic_planner.targets import Targets
from cpic_planner.version import __version__
from simulator.config import content_hash
from simulator.knobs import Dial, dial_of
from simulator.signal import frame_limit

if TYPE_CHECKING:
    from cpic_planner.queries import ConfirmQuestion, EtcQuestion

_NO_THRESHOLD = "fewer than three resolution elements at this separation: no threshold is defined (give a plain sigma)"
_MOVES = (
    "the planet moves: a search over its orbits asks for more than {visits} visits reach; if it stood still it would "
    "take {time_s:.3g} s"
)
_FLOORS = (Reason.SPECKLE_FLOOR, Reason.COMMON_SPECKLE_FLOOR)
_LONGEST_S = 1e12
_ROUNDING = 1e-6
_ENDLESS = 1e12
_MOST_VISITS, _N_VISITS, _HALVINGS = 1e5, 64, 40
_FEW_OR_MANY = whole_steps(_MOST_VISITS, _N_VISITS).reshape(-1, 1, 1, 1)
_SHARES = np.linspace(0.0, 1.0, _N_VISITS)[:, None, None, None]
_CHANGES = ("without_speckles", "common", "without_background", "without_motion")
_UNIT: dict[Question, str] = {"exposure_time": "s", "signal_to_noise": "", "contrast_limit": "contrast"}


class _Answers(Solution, eq=False):
    """Frames that answer a question in bands of one camera; they become answers, planets within stars within bands.

    Attributes
    ----------
    question : str
    value : ndarray
        The answers; ``inf`` where a contrast limit lies above 1.
    span : Span
        Times and visits that were given.
    """

    question: Question
    value: FloatArray
    span: Span

    @property
    def with_planet(self) -> bool:
        """Tell whether the level is an SNR, with the planet's own noise."""
        return self.cases.objective == "snr"

    @property
    def searched(self) -> bool:
        """Tell whether the level is that of a detection, in the least time."""
        return self.question == "exposure_time" and self.cases.value is None

    def answers(self) -> list[EtcAnswer]:
        """Return the answers, planets within stars within bands."""
        cases, problem, choice, question = self.cases, self.problem, self.choice, self.question
        model, time_s, limit = cases.model, self.span.time_s, question == "contrast_limit"
        strategy, programme, camera = model.strategy, cases.programme, cases.free_camera
        noise = cases.noise(choice)
        factors = budget.remedies(cases, choice, noise)
        setting, ratio = (choice.exposure_s, choice.n_frames, choice.em_gain), strategy.reference_ratio
        paper = snr_paper(cases.rates, *setting, camera, reference_ratio=ratio, programme=programme)
        columns = programme_columns(model, cases.rates, cases.motion, programme, choice, time_s, self.span.given_s)
        visits, used = columns["visits"], spread(programme.n_modes, choice.visit_s.shape)
        given_s, few = time_s or 0.0, (choice.n_frames == 1) & (visits > 1)
        room = model.visit_s(given_s / visits) - choice.visit_s > choice.exposure_s + camera.readout_s  # for a frame
        marks = {
            "shorter_visit_is_better": room & (columns["time_s"] < 0.999 * given_s),
            "visits_at_limit": ((visits >= MAX_VISITS) | few) & (self.span.visits is None),
            "exposure_beyond_max": choice.exposure_s > camera.exposure_max_s * (1.0 + 1e-12),
        }
        shown = {"snr": noise.snr, "significance": noise.significance, "snr_paper": paper}
        undefined = (cases.value is None) & ~np.isfinite(cases.threshold)
        levels = np.where(undefined, math.inf, self.level)
        lost = (choice.n_frames < 1) & cases.usable
        most = self._most(lost)
        still_s = budget.time_at_rest_s(cases, self.span.visit_time_s) if self.searched and lost.any() else None
        detection = None if limit else self._detection(noise)
        inherited = budget.inherited_terms(model.instrument, model.instrument.band(cases.bands[0]).camera, noise)
        answers = []
        for case in np.ndindex(*cases.contrast.shape):
            band = cases.bands[case[0]]
            head = cases.head(*case) | {"question": question, "unit": _UNIT[question]}
            head["contrast"] = None if limit else float(cases.contrast[case])
            level = None if question == "signal_to_noise" else float(levels[case])
            head["level"] = level if level is not None and math.isfinite(level) else None
            status, reason, message = self._standing(most, case, level)
            if still_s is not None and reason in _FLOORS and still_s[case] <= budget.LONGEST_TIME_S:
                reason, message = Reason.PLANET_MOVES, _MOVES.format(visits=int(visits[case]), time_s=still_s[case])
            if detection is not None:
                head |= _detection_fields(detection, status, reason, most, case)
            head |= {"status": status, "reason": reason, "message": message, "n_modes": int(used[case])}
            obstacle = modes_obstacle(model, band)
            if obstacle is not None:
                head["flags"] += (obstacle,)
            elif used[case] < strategy.n_modes and not strategy.choose_modes and choice.n_frames[case] >= 1:
                head["flags"] += (MODES_LIMITED,)
            if status is not Status.OK:
                answers.append(EtcAnswer(value=None, **head))
                continue
            if not limit:
                head["flags"] += cases.planet_notes(*case)
            head["flags"] += tuple(filter(None, (str(inherited[case]), *(name for name in marks if marks[name][case]))))
            if not model.of_table and speckle_error_extrapolated(band, head["separation_arcsec"]):
                head["flags"] += ("speckle_error_extrapolated",)
            binding = budget.binding_limits(problem, cases.rates, choice, case)
            value = float(self.value[case])
            terms = {f"{name}_e2": float(term[case]) for name, term in noise.terms.items()}
            fields: dict[str, Any] = head | {name: float(array[case]) for name, array in shown.items()}
            fields |= programme_fields(model, columns, case) | binding
            fields |= {
                "contrast": value if limit else head["contrast"],
                "budget": {"signal_e": float(noise.signal_e[case])} | terms,
                "dominant": budget.largest_term(noise, case),
                "remedies": {name: float(factor[case]) for name, factor in factors.items()},
            }
            answers.append(EtcAnswer(value=value if question != "exposure_time" else fields["time_s"], **fields))
        return answers

    def _standing(
        self, most: dict[str, FloatArray], index: tuple[int, ...], level: float | None
    ) -> tuple[Status, Reason, str]:
        """Return the status of one case, with the reason and a sentence where it is not ok."""
        place = self.cases.places[index[0]][index[2]]
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
        camera, fixed = self.problem.camera, self.cases.exposure_s
        gain = self.problem.fixed_gain() or 1.0
        saturated = frame_limit(*self.problem.peaks_e_s(index), camera.exposure_min_s, gain, camera)
        if saturated is not Reason.NONE:
            longest = float(most["longest_s"][index])
            shorter = fixed is not None or longest > 0
            advice = f"up to {longest:.3g} s does not" if shorter else "no exposure does"
            text = f"a frame of {camera.exposure_min_s:g} s at EM gain {gain:g} saturates; {advice}"
            return Status.SATURATED, saturated, text
        if math.isinf(most["cost"][index]):
            text = f"at EM gain {gain:g} every pixel of the aperture counts in each frame: photons cannot be told apart"
            return Status.SATURATED, Reason.TOO_BRIGHT_TO_COUNT, text
        if self.question == "exposure_time" and _LONGEST_S < most["visit_s"][index] < math.inf:
            text = "it takes more frames than can be planned"
            return Status.UNREACHABLE, Reason.TOO_MANY_FRAMES, text
        if self.question == "exposure_time" and level is not None:
            return self._floor(most, index, level)
        text = "the time does not hold one science frame of every visit with its share of reference frames"
        return Status.UNREACHABLE, Reason.NO_TIME, text

    def _floor(self, most: dict[str, FloatArray], index: tuple[int, ...], level: float) -> tuple[Status, Reason, str]:
        """Return why no time reaches the level: the residual of so many visits, or of any number."""
        name, wanted = "SNR" if self.with_planet else "significance", f"{level:.4g}" if level < 1e4 else f"{level:g}"
        many = int(spread(self.cases.programme.visits, self.choice.n_frames.shape)[index])
        visits = "one visit" if many == 1 else f"{many} visits"
        length = f" of {self.span.visit_time_s:g} s" if self.span.visit_time_s is not None else ", whatever the length"
        common, what, where = most["endless"][index] <= level, "the speckle residual", f"in {visits}{length}"
        if common:
            what, where = "what science and references differ by in every visit", "however many visits there are"
        calm_s = many * float(self.cases.model.time_s(most["calm_visit_s"][index]))
        calm = "the planet would still be too faint"
        if calm_s <= budget.LONGEST_TIME_S:
            calm = f"it would take {calm_s:.3g} s"
        top = most["endless"][index] if common else most["snr"][index]
        text = f"{what} keeps the {name} below {wanted} {where}; the most is {top:.4g}, and without drift of the "
        reason = Reason.COMMON_SPECKLE_FLOOR if common else Reason.SPECKLE_FLOOR
        return Status.UNREACHABLE, reason, f"{text}wavefront {calm}"

    def _most(self, lost: NDArray[np.bool_]) -> dict[str, FloatArray]:
        """Return the most that cases without frames could reach, solved together; 0 for the others.

        Longest exposure, least ``G`` (`inf` for none), visit for the level if frames need not be whole, highest SNR of
        any visit, of any number of visits, and the visits for the level without speckles and without background.
        """
        cases, problem, programme = self.cases, self.problem, self.cases.programme
        names = ("longest_s", "cost", "visit_s", "snr", "endless", "calm_visit_s", "dark_visit_s")
        most = {name: np.full(lost.shape, np.inf if name in names[5:] else 0.0) for name in names}
        if not lost.any():
            return most
        part = problem.at(lost)
        cost = best_exposure_s(part)[1]
        most["longest_s"][lost], most["cost"][lost] = part.longest_s, cost
        if self.question == "exposure_time":
            wanted = self.level[lost]
            best = best_in_visit(part, np.full(wanted.shape, _LONGEST_S))
            errors = error_noise(cases.rates, problem.camera, cases.model.strategy, programme)
            if self.with_planet:
                errors = errors * (1.0 + 1.0 / cases.rates.background_apertures)
            calm = budget.without_speckles(part, spread(errors, lost.shape)[lost])
            own = spread(own_noise(cases.rates, problem.camera, programme), lost.shape)[lost]
            # A search asks for less where nothing is speckles, and its visits can be short.
            none = np.zeros_like(self.level), np.ones_like(self.level)
            least = cases.searched.level_at(programme)(*none)[lost] if self.searched else wanted
            most["visit_s"][lost] = smooth_least_visit_s(part, wanted, cost)
            most["snr"][lost] = np.where(best.n_frames >= 1, best.inverse_snr2**-0.5, 0.0)
            most["endless"][lost] = spread(budget.programme_floor(cases, _ENDLESS), lost.shape)[lost]
            most["calm_visit_s"][lost] = smooth_least_visit_s(calm, least)
            most["dark_visit_s"][lost] = smooth_least_visit_s(budget.without_background(part, own), wanted)
        return most

    def _detection(self, noise: StackNoise) -> dict[str, Any]:
        """Return whether planets are detected, how likely, and what would make it so: arrays by name."""
        cases, choice, programme = self.cases, self.choice, self.cases.programme
        model, strategy, searched = cases.model, cases.model.strategy, cases.searched
        possible = (choice.n_frames >= 1) & cases.usable & np.isfinite(cases.threshold)
        with np.errstate(invalid="ignore", divide="ignore"):
            inverse = np.where(possible, noise.significance**-2.0, np.inf)
        visit = np.where(possible, choice.visit_s, 1.0)
        level = searched.level(programme, self.problem)(visit, inverse)
        detected = possible & (noise.significance >= level * (1.0 - _ROUNDING))
        chances = searched.chances(visit, noise)
        calm, common, dark, moving = np.zeros((4, *level.shape), bool)
        lost, required = possible & ~detected, {}
        if lost.any():
            problem, chosen, time_s = cases.problem("significance"), self.span.visits is None, self.span.time_s
            # Without speckles one visit is best, unless the number is given, and no mode pays.
            alone = cases.problem("significance", programme=Programme.of(strategy, 1 if chosen else programme.visits))
            total_s = programme.visits * model.time_s(visit) if time_s is None else np.array(time_s)
            visits = spread(programme.visits, level.shape)
            each = spread(model.visit_s(total_s / visits), level.shape)
            whole = spread(model.visit_s(total_s), level.shape) if chosen else each
            own = spread(own_noise(cases.rates, problem.camera, programme), lost.shape)[lost]
            least = searched.level_at(programme)(np.zeros_like(level), visit)
            errors = spread(error_noise(cases.rates, problem.camera, strategy, programme), lost.shape)[lost]
            calm[lost] = budget.reached(budget.without_speckles(alone.at(lost), errors), whole[lost], least[lost])
            dark[lost] = budget.reached(budget.without_background(problem.at(lost), own), each[lost], level[lost])
            floor = spread(budget.programme_floor(cases, _ENDLESS), level.shape)
            common = calm & (floor <= least)
            paid = motion_factor(model, cases.motion, programme, visit)
            moving = noise.significance >= level / paid * (1.0 - _ROUNDING)
            required = _required(searched, choice, noise, level, lost)
        changes = {"without_speckles": calm, "common": common, "without_background": dark, "without_motion": moving}
        whether = {"search": strategy.search, "detected": detected, "chances": chances, "required": required}
        return whether | changes | {"longest_s": float(model.visit_s(budget.LONGEST_TIME_S))}


def _detection_fields(
    found: dict[str, Any], status: Status, reason: Reason, most: dict[str, FloatArray], index: tuple[int, ...]
) -> dict[str, Any]:
    """Return the fields of one answer about the detection of its planet (`_Answers._detection`)."""
    answered, detected = status is Status.OK, bool(found["detected"][index])
    blind, known = (float(part[index]) for part in (found["chances"].blind, found["chances"].known_place))
    changes = {name: bool(found[name][index]) for name in _CHANGES}
    if not answered:
        changes = {
            "without_speckles": bool(most["calm_visit_s"][index] <= found["longest_s"]),
            "common": reason is Reason.COMMON_SPECKLE_FLOOR,
            "without_background": bool(most["dark_visit_s"][index] <= found["longest_s"]),
            "without_motion": reason is Reason.PLANET_MOVES,
        }
    return {
        "verdict": verdict_of(status, detected),
        "verdict_mode": found["search"],
        "detection_probability": blind if answered and math.isfinite(blind) else None,
        "detection_probability_known_place": known if answered and math.isfinite(known) else None,
        "limited_by": budget.limit_of(status, reason, detected=detected, **changes),
    } | {
        f"required_{name}": (int if name == "visits" else float)(part[index])
        for name, part in found["required"].items()
        if answered and not detected and math.isfinite(part[index])
    }


def _required(
    cases: Cases, choice: FrameChoice, noise: StackNoise, level: FloatArray, lost: NDArray[np.bool_]
) -> dict[str, FloatArray]:
    """Return the changes that would make planets detected, one at a time; ``inf`` where no value does."""
    visits = spread(cases.programme.visits, level.shape)
    with np.errstate(divide="ignore", invalid="ignore"):
        brighter = level / noise.significance
        brighter = np.where(brighter * cases.contrast <= 1.0, brighter, np.inf)
    required = {
        "contrast_factor": brighter,
        "drift_factor": _calmer(cases, choice, noise),
        "visits": _more_visits(cases, choice),
        "time_s": visits * cases.model.time_s(cases.solved(visits)[0]),
    }
    return {name: np.where(lost, value, np.inf) for name, value in required.items()}


def _calmer(cases: Cases, choice: FrameChoice, noise: StackNoise) -> FloatArray:
    """Return the largest factor on the drift at which the same frames detect the planet; ``inf`` if not even 0 does."""
    programme, laws = cases.programme, cases.rates.parts
    crossed, light = (programme.law(law).variance(choice.visit_s) for law in laws)
    beating, shining = (law.averaging().law().variance(choice.visit_s) for law in laws)
    level = cases.level_at(programme)
    with np.errstate(divide="ignore", invalid="ignore"):
        whole = noise.speckle + noise.terms["common_speckle"]
        lit, averaged = np.nan_to_num(whole * light / (crossed + light)), np.nan_to_num(noise.speckle / whole)

    def reached(square: FloatArray) -> NDArray[np.bool_]:
        less = noise.errors * (1.0 - square)
        quiet = noise.quiet - less - whole + square * (whole - lit) + square**2 * lit
        with np.errstate(divide="ignore", invalid="ignore"):
            bright = np.nan_to_num(square * shining / (beating + square * shining)) * averaged
            needed = level(1.0 - (noise.white - less) / quiet, choice.visit_s, bright)
            return np.asarray(noise.signal_e / np.sqrt(quiet) >= needed)

    low = last_true(reached, noise.quiet.shape, _HALVINGS)
    return np.where(reached(np.zeros_like(low)) & (low > 0.0), np.sqrt(low), np.inf)


def _more_visits(cases: Cases, choice: FrameChoice) -> FloatArray:
    """Return the fewest visits of these frames that detect the planet, to 0.3 % beyond some 300, or ``inf``."""
    wall_s = cases.model.time_s(choice.visit_s)

    def enough(visits: FloatArray) -> NDArray[np.bool_]:
        made = cases.in_programme(cases.programme_of(visits, wall_s, choice))
        significance = made.noise(choice).significance
        with np.errstate(divide="ignore"):
            inverse = significance**-2.0
        level = made.level(made.programme, made.problem())(choice.visit_s, inverse)
        return np.asarray(significance >= level * (1.0 - _ROUNDING))

    grid = _FEW_OR_MANY
    reached = enough(grid)
    first = np.argmax(reached, axis=0)
    high, low = grid[first, 0, 0, 0], grid[np.maximum(first - 1, 0), 0, 0, 0]
    fine = np.ceil(low + _SHARES * (high - low))
    first = np.argmax(enough(fine), axis=0)[None]
    return np.where(reached.any(axis=0), np.take_along_axis(fine, first, axis=0)[0], np.inf)


_LIMIT_STEPS, _MODE_ROUNDS, _STILL = 60, 10, 1e-11
_CLOSE, _START = 1e-14, 1e-9
TRIAL_CONTRAST = 1e-8
"""Contrast of the planet that stands for all where a faintest one is looked for."""


Places: TypeAlias = float | Sequence[float] | Mapping[str, Sequence[float]]
"""Separations in arcsec, in all bands or by band, as many in each."""


def _planets(places: Places, planet: Any, contrast: Any) -> Planets | dict[str, Planets]:
    """Return the planets of a question, in all bands or by band."""
    if isinstance(places, Mapping):
        return {band: planets_of(of_band, planet, contrast) for band, of_band in places.items()}
    return planets_of(places, planet, contrast)


def signal_to_noise(
    model: EtcModel,
    target: Targets,
    *,
    time_s: float | None = None,
    visit_time_s: float | None = None,
    separation_arcsec: Places,
    bands: Sequence[str] | None = None,
    planet: ReferencePlanet | Sequence[ReferencePlanet] | None = None,
    contrast: float | Sequence[float] | None = None,
    exposure_s: float | None = None,
    em_gain: float | None = None,
    exact: bool = False,
    offsets_arcsec: tuple[float, float] | None = None,
) -> list[EtcAnswer]:
    """Return the SNR of planets in a given wall time.

    Parameters
    ----------
    model : EtcModel
        Its strategy may say the number of visits; otherwise that of highest SNR is chosen.
    target : Targets
        One star or more.
    time_s : float, optional
        Longest wall time of all visits, overheads and reference frames included, 1e-3 to 1e9 s. It may be left out
        where number and time of the visits are given.
    visit_time_s : float, optional
        Wall time of one visit.
    separation_arcsec : float, sequence of float, or mapping of str to these
        Projected separation, on the diagonal of a quadrant, 0 to 120; in all bands or by band.
    bands : sequence of str, optional
        All of the model by default.
    planet : ReferencePlanet or sequence, optional
        Gives the contrast when ``contrast`` is not given; the default reference planet otherwise.
    contrast : float or sequence of float, optional
        Planet-to-star ratio of detected rates, in every band, 0 to 1.
    exposure_s, em_gain : float, optional
        Fixed instead of optimised.
    exact : bool
        Use all of the time, although the walk of the wavefront can make shorter visits better.
    offsets_arcsec : tuple of float, optional
        A place in the dark hole at which all planets stand, instead of the diagonal at their separations.

    Returns
    -------
    list of EtcAnswer
        Targets in order, bands in theirs within each (by wavelength if none are given), planets within each band.
        ``value`` is the photometric SNR in the best programme of at most ``time_s``; ``time_s`` of the answer is what
        it uses (flag ``shorter_visit_is_better``).

    Raises
    ------
    InputError
        For values out of range, sequences of different lengths, and times that contradict each other.
    """
    span = Span.of(model, time_s, visit_time_s)
    fixed: dict[str, Any] = {"exposure_s": exposure_s, "em_gain": em_gain, "offsets_arcsec": offsets_arcsec}
    every = cases_by_camera(model, target, bands, _planets(separation_arcsec, planet, contrast), snr=1.0, **fixed)
    solved = [cases.in_time(span, exact) for cases in every]
    with np.errstate(divide="ignore"):
        values = [1.0 / np.sqrt(one.choice.inverse_snr2) for one in solved]
    return _answers(solved, "signal_to_noise", values, span, model.named(bands))


def exposure_time(
    model: EtcModel,
    target: Targets,
    *,
    snr: float | None = None,
    sigma: float | None = None,
    detect: bool = False,
    visit_time_s: float | None = None,
    separation_arcsec: Places,
    bands: Sequence[str] | None = None,
    planet: ReferencePlanet | Sequence[ReferencePlanet] | None = None,
    contrast: float | Sequence[float] | None = None,
    exposure_s: float | None = None,
    em_gain: float | None = None,
) -> list[EtcAnswer]:
    """Return the least wall time that reaches an SNR or a detection; ``unreachable`` below the speckle floor.

    Parameters
    ----------
    model, target, separation_arcsec, bands, planet, contrast, exposure_s, em_gain
        As `signal_to_noise`.
    snr : float, optional
        Photometric SNR, 1e-6 to 1e6.
    sigma : float, optional
        Plain significance (noise without the planet), 1e-6 to 1e6.
    detect : bool
        Ask for a detection as the strategy searches: by half of such programmes. One of the three is given.
    visit_time_s : float, optional
        Wall time of one visit: the least number of them is asked for.

    Returns
    -------
    list of EtcAnswer
        ``value`` is ``time_s``, exactly the inverse of `signal_to_noise` (for ``snr``) and of `contrast_limit` (for
        ``sigma`` and ``detect``) of as many visits.

    Raises
    ------
    InputError
        For values out of range, or if not exactly one level is asked for.
    """
    given = [name for name, value in (("snr", snr), ("sigma", sigma), ("detect", detect or None)) if value is not None]
    if len(given) != 1:
        raise InputError("snr", " and ".join(given) or None, allowed="one of snr, sigma, detect")
    check_levels(snr, sigma)
    span = Span.of(model, None, visit_time_s, asked=True)
    how: dict[str, Any] = {"exposure_s": exposure_s, "em_gain": em_gain, "snr": snr, "sigma": sigma}
    every = cases_by_camera(model, target, bands, _planets(separation_arcsec, planet, contrast), **how)
    solved = [cases.for_level(span) for cases in every]
    values = [one.cases.programme.visits * model.time_s(one.choice.visit_s) for one in solved]
    return _answers(solved, "exposure_time", values, span, model.named(bands))


def contrast_limit(
    model: EtcModel,
    target: Targets,
    *,
    time_s: float | None = None,
    visit_time_s: float | None = None,
    separation_arcsec: Places,
    bands: Sequence[str] | None = None,
    sigma: float | None = None,
    snr: float | None = None,
    exposure_s: float | None = None,
    em_gain: float | None = None,
    exact: bool = False,
) -> list[EtcAnswer]:
    """Return the faintest contrast detected in a given wall time.

    Parameters
    ----------
    model, target, time_s, visit_time_s, separation_arcsec, bands, exposure_s, em_gain, exact
        As `signal_to_noise`.
    sigma : float, optional
        Plain significance, 1e-3 to 1e3, instead of a detection as the strategy searches; its small-sample threshold is
        stated in ``threshold``, and what half of such programmes find in ``level``.
    snr : float, optional
        Photometric SNR, 1e-3 to 1e3, instead of a significance: the planet's own noise counts.

    Notes
    -----
    ``C = level / SNR`` of a planet of contrast 1 but for the planet's own light, which fills pixels and, for ``snr``,
    adds noise: found by secants of ``ln C``, of which significance needs one or two.
    """
    check_levels(snr, sigma, largest=1e3)
    if sigma is not None and snr is not None:
        raise InputError("sigma", sigma, allowed="one of sigma, snr")
    span = Span.of(model, time_s, visit_time_s)
    how: dict[str, Any] = {"exposure_s": exposure_s, "em_gain": em_gain, "snr": snr, "sigma": sigma}
    every = cases_by_camera(model, target, bands, _planets(separation_arcsec, None, _START), **how)
    limits = [_limit(cases, span, exact) for cases in every]
    solved = [_at_limit(cases, limit, exact) for cases, limit in zip(every, limits, strict=True)]
    values = [np.where(limit.contrast < 1.0, limit.contrast, math.inf) for limit in limits]
    return _answers(solved, "contrast_limit", values, span, model.named(bands))


def contrast_limits(
    model: EtcModel,
    target: Targets,
    separation_arcsec: Mapping[str, FloatArray],
    *,
    time_s: float,
    sigma: float | None = None,
    snr: float | None = None,
    exposure_s: float | None = None,
    em_gain: float | None = None,
) -> dict[str, FloatArray]:
    """Return the values of `contrast_limit` alone, of bands at places of their own: NaN where there is none.

    Parameters
    ----------
    model, target, time_s, sigma, snr, exposure_s, em_gain
        As `contrast_limit`, one star.
    separation_arcsec : mapping of str to ndarray
        By band, as many in each.
    """
    bands, span = tuple(separation_arcsec), Span.of(model, time_s, None)
    planets = _planets({band: place.tolist() for band, place in separation_arcsec.items()}, None, _START)
    how: dict[str, Any] = {"exposure_s": exposure_s, "em_gain": em_gain, "snr": snr, "sigma": sigma}
    found: dict[str, FloatArray] = {}
    for cases in cases_by_camera(model, target, bands, planets, **how):
        limit = _limit(cases, span, exact=False)
        reached = cases.possible & (limit.choice.n_frames >= 1) & (limit.contrast < 1.0)
        value = np.where(reached, limit.contrast, np.nan)
        found |= {band: value[i, 0] for i, band in enumerate(cases.bands)}
    return found


def times_of(question: "EtcQuestion | ConfirmQuestion", model: EtcModel, band: str) -> dict[str, Any]:
    """Return the wall times of all visits and of one in a band: the given ones, or those of the frames.

    Parameters
    ----------
    question : EtcQuestion or ConfirmQuestion
    model : EtcModel
    band : str
        Name of a band of the instrument, such as ``F520``.

    Returns
    -------
    dict
        ``time_s``, ``visit_time_s``, and ``exact`` where frames set them.
    """
    if question.n_frames is None or question.exposure_s is None:
        return {"time_s": question.wall_s, "visit_time_s": question.visit_time_s}
    # A hair more, lest rounding lose a frame.
    pace_s = (question.exposure_s + model.camera(band).readout_s) * (1.0 + 1e-12)
    visit_time_s = float(model.time_s(question.n_frames * pace_s))
    return {"time_s": (question.strategy.visits or 1) * visit_time_s, "visit_time_s": visit_time_s, "exact": True}


class _Limit(Record):
    """Contrasts at which the best frames in a time reach the level (``inf`` where none does), and those frames.

    ``visit_s`` is the length of visits that pays, ``longest_s`` what the time allows.
    """

    contrast: FloatArray
    programme: Programme
    choice: FrameChoice
    visit_s: FloatArray
    longest_s: FloatArray


def _limit(cases: Cases, span: Span, exact: bool) -> _Limit:
    """Return the limits of cases in a time."""
    assert span.time_s is not None
    visits = cases.visits_in(span)
    programme, longest_s = cases.spread(visits, span.time_s)
    visit_s = longest_s if exact else cases.paying_s(visits, longest_s)
    contrast, choice = _limits(cases, programme, visit_s, exact)
    if span.visits is None and cases.objective == "snr":
        # The planet's own noise counts: the best number of visits is that at the limit.
        ratio = np.minimum(contrast, 1.0)
        visits = cases.of_contrast(ratio).best_in_time(span.time_s)
        programme, longest_s = cases.spread(visits, span.time_s)
        visit_s = longest_s
        contrast, choice = _limits(cases, programme, visit_s, exact)
    for _ in range(_MODE_ROUNDS if cases.model.strategy.n_modes else 0):
        programme, last = cases.programme_of(visits, span.time_s / visits, choice), contrast
        contrast, choice = _limits(cases, programme, visit_s, exact)
        if np.allclose(contrast, last, rtol=_STILL, atol=0.0):
            break
    return _Limit(contrast, programme, choice, visit_s, longest_s)


def _at_limit(cases: Cases, limit: _Limit, exact: bool) -> Solution:
    """Return the programmes and frames of planets at the limit."""
    programme, choice = limit.programme, limit.choice
    # Beyond contrast 1 there is no planet: refused below.
    ratio = np.minimum(limit.contrast, 1.0)
    there, problem = cases.of_contrast(ratio), cases.problem(None, programme, ratio)
    level = cases.level_of(programme, problem, choice)
    stopped = (choice.n_frames > 0) & (choice.visit_s < limit.longest_s * (1.0 - 1e-9))
    if np.any(stopped) and not exact:
        # The same setting as the inverse question finds: where more time hardly pays, rounding moves its length.
        again = there.at_level(programme.visits)
        use = stopped & (again.choice.n_frames > 0) & (again.choice.visit_s <= limit.visit_s)
        choice, level = again.choice.where(use, choice), np.where(use, again.level, level)
        if cases.model.strategy.n_modes:
            programme = again.cases.programme.spread(use.shape).where(use, programme.spread(use.shape))
    return Solution(there.in_programme(programme), problem, choice, level)


def _limits(cases: Cases, programme: Programme, visit_s: FloatArray, whole: bool) -> tuple[FloatArray, FrameChoice]:
    """Return the contrasts at which the best frames of visits reach the level, and those frames."""

    def excess(log_contrast: FloatArray) -> tuple[FloatArray, FrameChoice]:
        problem = cases.problem(None, programme, np.exp(log_contrast))
        choice = best_in_visit(problem, visit_s, whole=whole, quickest=False)
        level = cases.level_of(programme, problem, choice)
        with np.errstate(divide="ignore"):
            return np.log(level) + 0.5 * np.log(choice.inverse_snr2), choice

    x = np.full(visit_s.shape, math.log(_START))
    (f, choice), slope = excess(x), np.ones(visit_s.shape)
    for _ in range(_LIMIT_STEPS):
        # SNR grows with contrast at least like its square root: slopes are between 1/2 and 1.
        new = np.clip(x + f / slope, math.log(1e-29), 0.1)
        moved = np.isfinite(f) & (np.abs(new - x) > 4e-16 * np.abs(x))
        if not moved.any():
            break
        g, choice = excess(np.where(moved, new, x))
        with np.errstate(divide="ignore", invalid="ignore"):
            secant = (f - g) / (new - x)
        slope = np.where(moved & np.isfinite(secant), np.clip(secant, 0.3, 1.0), slope)
        x, f = np.where(moved, new, x), np.where(moved, g, f)
        if np.all(np.abs(f) < _CLOSE, where=np.isfinite(f)):
            break
    return np.where(np.isfinite(f) & (f < 1e-9), np.exp(x), math.inf), choice


def _answers(
    found: Sequence[Solution], question: Question, values: Sequence[FloatArray], span: Span, bands: Sequence[str]
) -> list[EtcAnswer]:
    """Return the answers of the programmes and frames of every camera: bands in a given order, planets in bands."""
    rows: dict[tuple[int, str, int], EtcAnswer] = {}
    for one, value in zip(found, values, strict=True):
        cases = one.cases
        answers = _Answers(**vars(one), question=question, value=value, span=span).answers()
        for (band, star, planet), answer in zip(np.ndindex(*cases.shape), answers, strict=True):
            rows[star, cases.bands[band], planet] = answer
    stars, planets = map(range, found[0].cases.shape[1:])
    return [rows[star, band, planet] for star in stars for band in bands for planet in planets]


def check_levels(snr: float | None, sigma: float | None, *, largest: float = 1e6) -> None:
    """Refuse an SNR or a significance outside of the range from one over ``largest`` to that.

    Raises
    ------
    InputError
        Naming the one that is out of range.
    """
    for name, value in (("snr", snr), ("sigma", sigma)):
        if value is not None:
            check_range(name, value, 1.0 / largest, largest, "")


def best_band(answers: Sequence[EtcAnswer]) -> str | None:
    """Return the band of the best answer: least time, highest significance over threshold, or faintest limit."""
    good = [answer for answer in answers if answer.value is not None]
    if not good:
        return None
    if good[0].question in ("exposure_time", "contrast_limit"):
        return min(good, key=lambda answer: answer.value or np.inf).band
    return max(good, key=lambda answer: (answer.significance or 0.0) / (answer.threshold or np.inf)).band


def etc_result(
    model: EtcModel,
    target: Targets,
    answers: Sequence[EtcAnswer],
    *,
    note: str,
    notes: Sequence[str] = (),
    planet: ReferencePlanet | None,
    asked: Mapping[str, Any],
    stated: Mapping[str, str] | None = None,
    catalogue: str,
    dial: Dial | None = None,
    seed: int | None = None,
) -> EtcResult:
    """Collect answers about one star of a catalogue, which is named by its provenance.

    ``asked`` is what decides the answers, for their hash, ``stated`` what they say of it.
    ``note`` is a remark on the name of the star, ``notes`` are those on the reading of tables. ``dial`` and ``seed``
    are those of the check in images, closed forms alone without.
    """
    record = None if planet is None else ReferencePlanetRecord.of(planet, albedo=planet.albedo.label)
    decides: dict[str, Any] = {"kind": "etc", "version": __version__, "model": model.content()}
    decides |= {"target": target.content(), "asked": asked}
    decides["planet"] = None if planet is None else planet.content()
    return EtcResult(
        config_hash=content_hash(decides),
        asked=None if stated is None else dict(stated),
        target=str(target.name[0]),
        hip=int(target.hip[0]) if target.hip[0] else None,
        v_mag=float(target.v_mag[0]),
        distance_pc=float(target.distance_pc[0]),
        catalogue=catalogue,
        date_utc=target.date_utc,
        note=note,
        notes=list(notes),
        reference_planet=record,
        best_band=best_band(answers),
        answers=list(answers),
        fidelity=etc_fidelity(answers, dial or dial_of("quick"), seed=seed, of_table=model.of_table),
    )
