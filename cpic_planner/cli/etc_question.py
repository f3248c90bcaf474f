"""One question to the exposure-time calculator, asked at given separations or where its answer is best."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cpic_planner.etc import questions
from cpic_planner.etc.answer import EtcAnswer
from cpic_planner.etc.cases import BandCases, FrameWish, band_cases, planets_of
from cpic_planner.etc.frames import smooth_in_visit, smooth_least_visit_s
from cpic_planner.etc.model import EtcModel
from cpic_planner.etc.noise import Objective
from cpic_planner.etc.planet import ReferencePlanet
from cpic_planner.optimiser import separation_grid
from cpic_planner.report.numbers import duration_text
from cpic_planner.targets import Targets

__all__ = ["EtcQuestion"]

FloatArray = NDArray[np.float64]
_ENDLESS_S = 1e12
_TRIAL_CONTRAST = 1e-8


@dataclass(frozen=True)
class EtcQuestion:
    """What is asked: the limit if ``limit``, else the time if a level is given, else the SNR.

    Attributes
    ----------
    time_s : float
        Wall time; of no meaning where the time is asked for.
    snr, sigma : float, optional
        Level: photometric SNR, or plain significance.
    detect : bool
        Level: the small-sample threshold.
    limit : bool
    planet : ReferencePlanet
    contrasts : sequence of float, optional
        Instead of the planet.
    exposure_s, em_gain : float, optional
        Fixed.
    n_frames : int, optional
        Frames of that exposure: they set the time, instead of ``time_s``.
    """

    time_s: float
    planet: ReferencePlanet
    snr: float | None = None
    sigma: float | None = None
    detect: bool = False
    limit: bool = False
    contrasts: tuple[float, ...] | None = None
    exposure_s: float | None = None
    em_gain: float | None = None
    n_frames: int | None = None

    @property
    def asks_time(self) -> bool:
        """Whether the answer is a time."""
        return not self.limit and (self.snr is not None or self.sigma is not None or self.detect)

    @property
    def words(self) -> str:
        """The question in words."""
        level = "a detection"
        if self.snr is not None or self.sigma is not None:
            level = f"SNR {self.snr:g}" if self.snr is not None else f"{self.sigma:g} sigma"
        if self.asks_time:
            return f"wall time for {level}"
        time = duration_text(self.time_s)
        if self.n_frames is not None and self.exposure_s is not None:
            time = f"{self.n_frames} × {self.exposure_s:g} s"
        return f"contrast limit for {level} in {time}" if self.limit else f"SNR in {time}"

    def wall_s(self, model: EtcModel, band: str) -> float:
        """Wall time in a band: the given one, or that of the frames."""
        if self.n_frames is None or self.exposure_s is None:
            return self.time_s
        # A hair more, lest rounding lose a frame.
        pace_s = (self.exposure_s + model.camera(band).readout_s) * (1.0 + 1e-12)
        return float(model.time_s(self.n_frames * pace_s))

    def ask(self, model: EtcModel, star: Targets, places: Sequence[float]) -> list[EtcAnswer]:
        """Answers in every band at separations, planets within bands."""
        if self.n_frames is None:
            return self._ask(model, star, model.bands, places)
        return [answer for band in model.bands for answer in self._ask(model, star, [band], places)]

    def _ask(self, model: EtcModel, star: Targets, bands: Sequence[str], places: Sequence[float]) -> list[EtcAnswer]:
        common: dict[str, Any] = {
            "bands": bands,
            "separation_arcsec": list(places),
            "exposure_s": self.exposure_s,
            "em_gain": self.em_gain,
        }
        given: dict[str, Any] = {"time_s": self.wall_s(model, bands[0]), "exact": self.n_frames is not None}
        if self.limit:
            return questions.contrast_limit(model, star, sigma=self.sigma, snr=self.snr, **given, **common)
        common |= {"planet": self.planet, "contrast": None if self.contrasts is None else list(self.contrasts)}
        if self.asks_time:
            level: dict[str, Any] = {"snr": self.snr, "sigma": self.sigma, "detect": self.detect}
            return questions.exposure_time(model, star, **level, **common)
        return questions.signal_to_noise(model, star, **given, **common)

    def ask_at_best(self, model: EtcModel, star: Targets) -> list[EtcAnswer]:
        """Answers where they are best in each band, one for each contrast."""
        answers = []
        for band in model.bands:
            answers += self._ask(model, star, [band], self.best_places(model, star, band))
        return answers

    def best_places(self, model: EtcModel, star: Targets, band: str) -> list[float]:
        """Separation of least time, of clearest detection or of faintest limit in a band, for each contrast.

        Where the level is out of reach it is the separation that comes nearest to it. Frames need not be whole in this
        search, which is on the grid of the ranking.
        """
        grid = separation_grid(model, band)
        wish = FrameWish(self.exposure_s, self.em_gain)
        best = []
        for contrast in (_TRIAL_CONTRAST,) if self.limit else self.contrasts or (None,):
            cases = band_cases(model, star, band, planets_of(list(grid), self.planet, contrast), wish)
            best.append(float(grid[int(np.argmin(self._cost(model, cases)))]))
        return best

    def _cost(self, model: EtcModel, cases: BandCases) -> FloatArray:
        """What to make small, one number a separation; places outside the field cost ``inf``."""
        objective: Objective = "significance" if self.snr is None else "snr"
        level = np.full(len(cases.planets), self.snr or self.sigma) if self.snr or self.sigma else cases.threshold
        problem = cases.problem(objective)

        def missed(visit_s: float) -> FloatArray:
            with np.errstate(invalid="ignore"):
                cost = np.sqrt(smooth_in_visit(problem, np.asarray(visit_s)))[0] * level
            return np.where(cases.usable[0] & ~np.isnan(cost), cost, np.inf)

        if not self.asks_time:
            return missed(float(model.visit_s(self.wall_s(model, cases.band))))
        visit = smooth_least_visit_s(problem, np.broadcast_to(level, cases.contrast.shape))[0]
        visit = np.where(cases.usable[0], visit, np.inf)
        return visit if np.isfinite(visit).any() else missed(_ENDLESS_S)
