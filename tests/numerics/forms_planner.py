"""Closed forms of the planner: orbits, laws of populations, detection thresholds, noise of a stack, lost frames."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable
from dataclasses import fields

import numpy as np
from mpmath import mp, mpf
from oracle import ClosedForm

from catalogs import eccentric_anomaly, orbit_places
from cpic_planner.etc import ApertureRates, FrameCamera, Programme, stack_noise
from cpic_planner.etc.detection import detection_threshold
from cpic_planner.etc.noise import SPECKLE_COHERENCE, snr_paper
from cpic_planner.planets.population import read_law
from simulator.camera.noise import mean_projection_um
from simulator.config import load_instrument
from simulator.detectors import clean_fraction
from simulator.signal import ProgrammeLaw, SpeckleLaw

CAMERA = FrameCamera.of(load_instrument(), "F520")


def rad(x: mpf) -> mpf:
    return x * mp.pi / 180


# --- orbits


@functools.lru_cache(maxsize=4096)
def anomaly(mean: mpf, e: mpf) -> mpf:
    """Kepler's equation by Newton's method from above, where it converges."""
    with mp.extradps(20):
        turns = mp.nint(mean / (2 * mp.pi))
        m = mean - 2 * mp.pi * turns
        root = abs(m) + e if abs(m) + e < mp.pi else mp.pi
        for _ in range(400):
            step = (root - e * mp.sin(root) - abs(m)) / (1 - e * mp.cos(root))
            root -= step
            if abs(step) <= abs(root) * mpf(10) ** (10 - mp.dps):
                break
        return mp.sign(m) * root + 2 * mp.pi * turns


def orbit(a: mpf, e: mpf, i: mpf, w: mpf, node: mpf, m: mpf) -> dict[str, mpf]:
    big = anomaly(rad(m), e)
    r = a * (1 - e * mp.cos(big))
    x, y = a * (mp.cos(big) - e), a * mp.sqrt(1 - e**2) * mp.sin(big)
    u = mp.atan2(y, x) + rad(w)
    east = r * (mp.sin(rad(node)) * mp.cos(u) + mp.cos(rad(node)) * mp.sin(u) * mp.cos(rad(i)))
    north = r * (mp.cos(rad(node)) * mp.cos(u) - mp.sin(rad(node)) * mp.sin(u) * mp.cos(rad(i)))
    away = r * mp.sin(u) * mp.sin(rad(i))
    return {
        "east_au": east,
        "north_au": north,
        "distance_au": r,
        "phase_deg": mp.degrees(mp.atan2(mp.hypot(east, north), away)),
    }


ANOMALIES = [
    (m, e)
    for m in (0.0, 1e-12, 1e-6, 0.1, 1.0, 3.0, -2.0, 3.14159265358979, 100.0)
    for e in (0.0, 1e-9, 0.5, 0.9, 0.999)
]
ORBITS = [
    (a, e, i, w, n, m)
    for a in (1e-3, 5.2, 1e3)
    for e, i, w, n, m in (
        (0.0, 0.0, 0.0, 0.0, 10.0),
        (0.0, 90.0 - 1e-9, 30.0, 0.0, 61.0),
        (0.9, 60.0, 100.0, 200.0, 1e-6),
        (0.999, 120.0, -30.0, 45.0, 179.9),
        (0.3, 90.0 - 1e-7, 89.99999, 10.0, 1e-9),
        (0.05, 45.0, 359.0, 300.0, -170.0),
    )
]


def place(name: str) -> tuple[Callable[..., float], Callable[..., mpf]]:
    return lambda *given: getattr(orbit_places(*given), name), lambda *given: orbit(*given)[name]


# --- laws of populations

SHARES = (0.0, 1e-200, 2**-53, 1e-12, 0.1, 0.5, 0.9, 1.0 - 1e-9, 1.0 - 2**-53)


def power(share: mpf, low: mpf, high: mpf, index: mpf) -> mpf:
    if index == -1:
        return low * (high / low) ** share
    g = index + 1
    with mp.extradps(400):
        return (low**g + share * (high**g - low**g)) ** (1 / g)


def law(tree: dict[str, float | str], exact: Callable[[mpf], mpf]) -> ClosedForm:
    name = str(tree["law"])
    drawn = read_law(tree)
    shown = "".join(f"{key} {value!r}, " for key, value in tree.items() if key != "law")
    return ClosedForm(
        f"cpic_planner.planets.population, {name}",
        f"{shown}shares 0 to 1 - 1e-16",
        [(s,) for s in SHARES],
        lambda share: drawn.quantile(np.array([share]))[0],
        exact,
    )


def power_law(low: float, high: float, index: float) -> ClosedForm:
    return law(
        {"law": "power_law", "low": low, "high": high, "index": index},
        lambda share: power(share, mpf(low), mpf(high), mpf(index)),
    )


def rayleigh(scale: float, high: float) -> ClosedForm:
    def exact(share: mpf) -> mpf:
        with mp.extradps(400):
            return mpf(scale) * mp.sqrt(-2 * mp.log(1 - share * (1 - mp.exp(-((mpf(high) / scale) ** 2) / 2))))

    return law({"law": "rayleigh", "scale": scale, "high": high}, exact)


# --- thresholds


def upper_tail(t: mpf, dof: mpf) -> mpf:
    if dof < 1e4:
        return mp.betainc(dof / 2, mpf(1) / 2, 0, dof / (dof + t**2), regularized=True) / 2
    grown = mp.loggamma((dof + 1) / 2) - mp.loggamma(dof / 2) - mp.log(dof * mp.pi) / 2

    def density(x: mpf) -> mpf:
        return mp.exp(grown - (dof + 1) / 2 * mp.log1p(x**2 / dof))

    return mp.quad(density, [t + mpf(k) / t * 8 for k in range(8)] + [mp.inf])


def student(n: mpf, sigma: mpf) -> mpf:
    """Small-sample threshold of Mawet et al. 2014: the t quantile by Newton's method in the logarithm."""
    dof, aim = n - 2, mp.erfc(sigma / mp.sqrt(2)) / 2
    t = mpf(float(detection_threshold(float(n), float(sigma)).unwrap()) / float(np.sqrt(1 + 1 / (float(n) - 1))))
    slope = mp.loggamma((dof + 1) / 2) - mp.loggamma(dof / 2) - mp.log(dof * mp.pi) / 2
    for _ in range(4):
        tail = upper_tail(t, dof)
        density = mp.exp(slope - (dof + 1) / 2 * mp.log1p(t**2 / dof))
        # Newton in ln t against ln tail: exact for a power law.
        t *= mp.exp(mp.log(tail / aim) * tail / (density * t))
    return t * mp.sqrt(1 + 1 / (n - 1))


