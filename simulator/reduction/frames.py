"""A sequence on its way through the reduction: raw frames in a scratch file, cosmic rays in time, means with errors.

A frame is in memory at a time, and a strip of rows of all frames where a pixel is compared with itself in time, so that
memory does not depend on the number of frames.
"""

import contextlib
import math
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

import numpy as np

from cpic_core import FloatArray, IntArray, NDArray
from simulator.camera import FrameNoise, MaskBit
from simulator.detectors import output_curve
from simulator.reduction.cosmic_rays import grown, reject_cosmic_rays
from simulator.reduction.level0 import Level0
from simulator.reduction.steps import Calibration, FrameLevel, Master, Pixels, frame_level

# Values of a strip of all frames: a dozen arrays of 8 bytes in the rejection.
_STRIP_VALUES = 1_000_000
_LIMIT_SHARE = 0.95
MOST_SATURATED = 0.05
"""Share of its frames in which a pixel may be saturated; where it is in more, its own light does it in all."""
_BOX = 5
_SURE = 2.0  # scatter of 25 pixels is this many times their noise by chance in one box of a thousand
_USELESS = np.uint8(MaskBit.BAD | MaskBit.SATURATED)


@dataclass(eq=False)
class Staged:
    """Frames of a sequence without bias and level, ADU, in files that vanish with this.

    Attributes
    ----------
    level0 : Level0
        The first file; all have its shape, gain and exposure.
    levels_adu : list of float
        Mean level of each frame.
    own : list of mapping
        Keywords of each frame.
    saturated : ndarray of int, shape (y, x)
        Frames in which a pixel reached a limit.
    """

    level0: Level0
    levels_adu: list[float] = field(default_factory=list)
    own: list[dict[str, Any]] = field(default_factory=list)
    saturated: IntArray = field(init=False)
    _images: IO[bytes] = field(init=False)
    _masks: IO[bytes] = field(init=False)

    def __len__(self) -> int:
        return len(self.levels_adu)

    def add(self, adu: FloatArray, mask: NDArray[np.uint8]) -> None:
        """Keep one more frame."""
        self._images.write(np.ascontiguousarray(adu, dtype=np.float32).data)
        self._masks.write(np.ascontiguousarray(mask).data)

    def frame(self, index: int) -> tuple[FloatArray, NDArray[np.uint8]]:
        """Return a frame: ADU, and mask with hits and their neighbours."""
        image, mask = self._strip(index, 0, self.level0.shape[0])
        hit = (mask & MaskBit.COSMIC_RAY) != 0
        mask[grown(hit[None])[0]] |= np.uint8(MaskBit.COSMIC_RAY)
        if len(self) > 1:
            mask[self.saturated > max(1.0, MOST_SATURATED * len(self))] |= np.uint8(MaskBit.SATURATED)
        return image.astype(np.float64), mask

    def _strip(self, index: int, first: int, n_rows: int) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
        rows, columns = self.level0.shape
        place, count = (index * rows + first) * columns, n_rows * columns
        found: list[Any] = []
        for file, kind in ((self._images, np.float32), (self._masks, np.uint8)):
            size = np.dtype(kind).itemsize
            file.seek(place * size)
            found.append(np.frombuffer(file.read(count * size), dtype=kind).reshape(n_rows, columns).copy())
        return found[0], found[1]

    def reject(self) -> None:
        """Mark what cosmic rays hit, pixel by pixel in time; nothing with a single frame, which has no other."""
        if len(self) < 2:
            return
        (rows, columns), detector = self.level0.shape, self.level0.detector
        gain, step = self.level0.em_gain, max(1, _STRIP_VALUES // (len(self) * self.level0.shape[1]))
        for first in range(0, rows, step):
            n_rows = min(step, rows - first)
            parts = [self._strip(index, first, n_rows) for index in range(len(self))]
            frames = np.stack([image for image, _ in parts]).astype(np.float64) * (detector.gain_e_adu / gain)
            usable = np.stack([(mask & _USELESS) == 0 for _, mask in parts])
            hit = reject_cosmic_rays(
                frames,
                usable,
                em_gain=gain,
                read_noise_e=detector.read_noise_e,
                stages=detector.register_stages,
                gain_e_adu=detector.gain_e_adu,
                grow=False,
            ).rejected
            for index in np.flatnonzero(hit.any(axis=(1, 2))):
                mask = parts[index][1] | np.where(hit[index], np.uint8(MaskBit.COSMIC_RAY), np.uint8(0))
                self._masks.seek((int(index) * rows + first) * columns)
                self._masks.write(mask.data)

    def mean(self) -> tuple[FloatArray, IntArray]:
        """Return the mean of the usable frames of each pixel (0 without any) and their number."""
        total, count = np.zeros(self.level0.shape), np.zeros(self.level0.shape, dtype=np.int64)
        for index in range(len(self)):
            self.tally(*self.frame(index), total, count)
        return total / np.maximum(count, 1), count

    @staticmethod
    def tally(image: FloatArray, mask: NDArray[np.uint8], total: FloatArray, count: IntArray) -> None:
        """Add the pixels of a frame that nothing spoils to a sum and its count, in place."""
        good = (mask & (_USELESS | np.uint8(MaskBit.COSMIC_RAY))) == 0
        total += np.where(good, image, 0.0)
        count += good


@contextlib.contextmanager
def staged(files: Sequence[Level0], bias: Master, mean_e: FloatArray, scratch: Path | None = None) -> Iterator[Staged]:
    """Take bias and level off every frame of files of one gain and exposure.

    Parameters
    ----------
    files : sequence of Level0
    bias : Master
        Structure of the bias; 0 where it is not known.
    mean_e : ndarray, shape (y, x)
        Electrons that unlit pixels hold on average.
    scratch : Path, optional
        Folder with room for the frames, 5 bytes a pixel; that of temporary files by default.

    Yields
    ------
    Staged
    """
    level0 = files[0]
    unlit, detector = level0.unlit(), level0.detector
    fit: FrameLevel | None = None
    if unlit.any():
        fit = frame_level(detector, level0.em_gain, level0.exposure_s, unlit=unlit, mean_e=mean_e)
    found = Staged(level0)
    found.saturated = np.zeros(level0.shape, dtype=np.int64)
    limit_e = min(detector.full_well_e * level0.em_gain, detector.register_full_well_e)
    limit_e /= 1.0 + output_curve(detector) * limit_e
    limit_adu = min(detector.adc_max_adu, detector.bias_adu + _LIMIT_SHARE * limit_e / detector.gain_e_adu)
    with tempfile.TemporaryFile(dir=scratch) as found._images, tempfile.TemporaryFile(dir=scratch) as found._masks:
        for file in files:
            for raw, own in file.iter_raw():
                # What spills over fills the last pixel it reaches in part.
                mask = grown(raw[None] >= limit_adu)[0] * np.uint8(MaskBit.SATURATED)
                finite = np.isfinite(raw)
                if not finite.all():
                    mask[~finite] = np.uint8(MaskBit.BAD)
                    raw[~finite] = detector.bias_adu
                image = raw - bias.value
                level = fit.of(image, finite) if fit is not None else None
                if level is None:
                    level = np.full(1, np.median(image[unlit]) if unlit.any() else detector.bias_adu)
                image -= level
                found.saturated += (mask & np.uint8(MaskBit.SATURATED)) != 0
                found.levels_adu.append(float(level.mean()))
                found.own.append(own)
                found.add(image, mask)
        yield found


def raw_variance(mean_adu: FloatArray, known: Calibration, level0: Level0) -> FloatArray:
    """Return the variance of a pixel of one frame, ADU^2, by its mean without bias and level.

    The register multiplies ``q`` electrons to a variance ``F^2 g^2 q`` with the exact ``F^2`` of its stages
    (`simulator.detectors.gain`); the output's curve flattens that by the square of its slope; amplifier and converter
    add theirs.

    Parameters
    ----------
    mean_adu : ndarray, shape (y, x)
    known : Calibration
    level0 : Level0
    """
    noise, gain = FrameNoise.of(level0.detector, known.em_gain, level0.exposure_s), known.em_gain
    seen_e = np.maximum(mean_adu, 0.0) * known.gain_e_adu
    slope = (1.0 - known.output_b * seen_e) ** 2
    counted = noise.factor2 * gain * seen_e / (1.0 - known.output_b * seen_e) * slope**2
    return np.asarray((counted + noise.gaussian_e2 * gain**2) / known.gain_e_adu**2)


def expected(mean_adu: FloatArray, count: IntArray, known: Calibration, level0: Level0) -> FloatArray:
    """Return the expected level of each pixel: between its mean over frames and that of its neighbours.

    A variance that is taken from the noise of the pixel itself is low where the pixel came out low. The mean over
    frames is therefore drawn to that of 5 x 5 pixels by as much as their scatter is noise (the filter of Lee 1980, IEEE
    Transactions on Pattern Analysis and Machine Intelligence 2, 165).

    Parameters
    ----------
    mean_adu : ndarray, shape (y, x)
        Mean of the usable frames.
    count : ndarray of int, shape (y, x)
        Their number.
    known : Calibration
    level0 : Level0
    """
    from scipy.ndimage import uniform_filter

    good = (count > 0).astype(np.float64)
    share = np.maximum(uniform_filter(good, _BOX), 1e-3)
    around = uniform_filter(mean_adu * good, _BOX) / share
    scatter = np.maximum(uniform_filter(mean_adu**2 * good, _BOX) / share - around**2, 1e-12)
    noise = raw_variance(around, known, level0) / np.maximum(count, 1)
    own = np.clip(1.0 - _SURE * noise / scatter, 0.0, 1.0)
    return np.asarray(around + own * (mean_adu - around))


def mean_pixels(frames: Staged, known: Calibration, *, mean_adu: FloatArray | None = None) -> Pixels:
    """Return the mean of frames with its variance, and with the noise of the bias that was taken off.

    Parameters
    ----------
    frames : Staged
    known : Calibration
    mean_adu : ndarray, optional
        Mean charge in ADU, where it is known without the frames.
    """
    mean, count = frames.mean()
    likely = expected(mean, count, known, frames.level0) if mean_adu is None else mean_adu
    variance = raw_variance(likely, known, frames.level0) / np.maximum(count, 1)
    mask = np.where(count == 0, np.uint8(MaskBit.BAD), np.uint8(0))
    return Pixels(mean, variance, mask, {name: -one for name, one in known.bias.shared.items()})


def scatter_of(values: FloatArray) -> tuple[float, float]:
    """Return mean and standard deviation, 0 without values."""
    return (float(values.mean()), float(values.std())) if values.size else (0.0, math.nan)
