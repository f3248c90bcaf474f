"""Detectors as configuration: frame, charge limits, readout, flaws, and what is switched on.

Switches and numbers of the effects stand with the effects (`simulator.detectors`); here is what a detector is besides.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self, TypeAlias

from pydantic import Field

from cpic_core import InputError, check_word
from simulator import detectors
from simulator.config.base import FrozenModel, bare_value

# Expected losses of an electron on its whole way. Three are followed; more happen to (n c)^4 / 24, 3e-4 of them here.
MAX_LOSSES = 0.3

CONVERTER_ASSUMED = "assumed: the range of the converter over the full well of a pixel"
"""Source of the gain of a camera that is described without one."""
_BITS = 16

Border = Annotated[int, Field(ge=0, le=4096)]
ReadoutMode = Literal["single", "cds", "up_the_ramp"]
Section = tuple[slice, slice]

if TYPE_CHECKING:
    CameraSwitches: TypeAlias = detectors.Switches
    InfraredSwitches: TypeAlias = detectors.Switches
    OwnVisible: TypeAlias = FrozenModel
    OwnInfrared: TypeAlias = FrozenModel
else:
    CameraSwitches = detectors.switches_model("CameraSwitches", __name__, detectors.VISIBLE)
    InfraredSwitches = detectors.switches_model("InfraredSwitches", __name__, detectors.INFRARED)
    OwnVisible = detectors.numbers_model("OwnVisible", __name__, detectors.VISIBLE)
    OwnInfrared = detectors.numbers_model("OwnInfrared", __name__, detectors.INFRARED)


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


class _AnyDetector(FrozenModel):
    """The fields that every detector has. Charge is in electrons, images are in ADU.

    ``sections`` are the row and column slices of the named parts of the frame: ``active`` (pixels that see light),
    ``image`` (active and shielded pixels), ``prescan`` and ``overscan_columns`` (every row), ``overscan_rows`` (columns
    of the image), ``dark_left`` and ``dark_right`` (rows of the image), ``dark_bottom`` and ``dark_top`` (active
    columns). All but ``image`` are disjoint and cover the frame; a part of no pixels has an empty slice. A hybrid array
    has active pixels only.
    """

    chain: ClassVar[detectors.Chain]
    set_name: ClassVar[str]
    """Name of the random streams of its calibration set."""

    n_columns: Annotated[int, Field(ge=16, le=20000)]
    n_rows: Annotated[int, Field(ge=16, le=20000)]
    star_column: Annotated[int, Field(ge=0)]
    star_row: Annotated[int, Field(ge=0)]
    pixel_um: Annotated[float, Field(ge=1, le=100)]
    full_well_e: detectors.FullWell
    dark_e_s: detectors.DarkCurrent
    read_noise_e: detectors.ReadNoiseElectrons
    gain_e_adu: Annotated[float, Field(gt=0, le=1e5)]
    adc_bits: Annotated[int, Field(ge=8, le=16)]
    bias_adu: Annotated[float, Field(ge=0, le=60000)]
    switches: detectors.Switches

    def _check_values(self) -> None:
        if self.star_column >= self.n_columns or self.star_row >= self.n_rows:
            allowed = f"inside the frame of {self.n_columns} x {self.n_rows}"
            raise InputError("star_column, star_row", (self.star_column, self.star_row), unit="px", allowed=allowed)
        if self.bias_adu >= self.adc_max_adu:
            raise InputError("bias_adu", self.bias_adu, unit="ADU", allowed=f"below the ADC maximum {self.adc_max_adu}")

    @property
    def multiplies(self) -> bool:
        """Whether charge goes through a multiplication register that is switched on."""
        return bool(getattr(self.switches, "em_register", False))

    @property
    def blooming_e(self) -> float:
        """Charge beyond which a pixel spills along its column; infinite where none does."""
        return self.full_well_e if getattr(self.switches, "blooming", False) else math.inf

    @property
    def trailing_e(self) -> float:
        """Charge at the output beyond which the register leaves some in its row; infinite where it does not."""
        switched = getattr(self.switches, "register_full_well", False)
        return float(getattr(self, "register_full_well_e", math.inf)) if switched else math.inf

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the frame."""
        return self.n_rows, self.n_columns

    @property
    def active_shape(self) -> tuple[int, int]:
        """Rows and columns of the active pixels."""
        return self.shape

    @property
    def adc_max_adu(self) -> int:
        """Largest number the converter writes."""
        return int(2**self.adc_bits - 1)

    @property
    def converter_e(self) -> float:
        """Charge at the output that the converter holds above the bias."""
        return (self.adc_max_adu - self.bias_adu) * self.gain_e_adu

    @property
    def maps(self) -> dict[str, str]:
        """Files of calibration maps, by what they hold."""
        return {}

    @property
    def sections(self) -> dict[str, Section]:
        """Row and column slices of the named parts of the frame."""
        whole = (slice(0, self.n_rows), slice(0, self.n_columns))
        return {"active": whole, "image": whole}

    def ramp(self, exposure_s: float | None = None) -> tuple[float, float]:
        """Return what several reads make of the variance of one read and of the mean of the light: nothing."""
        return 1.0, 1.0

    def with_switches(self, switches: Mapping[str, bool]) -> Self:
        """Return the same camera with effects switched by name; names of no switch of its own are passed over."""
        own = {name: on for name, on in switches.items() if name in type(self.switches).model_fields}
        return self.model_copy(update={"switches": self.switches.model_copy(update=own)})

    def switched(self, *, off: tuple[str, ...] = (), on: tuple[str, ...] = ()) -> Self:
        """Return the same camera with effects switched off or on, by name of the switch; ``("all",)`` means every one.

        Parameters
        ----------
        off, on : tuple of str
            Names of switches; those of ``on`` count after those of ``off``.

        Raises
        ------
        InputError
            For a name that is no switch.
        """
        names, changed = tuple(type(self.switches).model_fields), dict[str, bool]()
        for chosen, state in ((off, False), (on, True)):
            for name in names if chosen == ("all",) else chosen:
                check_word("switches", name, names)
                changed[name] = state
        return self.with_switches(changed)


