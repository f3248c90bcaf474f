"""Choice of band, separation, visits, frame exposure, number of frames and EM gain for each target."""

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from cpic_core import ArrayLike, BoolArray, FloatArray, InputError, IntArray, Reason
from cpic_planner import etc
from cpic_planner.queries import MAX_VISITS, ReferencePlanet
from cpic_planner.ranking.programmes import Outlook, nearby, programme_of
from cpic_planner.ranking.settings import OptimalSetting, Places, best_of, separation_grid
from cpic_planner.targets import Targets
from simulator.target import albedo_source

_SLACK = 1.5  # by how much other exposures may beat the chosen ones at other places; 1 gives the catalogue the same
_ROUNDING = 1e-9
_ROUNDS, _SECANTS = 40, 8
STRIDE = 5


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
    """Return the best band, separation and frame settings of each target.

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
    The separation maximises significance over the level of a detection that holds there (or SNR), not bare
    significance: towards the corner of the zone the number of resolution elements falls below three and no detection
    could be claimed. The number of visits is that of the strategy or, without, the best one up to 1000: each has an
    overhead and a wavefront of its own. Less than ``time_s`` is used where the wavefront's walk makes longer visits
    worse. A band in which the albedo is extrapolated wins only where no other has an answer.
    """
    given = {"time_s": time_s, "snr": snr, "detect": detect or None}
    goals = [name for name, value in given.items() if value is not None]
    if len(goals) != 1:
        raise InputError("time_s", " and ".join(goals) or None, allowed="one of time_s, snr, detect")
    body = planet or ReferencePlanet()
    names = model.named(bands)
    if separation_arcsec is not None:
        etc.check_range("separation_arcsec", separation_arcsec, etc.NEAREST_ARCSEC, etc.FARTHEST_ARCSEC, "arcsec")
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
    *,
    brief: bool = False,
) -> OptimalSetting:
    """Return the best separation, visits and settings of each target in one band within a time; see `optimise`.

    ``brief``: neither what limits a planet that is not detected nor what would detect it, and of a blind search no
    chance at a known place.
    """
    search = _Search(model, targets, band, planet, separation_arcsec)
    # The best place depends on the number of visits: both are chosen together.
    every = np.arange(len(targets))
    best, outlook = search.lowest(
        every, lambda outlook: outlook.in_time(time_s), lambda outlook, visits: outlook.in_time(time_s, visits)
    )
    chosen = search.places.at(every, best)
    visits, visit = outlook.finely_in_time(time_s)[1:]
    programme = programme_of(model, visits, visit)
    choice = etc.best_in_visit(chosen.problem("significance", programme), visit)
    return search.best(chosen, outlook, choice, programme, time_s, brief=brief)


def _least_in_band(
    model: etc.EtcModel,
    targets: Targets,
    band: str,
    snr: float | None,
    planet: ReferencePlanet,
    separation_arcsec: float | None = None,
) -> OptimalSetting:
    """Return the least time of each target in one band, for an SNR or a detection."""
    search = _Search(model, targets, band, planet, separation_arcsec, snr)
    every = np.arange(len(targets))
    best, outlook = search.lowest(every, Outlook.for_level, Outlook.for_level)
    chosen = search.places.at(every, best)
    visits, visit = outlook.for_level()[1:]
    if model.strategy.visits is None:
        visits, visit = outlook.for_level(nearby(visits))[1:]
        # Where visits are of few frames, those of one visit alone can be quicker.
        visits = np.stack((visits, np.ones_like(visits)))
    programme, choice = _least_frames(chosen, outlook, visits, visit, snr)
    if model.strategy.visits is None:
        both = programme.spread(visits.shape)
        time_s = np.where(choice.n_frames > 0, visits * model.time_s(choice.visit_s), np.inf)
        better = time_s[1] < time_s[0]
        programme, choice = both.at(1).where(better, both.at(0)), choice.at(1).where(better, choice.at(0))
    return search.best(chosen, outlook, choice, programme)


