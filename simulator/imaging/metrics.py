"""Figures of one band's PSF that the exposure-time calculator reads: plain arrays, no optics library."""

import functools
from collections.abc import Mapping
from dataclasses import MISSING, fields, replace
from typing import Any, Self

import numpy as np

from cpic_core import ArrayLike, FloatArray, InputError, NDArray, Record, overlap_weights
from simulator.detectors import aperture_noise_pixels
from simulator.imaging.aperture import core_from_table
from simulator.imaging.sampling import bilinear
from simulator.imaging.zones import BandGeometry, HoleSide, HoleStatus, Zone, ZoneMode, zone_from


class StampMetrics(Record, eq=False, kw_only=True):
    """Figures of merit of one band that follow from two stamps: the star behind the mask, and an unmasked source.

    Every fraction is of the energy that the clear pupil disc collects. Positions are arcsec from the star on the
    detector; maps are indexed ``[y, x]`` on the star-centred stamp, centre pixel ``n // 2``.

    Attributes
    ----------
    band : str
        Name of the band.
    lambda_d_arcsec : float
        lambda/D at band centre.
    pixel_scale_arcsec, aperture_radius_arcsec, mask_half_width_arcsec : float
        Detector pixel, photometric aperture, half width of the cross.
    hole_inner_arcsec, hole_outer_arcsec : float
        Edges a and b of the square quadrants, per axis; radii of a ring.
    hole_mode : {"4q", "2q", "ring"}
        All four quadrants, the two on ``hole_side``, or a ring.
    hole_side : {"right", "left", "top", "bottom"}
        Side of the star on the detector for ``2q``.
    strehl : float or None
        Peak relative to the same apodizer with a flat wavefront and no jitter; None where only stamps are known.
    apodizer_energy : float
        Energy behind the apodizer.
    core_open : float
        Core throughput far from the mask, in an aperture laid on pixels (phase average).
    peak_off_axis : float
        Peak pixel of a source centred on a pixel, no mask.
    iwa_arcsec : float
        Diagonal separation where core throughput is half its maximum.
    raw_contrast : ndarray, shape (n, n)
        Masked on-axis image over ``peak_off_axis``.
    halo_map : ndarray, shape (n, n)
        Starlight in the aperture centred on every pixel.
    column_light : ndarray, shape (n,)
        Masked star in every column of the stamp, summed over the rows: of the stamp where no more is known, else of
        the frame (those within 8.75 arcsec), what a frame transfer without a shutter smears along the column.
    core_table : ndarray, shape (k, k)
        Cumulative aperture-weighted PSF, over offsets up to ``core_table_half_arcsec``.
    core_table_half_arcsec : float
        Half side of that table.
    """

    band: str
    lambda_d_arcsec: float
    pixel_scale_arcsec: float
    aperture_radius_arcsec: float
    mask_half_width_arcsec: float
    hole_inner_arcsec: float
    hole_outer_arcsec: float
    hole_mode: ZoneMode
    hole_side: HoleSide
    strehl: float | None
    apodizer_energy: float
    core_open: float
    peak_off_axis: float
    iwa_arcsec: float
    raw_contrast: FloatArray
    halo_map: FloatArray
    column_light: FloatArray
    core_table: FloatArray
    core_table_half_arcsec: float

    @functools.cached_property
    def geometry(self) -> BandGeometry:
        """What holds at any numerical settings."""
        return BandGeometry.like(self, len(self.raw_contrast))

    @property
    def hole(self) -> NDArray[np.bool_]:
        """Pixels whose centres lie in the zone."""
        return self.geometry.hole

    @functools.cached_property
    def zone(self) -> Zone:
        """The controlled zone."""
        return zone_from(self.hole_inner_arcsec, self.hole_outer_arcsec, self.hole_mode, self.hole_side)

    @property
    def hole_inner_corner_arcsec(self) -> float:
        """Diagonal separation of the inner corner of the hole."""
        return self.zone.inner_corner_arcsec

    @property
    def owa_arcsec(self) -> float:
        """Diagonal separation of the outer corner of the hole."""
        return self.zone.outer_corner_arcsec

    @property
    def aperture_pixels(self) -> float:
        """Area of the photometric aperture in pixels."""
        return self.geometry.aperture_pixels

    def core_throughput(self, x_arcsec: ArrayLike, y_arcsec: ArrayLike) -> FloatArray:
        """Return the energy of a unit source at (x, y) in its aperture behind the mask.

        Parameters
        ----------
        x_arcsec, y_arcsec : array_like
            Offset from the star on the detector, arcsec; they broadcast.

        Returns
        -------
        ndarray
            0 to 1.
        """
        half, bar = self.core_table_half_arcsec, self.mask_half_width_arcsec
        return core_from_table(self.core_table, half, bar, x_arcsec, y_arcsec)


