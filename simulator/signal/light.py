"""Light in the photometric aperture: sky, dust, what smears in, and the region that measures the background.

One function for each term, of tables of the point-spread function and of numbers; whoever predicts or simulates an
aperture sums them.

Wings of sources off the axis.

Everything is in units of the light of the source on the clear disc.
"""

import math

import numpy as np

from cpic_core import ArrayLike, FloatArray, InputError, checked_array, checked_scalar
from simulator.config import DiscSource
from simulator.imaging import PsfMetrics, scattered_light

# Stark et al. 2014, ApJ 795, 122: one zodi is 22 mag/arcsec2 in V, face-on, at 1 au from a star of the Sun's light.
ZODI_V_MAG_ARCSEC2 = 22.0
SUN_ABSOLUTE_V_MAG = 4.83
# Light over the star's per arcsec2 at 1 arcsec: 10^(-0.4 (22 - 4.83)) (d / 10 pc)^2 / (r / au)^2, and r / au is the
# separation in arcsec times d / pc.
ZODI_AT_ONE_ARCSEC = 10.0 ** (-0.4 * (ZODI_V_MAG_ARCSEC2 - SUN_ABSOLUTE_V_MAG)) / 100.0
# Edges of the disc in images: inside lies what the mask blocks, and every hole ends before the outer edge.
INNER_ARCSEC, OUTER_ARCSEC = 0.05, 2.0


def sky_pixel_e_s(metrics: PsfMetrics, sky_e_s_arcsec2: ArrayLike) -> FloatArray:
    """Return the light of an even sky on an open pixel behind the apodizer, e-/s.

    Parameters
    ----------
    metrics : PsfMetrics
    sky_e_s_arcsec2 : array_like
        Detected light of the sky on the clear disc, e-/s/arcsec^2.
    """
    return np.asarray(sky_e_s_arcsec2, float) * metrics.pixel_scale_arcsec**2 * metrics.apodizer_energy


def annulus_apertures(metrics: PsfMetrics, half_width_lambda_d: float, separation_arcsec: ArrayLike) -> FloatArray:
    """Return the area of the annulus that measures the background, in apertures, at least 1.

    Parameters
    ----------
    metrics : PsfMetrics
    half_width_lambda_d : float
        Half width of the annulus, lambda/D.
    separation_arcsec : array_like
        Of its middle.

    Notes
    -----
    The part of the circle through the middle that lies inside the dark quadrants is taken for the whole ring: for a
    wide ring that is up to 25 % too much.
    """
    separation = np.asarray(separation_arcsec, float)
    width = 2.0 * half_width_lambda_d * metrics.lambda_d_arcsec
    length = 2.0 * np.pi * separation * metrics.azimuth_fraction(separation)
    return np.maximum(length * width / (np.pi * metrics.aperture_radius_arcsec**2), 1.0)


def lit_rows(metrics: PsfMetrics, rows: slice) -> float:
    """Return the number of active rows that the arm of the mask leaves open to the sky.

    Parameters
    ----------
    metrics : PsfMetrics
    rows : slice
        Active rows of the frame.
    """
    return float(rows.stop - rows.start - 2.0 * metrics.mask_half_width_arcsec / metrics.pixel_scale_arcsec)


def exozodi_fraction_arcsec2(separation_arcsec: ArrayLike, n_zodis: ArrayLike) -> FloatArray:
    """Return the brightness of the dust in front of the instrument, over the light of the star.

    Parameters
    ----------
    separation_arcsec : array_like
        Separation from the star, above 0, arcsec.
    n_zodis : array_like
        Dust in units of the solar system's, at least 0; broadcasts.

    Returns
    -------
    ndarray
        Light per arcsec^2 over that of the star, the same in every band: ``1.355e-9 n / separation^2``.

    Raises
    ------
    InputError
        If a separation is not above 0, a number of zodis negative, or one of them not finite.

    Notes
    -----
    One zodi is 22 mag/arcsec2 in V at 1 au from a solar twin (M_V 4.83; Stark et al. 2014, ApJ 795, 122), in proportion
    to the V light of the star and to ``r^-2``, grey. Both the dust's light and the star's fall with the square of the
    distance, and an arcsec spans more of the disc: in units of the star's light the brightness at a given separation is
    the same around every star.
    """
    separation = checked_array("separation_arcsec", separation_arcsec, low=0.0, unit="arcsec", allowed="above 0")
    if not (separation > 0).all():
        raise InputError("separation_arcsec", 0.0, unit="arcsec", allowed="above 0")
    zodis = checked_array("n_zodis", n_zodis, low=0.0, unit="zodis")
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
        fraction = ZODI_AT_ONE_ARCSEC * zodis / separation / separation
    if not np.isfinite(fraction).all():
        nearest, allowed = float(separation.min()), "separations at which the brightness is finite"
        raise InputError("separation_arcsec", nearest, unit="arcsec", allowed=allowed)
    return np.asarray(fraction)


