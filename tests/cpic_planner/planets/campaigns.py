"""Campaigns of astrometry of single planets, simulated and fitted by code of their own."""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from cpic_planner.planets import astrometric_error_arcsec, draw_population, load_population

STARS = {"eps Eri": (3.22, 0.82), "tau Cet": (3.65, 0.78), "alf Cen A": (1.33, 1.10)}
"""Distance in pc and mass in solar masses."""
HOLE_ARCSEC = 0.28, 0.95
LAMBDA_D_ARCSEC = 0.0536
MASS_ERROR = 0.064
# What a fit knows beforehand: the mean and width of ln a of the population, of eccentricities and of poles.
WIDTHS = np.array([0.70, 0.23, 0.23, 0.44, 0.44])


def offsets(elements, days):
    """East and north in au, shape (2, t), of elements (ln a, h, k, p, q, mean longitude, ln M) of a prograde orbit.

    Kepler's equation in the eccentric longitude and the orbit's own axes: Broucke & Cefola 1972, Celest. Mech. 5, 303.
    Not numbers where the orbit is none, which a fit takes for a step too far.
    """
    log_axis, h, k, p, q, longitude, log_mass = elements
    if np.hypot(h, k) > 0.99 or max(abs(log_axis), abs(log_mass)) > 10.0:
        return np.full((2, len(days)), np.nan)
    motion = 2.0 * np.pi / 365.25 * np.exp(0.5 * log_mass - 1.5 * log_axis)
    mean = longitude + motion * np.asarray(days, float)
    far = mean
    for _ in range(60):
        step = (far + h * np.cos(far) - k * np.sin(far) - mean) / (1.0 - h * np.sin(far) - k * np.cos(far))
        far = far - np.clip(step, -0.5, 0.5)
        if np.all(np.abs(step) < 1e-13):
            break
    root = np.sqrt(1.0 - h * h - k * k)
    beta = 1.0 / (1.0 + root)
    cosine, sine = np.cos(far), np.sin(far)
    along = (1.0 - beta * h * h) * cosine + beta * h * k * sine - k
    across = (1.0 - beta * k * k) * sine + beta * h * k * cosine - h
    scale = np.exp(log_axis) / (1.0 + p * p + q * q)
    north = scale * ((1.0 - p * p + q * q) * along + 2.0 * p * q * across)
    east = scale * ((1.0 + p * p - q * q) * across + 2.0 * p * q * along)
    return np.stack([east, north])


@dataclass
class Campaign:
    """Epochs of one planet, their errors, the date after them, and the elements at the middle of the arc."""

    planet: int
    distance_pc: float
    period_days: float
    elements: np.ndarray
    days: np.ndarray
    error_arcsec: np.ndarray
    later_day: float

    def at(self, elements, days):
        return offsets(elements, np.atleast_1d(days) - self.middle) / self.distance_pc

    @property
    def middle(self):
        return 0.5 * (self.days.min() + self.days.max())


def campaigns(star, number, arcs, epochs, seed, later_days=180.0):
    """Planets of a star that are in the hole at all epochs, and what population they are of."""
    distance, mass = STARS[star]
    population = draw_population(load_population("giants"), 40_000, seed)
    rng = np.random.default_rng(seed)
    found = []
    for j in range(len(population)):
        axis, e = population.semi_major_axis_au[j], population.eccentricity[j]
        period = 365.25 * np.sqrt(axis**3 / mass)
        arc = rng.uniform(*arcs) * period
        # The first and the last epoch are the ends of the arc.
        share = np.concatenate([[0.0], np.sort(rng.uniform(0.1, 0.9, epochs - 2)), [1.0]])
        days, error = arc * share, astrometric_error_arcsec(rng.uniform(6.0, 20.0, epochs), LAMBDA_D_ARCSEC)
        turned = population.inclination_deg[j] > 90.0
        tilt = np.deg2rad(180.0 - population.inclination_deg[j] if turned else population.inclination_deg[j])
        node = np.deg2rad(population.node_deg[j]) * (-1.0 if turned else 1.0)
        longitude = np.deg2rad(population.argument_of_pericentre_deg[j]) + node
        mean = longitude + np.deg2rad(population.mean_anomaly_deg[j]) + np.pi * arc / period
        tangent = np.tan(0.5 * tilt)
        shape = e * np.sin(longitude), e * np.cos(longitude), tangent * np.sin(node), tangent * np.cos(node)
        elements = np.array([np.log(axis), *shape, mean, np.log(mass)])
        one = Campaign(j, distance, period, elements, days, error, days[-1] + later_days)
        separation = np.hypot(*one.at(elements, days))
        if e < 0.9 and np.all((separation > HOLE_ARCSEC[0]) & (separation < HOLE_ARCSEC[1])):
            found.append(one)
        if len(found) == number:
            return population, found
    raise AssertionError(star)


def residuals_of(campaign, measured, log_mass, log_axis_mean):
    """Function of the elements: deviations from positions, mass, and what is known beforehand, over their errors."""
    known = np.array([log_axis_mean, 0.0, 0.0, 0.0, 0.0])

    def residuals(elements):
        missed = (campaign.at(elements, campaign.days) - measured) / campaign.error_arcsec
        return np.concatenate(
            [missed.ravel(), (elements[:5] - known) / WIDTHS, [(elements[6] - log_mass) / MASS_ERROR]]
        )

    return residuals


def has_second_period(campaign, rng, log_axis_mean, starts=24):
    """Whether another period, by 5 % or more, fits positions without noise to a chi2 of 4 above that of the truth."""
    truth = campaign.elements
    residuals = residuals_of(campaign, campaign.at(truth, campaign.days), truth[6], log_axis_mean)
    most = 0.5 * (residuals(truth) ** 2).sum() + 2.0
    for _ in range(starts):
        first = truth.copy()
        first[[0, 5]] += rng.uniform(-0.5, 0.5, 2)
        first[1:5] *= 0.7
        try:
            fit = least_squares(residuals, first, x_scale=[0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.06], max_nfev=60)
        except ValueError:
            continue
        off = fit.x - truth
        if fit.cost < most and abs(1.5 * off[0] - 0.5 * off[6]) > 0.05:
            return True
    return False


def fitted(campaign, rng, log_axis_mean, starts=3):
    """Elements of the best fit to noisy positions and a measured mass, from the truth and other starts."""
    clean = campaign.at(campaign.elements, campaign.days)
    measured = clean + campaign.error_arcsec * rng.standard_normal(clean.shape)
    log_mass = campaign.elements[6] + MASS_ERROR * rng.standard_normal()
    residuals = residuals_of(campaign, measured, log_mass, log_axis_mean)
    best = None
    for start in range(starts):
        first = campaign.elements + (start > 0) * rng.normal(0.0, [0.1, 0.05, 0.05, 0.1, 0.1, 0.1, 0.03])
        try:
            fit = least_squares(residuals, first, x_scale=[0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.06])
        except ValueError:
            continue
        if best is None or fit.cost < best.cost:
            best = fit
    return best.x
