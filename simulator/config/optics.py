"""The optics as configuration: coronagraph, near-infrared channel, static wavefront, mirror, dark hole, drift."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from catalogs.errors import InputError
from simulator.config.base import FrozenModel
from simulator.config.detector import InfraredDetector

__all__ = ["Coronagraph", "DarkHoleConfig", "Drift", "MirrorConfig", "NearInfrared", "WavefrontConfig"]


class Coronagraph(FrozenModel):
    """Apodizer, focal-plane mask and dark-hole geometry (squares, one per quadrant).

    The controlled zone of a band is ``a <= |x|, |y| <= b`` with ``a = inner_lambda_d / sqrt2`` in units of
    lambda/D and ``b = outer_half_side_arcsec``. ``inner_arcsec`` gives the diagonal separation of the inner corner
    of single bands in arcsec instead. ``apodizer_samples`` averages a measured map over a grid that fits the pupil's.
    """

    apodizer: str
    apodizer_kind: Literal["amplitude", "intensity"]
    apodizer_samples: Annotated[int, Field(ge=8, le=2048, multiple_of=2)] | None
    mask_half_width_arcsec: Annotated[float, Field(ge=0, le=2)]
    inner_lambda_d: Annotated[float, Field(ge=1, le=20)]
    inner_arcsec: dict[str, Annotated[float, Field(gt=0, le=4)]]
    outer_half_side_arcsec: Annotated[float, Field(gt=0, le=1)]
    aperture_radius_lambda_d: Annotated[float, Field(ge=0.2, le=5)]


class NearInfrared(FrozenModel):
    """What differs in the near-infrared channel: pixel, cross, outer edge of the hole, and its camera."""

    pixel_scale_arcsec: Annotated[float, Field(gt=0, le=1)]
    mask_half_width_arcsec: Annotated[float, Field(ge=0, le=4)]
    outer_half_side_arcsec: Annotated[float, Field(gt=0, le=3)]
    detector: InfraredDetector


class WavefrontConfig(FrozenModel):
    """Static aberrations, drawn from a seed on a grid of ``samples``, and pointing jitter (rms per axis)."""

    seed: Annotated[int, Field(ge=0, le=2**63 - 1)]
    samples: Annotated[int, Field(ge=64, le=1024, multiple_of=2)]
    opd_rms_nm: Annotated[float, Field(ge=0, le=1000)]
    amplitude_rms: Annotated[float, Field(ge=0, le=0.1)]
    psd_slope: Annotated[float, Field(ge=0, le=6)]
    jitter_mas: Annotated[float, Field(ge=0, le=30)]

    @property
    def perfect(self) -> bool:
        """No static aberration at all."""
        return self.opd_rms_nm == 0 and self.amplitude_rms == 0


class MirrorConfig(FrozenModel):
    """The deformable mirror; see `simulator.imaging.deformable_mirror.DeformableMirror`."""

    n_actuators: Annotated[int, Field(ge=4, le=128)]
    span_diameters: Annotated[float, Field(ge=0.5, le=1.5)]
    coupling: Annotated[float, Field(ge=0.01, le=0.5)]
    stroke_nm: Annotated[float, Field(gt=0, le=1e5)]
    bits: Annotated[int, Field(ge=8, le=32)] | None
    noise_nm: Annotated[float, Field(ge=0, le=100)]
    dead: tuple[tuple[int, int], ...]


class DarkHoleConfig(FrozenModel):
    """How the mirror is set.

    ``control`` is ``conjugation`` (a new Jacobian at every step, with perfect knowledge of the field),
    ``single_jacobian`` (one Jacobian of the design: the less ideal state), ``surface`` (maps loaded from
    ``surface_files``, one per band), or ``off`` (the mirror stays flat). Mode ``2q`` darkens the two quadrants on
    ``side`` of the star on the detector. ``hold_star`` keeps tip and tilt out of the search: positions are measured
    from the star, and a search that may point the telescope moves the star away from its hole.
    """

    control: Literal["conjugation", "single_jacobian", "surface", "off"]
    mode: Literal["4q", "2q"]
    side: Literal["right", "left", "top", "bottom"]
    bandwidth: Annotated[float, Field(ge=0, le=0.5)]
    hold_star: bool
    surface_files: dict[str, str]

    @model_validator(mode="after")
    def _files_with_surface(self) -> DarkHoleConfig:
        if bool(self.surface_files) != (self.control == "surface"):
            raise InputError("control", self.control, allowed="surface with surface_files, any other without")
        return self


class Drift(FrozenModel):
    """Wavefront drift between and within visits; power spectrum of the phase screens ``f^-psd_slope``."""

    visit_nm: Annotated[float, Field(ge=0, le=100)]
    walk_nm_per_sqrt_hour: Annotated[float, Field(ge=0, le=100)]
    psd_slope: Annotated[float, Field(ge=0, le=6)]
