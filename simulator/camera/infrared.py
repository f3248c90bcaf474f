"""The near-infrared camera: from photon rate to the numbers of a frame, read once, twice, or up the ramp.

Light goes through the response of the pixels and dark current is added (`InfraredCamera.prepare`, noise-free, once for
a sequence). Each frame then collects photons, dark current, persistence and cosmic rays, and is read without
destroying the charge: non-linearity and full well, inter-pixel capacitance, reset and read noise, bias and range of the
converter. Reads are reduced before they are rounded to whole ADU.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from catalogs.errors import InputError
from simulator.camera.calibration_set import CalibrationSet
from simulator.camera.checks import checked_array, checked_rates, checked_scalar, element_name
from simulator.camera.frame import Frame, MaskBit
from simulator.camera.gain import pixel_keys
from simulator.camera.infrared_effects import (
    Coupling,
    ExponentialPersistence,
    PastExposure,
    Persistence,
    neighbour_kernel,
)
from simulator.camera.infrared_hits import Hits, checked_hits, hit_times, tracks_of
from simulator.camera.infrared_reads import ReadStack, read_times, well_signal
from simulator.camera.infrared_set import load_infrared_set
from simulator.camera.stage import KERNELS
from simulator.config.effects import CosmicRayConfig
from simulator.config.infrared import InfraredDetector
from simulator.effects.cosmic_rays import draw_cosmic_rays
from simulator.lazy import load_kernels
from simulator.rng import PathPart, stream

__all__ = ["InfraredCamera", "InfraredExposure"]

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

# Keeps sums over a frame inside 64-bit integers; any full well is far below.
MAX_MEAN_E = 1e12
MAX_RATE_E_S = 1e300
MAX_EXPOSURE_S = 1e6


@dataclass(frozen=True, eq=False)
class InfraredExposure:
    """The noise-free part of a frame: made once, exposed many times.

    Attributes
    ----------
    light_e, dark_e : ndarray
        Mean electrons that every pixel collects from light and as dark current.
    expected_adu : ndarray
        Mean ADU of every pixel, without noise, rounding, cosmic rays and persistence. Where a limit cuts off only the
        upper tail of the counts (within a few sigma of full well) the mean of noisy frames differs.
    exposure_s : float
        Time from the first read (the reset, for a single read) to the last.
    n_reads : int
        Reads that are taken.
    mask : ndarray of uint8
        Bits of `MaskBit` that belong to the pixels themselves.
    n_negative_rates : int
        Pixels whose rate was a rounding-error negative and was taken as 0.
    """

    light_e: FloatArray
    dark_e: FloatArray
    expected_adu: FloatArray
    exposure_s: float
    n_reads: int
    mask: npt.NDArray[np.uint8]
    n_negative_rates: int = 0

    @property
    def mean_e(self) -> FloatArray:
        """Mean electrons that every pixel collects."""
        return self.light_e + self.dark_e


class InfraredCamera:
    """The near-infrared camera.

    Parameters
    ----------
    detector : InfraredDetector
        Everything about the camera, switches included.
    cosmic_rays : CosmicRayConfig, optional
        Particles; none without it.
    cosmic_ray_rate_per_s_cm2 : float
        Their rate at the date of the observation.
    persistence : Persistence, optional
        What earlier frames leave; `ExponentialPersistence` of the configuration if not given.
    coupling : Coupling, optional
        Inter-pixel capacitance; the four nearest neighbours with ``interpixel_coupling`` if not given.

    Raises
    ------
    InputError
        For a plug-in whose switch is off, or a rate out of range.
    """

    def __init__(
        self,
        detector: InfraredDetector,
        *,
        cosmic_rays: CosmicRayConfig | None = None,
        cosmic_ray_rate_per_s_cm2: float = 0.0,
        persistence: Persistence | None = None,
        coupling: Coupling | None = None,
    ) -> None:
        self.detector = detector
        self._particles = cosmic_rays
        self._particle_rate = checked_scalar("cosmic_ray_rate_per_s_cm2", cosmic_ray_rate_per_s_cm2, low=0.0, high=1e12)
        switches = detector.switches
        for key, given, on in (
            ("persistence", persistence, switches.persistence),
            ("interpixel_capacitance", coupling, switches.interpixel_capacitance),
        ):
            if given is not None and not on:
                raise InputError(f"near_infrared.detector.switches.{key}", False, allowed="true with a plug-in for it")
        late = detector.persistence
        self._persistence = persistence or ExponentialPersistence(late.fraction, late.decay_s)
        self._coupling = coupling or neighbour_kernel(detector.interpixel_coupling)

    def prepare(
        self, rate_map_e_s: npt.ArrayLike, exposure_s: float, *, first_pixel: tuple[int, int] | None = None
    ) -> InfraredExposure:
        """Noise-free part of a frame.

        Parameters
        ----------
        rate_map_e_s : array_like
            Photo-electrons per second and pixel, 2-D (y, x): the whole frame, or a window of it.
        exposure_s : float
            Exposure of the frame, 0 to 1e6 s (0 is a bias frame).
        first_pixel : tuple of int, optional
            Row and column of the frame at which a window begins; around the star if not given.

        Raises
        ------
        InputError
            For a rate that is NaN, infinite or more negative than 1e-9 of the largest (naming the pixel), an exposure
            out of range, or a window that reaches beyond the frame while flaws of pixels are switched on.
        """
        detector, switches = self.detector, self.detector.switches
        rates, n_negative = checked_rates(rate_map_e_s)
        time = checked_scalar("exposure_s", exposure_s, low=0.0, high=MAX_EXPOSURE_S, unit="s")
        flaws = self._flaws(rates.shape, first_pixel)
        # The cap keeps products of the largest rates finite.
        light = np.minimum(rates, MAX_RATE_E_S)
        if flaws is not None:
            light = light * flaws.response_of(switches)
        if flaws is not None:
            dark, mask = flaws.dark_of(switches), flaws.mask_of(switches)
        else:
            dark = np.full(rates.shape, detector.dark_e_s if switches.dark else 0.0)
            mask = np.zeros(rates.shape, dtype=np.uint8)
        light_e, dark_e = np.minimum(light * time, MAX_MEAN_E), np.minimum(dark * time, MAX_MEAN_E)
        n_reads = detector.reads_of(time)
        mean = light_e + dark_e
        stack = ReadStack(detector.readout_mode, mean.shape, detector.bias_adu, detector.adc_max_adu)
        for fraction in read_times(detector.readout_mode, n_reads):
            signal, full = self._signal(fraction * mean)
            stack.add(float(fraction), signal / detector.gain_e_adu + detector.bias_adu, full)
        return InfraredExposure(
            light_e=light_e,
            dark_e=dark_e,
            expected_adu=stack.result()[0],
            exposure_s=time,
            n_reads=n_reads,
            mask=mask,
            n_negative_rates=n_negative,
        )

    def expected_adu(self, exposure: InfraredExposure) -> FloatArray:
        """Mean ADU of every pixel; see `InfraredExposure`."""
        return exposure.expected_adu

    def expose(
        self,
        exposure: InfraredExposure,
        *,
        seed: int,
        path: Sequence[PathPart],
        cosmic_rays: Hits | None = None,
        past: Sequence[PastExposure] = (),
    ) -> Frame:
        """One noisy frame.

        Parameters
        ----------
        exposure : InfraredExposure
            What `prepare` made.
        seed : int
            Seed of the run.
        path : sequence of str or int
            Names of target, role, band, realisation, frame. Each stage draws from ``stream(seed, *path, stage)``
            (``photon_noise``, ``dark``, ``persistence``, ``arrivals``, ``cosmic_rays``, ``cosmic_ray_times``,
            ``reset_noise``, ``read_noise``).
        cosmic_rays : tuple of array_like, optional
            Flat pixel indices and electrons of what particles left during the exposure, instead of those that the
            camera draws. Left out where their switch is off. In a ramp, pixels that touch were hit at one time.
        past : sequence of PastExposure, optional
            Earlier frames and their age, for persistence; of no effect where its switch is off.

        Returns
        -------
        Frame
            ``charge`` holds the electrons of the frame: ``photons``, ``dark``, ``persistence`` and ``cosmic_rays`` came
            in, ``stored`` stayed in the pixels and ``lost_full_well`` did not.

        Raises
        ------
        InputError
            For a path that is a string, hits outside the array, or charges of past frames that do not fit.
        """
        if isinstance(path, str):
            raise InputError("path", path, allowed="a sequence of names, not one string")
        detector, switches, shape = self.detector, self.detector.switches, exposure.light_e.shape
        sources = {"photon_noise": exposure.light_e, "dark": exposure.dark_e}
        if switches.persistence and len(past):
            sources["persistence"] = self._late_charge(past, exposure)
        counts = {name: self._counts(mean, stream(seed, *path, name)) for name, mean in sources.items()}
        hits, n_particles = self._hits(cosmic_rays, exposure, stream(seed, *path, "cosmic_rays"))
        arrival = None
        if hits is not None and exposure.n_reads > 2:
            arrival = hit_times(hits > 0, stream(seed, *path, "cosmic_ray_times"))
        noise = stream(seed, *path, "read_noise") if switches.read_noise and detector.read_noise_e > 0 else None
        reset: FloatArray | float = 0.0
        if switches.reset_noise and detector.reset_noise_e > 0:
            reset = detector.reset_noise_e * stream(seed, *path, "reset_noise").standard_normal(shape)
        stack = ReadStack(detector.readout_mode, shape, detector.bias_adu, detector.adc_max_adu)
        full: BoolArray = np.zeros(shape, dtype=np.bool_)
        collected: FloatArray = sum(counts.values(), np.zeros(shape))
        for fraction, charge in self._collect(collected, exposure, stream(seed, *path, "arrivals")):
            if hits is None or fraction == 0.0:
                struck: FloatArray | float = 0.0
            else:
                struck = hits if arrival is None else np.where(arrival <= fraction, hits, 0.0)
            signal, full = self._signal(charge + struck)
            signal += reset
            if noise is not None:
                signal += detector.read_noise_e * noise.standard_normal(shape)
            stack.add(fraction, signal / detector.gain_e_adu + detector.bias_adu, full)
        adu, lost, clipped = stack.result()
        mask = exposure.mask | np.where(lost, np.uint8(MaskBit.SATURATED), np.uint8(0))
        book = {"photons" if name == "photon_noise" else name: float(n.sum()) for name, n in counts.items()}
        if hits is not None:
            mask[hits > 0] |= np.uint8(MaskBit.COSMIC_RAY)
            collected = collected + hits
            book["cosmic_rays"] = float(hits.sum())
        book["lost_full_well"] = float(np.maximum(collected - detector.full_well_e, 0.0).sum())
        book["stored"] = float(np.minimum(collected, detector.full_well_e).sum())
        return Frame(
            adu=np.rint(adu).astype(np.uint16),
            mask=mask,
            charge=book,
            n_clipped=int(np.count_nonzero(clipped)),
            n_saturated_pixels=int(np.count_nonzero(full)),
            n_cosmic_rays=n_particles,
            n_negative_rates=exposure.n_negative_rates,
        )

    def to_electrons(self, adu: npt.ArrayLike) -> FloatArray:
        """Electrons collected, as far as ADU tell: ``(adu - bias) gain_e_adu``, dark current included."""
        return (np.asarray(adu, dtype=np.float64) - self.detector.bias_adu) * self.detector.gain_e_adu

    def _flaws(self, shape: tuple[int, ...], first_pixel: tuple[int, int] | None) -> CalibrationSet | None:
        detector, switches = self.detector, self.detector.switches
        if not (switches.flat or switches.dark_structure or switches.bad_pixels):
            return None
        whole = load_infrared_set(detector)
        if shape == detector.shape and first_pixel is None:
            return whole
        if first_pixel is None:
            first_pixel = detector.star_row - shape[0] // 2, detector.star_column - shape[1] // 2
        row, column = first_pixel
        inside = 0 <= row <= detector.n_rows - shape[0] and 0 <= column <= detector.n_columns - shape[1]
        if not inside:
            raise InputError(
                "rate_map_e_s",
                f"window of {shape[0]} x {shape[1]} from row {row}, column {column}",
                allowed=f"a window of the frame of {detector.n_rows} x {detector.n_columns}",
                hint="or switch off flat, dark_structure and bad_pixels",
            )
        return whole.window(slice(row, row + shape[0]), slice(column, column + shape[1]))

    def _hits(
        self, given: Hits | None, exposure: InfraredExposure, rng: np.random.Generator
    ) -> tuple[FloatArray | None, int]:
        """Electrons of cosmic rays as a map (None for none), and the number of particles."""
        shape = exposure.light_e.shape
        if not self.detector.switches.cosmic_rays:
            return None, 0
        if given is not None:
            hits = checked_hits(given, shape)
            return hits, tracks_of(hits > 0)[1]
        if self._particles is None or self._particle_rate == 0.0 or exposure.exposure_s == 0.0:
            return None, 0
        rays = draw_cosmic_rays(
            self._particles, (shape[0], shape[1]), self.detector.pixel_um, exposure.exposure_s, self._particle_rate, rng
        )
        return rays.image().astype(np.float64), rays.n_events

    def _late_charge(self, past: Sequence[PastExposure], exposure: InfraredExposure) -> FloatArray:
        rate = checked_array("persistence", self._persistence(past, exposure.exposure_s), low=0.0, unit="e-/s")
        if rate.shape != exposure.light_e.shape:
            raise InputError("persistence", f"shape {rate.shape}", allowed=f"shape {exposure.light_e.shape}")
        return np.minimum(rate * exposure.exposure_s, MAX_MEAN_E)

    def _counts(self, mean: FloatArray, rng: np.random.Generator) -> FloatArray:
        if not self.detector.switches.photon_noise:
            return mean
        counts = np.empty(mean.shape)
        load_kernels(KERNELS).draw_poisson(
            mean.reshape(-1), np.exp(-mean).reshape(-1), pixel_keys(rng), counts.reshape(-1)
        )
        return counts

    def _collect(
        self, total: FloatArray, exposure: InfraredExposure, rng: np.random.Generator
    ) -> Iterator[tuple[float, FloatArray]]:
        """Charge at each read: electrons arrive at independent, uniform times."""
        fractions = read_times(self.detector.readout_mode, exposure.n_reads)
        if not self.detector.switches.photon_noise:
            yield from ((float(fraction), fraction * total) for fraction in fractions)
            return
        left, here, before = total.astype(np.int64), np.zeros(total.shape, dtype=np.int64), 0.0
        for fraction in fractions:
            if fraction == 1.0:
                here = here + left
            elif fraction > before:
                step = rng.binomial(left, (fraction - before) / (1.0 - before))
                here, left = here + step, left - step
            before = float(fraction)
            yield before, here.astype(np.float64)

    def _signal(self, charge: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Signal of a charge, and where the pixel is full."""
        detector, switches = self.detector, self.detector.switches
        loss = detector.nonlinearity_at_full_well if switches.nonlinearity else 0.0
        signal = well_signal(charge, detector.full_well_e, loss)
        if switches.interpixel_capacitance:
            coupled = np.asarray(self._coupling(signal), dtype=np.float64)
            if coupled.shape != signal.shape or not np.isfinite(coupled).all():
                wrong = coupled.shape if coupled.shape != signal.shape else element_name("", ~np.isfinite(coupled))[0]
                raise InputError("coupling", str(wrong), allowed=f"finite signals of shape {signal.shape}")
            signal = np.array(coupled)
        return signal, charge >= detector.full_well_e
