"""The base of both cameras: a chain of effects on one detector, prepared once and exposed many times.

Poisson counts, transfer losses and the multiplication register act on every electron for itself, and the reads of a
ramp are reduced by sums and differences, so the sum of ``n`` frames has the law of one frame of ``n`` times the mean.
Limits and curves do not add up: where they matter, frames are drawn one by one.
"""

import functools
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

import numpy as np

from cpic_core import FloatArray, InputError, Outcome, PathPart, Reason, Status, stream
from simulator.camera.calibration_set import CalibrationSet, load_calibration_set
from simulator.config import AnyDetector, CosmicRayConfig
from simulator.detectors import Chain, Effect, Exposure, PastExposure, Work
from simulator.effects import draw_cosmic_rays

# A charge this many decay times old has left 2e-22 of what it leaves at once.
_FORGOTTEN = 50.0


def earlier_frames(
    runs: Iterable[tuple[int, int]],
    mean_e: Callable[[int], FloatArray],
    *,
    before: int,
    full_well_e: float,
    exposure_s: float,
    readout_s: float,
    decay_s: float,
) -> Iterator[PastExposure]:
    """Yield the earlier frames of a sequence as one past exposure for each run of equal light.

    Frames of equal light hold equal mean charge ``Q`` and differ in age. With one decay time ``tau`` they act together
    as one charge ``Q sum(exp(-(a_k - a) / tau))`` of the age ``a`` of the youngest: exact, in closed form, and at a
    cost that does not grow with the number of frames. The noise of the earlier frames, their cosmic rays and their own
    persistence (of second order) are left out, so that a frame never depends on which others were drawn.

    Parameters
    ----------
    runs : iterable of tuple of int
        First and last frame of each run of equal light, the last one excluded; from the youngest to the oldest.
    mean_e : callable
        Mean electrons of a frame, by its number.
    before : int
        The frame that sees them; runs end at it or earlier.
    full_well_e : float
        Most that a pixel holds.
    exposure_s, readout_s : float
        Frames follow each other after their sum, above 0.
    decay_s : float
        Decay time of the traps.

    Yields
    ------
    PastExposure
        From the youngest run to the oldest that is not forgotten.
    """
    pace = exposure_s + readout_s
    for begin, end in runs:
        age = readout_s + (before - end) * pace
        if age > _FORGOTTEN * decay_s:
            return
        # the geometric series of exp(-pace / tau), stable where pace << tau
        weight = math.expm1(-(end - begin) * pace / decay_s) / math.expm1(-pace / decay_s)
        yield PastExposure(np.minimum(mean_e(begin), full_well_e) * weight, age)


# Chance of a Gaussian beyond: 1e-15, once in 1e9 frames of a million pixels.
MARGIN_SIGMA = 8.0
MAX_FRAMES = 1_000_000
# Keeps sums over a column or a frame inside the whole numbers of float64 and int64; any full well is far below.
MAX_MEAN_E = 1e12
MAX_EXPOSURE_S = 1e6


