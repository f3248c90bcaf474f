"""Laws that quantities of a population follow, each drawn through its quantile function."""

import math
from collections.abc import Mapping
from typing import Annotated, Any, Literal, TypeAlias, cast, get_args

import numpy as np
from pydantic import Field, model_validator

from cpic_core import FloatArray, InputError, IntArray, special
from simulator.config import FrozenModel, Real, nearest, validate


class _Between(FrozenModel):
    """A law between two limits, ``low < high``."""

    low: Real
    high: Real

    @model_validator(mode="after")
    def _ordered(self) -> "_Between":
        if not self.low < self.high:
            raise InputError("low", self.low, allowed=f"below high = {self.high:g}")
        return self

    @property
    def support(self) -> tuple[float, float]:
        """Smallest and largest value."""
        return self.low, self.high


class Fixed(FrozenModel):
    """One value for all."""

    law: Literal["fixed"] = "fixed"
    value: Real

    @property
    def support(self) -> tuple[float, float]:
        """Smallest and largest value."""
        return self.value, self.value

    def quantile(self, share: FloatArray) -> FloatArray:
        """Return the values below which these shares of the population lie."""
        return np.full(share.shape, self.value)


class Uniform(_Between):
    """The same density everywhere."""

    law: Literal["uniform"] = "uniform"

    def quantile(self, share: FloatArray) -> FloatArray:
        """Return the values below which these shares of the population lie."""
        return self.low + share * (self.high - self.low)


class _Positive(_Between):
    """A law between two limits above 0."""

    @model_validator(mode="after")
    def _above_zero(self) -> "_Positive":
        if self.low <= 0.0:
            raise InputError("low", self.low, allowed="above 0")
        return self


class LogUniform(_Positive):
    """The same number in every interval of the logarithm."""

    law: Literal["log_uniform"] = "log_uniform"

    def quantile(self, share: FloatArray) -> FloatArray:
        """Return the values below which these shares of the population lie."""
        return _power_quantile(share, self.low, self.high, -1.0)


class PowerLaw(_Positive):
    """Density ``dN/dx ~ x^index``: -1 is log-uniform, 0 uniform."""

    law: Literal["power_law"] = "power_law"
    index: Annotated[Real, Field(ge=-20, le=20)]

    def quantile(self, share: FloatArray) -> FloatArray:
        """Return the values below which these shares of the population lie."""
        return _power_quantile(share, self.low, self.high, self.index)


class BrokenPowerLaw(_Positive):
    """Density ``dN/dx ~ x^index_inner`` up to ``turn``, ``x^index_outer`` beyond, continuous there."""

    law: Literal["broken_power_law"] = "broken_power_law"
    index_inner: Annotated[Real, Field(ge=-20, le=20)]
    index_outer: Annotated[Real, Field(ge=-20, le=20)]
    turn: Real

    @model_validator(mode="after")
    def _turn_between(self) -> "BrokenPowerLaw":
        if not self.low < self.turn < self.high:
            raise InputError("turn", self.turn, allowed=f"between low = {self.low:g} and high = {self.high:g}")
        return self

    @property
    def inner_share(self) -> float:
        """Share of the population below the turn."""
        inner = _power_integral(self.low / self.turn, 1.0, self.index_inner)
        return inner / (inner + _power_integral(1.0, self.high / self.turn, self.index_outer))

    def quantile(self, share: FloatArray) -> FloatArray:
        """Return the values below which these shares of the population lie."""
        inner = self.inner_share
        below = _power_quantile(np.minimum(share / inner, 1.0), self.low, self.turn, self.index_inner)
        past = np.maximum(share - inner, 0.0) / (1.0 - inner)
        above = _power_quantile(past, self.turn, self.high, self.index_outer)
        return np.where(share < inner, below, above)


class Normal(_Between):
    """Normal, cut at both limits."""

    law: Literal["normal"] = "normal"
    mean: Real
    sd: Annotated[Real, Field(gt=0)]

    @model_validator(mode="after")
    def _reached(self) -> "Normal":
        # Beyond 6 sd less than 1e-9 is left of the law: what is meant is another one.
        if self.low > self.mean + 6.0 * self.sd or self.high < self.mean - 6.0 * self.sd:
            raise InputError("mean", self.mean, allowed="within 6 sd of a value between low and high")
        return self

    def quantile(self, share: FloatArray) -> FloatArray:
        """Return the values below which these shares of the population lie."""
        low, high = (self.low - self.mean) / self.sd, (self.high - self.mean) / self.sd
        # In the upper tail the complement keeps its digits.
        sign = -1.0 if low > 0.0 else 1.0
        first, last = float(special().ndtr(sign * low)), float(special().ndtr(sign * high))
        z = sign * special().ndtri(first + share * (last - first))
        return np.asarray(np.clip(self.mean + self.sd * z, self.low, self.high))


class Rayleigh(FrozenModel):
    """Rayleigh law of a scale, cut at ``high``."""

    law: Literal["rayleigh"] = "rayleigh"
    scale: Annotated[Real, Field(gt=0)]
    high: Annotated[Real, Field(gt=0)]

    @property
    def support(self) -> tuple[float, float]:
        """Smallest and largest value."""
        return 0.0, self.high

    def quantile(self, share: FloatArray) -> FloatArray:
        """Return the values below which these shares of the population lie."""
        all_below = -math.expm1(-0.5 * (self.high / self.scale) ** 2)
        return np.minimum(self.scale * np.sqrt(-2.0 * np.log1p(-share * all_below)), self.high)


