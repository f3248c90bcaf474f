"""Telescope and coronagraph as configuration: pupil, apodizer, focal-plane mask, dark hole, or a table instead."""

import math
from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import Field

from cpic_core import InputError
from simulator.config.base import FrozenModel
from simulator.config.detector import InfraredDetector


class Telescope(FrozenModel):
    """Entrance pupil: a disc, whose diameter is the D of lambda/D.

    ``obstruction_diameter_ratio`` is the diameter of a round obstruction in its middle over its own. ``area_m2`` is the
    collecting area, where it is another than that of this ring: of segments with gaps, or behind struts. Throughputs
    of a coronagraph are over the light on this area.
    """

    diameter_m: Annotated[float, Field(ge=0.1, le=50)]
    obstruction_diameter_ratio: Annotated[float, Field(ge=0, lt=1)] = 0.0
    area_m2: Annotated[float, Field(gt=0, le=2000)] | None = None

    def _check_values(self) -> None:
        disc = math.pi / 4.0 * self.diameter_m**2
        if self.area_m2 is not None and self.area_m2 > disc * (1.0 + 1e-9):
            raise InputError("area_m2", self.area_m2, unit="m2", allowed=f"at most that of the disc, {disc:.4g}")

    @property
    def area_cm2(self) -> float:
        """Collecting area."""
        disc = math.pi / 4.0 * (100.0 * self.diameter_m) ** 2
        if self.area_m2 is not None:
            return 1e4 * self.area_m2
        return disc * (1.0 - self.obstruction_diameter_ratio**2)


class Coronagraph(FrozenModel):
    """Apodizer, focal-plane mask and dark-hole geometry (squares, one per quadrant).

    The controlled zone of a band is ``a <= |x|, |y| <= b`` with ``a = inner_lambda_d / sqrt2`` in units of
    lambda/D and ``b = outer_half_side_arcsec``. ``inner_arcsec`` gives the diagonal separation of the inner corner
    of single bands in arcsec instead. ``apodizer_samples`` averages a measured map over a grid that fits the pupil's.

    ``table`` replaces the optics by a file or folder, or by one for each band, of what the coronagraph does by
    separation (`simulator.config.coronagraph_table`). Planets are then looked for in a ``ring`` that holds the
    separations of the table, or in the ``quadrants`` above. Where a table has the column ``contrast_stability``, or
    ``stability_fraction`` of the raw contrast is given instead, that is the residual of a visit and no drift of the
    wavefront changes it; ``stability_averages`` says whether it is a new one in every visit, so that V visits leave
    V^(-1/2) of it (``visits``), or the same in all (``never``). Without either, the drift scatters light as the same
    wavefront error does in a clear telescope. ``diameter_m`` is the D of lambda/D in the tables where it is not that
    of the telescope, ``star_diameter_mas`` the diameter of the star behind a table that was made from images. Images
    are made from ``psf``, a file of `simulator.load_psf`, or one for each band, and refused without.
    """

    apodizer: str
    apodizer_kind: Literal["amplitude", "intensity"]
    apodizer_samples: Annotated[int, Field(ge=8, le=2048, multiple_of=2)] | None
    mask_half_width_arcsec: Annotated[float, Field(ge=0, le=2)]
    inner_lambda_d: Annotated[float, Field(ge=1, le=20)]
    inner_arcsec: dict[str, Annotated[float, Field(gt=0, le=4)]]
    outer_half_side_arcsec: Annotated[float, Field(gt=0, le=1)]
    aperture_radius_lambda_d: Annotated[float, Field(ge=0.2, le=5)]
    table: str | dict[str, str] | None = None
    diameter_m: Annotated[float, Field(ge=0.1, le=50)] | None = None
    star_diameter_mas: Annotated[float, Field(ge=0, le=1000)] | None = None
    psf: str | dict[str, str] | None = None
    zone: Literal["quadrants", "ring"] | None = None
    stability_fraction: Annotated[float, Field(ge=0, le=1)] | None = None
    stability_averages: Literal["visits", "never"] = "never"

    def _check_values(self) -> None:
        if self.table is None:
            for key in ("diameter_m", "star_diameter_mas", "psf", "zone", "stability_fraction"):
                if getattr(self, key) is not None:
                    raise InputError(key, getattr(self, key), allowed="not given without coronagraph.table")

    @property
    def is_ring(self) -> bool:
        """Whether planets are looked for in a ring: with a table, unless it is said otherwise."""
        return self.table is not None and self.zone != "quadrants"


class NearInfrared(FrozenModel):
    """The near-infrared channel where it differs: pixel, cross, outer edge of the hole, and its camera."""

    pixel_scale_arcsec: Annotated[float, Field(gt=0, le=1)]
    mask_half_width_arcsec: Annotated[float, Field(ge=0, le=4)]
    outer_half_side_arcsec: Annotated[float, Field(gt=0, le=3)]
    detector: InfraredDetector


def drop_bands(own: Mapping[str, Any], merged: dict[str, Any]) -> None:
    """Leave out the bands of the base where a table replaces its optics: those that neither bands nor tables name.

    Parameters
    ----------
    own : mapping
        What a file says of an instrument.
    merged : dict
        The same over its base, which is changed.
    """
    coronagraph = own.get("coronagraph")
    table = coronagraph.get("table") if isinstance(coronagraph, Mapping) else None
    if isinstance(table, Mapping) and "value" in table:
        table = table["value"]
    named = own.get("bands") if isinstance(own.get("bands"), Mapping) else table
    if table is not None and isinstance(named, Mapping) and isinstance(merged.get("bands"), Mapping):
        merged["bands"] = {name: band for name, band in merged["bands"].items() if name in named}