class Camera:
    """A chain of effects on a detector.

    Parameters
    ----------
    detector : Detector or InfraredDetector
        Everything about the camera, switches included.
    cosmic_rays : CosmicRayConfig, optional
        Particles; none without it.
    cosmic_ray_rate_per_s_cm2 : float
        Their rate at the date of the observation.
    chain : sequence of Effect, optional
        Effects in their order; those of the detector if not given.

    Notes
    -----
    Effects whose switch is off are not run, and leave the random numbers of the others as they are.
    """

    def __init__(
        self,
        detector: AnyDetector,
        *,
        cosmic_rays: CosmicRayConfig | None = None,
        cosmic_ray_rate_per_s_cm2: float = 0.0,
        chain: Chain | None = None,
    ) -> None:
        self._rays, self._rate = cosmic_rays, cosmic_ray_rate_per_s_cm2
        self.particles = cosmic_rays is not None and cosmic_ray_rate_per_s_cm2 > 0
        self.detector: Any = detector
        every = detector.chain if chain is None else chain
        running = [effect for effect in every if effect.runs(detector) and self._there(effect)]
        self.light = tuple(effect for effect in running if effect.stage == "light")
        self.charge = tuple(effect for effect in running if effect.stage == "charge")
        self.voltage = tuple(effect for effect in running if effect.stage == "voltage")

    def _there(self, effect: Effect) -> bool:
        return self.particles or effect.switch != "cosmic_rays"

    def response(self, shape: tuple[int, int], first_pixel: tuple[int, int] | None) -> FloatArray | float:
        """Return the sensitivity of the pixels of a window, 1 on average.

        Parameters
        ----------
        shape : tuple of int
            Rows and columns of the window.
        first_pixel : tuple of int or None
            Row and column of the frame at which it begins; around the star if None.
        """
        flaws = flaws_of(self.detector, shape, corner_of(self.detector, shape, first_pixel))
        return 1.0 if flaws is None else flaws.response_of(self.detector.switches)

    def fills(self, exposure: Exposure) -> dict[Reason, float]:
        """Return how far frames fill every limit, eight sigma of noise included; 1 is full."""
        raise NotImplementedError

    def summed(self, exposure: Exposure, n_frames: int, work: Work) -> FloatArray:
        """Return the sum of frames, electrons at the register input without the fixed bias, as one draw.

        Parameters
        ----------
        exposure : Exposure
            Of one frame.
        n_frames : int
            Number of frames, none of which reaches a limit.
        work : Work
            An empty frame.
        """
        raise NotImplementedError

    def _tracks(self, detector: AnyDetector, exposure_s: float) -> Any:
        """Return what draws the particles of one frame."""
        if self._rays is None or not self.particles:
            return None
        rate = self._rate
        return functools.partial(
            draw_cosmic_rays, self._rays, pixel_um=detector.pixel_um, exposure_s=exposure_s, rate_per_s_cm2=rate
        )


def stackable(camera: Camera, exposure: Exposure) -> Outcome[float]:
    """Return whether frames of an exposure add up to one draw.

    Returns
    -------
    Outcome of float
        ``ok`` with the filled fraction of the nearest limit (eight sigma of noise included); else ``saturated`` with
        the limit that frames can reach, or ``invalid`` where an effect that is no sum is switched on.
    """
    running = (effect for effect in (*camera.charge, *camera.voltage) if effect.on(exposure.detector))
    alone = next((effect.switch for effect in running if effect.in_sums == "not_additive"), None)
    if alone:
        message = f"{alone} does not add up over frames: switch it off"
        return Outcome.refuse(Status.INVALID, Reason.NOT_ADDITIVE, message)
    fills = camera.fills(exposure)
    reason = max(fills, key=lambda name: fills[name])
    if fills[reason] > 1.0:
        return Outcome.refuse(Status.SATURATED, reason, f"frames can reach {fills[reason]:.3g} times a limit")
    return Outcome.ok(fills[reason])


def stack_electrons(
    camera: Camera, exposure: Exposure, n_frames: int, *, seed: int, path: Sequence[PathPart]
) -> FloatArray:
    """Return the sum of ``n_frames`` frames in electrons at the register input, the fixed bias taken off: one draw.

    Parameters
    ----------
    camera : VisibleCamera or InfraredCamera
    exposure : Exposure
        What ``camera.prepare`` made for one frame.
    n_frames : int
        Number of frames, 1 to 1e6.
    seed, path
        As `VisibleCamera.expose`; the draws are those of no single frame.

    Returns
    -------
    ndarray
        Mean, variance and law of the sum over frames of ``(adu - bias) K / g``; level, map and stripes of the bias are
        off. The converter's rounding enters as its variance, ``n / 12`` ADU^2.

    Raises
    ------
    InputError
        If frames can saturate or an effect is switched on that does not add up (see `stackable`), or the number of
        frames is out of range.
    """
    if isinstance(n_frames, bool) or not isinstance(n_frames, int | np.integer) or not 1 <= n_frames <= MAX_FRAMES:
        raise InputError("n_frames", n_frames, allowed=f"an integer from 1 to {MAX_FRAMES}")
    time, answer = exposure.exposure_s, stackable(camera, exposure)
    if answer.status is not Status.OK:
        raise InputError("exposure_s", time, unit="s", allowed="frames that add up to one draw", hint=answer.message)
    return camera.summed(exposure, int(n_frames), begun(exposure, seed, path))


