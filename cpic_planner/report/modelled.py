"""What was modelled, for people: the dial in words, and one table of the effect ledger for each distinct content."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from cpic_planner.models import BandConfirmation, ConfirmResult, EffectRecord, ModellingRecord, PlanResult
from cpic_planner.report.numbers import significant
from simulator.knobs import Quantity

QUANTITIES: dict[Quantity, str] = {"planet_flux": "planet flux", "snr": "SNR", "pixel_map": "pixels of a frame"}
"""Names of the quantities that errors refer to."""
_REGIONS = {"hole": "pixels around the dark hole", "full": "whole frames, of which the dark hole is kept"}
_DRAWS = {"sums": "sums of frames over the dark hole", "frames": "every frame, one by one"}
_COARSER = ("wavelength_nodes", "pixel_nodes", "precision", "drift_epochs", "pupil_samples")
_LEAST = 1e-6


@dataclass(frozen=True)
class ModelledRow:
    """One effect of a table.

    Attributes
    ----------
    effect : EffectRecord
        With its largest size.
    where : str
        Image set in which it is that large; empty where all are alike.
    size : str
        In per cent.
    word : str
        What became of it.
    """

    effect: EffectRecord
    where: str
    size: str
    word: str


@dataclass(frozen=True)
class ModelledGroup:
    """Image sets that are made alike.

    Attributes
    ----------
    title : str
        How they are made.
    members : str
        Their names.
    knobs, errors : str
        Settings of the optics; largest predicted errors, and what was asked for.
    rows : tuple of ModelledRow
        Largest size first.
    """

    title: str
    members: str
    knobs: str
    errors: str
    rows: tuple[ModelledRow, ...]


def dial_text(result: PlanResult | ConfirmResult) -> str:
    """Return the setting of the dial in words: ``fidelity standard``, ``tolerance 2 %``."""
    if result.fidelity == "custom" and result.tolerance:
        return f"tolerance {_percent(max(result.tolerance.values()))}"
    return f"fidelity {result.fidelity}"


def error_text(errors: Mapping[Quantity, float | None]) -> str:
    """Return errors of quantities in words."""
    return ", ".join(f"{QUANTITIES[name]} {_percent(value)}" for name, value in errors.items())


def modelled_sentence(bands: Iterable[BandConfirmation]) -> str:
    """Return how images were drawn and the largest error that is predicted of them; empty without images."""
    made = [band.modelled for band in bands if band.modelled is not None and band.status != "invalid"]
    if not made:
        return ""
    ways = " and ".join(dict.fromkeys(_DRAWS[item.draw] for item in sorted(made, key=lambda item: item.draw)))
    return f"Images: {ways}; predicted error beside the reference: {error_text(_largest(made))}."


def modelled_groups(named: Sequence[tuple[str, ModellingRecord]]) -> list[ModelledGroup]:
    """Return one table for every distinct way to make images.

    Parameters
    ----------
    named : sequence of (str, ModellingRecord)
        Name of each image set, and how it was made. Sets that differ in nothing but sizes share a table, which shows
        the largest.
    """
    groups: dict[tuple[object, ...], list[tuple[str, ModellingRecord]]] = {}
    for name, record in named:
        kept = tuple((row.effect, row.decision) for row in record.effects)
        content = (record.draw, record.region, record.epochs, record.knobs.content_hash, kept)
        groups.setdefault(content, []).append((name, record))
    return [_group(members) for members in groups.values()]


def _group(members: list[tuple[str, ModellingRecord]]) -> ModelledGroup:
    record = members[0][1]
    found = _largest([item for _, item in members])
    asked = f" (asked: at most {error_text(record.tolerance)})" if any(record.tolerance.values()) else ""
    knobs = record.knobs
    rows = [_row(index, members) for index in range(len(record.effects))]
    ways = _DRAWS[record.draw]
    return ModelledGroup(
        title=ways[:1].upper() + ways[1:],
        members=", ".join(dict.fromkeys(name for name, _ in members)),
        knobs=f"{_REGIONS[record.region]}; {knobs.pupil_samples} samples across the pupil, {knobs.wavelength_nodes} "
        f"wavelength{'s' * (knobs.wavelength_nodes != 1)} a band, {knobs.pixel_nodes} × {knobs.pixel_nodes} nodes a "
        f"pixel, {knobs.precision} precision; wavefront at {record.epochs} epoch{'s' * (record.epochs != 1)} a visit",
        errors=f"{error_text(found)}{asked}",
        rows=tuple(sorted(rows, key=lambda row: -_order(row.effect))),
    )


def _row(index: int, members: list[tuple[str, ModellingRecord]]) -> ModelledRow:
    name, record = max(members, key=lambda member: _order(member[1].effects[index]))
    sizes = {item.effects[index].size for _, item in members}
    row = record.effects[index]
    size = "" if row.size is None else _percent(row.size)
    return ModelledRow(row, name if len(sizes) > 1 else "", size, _word(row))


def _word(row: EffectRecord) -> str:
    if row.decision == "kept":
        return "kept"
    if row.key in _COARSER:
        return "coarser"
    return "as sums" if row.key == "summed_frames" else "left out"


def _order(row: EffectRecord) -> float:
    """Rows without a size are kept whatever happens: they stand behind those with one, before what is not there."""
    return row.size if row.size else 0.5 * _LEAST * _LEAST if row.size is None else 0.0


def _largest(records: Iterable[ModellingRecord]) -> dict[Quantity, float | None]:
    largest: dict[Quantity, float | None] = {}
    for record in records:
        for name, value in record.predicted_error.items():
            before = largest.get(name, 0.0)
            largest[name] = None if value is None or before is None else max(value, before)
    return largest


def _percent(value: float | None) -> str:
    if value is None:
        return "without a bound"
    if 0 < value < _LEAST:
        return f"below {100 * _LEAST:g} %"
    return f"{significant(100.0 * value, 2)} %"
