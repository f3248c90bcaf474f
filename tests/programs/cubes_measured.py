"""Position and contrast of a planet in a reduced image, as a user of another program would measure them."""

import numpy as np
from scipy.signal import fftconvolve


class Field:
    """The reduced image: north up, the star in the middle; the dark hole is turned with the roll."""

    def __init__(self, middle, scale_arcsec, fwhm, roll_deg, shape=(137, 137)):
        self.middle, self.scale, self.fwhm, self.roll = middle, scale_arcsec, fwhm, np.deg2rad(roll_deg)
        self.rows, self.columns = np.mgrid[: shape[0], : shape[1]]

    def place(self, separation_arcsec, pa_deg):
        """Return column and row of a place on the sky."""
        angle, rho = np.deg2rad(pa_deg), separation_arcsec / self.scale
        return self.middle - rho * np.sin(angle), self.middle + rho * np.cos(angle)

    def is_dark(self, x, y, margin=0.0):
        """Return whether a place lies in the four quadrants of the dark hole, 0.25 to 0.70 arcsec either way."""
        across, up = (x - self.middle) * self.scale, (y - self.middle) * self.scale
        # On the detector position angles are less by the roll: clockwise.
        turned = (
            across * np.cos(self.roll) + up * np.sin(self.roll),
            up * np.cos(self.roll) - across * np.sin(self.roll),
        )
        sizes = np.abs(turned)
        return (sizes.min(axis=0) > 0.25 + margin) & (sizes.max(axis=0) < 0.70 - margin)

    def sum_at(self, image, x, y):
        """Return the sum in an aperture of one FWHM across, pixels by the share of them that is inside."""
        near = np.hypot(self.columns - x, self.rows - y)
        return float((image * np.clip(self.fwhm / 2.0 - near + 0.5, 0.0, 1.0)).sum())


def measured(field, image, reduced, injected, star_e_s, time_s, separation_arcsec, pa_deg):
    """Return how far from its place the planet is found, its contrast and the error of that."""
    x, y = field.place(separation_arcsec, pa_deg)
    half = int(field.fwhm)
    kernel = np.clip(field.fwhm / 2.0 - np.hypot(*np.mgrid[-half : half + 1, -half : half + 1]) + 0.5, 0.0, 1.0)
    smooth = np.where(field.is_dark(field.columns, field.rows), fftconvolve(image, kernel, mode="same"), -np.inf)
    row, column = np.unravel_index(smooth.argmax(), smooth.shape)
    near = np.hypot(field.columns - column, field.rows - row) < field.fwhm / 2.0
    light = np.where(near, np.maximum(image, 0.0), 0.0)
    found = (light * field.columns).sum() / light.sum(), (light * field.rows).sum() / light.sum()
    # What the reduction leaves of a planet: one of known flux on the other side of the star.
    flux = 3e-7 * star_e_s
    other = field.place(separation_arcsec, pa_deg + 180.0)
    left = field.sum_at(reduced(injected(flux, pa_deg + 180.0)) - image, *other) / flux
    beside = [field.place(separation_arcsec, pa_deg + turn) for turn in np.arange(0.0, 360.0, 5.0)]
    far = [one for one in beside if field.is_dark(*one, 0.04) and np.hypot(one[0] - x, one[1] - y) > 2.0 * field.fwhm]
    empty = [field.sum_at(image, *one) for one in far]
    seen = field.sum_at(image, x, y) - float(np.mean(empty))
    # of the background, and of the planet's photons behind the register, whose variance is twice their number
    variance = np.var(empty, ddof=1) + 2.0 * max(seen, 0.0) / time_s
    return {
        "off_pixel": float(np.hypot(found[0] - x, found[1] - y)),
        "contrast": seen / left / star_e_s,
        "error": float(np.sqrt(variance)) / left / star_e_s,
        "left": left,
    }
