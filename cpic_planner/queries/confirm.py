"""The question of ``cpic confirm``: what simulated images of a scene show."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, ClassVar

from pydantic import Field, model_validator

from catalogs.errors import InputError
from catalogs.names import resolve_star
from cpic_planner.queries.base import Parts, called
from cpic_planner.queries.fields import asked
from cpic_planner.queries.images import ImageQuestion, audited
from cpic_planner.queries.shared import OnOff, RunQuestion
from simulator.config import Scene, load_scene

MAX_FRAMES = 4000
"""Frames of one sequence that are held in memory at once (0.6 GB of stamps)."""


class SceneParts(Parts):
    """Options of a scene."""

    scene: str = asked(..., "Scene: a preset or a YAML file.", argument=True)
    companions: OnOff | None = asked(
        None, "Put the scene's companions on the images.", default_words="as the scene says"
    )

    def made(self, base: Any) -> Scene:
        """Return the scene, with or without its companions."""
        chosen = _scene(self.scene)
        return chosen if self.companions is None else chosen.model_copy(update={"companions": self.companions})


def _scene(source: str) -> Scene:
    """Scene of a preset or a file; says what to do with the name of a star."""
    try:
        return load_scene(source)
    except InputError as error:
        if error.key != "scene" or Path(source).exists():
            raise
        try:
            resolve_star(source)
        except InputError:
            raise error from None
        raise InputError(
            error.key,
            source,
            allowed=error.allowed,
            hint="this is a star of the catalogue: write a scene with it as cstar, or see cpic plan",
        ) from None


class ConfirmQuestion(ImageQuestion, RunQuestion):
    """Everything that decides the confirmation of a scene.

    Frames are given by ``exposure_s`` and ``n_frames``, or are the best within ``time_s`` of wall time for the first
    planet of the scene (of 1e-8 at the middle of the hole where it has none). A gain that is not given is the best one.
    ``audit`` None: as `cpic_planner.queries.images.audited` says.
    """

    KIND: ClassVar[str] = "confirm"

    scene: Scene = asked(
        ...,
        "The scene, with any number of planets and other stars; what `simulator.load_scene` reads.",
        parts=SceneParts,
        read=load_scene,
        accepts="Scene, mapping, str or Path",
    )
    time_s: Annotated[float, Field(ge=1e-3, le=1e9)] | None = asked(
        None,
        "Wall time per band, readouts and reference frames included.",
        default_words="36000",
    )
    exposure_s: Annotated[float, Field(ge=1e-6, le=1e6)] | None = asked(None, "Exposure of one frame.")
    n_frames: Annotated[int, Field(ge=1, le=MAX_FRAMES)] | None = asked(
        None, "Science frames; needs {exposure_s}.", option="--frames"
    )
    em_gain: Annotated[float, Field(ge=1, le=1e4)] | None = asked(None, "Actual EM gain.", default_words="the best one")
    audit: bool | None = asked(
        None,
        "Run one more realisation frame by frame, with every effect.",
        default_words="with {fidelity} standard",
    )
    out: Path | None = asked(None, "Output folder.", default_words="print only", physics=False)

    @model_validator(mode="after")
    def _frames(self) -> ConfirmQuestion:
        if self.time_s is not None and self.n_frames is not None:
            raise InputError(
                "n_frames", self.n_frames, allowed=f"without {called('time_s')}", hint="the time sets their number"
            )
        if self.n_frames is not None and self.exposure_s is None:
            raise InputError("n_frames", self.n_frames, allowed=f"together with {called('exposure_s')}")
        if self.exposure_s is not None and self.n_frames is None and self.time_s is None:
            raise InputError(
                "exposure_s",
                self.exposure_s,
                unit="s",
                allowed=f"together with {called('n_frames')} or {called('time_s')}",
            )
        if self.force and self.out is None:
            raise InputError("force", "given", allowed=f"together with {called('out')}")
        audited(self.dial, self.audit)
        return self