THRESHOLDS = [(n, s) for n in (3.0, 3.5, 19.0, 300.0) for s in (1e-3, 5.0, 20.0)] + [
    (9000.0, 5.0),
    (1e6, 5.0),
    (1e15, 5.0),
]


# --- noise of a stack

LIGHT = ("planet_e_s", "halo_e_s", "companion_e_s", "sky_e_s", "exozodi_e_s", "dark_e_s")
PLAIN = dict.fromkeys((item.name for item in fields(ApertureRates)), 0.0) | {
    "aperture_pixels": 18.3,
    "noise_fraction": 0.86,
    "source_noise_fraction": 0.95,
    "background_apertures": 37.0,
    "variance_factor": 1.0,
}
MODES = Programme(speckle=np.array(0.8), white=np.array(0.95), throughput=np.array(0.9))
SKY, DARK, SMEAR, LOSS, SCALE, K1 = 1e-3, 1e-4, 0.3, 1e-4, 1.0, 1e-9
STACKS = [
    (planet, halo, exposure, frames, gain)
    for planet, halo in ((1e-12, 1e-6), (0.01, 0.1), (1e9, 1e6), (1e-9, 1e9))
    for exposure in (1e-6, 30.0, 1e6)
    for frames in (1.0, 100.0, 1e6)
    for gain in (1.0, 1.0 + 1e-12, 300.0, 1e4)
]


