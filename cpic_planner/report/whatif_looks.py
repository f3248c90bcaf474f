"""How strategies look in figures: one colour and marker each, and what a sweep varies."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from cpic_planner.models.surveyed import StrategyOutcome
from cpic_planner.report.drawing import BAND_STYLE, literal

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FEW = 8
"""Strategies that can be told apart by colour and marker in one plot."""
MOST_ROWS = 40
"""Rows of a figure that can be read."""
_LABEL_LENGTH = 34


@dataclass(frozen=True)
class Sweep:
    """Strategies that differ by the values of keys, as ``--vary`` names them.

    Attributes
    ----------
    key : str
        What is drawn along the axis: the key with the most values.
    values : tuple of str
        Its values with unit or x, ascending if they are numbers, otherwise in order of appearance.
    numbers : tuple of float or None
        The values in ``unit``, if all of them are numbers of that one unit.
    unit : str
        Unit of the numbers; ``x`` for factors, empty for quantities that have none.
    lines : dict
        Index of the strategy at each value, by line: the base strategy with the values of the other keys.
    """

    key: str
    values: tuple[str, ...]
    numbers: tuple[float, ...] | None
    unit: str
    lines: dict[str, dict[str, int]]

    @property
    def title(self) -> str:
        """The key with its unit, for an axis."""
        return f"{self.key} ({self.unit})" if self.numbers is not None and self.unit else self.key


def looks_of(strategies: Sequence[StrategyOutcome]) -> list[tuple[str, str]]:
    """Return colour and marker of each strategy.

    Up to 8 differ; of more, those of one line of a sweep look alike, and without a sweep all do: their rows are named.
    """
    n = len(strategies)
    sweep = sweep_of(strategies) if n > FEW else None
    if n <= FEW:
        return list(BAND_STYLE[:n])
    if sweep is None or len(sweep.lines) > FEW:
        return [BAND_STYLE[0]] * n
    lines = {i: line for line, members in enumerate(sweep.lines.values()) for i in members.values()}
    return [BAND_STYLE[lines[i]] for i in range(n)]


def sweep_of(strategies: Sequence[StrategyOutcome]) -> Sweep | None:
    """Return what varies where all strategies have values of the same keys; otherwise none."""
    parsed = [(item.base, {setting.name: setting for setting in item.varied}) for item in strategies]
    keys = list(parsed[0][1]) if parsed else []
    if not keys or any(list(values) != keys for _, values in parsed):
        return None
    seen = {key: {values[key].text: values[key] for _, values in parsed} for key in keys}
    key = max(keys, key=lambda name: len(seen[name]))
    if len(seen[key]) < 2:
        return None
    lines: dict[str, dict[str, int]] = {}
    for index, (base, values) in enumerate(parsed):
        rest = " ".join(values[name].label for name in keys if name != key and len(seen[name]) > 1)
        lines.setdefault(f"{base} {rest}".strip(), {})[values[key].text] = index
    texts, settings = list(seen[key]), list(seen[key].values())
    units = {"x" if item.text.startswith("x") and not item.unit else item.unit for item in settings}
    found = [_number(item.value) for item in settings]
    if None in found or len(units) > 1:
        return Sweep(key, tuple(texts), None, "", lines)
    ordered = sorted(zip(found, texts, strict=True))
    return Sweep(
        key,
        tuple(text for _, text in ordered),
        tuple(float(value) for value, _ in ordered),  # type: ignore[arg-type]
        units.pop(),
        lines,
    )


def _number(value: Any) -> float | None:
    """A number, or the only one of a list; None for anything else."""
    if isinstance(value, list | tuple) and len(value) == 1:
        return _number(value[0])
    plain = isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
    return float(value) if plain else None


def plain_log_axis(axes: Axes) -> None:
    """Make the x axis logarithmic, with few ticks that are written as everyday numbers."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    axes.set_xscale("log")
    low, high = axes.get_xlim()
    wide = high > 40.0 * low
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0,) if wide else (1.0, 2.0, 5.0), numticks=12))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())


def row_label(name: str) -> str:
    """Return the name of a strategy for an axis: cut in its middle if long, for names differ at both ends."""
    if len(name) > _LABEL_LENGTH:
        half = (_LABEL_LENGTH - 1) // 2
        name = f"{name[:half]}…{name[-half:]}"
    return literal(name)


def shown_rows(strategies: Sequence[StrategyOutcome], most: int = MOST_ROWS) -> list[int]:
    """Return which strategies a figure shows: all, or the first one and those that find most, in order."""
    best = sorted(range(1, len(strategies)), key=lambda i: (-strategies[i].planets.mean, i))
    return sorted([0, *best[: most - 1]])


def left_out(strategies: Sequence[StrategyOutcome], most: int = MOST_ROWS) -> str:
    """Return the sentence that says which strategies a figure shows; empty if it shows all."""
    if len(strategies) <= most:
        return ""
    return f" Shown are the first strategy and the {most - 1} of all {len(strategies)} that find most."
