"""Sums of many frames over the dark hole: a fraction of the cost of frames.

Only the pixels of the hole see the star and are drawn; light elsewhere smears into their columns. That is exact where
no charge of other pixels enters the hole (bloomed columns, register tails, deferred charge) and where frames add up
(`simulator.camera.camera`); `hole_stackable` says whether, and by which limit not. A sum over frames of different
light has the law of one draw of its mean: a visit of many is drawn once, whatever the epochs of its wavefront, and so
are all visits where only their sum counts.

The star's light comes from an expansion (`simulator.imaging.visit_light`), which draws other numbers for a wavefront
than frames do; from a transform a wavefront, with the numbers of the frames, where the errors are too large for it and
by the settings of the reference.
"""

import dataclasses
import functools
from typing import Any

import numpy as np

from cpic_core import FloatArray, InputError, NDArray, Outcome, Reason, Record, Status, check_whole
from simulator.camera import stack_electrons, stackable
from simulator.detectors import Blooming, Exposure, Smear, excess_noise_factor2
from simulator.imaging import ExternalPsf, FocalGrid, TablePsf, VisitLight, centred_axis, expands, visit_light
from simulator.ledger import SUM_EPOCHS
from simulator.observing.observation import (
    MAX_VISIT,
    Observation,
    Visit,
    brightest_stamp,
    table_stamps,
    visit_stamps,
    visit_waves,
)
from simulator.observing.sequence import MAX_REALISATION

# A pixel beyond the hole overflows by chance: once in 3e6 pixel-frames at the margin, by a fraction of its noise.
_MARGIN_SIGMA = 5.0


