"""Sizes of the effects of the visible camera, one closed form each."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from simulator.camera.gain import stage_probability
from simulator.knobs import Quantity
from simulator.ledger.case import CameraCase, stamp_flaws
from simulator.ledger.light import PlanetPlace
from simulator.ledger.spill import Spill
from simulator.signal.saturation import overflow

__all__ = ["camera_sizes"]

FloatArray = NDArray[np.float64]
Sizes = dict[Quantity, float]
_CORE_MARGIN = 1.4  # for what a Gaussian core lacks
_SMEAR_MARGIN = 1.2  # rows behind the cross and beyond the frame, drifting speckles
# Of the aperture sum of a planet, what a shift by one pixel costs, times the squared radius in pixels: measured 0.40 to
# 0.43 in the four visible bands. At the edge of the mask the image ends sharply, and what is left of it may be little.
_SHIFT, _SHIFT_EDGE, _SHIFT_CUT = 0.43, 0.1, 1.3
_COUNTED = ("planet", "halo", "other", "sky", "smear", "dark", "flaws")


def camera_sizes(case: CameraCase) -> dict[str, Sizes]:
    """Size of every effect of the camera on every quantity, by the name of its switch; and of the converter.

    Of a change of the mean ``d`` of a pixel the size is ``|d| / sigma``, or that of the variance that goes with it; of
    a part of the variance half its share; of a change of the aperture sum of a planet its relative size; for the SNR
    the sum of this and half the share of the variance of the aperture sum.
    """
    return _calibrated(case) | _charge(case) | _limits(case) | _readout(case)


def _sizes(pixel: float, flux: float = 0.0, snr: float | None = None) -> Sizes:
    return {"pixel_map": pixel, "planet_flux": flux, "snr": flux if snr is None else snr}


def _calibrated(case: CameraCase) -> dict[str, Sizes]:
    """Flaws of pixels, known from the calibration set."""
    flaws = case.flaws
    if case.reduced:
        return {key: _sizes(0.0) for key in flaws}
    t, found = case.exposure_s, {}
    outside = case.light_e[case.sketch.total_e_s.size :]
    counts = case.n_frames * case.noise.factor2
    for key, flaw in flaws.items():
        change = flaw.response * (case.sketch.total_e_s * t) + flaw.dark_e_s * t
        beyond = flaw.most_response * outside + flaw.most_dark_e_s * t
        parts = [
            (
                float((weight * flaw.response[place]).sum()),
                float((planet.weights**2 * flaw.dark_e_s[planet.place]).sum()),
            )
            for (place, weight), planet in zip(case.cores, case.sketch.planets, strict=True)
        ]
        flux = _CORE_MARGIN * max((part[0] for part in parts), default=0.0)
        added = case.snr_added([counts * part[1] * t for part in parts])
        found[key] = _sizes(case.mean_change(np.concatenate([change.ravel(), beyond])), flux, flux + added)
    return found


def _charge(case: CameraCase) -> dict[str, Sizes]:
    """Charge that is collected, made on the way, or moved."""
    noise, t, frames, detector = case.noise, case.exposure_s, case.n_frames, case.detector
    counted = (case.light_e + noise.dark_e) * noise.photons
    smear = detector.transfer.line_shift_s * case.sketch.column_e_s
    own = detector.transfer.line_shift_s / t * 2.0 * case.radius_pixels
    own *= 0.0 if case.reduced else 1.0 + case.over_planets(lambda planet: planet.hidden)
    hits = case.hits_per_s * t * case.hits.square_e2
    struck = 1.0 - math.exp(-0.5 * case.lost_per_s * t)
    p = float(stage_probability(case.em_gain, detector.register_stages))
    grown = (case.em_gain - 1.0) / p / case.em_gain if p > 0 else float(detector.register_stages)
    made, spread = detector.register_cic_e * grown, 2.0 * detector.register_cic_e * grown
    made_variance = [frames * case.sketch.noise_pixels * spread] * len(case.variances)
    return {
        "photon_noise": _sizes(
            case.variance_change(noise.factor2 * counted),
            snr=case.snr_share(*_COUNTED),
        ),
        "dark": _sizes(case.mean_change(noise.dark_e), snr=case.snr_share("dark", "flaws")),
        "smear": _sizes(case.mean_change(smear), own, own + _SMEAR_MARGIN * case.snr_share("smear")),
        "cosmic_rays": _sizes(
            0.0
            if case.reduced
            else case.variance_change(noise.factor2 * hits, inside=False)
            + case.mean_change(case.hits_per_s * t * case.hits.mean_e),
            snr=struck,
        ),
        "clock_charge": _sizes(case.mean_change(noise.clock_e), snr=case.snr_share("clock")),
        "register_clock_charge": _sizes(
            max(case.mean_change(made), case.variance_change(spread, inside=False)), snr=case.snr_added(made_variance)
        ),
        "em_register": _sizes(
            case.variance_change((noise.factor2 - 1.0) * (counted + noise.clock_e)),
            snr=case.snr_share(*_COUNTED, "clock", factor=(noise.factor2 - 1.0) / noise.factor2),
        ),
    } | _transfers(case, hits)


def _transfers(case: CameraCase, hits_e2: float) -> dict[str, Sizes]:
    """Charge left behind: the fraction ``n c`` of a pixel's charge arrives with the pixel behind it."""
    clocks = case.detector.transfer
    stamp = case.charge_e
    outside = case.light_e[stamp.size :]
    struck = case.variance_change(case.noise.factor2 * hits_e2, inside=False)
    near, counts = case.edge_arcsec, case.n_frames * case.noise.factor2 * case.noise.photons
    hot_e = (case.flaws["bad_pixels"].dark_e_s + case.flaws["bad_columns"].dark_e_s) * case.exposure_s
    beside = [0.0 if case.reduced else counts * float(hot_e[planet.place].sum()) for planet in case.sketch.planets]
    found = {}
    for axis, (key, c, first, size) in enumerate(
        (
            ("parallel_cti", clocks.parallel_cti, case.first_pixel[0] + clocks.store_rows, case.detector.n_rows),
            ("serial_cti", clocks.serial_cti, case.first_pixel[1] + clocks.serial_elements, case.detector.n_columns),
        )
    ):
        share = 1.0 - math.exp(-c * (first + len(stamp) + 1))
        step = np.abs(np.diff(stamp, axis=axis, prepend=0.0))
        edge = 1.0 - math.exp(-c * (size + (clocks.serial_elements if axis else clocks.store_rows)))
        change = np.concatenate([share * step.ravel(), edge * outside])

        def of_planet(planet: PlanetPlace, share: float = share) -> float:
            cut = _SHIFT_EDGE if min(abs(planet.x_arcsec), abs(planet.y_arcsec)) < near else 0.0
            return share * (_SHIFT / case.radius_pixels**2 + cut + _SHIFT_CUT * planet.hidden)

        flux = case.over_planets(of_planet)
        # Charge of steep halos moves too: a tenth of what moves, measured; and that of hot pixels beside an aperture.
        snr = flux + 0.1 * share * case.snr_share("halo", "other", factor=2.0) + share * case.snr_added(beside)
        found[key] = _sizes(case.mean_change(change) + share * struck, flux, snr)
    return found


