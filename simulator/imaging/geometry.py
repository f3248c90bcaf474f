"""The dark zone, the mask and the apertures of a band on a star-centred stamp, which need no optics."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from cpic_core import ArrayLike, FloatArray, IntArray, NDArray
from simulator.config import Instrument
from simulator.imaging.sampling import centred_offsets
from simulator.imaging.zones import Zone, zone_from


def zone_of(instrument: Instrument, band: str) -> Zone:
    """Return the controlled zone of a band.

    Parameters
    ----------
    instrument : Instrument
    band : str
        Name of a band of the instrument, such as ``F520``.
    """
    hole = instrument.dark_hole
    edges = instrument.hole_inner_arcsec(band), instrument.hole_outer_arcsec(band)
    return zone_from(*edges, "ring" if instrument.coronagraph.is_ring else hole.mode, hole.side)


@dataclass(frozen=True)
class BandGeometry:
    """Geometry of one band on a stamp, star at pixel ``stamp_pixels // 2``; the same at all numerical settings.

    Attributes
    ----------
    lambda_d_arcsec : float
        lambda/D at band centre.
    pixel_scale_arcsec, aperture_radius_arcsec, mask_half_width_arcsec : float
        Detector pixel, photometric aperture, half width of the cross.
    zone : HoleZone or RingZone
        Where planets are looked for.
    stamp_pixels : int
        Side of the stamp.
    """

    lambda_d_arcsec: float
    pixel_scale_arcsec: float
    aperture_radius_arcsec: float
    mask_half_width_arcsec: float
    zone: Zone
    stamp_pixels: int

    @classmethod
    def of(
        cls, instrument: Instrument, band: str, stamp_pixels: int, mask_half_width_arcsec: float | None = None
    ) -> "BandGeometry":
        """Return the geometry of a band of an instrument, perhaps with another mask.

        Parameters
        ----------
        instrument : Instrument
        band : str
            Name of a band of the instrument, such as ``F520``.
        stamp_pixels : int
            Pixels of the stamp a side.
        mask_half_width_arcsec : float, optional
            Half width of the mask's arms, arcsec; that of the instrument by default.

        Raises
        ------
        InputError
            If the instrument has no such band.
        """
        own = instrument.mask_half_width_arcsec(band)
        return cls(
            lambda_d_arcsec=instrument.lambda_d_arcsec(band),
            pixel_scale_arcsec=instrument.pixel_scale_arcsec(band),
            aperture_radius_arcsec=instrument.aperture_radius_arcsec(band),
            mask_half_width_arcsec=own if mask_half_width_arcsec is None else mask_half_width_arcsec,
            zone=zone_of(instrument, band),
            stamp_pixels=stamp_pixels,
        )

    def figures(self) -> dict[str, Any]:
        """Return the lengths and hole as fields of `simulator.imaging.metrics.StampMetrics`."""
        lengths = {name: value for name, value in vars(self).items() if name.endswith("_arcsec")}
        edges = ("inner_arcsec", "outer_arcsec", "mode", "side")
        return lengths | {f"hole_{name}": getattr(self.zone, name) for name in edges}

    @property
    def hole(self) -> NDArray[np.bool_]:
        """Pixels whose centres lie in the zone; shape (n, n)."""
        offset = centred_offsets(self.stamp_pixels) * self.pixel_scale_arcsec
        return self.zone.covers(offset, offset)

    @property
    def aperture_pixels(self) -> float:
        """Area of the photometric aperture in pixels."""
        return float(np.pi) * (self.aperture_radius_arcsec / self.pixel_scale_arcsec) ** 2

    def annulus(self, separation_arcsec: float, half_width_lambda_d: float) -> NDArray[np.bool_]:
        """Return the pixels of the hole whose separation is within ``half_width_lambda_d`` of the given one.

        Parameters
        ----------
        separation_arcsec : float
            Projected separation from the star, arcsec, above 0.
        half_width_lambda_d : float
            Half width of the annulus, in lambda/D of the band.
        """
        distance = np.abs(self._separations() - separation_arcsec)
        return self.hole & (distance <= half_width_lambda_d * self.lambda_d_arcsec)

    def annulus_pixels(self, separation_arcsec: FloatArray, half_width_lambda_d: float) -> IntArray:
        """Return how many pixels `annulus` has at each of many separations.

        Parameters
        ----------
        separation_arcsec : ndarray
        half_width_lambda_d : float
        """
        width, inside = half_width_lambda_d * self.lambda_d_arcsec, np.sort(self._separations()[self.hole])
        first = np.searchsorted(inside, separation_arcsec - width, side="left")
        last = np.searchsorted(inside, separation_arcsec + width, side="right")
        return np.asarray(last - first)

    def _separations(self) -> FloatArray:
        """Return the distance of every pixel from the star, arcsec."""
        offset = centred_offsets(self.stamp_pixels) * self.pixel_scale_arcsec
        return np.hypot(offset[:, None], offset)

    def resolution_elements(self, separation_arcsec: ArrayLike) -> FloatArray:
        """Return the non-overlapping lambda/D-wide apertures on the arcs inside the zone, a real number (>= 0)."""
        r = np.asarray(separation_arcsec, dtype=np.float64)
        return 2.0 * np.pi * r * self.zone.azimuth_fraction(r) / self.lambda_d_arcsec