class Detector(_AnyDetector, OwnVisible):
    """EMCCD and its frame; read noise at the register output."""

    chain = detectors.VISIBLE
    set_name = "visible"

    pixel_scale_arcsec: Annotated[float, Field(gt=0, le=1)]
    parity: Literal[-1, 1]
    layout: FrameLayout
    register_full_well_e: detectors.FullWell
    register_stages: detectors.Stages
    em_gain_max: detectors.LargestGain
    temperature_k: Annotated[float, Field(ge=120, le=320)]
    dark_293k_e_s: detectors.DarkCurrent
    cic_e: detectors.ClockInduced
    register_cic_e: detectors.StageCharge
    readout_s: Annotated[float, Field(ge=0, le=1e4)]
    exposure_min_s: Annotated[float, Field(gt=0, le=1e6)]
    exposure_max_s: Annotated[float, Field(gt=0, le=1e6)]
    flaws: detectors.PixelFlaws
    calibration_files: CalibrationFiles
    transfer: detectors.ChargeTransfer
    nonlinearity: detectors.Nonlinearity
    bias_structure: detectors.BiasStructure
    switches: CameraSwitches

    def _check_values(self) -> None:
        super()._check_values()
        if min(self.active_shape) < 1:
            allowed = f"borders that leave pixels in {self.n_columns} x {self.n_rows}"
            raise InputError("layout", self.layout.model_dump(), unit="px", allowed=allowed)
        if self.exposure_min_s > self.exposure_max_s:
            allowed = f"at most exposure_max_s = {self.exposure_max_s}"
            raise InputError("exposure_min_s", self.exposure_min_s, unit="s", allowed=allowed)
        if self.em_gain_max > 2.0 ** min(self.register_stages, 1000):
            allowed = f"at most 2^{self.register_stages}, one doubling a stage"
            raise InputError("em_gain_max", self.em_gain_max, allowed=allowed)
        clocks = self.transfer
        for name, elements, loss in (
            ("parallel_cti", self.n_rows + clocks.store_rows, clocks.parallel_cti),
            ("serial_cti", self.n_columns + clocks.serial_elements, clocks.serial_cti),
        ):
            if elements * loss > MAX_LOSSES:
                allowed = f"at most {MAX_LOSSES / elements:.3g}, {MAX_LOSSES:g} over {elements} transfers"
                raise InputError(f"transfer.{name}", loss, allowed=allowed)

    @property
    def active_shape(self) -> tuple[int, int]:
        """Rows and columns of the active pixels."""
        edge = self.layout
        rows = self.n_rows - edge.dark_rows_bottom - edge.dark_rows_top - edge.overscan_rows
        dark = edge.dark_columns_left + edge.dark_columns_right
        return rows, self.n_columns - edge.prescan_columns - dark - edge.overscan_columns

    @property
    def maps(self) -> dict[str, str]:
        """Files of calibration maps, by what they hold."""
        return {kind: path for kind, path in self.calibration_files if path is not None}

    @property
    def sections(self) -> dict[str, Section]:
        """Row and column slices of the named parts of the frame."""
        edge, (rows, columns) = self.layout, self.active_shape
        left = edge.prescan_columns
        first, bottom = left + edge.dark_columns_left, edge.dark_rows_bottom
        last, top = first + columns, bottom + rows
        right, above = last + edge.dark_columns_right, top + edge.dark_rows_top
        every_row, image_rows, image_columns = slice(0, self.n_rows), slice(0, above), slice(left, right)
        return {
            "active": (slice(bottom, top), slice(first, last)),
            "image": (image_rows, image_columns),
            "prescan": (every_row, slice(0, left)),
            "overscan_columns": (every_row, slice(right, self.n_columns)),
            "overscan_rows": (slice(above, self.n_rows), image_columns),
            "dark_left": (image_rows, slice(left, first)),
            "dark_right": (image_rows, slice(last, right)),
            "dark_bottom": (slice(0, bottom), slice(first, last)),
            "dark_top": (slice(top, above), slice(first, last)),
        }

    @property
    def dark_rate_e_s(self) -> float:
        """Mean dark current of a pixel: what cooling does not remove, and the law at the detector's temperature."""
        return self.dark_e_s + float(detectors.dark_law_e_s(self.temperature_k, self.dark_293k_e_s))

    @property
    def line_shift_s(self) -> float:
        """Time that a line of the frame stands in the light of each other during the transfer; 0 without smear."""
        return self.transfer.line_shift_s if self.switches.smear else 0.0

    @property
    def stripe_rms_adu(self) -> float:
        """Scatter of the fixed stripes of the bias."""
        return self.bias_structure.stripe_rms_adu


