"""What a simulation costs before it is run: time, memory and disk from the number and size of its frames."""

from __future__ import annotations

import math
from collections.abc import Sequence

from cpic_planner.simulation.sequences import PlannedSequence

__all__ = ["Cost", "disk_bytes", "estimate_cost"]
