"""Cosmic rays and sky as configuration."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from catalogs.errors import InputError
from simulator.config.base import FrozenModel

__all__ = ["CosmicRayConfig", "ExtraLight", "PaperTracks", "PhysicalTracks", "SkyConfig", "TemplateTracks"]

Depth = Annotated[float, Field(ge=1, le=2000)]
Width = Annotated[float, Field(ge=0.1, le=100)]
Length = Annotated[float, Field(ge=10, le=100_000)]
Brightness = Annotated[float, Field(ge=0, le=40)]
LOSS_WIDTHS = 10  # the lower end of the truncated Landau law lies at most so many widths below its mean


class PhysicalTracks(FrozenModel):
    """Straight tracks of fast charged particles through a silicon layer.

    Isotropic particles cross a layer of ``depth_um``; chords longer than ``max_length_um`` are left out. A chord L
    leaves ``mean_loss_e_um`` L on average, with Landau fluctuations of width ``loss_width_e_um`` L cut off at
    ``loss_cut`` (Landau's lambda). ``diffusion_um`` is the Gaussian sigma of the collected charge.
    """

    depth_um: Depth
    max_length_um: Length
    mean_loss_e_um: Annotated[float, Field(gt=0, le=1e5)]
    loss_width_e_um: Annotated[float, Field(ge=0, le=1e4)]
    loss_cut: Annotated[float, Field(ge=1, le=200)]
    diffusion_um: Width

    @model_validator(mode="after")
    def _loses(self) -> PhysicalTracks:
        _check_lengths(self.depth_um, self.max_length_um)
        if self.mean_loss_e_um < LOSS_WIDTHS * self.loss_width_e_um:
            raise InputError(
                "loss_width_e_um",
                self.loss_width_e_um,
                unit="e-/um",
                allowed=f"at most mean_loss_e_um / {LOSS_WIDTHS} = {self.mean_loss_e_um / LOSS_WIDTHS:g}",
            )
        return self


class PaperTracks(FrozenModel):
    """Streaks as Zhu et al. 2025 describe them.

    Chords of a layer of ``depth_um``. Charge does not depend on length: exponential up to ``tail_start`` e-foldings, a
    power law of index ``tail_index`` beyond, mean ``mean_charge_e``. The Gaussian sigma across is ``width_um`` with a
    relative scatter ``width_rms``; along the streak the charge varies by ``texture_rms`` in ``texture_waves`` Fourier
    components.
    """

    depth_um: Depth
    max_length_um: Length
    mean_charge_e: Annotated[float, Field(ge=1, le=1e7)]
    tail_start: Annotated[float, Field(gt=0, le=30)]
    tail_index: Annotated[float, Field(ge=2.5, le=100)]
    width_um: Width
    width_rms: Annotated[float, Field(ge=0, le=1)]
    texture_rms: Annotated[float, Field(ge=0, le=1)]
    texture_waves: Annotated[int, Field(ge=1, le=64)]

    @model_validator(mode="after")
    def _long(self) -> PaperTracks:
        _check_lengths(self.depth_um, self.max_length_um)
        return self


class TemplateTracks(FrozenModel):
    """Tracks taken from a set of small images, turned and placed at random, scaled to a charge of the law of ``paper``.

    ``template_file`` is a FITS cube or npz file (`simulator.effects.templates`). Without one, ``generated_tracks``
    tracks of the physical model, sampled at ``sample_um``, are made from ``generated_seed``.
    """

    template_file: str | None
    generated_tracks: Annotated[int, Field(ge=1, le=5000)]
    generated_seed: Annotated[int, Field(ge=0)]
    sample_um: Annotated[float, Field(ge=0.5, le=100)]


class CosmicRayConfig(FrozenModel):
    """Cosmic rays: how many, and what they leave.

    The rate falls from ``peak_rate_per_s_cm2`` at solar minimum by the fraction ``cycle_depth`` at maximum;
    ``orbit_factor`` scales it to the orbit.
    """

    model: Literal["physical", "paper", "template"]
    peak_rate_per_s_cm2: Annotated[float, Field(ge=0, le=1e6)]
    cycle_depth: Annotated[float, Field(ge=0, le=1)]
    cycle_minimum_year: Annotated[float, Field(ge=1700, le=2300)]
    cycle_years: Annotated[float, Field(ge=1, le=100)]
    orbit_factor: Annotated[float, Field(ge=0, le=1000)]
    physical: PhysicalTracks
    paper: PaperTracks
    template: TemplateTracks


class ExtraLight(FrozenModel):
    """Light besides the sky: at most one of three.

    ``brightness_v_mag_arcsec2`` is a surface brightness of solar colour in front of the telescope; ``rate_e_s`` a
    uniform rate per pixel on the detector; ``map_file`` a FITS map of that rate over the whole frame (BUNIT
    electron/s), one for all bands or one by band.
    """

    brightness_v_mag_arcsec2: Brightness | None = None
    rate_e_s: Annotated[float, Field(ge=0, le=1e9)] | None = None
    map_file: str | dict[str, str] | None = None

    @model_validator(mode="after")
    def _one(self) -> ExtraLight:
        given = [name for name, value in self if value is not None]
        if len(given) > 1:
            raise InputError(given[1], f"given with {given[0]}", allowed="one of the two")
        return self

    def map_of(self, band: str) -> str | None:
        """Name of the map of a band, None if none is set.

        Raises
        ------
        InputError
            If there are maps by band and none for this one.
        """
        if not isinstance(self.map_file, dict):
            return self.map_file
        if band not in self.map_file:
            raise InputError(
                "map_file",
                f"no map of {band}",
                allowed=f"a map of each band, or of {band} at least",
                hint=f"there are maps of {', '.join(self.map_file) or 'no band'}",
            )
        return self.map_file[band]


class SkyConfig(FrozenModel):
    """Light of the sky: ``uniform`` of solar colour, or ``zodiacal`` by place and date; and what stray light adds.

    ``exozodi_zodis`` is the dust assumed around every target, in units of the solar system's, in a disc seen face-on:
    22 mag/arcsec2 in V at 1 au of a solar twin, in proportion to the star's V light and ``r^-2``. Predictions count it
    and confirmations show it; a scene of one's own has the discs that it names.
    """

    model: Literal["uniform", "zodiacal"]
    brightness_v_mag_arcsec2: Brightness
    exozodi_zodis: Annotated[float, Field(ge=0, le=1e5)]
    earthshine: ExtraLight
    stray_light: ExtraLight


def _check_lengths(depth_um: float, max_length_um: float) -> None:
    if max_length_um <= depth_um:
        raise InputError("max_length_um", max_length_um, unit="um", allowed=f"above depth_um = {depth_um:g}")
