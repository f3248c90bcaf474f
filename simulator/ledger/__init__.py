"""The effect ledger: what an observation models, what it leaves out, and how large that is predicted to be."""

from __future__ import annotations

from simulator.ledger.choice import SUM_EPOCHS, Choice, budget_of, choose, error_of
from simulator.ledger.inventory import camera_ledger, effect_ledger, not_modelled, sky_ledger
from simulator.ledger.prediction import MAX_EPOCHS, Forecast, forecast
from simulator.ledger.rows import EffectRow

__all__ = [
    "MAX_EPOCHS",
    "SUM_EPOCHS",
    "Choice",
    "EffectRow",
    "Forecast",
    "budget_of",
    "camera_ledger",
    "choose",
    "effect_ledger",
    "error_of",
    "forecast",
    "not_modelled",
    "sky_ledger",
]
