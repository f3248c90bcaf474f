"""From answers to the result that leaves the program."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from cpic_planner.etc.answer import EtcAnswer
from cpic_planner.etc.detection import default_law
from cpic_planner.etc.fidelity import etc_dial, etc_fidelity
from cpic_planner.etc.model import EtcModel
from cpic_planner.etc.planet import ReferencePlanet
from cpic_planner.models import EtcResult, ReferencePlanetRecord
from cpic_planner.targets import Targets
from cpic_planner.version import __version__
from simulator.config import content_hash
from simulator.knobs import Dial

__all__ = ["best_band", "etc_result"]


def best_band(answers: Sequence[EtcAnswer]) -> str | None:
    """Band of the best answer: least time, highest significance over threshold, or faintest limit."""
    good = [answer for answer in answers if answer.value is not None]
    if not good:
        return None
    if good[0].question in ("exposure_time", "contrast_limit"):
        return min(good, key=lambda answer: answer.value or np.inf).band
    return max(good, key=lambda answer: (answer.significance or 0.0) / (answer.threshold or np.inf)).band


def etc_result(
    model: EtcModel,
    target: Targets,
    answers: Sequence[EtcAnswer],
    *,
    note: str,
    planet: ReferencePlanet | None,
    asked: Mapping[str, Any],
    catalogue: str,
    dial: Dial | None = None,
    seed: int | None = None,
) -> EtcResult:
    """Collect answers about one star of a catalogue, which is named by its provenance.

    ``dial`` and ``seed`` are those of the check in images, closed forms alone without.
    """
    record = None
    if planet is not None:
        record = ReferencePlanetRecord(
            radius_rjup=planet.radius_rjup, phase_deg=planet.phase_deg, albedo=planet.albedo.label
        )
    return EtcResult(
        config_hash=content_hash(
            {
                "kind": "etc",
                "version": __version__,
                "model": model.content(),
                "detection": default_law().model_dump(mode="json"),
                "target": target.content(),
                "planet": None if planet is None else planet.content(),
                "asked": asked,
            }
        ),
        target=str(target.name[0]),
        hip=int(target.hip[0]) if target.hip[0] else None,
        v_mag=float(target.v_mag[0]),
        distance_pc=float(target.distance_pc[0]),
        catalogue=catalogue,
        note=note,
        reference_planet=record,
        best_band=best_band(answers),
        answers=list(answers),
        fidelity=etc_fidelity(answers, dial or etc_dial(), seed=seed),
    )
