"""Electrons after the register of an EMCCD: Roman's detector simulator."""

from __future__ import annotations

from typing import Any

import numpy as np

from reports.external import register
from reports.external.comparison import Reference, Row

TITLE = "Register of an EMCCD: emccd_detect"
REFERENCE = Reference(
    "emccd_detect",
    "2.6.2",
    "package index and repository roman-corgi/emccd_detect",
    ("emccd-detect==2.6.2",),
)
TEXT = """
Electrons after 604 stages for 1, 2 and 5 electrons before them. emccd_detect has three answers: `exact_gain_PDF`, the
law of Matsuo in the form of Sutin (doi 10.1117/1.JATIS.9.2.028001), a way to the law that shares nothing with our
generating function; `rand_em_gain`, which draws every stage; and its fast mode, which draws from Gamma(n, g) and
which its `auto` takes above a gain of 200. The first two have our law. Gamma(n, g) has its mean, but a squared excess
noise factor of 2 instead of 1.976 at gain 1000, and more small outputs: 8 % more single electrons end below 2 % of
the gain, and 1 % more below half of it, where a threshold for photon counting may lie. The lower the gain, the worse:
at gain 20, 22 % more single electrons and 59 % more pairs end below a tenth of their mean. Our camera draws from the
exact law up to 24 electrons and beyond (`simulator.camera.multiply`).
"""
GAINS = (20.0, 1000.0)
DRAWN = (("slow", 1000.0, 250_000), ("fast", 1000.0, 4_000_000), ("fast_low", 20.0, 4_000_000))
WHY_LAW = "two forms of one law; theirs sums logarithms of factorials 604 times over"
WHY_GAMMA = "Gamma(n, g) is the limit of endlessly many stages at endless gain"


def peer() -> dict[str, Any]:
    """Ask emccd_detect."""
    from emccd_detect.rand_em_gain import exact_gain_PDF, rand_em_gain

    law = []
    for gain in GAINS:
        for electrons in register.ELECTRONS:
            limits = register.limits(electrons, gain)
            pmf = exact_gain_PDF(gain, register.STAGES, electrons, np.arange(limits[-1] + 1))
            law.append({"electrons": electrons, "gain": gain, "tails": np.cumsum(pmf)[limits].tolist()})
    found = {"law": law}
    for name, gain, draws in DRAWN:
        fast = name != "slow"
        chance = gain ** (1.0 / register.STAGES) - 1.0
        stages = dict.fromkeys(range(1, register.STAGES + 1), chance)

        def drawing(charge: Any, stages: dict[int, float] = stages, fast: bool = fast) -> Any:
            np.random.seed(1)  # noqa: NPY002 (the package draws from the global generator)
            return rand_em_gain(charge, stages, register.STAGES, fast, fast)

        found[name] = register.drawn(drawing, gain, draws)
    return found


def rows(recorded: dict[str, Any]) -> list[Row]:
    """Return both laws, and draws beside ours."""
    found = []
    for case in recorded["law"]:
        electrons, gain = case["electrons"], case["gain"]
        law = register.our_law(electrons, gain)
        for limit, theirs in zip(register.limits(electrons, gain), case["tails"], strict=True):
            if theirs > register.LEAST_CHANCE:
                what = f"chance of at most {limit} e-, {electrons} e-, gain {gain:g}, law"
                found.append(Row(what, theirs, float(law[limit]), 1e-7, WHY_LAW))
    for case in recorded["slow"]:
        found += register.compared(case, "every stage drawn")
    for case in (*recorded["fast"], *recorded["fast_low"]):
        found += register.compared(case, "fast mode", misses=WHY_GAMMA)
    return found
