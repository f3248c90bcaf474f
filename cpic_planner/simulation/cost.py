"""What a simulation costs before it is run: time, memory and disk from the number and size of its frames."""

from __future__ import annotations

import math
from collections.abc import Sequence

from cpic_planner.jobs.job import Cost
from cpic_planner.models import ModellingRecord, PlannedSequenceRow, SimulationEstimate
from cpic_planner.simulation.modelled import modelled
from cpic_planner.simulation.sequences import PlannedSequence, check_light, plan_sequences
from simulator.config.simulation import SimulationConfig

_BLOCK = 2880
_START_S = 1.0  # libraries and compiled kernels, once in each process
_SETUP_S = {"sky": 0.6, "light": 0.4, "dark": 0.05}
_SOURCE_S = 0.7  # the light of a star off the axis at its own number of wavelengths
_MOST_SOURCES = 19  # more stars share numbers of wavelengths
_EPOCH_S = 0.06
_MOST_EPOCHS = 12
_FRAME_S_MPX = 0.06
_FRAME_S = 0.005
_RAY_S = 1e-4
_MEMORY_MB = 250.0
_MEMORY_MB_MPX = 150.0


def estimate(simulation: SimulationConfig, *, truth: bool = True, workers: int = 1) -> SimulationEstimate:
    """Sequences of a simulation, and what they would cost: wall time, memory of a worker, disk.

    Raises
    ------
    InputError
        As `cpic_planner.simulation.run.simulate`, for what can be known before frames are made.
    """
    planned = plan_sequences(simulation)
    check_light(planned)
    records = [modelled(item) for item in planned]
    return SimulationEstimate(
        name=simulation.name,
        n_sequences=len(planned),
        n_frames=sum(item.n_frames for item in planned),
        workers=workers,
        **sequences_cost(planned, records, truth=truth).at(workers),
        sequences=[
            PlannedSequenceRow(**item.row(), modelled=record) for item, record in zip(planned, records, strict=True)
        ],
    )


def sequences_cost(
    planned: Sequence[PlannedSequence], records: Sequence[ModellingRecord | None], *, truth: bool
) -> Cost:
    """Return the expected cost of sequences.

    Parameters
    ----------
    planned : sequence of PlannedSequence
    records : sequence of ModellingRecord or None
        What each models, see `cpic_planner.simulation.modelled.modelled`.
    truth : bool
        Whether the truth is written beside the products.
    """
    return Cost(
        counts={},
        times_s=[_time_s(item, record) for item, record in zip(planned, records, strict=True)],
        start_s=_START_S,
        pool_s=2.0 * _START_S,
        memory_mb=_MEMORY_MB + _MEMORY_MB_MPX * max(map(_n_pixels, planned)) / 1e6,
        disk_mb=sum(disk_bytes(item, truth=truth) for item in planned) / 1e6,
    )


def disk_bytes(item: PlannedSequence, *, truth: bool) -> int:
    """Bytes of the files of a sequence: exact for the images, a bound for compressed masks and logs."""
    pixels = _n_pixels(item)
    level0 = 6 * _BLOCK + item.n_frames * (_padded(2 * pixels) + 2 * _BLOCK)
    params = 75_000 + 300 * item.n_frames + 1000 * _n_sources(item)
    masks = item.n_frames * (_padded(0.02 * pixels) + 2 * _BLOCK)
    return level0 + params + (2 * _padded(4 * pixels) + 12 * _BLOCK + masks if truth else 0)


def _padded(size: float) -> int:
    return math.ceil(size / _BLOCK) * _BLOCK


def _n_pixels(item: PlannedSequence) -> int:
    detector = item.entry.instrument.channel(item.camera).detector
    return detector.n_rows * detector.n_columns


def _n_sources(item: PlannedSequence) -> int:
    """Stars off the axis, and one for planets and extended sources together."""
    scene = item.entry.scene
    if scene is None:
        return 0
    return sum(map(scene.is_lit, scene.stars)) + bool(scene.planets or scene.extended)


def _time_s(item: PlannedSequence, record: ModellingRecord | None) -> float:
    gone = {row.key for row in record.effects if row.decision == "skipped"} if record else set()
    instrument = item.entry.instrument
    detector = instrument.channel(item.camera).detector
    setup = _SETUP_S["sky" if item.on_sky else "light" if item.band else "dark"]
    if item.on_sky:
        sources = _n_sources(item) - sum(key.startswith("star:") for key in gone)
        epochs = min(item.n_frames, _MOST_EPOCHS) if record is None else record.epochs
        setup += _EPOCH_S * epochs + _SOURCE_S * min(sources, _MOST_SOURCES)
    megapixels = _n_pixels(item) / 1e6
    area_cm2 = megapixels * 1e6 * (detector.pixel_um * 1e-4) ** 2
    rays = instrument.cosmic_rays.peak_rate_per_s_cm2 * area_cm2 * item.exposure_s
    rays = 0.0 if "cosmic_rays" in gone else rays
    return setup + item.n_frames * (_FRAME_S + _FRAME_S_MPX * megapixels + _RAY_S * rays)
