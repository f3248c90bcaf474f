"""What the search finds, as words and tables."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from reports.paper.paper_table1 import search
from reports.paper.paper_table1.measure import instrument
from reports.paper.paper_table1.search import AGREES, BANDS, Choice, FloatArray, Found
from tools.report_parts import bulleted

Table = tuple[list[str], list[list[str]]]
N_PAIRS = 10  # of the table


@dataclass(frozen=True)
class Searched:
    """Everything found; `singles` and `all_pairs` of all values, `pairs` of those held possible; the best first."""

    readings: list[Found]
    choices: list[Choice]
    needed: list[FloatArray]
    singles: list[Found]
    pairs: list[Found]
    all_pairs: list[Found]

    @property
    def fitting(self) -> list[Found]:
        """Pairs that make all four ratios those of Table 1."""
        return [one for one in self.pairs if one.worst <= AGREES]


def searched() -> Searched:
    """Search, which takes seconds."""
    many = search.choices()
    return Searched(
        readings=[search.of_variant(name) for name in search.variants()],
        choices=many,
        needed=[search.needed(one, {}) for one in many],
        singles=[search.best((one,), {}, held=False) for one in many],
        pairs=search.pairs({}, held=True),
        all_pairs=search.pairs({}, held=False),
    )


def _digits(value: float) -> str:
    """Three digits, never a power of ten."""
    return "none" if np.isnan(value) else f"{float(f'{value:.3g}'):.10g}"


def _valued(found: Found, by_name: dict[str, Choice]) -> str:
    """Choices with their values."""
    with_value = [name for name in found.names if name in by_name]
    parts = [name for name in found.names if name not in by_name]
    parts += [
        f"{name}: {_digits(value)} {by_name[name].unit}".strip()
        for name, value in zip(with_value, found.values, strict=True)
    ]
    return "; ".join(parts)


def _ratios(found: Found) -> list[str]:
    return [
        *(f"{over:.2f}" for over in found.over),
        f"{found.worst:.0%}" if found.worst >= 0.1 else f"{found.worst:.1%}",
    ]


def reading_rows(found: Searched) -> Table:
    """Other readings of the text."""
    return ["reading", *BANDS, "worst"], [[*one.names, *_ratios(one)] for one in found.readings]


def pair_rows(found: Searched) -> Table:
    """The best pairs."""
    by_name = {one.name: one for one in found.choices}
    shown = found.pairs[: max(N_PAIRS, len(found.fitting) + 1)]
    return ["pair", *BANDS, "worst"], [[_valued(one, by_name), *_ratios(one)] for one in shown]


def conclusion(found: Searched) -> str:
    """What follows; refuses to be written where it no longer does."""
    now, best = found.readings[0], min(found.singles, key=lambda one: one.worst)
    by_name, wider = {one.name: one for one in found.choices}, "width of F850"
    assert best.worst > AGREES, "a choice explains the table: say which"
    assert all(wider in one.names for one in found.all_pairs if one.worst <= AGREES), "other pairs fit too: say which"
    widths = [one.values[one.names.index(wider)] for one in found.fitting]
    others = [next(name for name in one.names if name != wider) for one in found.fitting]
    asked = {choice.name: needed for choice, needed in zip(found.choices, found.needed, strict=True)}
    wide, read = (", ".join(_digits(value) for value in asked[name]) for name in (search.WIDE, search.READ_NOISE))
    assumed = instrument().band("F850").width_nm
    mean_frame = next(one for one in found.readings if one.names[0] == search.MEAN_FRAME)
    points = [
        f"**No single choice explains all four rows.** At the contrasts of Table 1 our ratios are {now.over.min():.2f} "
        f"to {now.over.max():.2f} times the paper's. The best of {len(found.choices)} choices, whatever its value, "
        f"leaves one row {best.worst:.0%} off ({_valued(best, by_name)}). What acts on all bands alike leaves "
        f"what the rows differ by, and that hangs on the widths of the bands, four numbers that are not published.",
        f"**The odd row is F850.** The other three ask for nearly the same: in the order of the bands, a circle with a "
        f"radius of {wide} λ/D, or a read noise of {read} e-.",
        f"**Of {len(found.pairs)} pairs {len(found.fitting)} fit within {AGREES:.0%}, each with F850 "
        f"{min(widths):.0f} to {max(widths):.0f} nm wide instead of {assumed:g}** and one of: "
        f"{'; '.join(others)}. No values of any other pair fit, possible or not. These cannot be told apart, and two "
        f"free numbers for four ratios prove none of them.",
        f'"17 x 30 s" as 17 frames of 30 s, or as 17 s in all, makes the rows differ more. Counts of the mean frame '
        f"put into Eq. 4, which holds for sums, come within {mean_frame.worst:.0%} without any free number.",
        "What the authors would have to state: the widths and throughputs of the bands, gain and read noise, and the "
        "radius of the aperture.",
    ]
    return bulleted(points)