def _limits(case: CameraCase) -> dict[str, Sizes]:
    """Full wells and the curves on the way to them."""
    detector, gain, t, noise = case.detector, case.em_gain, case.exposure_s, case.noise
    curve = detector.nonlinearity
    loss = curve.pixel_loss_at_full_well
    pixel_b = loss / ((1.0 - loss) * detector.full_well_e)
    output_b = curve.register_loss / ((1.0 - curve.register_loss) * curve.register_loss_at_e)
    b = pixel_b + gain * output_b
    charge = np.minimum(case.light_e + noise.dark_e + noise.clock_e, detector.full_well_e)
    lost = b * charge**2 / (1.0 + b * charge)
    struck = case.variance_change(noise.factor2 * case.hits_per_s * t * case.hits.square_e2, inside=False)
    spread = 2.0 * b * noise.factor2 * charge**2 / case.sigma_e**2

    def slope(planet: PlanetPlace) -> float:
        behind = (planet.halo_e_s + planet.other_most_e_s + planet.sky_e_s) / case.sketch.aperture_pixels
        behind = max(behind, float(case.sketch.star_e_s[planet.place].max(initial=0.0)))
        return b * t * (2.0 * behind + planet.peak_e_s)

    bent = 0.0 if case.reduced else case.over_planets(slope)
    curved = float(np.max(lost / case.sigma_e + spread, initial=0.0)) + 2.0 * struck * b * case.hits.typical_e
    pixel_well, register_well = detector.full_well_e, detector.register_full_well_e / gain
    held = case.most_e + noise.dark_e
    passed = np.minimum(held, pixel_well if detector.switches.blooming else np.inf)
    spill = Spill(case)

    def fills(planet: PlanetPlace, well: float, factor2: float) -> float:
        behind = (planet.halo_e_s + planet.other_most_e_s + planet.sky_e_s) / case.sketch.aperture_pixels
        level = behind + planet.peak_e_s
        return float(overflow(level * t, well, factor2))

    def blooms(planet: PlanetPlace) -> float:
        if not planet.weights.size:  # off the stamp: from the brightest pixel of all
            return float(overflow(case.column_peak_e_s * t, pixel_well, 1.0) > 1e-9)
        return max(float(spill.blooms_into(*planet.place)), fills(planet, pixel_well, 1.0))

    def trails(planet: PlanetPlace) -> float:
        if not planet.weights.size:
            return float(overflow(case.column_peak_e_s * t, register_well, noise.factor2) > 1e-9)
        return max(float(spill.trails_into(*planet.place)), fills(planet, register_well, noise.factor2))

    return {
        "nonlinearity": _sizes(0.0 if case.reduced else curved, bent),
        "blooming": _sizes(float(np.max(overflow(held, pixel_well, 1.0), initial=0.0)), case.over_planets(blooms)),
        "register_full_well": _sizes(
            float(np.max(overflow(passed + noise.clock_e, register_well, noise.factor2), initial=0.0))
            + struck * case.hits.share_above(register_well),
            case.over_planets(trails),
        ),
    }


def _readout(case: CameraCase) -> dict[str, Sizes]:
    """Amplifier, converter, and structure of the bias."""
    noise, structure, left = case.noise, case.detector.bias_structure, 0.0 if case.reduced else 1.0
    per_adu = case.detector.gain_e_adu / case.em_gain
    _, most = stamp_flaws(case.detector, case.first_pixel, len(case.sketch.total_e_s))
    largest = float(most[1 if case.full else 0]) * per_adu
    wave, drift = structure.interference_adu**2 / 2.0 * per_adu**2, (structure.drift_adu * per_adu) ** 2
    return {
        "read_noise": _sizes(case.variance_change(noise.read_e2), snr=case.snr_share("read")),
        "stripes": _sizes(left * case.mean_change(largest)),
        "interference": _sizes(left * case.variance_change(wave, inside=False)),
        "bias_drift": _sizes(left * case.variance_change(drift, inside=False)),
        "quantisation": _sizes(case.variance_change(noise.rounding_e2), snr=case.snr_share("rounding")),
    }
