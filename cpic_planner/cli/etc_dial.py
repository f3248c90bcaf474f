"""The dial of ``cpic etc``: its options, and the check of answers in images."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

import typer

from catalogs.errors import InputError
from cpic_planner.cli.options import Tier
from cpic_planner.cli.output import progress
from cpic_planner.cli.strategy_options import refuse_together
from cpic_planner.etc.fidelity import etc_dial
from simulator.knobs import Dial

if TYPE_CHECKING:
    from cpic_planner.etc.answer import EtcAnswer
    from cpic_planner.etc.model import EtcModel
    from cpic_planner.etc.planet import ReferencePlanet
    from cpic_planner.targets import Targets

__all__ = ["EtcCheck", "EtcFidelityOption", "EtcRealisationsOption", "EtcSeedOption", "EtcToleranceOption"]

EtcFidelityOption: TypeAlias = Annotated[
    Tier | None, typer.Option("--fidelity", help="Closed forms alone, or checked in images [default: quick].")
]
EtcToleranceOption: TypeAlias = Annotated[
    float | None,
    typer.Option(
        "--tolerance",
        help="Instead of --fidelity: images only where the stated error of planet flux or SNR exceeds this, 0 to 0.5.",
    ),
]
EtcRealisationsOption: TypeAlias = Annotated[
    int | None,
    typer.Option(
        "--realisations",
        min=1,
        max=100_000,
        help="Draws of the images of each answer [default: what tells the SNR to 5 %].",
    ),
]
EtcSeedOption: TypeAlias = Annotated[int | None, typer.Option("--seed", min=0, help="Seed of the images [default: 1].")]


@dataclass(frozen=True)
class EtcCheck:
    """Setting of the dial, and how images are drawn; made by `of`."""

    dial: Dial
    realisations: int | None
    seed: int

    @classmethod
    def of(cls, fidelity: Tier | None, tolerance: float | None, realisations: int | None, seed: int | None) -> EtcCheck:
        """From options; those of images without images are refused."""
        refuse_together({"--tolerance": tolerance, "--fidelity": fidelity}, "they are two names of one dial")
        try:
            dial = etc_dial(None if fidelity is None else fidelity.value, tolerance)
        except InputError as error:
            raise InputError(f"--{error.key}", error.value, allowed=error.allowed, hint=error.hint) from None
        tiers = "--fidelity standard or reference"
        for name, value, allowed, there in (
            ("--realisations", realisations, tiers, dial.fidelity in ("standard", "reference")),
            ("--seed", seed, f"{tiers}, or --tolerance", dial.fidelity != "quick"),
        ):
            if value is not None and not there:
                raise InputError(name, value, allowed=f"together with {allowed}")
        return cls(dial, realisations, 1 if seed is None else seed)

    @property
    def asked(self) -> dict[str, Any]:
        """What decides the images, for hashes; nothing for closed forms alone."""
        if self.dial.fidelity == "quick":
            return {}
        return {"dial": self.dial.model_dump(mode="json"), "realisations": self.realisations, "seed": self.seed}

    def checked(
        self, model: EtcModel, star: Targets, answers: Sequence[EtcAnswer], planet: ReferencePlanet | None
    ) -> list[EtcAnswer]:
        """The answers about one star, checked in images where the dial asks for it, with a bar of progress.

        ``planet`` None: a grey one of the contrast of each answer.
        """
        if self.dial.fidelity == "quick":
            return list(answers)
        from cpic_planner.etc_check import checked_answers, needs_images

        every = len(answers)
        total = 100 * sum(needs_images(answer, self.dial) for answer in answers)
        with progress("images, per cent", total=total, enabled=total > 0) as advance:
            return checked_answers(
                model,
                [star] * every,
                answers,
                [planet] * every,
                self.dial,
                seed=self.seed,
                realisations=self.realisations,
                advance=advance,
            )
