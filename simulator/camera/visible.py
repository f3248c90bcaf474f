"""The visible camera: the effects of an EMCCD in their order, on a whole frame or on a window of it.

Light goes through the response of the pixels, smear and dark current are added (`prepare`, noise-free, once for a
sequence). Each frame then runs through photon noise, cosmic rays, non-linearity, full well and blooming, parallel
transfer, clock-induced charge, serial transfer, the multiplication register and its full well, the output amplifier,
read noise, bias and converter. Every step is an `Effect` with its own switch and its own random stream.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from catalogs.errors import InputError
from simulator.camera.calibration_set import CalibrationSet, load_calibration_set
from simulator.camera.checks import MOST_E_S, checked_array, checked_rates, checked_scalar
from simulator.camera.collection import Blooming, CosmicRayHits, PhotonNoise, PixelNonlinearity
from simulator.camera.dark_current import dark_rate_e_s
from simulator.camera.frame import Frame, MaskBit
from simulator.camera.multiplication import OutputNonlinearity, Register, RegisterClockCharge, RegisterFullWell
from simulator.camera.readout import BiasDrift, Interference, ReadNoise, Stripes
from simulator.camera.sections import sections_of
from simulator.camera.stage import LIMIT_KERNELS, Effect, Exposure, FloatArray, Place, Work
from simulator.camera.transfer import ClockCharge, ParallelTransfer, SerialTransfer
from simulator.config.detector import Detector
from simulator.config.effects import CosmicRayConfig
from simulator.lazy import load_kernels
from simulator.rng import PathPart, stream

__all__ = ["CHARGE", "VOLTAGE", "VisibleCamera"]

# Keeps sums over a column inside the whole numbers of float64; any full well is far below.
MAX_MEAN_E = 1e12
MAX_EXPOSURE_S = 1e6

CHARGE: tuple[Effect, ...] = (
    PhotonNoise(),
    PixelNonlinearity(),
    Blooming(),
    ParallelTransfer(),
    ClockCharge(),
    SerialTransfer(),
    Register(),
    RegisterClockCharge(),
    RegisterFullWell(),
    OutputNonlinearity(),
)
VOLTAGE: tuple[Effect, ...] = (ReadNoise(), Stripes(), Interference(), BiasDrift())


class VisibleCamera:
    """The EMCCD camera.

    Parameters
    ----------
    detector : Detector
        Everything about the camera, switches included.
    cosmic_rays : CosmicRayConfig, optional
        Particles; none without it.
    cosmic_ray_rate_per_s_cm2 : float
        Their rate at the date of the observation.
    charge, voltage : sequence of Effect, optional
        Effects in their order before and after the conversion from electrons to ADU.

    Notes
    -----
    Effects whose switch is off are not run, and leave the random numbers of the others as they are.
    """

    def __init__(
        self,
        detector: Detector,
        *,
        cosmic_rays: CosmicRayConfig | None = None,
        cosmic_ray_rate_per_s_cm2: float = 0.0,
        charge: Sequence[Effect] = CHARGE,
        voltage: Sequence[Effect] = VOLTAGE,
    ) -> None:
        self.detector = detector
        chain = list(charge)
        if cosmic_rays is not None and cosmic_ray_rate_per_s_cm2 > 0:
            chain.insert(1, CosmicRayHits(cosmic_rays, cosmic_ray_rate_per_s_cm2))
        self.charge = tuple(effect for effect in chain if self._runs(effect))
        self.voltage = tuple(effect for effect in voltage if self._runs(effect))

    def _runs(self, effect: Effect) -> bool:
        # The register multiplies whether or not it does so at random.
        return isinstance(effect, Register) or bool(getattr(self.detector.switches, effect.switch, True))

    def prepare(
        self,
        rate_map_e_s: npt.ArrayLike,
        exposure_s: float,
        em_gain: float,
        *,
        first_pixel: tuple[int, int] | None = None,
        beyond_e_s: npt.ArrayLike | None = None,
    ) -> Exposure:
        """Noise-free part of a frame.

        Parameters
        ----------
        rate_map_e_s : array_like
            Photo-electrons per second and pixel, 2-D (y, x): the whole frame, or a window of any shape.
        exposure_s : float
            Exposure of the frame, 0 to 1e6 s (0 is a bias frame).
        em_gain : float
            Actual gain of the register, 1 to ``detector.em_gain_max``.
        first_pixel : tuple of int, optional
            Row and column of the frame at which a window begins; around the star if not given.
        beyond_e_s : array_like, optional
            Light of the frame beyond a window, summed over each of its columns, at least 0: it smears into the window.
            Without it a window is all of the frame that sees light.

        Raises
        ------
        InputError
            For a rate that is NaN, infinite or more negative than 1e-9 of the largest (naming the pixel), another
            argument out of range, or a window outside the active pixels where the flaws of pixels are switched on.
        """
        detector = self.detector
        rates, n_negative = checked_rates(rate_map_e_s)
        checked_scalar("exposure_s", exposure_s, low=0.0, high=MAX_EXPOSURE_S, unit="s")
        checked_scalar("em_gain", em_gain, low=1.0, high=detector.em_gain_max)
        place = _place(detector, rates.shape, first_pixel)
        flaws = self._flaws(rates.shape, place)
        light = self._light(rates, flaws, place)
        mean = light * exposure_s
        switches, smear = detector.switches, None
        if switches.smear and exposure_s > 0:
            # Lines pass under the light of their column on the way in and on the way out.
            passed = light[place.rows] * detector.transfer.line_shift_s
            others = passed.sum(axis=0)
            if beyond_e_s is not None:
                others += _beyond(beyond_e_s, place, rates.shape) * detector.transfer.line_shift_s
            smear = np.zeros_like(mean)
            smear[place.rows] = others - passed
            mean += smear
        if switches.dark:
            # Without flaws of the dark current `dark_of` is the same number everywhere.
            dark = dark_rate_e_s(detector) if flaws is None else flaws.dark_of(switches)
            pixels = mean[place.rows, place.columns]
            pixels += (dark[place.rows, place.columns] if isinstance(dark, np.ndarray) else dark) * exposure_s
        np.minimum(mean, MAX_MEAN_E, out=mean)
        return Exposure(
            detector=detector,
            place=place,
            exposure_s=float(exposure_s),
            em_gain=float(em_gain),
            mean_e=mean,
            zero=np.exp(-mean),
            cic_e=flaws.cic_e if flaws is not None and flaws.cic_varies else None,
            stripe_adu=flaws.stripe_adu if flaws is not None else None,
            bias_adu=flaws.bias_adu if flaws is not None else None,
            flaws=flaws.mask_of(switches) if flaws is not None else None,
            smear_e=smear,
            n_negative_rates=n_negative,
        )

    def _flaws(self, shape: tuple[int, ...], place: Place) -> CalibrationSet | None:
        switches, files = self.detector.switches, self.detector.calibration_files
        named = any((files.flat, files.dark, files.cic, files.bad_columns, files.bias))
        wanted = (switches.flat, switches.dark_structure, switches.bad_pixels, switches.bad_columns, switches.stripes)
        if not named and not any(wanted):
            return None
        whole = load_calibration_set(self.detector)
        if place.whole:
            return whole
        rows, columns = place.first_row, place.first_column
        active = sections_of(self.detector)["active"]
        inside = active[0].start <= rows and rows + shape[0] <= active[0].stop
        if not (inside and active[1].start <= columns and columns + shape[1] <= active[1].stop):
            raise InputError(
                "rate_map_e_s",
                f"window of {shape[0]} x {shape[1]} from row {rows}, column {columns}",
                allowed="a window of the active pixels, or the whole frame",
                hint="or switch off flat, dark_structure, bad_pixels, bad_columns, stripes",
            )
        return whole.window(slice(rows, rows + shape[0]), slice(columns, columns + shape[1]))

    def _light(self, rates: FloatArray, flaws: CalibrationSet | None, place: Place) -> FloatArray:
        """Rates as the pixels respond to them; borders see no light."""
        if flaws is not None:
            return rates * flaws.response_of(self.detector.switches)
        if not place.whole:
            return rates.copy()
        light = np.zeros_like(rates)
        active = sections_of(self.detector)["active"]
        light[active] = rates[active]
        return light

    def expected_adu(self, exposure: Exposure) -> FloatArray:
        """Mean ADU of every pixel, without noise and without rounding.

        Each step acts on the mean image. Where a limit cuts off only the upper tail of the counts (within a few sigma
        of a full well) the mean of noisy frames is lower. Cosmic rays are not in it; interference and drift of the
        bias average out.
        """
        image = exposure.mean_e.copy()
        for effect in self.charge:
            effect.expect(image, exposure)
        image /= self.detector.gain_e_adu
        image += self.detector.bias_adu if exposure.bias_adu is None else exposure.bias_adu
        for effect in self.voltage:
            effect.expect(image, exposure)
        return np.clip(image, 0.0, float(self.detector.adc_max_adu), out=image)

    def expose(self, exposure: Exposure, *, seed: int, path: Sequence[PathPart]) -> Frame:
        """One noisy frame.

        Parameters
        ----------
        exposure : Exposure
            What `prepare` made.
        seed : int
            Seed of the run.
        path : sequence of str or int
            Names of target, role, band, realisation, frame. Each effect draws from ``stream(seed, *path, switch)``.
        """
        if isinstance(path, str):
            raise InputError("path", path, allowed="a sequence of names, not one string")
        kernels = load_kernels(LIMIT_KERNELS)
        detector, shape = self.detector, exposure.mean_e.shape
        work = Work(np.empty(shape), np.zeros(shape, dtype=np.bool_))
        if not detector.switches.photon_noise:
            work.image[...] = exposure.mean_e
            work.charge["collected"] = float(work.image.sum())
        for effect in self.charge:
            effect.draw(work, exposure, stream(seed, *path, effect.switch))
        work.image *= 1.0 / detector.gain_e_adu
        work.image += detector.bias_adu if exposure.bias_adu is None else exposure.bias_adu
        for effect in self.voltage:
            effect.draw(work, exposure, stream(seed, *path, effect.switch))
        adu = np.empty(shape, dtype=np.uint16)
        clipped = kernels.digitise(
            work.image.reshape(-1), float(detector.adc_max_adu), adu.reshape(-1), work.saturated.reshape(-1)
        )
        return Frame(
            adu=adu,
            mask=_mask(work, exposure),
            charge=dict(work.charge),
            n_clipped=int(clipped),
            n_saturated_pixels=work.counts.get("n_saturated_pixels", 0),
            n_register_saturated=work.counts.get("n_register_saturated", 0),
            n_cosmic_rays=work.counts.get("n_cosmic_rays", 0),
            n_negative_rates=exposure.n_negative_rates,
        )


def _mask(work: Work, exposure: Exposure) -> npt.NDArray[np.uint8]:
    mask = work.saturated.astype(np.uint8)
    mask *= np.uint8(MaskBit.SATURATED)
    if work.cosmic is not None:
        mask |= work.cosmic.view(np.uint8) * np.uint8(MaskBit.COSMIC_RAY)
    if exposure.flaws is not None:
        mask |= exposure.flaws
    return mask


def _beyond(beyond_e_s: npt.ArrayLike, place: Place, shape: tuple[int, ...]) -> FloatArray:
    if place.whole or np.shape(beyond_e_s) != shape[1:]:
        raise InputError("beyond_e_s", np.shape(beyond_e_s), unit="px", allowed=f"{shape[1]} columns of a window")
    return checked_array("beyond_e_s", beyond_e_s, low=0.0, high=MOST_E_S, unit="e-/s")


def _place(detector: Detector, shape: tuple[int, ...], first_pixel: tuple[int, int] | None) -> Place:
    if first_pixel is None and shape == (detector.n_rows, detector.n_columns):
        rows, columns = sections_of(detector)["image"]
        return Place(rows, columns, 0, 0, True)
    corner = (detector.star_row - shape[0] // 2, detector.star_column - shape[1] // 2)
    if first_pixel is not None:
        whole = isinstance(first_pixel, tuple | list) and all(isinstance(i, int | np.integer) for i in first_pixel)
        if not whole or len(first_pixel) != 2:
            raise InputError("first_pixel", first_pixel, unit="px", allowed="row and column of the frame, integers")
        corner = int(first_pixel[0]), int(first_pixel[1])
    return Place(slice(0, shape[0]), slice(0, shape[1]), *corner, False)
