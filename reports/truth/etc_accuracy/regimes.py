"""Synthetic observations in which one noise after the other dominates, and what the ETC says of them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from monte_carlo import Aperture, Readout, Stack, aperture_on

from cpic_planner.etc import ApertureRates, FrameCamera, Programme, StackNoise, stack_noise
from cpic_planner.queries import Strategy
from simulator.signal import ProgrammeLaw, SpeckleLaw

GAINS = (1.0, 2.0, 20.0, 300.0, 1000.0)
RATIOS = (0.5, 1.0, 3.0)
LIGHTS = ("halo", "sky", "companion", "dark", "exozodi")
REGIMES = ("photon", *LIGHTS, "read", "cic", "speckle", "mixed", "particles", "reference star", "projected")
SPECKLED = ("speckle", "mixed")
RADIUS_PIXELS = 3.0
PLACES = ((0.0, 0.0), (0.5, 0.0), (0.5, 0.5), (0.25, 0.25))  # pixels; each has the symmetry that makes draws few
DOMINANT = 30.0


@dataclass(frozen=True)
class Case:
    """One observation: which noise rules, at which gain."""

    regime: str
    stack: Stack
    readout: Readout

    @property
    def light(self) -> str:
        """Field of the rates that holds the background."""
        return self.regime if self.regime in LIGHTS else "halo"

    @property
    def white(self) -> bool:
        """Whether all noise averages."""
        return self.regime not in SPECKLED


def apertures() -> list[Aperture]:
    """The synthetic aperture at four places on the pixels."""
    return [aperture_on(RADIUS_PIXELS, offset_y=y, offset_x=x) for y, x in PLACES]


def case_of(regime: str, em_gain: float, reference_ratio: float = 1.0) -> Case:
    """Levels such that the named noise is most of the variance at that gain."""
    readout, t, n = Readout(), 100.0, 30
    area = np.pi * RADIUS_PIXELS**2
    read = 2.0 * area * (readout.read_noise_e**2 + readout.gain_e_adu**2 / 12.0) / em_gain**2  # per frame
    rule = max(100.0, DOMINANT * read)  # light of a frame beside which reading does not count
    more: dict[str, Any] = {}
    if regime == "photon":
        planet, background = rule, 0.01 * rule
    elif regime in LIGHTS:
        planet, background = 0.02 * rule, rule
    elif regime == "read":
        planet, background, readout = 0.02 * read, 0.002 * read, Readout(cic_e=0.0)
    elif regime == "cic":
        n, planet, background = 1000, 0.02 * rule, 0.01 * rule
        readout = Readout(cic_e=rule / area)
    elif regime == "speckle":
        background = max(1000.0, 10.0 * np.sqrt(DOMINANT * read / n))
        planet, more = 0.1 * background, {"speckle_e_s": 0.1 * background / t}
    else:
        n, planet, background = 100, max(30.0, read), max(30.0, read)
        more = {
            "mixed": {"speckle_e_s": np.sqrt(background / n) / t},
            "particles": {"loss_per_s": 2e-3},
            "reference star": {"reference_background_e_s": 2.5 * background / t, "reference_scale": 0.4},
            "projected": {"rdi_throughput": 0.85},
        }[regime]
    stack = Stack(planet / t, background / t, t, n, em_gain, reference_ratio, **more)
    return Case(regime, stack, readout)


def cases() -> Iterator[Case]:
    """Every regime at every gain, and three regimes with other reference libraries."""
    for regime in REGIMES:
        for gain in GAINS:
            yield case_of(regime, gain)
    for regime in ("halo", "read", "mixed"):
        for gain in GAINS:
            for ratio in RATIOS:
                if ratio != 1.0:
                    yield case_of(regime, gain, ratio)


def camera_of(readout: Readout) -> FrameCamera:
    """The ETC's camera of that readout; nothing saturates."""
    return FrameCamera(
        full_well_e=np.inf,
        register_full_well_e=np.inf,
        converter_e=np.inf,
        em_gain_max=1000.0,
        register_stages=readout.stages,
        read_noise_e=readout.read_noise_e,
        rounding_e=readout.gain_e_adu / np.sqrt(12.0),
        cic_e=readout.cic_e,
        dark_e_s=0.0,
        readout_s=1.1,
        exposure_min_s=0.01,
        exposure_max_s=300.0,
    )


def rates_of(stack: Stack, places: Sequence[Aperture], light: str = "halo") -> ApertureRates:
    """The ETC's rates of a stack whose background is all of one origin."""
    zero = np.zeros(1)
    none = SpeckleLaw(zero, zero, zero)
    other = stack.background_e_s if stack.reference_background_e_s is None else stack.reference_background_e_s
    values: dict[str, Any] = {item.name: zero for item in fields(ApertureRates)} | {
        "planet_e_s": np.array([stack.planet_e_s]),
        f"{light}_e_s": np.array([stack.background_e_s]),
        "speckle": ProgrammeLaw(*[SpeckleLaw(np.array([stack.speckle_e_s**2 / 2.0]), zero, zero)] * 2, none),
        "aperture_pixels": places[0].pixels,
        "noise_fraction": float(np.mean([place.noise_fraction for place in places])),
        "source_noise_fraction": float(np.mean([place.source_noise_fraction for place in places])),
        "background_apertures": np.array([float(stack.background_apertures)]),
        "loss_per_s": stack.loss_per_s,
        "reference_light_e_s": np.array([other * stack.reference_scale**2]),
        "reference_scale": np.array([stack.reference_scale**2]),
        "variance_factor": 1.0,
    }
    return ApertureRates(**values)


def predicted(case: Case, places: Sequence[Aperture]) -> StackNoise:
    """What the ETC says."""
    stack = case.stack
    return stack_noise(
        rates_of(stack, places, case.light),
        stack.exposure_s,
        stack.n_frames,
        stack.em_gain,
        camera_of(case.readout),
        Strategy(reference_ratio=stack.reference_ratio),
        Programme(throughput=np.array(stack.rdi_throughput)),
    )