def _least_frames(
    chosen: Places, outlook: Outlook, visits: FloatArray, visit_s: FloatArray, snr: float | None
) -> tuple[etc.Programme, etc.FrameChoice]:
    """Return the least frames of so many visits for an SNR, or a detection; they need at least ``visit_s``.

    The level of a detection grows with the share of the errors' light in the frames, and that with the length of the
    visits: it is reached from below, so that the first answer is the least.
    """
    spaced_s = np.where(np.isfinite(visit_s), visit_s, 1.0)
    programme = programme_of(chosen.model, visits, spaced_s)
    problem = chosen.problem("significance" if snr is None else "snr", programme)
    if snr is not None:
        return programme, etc.least_time(problem, np.full(visits.shape, snr))
    reachable = np.isfinite(np.broadcast_to(visit_s, visits.shape))
    aim = outlook.wanted(visits[..., None], spaced_s[..., None])[..., 0] * (1.0 - _ROUNDING)
    choice = etc.least_time(problem, np.where(reachable, aim, np.inf))
    # Visits that remember each other are spaced as they were planned: shorter ones would be closer together.
    secants = 0 if chosen.model.instrument.drift.correlation_time_h > 0.0 else _SECANTS
    slope = np.zeros(visits.shape)
    last: tuple[FloatArray, FloatArray] | None = None
    for step in range(_ROUNDS):
        level = chosen.needed(choice, programme) * chosen.threshold
        some = choice.n_frames > 0
        off = np.where(some, level / np.where(some, aim, 1.0) - 1.0, 0.0)
        # Secants of a fixed point may land above it; the last ones go up to it step by step.
        wrong = some & ((off > _ROUNDING) | (off < -_ROUNDING) & (step < secants))
        if not wrong.any():
            break
        if last is not None and step < secants:
            with np.errstate(divide="ignore", invalid="ignore"):
                slope = np.clip(np.nan_to_num((level - last[1]) / (aim - last[0])), -0.9, 0.9)
        last = aim, level
        moved = aim * (1.0 + off / (1.0 - slope)) if step < secants else level
        aim = np.where(wrong, moved * (1.0 + 0.1 * _ROUNDING), aim)
        better = etc.least_time(problem.at(wrong), aim[wrong])
        for item in fields(etc.FrameChoice):
            getattr(choice, item.name)[wrong] = getattr(better, item.name)
    else:
        choice.n_frames[wrong] = 0.0  # a level that runs away is never reached
    return programme, choice