def rates(planet: float, halo: float) -> ApertureRates:
    given = PLAIN | {
        "planet_e_s": planet,
        "halo_e_s": halo,
        "sky_e_s": SKY,
        "dark_e_s": DARK,
        "loss_per_s": LOSS,
        "reference_light_e_s": halo + SKY + DARK,
        "reference_halo": 1.0,
        "reference_scale": SCALE,
        "smear_e": SMEAR,
        "reference_smear_e": SMEAR,
        "variance_factor": 1.0,
    }
    arrays = {name: np.float64(value) for name, value in given.items() if name != "speckle"}
    half = SpeckleLaw(np.float64(K1 * halo**2 / 2.0), np.float64(K1 * halo**2 * 1e-4 / 2.0), np.float64(0.0))
    return ApertureRates(speckle=ProgrammeLaw(half, half, half.scaled(0.0)), **arrays)


def white(planet: mpf, halo: mpf, exposure: mpf, frames: mpf, gain: mpf) -> dict[str, mpf]:
    """Variances of a stack written out term by term; F^2 in the form of Robbins & Hadwen 2003."""
    n = mpf(CAMERA.register_stages)
    factor = 2 * (gain - 1) * gain ** (-(n + 1) / n) + 1 / gain
    cut, own_cut, pixels = (
        mpf(PLAIN["noise_fraction"]),
        mpf(PLAIN["source_noise_fraction"]),
        mpf(PLAIN["aperture_pixels"]),
    )
    voided = mp.exp(mpf(LOSS) * exposure)
    light = (halo + mpf(SKY) + mpf(DARK)) * exposure + mpf(SMEAR)
    read = (mpf(CAMERA.read_noise_e) ** 2 + mpf(CAMERA.rounding_e) ** 2) / gain**2
    one = cut * (factor * light + pixels * (factor * mpf(CAMERA.cic_e) + read))
    left = mpf(float(MODES.throughput))
    quiet = 2 * frames * voided * one * mpf(float(MODES.white)) / left**2
    visit = frames * (exposure + mpf(CAMERA.readout_s))
    # The doubles of the law, as they are passed.
    speckle = (
        mpf(float(MODES.speckle)) / left**2 * (frames * exposure) ** 2 * mpf(K1) * halo**2 * (1 + visit * mpf("1e-4"))
    )
    own = frames * voided * factor * own_cut * planet * exposure / left
    return {"signal": frames * exposure * planet, "quiet": quiet + speckle, "own": own}


def snr(*given: mpf) -> mpf:
    part = white(*given)
    return part["signal"] / mp.sqrt(part["quiet"] * (1 + 1 / mpf(PLAIN["background_apertures"])) + part["own"])


def significance(*given: mpf) -> mpf:
    part = white(*given)
    return part["signal"] / mp.sqrt(part["quiet"])


def stacked(name: str) -> Callable[..., float]:
    return lambda planet, halo, *frames: getattr(
        stack_noise(rates(planet, halo), *frames, CAMERA, programme=MODES), name
    )


