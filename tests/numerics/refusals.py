"""Arguments that public functions refuse, and the one line that they refuse them with.

A line of the table has the call, the key with its value, and the begin of what is allowed.
"""

import math

import numpy as np

import simulator
from catalogs import eccentric_anomaly, orbit_places, position_angle, separation_arcsec, tangent_offset
from catalogs.coordinates import propagate
from catalogs.stellar_physics import bolometric_correction, gravity, mass_from_luminosity, radius_from_luminosity
from cpic_core import InputError
from cpic_planner.etc.detection import detection_threshold
from cpic_planner.planets.population import read_law
from cpic_planner.validation import aperture_weights, combine, filled
from simulator import camera
from simulator.camera.noise import mean_projection_um
from simulator.detectors import clean_fraction
from simulator.effects import cosmic_ray_rate
from simulator.knobs import dial_of
from simulator.passbands import Passbands
from simulator.signal.light import exozodi_fraction_arcsec2
from simulator.target import contrast_at, detector_to_sky, sky_to_detector
from tests.simulator.frames import expected_adu_map

INSTRUMENT = simulator.load_instrument()
DETECTOR, BANDS, RNG = INSTRUMENT.detector, Passbands.from_bands(), np.random.default_rng(0)
OBSERVED = {"band": "F520", "exposure_s": 1.0, "window": "hole"}
CALLED = (
    *(eccentric_anomaly, orbit_places, position_angle, separation_arcsec, tangent_offset, propagate, dial_of, filled),
    *(bolometric_correction, gravity, mass_from_luminosity, radius_from_luminosity, detection_threshold, read_law),
    *(aperture_weights, combine, mean_projection_um, clean_fraction, exozodi_fraction_arcsec2, contrast_at),
    *(detector_to_sky, sky_to_detector, simulator.lambert_phase, simulator.planet_contrast, simulator.planet_albedo),
    *(simulator.stream, camera.stage_probability, camera.excess_noise_factor2, camera.aperture_noise_pixels),
    *(camera.pixel_saturated, camera.em_voltage_of),
)
NAMES = {function.__name__: function for function in CALLED} | {
    "np": np,
    "nan": math.nan,
    "inf": math.inf,
    "DETECTOR": DETECTOR,
    "FRAMES": np.ones((2, 4, 4)),
    "GOOD": np.ones((2, 4, 4), dtype=bool),
    "adu": lambda rate, exposure_s, gain: expected_adu_map(np.full((3, 3), rate), exposure_s, gain, DETECTOR),
    "multiply": lambda electrons, gain: camera.multiply(electrons, gain, rng=RNG),
    "star": lambda v_mag, area_cm2: BANDS.star_rate_e_s(v_mag, 5772.0, 4.44, 0.0, area_cm2),
    "photlam": lambda v_mag, teff_k: simulator.star_photlam(v_mag, teff_k=teff_k),
    "rays": lambda when: cosmic_ray_rate(INSTRUMENT.cosmic_rays, when),
    "observe": lambda **changed: simulator.observe("paper_example", **(OBSERVED | changed)),
}
REFUSED = """
stage_probability(nan, 604) -> gain = nan | 1 to 10000
stage_probability(0.9999999999999999, 604) -> gain = 0.9999999999999999 | 1 to 10000
stage_probability(10001.0, 604) -> gain = 10001.0 | 1 to 10000
stage_probability(3.0, 1) -> gain = 3.0 | 1 to 2
stage_probability('2', 604) -> gain = 2 | numbers, 1 to 10000
stage_probability(2.0, 0) -> stages = 0 | an integer of at least 1
stage_probability(2.0, 1.5) -> stages = 1.5 | an integer of at least 1
excess_noise_factor2(nan, 604) -> gain = nan | 1 to 10000
excess_noise_factor2(0.9999999999999999, 604) -> gain = 0.9999999999999999 | 1 to 10000
excess_noise_factor2(10001.0, 604) -> gain = 10001.0 | 1 to 10000
excess_noise_factor2(3.0, 1) -> gain = 3.0 | 1 to 2
excess_noise_factor2('2', 604) -> gain = 2 | numbers, 1 to 10000
excess_noise_factor2(2.0, 0) -> stages = 0 | an integer of at least 1
excess_noise_factor2(2.0, 1.5) -> stages = 1.5 | an integer of at least 1
aperture_noise_pixels(0.5) -> radius_pixel = 0.5 px | 1 to 1e+100
aperture_noise_pixels(nan) -> radius_pixel = nan px | 1 to 1e+100
aperture_noise_pixels(inf) -> radius_pixel = inf px | 1 to 1e+100
aperture_noise_pixels(1e+200) -> radius_pixel = 1e+200 px | 1 to 1e+100
pixel_saturated(-1.0, 1.0, DETECTOR, 5.0) -> peak_e_per_frame = -1.0 e- | finite and at least 0
pixel_saturated(nan, 1.0, DETECTOR, 5.0) -> peak_e_per_frame = nan e- | finite and at least 0
pixel_saturated(1.0, 1.0, DETECTOR, 101.0) -> n_sigma = 101.0 | 0 to 100
pixel_saturated(1.0, 0.5, DETECTOR) -> em_gain = 0.5 | 1 to 10000
em_voltage_of(0.5, 200.0) -> em_gain = 0.5 | 1 to 10000
em_voltage_of(nan, 200.0) -> em_gain = nan | 1 to 10000
adu(nan, 1.0, 1.0) -> rate_map_e_s[y=0, x=0] = nan e-/s | finite and at least 0
adu(-1.0, 1.0, 1.0) -> rate_map_e_s[y=0, x=0] = -1.0 e-/s | finite and at least 0
adu(inf, 1.0, 1.0) -> rate_map_e_s[y=0, x=0] = inf e-/s | finite and at least 0
adu(1.0, 10000000.0, 1.0) -> exposure_s = 10000000.0 s | 0 to 1e+06
adu(1.0, 1.0, 100000.0) -> em_gain = 100000.0 | 1 to 1000
multiply(np.array([-1]), 2.0) -> electrons[0] = -1 e- | whole electrons (integers), 0 to 1e+12
multiply(np.array([1000000000001]), 2.0) -> electrons[0] = 1000000000001 e- |
multiply(np.array([1.5]), 2.0) -> electrons[0] = 1.5 e- |
multiply(np.array([5]), nan) -> gain = nan | 1 to 10000
lambert_phase(nan) -> phase_deg = nan deg | 0 to 180
lambert_phase(inf) -> phase_deg = inf deg | 0 to 180
lambert_phase(-1e-09) -> phase_deg = -1e-09 deg | 0 to 180
lambert_phase(180.00000000000003) -> phase_deg = 180.00000000000003 deg | 0 to 180
lambert_phase('90') -> phase_deg = 90 deg | real numbers
lambert_phase(True) -> phase_deg = True deg | real numbers
lambert_phase(1j) -> phase_deg = 1j deg | real numbers
planet_contrast(nan, 1.0, 0.0, 90.0, 0.5) -> radius_rjup = nan R_Jup | finite numbers
planet_contrast(-1.0, 1.0, 0.0, 90.0, 0.5) -> radius_rjup = -1.0 R_Jup | at least 0
planet_contrast(1.0, 1.0, 0.0, 90.0, inf) -> geometric_albedo = inf | finite numbers
planet_contrast(1.0, 0.0, 0.0, 90.0, 0.5) -> separation = 0.0 AU | above 0 (give the true distance to contrast_at)
planet_contrast(1.0, 1e-320, 0.0, 90.0, 0.5) -> contrast = inf | a finite ratio
planet_contrast(1e+200, 1.0, 0.0, 90.0, 0.5) -> contrast = inf | a finite ratio
planet_contrast(1.0, '1', 0.0, 90.0, 0.5) -> separation_ra_au = 1 AU | real numbers
contrast_at(1.0, 0.0, 90.0, 0.5) -> distance_au = 0.0 AU | above 0
contrast_at(1.0, nan, 90.0, 0.5) -> distance_au = nan AU | finite numbers
contrast_at(1.0, 1e-320, 90.0, 0.5) -> contrast = inf | a finite ratio
sky_to_detector(-1.0, 0.0) -> separation_arcsec = -1.0 arcsec | at least 0
sky_to_detector(1.0, inf) -> pa_deg = inf deg | finite numbers
sky_to_detector(1.0, 'north') -> pa_deg = north deg | real numbers
detector_to_sky(1.5e+308, 1.5e+308) -> separation_arcsec = inf arcsec | finite numbers
detection_threshold(nan, 5.0) -> n_resolution_elements = nan | finite and at least 0
detection_threshold(-1.0, 5.0) -> n_resolution_elements = -1.0 | finite and at least 0
detection_threshold(19.0, 0.0) -> sigma = 0.0 sigma | above 0 and at most 20
detection_threshold(19.0, 20.5) -> sigma = 20.5 sigma | above 0 and at most 20
detection_threshold('a', 5.0) -> n_resolution_elements = a | numbers, finite and at least 0
combine(FRAMES * nan, GOOD) -> frames[0, y=0, x=0] = nan e- | finite numbers
combine(FRAMES * -inf, GOOD) -> frames[0, y=0, x=0] = -inf e- | finite numbers
combine(FRAMES * 1e308, GOOD) -> frames[0, y=0, x=0] = 1e+308 e- | -1e+100 to 1e+100, so that sums stay finite
filled(FRAMES * nan, GOOD) -> frames[0, y=0, x=0] = nan e- | finite numbers
filled(FRAMES * -inf, GOOD) -> frames[0, y=0, x=0] = -inf e- | finite numbers
filled(FRAMES * 1e308, GOOD) -> frames[0, y=0, x=0] = 1e+308 e- | -1e+100 to 1e+100, so that sums stay finite
aperture_weights((5, 5), 2.0, 2.0, nan) -> radius_pixel = nan px | a finite number
aperture_weights((5, 5), 2.0, 2.0, 0.0) -> radius_pixel = 0.0 px | finite and above 0
aperture_weights((5, 5), 2.0, 2.0, 'a') -> radius_pixel = a px | real numbers
aperture_weights((5, 5), nan, 2.0, 1.0) -> x_pixel = nan px | a circle of radius 1 px inside 5 px
star(nan, 1.0) -> v_mag = nan mag | finite numbers
star(-1000.0, 1.0) -> v_mag = -1000.0 mag | -30 to 60
star(5.0, 0.0) -> area_cm2 = 0.0 cm2 | above 0, at most 1e+12
star(5.0, 1e308) -> area_cm2 = 1e+308 cm2 | above 0, at most 1e+12
photlam(-31.0, 5000.0) -> magnitude_v = -31.0 mag | -30 to 40
photlam(5.0, 3499.9999999999995) -> teff_k = 3499.9999999999995 K | 3500 to 8000
photlam(5.0, 8000.000000000001) -> teff_k = 8000.000000000001 K | 3500 to 8000
planet_albedo(nan) -> wavelength_nm = nan nm | 300 to 1754
planet_albedo(10.0) -> wavelength_nm = 10.0 nm | 300 to 1754
exozodi_fraction_arcsec2(0.0, 1.0) -> separation_arcsec = 0.0 arcsec | above 0
exozodi_fraction_arcsec2(1e-200, 1.0) -> separation_arcsec = 1e-200 arcsec | separations
clean_fraction(-1.0, 1.0) -> loss_per_s = -1.0 1/s | finite and at least 0
mean_projection_um(nan, 1.0) -> depth_um = nan um | 1e-06 to 1e+09
rays(nan) -> when = nan yr | a finite number
rays(1900.0) -> when = 1900.0 yr | a year, 1972 to 2100
rays('soon') -> when = soon | a date, 1972 to 2100
eccentric_anomaly(nan, 0.1) -> mean_anomaly_rad = nan rad | finite numbers
eccentric_anomaly(0.1, 1.0) -> eccentricity = 1.0 | 0 to 0.999
orbit_places(0.0, 0, 0, 0, 0, 0) -> semi_major_axis_au = 0.0 au | above 0
read_law({'law': 'uniform', 'low': 1.0, 'high': 1.0}) -> low = 1.0 | below high = 1
separation_arcsec(nan, 0.0, 0.0, 0.0) -> ra_deg = nan | finite numbers
separation_arcsec('east', 0.0, 0.0, 0.0) -> ra_deg = east | real numbers
tangent_offset(0.0, 0.0, 180.0, 0.0) -> ra_deg, dec_deg = position | less than 90 deg from the tangent point
position_angle(nan, 1.0) -> east = nan | finite numbers
propagate(0, 0, 1e300, 0, 1, 0, 2000, 1e300) -> to_epoch_yr = 1e+300 yr | epochs at which the star is at a finite place
bolometric_correction(0.0) -> teff_k = 0.0 K | above 0
radius_from_luminosity(-1.0, 5772.0) -> luminosity_lsun = -1.0 L_sun | above 0
mass_from_luminosity(0.0) -> luminosity_lsun = 0.0 L_sun | above 0
gravity(0.0, 1.0) -> mass_msun = 0.0 M_sun | above 0
dial_of(None, -1e-12) -> tolerance = -1e-12 | 0 to 0.5
dial_of(None, nan) -> tolerance = nan | a finite number
dial_of('quick', 0.1) -> tolerance = 0.1 | without fidelity
stream(-1, 'a') -> seed = -1 | an integer from 0 to 9223372036854775807
stream(nan, 'a') -> seed = nan | an integer from 0 to 9223372036854775807
observe(exposure_s=0.0) -> exposure_s = 0.0 s |
observe(exposure_s=nan) -> exposure_s = nan s |
observe(exposure_s=10000000.0) -> exposure_s = 10000000.0 s |
observe(n_frames=0) -> n_frames = 0 | an integer from 1 to 1000000
observe(n_frames=1000001) -> n_frames = 1000001 | an integer from 1 to 1000000
observe(em_gain=0.5) -> em_gain = 0.5 |
observe(em_gain=10000.0) -> em_gain = 10000.0 |
"""


def answer(call: str) -> str:
    """The line of a refusal; what was answered instead where the call is not refused."""
    try:
        return f"answered {eval(call, dict(NAMES))!r}"
    except InputError as error:
        return str(error)
