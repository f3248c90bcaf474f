"""What a sequence leaves out for its tolerance, before its frames are made."""

from __future__ import annotations

from cpic_planner.models import ModellingRecord
from cpic_planner.simulation.sequences import PlannedSequence
from cpic_planner.validation.modelling import modelling_record
from simulator.knobs import FIDELITIES
from simulator.ledger.choice import Choice
from simulator.ledger.observed import observation_choice


def sequence_choice(item: PlannedSequence) -> Choice | None:
    """What `simulator.observe` decides for a sequence; None where nothing may be left out."""
    entry = item.entry
    if entry.scene is None or entry.tolerance == 0:
        return None
    return observation_choice(
        entry.scene,
        entry.instrument,
        tolerance=entry.tolerance,
        quantity=None,
        finest=FIDELITIES[entry.fidelity],
        full=True,
        band=item.band,
        exposure_s=item.exposure_s,
        n_frames=item.n_frames,
        em_gain=item.em_gain,
        roll_deg=entry.roll_deg,
        star_offset_arcsec=entry.star_offset_arcsec,
        scene_model=entry.scene_model,
        start_utc=item.start_utc,
        switches=entry.switches_for(item.camera),
    )


def modelled(item: PlannedSequence) -> ModellingRecord | None:
    """Record of what a sequence models and leaves out; None where nothing may be left out."""
    choice = sequence_choice(item)
    if choice is None:
        return None
    tolerance = dict.fromkeys(choice.predicted_error, item.entry.tolerance)
    return modelling_record(choice, fidelity="custom", tolerance=tolerance, draw="frames", region="full")
