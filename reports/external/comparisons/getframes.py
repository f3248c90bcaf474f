"""Electrons after the register of an EMCCD: getframes."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from reports.external import register
from reports.external.comparison import Reference, Row

TITLE = "Register of an EMCCD: getframes"
REFERENCE = Reference("getframes", "2.6.1", "package index, getframes", ("getframes==2.6.1",))
TEXT = """
getframes draws from a Gamma law of the mean and of the excess noise factor that its camera has: the square root of 2
for an EMCCD, whatever the gain, or what the user gives. Asked as it comes, it misses our law as the fast mode of
emccd_detect does. Given the factor of the register (Robbins & Hadwen 2003), it has the right variance, and its
chances of small outputs are within 2 % at gain 1000; at gain 20, 10 % more single electrons and 31 % more pairs still
end below a tenth of their mean, because a Gamma law has outputs below one electron and a register has none.
"""
PRESET, GAINS, DRAWS = "andor_ocam2k", (1000.0, 20.0), 4_000_000
WHY_PLAIN = "Gamma(n, g) for every EMCCD, whatever its gain and stages"
WHY_GIVEN = "a Gamma law of the right mean and variance has another shape"


def factor(gain: float) -> float:
    """Return the squared excess noise factor that getframes is given: that of Robbins & Hadwen (2003)."""
    return 2.0 * (gain - 1.0) * gain ** (-(register.STAGES + 1.0) / register.STAGES) + 1.0 / gain


def peer() -> dict[str, Any]:
    """Ask getframes."""
    import getframes
    from getframes.noise import apply_gain_stage

    found: dict[str, Any] = {"plain": [], "given": []}
    for gain in GAINS:
        config = getframes.Camera.from_preset(PRESET).with_config(em_gain=gain).config
        for name, excess in (("plain", config.gain_excess_noise_factor), ("given", math.sqrt(factor(gain)))):

            def drawing(charge: Any, gain: float = gain, excess: float = excess) -> Any:
                return apply_gain_stage(charge, gain, excess, np.random.default_rng(1))

            found[name] += register.drawn(drawing, gain, DRAWS)
    return found


def rows(recorded: dict[str, Any]) -> list[Row]:
    """Return draws beside our law."""
    found = []
    for case in recorded["plain"]:
        found += register.compared(case, "as it comes", misses=WHY_PLAIN)
    for case in recorded["given"]:
        found += register.compared(case, "factor given", misses=WHY_GIVEN, variance_too=False)
    return found
