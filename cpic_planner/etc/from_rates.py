"""Times and signal-to-noise ratios from count rates that somebody else worked out, by a stated convention.

The calculators of the field have the same few rates and combine them in ways that differ by factors of two and more:
whose noise counts, and how often the background does.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from pydantic import Field

from cpic_core import (
    ArrayLike,
    FloatArray,
    InputError,
    Outcome,
    Outcomes,
    Reason,
    Status,
    checked_array,
    numeric_context,
)
from simulator.config import FrozenModel, validate

LARGEST_RATE, LARGEST_SNR, LARGEST_TIME_S = 1e30, 1e12, 1e30


class RateConvention(FrozenModel):
    """The terms that count as noise: ``SNR^2 = P^2 t^2 / ((a P + b B) t + F^2 t^2)``.

    ``P``, ``B`` and ``F`` are the rates of planet, background and noise floor, ``t`` the time on the star.

    Attributes
    ----------
    planet_noise : float
        ``a``: variance that each counted electron of the planet adds; 0 where its own noise does not count, or where
        the background rate has it already, 1 for photon noise.
    background_noise : float
        ``b``: variance that each counted electron of the background adds; 2 where a reference that is as long as the
        science exposure is subtracted, 1 without one.
    """

    planet_noise: float = Field(ge=0.0, le=100.0)
    background_noise: float = Field(ge=0.0, le=100.0)

    @property
    def equation(self) -> str:
        """Time to an SNR, in one line."""
        parts = [
            symbol if factor == 1.0 else f"{factor:g} {symbol}"
            for factor, symbol in ((self.planet_noise, "P"), (self.background_noise, "B"))
            if factor
        ]
        variance = " + ".join(parts) or "0"
        return f"t = SNR^2 ({variance}) / (P^2 - (SNR F)^2)"


CONVENTIONS: dict[str, RateConvention] = {
    "cpic": RateConvention(planet_noise=1.0, background_noise=2.0),
    "ayo": RateConvention(planet_noise=1.0, background_noise=2.0),
    "ebs": RateConvention(planet_noise=0.0, background_noise=1.0),
    "exosims": RateConvention(planet_noise=0.0, background_noise=1.0),
    "cgi_noise": RateConvention(planet_noise=0.0, background_noise=1.0),
}
"""Conventions by the name of the calculator.

``cpic`` is the SNR of this package: the planet's own noise counts, and there are as many reference frames, without the
planet, as science frames. ``ayo`` is that of AYO and pyEDITH, and the same. ``ebs`` and ``exosims`` leave the planet's
noise out and subtract no reference. ``cgi_noise`` (Roman) takes as ``B`` the whole rate of variance, the planet's
included.
Source: Stark et al. 2025 (arXiv 2502.18556) and its table of rates and times; github.com/roman-corgi/cgi_noise.
"""


def rate_convention(convention: str | Mapping[str, Any] | RateConvention) -> RateConvention:
    """Return a convention by the name of a calculator or by its choices.

    Parameters
    ----------
    convention : str, mapping or RateConvention
        One of `CONVENTIONS`, or both fields of `RateConvention`.

    Raises
    ------
    InputError
        For another name, a choice that is missing or unknown, or one that is out of range.
    """
    if isinstance(convention, RateConvention):
        return convention
    if isinstance(convention, str) and convention in CONVENTIONS:
        return CONVENTIONS[convention]
    if isinstance(convention, Mapping):
        return validate(RateConvention, convention, where="convention")
    allowed = f"{', '.join(CONVENTIONS)}, or a mapping with planet_noise and background_noise, 0 to 100 each"
    raise InputError("convention", convention, allowed=allowed)


def _checked_rates(
    planet: ArrayLike, background: ArrayLike, floor: ArrayLike, wanted: FloatArray, by: Any
) -> tuple[FloatArray, ...]:
    """Return the planet's rate, the variance of a second, the floor and what is wanted, in one shape."""
    convention = rate_convention(by)
    rates = {"planet_rate": planet, "background_rate": background, "floor_rate": floor}
    checked = [checked_array(name, rate, low=0.0, high=LARGEST_RATE, unit="1/s") for name, rate in rates.items()]
    try:
        p, b, f, w = np.broadcast_arrays(*checked, wanted)
    except ValueError:
        shapes = ", ".join(str(part.shape) for part in (*checked, wanted))
        raise InputError("planet_rate", shapes, allowed="arrays whose shapes broadcast") from None
    return p, convention.planet_noise * p + convention.background_noise * b, f, w


