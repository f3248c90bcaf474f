"""The effects of both cameras in their order, and those that make pixels differ (response, dark current, flaws).

A new effect is one entry here, at its place in the chain.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import numpy as np
from pydantic import Field, create_model

from cpic_core import ArrayLike, FloatArray, checked_array
from simulator.config import FrozenModel
from simulator.detectors.effect import Case, Effect, Setting, Sizes, Work, counted, sizes
from simulator.detectors.infrared import (
    InfraredHits,
    InfraredReadNoise,
    InterpixelCapacitance,
    Persistence,
    PixelCurve,
    ResetNoise,
)
from simulator.detectors.variance import FrameTerm
from simulator.detectors.visible import (
    BiasDrift,
    Blooming,
    ClockCharge,
    CosmicRayHits,
    InfraredPhotonNoise,
    Interference,
    OutputNonlinearity,
    ParallelTransfer,
    PhotonNoise,
    PixelNonlinearity,
    Quantisation,
    ReadNoise,
    Register,
    RegisterClockCharge,
    RegisterFullWell,
    SerialTransfer,
    Smear,
    Stripes,
)

Fraction = Annotated[float, Field(ge=0, le=0.5)]
DarkCurrent = Annotated[float, Field(ge=0, le=1e6)]
_CORE_MARGIN = 1.4  # for what a Gaussian core lacks


class SharedFlaws(FrozenModel):
    """The seeded calibration set of every camera: scatter of response and dark current, hot and dead pixels.

    ``prnu_rms`` is the relative scatter of the response, ``dsnu_rms`` that of the dark current. Hot pixels have
    ``hot_factor`` times the dark current on average; dead pixels have no response to light.
    """

    seed: Annotated[int, Field(ge=0, le=2**63 - 1)]
    prnu_rms: Annotated[float, Field(ge=0, le=0.3)]
    dsnu_rms: Annotated[float, Field(ge=0, le=3)]
    hot_fraction: Fraction
    hot_factor: Annotated[float, Field(ge=1, le=1e7)]
    dead_fraction: Fraction


class InfraredFlaws(SharedFlaws):
    """The seeded calibration set of the near-infrared camera: without columns of flaws and clock-induced charge."""

    cic_rms: ClassVar[float] = 0.0
    bad_columns: ClassVar[int] = 0
    bad_column_e_s: ClassVar[float] = 0.0


class PixelFlaws(SharedFlaws):
    """The seeded calibration set of the visible camera.

    ``cic_rms`` is the relative scatter of the clock-induced charge. Bad columns have no response to light and collect
    ``bad_column_e_s`` more than the dark current.
    """

    seed: Annotated[int, Field(ge=0)]
    cic_rms: Annotated[float, Field(ge=0, le=3)]
    bad_columns: Annotated[int, Field(ge=0, le=1000)]
    bad_column_e_s: Annotated[float, Field(ge=0, le=1e6)]


class _Flaw(Effect):
    """A flaw of pixels, known from the calibration set and taken out by a reduction.

    The cameras apply all flaws at once: `simulator.camera.calibration_set.CalibrationSet.response_of` and ``dark_of``.
    """

    law = "from the calibration set"
    in_sums, seeded = "left_out", True
    set_up_s = 2e-4

    def size(self, case: Case) -> Sizes:
        """Return the sizes of its changes of the response and of the dark current on the stamp."""
        if case.reduced:
            return sizes(0.0)
        flaw, t = case.flaws[self.switch], case.exposure_s
        outside = case.light_e[case.light.total_e_s.size :]
        counts = case.n_frames * case.noise.factor2
        change = flaw.response * (case.light.total_e_s * t) + flaw.dark_e_s * t
        beyond = flaw.most_response * outside + flaw.most_dark_e_s * t
        lost = [float((weight * flaw.response[place]).sum()) for place, weight in case.cores]
        dark_e_s = [float((planet.weights**2 * flaw.dark_e_s[planet.place]).sum()) for planet in case.light.planets]
        flux = _CORE_MARGIN * max(lost, default=0.0)
        added = case.snr_added([counts * rate_e_s * t for rate_e_s in dark_e_s])
        return sizes(case.mean_change(np.concatenate([change.ravel(), beyond])), flux, flux + added)


class Flat(_Flaw):
    """Scatter of the response from pixel to pixel."""

    switch, label, law = "flat", "flat field", "response of every pixel"
    needs, number, map_kind = "light", "flaws.prnu_rms", "flat"


class Dark(Effect):
    """Dark current: electrons with Poisson noise that come with time."""

    switch, label, law = "dark", "dark current", "plateau and law of temperature"
    needs, map_kind = "exposure", "dark"
    set_up_s, colour = 5e-5, "#9A8700"
    hides = ("dark_structure", "bad_pixels", "bad_columns")

    def added(self, detector: Any, exposure_s: float | None = None) -> FrameTerm:
        """Return the dark current as a rate."""
        return FrameTerm(rate_e_s=detector.dark_rate_e_s)

    def size(self, case: Case) -> Sizes:
        """Return the size of the mean of the dark current, its hot pixels included."""
        return sizes(case.mean_change(case.noise.dark_e), snr=case.snr_share("dark", "flaws"))


class InfraredDark(Dark):
    """Dark current of the near-infrared camera, with a random stream of its own."""

    law = "constant"
    stage, always = "charge", True

    def draw(self, work: Work, exposure: Any, rng: np.random.Generator) -> None:
        """Add the counts."""
        dark = counted(exposure.dark_e, exposure.detector, rng)
        work.image += dark
        work.book("dark", dark.sum())

    def draw_sum(self, work: Work, exposure: Any, n_frames: int, rng: np.random.Generator) -> None:
        """Leave sums of frames as they are: the counts of light hold it."""


class DarkStructure(_Flaw):
    """Scatter of the dark current from pixel to pixel."""

    switch, label, law = "dark_structure", "structure of the dark current", "every pixel its own"
    needs, number, map_kind = "exposure", "flaws.dsnu_rms", "dark"

    def why_not(self, setting: Setting) -> str:
        """Return why it does not exist; empty if it does."""
        hidden = self.on(setting.detector) and setting.exposed and not setting.detector.switches.dark
        return "the dark current is switched off" if hidden else super().why_not(setting)


class BadPixels(_Flaw):
    """Hot and dead pixels."""

    switch, label = "bad_pixels", "hot and dead pixels"
    set_up_s = 1e-4


class BadColumns(_Flaw):
    """Columns that see no light and collect more than the dark current."""

    switch, label = "bad_columns", "bad columns"
    number, map_kind = "flaws.bad_columns", "bad_columns"
    set_up_s = 1e-4


def dark_law_e_s(temperature_k: ArrayLike, dark_293k_e_s: ArrayLike) -> FloatArray:
    """Return the thermal dark current of a pixel in inverted mode.

    Parameters
    ----------
    temperature_k : array_like
        Temperature of the detector, 120 to 320 K.
    dark_293k_e_s : array_like
        Dark current at 293 K, at least 0 e-/s per pixel; broadcasts.

    Returns
    -------
    ndarray
        ``dark_293k 1.14e6 T^3 exp(-9080 / T)`` in e-/s per pixel (e2v CCD201-20 data sheet; 0.3 % below
        ``dark_293k_e_s`` at 293 K, within 20 % of the curve of the sheet from 233 K to 293 K). Below 230 K the law is
        extrapolated.

    Raises
    ------
    InputError
        If an argument is out of range or not finite.
    """
    temperature = checked_array("temperature_k", temperature_k, low=120.0, high=320.0, unit="K")
    level = checked_array("dark_293k_e_s", dark_293k_e_s, low=0.0, unit="e-/s")
    return np.asarray(level * 1.14e6 * temperature**3 * np.exp(-9080.0 / temperature))


Chain = tuple[Effect, ...]

VISIBLE: Chain = (
    *(PhotonNoise(), Flat(), Dark(), DarkStructure(), BadPixels(), BadColumns(), Smear(), CosmicRayHits()),
    *(PixelNonlinearity(), Blooming(), ParallelTransfer(), ClockCharge(), SerialTransfer()),
    *(Register(), RegisterClockCharge(), RegisterFullWell(), OutputNonlinearity()),
    *(ReadNoise(), Stripes(), Interference(), BiasDrift(), Quantisation()),
)
INFRARED: Chain = (
    *(InfraredPhotonNoise(), Flat(), InfraredDark(), DarkStructure(), BadPixels(), InfraredHits(), Persistence()),
    *(PixelCurve(), InterpixelCapacitance(), ResetNoise(), InfraredReadNoise(), Quantisation()),
)


def rows_of(chain: Chain) -> Iterator[Effect]:
    """Yield the effects of a chain that have a row in the ledger: one a switch."""
    return (effect for effect in chain if effect.label)


def switched(chain: Chain) -> tuple[str, ...]:
    """Return the names of the switches of a chain."""
    return tuple(effect.switch for effect in rows_of(chain) if not effect.fixed)


def in_sums(chain: Chain, *fates: str) -> tuple[str, ...]:
    """Return the switches of effects that sums of frames treat in one of some ways; see `Effect.in_sums`."""
    return tuple(effect.switch for effect in rows_of(chain) if effect.in_sums in fates)


def added_variance(detector: Any, exposure_s: float | None = None) -> dict[str, FrameTerm]:
    """Return the variance that a pixel of one frame has besides that of its light, by term of the budget of noise.

    Parameters
    ----------
    detector : Detector or InfraredDetector
        Effects that are switched off add nothing.
    exposure_s : float, optional
        Exposure of the frame; one that has room for all reads of the detector if not given.
    """
    terms: dict[str, FrameTerm] = {}
    for effect in detector.chain:
        added = effect.added(detector, exposure_s) if effect.on(detector) else FrameTerm()
        if any(added):
            terms[effect.budget_term] = FrameTerm.total([terms.get(effect.budget_term, FrameTerm()), added])
    return terms


def noise_terms() -> dict[str, Effect]:
    """Return the effects that add variance, by their term in budgets of noise: their words and colours there."""
    found: dict[str, Effect] = {}
    for effect in (*VISIBLE, *INFRARED):
        if type(effect).added is not Effect.added:
            found.setdefault(effect.budget_term, effect)
    return found


def chain_preset(chain: Chain) -> dict[str, Any]:
    """Return the defaults that effects of a chain bring with them, as in the file of an instrument under a detector."""
    tree: dict[str, Any] = {"switches": {}}
    for effect in chain:
        for key, value in effect.preset.items():
            tree[key] = {**tree.get(key, {}), **value} if key == "switches" else value
    return tree


class Switches(FrozenModel):
    """Every effect of a camera can be left out; what is left out leaves the numbers of the others as they are."""

    if TYPE_CHECKING:

        def __getattr__(self, name: str) -> bool: ...


def switches_model(name: str, module: str, chain: Chain) -> type[Switches]:
    """Return the model of the switches of a chain.

    Parameters
    ----------
    name, module : str
        Name of the class, and of the module that holds it.
    chain : tuple of Effect
    """
    fields: Any = dict.fromkeys(switched(chain), (bool, ...))
    return create_model(name, __base__=Switches, __module__=module, __doc__=Switches.__doc__, **fields)


def numbers_model(name: str, module: str, chain: Chain) -> type[FrozenModel]:
    """Return the model of the settings that effects of a chain bring with them, by the names of their switches.

    Parameters
    ----------
    name, module : str
        Name of the class, and of the module that holds it.
    chain : tuple of Effect
    """
    own: Any = {effect.switch: (effect.settings, ...) for effect in chain if effect.settings is not None}
    return create_model(name, __base__=FrozenModel, __module__=module, **own)
