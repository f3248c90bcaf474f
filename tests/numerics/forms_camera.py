"""Closed forms of the camera: the register, voltages, variances, limits, dark current."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable

import numpy as np
from mpmath import mp, mpf
from oracle import ClosedForm

from simulator.camera import FrameNoise, em_voltage_of
from simulator.config import load_instrument
from simulator.detectors import aperture_noise_pixels, dark_law_e_s, excess_noise_factor2, stage_probability
from simulator.detectors.gain import output_cumulants
from simulator.detectors.visible import chances_of_loss, compressed
from simulator.signal import pixel_saturated
from tests.simulator.frames import expected_adu_map

DETECTOR = load_instrument().detector
IDEAL = DETECTOR.model_copy(
    update={"switches": DETECTOR.switches.model_copy(update=dict.fromkeys(type(DETECTOR.switches).model_fields, False))}
)
GAINS = (1.0, 1.0 + 1e-12, 1.0 + 1e-6, 1.5, 2.0, 20.0, 300.0, 1000.0, 1e4)
STAGES = (1, 16, 604)
REGISTERS = [(gain, stages) for gain, stages in itertools.product(GAINS, STAGES) if gain <= 2.0**stages]
CHARGES = (0.0, 1e-12, 1.0, 1e3, 1e5, 1e12)
SPREADS = (0.0, 1e-6, 1.0, 5.0, 100.0)


def stage(gain: mpf, stages: mpf) -> mpf:
    return gain ** (1 / mpf(stages)) - 1


def factor(gain: mpf, stages: mpf) -> mpf:
    """Robbins & Hadwen 2003 in their own form."""
    return 2 * (gain - 1) * gain ** (-(stages + 1) / stages) + 1 / gain


def pixel(photon: mpf, cic: mpf, gain: mpf) -> mpf:
    output = mpf(DETECTOR.read_noise_e) ** 2 + mpf(DETECTOR.gain_e_adu) ** 2 / 12
    return factor(gain, mpf(DETECTOR.register_stages)) * (photon + cic) + output / gain**2


def voltage(gain: mpf, temperature: mpf) -> mpf:
    """Root of the cubic by Newton's method."""
    v = mpf(0)
    for _ in range(200):
        value = mpf(0.582) + v * (mpf(0.860) + v * (mpf(-0.0530) + v * mpf(0.01465))) - mp.log(gain)
        step = value / (mpf(0.860) + v * (2 * mpf(-0.0530) + 3 * v * mpf(0.01465)))
        v -= step
        if abs(step) < mpf(10) ** (3 - mp.dps):
            break
    return v + 39 + mpf(0.029) * (temperature - 223)


def fills(charge: mpf, gain: mpf, spread: mpf) -> tuple[mpf, mpf, mpf]:
    level = charge + spread * mp.sqrt(2 * charge)
    converter = (mpf(DETECTOR.adc_max_adu) - mpf(DETECTOR.bias_adu)) * mpf(DETECTOR.gain_e_adu)
    return (
        (charge + spread * mp.sqrt(charge)) / mpf(DETECTOR.full_well_e),
        gain * level / mpf(DETECTOR.register_full_well_e),
        gain * level / (converter - spread * mpf(DETECTOR.read_noise_e)),
    )


def filled(charge: float, gain: float, spread: float) -> float:
    """The filled fraction; of a saturated pixel from the words of the refusal, so only unsaturated ones are asked."""
    return pixel_saturated(charge, gain, DETECTOR, spread).unwrap()


def unsaturated() -> list[tuple[float, ...]]:
    return [
        case
        for case in itertools.product((0.0, 1e-12, 1.0, 1e3, 3e4), (1.0, 1.0 + 1e-12, 20.0, 1000.0, 1e4), SPREADS)
        if max(fills(*(mpf(x) for x in case))) < 0.999
    ]


@functools.cache
def cumulants(probability: mpf, stages: mpf) -> list[mpf]:
    """First five cumulants of the cascade, from the derivatives of its iterated cumulant function (Taylor series)."""
    series = [mpf(0), mpf(1), mpf(0), mpf(0), mpf(0), mpf(0)]
    for _ in range(int(stages)):
        series = _outer(series, probability)
    return [series[k] * mp.factorial(k) for k in range(1, 6)]


def _outer(inner: list[mpf], p: mpf) -> list[mpf]:
    """Taylor coefficients of ``inner + log(1 + p (exp(inner) - 1))`` to the fifth order."""
    powers, grown = [mpf(1)] + [mpf(0)] * 5, [mpf(0)] * 6
    for k in range(1, 6):
        powers = _times(powers, inner)
        grown = [a + b / mp.factorial(k) for a, b in zip(grown, powers, strict=True)]
    x = [p * a for a in grown]
    powers, log = [mpf(1)] + [mpf(0)] * 5, [mpf(0)] * 6
    for k in range(1, 6):
        powers = _times(powers, x)
        log = [a + (-1) ** (k + 1) * b / k for a, b in zip(log, powers, strict=True)]
    return [a + b for a, b in zip(inner, log, strict=True)]


def _times(a: list[mpf], b: list[mpf]) -> list[mpf]:
    return [mp.fsum(a[i] * b[k - i] for i in range(k + 1)) for k in range(6)]


