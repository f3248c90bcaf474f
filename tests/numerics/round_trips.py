"""Questions to the exposure-time calculator that undo each other, from end to end of what can be asked."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field, replace

import numpy as np

from cpic_planner.etc import EtcModel, build_model, contrast_limit
from cpic_planner.etc.questions import exposure_time, signal_to_noise
from cpic_planner.targets import Targets, find_target
from simulator.config import load_instrument

MAGNITUDES = (-27.0, -1.46, 3.5, 12.0, 30.0)
LEVELS = (1e-6, 1e-3, 1.0, 5.0, 100.0, 1e4, 1e6)
CONTRASTS = (1e-3, 1e-6, 1e-9, 1e-12, 1e-15)
TIMES_S = (1.0, 100.0, 1e4, 1e6, 1e9)
DISTANCES_PC = (0.1, 10.0, 1000.0)
ALLOWED = 1e-9
"""What the search for whole frames may leave between a question and the one that undoes it, relative."""


@dataclass
class Trips:
    """Worst relative deviation, the question that has it, and how all questions were answered."""

    worst: float = 0.0
    where: str = ""
    answers: Counter[str] = field(default_factory=Counter)

    def note(self, deviation: float, where: str) -> None:
        """Keep the largest deviation."""
        if deviation > self.worst:
            self.worst, self.where = deviation, where


def model() -> EtcModel:
    """The default instrument without the walk of the wavefront: then more time is always better."""
    return build_model(load_instrument({"drift": {"visit_nm": 0, "walk_nm_per_sqrt_hour": 0}}), ["F520"])


def stars() -> Targets:
    """One star of each magnitude and distance, single."""
    tau_cet = find_target("tau Cet")[0]
    v, d = (part.ravel() for part in np.meshgrid(MAGNITUDES, DISTANCES_PC))
    return replace(tau_cet.select([0] * v.size), v_mag=v, distance_pc=d)


def times(etc: EtcModel, levels: tuple[float, ...] = LEVELS) -> Trips:
    """Time for an SNR, and the SNR in that time."""
    found = Trips()
    for contrast in CONTRASTS:
        for level in levels:
            asked = {"separation_arcsec": 0.55, "contrast": contrast}
            for i, there in enumerate(exposure_time(etc, stars(), snr=level, **asked)):
                found.answers[there.status.value] += 1
                if there.value is None or not 1e-3 <= there.value <= 1e9:
                    continue
                back = signal_to_noise(etc, stars().select([i]), time_s=there.value, **asked)[0]
                # Whole frames of the shortest exposure may give more than was asked for, never less.
                if there.snr is None or back.value is None:
                    found.note(np.inf, f"contrast {contrast:g}, SNR {level:g}: no way back")
                    continue
                found.note(abs(back.value / there.snr - 1.0), f"contrast {contrast:g}, SNR {level:g}")
                found.note(max(level / back.value - 1.0, 0.0), f"contrast {contrast:g}, SNR {level:g}")
    return found


def limits(etc: EtcModel) -> Trips:
    """Faintest contrast in a time, and the significance of a planet of that contrast."""
    found = Trips()
    for time_s in TIMES_S:
        for i, there in enumerate(contrast_limit(etc, stars(), time_s=time_s, separation_arcsec=0.55, sigma=5.0)):
            found.answers[there.status.value] += 1
            if there.value is None:
                continue
            one = stars().select([i])
            back = exposure_time(etc, one, sigma=5.0, separation_arcsec=0.55, contrast=there.value)[0]
            if back.value is None:
                found.note(np.inf, f"{time_s:g} s: no way back")
                continue
            found.note(max(back.value / time_s - 1.0, 0.0), f"{time_s:g} s, contrast {there.value:.3g}")
            found.note(abs(float(back.significance or 0.0) / 5.0 - 1.0), f"{time_s:g} s, contrast {there.value:.3g}")
    return found