TINY = 1e-300  # for logarithms of what may be 0
# Light that diffraction sends farther than this is lost: a disc of dust is fainter there and gives less back.
NEARBY_ARCSEC = 1.5


class PsfMetrics(StampMetrics, eq=False, kw_only=True):
    """Figures of merit of one band whose optics are known.

    Attributes
    ----------
    hole_state : {"reached", "not_reached", "none", "table"}
        Whether the hole is as dark as asked; none where no search sets the mirror, table where there are no optics.
    core_continuous : float
        ``core_open`` for an ideal circle on the continuous image; pixels cost the difference.
    peak_on_axis_hole : float
        Brightest pixel of the masked star that overlaps the hole.
    peak_on_axis_frame : float
        Brightest pixel of the masked star anywhere on the frame.
    peak_on_axis_columns : float
        Brightest pixel of the masked star in the columns that cross the hole: the one that blooms into it first.
    register_tail : float
        Largest mean over any run of pixels that ends at the hole, along its rows, from either side: a register that
        holds this many electrons a pixel has no charge left over that trails into the hole.
    column_profile : ndarray, shape (2 w - 1,)
        Unmasked PSF summed over all rows, at offsets of ... -1, 0, 1 ... columns from the source.
    source_noise_fraction : float
        ``sum(w^2 mu) / sum(w mu)`` of a source in its aperture: cut pixels weigh less in the variance of a sum.
    wing_profile : ndarray, shape (w,)
        Azimuthal mean of the unmasked PSF per pixel at separations of 0, 1, 2 ... pixels.
    wing_map : ndarray, shape (q, q), q odd
        Unmasked PSF per pixel at offsets ``y, x`` of ... -1, 0, 1 ... steps, each the mean over a box one step wide;
        the source stands in the middle.
    wing_map_step_arcsec : float
        Step of that map.
    aperture_map : ndarray, shape (q, q), q odd
        Light of an unmasked source in whole apertures at offsets ``y, x`` of ... -1, 0, 1 ... steps from it, as far as
        8 arcsec along an axis.
    aperture_map_step_arcsec : float
        Step of that map, about 0.6 lambda/D.
    floor_separation_arcsec : ndarray, shape (s,)
        Mean separations of the annular bins.
    floor_linear, floor_square : ndarray, shape (1 + s,)
        Variance of aperture sums between two visits that are each v nm off, ``linear v^2 + square v^4``: of the cross
        term with the static field and of the light of the errors; whole hole, then each bin.
    filter_gain : ndarray, shape (s,)
        Signal-to-noise ratio of a source through a matched filter over that in its aperture, in white noise, in each
        bin: the edge of the hole cuts the filter.
    filter_linear : ndarray, shape (s, 5)
        Variance of the cross term through the filter over the mean one in apertures of the bin, each over that of the
        same white noise: mean of each fifth of the places, the calmest first.
    filter_square : float
        The same of the light of the errors.
    filter_tails : float
        Excess kurtosis of the light of the errors through the filter over that of a Laplace variate.
    filter_positions, filter_roughness : float
        Positions of filtered white noise that are worth one, and the variance of its gradient along an axis over its
        variance, per square pixel.
    pupil_steps : int
        Steps across the pupil of which its field is made; 0 where nobody knows.
    """

    hole_state: HoleStatus
    core_continuous: float
    peak_on_axis_hole: float
    peak_on_axis_frame: float
    peak_on_axis_columns: float
    register_tail: float
    column_profile: FloatArray
    source_noise_fraction: float
    wing_profile: FloatArray
    wing_map: FloatArray
    wing_map_step_arcsec: float
    aperture_map: FloatArray
    aperture_map_step_arcsec: float
    floor_separation_arcsec: FloatArray
    floor_linear: FloatArray
    floor_square: FloatArray
    filter_gain: FloatArray
    filter_linear: FloatArray
    filter_square: float
    filter_tails: float
    filter_positions: float
    filter_roughness: float
    pupil_steps: int = 0

    @property
    def field_radius_arcsec(self) -> float:
        """Separation out to which the PSF was computed."""
        return (len(self.wing_profile) - 1) * self.pixel_scale_arcsec

    def core_throughput(self, x_arcsec: ArrayLike, y_arcsec: ArrayLike) -> FloatArray:
        """Return the energy of a unit source at (x, y) in its aperture behind the mask.

        Outside the hole it is still the truth (0 behind the cross, the open value elsewhere); beyond
        `field_radius_arcsec` it is 0.

        Parameters
        ----------
        x_arcsec : array_like
            Offset from the star on the detector along x, arcsec.
        y_arcsec : array_like
            Offset from the star on the detector along y, arcsec.
        """
        x, y = np.broadcast_arrays(np.asarray(x_arcsec, dtype=np.float64), np.asarray(y_arcsec, dtype=np.float64))
        return np.where(np.hypot(x, y) <= self.field_radius_arcsec, super().core_throughput(x, y), 0.0)

    def halo_aperture(self, x_arcsec: ArrayLike, y_arcsec: ArrayLike) -> FloatArray:
        """Return the starlight in an aperture at (x, y), bilinear in the logarithm; beyond the stamp that of the wings.

        Parameters
        ----------
        x_arcsec : array_like
            Offset from the star on the detector along x, arcsec.
        y_arcsec : array_like
            Offset from the star on the detector along y, arcsec.
        """
        x, y = np.broadcast_arrays(np.asarray(x_arcsec, dtype=np.float64), np.asarray(y_arcsec, dtype=np.float64))
        n = len(self.halo_map)
        column, row = (part / self.pixel_scale_arcsec + n // 2 for part in (x, y))
        margin = self.aperture_radius_arcsec / self.pixel_scale_arcsec + 1
        inside = (np.minimum(row, column) >= margin) & (np.maximum(row, column) <= n - 1 - margin)
        row, column = np.where(inside, row, 0.0), np.where(inside, column, 0.0)
        near = np.exp(bilinear(self._log_halo, row, column))
        return np.where(inside, near, self.wing(np.hypot(x, y)) * self.aperture_pixels)

    @functools.cached_property
    def noise_fraction(self) -> float:
        """Sum of squared weights of the aperture's pixels over its area: cut pixels weigh less in a variance."""
        return (
            float(aperture_noise_pixels(self.aperture_radius_arcsec / self.pixel_scale_arcsec)) / self.aperture_pixels
        )

    def core_pixels(self, x_arcsec: FloatArray, y_arcsec: FloatArray) -> FloatArray | float:
        """Return the area in pixels of the aperture that a source at (x, y) is measured in: everywhere the same."""
        return self.aperture_pixels

    def sky_share(self, x_arcsec: FloatArray, y_arcsec: FloatArray) -> FloatArray | float:
        """Return the light of an even sky on a pixel at (x, y), over that of `apodizer_energy`."""
        return 1.0

    def dust_transmission(self, x_arcsec: FloatArray, y_arcsec: FloatArray, core: FloatArray) -> FloatArray:
        """Return the part of the light of dust around the star that reaches an aperture at (x, y).

        What apodizer and diffraction leave within 1.5 arcsec of a source, times what the mask leaves of one there.

        Parameters
        ----------
        x_arcsec, y_arcsec : ndarray
            Offset from the star on the detector, arcsec.
        core : ndarray
            `core_throughput` there.
        """
        return self._energy_nearby * core / self.core_open

    @functools.cached_property
    def _energy_nearby(self) -> float:
        pixel = np.arange(len(self.wing_profile))
        far = pixel * self.pixel_scale_arcsec > NEARBY_ARCSEC
        return self.apodizer_energy - 2.0 * np.pi * float(pixel[far] @ self.wing_profile[far])

    def measured(self) -> Self:
        """Return the figures of apertures as they are summed in images: these."""
        return self

    def stability(self, separation_arcsec: FloatArray) -> tuple[FloatArray, bool] | None:
        """Return the variance of aperture sums that subtraction leaves whatever the drift, and if all visits share it.

        Known of tables alone.
        """
        return None

    @functools.cached_property
    def _log_halo(self) -> FloatArray:
        return np.log(np.maximum(self.halo_map, TINY))

    @functools.cached_property
    def _columns_under_aperture(self) -> tuple[FloatArray, FloatArray]:
        weights = overlap_weights(self.aperture_radius_arcsec / self.pixel_scale_arcsec).sum(axis=0)
        star, source = (np.convolve(light, weights, mode="same") for light in (self.column_light, self.column_profile))
        return star, source

    def column_aperture(self, x_arcsec: ArrayLike) -> FloatArray:
        """Return the starlight of whole columns under an aperture at x: its column's in each pixel, summed over them.

        Beyond the stamp it is that of the stamp's edge.
        """
        return self._column(self._columns_under_aperture[0], x_arcsec)

    def source_column_aperture(self, x_arcsec: ArrayLike) -> FloatArray:
        """Return the same of an unmasked source on the frame, the aperture at an offset x from it.

        All rows count, also those behind the cross or beyond the frame: 1 to 5 % of the light of a column.
        """
        return self._column(self._columns_under_aperture[1], x_arcsec)

    def _column(self, light: FloatArray, x_arcsec: ArrayLike) -> FloatArray:
        pixels = np.asarray(x_arcsec, dtype=np.float64) / self.pixel_scale_arcsec
        return np.asarray(np.interp(pixels, np.arange(len(light)) - len(light) // 2, light))

    def wing(self, separation_arcsec: ArrayLike) -> FloatArray:
        """Return the unmasked PSF's azimuthal mean per pixel; beyond `field_radius_arcsec` it falls as separation^-3.

        The true wings are brighter than the mean along the arms of the cross and fainter between them.
        """
        pixels = np.asarray(separation_arcsec, dtype=np.float64) / self.pixel_scale_arcsec
        radius = np.arange(len(self.wing_profile))
        outside = float((self.wing_profile[-60:] * radius[-60:] ** 3.0).mean())
        beyond = outside / np.maximum(pixels, radius[-1]) ** 3
        return np.where(pixels <= radius[-1], np.interp(pixels, radius, self.wing_profile), beyond)

    def wing_at(self, x_arcsec: ArrayLike, y_arcsec: ArrayLike) -> FloatArray:
        """Return the light per pixel that a source leaves at an offset (x, y), smoothed over a step of the map.

        The wings of a stepped apodizer gather along its axes: on a diagonal they lie a hundred times below the
        azimuthal mean. The field of a pupil of ``n`` steps repeats every ``n`` lambda/D along an axis, times
        ``sinc(u / n)`` with u in lambda/D: beyond the map its light is that of the map's last such part, over the
        square of the offsets. It is good to 10 % in the mean over a hole, and to a factor of 1.5 where the width of the
        band smears it. Where the steps are not known, the pattern of the edge goes on and fades as the inverse square;
        the offset across an arm stays as it is.
        """
        x, y = np.broadcast_arrays(np.asarray(x_arcsec, float), np.asarray(y_arcsec, float))
        last, step = len(self.wing_map) - 1, self.wing_map_step_arcsec
        edge, dimmer = (last // 2 - 0.5) * step, np.ones(x.shape)
        if self.pupil_steps:
            (x, own), (y, other) = (self._repeated(part, edge) for part in (x, y))
            dimmer = own * other
        # The last boxes lie beside an axis where the source does.
        far = np.maximum(np.maximum(np.abs(x), np.abs(y)) / edge, 1.0)
        along = np.abs(x) > np.abs(y)
        x, y = np.where(along, x / far, x), np.where(along, y, y / far)
        column, row = (np.clip(part, -edge, edge) / step + last // 2 for part in (x, y))
        result: FloatArray = np.exp(bilinear(np.log(self.wing_map), row, column)) * dimmer / far**2
        return result

    def _repeated(self, offset: FloatArray, edge_arcsec: float) -> tuple[FloatArray, FloatArray]:
        """Return offsets along an axis within the edge whose light repeats at given ones, and how much dimmer it is."""
        period = self.pupil_steps * self.lambda_d_arcsec
        beyond = np.maximum(np.abs(offset) - edge_arcsec, 0.0)
        within = offset - np.sign(offset) * np.ceil(beyond / period) * period
        return within, np.where(beyond > 0.0, (within / np.where(beyond > 0.0, offset, 1.0)) ** 2, 1.0)

    @property
    def aperture_map_half_arcsec(self) -> float:
        """Largest offset along an axis of the map of apertures."""
        return len(self.aperture_map) // 2 * self.aperture_map_step_arcsec

    def source_aperture(self, x_arcsec: ArrayLike, y_arcsec: ArrayLike) -> FloatArray:
        """Return the light of an unmasked source in apertures at offsets (x, y); beyond the map that of smooth wings.

        Parameters
        ----------
        x_arcsec, y_arcsec : array_like
            Offset from the source, arcsec; they broadcast. Linear between the map's apertures, which overlap.
        """
        x, y = np.broadcast_arrays(np.asarray(x_arcsec, float), np.asarray(y_arcsec, float))
        half, step = len(self.aperture_map) // 2, self.aperture_map_step_arcsec
        far = np.maximum(np.abs(x), np.abs(y)) > self.aperture_map_half_arcsec
        column, row = (np.where(far, 0.0, part / step + half) for part in (x, y))
        light = bilinear(self.aperture_map, row, column)
        if far.any():
            light[far] = self.wing_at(x[far], y[far]) * self.aperture_pixels
        return light

    def azimuth_fraction(self, separation_arcsec: ArrayLike) -> FloatArray:
        """Return the fraction of the circle of that radius that lies inside the zone."""
        return self.zone.azimuth_fraction(separation_arcsec)

    def resolution_elements(self, separation_arcsec: ArrayLike) -> FloatArray:
        """Return the non-overlapping lambda/D-wide apertures on the arcs inside the zone, a real number (>= 0)."""
        return self.geometry.resolution_elements(separation_arcsec)

    def rdi_floor(
        self,
        visit_nm: ArrayLike,
        *,
        walk_nm_per_sqrt_hour: ArrayLike = 0.0,
        visit_hours: ArrayLike = 0.0,
        separation_arcsec: ArrayLike | None = None,
    ) -> FloatArray:
        """Return the speckle floor of reference differential imaging: spatial rms of aperture sums, per unit star.

        Modes that are projected out after the reference mean are not credited: they hold what the reference visit's own
        walk and noise put there.

        Parameters
        ----------
        visit_nm : array_like
            Rms wavefront offset of each visit, >= 0.
        walk_nm_per_sqrt_hour, visit_hours : array_like
            Random walk and length of the two visits (each); the time average of the walk adds ``walk^2 hours / 3``
            to the variance of the offset.
        separation_arcsec : array_like, optional
            Local value at that separation, in logarithms between the bins and clamped to them; the whole hole if
            omitted.

        Raises
        ------
        InputError
            If an rms is negative.
        """
        given = (visit_nm, walk_nm_per_sqrt_hour, visit_hours)
        visit, walk, hours = (np.asarray(part, dtype=np.float64) for part in given)
        if not (np.all(visit >= 0) and np.all(walk >= 0) and np.all(hours >= 0)):
            raise InputError("visit_nm", visit_nm, unit="nm", allowed="0 or more, as the walk and the hours")
        variance = visit**2 + walk**2 * hours / 3.0
        if separation_arcsec is None:
            linear, square = self.floor_linear[0], self.floor_square[0]
        else:
            bins, place = self.floor_separation_arcsec, np.asarray(separation_arcsec, dtype=np.float64)
            linear, square = (np.exp(np.interp(place, bins, logs)) for logs in self.floor_logs())
        return np.asarray(np.sqrt(linear * variance + square * variance**2))

    def floor_logs(self) -> tuple[FloatArray, FloatArray]:
        """Return the logarithms of the floor's coefficients in the bins; a 0 (a perfect hole) stays next to it."""
        linear, square = (np.log(np.maximum(part[1:], TINY)) for part in (self.floor_linear, self.floor_square))
        return linear, square

    @property
    def median_contrast(self) -> float:
        """Median raw contrast of the pixels of the zone."""
        return float(np.median(self.raw_contrast[self.hole]))

    def brightened(self, factor: float) -> Self:
        """Return the figures of a zone with more or less of the same light of the star, ``factor`` times as much.

        The static intensity ``|E0|^2`` in the zone is multiplied. The residual of two visits with independent errors dE
        of the wavefront has the variance ``f a o^2 + b o^4`` for offsets of ``o`` nm: the cross term ``2 Re(E0* dE)``
        grows with ``|E0|^2``, the light of the errors does not change. Peaks in the columns and tails of the register,
        which lie mostly outside the zone, are kept; so are all throughputs.
        """
        inside = self.hole
        maps = {name: getattr(self, name) for name in ("halo_map", "raw_contrast")}
        scaled: dict[str, Any] = {name: np.where(inside, factor * values, values) for name, values in maps.items()}
        scaled["floor_linear"] = factor * self.floor_linear
        return replace(self, **scaled, peak_on_axis_hole=factor * self.peak_on_axis_hole)

    def annulus(self, separation_arcsec: float, half_width_lambda_d: float) -> NDArray[np.bool_]:
        """Return the pixels of the hole whose separation is within ``half_width_lambda_d`` of the given one."""
        return self.geometry.annulus(separation_arcsec, half_width_lambda_d)

    def to_arrays(self) -> dict[str, NDArray[Any]]:
        """Return every field as an array, for an npz file or a cache."""
        return {field.name: np.asarray(getattr(self, field.name)) for field in fields(self)}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, NDArray[Any]]) -> "PsfMetrics":
        """Return the inverse of `to_arrays`; extra arrays are ignored.

        Raises
        ------
        InputError
            If an array is missing.
        """
        values: dict[str, Any] = {}
        for field in fields(cls):
            if field.name not in arrays and field.default is not MISSING:
                continue
            if field.name not in arrays:
                raise InputError("metrics", field.name, allowed="arrays of every field")
            array = np.asarray(arrays[field.name])
            if array.ndim:
                values[field.name] = array.astype(np.float64)
                values[field.name].flags.writeable = False
            else:
                values[field.name] = array.item()
        return cls(**values)
