"""Figures of one band's PSF that follow from two stamps."""

import functools
from dataclasses import dataclass

import numpy as np

from cpic_core import ArrayLike, FloatArray, NDArray
from simulator.imaging.aperture import core_from_table
from simulator.imaging.geometry import BandGeometry
from simulator.imaging.zones import HoleSide, Zone, ZoneMode, zone_from


@dataclass(frozen=True, eq=False, kw_only=True)
class StampMetrics:
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
        return BandGeometry(
            lambda_d_arcsec=self.lambda_d_arcsec,
            pixel_scale_arcsec=self.pixel_scale_arcsec,
            aperture_radius_arcsec=self.aperture_radius_arcsec,
            mask_half_width_arcsec=self.mask_half_width_arcsec,
            zone=self.zone,
            stamp_pixels=len(self.raw_contrast),
        )

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
