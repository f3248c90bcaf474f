"""The near-infrared camera as configuration: frame, charge limits, readout, flaws, and what is switched on."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from catalogs.errors import InputError
from simulator.config.base import FrozenModel, flipped

__all__ = ["InfraredDetector", "InfraredFlaws", "InfraredPersistence", "InfraredSwitches", "ReadoutMode"]

ReadoutMode = Literal["single", "cds", "up_the_ramp"]
Fraction = Annotated[float, Field(ge=0, le=0.5)]


class InfraredFlaws(FrozenModel):
    """The seeded calibration set: relative scatter of response and dark current, hot and dead pixels.

    Hot pixels have ``hot_factor`` times the dark current on average; dead pixels have no response to light.
    """

    seed: Annotated[int, Field(ge=0, le=2**63 - 1)]
    prnu_rms: Annotated[float, Field(ge=0, le=0.3)]
    dsnu_rms: Annotated[float, Field(ge=0, le=3)]
    hot_fraction: Fraction
    hot_factor: Annotated[float, Field(ge=1, le=1e7)]
    dead_fraction: Fraction


class InfraredPersistence(FrozenModel):
    """Charge of earlier frames that comes out late: ``fraction`` of it, with the decay time ``decay_s``."""

    fraction: Fraction
    decay_s: Annotated[float, Field(gt=0, le=1e7)]


class InfraredSwitches(FrozenModel):
    """Every effect of the camera can be left out; what is left out leaves the numbers of the others as they are."""

    photon_noise: bool
    flat: bool
    dark: bool
    dark_structure: bool
    bad_pixels: bool
    cosmic_rays: bool
    persistence: bool
    nonlinearity: bool
    interpixel_capacitance: bool
    reset_noise: bool
    read_noise: bool


class InfraredDetector(FrozenModel):
    """Hybrid detector read without destroying the charge. Charge in electrons, images in ADU.

    ``read_noise_e`` is that of one read. ``readout_mode`` is ``single`` (one read after the exposure), ``cds`` (last
    read minus first: correlated double sampling) or ``up_the_ramp`` (``n_reads`` reads evenly spread over the exposure,
    the first right after the reset, fitted by a straight line). A read takes ``frame_time_s``; where an exposure has no
    room for ``n_reads``, fewer are taken. ``nonlinearity_at_full_well`` is the fraction of the signal missing there.
    ``interpixel_coupling`` is the part of a pixel's signal that appears in each of its four neighbours.
    """

    n_columns: Annotated[int, Field(ge=16, le=20000)]
    n_rows: Annotated[int, Field(ge=16, le=20000)]
    star_column: Annotated[int, Field(ge=0)]
    star_row: Annotated[int, Field(ge=0)]
    pixel_um: Annotated[float, Field(ge=1, le=100)]
    full_well_e: Annotated[float, Field(ge=100, le=1e9)]
    nonlinearity_at_full_well: Annotated[float, Field(ge=0, le=0.4)]
    dark_e_s: Annotated[float, Field(ge=0, le=1e6)]
    read_noise_e: Annotated[float, Field(ge=0, le=1e5)]
    reset_noise_e: Annotated[float, Field(ge=0, le=1e5)]
    gain_e_adu: Annotated[float, Field(gt=0, le=1e5)]
    adc_bits: Annotated[int, Field(ge=8, le=16)]
    bias_adu: Annotated[float, Field(ge=0, le=60000)]
    readout_mode: ReadoutMode
    n_reads: Annotated[int, Field(ge=2, le=1000)]
    frame_time_s: Annotated[float, Field(gt=0, le=1e3)]
    interpixel_coupling: Annotated[float, Field(ge=0, le=0.2)]
    flaws: InfraredFlaws
    persistence: InfraredPersistence
    switches: InfraredSwitches

    @model_validator(mode="after")
    def _consistent(self) -> InfraredDetector:
        if self.star_column >= self.n_columns or self.star_row >= self.n_rows:
            raise InputError(
                "star_column, star_row",
                (self.star_column, self.star_row),
                unit="px",
                allowed=f"inside the frame of {self.n_columns} x {self.n_rows}",
            )
        if self.bias_adu >= self.adc_max_adu:
            raise InputError("bias_adu", self.bias_adu, unit="ADU", allowed=f"below the ADC maximum {self.adc_max_adu}")
        return self

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the frame; every pixel sees light."""
        return self.n_rows, self.n_columns

    @property
    def adc_max_adu(self) -> int:
        """Largest number the converter writes."""
        return 2**self.adc_bits - 1

    @property
    def readout_s(self) -> float:
        """Dead time after an exposure: one read of the frame for the reset."""
        return self.frame_time_s

    def reads_of(self, exposure_s: float) -> int:
        """Number of reads of an exposure in the chosen mode."""
        if self.readout_mode != "up_the_ramp":
            return 1 if self.readout_mode == "single" else 2
        # The margin keeps an exposure of whole frame times from losing a read to rounding.
        return max(2, min(self.n_reads, int(exposure_s / self.frame_time_s + 1e-9) + 1))

    def switched(self, *, off: tuple[str, ...] = (), on: tuple[str, ...] = ()) -> InfraredDetector:
        """The same camera with effects switched off or on, by name of the switch; ``("all",)`` means every one.

        Raises
        ------
        InputError
            For a name that is no switch.
        """
        return self.model_copy(update={"switches": flipped(self.switches, off=off, on=on)})