@numeric_context()
def time_for_rates(
    planet_rate: ArrayLike,
    background_rate: ArrayLike,
    *,
    snr: ArrayLike,
    floor_rate: ArrayLike = 0.0,
    convention: str | Mapping[str, Any] | RateConvention,
) -> Outcome[float] | Outcomes:
    """Return the time on the star until a planet of known count rate reaches a signal-to-noise ratio.

    Parameters
    ----------
    planet_rate, background_rate : array_like
        Counted electrons per second in the aperture, 0 to 1e30; the background is all light and dark charge but the
        planet's (with ``cgi_noise`` the whole rate of variance).
    snr : array_like
        Signal-to-noise ratio to reach, 1e-12 to 1e12.
    floor_rate : array_like, optional
        Noise that grows with time as the signal does (residual speckles), electrons per second, 0 to 1e30.
    convention : str, mapping or RateConvention
        Whose noise counts: ``cpic``, ``ayo``, ``ebs``, ``exosims``, ``cgi_noise``, or ``planet_noise`` and
        ``background_noise`` of `RateConvention`, whose ``equation`` says what is solved.

    Returns
    -------
    Outcome or Outcomes
        Seconds; an `Outcome` where all arguments are single numbers, else `Outcomes` of the shape to which they
        broadcast. Where the planet is not brighter than ``snr`` times the floor no time is long enough:
        ``unreachable`` for ``speckle_floor``, or for ``no_planet_light``. Overheads, readout and references are not
        part of the time.

    Raises
    ------
    InputError
        For a rate, ratio or convention that is not accepted, or shapes that do not broadcast.

    Notes
    -----
    ``t = SNR^2 (a P + b B) / (P^2 - (SNR F)^2)`` (Stark et al. 2025, arXiv 2502.18556).
    """
    wanted = checked_array("snr", snr, low=1.0 / LARGEST_SNR, high=LARGEST_SNR)
    planet, variance, floor, wanted = _checked_rates(planet_rate, background_rate, floor_rate, wanted, convention)
    lit = planet > 0.0
    with np.errstate(over="ignore", invalid="ignore"):
        share = wanted * (floor / np.where(lit, planet, 1.0))
        possible = lit & (share < 1.0)
        share = np.where(possible, share, 0.0)
        scale = wanted / np.where(possible, planet, 1.0)
        time_s = scale * (scale * variance) / ((1.0 - share) * (1.0 + share))
    time_s = np.where(variance > 0.0, time_s, 0.0)  # a faint planet has an infinite scale
    finite = np.isfinite(time_s)
    reasons = {Reason.NO_LIGHT: ~lit, Reason.SPECKLE_FLOOR: lit & ~possible, Reason.INSUFFICIENT_TIME: ~finite}
    return Outcomes.of(time_s, {reason: (Status.UNREACHABLE, bad) for reason, bad in reasons.items()}, _WHY, "s")


@numeric_context()
def snr_for_rates(
    planet_rate: ArrayLike,
    background_rate: ArrayLike,
    *,
    time_s: ArrayLike,
    floor_rate: ArrayLike = 0.0,
    convention: str | Mapping[str, Any] | RateConvention,
) -> Outcome[float] | Outcomes:
    """Return the signal-to-noise ratio of a planet of known count rate in a time: the inverse of `time_for_rates`.

    Parameters
    ----------
    planet_rate, background_rate, floor_rate, convention
        As of `time_for_rates`.
    time_s : array_like
        Seconds on the star, 0 to 1e30.

    Returns
    -------
    Outcome or Outcomes
        As of `time_for_rates`, without a unit: ``SNR = P t / sqrt((a P + b B) t + (F t)^2)``. There is none where
        there is signal and no noise at all: ``invalid``.

    Raises
    ------
    InputError
        As of `time_for_rates`.
    """
    wanted = checked_array("time_s", time_s, low=0.0, high=LARGEST_TIME_S, unit="s")
    planet, variance, floor, wanted = _checked_rates(planet_rate, background_rate, floor_rate, wanted, convention)
    noise = np.hypot(np.sqrt(variance) * np.sqrt(wanted), floor * wanted)
    signal = planet * wanted
    silent = (noise == 0.0) & (signal > 0.0)
    ratio = signal / np.where(noise > 0.0, noise, 1.0)
    return Outcomes.of(ratio, {Reason.NO_NOISE: (Status.INVALID, silent)}, _WHY)


_WHY = {
    Reason.NO_LIGHT: "the planet sends no light, so that no time is long enough",
    Reason.SPECKLE_FLOOR: "the planet is not brighter than the asked SNR times the noise floor: no time is long enough",
    Reason.INSUFFICIENT_TIME: "the time is longer than the largest number of the machine",
    Reason.NO_NOISE: "nothing makes noise by these rates and choices: the ratio has no value",
}
