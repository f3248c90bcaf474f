"""Light in the photometric aperture: sky, dust, companions, what smears in, and the region of the background.

One function for each term, of tables of the point-spread function and of numbers; whoever predicts or simulates an
aperture sums them. Light is in units of that of its source on the clear disc.

A companion lights the hole unevenly: its wings are bright along the arms of its own diffraction pattern. Who measures a
planet takes the scatter of apertures around the star, at the planet's separation, for its noise
(`cpic_planner.validation.photometry`). The light that makes this scatter is the mean over these apertures, not that at
the planet; what is left of it after a subtraction is their scatter.
"""

import functools
import math
from collections.abc import Sequence

import numpy as np

from cpic_core import ArrayLike, FloatArray, InputError, Keyed, Record, checked_array, checked_scalar
from simulator.config import DiscSource
from simulator.imaging import (
    APART_RADII,
    STEP_PIXELS,
    PsfMetrics,
    by_geometry,
    mean_over,
    noise_apertures,
    quadrant_of,
    scattered_light,
)

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


Place = tuple[FloatArray, FloatArray]
"""Offsets x and y of ``k`` companions from the star on the detector, arcsec, shape ``(k, a)``: one place each, or ``a``
of them that are equally likely."""

# Rms of aperture sums of the wings about their smooth course, over the latter, where no map resolves them: typical of
# the visible bands, and good to a factor of two at most single places (tests of this module, against images).
_STRUCTURE = 0.4
# Brightest pixel over the mean of an aperture on it: that of fringes, which wings are within an aperture. Images of
# companions that fill the register have 1.1 to 1.8.
_FRINGES = 2.0
# Pixels between apertures for many places of a companion that are averaged.
_ROUGH_STEP_PIXELS = 6.0
# Companions whose tables are kept, of one band and annulus: 2 kB each.
_MOST_KEPT = 10_000


class CompanionLight(Record):
    """Light of unit companions around planets; arrays ``(k, ...)`` in the shape of the planets' places.

    Attributes
    ----------
    aperture : ndarray
        Mean over the apertures of the annulus.
    column : ndarray
        The same of whole columns under the apertures, for each of their pixels: what smears into them.
    left : ndarray
        Spatial variance of aperture sums of what the references leave, in units of the square of the companion's light.
        It does not average, like that of speckles.
    """

    aperture: FloatArray
    column: FloatArray
    left: FloatArray


class CompanionTables(Record):
    """Light of ``k`` unit companions for planets on the diagonals of the quadrants.

    Attributes
    ----------
    separation_arcsec : ndarray, shape (s,)
        Of the planets.
    tables : ndarray, shape (k, 3, 4, s)
        Fields of `CompanionLight`, by the quadrant of the planet (`quadrant_of`).
    brightest : ndarray, shape (k,)
        Light on the brightest pixel of the hole, at most.
    quadrants : ndarray, shape (k, 4)
        Mean light in the apertures of each quadrant; inf in one that is not controlled, which is full of starlight.
    """

    separation_arcsec: FloatArray
    tables: FloatArray
    brightest: FloatArray
    quadrants: FloatArray

    def around(self, x_arcsec: ArrayLike, y_arcsec: ArrayLike) -> CompanionLight:
        """Return the light around planets anywhere in their quadrants.

        Parameters
        ----------
        x_arcsec, y_arcsec : array_like
            Places relative to the star, ``(k or 1, ...)``.
        """
        x, y = np.asarray(x_arcsec, float), np.asarray(y_arcsec, float)
        k, separation = len(self.tables), np.hypot(x, y)
        shape = np.broadcast_shapes((k, *(1,) * (separation.ndim - 1)), separation.shape)
        at = np.interp(separation, self.separation_arcsec, np.arange(self.separation_arcsec.size))
        low = np.minimum(at.astype(np.intp), self.separation_arcsec.size - 2)
        companion, part = np.arange(k).reshape((-1,) + (1,) * (len(shape) - 1)), at - low
        quadrant = quadrant_of(x, y)
        fields = (
            self.tables[companion, number, quadrant, low] * (1.0 - part)
            + self.tables[companion, number, quadrant, low + 1] * part
            for number in range(3)
        )
        return CompanionLight(*(np.broadcast_to(field, shape) for field in fields))


