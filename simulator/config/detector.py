"""The visible camera as configuration: frame, charge limits, register, converter, flaws, and what is switched on."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from catalogs.errors import InputError
from simulator.config.base import FrozenModel, flipped

__all__ = [
    "BiasStructure",
    "CalibrationFiles",
    "CameraSwitches",
    "ChargeTransfer",
    "Detector",
    "FrameLayout",
    "Nonlinearity",
    "PixelFlaws",
]

# Expected losses of an electron on its whole way. Three are followed; more happen to (n c)^4 / 24, 3e-4 of them here.
MAX_LOSSES = 0.3

Border = Annotated[int, Field(ge=0, le=4096)]
Fraction = Annotated[float, Field(ge=0, le=1)]


class FrameLayout(FrozenModel):
    """Borders of the frame around the active pixels.

    Columns from the left: prescan, dark, active, dark, overscan. Rows from the bottom, the side of the register: dark,
    active, dark, overscan. Prescan and overscan are clocked out of no pixel; dark pixels are shielded.
    """

    prescan_columns: Border
    dark_columns_left: Border
    dark_columns_right: Border
    overscan_columns: Border
    dark_rows_bottom: Border
    dark_rows_top: Border
    overscan_rows: Border


class PixelFlaws(FrozenModel):
    """The seeded calibration set: what makes pixels differ.

    ``prnu_rms`` is the relative scatter of the response, ``dsnu_rms`` that of the dark current, ``cic_rms`` that of the
    clock-induced charge. Hot pixels have ``hot_factor`` times the dark current on average. Dead pixels and bad columns
    have no response to light; bad columns collect ``bad_column_e_s`` more than the dark current.
    """

    seed: Annotated[int, Field(ge=0)]
    prnu_rms: Annotated[float, Field(ge=0, le=0.3)]
    dsnu_rms: Annotated[float, Field(ge=0, le=3)]
    cic_rms: Annotated[float, Field(ge=0, le=3)]
    hot_fraction: Annotated[float, Field(ge=0, le=0.5)]
    hot_factor: Annotated[float, Field(ge=1, le=1e7)]
    dead_fraction: Annotated[float, Field(ge=0, le=0.5)]
    bad_columns: Annotated[int, Field(ge=0, le=1000)]
    bad_column_e_s: Annotated[float, Field(ge=0, le=1e6)]


class CalibrationFiles(FrozenModel):
    """FITS maps over the whole frame that replace parts of the seeded set.

    ``flat`` is relative response (no unit), ``dark`` in electron/s, ``cic`` in electron (per frame), ``bias`` in adu,
    ``bad_columns`` an integer mask of pixels (0 is good).
    """

    flat: str | None
    dark: str | None
    cic: str | None
    bad_columns: str | None
    bias: str | None


class ChargeTransfer(FrozenModel):
    """Losses of charge transfer and the clocks of frame transfer.

    A transfer leaves the fraction ``parallel_cti`` (image) or ``serial_cti`` (line and multiplication register) of the
    charge behind; ``store_rows`` (the frame store) lie between the first row and the register, ``serial_elements``
    between the first column and the output. Light falls on the pixels during
    frame transfer: there is no shutter.
    """

    parallel_cti: Annotated[float, Field(ge=0, le=0.01)]
    serial_cti: Annotated[float, Field(ge=0, le=0.001)]
    store_rows: Annotated[int, Field(ge=0, le=100_000)]
    serial_elements: Annotated[int, Field(ge=0, le=100_000)]
    line_shift_s: Annotated[float, Field(ge=0, le=0.1)]


class Nonlinearity(FrozenModel):
    """Fractions of the charge missing at two levels: in a pixel at full well, and at the output of the register."""

    pixel_loss_at_full_well: Annotated[float, Field(ge=0, le=0.5)]
    register_loss: Annotated[float, Field(ge=0, le=0.5)]
    register_loss_at_e: Annotated[float, Field(gt=0, le=1e9)]


class BiasStructure(FrozenModel):
    """Structure of the bias: fixed vertical stripes, horizontal interference, drift of the level."""

    stripe_rms_adu: Annotated[float, Field(ge=0, le=1000)]
    interference_adu: Annotated[float, Field(ge=0, le=1000)]
    interference_period_columns: Annotated[float, Field(ge=2, le=1e5)]
    drift_adu: Annotated[float, Field(ge=0, le=1000)]


class CameraSwitches(FrozenModel):
    """Every effect of the camera can be left out; what is left out leaves the numbers of the others as they are."""

    photon_noise: bool
    flat: bool
    dark: bool
    dark_structure: bool
    bad_pixels: bool
    bad_columns: bool
    smear: bool
    cosmic_rays: bool
    nonlinearity: bool
    blooming: bool
    parallel_cti: bool
    clock_charge: bool
    serial_cti: bool
    em_register: bool
    register_clock_charge: bool
    register_full_well: bool
    read_noise: bool
    stripes: bool
    interference: bool
    bias_drift: bool


class Detector(FrozenModel):
    """EMCCD and its frame. Charge in electrons, images in ADU; read noise at the register output."""

    n_columns: Annotated[int, Field(ge=16, le=20000)]
    n_rows: Annotated[int, Field(ge=16, le=20000)]
    star_column: Annotated[int, Field(ge=0)]
    star_row: Annotated[int, Field(ge=0)]
    pixel_scale_arcsec: Annotated[float, Field(gt=0, le=1)]
    pixel_um: Annotated[float, Field(ge=1, le=100)]
    parity: Literal[-1, 1]
    layout: FrameLayout
    full_well_e: Annotated[float, Field(ge=100, le=1e9)]
    register_full_well_e: Annotated[float, Field(ge=100, le=1e9)]
    register_stages: Annotated[int, Field(ge=1, le=10000)]
    em_gain_max: Annotated[float, Field(ge=1, le=10000)]
    read_noise_e: Annotated[float, Field(ge=0, le=1e5)]
    gain_e_adu: Annotated[float, Field(gt=0, le=1e5)]
    adc_bits: Annotated[int, Field(ge=8, le=16)]
    bias_adu: Annotated[float, Field(ge=0, le=60000)]
    temperature_k: Annotated[float, Field(ge=120, le=320)]
    dark_e_s: Annotated[float, Field(ge=0, le=1e6)]
    dark_293k_e_s: Annotated[float, Field(ge=0, le=1e6)]
    cic_e: Annotated[float, Field(ge=0, le=1e3)]
    register_cic_e: Annotated[float, Field(ge=0, le=1)]
    readout_s: Annotated[float, Field(ge=0, le=1e4)]
    exposure_min_s: Annotated[float, Field(gt=0, le=1e6)]
    exposure_max_s: Annotated[float, Field(gt=0, le=1e6)]
    flaws: PixelFlaws
    calibration_files: CalibrationFiles
    transfer: ChargeTransfer
    nonlinearity: Nonlinearity
    bias_structure: BiasStructure
    switches: CameraSwitches

    @model_validator(mode="after")
    def _consistent(self) -> Detector:
        if self.star_column >= self.n_columns or self.star_row >= self.n_rows:
            raise InputError(
                "star_column, star_row",
                (self.star_column, self.star_row),
                unit="px",
                allowed=f"inside the frame of {self.n_columns} x {self.n_rows}",
            )
        if min(self.active_shape) < 1:
            raise InputError(
                "layout",
                self.layout.model_dump(),
                unit="px",
                allowed=f"borders that leave pixels in {self.n_columns} x {self.n_rows}",
            )
        if self.exposure_min_s > self.exposure_max_s:
            raise InputError(
                "exposure_min_s",
                self.exposure_min_s,
                unit="s",
                allowed=f"at most exposure_max_s = {self.exposure_max_s}",
            )
        if self.em_gain_max > 2.0 ** min(self.register_stages, 1000):
            raise InputError(
                "em_gain_max", self.em_gain_max, allowed=f"at most 2^{self.register_stages}, one doubling a stage"
            )
        clocks = self.transfer
        for name, elements, loss in (
            ("parallel_cti", self.n_rows + clocks.store_rows, clocks.parallel_cti),
            ("serial_cti", self.n_columns + clocks.serial_elements, clocks.serial_cti),
        ):
            if elements * loss > MAX_LOSSES:
                raise InputError(
                    f"transfer.{name}",
                    loss,
                    allowed=f"at most {MAX_LOSSES / elements:.3g}, {MAX_LOSSES:g} over {elements} transfers",
                )
        if self.bias_adu >= self.adc_max_adu:
            raise InputError("bias_adu", self.bias_adu, unit="ADU", allowed=f"below the ADC maximum {self.adc_max_adu}")
        return self

    @property
    def active_shape(self) -> tuple[int, int]:
        """Rows and columns of the active pixels."""
        edge = self.layout
        rows = self.n_rows - edge.dark_rows_bottom - edge.dark_rows_top - edge.overscan_rows
        dark = edge.dark_columns_left + edge.dark_columns_right
        return rows, self.n_columns - edge.prescan_columns - dark - edge.overscan_columns

    @property
    def adc_max_adu(self) -> int:
        """Largest number the converter writes."""
        return 2**self.adc_bits - 1

    def switched(self, *, off: tuple[str, ...] = (), on: tuple[str, ...] = ()) -> Detector:
        """The same camera with effects switched off or on, by name of the switch; ``("all",)`` means every one.

        Raises
        ------
        InputError
            For a name that is no switch.
        """
        return self.model_copy(update={"switches": flipped(self.switches, off=off, on=on)})