@dataclass(frozen=True)
class _Search:
    """Search of the best separation of each star, first on a coarse grid, then between its points; or a given one."""

    model: etc.EtcModel
    targets: Targets
    band: str
    planet: ReferencePlanet
    separation_arcsec: float | None
    snr: float | None = None

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

    @functools.cached_property
    def places(self) -> Places:
        """Rates and contrasts of all stars at every separation."""
        model, band, place = self.model, self.band, self.grid[None, :]
        x, y = etc.planet_offsets(model, self.targets, band, place)
        contrast = etc.reference_contrast(model, self.targets, band, place, self.planet)
        elements = model.metrics[band].resolution_elements(place)
        threshold = np.broadcast_to(etc.threshold_array(elements, model.strategy.sigma), contrast.shape)
        rates = etc.aperture_rates(model, self.targets, band, x, y, contrast)
        motion = etc.SearchMotion.asked(model, self.targets, band, np.broadcast_to(place, contrast.shape))
        return Places(model, band, place, contrast, threshold, rates, motion)

    def outlook(self, stars: IntArray, columns: IntArray, *, dark: bool = False) -> Outlook:
        """Return what decides programmes of some stars at some separations; ``dark``: with no background."""
        return self.places.at(stars, columns).outlook(self.snr, dark=dark)

    @functools.cached_property
    def coarse(self) -> Outlook:
        """The outlook of all stars on the coarse grid."""
        return self.outlook(np.arange(len(self.targets)), np.arange(0, len(self.grid), STRIDE)[None, :])

    @functools.cached_property
    def endless(self) -> FloatArray:
        """Least level over SNR that any programme has at the separations of the coarse grid, ``(n,)``."""
        return np.asarray(self.coarse.endless().min(axis=1))

    def lowest(
        self,
        stars: IntArray,
        cost: Callable[[Outlook], list[FloatArray]],
        finer: Callable[[Outlook, FloatArray], list[FloatArray]] | None = None,
        *,
        dark: bool = False,
    ) -> tuple[IntArray, Outlook]:
        """Return which separation is of least cost for some stars, ``(n, 1)``: the middle one where there is no answer.

        And the outlook there. Between the points of the coarse grid ``finer`` looks at all numbers of visits near the
        best ones there.
        """
        n = len(self.grid)
        steps = np.arange(0, n, STRIDE)[None, :]
        coarse = self.outlook(stars, steps, dark=True) if dark else self.coarse.at(stars, steps // STRIDE)
        if n == 1:
            return np.zeros((len(stars), 1), int), coarse
        rough, visits = cost(coarse)[:2]
        column = np.argmin(rough, axis=1)
        middle = column * STRIDE
        middle = np.where(np.isfinite(rough).any(axis=1), middle, n // 2)
        around = np.clip(middle[:, None] + np.arange(1 - STRIDE, STRIDE), 0, n - 1)
        fine = self.outlook(stars, around, dark=dark)
        if finer is None or self.model.strategy.visits is not None:
            close = cost(fine)[0]
        else:
            close = finer(fine, nearby(np.take_along_axis(visits, column[:, None], axis=1)))[0]
        best = np.where(np.isfinite(close).any(axis=1), np.argmin(close, axis=1), STRIDE - 1)[:, None]
        found = fine.at(np.arange(len(stars)), best)
        return np.take_along_axis(around, best, axis=1), found

    def _changed(
        self, stars: BoolArray, change: Callable[[Outlook], list[FloatArray]], *, dark: bool = False
    ) -> FloatArray:
        """Return the least cost of some stars under a change, at its best separation; infinite for the others."""
        found, some = np.full(len(self.targets), np.inf), np.flatnonzero(stars)
        if some.size:
            found[some] = change(self.lowest(some, change, dark=dark)[1])[0][:, 0]
        return found

    def best(
        self,
        chosen: Places,
        outlook: Outlook,
        choice: etc.FrameChoice,
        programme: etc.Programme,
        time_s: float | None = None,
        *,
        brief: bool = False,
    ) -> OptimalSetting:
        """Return everything about the chosen separations and programmes; what limits them only in a given time."""
        model, band, n = self.model, self.band, len(self.targets)
        noise = chosen.noise(choice, programme)
        if (refused := self.refusal) is not Reason.NONE:
            choice.n_frames[:] = 0.0
        possible = choice.n_frames > 0
        with np.errstate(invalid="ignore"):
            margin = np.where(possible, noise.significance / chosen.threshold, 0.0)
        needed = chosen.needed(choice, programme, noise)
        fine = self.grid
        every = self.places
        around = every.noise(choice, programme)
        level = every.needed(choice, programme, around) * every.threshold
        with np.errstate(divide="ignore", invalid="ignore"):
            limits = np.where(around.significance > 0, every.contrast * level / around.significance, np.inf)
            limit = np.where(margin > 0, chosen.contrast * needed / margin, np.inf)
        deepest = np.argmin(limits, axis=1)

        def column(array: ArrayLike) -> FloatArray:
            return np.array(np.broadcast_to(np.asarray(array, float), (n, 1))[:, 0])

        wall = model.time_s(choice.visit_s)
        if time_s is not None:  # never more than what was given, not even by rounding
            wall = np.minimum(wall, time_s / programme.visits)
        beyond = model.passbands.albedo_flags(albedo_source(self.planet.albedo))[model.passbands.index(band)]
        place, visits = chosen.separation_arcsec, etc.effective_of(programme, chosen.rates.speckle)
        paid = etc.motion_factor(chosen.motion, programme, choice.visit_s)
        known = not brief or model.strategy.search == "known_place"
        chances = etc.visit_chances(model, band, place, choice.visit_s, noise, visits, motion=paid, at_place=known)
        orbits = np.nan if chosen.motion is None else chosen.motion.orbits(programme, choice.visit_s)
        alone = chosen.rates.speckle.independent(programme.visits, programme.gap_s)
        inherited = etc.inherited_terms(model.instrument, model.instrument.band(band).camera, noise)
        lost = column(possible & (margin < needed * (1.0 - _ROUNDING))).astype(bool)
        best = OptimalSetting(
            band=np.full(n, band),
            separation_arcsec=column(chosen.separation_arcsec),
            contrast=column(chosen.contrast),
            threshold=column(chosen.threshold),
            visits=column(programme.visits),
            independent_visits=column(alone),
            orbits_searched=column(orbits),
            motion_factor=column(paid),
            reference_visits=column(programme.reference_visits),
            exposure_s=column(choice.exposure_s),
            frames_per_visit=column(choice.n_frames),
            n_frames=column(choice.n_frames * programme.visits),
            em_gain=column(choice.em_gain),
            visit_time_s=column(wall),
            time_s=column(wall * programme.visits),
            unused_s=column(np.nan if time_s is None else np.maximum(time_s - wall * programme.visits, 0.0)),
            snr=column(noise.snr),
            significance=column(noise.significance),
            margin=column(margin),
            floor_margin=np.full(n, np.nan) if brief else column(needed) / self.endless,
            needed_margin=column(needed),
            chance_blind=column(chances.blind),
            chance_known_place=column(chances.known_place),
            without_motion=np.zeros(n, bool),
            moves=np.zeros(n, bool),
            without_speckles=np.zeros(n, bool),
            without_background=np.zeros(n, bool),
            required_visits=np.full(n, np.nan),
            required_drift_factor=np.full(n, np.nan),
            required_contrast_factor=np.full(n, np.nan),
            contrast_limit=column(limit),
            deepest_limit=limits[np.arange(n), deepest],
            deepest_separation_arcsec=fine[deepest],
            longest_exposure_s=column(chosen.problem("significance").longest_s),
            peak_columns_e_s=column(chosen.rates.peak_columns_e_s),
            peak_hole_e_s=column(chosen.rates.peak_in_hole_e_s),
            tail_e_s=column(chosen.rates.register_tail_e_s),
            core_throughput=column(chosen.rates.core),
            extrapolated=np.full(n, bool(beyond)),
            outside=np.full(n, refused.value),
            inherited=np.broadcast_to(inherited, (n, 1))[:, 0].copy(),
        )
        if time_s is None or brief or not lost.any():
            return best
        # A bound leaves few stars to be solved again: white noise alone.
        with np.errstate(divide="ignore", invalid="ignore"):
            bound = around.signal_e * np.sqrt(model.visit_s(time_s) / choice.visit_s / programme.visits / around.white)
            ends = (
                etc.needed_margin(model, band, fine, 0.0, 0.0, visits, every.threshold) for visits in (1.0, MAX_VISITS)
            )
            calmest = np.minimum(*ends)
            near = np.nan_to_num(bound / every.threshold / calmest).max(axis=1) * _SLACK >= 1.0
        fewest, factor = np.full((2, n), np.nan)
        fewest[lost] = outlook.select(lost).fewest(column(choice.visit_s)[lost])
        contrast = np.where(lost, column(needed) / np.maximum(column(margin), 1e-300), np.nan)
        few = lost & (self.endless <= 1.0)
        still = self._changed(few & near, lambda item: item.at_rest().in_time(time_s)) <= 1.0
        calm = self._changed(lost & near, lambda item: item.without_speckles().in_time(time_s)) <= 1.0
        dark = self._changed(few, lambda item: item.in_time(time_s), dark=True) <= 1.0
        if calm.any():
            every_place = np.arange(len(fine))[None, :]
            factor[calm] = self.outlook(np.flatnonzero(calm), every_place).drift_factor(time_s)
        return replace(
            best,
            without_motion=still,
            without_speckles=calm,
            without_background=dark,
            required_visits=fewest,
            required_drift_factor=factor,
            required_contrast_factor=contrast,
        )