class InfraredDetector(_AnyDetector, OwnInfrared):
    """Hybrid detector read without destroying the charge.

    ``read_noise_e`` is that of one read. ``readout_mode`` is ``single`` (one read after the exposure), ``cds`` (last
    read minus first: correlated double sampling) or ``up_the_ramp`` (``n_reads`` reads evenly spread over the exposure,
    the first right after the reset, fitted by a straight line). A read takes ``frame_time_s``; where an exposure has no
    room for ``n_reads``, fewer are taken. ``nonlinearity_at_full_well`` is the fraction of the signal missing there.
    ``interpixel_coupling`` is the part of a pixel's signal that appears in each of its four neighbours.
    """

    chain = detectors.INFRARED
    set_name = "infrared"
    cic_e: ClassVar[float] = 0.0
    stripe_rms_adu: ClassVar[float] = 0.0
    em_gain_max: ClassVar[float] = 1.0
    register_stages: ClassVar[int] = 0
    register_full_well_e: ClassVar[float] = math.inf
    line_shift_s: ClassVar[float] = 0.0
    exposure_max_s: ClassVar[float] = math.inf

    nonlinearity_at_full_well: detectors.LossAtFullWell
    reset_noise_e: detectors.ResetElectrons
    readout_mode: ReadoutMode
    n_reads: Annotated[int, Field(ge=2, le=1000)]
    frame_time_s: Annotated[float, Field(gt=0, le=1e3)]
    interpixel_coupling: detectors.Coupled
    flaws: detectors.InfraredFlaws
    persistence: detectors.InfraredPersistence
    switches: InfraredSwitches

    @property
    def readout_s(self) -> float:
        """Dead time after an exposure: one read of the frame for the reset."""
        return self.frame_time_s

    @property
    def dark_rate_e_s(self) -> float:
        """Mean dark current of a pixel."""
        return self.dark_e_s

    def ramp(self, exposure_s: float | None = None) -> tuple[float, float]:
        """Return `simulator.detectors.variance.ramp_factors` of the reads of an exposure, or of all reads."""
        reads = self.n_reads if exposure_s is None else self.reads_of(exposure_s)
        return detectors.ramp_factors(self.readout_mode, reads)

    @property
    def exposure_min_s(self) -> float:
        """Shortest exposure: that of all reads of a ramp, or of one read."""
        return (self.n_reads if self.readout_mode == "up_the_ramp" else 1) * self.frame_time_s

    def reads_of(self, exposure_s: float) -> int:
        """Return the number of reads of an exposure in the chosen mode."""
        if self.readout_mode != "up_the_ramp":
            return 1 if self.readout_mode == "single" else 2
        # The margin keeps an exposure of whole frame times from losing a read to rounding.
        return max(2, min(self.n_reads, int(exposure_s / self.frame_time_s + 1e-9) + 1))


AnyDetector = Detector | InfraredDetector


def assume_converter(own: Mapping[str, Any], base: Mapping[str, Any], merged: dict[str, Any]) -> None:
    """Give a camera that is described anew a converter of its own where its file says nothing of one.

    An EMCCD's converter spans the output of its register: 59 electrons a step, which would be 17 electrons of rounding
    in a camera without a register. Where that is switched off and read noise is given, the range of the converter, 16
    bit unless it is said, is laid over the full well of a pixel.

    Parameters
    ----------
    own, base : mapping
        Section ``detector`` of an instrument's file, and of the preset under it.
    merged : dict
        The two together, which is changed in place.
    """
    register = [bare_value(own.get("em_gain_max", 0)) == 1, _plain_switch(own) is False]
    if "gain_e_adu" in own or "read_noise_e" not in own or not any(register) or _plain_switch(base) is False:
        return
    merged["adc_bits"] = own.get("adc_bits", {"value": _BITS, "source": "assumed", "confidence": "A"})
    try:
        steps = 2.0 ** float(bare_value(merged["adc_bits"])) - 1.0 - float(bare_value(merged["bias_adu"]))
        gain = float(bare_value(merged["full_well_e"])) / steps
    except (TypeError, ValueError, ArithmeticError):
        return  # what is no number is refused with its key
    merged["gain_e_adu"] = {"value": gain, "unit": "e-/ADU", "source": CONVERTER_ASSUMED, "confidence": "A"}


def _plain_switch(detector: Mapping[str, Any]) -> Any:
    switches = detector.get("switches")
    return bare_value(switches.get("em_register")) if isinstance(switches, Mapping) else None
