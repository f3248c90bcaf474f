"""Choice of band, separation, frame exposure, number of frames and EM gain for each target."""

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cpic_core import ArrayLike, BoolArray, FloatArray, InputError, NDArray, Reason, Status
from cpic_planner import etc
from cpic_planner.queries import ReferencePlanet
from cpic_planner.targets import Targets
from simulator.imaging import PsfMetrics
from simulator.target import albedo_source

N_SEPARATIONS = 41
_ENDLESS_S = np.asarray(1e12)
_Change = Callable[[etc.FrameProblem, FloatArray], etc.FrameProblem]
_CHANGES = ("without_speckles", "without_background")
_SLACK = 1.5  # by how much other exposures may beat the chosen ones at other places; 1 gives the catalogue the same
STRIDE = 5
MIN_BACKGROUND_APERTURES = 25.0
"""Aperture areas that the background annulus must hold: about a third of them fit without overlap."""


@dataclass(frozen=True)
class OptimalSetting:
    """Best setting of each target; arrays of ``n`` stars.

    ``margin`` is significance over the detection threshold at the chosen separation; at ``needed_margin`` half of the
    visits detect the planet there, and ``chance_blind`` and ``chance_known_place`` are the probabilities of a detection
    (NaN where no law was measured). ``floor_margin`` is what no length of visit can pass, at any separation (with the
    noise of light where that decides). ``without_speckles`` and ``without_background`` say whether the planet would be
    detected in the given time under the changes of `cpic_planner.etc.budget`; False where no time was given.
    ``contrast_limit`` is the faintest contrast that this observation detects at the chosen separation,
    ``deepest_limit`` that of the best separation for it. ``n_frames`` is 0 where every frame saturates or the time is
    too short. ``extrapolated`` says that the planet's albedo is beyond its data in this band, ``outside`` why a given
    separation has no answer (empty: it is in the zone).
    """

    band: NDArray[np.str_]
    separation_arcsec: FloatArray
    contrast: FloatArray
    exposure_s: FloatArray
    n_frames: FloatArray
    em_gain: FloatArray
    time_s: FloatArray
    snr: FloatArray
    significance: FloatArray
    threshold: FloatArray
    margin: FloatArray
    floor_margin: FloatArray
    needed_margin: FloatArray
    chance_blind: FloatArray
    chance_known_place: FloatArray
    without_speckles: BoolArray
    without_background: BoolArray
    contrast_limit: FloatArray
    deepest_limit: FloatArray
    deepest_separation_arcsec: FloatArray
    longest_exposure_s: FloatArray
    peak_columns_e_s: FloatArray
    peak_hole_e_s: FloatArray
    tail_e_s: FloatArray
    core_throughput: FloatArray
    extrapolated: BoolArray
    outside: NDArray[np.str_]


def separation_grid(model: etc.EtcModel, band: str) -> FloatArray:
    """Diagonal separations with the aperture inside a band's zone, a defined threshold and room to measure noise."""
    inner, outer = etc.usable_range_arcsec(model.instrument, band)
    grid = _roomy(model.metrics[band], inner, outer, model.strategy.annulus_lambda_d)
    if len(model.strategy.rolls_deg) > 1:  # a planet that is seen at two rolls stands beside the diagonal
        grid = grid[np.array([etc.place_status(model, band, float(place))[0] is Status.OK for place in grid], bool)]
    if grid.size == 0:
        allowed = "a zone with room for aperture, background and three elements"
        raise InputError("band", band, allowed=allowed, hint="see annulus_lambda_d, roll_deg and the hole's edges")
    return grid


@functools.lru_cache(maxsize=64)
def _roomy(metrics: PsfMetrics, inner_arcsec: float, outer_arcsec: float, annulus_lambda_d: float) -> FloatArray:
    grid = np.geomspace(inner_arcsec, outer_arcsec, N_SEPARATIONS)
    enough = [np.count_nonzero(metrics.annulus(s, annulus_lambda_d)) for s in grid]
    room = np.asarray(enough) >= MIN_BACKGROUND_APERTURES * metrics.aperture_pixels
    usable: FloatArray = grid[(metrics.resolution_elements(grid) >= 3.0) & room]
    usable.flags.writeable = False
    return usable


