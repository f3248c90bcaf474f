"""Quantities that a table of known planets leaves open, each as a function of uniform numbers."""

import functools

import numpy as np

from catalogs import KnownPlanetTable
from cpic_core import BoolArray, FloatArray, InputError, IntArray, special
from cpic_planner.planets.laws import Isotropic, Law
from cpic_planner.planets.mass_radius import MJUP_IN_MSUN, STAR_MJUP, radius_from_mass
from cpic_planner.planets.population_config import load_population

_OF_COLUMNS = ("period", "epoch", "eccentricity", "omega", "semi_major_axis", "mass", "inclination", "node")
QUANTITIES = (*_OF_COLUMNS, "mean_anomaly", "radius", "star_mass", "solution")
"""What is drawn of one known planet, in the order of the last axis of the uniforms; ``solution`` is which orbit."""

ECCENTRICITY_HIGH = 0.99
_MJD_ZERO_JD = 2400000.5
_GAUSSIAN_YEAR_DAYS = 365.2568983
"""Period at 1 au around one solar mass."""
_LEAST = 1e-3
"""Least share of its published value that a drawn length, mass or period has."""


@functools.cache
def _usual_eccentricity() -> Law:
    """Return the law of eccentricities of the default population."""
    law = load_population().mixture[0].eccentricity
    assert law is not None
    return law