def companion_tables(
    metrics: PsfMetrics,
    place: Place,
    difference: Sequence[Place],
    annulus_lambda_d: float,
    *,
    rows: tuple[float, float],
) -> CompanionTables:
    """Return the light of companions in the apertures that measure the noise of planets.

    Parameters
    ----------
    metrics : PsfMetrics
    place : Place
        Where the companions stand in the science frames.
    difference : sequence of Place
        Where the difference of science frames and references shows them, the references' place second. None where the
        references show them at the same place: nothing is left.
    annulus_lambda_d : float
        Half width of the annulus, lambda/D.
    rows : tuple of float
        First active row of the detector and the one after the last, relative to that of the star.

    Notes
    -----
    Apertures lie whole in the zone and in the annulus, beside the planet and the companion (1.5 radii around each are
    no background). Companions that come again are not computed again.

    Two rolls show the companion at two places, a reference star has none; the library of the same star shows it where
    the science frames do. With ``W`` the light in an aperture and the references' ``R``, what is left is
    ``var(W - R)``; beyond the map that resolves the wings ``0.4^2 mean(W^2 + R^2)`` is added for their structure.
    """
    kept = _kept(by_geometry(metrics), annulus_lambda_d, place[0].shape[1], len(difference), rows)
    every = np.stack([part for one in (place, *difference) for part in one], axis=1, dtype=np.float64)
    keys = [companion.tobytes() for companion in every]
    new = [number for number, key in enumerate(keys) if key not in kept]
    if new:
        if len(kept) > _MOST_KEPT:
            kept.clear()
            new = list(range(len(keys)))
        parts = every[new]
        places = [(parts[:, 2 * number], parts[:, 2 * number + 1]) for number in range(1 + len(difference))]
        found = _tables(metrics, annulus_lambda_d, places, rows)
        kept.update({keys[number]: row for number, row in zip(new, zip(*found, strict=True), strict=True)})
    tables, brightest, quadrants = (np.array(part) for part in zip(*(kept[key] for key in keys), strict=True))
    step = STEP_PIXELS if place[0].shape[1] == 1 else _ROUGH_STEP_PIXELS
    separation_arcsec = noise_apertures(by_geometry(metrics), annulus_lambda_d, step).separation_arcsec
    return CompanionTables(separation_arcsec, tables, brightest, quadrants)


Row = tuple[FloatArray, FloatArray, FloatArray]


@functools.lru_cache(maxsize=64)
def _kept(
    figures: Keyed[PsfMetrics], annulus_lambda_d: float, n_places: int, n_difference: int, rows: tuple[float, float]
) -> dict[bytes, Row]:
    """Return the tables, brightest pixel and quadrants of single companions, by their places."""
    return {}


def _tables(metrics: PsfMetrics, annulus_lambda_d: float, places: Sequence[Place], rows: tuple[float, float]) -> Row:
    """Return the same of ``k`` companions at once, which stand at the first of the places."""
    place, *difference = places
    step = STEP_PIXELS if place[0].shape[1] == 1 else _ROUGH_STEP_PIXELS
    x, y, separations, share = noise_apertures(by_geometry(metrics), annulus_lambda_d, step)
    light, apart = _apart(metrics, x, y, place)
    column_x, index = np.unique(x, return_inverse=True)
    columns = metrics.source_column_aperture(column_x - place[0][..., None])[..., index]
    row = place[1] / metrics.pixel_scale_arcsec
    seen = (row >= rows[0]) & (row < rows[1]) & (np.abs(place[1]) >= metrics.mask_half_width_arcsec)
    # Of a companion beyond the active rows, or behind the mask, the columns hold its wings alone.
    columns = np.where(seen[..., None], columns, (rows[1] - rows[0]) * light)
    tables = np.zeros((len(light), 3, 4, separations.size))
    whole = np.maximum(mean_over(apart.sum(axis=1), share), 1e-9)
    for field, part in enumerate((light, columns)):
        tables[:, field] = mean_over((part * apart).sum(axis=1), share) / whole
    if difference:
        tables[:, 2] = _left(metrics, x, y, difference, share)
    quadrants, number = np.full((len(light), 4), np.inf), quadrant_of(x, y)
    for dark in np.unique(number):
        quadrants[:, dark] = light[..., number == dark].mean(axis=(1, 2))
    pixel = metrics.pixel_scale_arcsec
    over_edges, _ = _apart(metrics, *metrics.zone.cells(step * pixel, 0.0, pixel)[:2], place)
    brightest = over_edges.max(axis=2).mean(axis=1) * (_FRINGES / metrics.aperture_pixels)
    return tables, brightest, quadrants


def _apart(metrics: PsfMetrics, x: FloatArray, y: FloatArray, place: Place) -> tuple[FloatArray, FloatArray]:
    """Return companions' light in apertures, ``(k, a, p)``, 0 on the companion itself, and which are beside it."""
    dx, dy = x - place[0][..., None], y - place[1][..., None]
    apart = np.hypot(dx, dy) > APART_RADII * metrics.aperture_radius_arcsec
    return metrics.source_aperture(dx, dy) * apart, apart.astype(float)


def _left(metrics: PsfMetrics, x: FloatArray, y: FloatArray, places: Sequence[Place], share: FloatArray) -> FloatArray:
    """Return a difference's variance over annuli, ``(k, 4, s)``: the mean over the companions' places."""
    found, square, beside = np.zeros((3, *places[0][0].shape, x.size))
    beside += 1.0
    for sign, place in zip((1.0, -1.0), places, strict=False):
        light, apart = _apart(metrics, x, y, place)
        far = np.maximum(abs(x - place[0][..., None]), abs(y - place[1][..., None])) > metrics.aperture_map_half_arcsec
        found += sign * light
        square += far * light**2
        beside *= apart
    whole, course, scatter, structure = (
        mean_over(part.reshape(-1, x.size), share)
        for part in (beside, found * beside, found**2 * beside, square * beside)
    )
    whole = np.maximum(whole, 1e-9)
    variance = np.maximum(scatter / whole - (course / whole) ** 2, 0.0) + _STRUCTURE**2 * structure / whole
    return np.asarray(variance.reshape(*places[0][0].shape, *variance.shape[1:]).mean(axis=1))
