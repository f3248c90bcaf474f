"""Sums of many frames over the dark hole, one draw per epoch of the drift: a fraction of the cost of frames.

Only the pixels of the hole are propagated and drawn; light elsewhere smears into their columns. That is exact where no
charge of other pixels enters the hole (bloomed columns, register tails, deferred charge) and where frames add up
(`simulator.camera.visible`);
`hole_stackable` says whether, and by which limit not. The drift of a visit is drawn from the streams of the frames: a
visit has the same frozen offset whether it is drawn as frames or as sums, while the random walk is sampled at fewer
epochs.
"""

import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np

from cpic_core import FloatArray, InputError, NDArray, Outcome, Reason, Status, check_whole
from simulator.camera import stack_electrons, stackable
from simulator.detectors import Blooming, Exposure, excess_noise_factor2
from simulator.imaging import ExternalPsf, FocalGrid, centred_axis
from simulator.ledger import SUM_EPOCHS
from simulator.observing.observation import Observation
from simulator.observing.scene_light import MAX_VISIT, Visit, visit_stamps
from simulator.observing.sequence import MAX_REALISATION

# A pixel beyond the hole overflows by chance: once in 3e6 pixel-frames at the margin, by a fraction of its noise.
_MARGIN_SIGMA = 5.0


@dataclass(frozen=True, eq=False)
class HoleStacks:
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
        Draws of a sequence.
    """

    observation: Observation
    static_e_s: FloatArray
    region: NDArray[np.bool_]
    epochs: int
    _grid: FocalGrid | None
    _rows: NDArray[np.intp]
    _columns: NDArray[np.intp]

    @property
    def frames(self) -> NDArray[np.int64]:
        """Number of frames in each draw, shape (epochs,)."""
        edges = [-(-epoch * self.observation.n_frames // self.epochs) for epoch in range(self.epochs + 1)]
        return np.diff(edges)

    def with_light(self, extra_e_s: FloatArray) -> "HoleStacks":
        """Return the same with more light (a planet elsewhere), electrons per second and pixel, shape (n, n)."""
        return dataclasses.replace(self, static_e_s=self.static_e_s + extra_e_s)

    def mean_rates(self, realisation: int = 0, visit: int = 0) -> FloatArray:
        """Return mean electrons per second and pixel in every epoch of one visit, (epochs, n, n); 0 beyond the hole.

        Parameters
        ----------
        realisation, visit
            As of `draw`.
        """
        star = self.observation.truth.sources[0].rate_e_s * self._stamps(self._visit(realisation, visit))
        rates = np.zeros((self.epochs, *self.region.shape))
        place = np.ix_(self._rows, self._columns)
        for epoch, stamp in enumerate(star):
            rates[epoch][place] = stamp + self.static_e_s[place]
        return rates

    def draw(self, realisation: int = 0, visit: int = 0) -> FloatArray:
        """Return the sums of frames in electrons at the register input; bias and the mean of the smear are taken off.

        Parameters
        ----------
        realisation : int
            Number of drift and noise, 0 to 2**31 - 1; see `simulator.observing.observation.observe`.
        visit : int
            Number of the visit in a programme, from 0, at the observation's timing.

        Returns
        -------
        ndarray, shape (epochs, n, n)
            0 beyond the hole. Dark current, clock-induced charge and the noise of the smear are part of it.
        """
        one, sequence = self._visit(realisation, visit), self.observation
        stamps = sequence.truth.sources[0].rate_e_s * self._stamps(one)
        sums = np.zeros((self.epochs, *self.region.shape))
        camera = sequence.visible_camera
        place = np.ix_(self._rows, self._columns)
        for epoch, count in enumerate(self.frames):
            whole = sequence.mean_rate_map.copy()
            whole[place] = stamps[epoch] + self.static_e_s[place]
            exposure = self._cropped(sequence.prepared(whole))
            drawn = stack_electrons(camera, exposure, int(count), seed=sequence.seed, path=(*one.path, "stack", epoch))
            sums[epoch][place] = drawn - count * sequence.smear_e[place]
        sums[:, ~self.region] = 0.0
        return sums

    def _visit(self, realisation: int, visit: int) -> Visit:
        number, turn = (
            check_whole("realisation", realisation, 0, MAX_REALISATION),
            check_whole("visit", visit, 0, MAX_VISIT),
        )
        return dataclasses.replace(self.observation.visit, realisation=number, number=turn)

    def _stamps(self, one: Visit) -> FloatArray:
        """Return the unit star on rows and columns of the hole at every epoch."""
        sequence = self.observation
        if self._grid is None:
            fixed = sequence.psf.on_axis[np.ix_(self._rows, self._columns)]
            return np.broadcast_to(fixed, (self.epochs, *fixed.shape))
        visit_s = (sequence.exposure_s + sequence.readout_s) * sequence.n_frames
        return visit_stamps(self._grid, sequence.instrument.drift, self.epochs, visit_s, sequence.seed, one)

    def _cropped(self, exposure: Exposure) -> Exposure:
        place = np.ix_(self._rows, self._columns)
        cut: dict[str, Any] = {
            name: np.ascontiguousarray(array[place])
            for name in ("mean_e", "cic_e", "bias_adu", "flaws", "smear_e")
            if (array := getattr(exposure, name)) is not None
        }
        stripes = None if exposure.stripe_adu is None else exposure.stripe_adu[self._columns]
        return dataclasses.replace(exposure, stripe_adu=stripes, **cut)


def hole_stacks(observation: Observation, *, epochs: int = SUM_EPOCHS) -> HoleStacks:
    """Prepare sums of frames of an observation over its dark hole.

    Parameters
    ----------
    observation : Observation
        Of the visible camera with ``window="hole"`` and the star behind the mask.
    epochs : int
        Draws of a sequence, at least 1; a sequence of fewer frames has one draw a frame.

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
    grid = None
    if not isinstance(observation.psf, ExternalPsf):
        imager = observation.psf.imager
        offset = centred_axis(len(region), imager.pixel_scale_arcsec)
        grid = imager.focal_grid(imager.axis(offset[rows], masked=True), imager.axis(offset[columns], masked=True))
    return HoleStacks(
        observation=observation,
        static_e_s=observation.light.static_e_s,
        region=region,
        epochs=min(epochs, observation.n_frames),
        _grid=grid,
        _rows=rows,
        _columns=columns,
    )


def hole_stackable(observation: Observation) -> Outcome[float]:
    """Return whether frames of an observation add up to one draw over the dark hole.

    Returns
    -------
    Outcome of float
        ``ok`` with the filled fraction of the nearest limit inside the hole; ``saturated`` with the limit that frames
        reach there, or whose overflow enters it; ``invalid`` where an effect is on that does not add up or moves
        charge.
    """
    if not observation.channel.multiplies:
        return Outcome.refuse(Status.INVALID, Reason.NOT_ADDITIVE, f"{observation.band} is read by the infrared camera")
    camera = observation.visible_camera
    # An image of the hole alone cannot hold what other pixels leave behind.
    moving = next((effect.switch for effect in camera.charge if effect.in_sums == "moves_charge"), None)
    if moving:
        message = f"{moving} moves charge between pixels: switch it off"
        return Outcome.refuse(Status.INVALID, Reason.NOT_ADDITIVE, message)
    exposure = observation.prepared(observation.mean_rate_map)
    region = observation.psf.geometry.hole
    inside = dataclasses.replace(exposure, mean_e=np.where(region, exposure.mean_e, 0.0))
    answer = stackable(camera, inside)
    if answer.status is not Status.OK:
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