def flaws_of(detector: AnyDetector, shape: tuple[int, ...], corner: tuple[int, int] | None) -> CalibrationSet | None:
    """Return the calibration set of a frame or of a window of it; None where all of it is switched off.

    Parameters
    ----------
    detector : Detector or InfraredDetector
    shape : tuple of int
        Rows and columns.
    corner : tuple of int or None
        Row and column of the frame at which a window begins; None for the whole frame.

    Raises
    ------
    InputError
        For a window that reaches beyond the active pixels.
    """
    seeded = [effect.switch for effect in detector.chain if effect.seeded]
    if not detector.maps and not any(getattr(detector.switches, name) for name in seeded):
        return None
    whole = load_calibration_set(detector)
    if corner is None:
        return whole
    (rows, columns), (row, column) = detector.sections["active"], corner
    inside, size = rows.start <= row and row + shape[0] <= rows.stop, detector.active_shape
    if not (inside and columns.start <= column and column + shape[1] <= columns.stop):
        window = f"window of {shape[0]} x {shape[1]} from row {row}, column {column}"
        allowed = f"a window of the {size[0]} x {size[1]} active pixels, or the whole frame"
        raise InputError("rate_map_e_s", window, allowed=allowed, hint=f"or switch off {', '.join(seeded)}")
    return whole.window(slice(row, row + shape[0]), slice(column, column + shape[1]))


def corner_of(
    detector: AnyDetector, shape: tuple[int, ...], first_pixel: tuple[int, int] | None
) -> tuple[int, int] | None:
    """Return the row and column of the frame at which a window begins, around the star by default; None for a frame.

    Parameters
    ----------
    detector : Detector or InfraredDetector
    shape : tuple of int
        Rows and columns of the window.
    first_pixel : tuple of int or None
        Where it begins.

    Raises
    ------
    InputError
        For anything but two integers.
    """
    if first_pixel is None:
        around = (detector.star_row - shape[0] // 2, detector.star_column - shape[1] // 2)
        return None if shape == detector.shape else around
    whole = isinstance(first_pixel, tuple | list) and all(isinstance(i, int | np.integer) for i in first_pixel)
    if not whole or len(first_pixel) != 2:
        raise InputError("first_pixel", first_pixel, unit="px", allowed="row and column of the frame, integers")
    return int(first_pixel[0]), int(first_pixel[1])


def begun(exposure: Exposure, seed: int, path: Sequence[PathPart], past: Sequence[Any] = ()) -> Work:
    """Return an empty frame with its random streams.

    Parameters
    ----------
    exposure : Exposure
    seed : int
        Seed of the run.
    path : sequence of str or int
        Names of target, role, band, realisation, frame.
    past : sequence
        Earlier frames and their age.

    Raises
    ------
    InputError
        For a path that is one string.
    """
    if isinstance(path, str):
        raise InputError("path", path, allowed="a sequence of names, not one string")
    shape = exposure.mean_e.shape
    return Work(np.zeros(shape), np.zeros(shape, dtype=np.bool_), functools.partial(stream, seed, *path), past=past)


def run(effects: Sequence[Effect], work: Work, exposure: Exposure) -> None:
    """Draw effects on a frame in their order, each from the stream of its switch."""
    for effect in effects:
        effect.draw(work, exposure, work.stream(effect.switch))


def means(effects: Sequence[Effect], image: FloatArray, exposure: Exposure) -> FloatArray:
    """Return a mean image after effects in their order; changed in place."""
    for effect in effects:
        effect.expect(image, exposure)
    return image