def exozodi_disc(n_zodis: float) -> DiscSource | None:
    """Return the disc as a source of a scene, None where there is no dust.

    Parameters
    ----------
    n_zodis : float
        Dust in units of the solar system's, 0 to 1e5.

    Returns
    -------
    DiscSource or None
        Face-on, ``r^-2`` from 0.05 to 2 arcsec; its light is that of `exozodi_fraction_arcsec2` between these edges,
        ``2 pi ln(2 / 0.05)`` times the brightness at 1 arcsec (3.1e-8 of the star per zodi).

    Raises
    ------
    InputError
        If the number is out of range.
    """
    zodis = checked_scalar("n_zodis", n_zodis, low=0.0, high=1e5, unit="zodis")
    if zodis == 0.0:
        return None
    light = 2.0 * math.pi * math.log(OUTER_ARCSEC / INNER_ARCSEC) * ZODI_AT_ONE_ARCSEC * zodis
    return DiscSource(name="exozodi", contrast=light, inner_arcsec=INNER_ARCSEC, outer_arcsec=OUTER_ARCSEC, slope=-2.0)


def aperture_exozodi(
    metrics: PsfMetrics, n_zodis: ArrayLike, x_arcsec: ArrayLike, y_arcsec: ArrayLike, core: FloatArray | None = None
) -> FloatArray:
    """Return the detected light of the dust in an aperture, over the star's detected light on the clear disc.

    Parameters
    ----------
    metrics : PsfMetrics
    n_zodis : array_like
        Dust in units of the solar system's, at least 0; broadcasts with the positions.
    x_arcsec, y_arcsec : array_like
        Centres of apertures on the detector relative to the star; broadcast.
    core : ndarray, optional
        ``metrics.core_throughput`` there, where it is known.

    Returns
    -------
    ndarray
        At least 0: brightness times area of the aperture, times the energy that apodizer and diffraction leave within
        1.5 arcsec of a source (95 to 97.5 % of what the apodizer passes; the disc gives little back for the rest),
        times what the mask leaves of a source there. In the hole within 2.6 % of images of the disc. Nearer to the star
        than an aperture's radius, the brightness is that at the radius.

    Raises
    ------
    InputError
        If a position is not finite.
    """
    x = checked_array("x_arcsec", x_arcsec, low=-np.inf, unit="arcsec", allowed="finite")
    y = checked_array("y_arcsec", y_arcsec, low=-np.inf, unit="arcsec", allowed="finite")
    separation = np.hypot(x, y)
    if not np.any(n_zodis):
        return np.zeros(separation.shape)
    radius = metrics.aperture_radius_arcsec
    left = metrics.core_throughput(x, y) if core is None else core
    behind = metrics.dust_transmission(x, y, left)
    area = metrics.core_pixels(x, y) * metrics.pixel_scale_arcsec**2
    return exozodi_fraction_arcsec2(np.maximum(separation, radius), n_zodis) * area * behind


def wing(metrics: PsfMetrics, x: FloatArray | float, y: FloatArray | float) -> FloatArray:
    """Return the unmasked light per pixel at an offset from a source: its ring mean near the core, then the wing map.

    Parameters
    ----------
    metrics : PsfMetrics
    x, y : array_like
        Offsets from the source, arcsec; broadcast.
    """
    distance = np.hypot(x, y)
    return np.where(distance < 2.0 * metrics.wing_map_step_arcsec, metrics.wing(distance), metrics.wing_at(x, y))


def spot(metrics: PsfMetrics, offset: FloatArray, x: float, y: float) -> FloatArray:
    """Return the light per pixel of a unit source on a stamp without a mask, shape (n, n).

    Parameters
    ----------
    metrics : PsfMetrics
    offset : ndarray, shape (n,)
        Of the pixels of the stamp along an axis, arcsec.
    x, y : float
        Place of the source, arcsec.
    """
    return wing(metrics, (offset - x)[None, :], (offset - y)[:, None])


def drift_halo(
    metrics: PsfMetrics, separation_arcsec: FloatArray, rms_nm: float, slope: float, wavelength_nm: float
) -> FloatArray:
    """Return the mean light that a wavefront error scatters: `scattered_light` at separations in arcsec.

    Parameters
    ----------
    metrics : PsfMetrics
    separation_arcsec : ndarray
        From the source.
    rms_nm, slope, wavelength_nm : float
        As of `simulator.imaging.table_metrics.scattered_light`.
    """
    return scattered_light(separation_arcsec / metrics.lambda_d_arcsec, rms_nm, slope, wavelength_nm)