def eq4(planet: mpf, halo: mpf, exposure: mpf, frames: mpf, gain: mpf) -> mpf:
    n, area = mpf(CAMERA.register_stages), mpf(PLAIN["aperture_pixels"])
    factor = 2 * (gain - 1) * gain ** (-(n + 1) / n) + 1 / gain
    kept = frames * mp.exp(-mpf(LOSS) * exposure)
    own = mpf(float(MODES.throughput)) * planet * exposure * kept
    light = 2 * ((halo + mpf(SKY) + mpf(DARK)) * exposure + mpf(SMEAR)) / area
    read = (mpf(CAMERA.read_noise_e) ** 2 + mpf(CAMERA.rounding_e) ** 2) / gain**2
    white_pixel = mpf(float(MODES.white)) * kept * (factor * light + 2 * (factor * mpf(CAMERA.cic_e) + read))
    visit = frames * (exposure + mpf(CAMERA.readout_s))
    together = mpf(float(MODES.speckle)) * mpf(K1) * halo**2 * (1 + visit * mpf("1e-4")) / area**2
    pixel = white_pixel + (kept * exposure) ** 2 * together / mpf(SPECKLE_COHERENCE)
    return own / mp.sqrt(own + pixel * area * (1 + 1 / mpf(PLAIN["background_apertures"])))


def chord(depth: mpf, longest: mpf) -> mpf:
    with mp.extradps(60):
        m = depth / longest
        return depth * (mp.acos(m) - m * mp.sqrt(1 - m**2)) / (1 - m**2)


FORMS = [
    ClosedForm(
        "catalogs.orbits.eccentric_anomaly",
        "-2 to 100 rad, eccentricity 0 to 0.999",
        ANOMALIES,
        eccentric_anomaly,
        anomaly,
    ),
    *(
        ClosedForm(
            f"catalogs.orbits.orbit_places, {name}",
            "1e-3 to 1e3 au, eccentricity 0 to 0.999, nearly edge-on too",
            ORBITS,
            *place(name),
        )
        for name in ("east_au", "north_au", "distance_au", "phase_deg")
    ),
    law({"law": "uniform", "low": -1.0, "high": 3.0}, lambda s: -1 + 4 * s),
    law({"law": "log_uniform", "low": 1e-6, "high": 1e6}, lambda s: power(s, mpf(1e-6), mpf(1e6), mpf(-1))),
    *(
        power_law(low, high, index)
        for low, high in ((1e-3, 1e3), (1.0, 1.0 + 1e-9))
        for index in (-20.0, -2.0, -1.0 + 1e-9, 0.0, 20.0)
    ),
    rayleigh(0.05, 0.9),
    rayleigh(1e6, 1.0),
    law({"law": "isotropic"}, lambda s: mp.degrees(2 * mp.asin(mp.sqrt(s)))),
    ClosedForm(
        "cpic_planner.validation.detection_threshold",
        "3 to 1e15 elements, 1e-3 to 20 sigma",
        THRESHOLDS,
        lambda n, s: detection_threshold(n, s).unwrap(),
        student,
    ),
    ClosedForm(
        "simulator.detectors.variance.clean_fraction",
        "0 to 1 track/s, 1e-6 to 1e6 s",
        list(itertools.product((0.0, 1e-9, 1e-4, 1e-2), (0.0, 1e-6, 1.0, 1e6)))[:15],
        clean_fraction,
        lambda loss, t: mp.exp(-loss * t),
    ),
    ClosedForm(
        "simulator.camera.noise.mean_projection_um",
        "layers 1 to 1e4 um, chords to 1e-6 of the depth and 1e9 um",
        [(d, d * f) for d in (1.0, 38.0, 1e4) for f in (1.0 + 2e-6, 1.001, 2.0, 1e3, 1e5)],
        mean_projection_um,
        chord,
    ),
    ClosedForm(
        "cpic_planner.etc.noise.stack_noise, snr",
        "1e-12 to 1e9 e-/s, 1e-6 to 1e6 s, 1 to 1e6 frames, gain 1 to 1e4",
        STACKS,
        stacked("snr"),
        snr,
    ),
    ClosedForm(
        "cpic_planner.etc.noise.stack_noise, significance", "as the SNR", STACKS, stacked("significance"), significance
    ),
    ClosedForm(
        "cpic_planner.etc.noise.snr_paper",
        "as the SNR",
        STACKS,
        lambda planet, halo, *frames: snr_paper(rates(planet, halo), *frames, CAMERA, programme=MODES),
        eq4,
    ),
]