def at_least(k: int, n: mpf, c: mpf) -> mpf:
    """Chance of at least ``k`` losses in ``n`` transfers."""
    with mp.extradps(60):
        return 1 - mp.fsum(mp.binomial(n, i) * c**i * (1 - c) ** (n - i) for i in range(k))


def loss(index: int) -> tuple[Callable[..., float], Callable[..., mpf]]:
    def computed(n: float, c: float) -> float:
        return chances_of_loss(np.array([int(n)]), c)[index][0]

    def exact(n: mpf, c: mpf) -> mpf:
        return at_least(index + 1, n, c) / at_least(index, n, c) if n > index else mpf(0)

    return computed, exact


def plain_adu(rate: float, exposure: float, gain: float) -> float:
    return expected_adu_map(np.full((3, 3), rate), exposure, gain, IDEAL)[1, 1]


def adu(rate: mpf, exposure: mpf, gain: mpf) -> mpf:
    charge = min(rate * exposure, mpf(10) ** 12)
    value = charge * gain / mpf(IDEAL.gain_e_adu) + mpf(IDEAL.bias_adu)
    return min(value, mpf(IDEAL.adc_max_adu))


CASCADES = [
    (float(stage_probability(gain, stages)), stages)
    for gain, stages in ((1 + 1e-12, 1), (1.3, 1), (1 + 1e-12, 16), (1e4, 16), (1 + 1e-12, 604), (300.0, 604))
]
FORMS = [
    ClosedForm(
        "simulator.camera.stage_probability",
        "gain 1 to 1e4, 1 to 604 stages",
        REGISTERS,
        lambda g, n: stage_probability(g, int(n)),
        stage,
        fixed=(1,),
    ),
    ClosedForm(
        "simulator.camera.excess_noise_factor2",
        "gain 1 to 1e4, 1 to 604 stages",
        REGISTERS,
        lambda g, n: excess_noise_factor2(g, int(n)),
        factor,
        fixed=(1,),
    ),
    ClosedForm(
        "simulator.camera.FrameNoise.charge_variance_e2",
        "0 to 1e12 e-, gain 1 to 1e4",
        list(itertools.product(CHARGES, (0.0, 1e-3), GAINS)),
        lambda photon, cic, gain: FrameNoise.of(DETECTOR, gain, 0.0).charge_variance_e2(photon + cic),
        pixel,
    ),
    ClosedForm(
        "simulator.camera.aperture_noise_pixels",
        "radius 1 to 1e6 px",
        [(r,) for r in (1.0, 1.0 + 1e-12, 3.3, 1e6)],
        aperture_noise_pixels,
        lambda r: mp.pi * r**2 - mp.pi * r / 3,
    ),
    ClosedForm(
        "simulator.camera.em_voltage_of",
        "gain 1 to 1e4, 120 to 320 K",
        list(itertools.product(GAINS, (120.0, 203.0, 223.0, 293.0, 320.0))),
        em_voltage_of,
        voltage,
    ),
    ClosedForm(
        "simulator.camera.pixel_saturated, filled fraction",
        "0 to 3e4 e-, gain 1 to 1e4, 0 to 100 sigma",
        unsaturated(),
        filled,
        lambda q, g, n: max(fills(q, g, n)),
    ),
    ClosedForm(
        "simulator.camera.VisibleCamera.expected_adu, every effect off",
        "0 to 1e12 e-/s, 1e-6 to 1e6 s, gain 1 to 1000",
        list(itertools.product((0.0, 1e-9, 1.0, 1e12), (1e-6, 1.0, 1e6), (1.0, 1.0 + 1e-12, 1000.0))),
        plain_adu,
        adu,
    ),
    ClosedForm(
        "simulator.detectors.chains.dark_law_e_s",
        "120 to 320 K",
        list(itertools.product((120.0, 165.0, 203.0, 293.0, 320.0), (0.0, 1e-6, 150.0, 1e6))),
        dark_law_e_s,
        lambda t, d: d * mpf("1.14e6") * t**3 * mp.exp(-9080 / t),
    ),
    ClosedForm(
        "simulator.detectors.visible.compressed",
        "0 to 1e12 e-",
        list(itertools.product(CHARGES, (1e-6, 0.02), (9e4,))),
        lambda x, b, at: compressed(np.float64(x), b, at),
        lambda x, b, at: x / (1 + x * b / ((1 - b) * at)),
    ),
    *(
        ClosedForm(
            f"simulator.detectors.gain.output_cumulants, {k + 1}",
            "gain 1 + 1e-12 to 1e4, 1 to 604 stages",
            CASCADES,
            lambda p, n, k=k: output_cumulants(p, int(n))[k],
            lambda p, n, k=k: cumulants(p, n)[k],
            fixed=(1,),
        )
        for k in range(5)
    ),
    *(
        ClosedForm(
            f"simulator.detectors.visible.chances_of_loss, {k + 1}",
            "1 to 3000 transfers, inefficiency 1e-12 to 0.01",
            list(itertools.product((1, 2, 3, 100, 3000), (1e-12, 1e-7, 3e-7, 1e-5, 1e-3, 0.01))),
            *loss(k),
            fixed=(0,),
        )
        for k in range(3)
    ),
]