def optimise(
    model: etc.EtcModel,
    targets: Targets,
    *,
    time_s: float | None = None,
    snr: float | None = None,
    detect: bool = False,
    separation_arcsec: float | None = None,
    planet: ReferencePlanet | None = None,
    bands: Sequence[str] | None = None,
) -> OptimalSetting:
    """Best band, separation and frame settings of each target.

    Parameters
    ----------
    model : EtcModel
    targets : Targets
        ``n`` stars.
    time_s : float, optional
        Longest wall time per target and band, overheads and reference frames included: the clearest detection wins.
    snr : float, optional
        Photometric SNR to reach, 1e-6 to 1e6: the least time wins.
    detect : bool
        A detection to reach: the least time wins. One of the three is given.
    separation_arcsec : float, optional
        Projected separation of the planet, instead of the best one.
    planet : ReferencePlanet, optional
    bands : sequence of str, optional
        All of the model by default.

    Returns
    -------
    OptimalSetting

    Raises
    ------
    InputError
        For values out of range, or if not exactly one goal is given.

    Notes
    -----
    The separation maximises significance over the threshold that holds there (or SNR), not bare significance: towards
    the corner of the zone the number of resolution elements falls below three and no detection could be claimed.
    Less than ``time_s`` is used where the wavefront's walk makes a longer visit worse. A band in which the albedo is
    extrapolated wins only where no other has an answer.
    """
    given = {"time_s": time_s, "snr": snr, "detect": detect or None}
    goals = [name for name, value in given.items() if value is not None]
    if len(goals) != 1:
        raise InputError("time_s", " and ".join(goals) or None, allowed="one of time_s, snr, detect")
    body = planet or ReferencePlanet()
    names = model.named(bands)
    if separation_arcsec is not None:
        etc.check_range("separation_arcsec", separation_arcsec, 1e-6, 120.0, "arcsec")
    if time_s is not None:
        etc.check_range("time_s", time_s, 1e-3, 1e9, "s")
        return best_of([best_in_band(model, targets, band, time_s, body, separation_arcsec) for band in names])
    if snr is not None:
        etc.check_range("snr", snr, 1e-6, 1e6, "")
    return best_of([_least_in_band(model, targets, band, snr, body, separation_arcsec) for band in names], by_time=True)


def best_in_band(
    model: etc.EtcModel,
    targets: Targets,
    band: str,
    time_s: float,
    planet: ReferencePlanet,
    separation_arcsec: float | None = None,
) -> OptimalSetting:
    """Best separation, length of visit and settings of each target in one band within a time; see `optimise`."""
    visit = model.visit_s(time_s)
    search = _Search(model, targets, band, planet, separation_arcsec)
    chosen = search.lowest(lambda places: places.cost(places.problem("significance"), visit))
    return search.best(chosen, etc.best_in_visit(chosen.problem("significance"), visit), visit)


def _least_in_band(
    model: etc.EtcModel,
    targets: Targets,
    band: str,
    snr: float | None,
    planet: ReferencePlanet,
    separation_arcsec: float | None = None,
) -> OptimalSetting:
    """Least time of each target in one band, for an SNR or a detection."""
    objective: etc.Objective = "significance" if snr is None else "snr"

    def level(places: _Places) -> FloatArray:
        return places.threshold if snr is None else np.full(places.contrast.shape, snr)

    search = _Search(model, targets, band, planet, separation_arcsec)
    chosen = search.lowest(lambda places: etc.smooth_least_visit_s(places.problem(objective), level(places)))
    return search.best(chosen, etc.least_time(chosen.problem(objective), level(chosen)))