class Beta(FrozenModel):
    """Beta law on 0 to 1, density ~ ``x^(a-1) (1-x)^(b-1)``, cut at ``high``."""

    law: Literal["beta"] = "beta"
    a: Annotated[Real, Field(gt=0, le=1000)]
    b: Annotated[Real, Field(gt=0, le=1000)]
    high: Annotated[Real, Field(gt=0, le=1)]

    @property
    def support(self) -> tuple[float, float]:
        """Smallest and largest value."""
        return 0.0, self.high

    def quantile(self, share: FloatArray) -> FloatArray:
        """Return the values below which these shares of the population lie."""
        value: FloatArray = special().betaincinv(
            self.a, self.b, share * float(special().betainc(self.a, self.b, self.high))
        )
        return np.minimum(value, self.high)


class Isotropic(FrozenModel):
    """Inclinations of orbits whose poles point anywhere: density ~ ``sin i``, 0 to 180 degrees."""

    law: Literal["isotropic"] = "isotropic"

    @property
    def support(self) -> tuple[float, float]:
        """Smallest and largest value."""
        return 0.0, 180.0

    def quantile(self, share: FloatArray) -> FloatArray:
        """Return the values below which these shares of the population lie."""
        return np.rad2deg(2.0 * np.arcsin(np.sqrt(share)))


class Table(FrozenModel):
    """Some values, each with its weight; equal weights if none are given."""

    law: Literal["table"] = "table"
    values: Annotated[tuple[Real, ...], Field(min_length=1)]
    weights: tuple[Annotated[Real, Field(ge=0)], ...] | None = None

    @model_validator(mode="after")
    def _weighed(self) -> "Table":
        weights = self.weights
        if weights is not None and (len(weights) != len(self.values) or not sum(weights) > 0.0):
            raise InputError("weights", list(weights), allowed=f"{len(self.values)} numbers, at least one above 0")
        return self

    @property
    def support(self) -> tuple[float, float]:
        """Smallest and largest value."""
        return min(self.values), max(self.values)

    def quantile(self, share: FloatArray) -> FloatArray:
        """Return the values below which these shares of the population lie, in the order of the table."""
        return np.asarray(self.values)[chosen_entry(share, self.weights or (1.0,) * len(self.values))]


Law: TypeAlias = Fixed | Uniform | LogUniform | PowerLaw | BrokenPowerLaw | Normal | Rayleigh | Beta | Isotropic | Table

_BY_NAME: dict[str, type[Law]] = {item.model_fields["law"].default: item for item in get_args(Law)}
LAWS = tuple(_BY_NAME)
"""Names of the laws."""


def read_law(value: Any) -> Law:
    """Return the law of what a user writes.

    Parameters
    ----------
    value : Law, mapping, float or str
        A mapping with ``law`` and the law's own keys; a number for ``fixed``; a word for a law without keys.

    Raises
    ------
    InputError
        Naming the key, its value and what is allowed.
    """
    if isinstance(value, tuple(_BY_NAME.values())):
        return cast("Law", value)
    if isinstance(value, int | float) and not isinstance(value, bool):
        return validate(Fixed, {"value": value})
    given = {"law": value} if isinstance(value, str) else value
    if not isinstance(given, Mapping):
        raise InputError("law", value, allowed="a number, or a mapping with law: " + ", ".join(LAWS))
    name = given.get("law", "missing")
    if not isinstance(name, str) or name not in _BY_NAME:
        raise InputError("law", name, allowed=", ".join(LAWS), hint=nearest(name, LAWS))
    return validate(_BY_NAME[name], given)


def chosen_entry(share: FloatArray, weights: tuple[float, ...]) -> IntArray:
    """Return the entry of a list that each share of the population falls on, entries weighed.

    Parameters
    ----------
    share : ndarray
        Uniform numbers in [0, 1), turned into values by the law.
    weights : tuple of float
        Weight of each entry, relative to the others.
    """
    ends = np.cumsum(weights) / math.fsum(weights)
    last = int(np.flatnonzero(weights)[-1])
    return np.minimum(np.searchsorted(ends, share, side="right"), last)


def _power_integral(low: float, high: float, index: float) -> float:
    """Return the integral of ``x^index``."""
    width, power = math.log(high / low), index + 1.0
    return float(low**power * (width if power == 0.0 else math.expm1(power * width) / power))


def _power_quantile(share: FloatArray, low: float, high: float, index: float) -> FloatArray:
    """Return the quantile of the density ``x^index`` between two limits; accurate for every index, -1 included."""
    width, power = math.log(high / low), index + 1.0
    grown = power * width
    # ln of (x / high)^power or (x / low)^power, at most 1: a sum of positive terms or, near 1, its distance from 1.
    least = math.exp(-abs(grown))
    near, far, end = (share, 1.0 - share, width) if grown > 0.0 else (1.0 - share, share, 0.0)
    if grown == 0.0:
        up = share * width
    elif least < 0.5:
        up = end + np.log(near + far * least) / power
    else:
        up = end + np.log1p(far * math.expm1(-abs(grown))) / power
    return np.clip(low * np.exp(up), low, high)