class HoleStacks(Record, eq=False):
    """Sums of frames over the dark hole; made by `hole_stacks`.

    Attributes
    ----------
    observation : Observation
        Settings, light and optics.
    static_e_s : ndarray, shape (n, n)
        Mean electrons per second of everything but the central star.
    region : ndarray of bool, shape (n, n)
        Pixels that are drawn: the dark hole.
    epochs : int
        Wavefronts of a visit.
    star : VisitLight, FocalGrid, TablePsf or ndarray
        What gives the star's light on rows and columns of the hole: an expansion, a transform of each wavefront, the
        speckles of a table, or an image that does not change.
    """

    observation: Observation
    static_e_s: FloatArray
    region: NDArray[np.bool_]
    epochs: int
    star: VisitLight | FocalGrid | TablePsf | FloatArray
    _place: tuple[NDArray[np.intp], NDArray[np.intp]]

    @property
    def frames(self) -> NDArray[np.int64]:
        """Number of frames in each epoch of a visit, shape (epochs,)."""
        edges = [-(-epoch * self.observation.n_frames // self.epochs) for epoch in range(self.epochs + 1)]
        return np.diff(edges)

    def counts(self, visits: int = 1, *, summed: bool = False) -> NDArray[np.int64]:
        """Return the number of frames in each draw of `draw`, shape (k,)."""
        each = self.observation.n_frames
        if summed:
            return np.array([visits * each])
        return self.frames if visits == 1 else np.full(visits, each)

    def with_light(self, extra_e_s: FloatArray) -> "HoleStacks":
        """Return the same with more light (a planet elsewhere), electrons per second and pixel, shape (n, n)."""
        return dataclasses.replace(self, static_e_s=self.static_e_s + extra_e_s)

    def mean_rates(self, realisation: int = 0, visit: int = 0, visits: int = 1, *, summed: bool = False) -> FloatArray:
        """Return mean electrons per second and pixel of every draw of `draw`, (k, n, n); 0 beyond the hole."""
        stars = self._stars(self._visits(realisation, visit, visits), summed)
        return self._whole(self.observation.truth.sources[0].rate_e_s * stars + self.static_e_s[self._place])

    def draw(self, realisation: int = 0, visit: int = 0, visits: int = 1, *, summed: bool = False) -> FloatArray:
        """Return the sums of frames in electrons at the register input; bias and the mean of the smear are taken off.

        Parameters
        ----------
        realisation : int
            Number of drift and noise, 0 to 2**31 - 1; see `simulator.observing.observation.observe`.
        visit : int
            Number of the first visit in a programme, from 0, at the observation's timing.
        visits : int
            How many visits: of one every epoch is a draw, of many every visit.
        summed : bool
            One draw of all frames of all of them.

        Returns
        -------
        ndarray, shape (k, n, n)
            0 beyond the hole. Dark current, clock-induced charge and the noise of the smear are part of it.
        """
        every, sequence = self._visits(realisation, visit, visits), self.observation
        stars = sequence.truth.sources[0].rate_e_s * self._stars(every, summed)
        counts, drawn = self.counts(visits, summed=summed), np.empty_like(stars)
        for count in np.unique(counts):
            # Pixels are drawn each for itself: images of as many frames below each other in one draw.
            these = counts == count
            path = (*every[0].path, "stack", "sum" if summed else "visits", visits, int(count))
            exposure = self._lit(stars[these])
            sums = stack_electrons(sequence.camera_chain, exposure, int(count), seed=sequence.seed, path=path)
            drawn[these] = sums.reshape(-1, *drawn.shape[1:])
        drawn -= counts[:, None, None] * sequence.smear_e[self._place]
        return self._whole(drawn)

    def _visits(self, realisation: int, visit: int, visits: int) -> list[Visit]:
        number = check_whole("realisation", realisation, 0, MAX_REALISATION)
        first = check_whole("visit", visit, 0, MAX_VISIT)
        last = first + check_whole("visits", visits, 1, MAX_VISIT + 1 - first)
        one = self.observation.visit
        return [dataclasses.replace(one, realisation=number, number=turn) for turn in range(first, last)]

    def _stars(self, visits: list[Visit], summed: bool) -> FloatArray:
        """Return the mean of the unit star on rows and columns of the hole in every draw."""
        sequence, star = self.observation, self.star
        shares = self.frames / sequence.n_frames
        visit_s = (sequence.exposure_s + sequence.readout_s) * sequence.n_frames
        if isinstance(star, TablePsf):
            whole = table_stamps(star, sequence.instrument.drift, visit_s, sequence.seed, visits)
            seen = np.asarray(whole[(slice(None), *self._place)])
            if summed:
                return np.asarray(seen.mean(axis=0, keepdims=True))
            return seen if len(visits) > 1 else np.repeat(seen, self.epochs, axis=0)
        if isinstance(star, np.ndarray):
            return np.broadcast_to(star, (self.counts(len(visits), summed=summed).size, *star.shape))
        given = sequence.instrument.drift, self.epochs, visit_s, sequence.seed
        if isinstance(star, FocalGrid):
            images = (visit_stamps(star, *given, one) for one in visits)
            if len(visits) == 1 and not summed:
                return next(images)
            means = (np.tensordot(shares, image, 1) for image in images)
            return np.asarray(sum(means) / len(visits))[None] if summed else np.stack(list(means))
        waves = visit_waves(star, *given, visits)
        if summed:
            return star.images(waves.reshape(1, -1, waves.shape[-1]), np.tile(shares, len(visits)) / len(visits))
        return star.images(waves[0][:, None]) if len(visits) == 1 else star.images(waves, shares)

    def _whole(self, images: FloatArray) -> FloatArray:
        """Return images of the rows and columns of the hole on the stamp, 0 beyond the hole."""
        whole = np.zeros((len(images), *self.region.shape))
        whole[:, *self._place] = images
        whole[:, ~self.region] = 0.0
        return whole

    def _lit(self, stars_e_s: FloatArray) -> Exposure:
        """Return the exposure of the hole under each light of the star, below each other; light adds to all else."""
        still, n = self._still, len(stars_e_s)
        light = stars_e_s * self._response
        mean = still.mean_e + self.observation.exposure_s * light
        line_s = still.detector.line_shift_s
        if line_s:
            mean += np.array([Smear.smear_e(one, slice(None), line_s, 0.0) for one in light])
        below: dict[str, Any] = {
            name: np.concatenate([array] * n)
            for name in ("cic_e", "bias_adu", "flaws", "smear_e")
            if (array := getattr(still, name)) is not None
        }
        return dataclasses.replace(still, mean_e=mean.reshape(-1, mean.shape[-1]), **below)

    @functools.cached_property
    def _still(self) -> Exposure:
        """The exposure of the hole without the star on its rows and columns."""
        whole = self.observation.mean_rate_map.copy()
        whole[self._place] = self.static_e_s[self._place]
        exposure = self.observation.prepared(whole)
        cut: dict[str, Any] = {
            name: np.ascontiguousarray(array[self._place])
            for name in ("mean_e", "cic_e", "bias_adu", "flaws", "smear_e")
            if (array := getattr(exposure, name)) is not None
        }
        stripes = None if exposure.stripe_adu is None else exposure.stripe_adu[self._place[1][0]]
        return dataclasses.replace(exposure, stripe_adu=stripes, **cut)

    @functools.cached_property
    def _response(self) -> FloatArray | float:
        """Sensitivity of the pixels of the hole."""
        camera, shape = self.observation.camera_chain, self.observation.shape
        response = camera.response(shape, self.observation.first_pixel)
        return response[self._place] if isinstance(response, np.ndarray) else response


def hole_stacks(observation: Observation, *, epochs: int = SUM_EPOCHS, exact: bool | None = None) -> HoleStacks:
    """Prepare sums of frames of an observation over its dark hole.

    Parameters
    ----------
    observation : Observation
        With ``window="hole"`` and the star behind the mask.
    epochs : int
        Wavefronts of a visit, at least 1; a visit of fewer frames has one a frame.
    exact : bool, optional
        Whether each wavefront is propagated, with the random numbers of frames. By default only where the expansion
        does not hold (`simulator.imaging.expands`), and by the settings of the reference.

    Raises
    ------
    InputError
        If frames of this observation do not add up over the hole (`hole_stackable`).
    """
    check_whole("epochs", epochs, 1, 1000)
    if observation.window != "hole" or any(observation.star_offset_arcsec):
        raise InputError("window", observation.window, allowed="hole, with the star behind the mask")
    answer = hole_stackable(observation)
    if answer.status is not Status.OK:
        raise InputError(
            "exposure_s",
            observation.exposure_s,
            unit="s",
            allowed="frames that add up over the hole",
            hint=answer.message,
        )
    region = observation.psf.geometry.hole
    rows, columns = np.flatnonzero(region.any(axis=1)), np.flatnonzero(region.any(axis=0))
    return HoleStacks(
        observation=observation,
        static_e_s=observation.light.static_e_s,
        region=region,
        epochs=min(epochs, observation.n_frames),
        star=_star_of(observation, rows, columns, exact),
        _place=(rows[:, None], columns[None]),
    )


def _star_of(
    observation: Observation, rows: NDArray[np.intp], columns: NDArray[np.intp], exact: bool | None
) -> VisitLight | FocalGrid | TablePsf | FloatArray:
    """Return what gives the light of the star on rows and columns of the stamp."""
    psf, drift = observation.psf, observation.instrument.drift
    visit_s = (observation.exposure_s + observation.readout_s) * observation.n_frames
    if isinstance(psf, TablePsf):
        return psf
    if isinstance(psf, ExternalPsf):
        return np.asarray(psf.on_axis[np.ix_(rows, columns)])
    offset = centred_axis(len(psf.on_axis), psf.imager.pixel_scale_arcsec)
    y, x = (psf.imager.axis(offset[part], masked=True) for part in (rows, columns))
    if drift.rms_nm(visit_s) == 0.0:
        return psf.imager.focal_grid(y, x).image()
    if exact is None:
        exact = psf.imager.knobs.tier == "reference" or not expands(drift, visit_s)
    return psf.imager.focal_grid(y, x) if exact else visit_light(psf.imager, y, x, drift.psd_slope)


def hole_stackable(observation: Observation) -> Outcome[float]:
    """Return whether frames of an observation add up to one draw over the dark hole.

    Returns
    -------
    Outcome of float
        ``ok`` with the filled fraction of the nearest limit inside the hole; ``saturated`` with the limit that frames
        reach there, or whose overflow enters it; ``invalid`` where an effect is on that does not add up or moves
        charge.
    """
    camera = observation.camera_chain
    # An image of the hole alone cannot hold what other pixels leave behind.
    effects = (*camera.charge, *camera.voltage)
    moving = next((effect.switch for effect in effects if effect.in_sums == "moves_charge"), None)
    if moving:
        message = f"{moving} moves charge between pixels: switch it off"
        return Outcome.refuse(Status.INVALID, Reason.NOT_ADDITIVE, message)
    psf, rates = observation.psf, observation.mean_rate_map
    star = observation.light.star
    if isinstance(psf, TablePsf) and star is not None:
        # A residual that is large beside the light of the star makes other visits brighter than this one.
        visit_s = (observation.exposure_s + observation.readout_s) * observation.n_frames
        stamp = brightest_stamp(psf, observation.instrument.drift, visit_s, observation.visit)
        bright = dataclasses.replace(star, rate_e_s=observation.truth.sources[0].rate_e_s * stamp[None])
        rates = dataclasses.replace(observation.light, star=bright).mean()
    exposure = observation.prepared(rates)
    region = psf.geometry.hole
    inside = dataclasses.replace(exposure, mean_e=np.where(region, exposure.mean_e, 0.0))
    answer = stackable(camera, inside)
    if answer.status is not Status.OK or not observation.channel.multiplies:
        return answer
    # Overflow elsewhere is allowed as long as none of it arrives in the hole.
    charge = exposure.mean_e + _MARGIN_SIGMA * np.sqrt(exposure.mean_e)
    switches = exposure.detector.switches
    if switches.blooming:
        spilt = charge.copy()
        Blooming().expect(spilt, exposure)
        if not np.array_equal(spilt[region], charge[region]):
            return Outcome.refuse(Status.SATURATED, Reason.PIXEL_FULL_WELL, "bloomed columns enter the hole")
        charge = spilt
    if switches.register_full_well and _tail_enters(np.minimum(exposure.mean_e, charge), region, exposure):
        return Outcome.refuse(Status.SATURATED, Reason.REGISTER_FULL_WELL, "tails of the register enter the hole")
    return answer


def _tail_enters(mean_e: FloatArray, region: NDArray[np.bool_], exposure: Exposure) -> bool:
    """Return whether a run of pixels read before the hole holds more than the register passes on, with noise."""
    detector, gain = exposure.detector, exposure.em_gain
    factor2 = float(excess_noise_factor2(gain, detector.register_stages))
    rows = region.any(axis=1)
    held = np.concatenate([np.zeros((int(rows.sum()), 1)), np.cumsum(mean_e[rows], axis=1)], axis=1)
    inside = np.concatenate([[False], region.any(axis=0)])
    for first in np.flatnonzero(inside[1:] & ~inside[:-1]):
        light = held[:, first, None] - held[:, :first]  # of every run that ends at the hole
        room = detector.register_full_well_e * np.arange(first, 0, -1)
        if np.any(gain * (light + _MARGIN_SIGMA * np.sqrt(factor2 * light)) > room):
            return True
    return False