@dataclass(frozen=True)
class _Places:
    """Stars x separations; ``separation_arcsec`` is ``(1 or n, k)``, the others ``(n, k)``."""

    model: etc.EtcModel
    band: str
    separation_arcsec: FloatArray
    contrast: FloatArray
    threshold: FloatArray
    rates: etc.ApertureRates

    def problem(self, objective: etc.Objective) -> etc.FrameProblem:
        """What the solver needs."""
        return etc.frame_problem(self.rates, self.model.camera(self.band), self.model.strategy, objective=objective)

    def cost(self, problem: etc.FrameProblem, visit_s: FloatArray) -> FloatArray:
        """Threshold over the significance of the best frames in a visit."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.sqrt(etc.smooth_in_visit(problem, visit_s)) * self.threshold


@dataclass(frozen=True)
class _Search:
    """Search of the best separation of each star, first on a coarse grid, then between its points; or a given one."""

    model: etc.EtcModel
    targets: Targets
    band: str
    planet: ReferencePlanet
    separation_arcsec: float | None

    @property
    def grid(self) -> FloatArray:
        """Separations to look at."""
        given = self.separation_arcsec
        return separation_grid(self.model, self.band) if given is None else np.array([given])

    @property
    def refusal(self) -> Reason:
        """Why a given separation is outside the zone of the band."""
        if self.separation_arcsec is None:
            return Reason.NONE
        return etc.place_status(self.model, self.band, self.separation_arcsec)[1]

    def places(self, separation_arcsec: FloatArray) -> _Places:
        """Rates and contrasts at the separations."""
        model, band = self.model, self.band
        x, y = etc.planet_offsets(model, self.targets, band, separation_arcsec)
        contrast = etc.reference_contrast(model, self.targets, band, separation_arcsec, self.planet)
        elements = model.metrics[band].resolution_elements(separation_arcsec)
        threshold = np.broadcast_to(etc.threshold_array(elements, model.strategy.sigma), contrast.shape)
        rates = etc.aperture_rates(model, self.targets, band, x, y, contrast)
        return _Places(model, band, separation_arcsec, contrast, threshold, rates)

    def lowest(self, cost: Callable[[_Places], FloatArray]) -> _Places:
        """The separation of least cost for each star, ``(n, 1)``; the middle of the range where there is no answer."""
        fine = self.grid
        if len(fine) == 1:
            return self.places(fine[None, :])
        rough = cost(self.places(fine[None, ::STRIDE]))
        middle = np.argmin(rough, axis=1) * STRIDE
        middle = np.where(np.isfinite(rough).any(axis=1), middle, len(fine) // 2)
        around = np.clip(middle[:, None] + np.arange(1 - STRIDE, STRIDE), 0, len(fine) - 1)
        close = cost(self.places(fine[around]))
        best = np.where(np.isfinite(close).any(axis=1), np.argmin(close, axis=1), STRIDE - 1)
        return self.places(np.take_along_axis(fine[around], best[:, None], axis=1))

    def _most(self, bound: FloatArray, margin: FloatArray) -> FloatArray:
        """Margin of the best length of visit, where a bound from the visit's offset alone leaves it open."""
        doubtful = (bound > 1.0) & (margin < 1.0)
        if not doubtful.any():
            return bound

        def cost(places: _Places) -> FloatArray:
            found = places.cost(places.problem("significance"), _ENDLESS_S)
            return np.where(np.isfinite(places.threshold), found, np.inf)

        least = cost(replace(self, targets=self.targets.select(doubtful)).lowest(cost))[:, 0]
        bound[doubtful] = np.minimum(bound[doubtful], 1.0 / least)
        return bound

    def _would_detect(self, possible: BoolArray, visit_s: FloatArray, change: _Change) -> BoolArray:
        """Stars of those possible whose planet a change makes detected, at the separation that is best under it."""
        camera, needed = self.model.camera(self.band), etc.needed_margin(self.model, self.band)

        def changed(places: _Places) -> etc.FrameProblem:
            return change(places.problem("significance"), etc.own_noise(places.rates, camera))

        found = np.zeros(len(self.targets), bool)
        if possible.any():
            places = replace(self, targets=self.targets.select(possible)).lowest(
                lambda places: places.cost(changed(places), visit_s)
            )
            found[possible] = etc.reached(changed(places), visit_s, needed * places.threshold)[:, 0]
        return found

    def best(self, chosen: _Places, choice: etc.FrameChoice, visit_s: FloatArray | None = None) -> OptimalSetting:
        """Everything about the chosen separations and frames; what limits them only in a given visit."""
        model, band, n = self.model, self.band, len(self.targets)
        frames = choice.exposure_s, choice.n_frames, choice.em_gain, model.camera(band), model.strategy
        noise = etc.stack_noise(chosen.rates, *frames)
        if (refused := self.refusal) is not Reason.NONE:
            choice.n_frames[:] = 0.0
        with np.errstate(invalid="ignore"):
            margin = np.where(choice.n_frames > 0, noise.significance / chosen.threshold, 0.0)
        fine = self.grid
        every = self.places(fine[None, :]) if len(fine) > 1 else chosen
        with np.errstate(divide="ignore"):
            left = every.rates.residual.k0 * every.rates.variance_factor
            floor = every.rates.planet_e_s / np.sqrt(left) / every.threshold
        around = etc.stack_noise(every.rates, *frames)
        with np.errstate(divide="ignore", invalid="ignore"):
            limits = np.where(around.significance > 0, every.contrast * every.threshold / around.significance, np.inf)
            limit = np.where(margin > 0, chosen.contrast / margin, np.inf)
        deepest = np.argmin(limits, axis=1)

        def column(array: ArrayLike) -> FloatArray:
            return np.array(np.broadcast_to(np.asarray(array, float), (n, 1))[:, 0])

        needed = etc.needed_margin(model, band)
        calm, dark = np.zeros(n, bool), np.zeros(n, bool)
        if visit_s is not None:
            # Bounds leave few stars to be solved again: white noise alone, and the frozen offset alone.
            with np.errstate(divide="ignore", invalid="ignore"):
                bound = around.signal_e * np.sqrt(visit_s / choice.visit_s / around.white) / every.threshold
            lost = (column(margin) < needed) & (choice.n_frames[:, 0] > 0)
            near = np.nan_to_num(bound).max(axis=1) * _SLACK >= needed
            calm = self._would_detect(lost & near, visit_s, lambda problem, _: etc.without_speckles(problem))
            dark = self._would_detect(lost & ~calm & (floor.max(axis=1) >= needed), visit_s, etc.without_background)
        chances = etc.visit_chances(model, band, chosen.separation_arcsec, choice.visit_s, noise, margin)
        beyond = model.passbands.albedo_flags(albedo_source(self.planet.albedo))[model.passbands.index(band)]

        return OptimalSetting(
            band=np.full(n, band),
            separation_arcsec=column(chosen.separation_arcsec),
            contrast=column(chosen.contrast),
            threshold=column(chosen.threshold),
            exposure_s=column(choice.exposure_s),
            n_frames=column(choice.n_frames),
            em_gain=column(choice.em_gain),
            time_s=column(model.time_s(choice.visit_s)),
            snr=column(noise.snr),
            significance=column(noise.significance),
            margin=column(margin),
            floor_margin=self._most(floor.max(axis=1), column(margin)),
            needed_margin=np.full(n, needed),
            chance_blind=column(chances.blind),
            chance_known_place=column(chances.known_place),
            without_speckles=calm,
            without_background=dark,
            contrast_limit=column(limit),
            deepest_limit=limits[np.arange(n), deepest],
            deepest_separation_arcsec=fine[deepest],
            longest_exposure_s=column(chosen.problem("significance").longest_s()),
            peak_columns_e_s=column(chosen.rates.peak_columns_e_s),
            peak_hole_e_s=column(chosen.rates.peak_in_hole_e_s),
            tail_e_s=column(chosen.rates.register_tail_e_s),
            core_throughput=column(chosen.rates.core),
            extrapolated=np.full(n, bool(beyond)),
            outside=np.full(n, refused.value),
        )


def best_of(found: Sequence[OptimalSetting], *, by_time: bool = False) -> OptimalSetting:
    """Row by row the one of largest margin (or of least time), the first of equals; extrapolated ones come last.

    Whether a change would make the planet detected is said of any of them.
    """
    costs = [np.where(item.n_frames > 0, item.time_s, np.inf) if by_time else -item.margin for item in found]
    cost = np.stack(costs)
    answered = np.stack([item.n_frames > 0 for item in found])
    last = np.stack([item.extrapolated for item in found]) | ~answered
    rows = np.arange(cost.shape[1])
    pick = np.lexsort((np.broadcast_to(np.arange(len(found))[:, None], cost.shape), cost, last), axis=0)[0]
    changed = {name: np.any([getattr(item, name) for item in found], axis=0) for name in _CHANGES}
    others = (name for name in OptimalSetting.__dataclass_fields__ if name not in _CHANGES)
    return OptimalSetting(
        **changed, **{name: np.stack([getattr(item, name) for item in found])[pick, rows] for name in others}
    )
