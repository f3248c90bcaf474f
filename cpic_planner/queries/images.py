"""What decides images that are measured; the part that a plan, a scene and single stars share."""

from __future__ import annotations

from typing import Any, ClassVar

from pydantic import model_validator

from catalogs.errors import InputError
from cpic_planner.overrides import SimulatorOverrides
from cpic_planner.queries.fields import asked
from cpic_planner.queries.planet import ReferencePlanet
from cpic_planner.queries.shared import (
    MAX_REALISATIONS,
    Fidelity,
    InstrumentQuestion,
    RunQuestion,
    Seed,
    StarsQuestion,
    Texts,
)
from cpic_planner.queries.strategy import Reduction, Strategy
from simulator.knobs import Dial, dial_of

REALISATIONS = 8
"""Draws of drift and noise of every target and band: an SNR of 10 from 12 apertures is then known to 9 %."""


class ImageQuestion(InstrumentQuestion):
    """What decides images that are measured.

    ``fidelity`` or ``tolerance`` set the dial of speed against accuracy, ``standard`` without any.
    ``simulator_overrides`` alter the images alone.
    """

    strategy: Strategy = asked(
        Strategy(),
        "How the observation is made and reduced; photon counting is predicted, not yet measured in images.",
        group=Reduction,
        accepts="Strategy or mapping, optional",
    )
    realisations: int = asked(
        REALISATIONS,
        "Made-up observations of every planet and band, each with its own drift and noise.",
        ge=1,
        le=MAX_REALISATIONS,
    )
    simulator_overrides: SimulatorOverrides = asked(
        SimulatorOverrides(),
        "Alter the simulator alone, as throughput=x0.7, companions=on or detector.cic_e=0.05; repeat for several. Or a "
        "YAML file.",
        metavar="KEY=VALUE",
        several=True,
        option="--simulator-overrides",
        accepts="mapping, str, Path or sequence, optional",
    )
    fidelity: Fidelity | None = asked(
        None,
        "Speed against accuracy of the images.",
        default_words="standard",
    )
    tolerance: float | None = asked(
        None,
        "Instead of {fidelity}: the cheapest images whose planet flux and SNR are predicted to be this close to the "
        "reference, 0 to 0.5.",
    )
    seed: Seed = asked(1, "Seed of every random number.")

    @classmethod
    def _read(cls, tree: dict[str, Any]) -> dict[str, Any]:
        tree = super()._read(tree)
        if "simulator_overrides" in tree:
            tree["simulator_overrides"] = SimulatorOverrides.of(tree["simulator_overrides"], tree.get("instrument"))
        return tree

    @model_validator(mode="after")
    def _imaged(self) -> ImageQuestion:
        refuse_counting(self.strategy)
        self.simulator_overrides.instrument(self.instrument)  # refuses unknown keys
        self.refuse_together(("tolerance", "fidelity"), "they are two names of one dial")
        dial_of(self.fidelity, self.tolerance)
        return self

    @property
    def dial(self) -> Dial:
        """Speed against accuracy."""
        return dial_of(self.fidelity, self.tolerance)

    def hashed(self) -> dict[str, Any]:
        """Return what decides numbers; the dial by what it does, not by the name that it was given."""
        tree = super().hashed()
        del tree["fidelity"], tree["tolerance"]
        return tree | {"dial": self.dial.model_dump(mode="json")}

    @property
    def image_settings(self) -> dict[str, Any]:
        """Settings of `cpic_planner.validation.task.task_of`."""
        return {
            "seed": self.seed,
            "fidelity": self.fidelity,
            "tolerance": self.tolerance,
            "realisations": self.realisations,
            "overrides": self.simulator_overrides,
        }


class StarImagesQuestion(ImageQuestion, StarsQuestion, RunQuestion):
    """Images of named stars, each with its reference planet at the best separation."""

    KIND: ClassVar[str] = "confirm_targets"

    target: Texts = asked(..., "Star names.", accepts="str or sequence of str")
    time_s: float = asked(
        36000.0, "Wall time per target and band, readouts and reference frames included.", ge=1e-3, le=1e9
    )
    planet: ReferencePlanet = asked(
        ReferencePlanet(), "The reference planet.", accepts="ReferencePlanet or mapping, optional"
    )


def audited(dial: Dial, asked_for: bool | None = None) -> bool:
    """Whether one more realisation runs frame by frame beside those that are drawn as sums.

    Parameters
    ----------
    dial : Dial
    asked_for : bool, optional
        What was asked for; ``standard`` has an audit and no other setting without.

    Raises
    ------
    InputError
        Where one is asked of the reference.
    """
    if asked_for and dial.fidelity == "reference":
        raise InputError(
            "audit",
            "given",
            allowed="quick, standard or a tolerance",
            hint="the reference runs every realisation frame by frame",
        )
    return dial.fidelity == "standard" if asked_for is None else asked_for


def refuse_counting(strategy: Strategy) -> None:
    """Refuse photon counting, which is predicted but not measured in images.

    Raises
    ------
    InputError
        Naming the mode.
    """
    if strategy.mode != "analogue":
        raise InputError(
            "strategy.mode",
            strategy.mode,
            allowed="analogue",
            hint="photon counting is predicted, not yet measured in images",
        )