class DrawnRows:
    """Columns of some rows with the uniform numbers of their draws."""

    def __init__(self, table: KnownPlanetTable, index: IntArray, uniforms: FloatArray) -> None:
        self.table, self.index, self.uniforms = table, index, uniforms
        self.flags = [table.flags(int(row)) for row in index]

    def column(self, name: str) -> FloatArray:
        """Return the column of the rows, shape ``(n_rows, 1)``."""
        return self.table.number(name)[self.index][:, None]

    def share(self, quantity: str) -> FloatArray:
        """Return the uniform numbers of a quantity, shape ``(n_rows, n_draws)``, as of all that follows."""
        return self.uniforms[:, :, QUANTITIES.index(quantity)]

    def flagged(self, flag: str) -> BoolArray:
        """Return which rows have a flag, shape ``(n_rows, 1)``."""
        return np.array([flag in flags for flags in self.flags], bool)[:, None]

    def normal(
        self,
        name: str,
        error_name: str,
        quantity: str,
        *,
        low: float | None = None,
        high: float = np.inf,
        fill: FloatArray | None = None,
    ) -> FloatArray:
        """Return a normal about a column with its error, cut; above a thousandth of the value if ``low`` is not given.

        Parameters
        ----------
        name : str
            Column of the value.
        error_name : str
            Column of its error.
        quantity : str
            Name of the uniform numbers to use.
        low : float, optional
            Lower physical limit.
        high : float, optional
            Upper physical limit.
        fill : ndarray, optional
            Values where the table has none.
        """
        value = self.column(name)
        if fill is not None:
            value = np.where(np.isfinite(value), value, fill[:, None])
        error = np.nan_to_num(self.column(error_name), nan=0.0)
        least = _LEAST * value if low is None else np.full(value.shape, low)
        return truncated_normal(self.share(quantity), value, error, least, np.full(value.shape, high))

    def angle(self, name: str, error_name: str, quantity: str) -> FloatArray:
        """Return a normal about an angle, uniform where it is unknown; degrees.

        Parameters
        ----------
        name : str
            Column of the angle, degrees.
        error_name : str
            Column of its error, degrees.
        quantity : str
            Name of the uniform numbers to use.
        """
        known = self.normal(name, error_name, quantity, low=-np.inf)
        return np.where(np.isfinite(known), known, 360.0 * self.share(quantity)) % 360.0

    def eccentricity(self) -> FloatArray:
        """Return the eccentricity: about its value, below its limit, or of planets of long periods."""
        share, value = self.share("eccentricity"), self.column("eccentricity")
        drawn = self.normal("eccentricity", "eccentricity_err", "eccentricity", low=0.0, high=ECCENTRICITY_HIGH)
        drawn = np.where(self.flagged("eccentricity_upper_limit"), share * np.minimum(value, ECCENTRICITY_HIGH), drawn)
        unknown = ~np.isfinite(value[:, 0])
        drawn[unknown] = _usual_eccentricity().quantile(share[unknown])
        return drawn

    def tilt_and_mass(self) -> tuple[FloatArray, FloatArray]:
        """Return the inclination and true mass, which m sin i joins."""
        true = self.normal("mass_mjup", "mass_err_mjup", "mass")
        limit = self.flagged("mass_upper_limit")
        true = np.where(limit, np.maximum(self.share("mass"), _LEAST) * self.column("mass_mjup"), true)
        minimum = self.normal("msini_mjup", "msini_err_mjup", "mass")
        alone = np.isfinite(minimum) & ~np.isfinite(true)
        share = self.share("inclination")
        # Of both hemispheres, the poles whose planet would be a star are left out.
        least_sine = np.where(alone, np.minimum(minimum / STAR_MJUP, 1.0), 0.0)
        any_tilt = np.rad2deg(np.arccos(np.sqrt(1.0 - least_sine**2) * np.cos(np.deg2rad(Isotropic().quantile(share)))))
        known = self.normal("inclination_deg", "inclination_err_deg", "inclination", low=0.0, high=180.0)
        tilt = np.where(np.isfinite(known), known, any_tilt)
        sine = np.maximum(np.sin(np.deg2rad(tilt)), 1e-9)
        return tilt, np.where(alone, np.minimum(minimum / sine, np.maximum(STAR_MJUP, minimum)), true)

    def axis_and_period(self, star_msun: FloatArray, mass_mjup: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the semi-major axis and period; what is missing follows from Kepler's third law.

        Parameters
        ----------
        star_msun : ndarray
            Mass of the star, solar masses, shape (n, n_draws).
        mass_mjup : ndarray
            Mass of the planet, Jupiter masses, shape (n, n_draws).
        """
        axis = self.normal("semi_major_axis_au", "semi_major_axis_err_au", "semi_major_axis")
        period = self.normal("period_days", "period_err_days", "period")
        total = star_msun + MJUP_IN_MSUN * np.nan_to_num(mass_mjup, nan=0.0)
        no_axis, no_period = ~np.isfinite(axis), ~np.isfinite(period)
        lost = (no_axis | no_period) & ~np.isfinite(total)
        if lost.any():
            name = self.table.text("planet")[int(self.index[np.flatnonzero(lost.any(axis=1))[0]])]
            allowed = "a mass: it joins period and semi-major axis"
            raise InputError(f"{name} star_mass_msun", "missing", unit="M_Sun", allowed=allowed)
        from_period = np.cbrt(total * (period / _GAUSSIAN_YEAR_DAYS) ** 2)
        from_axis = _GAUSSIAN_YEAR_DAYS * np.sqrt(axis**3 / total)
        return np.where(no_axis, from_period, axis), np.where(no_period, from_axis, period)

    def mean_anomaly(
        self, epoch_mjd: float, period_days: FloatArray, eccentricity: FloatArray, omega_star_deg: FloatArray
    ) -> FloatArray:
        """Return the mean anomaly at the epoch, degrees.

        Parameters
        ----------
        epoch_mjd : float
            Date of the anomaly, MJD.
        period_days : ndarray
            Period, days, shape (n, n_draws).
        eccentricity : ndarray
            0 to 0.99, shape (n, n_draws).
        omega_star_deg : ndarray
            Argument of pericentre of the star's orbit, degrees, shape (n, n_draws).
        """
        passage = self.normal("periastron_jd", "periastron_err_days", "epoch")
        conjunction = self.normal("conjunction_jd", "conjunction_err_days", "epoch")
        told = [np.isfinite(self.column(f"{what}_err_days")) for what in ("periastron", "conjunction")]
        better = np.isfinite(self.column("periastron_jd")) & told[0] & ~told[1]  # of two the one with an error
        meets = np.isfinite(self.column("conjunction_jd")) & ~better
        true = np.deg2rad(90.0 - omega_star_deg)
        sine, cosine = np.sin(true / 2), np.cos(true / 2)
        half = np.arctan2(np.sqrt(1.0 - eccentricity) * sine, np.sqrt(1.0 + eccentricity) * cosine)
        at_conjunction = 2.0 * half - eccentricity * np.sin(2.0 * half)
        start = np.where(meets, conjunction, passage) - _MJD_ZERO_JD
        angle = 360.0 * (epoch_mjd - start) / period_days + np.where(meets, np.rad2deg(at_conjunction), 0.0)
        return np.where(self.flagged("phase_unknown"), 360.0 * self.share("mean_anomaly"), angle) % 360.0

    def radius(self, mass_mjup: FloatArray) -> FloatArray:
        """Return the radius: about its value, or that of the true mass with scatter."""
        known = self.normal("radius_rjup", "radius_err_rjup", "radius")
        deviate = special().ndtri(np.clip(self.share("radius"), 1e-12, 1.0 - 1e-12))
        other = radius_from_mass(np.where(np.isfinite(mass_mjup), mass_mjup, 1.0), deviate)
        return np.where(np.isfinite(known), known, other)


def truncated_normal(
    share: FloatArray, mean: FloatArray, sd: FloatArray, low: FloatArray, high: FloatArray
) -> FloatArray:
    """Return the quantiles of normal laws cut at both ends; the mean where ``sd`` is 0; arrays broadcast.

    Parameters
    ----------
    share : ndarray
        Uniform numbers in [0, 1), turned into values by the law.
    mean : ndarray
        Mean before the limits.
    sd : ndarray
        Standard deviation before the limits, 0 for an exact value.
    low : ndarray
        Lower limit.
    high : ndarray
        Upper limit.
    """
    width = np.where(sd > 0.0, sd, 1.0)
    first, last = special().ndtr((low - mean) / width), special().ndtr((high - mean) / width)
    with np.errstate(invalid="ignore"):
        drawn = mean + width * special().ndtri(np.clip(first + share * (last - first), 1e-15, 1.0 - 1e-15))
        drawn = np.clip(drawn, low, high)
    return np.where(sd > 0.0, drawn, np.broadcast_to(mean, drawn.shape))
