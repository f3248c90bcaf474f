"""The ways to an answer that are measured on every fixed scene."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

from catalogs.errors import InputError
from cpic_planner.tradeoff.scenes import FixedScene
from cpic_planner.tradeoff.setup import REFERENCE_EPOCHS, Setup, reference_setup
from simulator.knobs import FIDELITIES
from simulator.ledger import MAX_EPOCHS, SUM_EPOCHS

Group = Literal["closed_form", "images", "tier", "tolerance", "knob", "effect"]
REFERENCE = "reference"
TOLERANCES_MEASURED = (0.003, 0.01, 0.03, 0.1, 0.3)
QUICK_EPOCHS = 2


@dataclass(frozen=True)
class Point:
    """One way to an answer.

    Attributes
    ----------
    name, title : str
    group : str
        ``closed_form``: the exposure-time calculator; ``images``: images made in a stated way; ``tier`` and
        ``tolerance``: what the effect ledger chooses for a dial; ``knob`` and ``effect``: the reference with one thing
        changed.
    n_cases : int
        Questions that one call answers.
    fidelity, tolerance
        Of the dial.
    setup : Setup or None
        What is modelled, where the ledger does not decide it.
    light_changes : bool
        Whether the light on the detector differs from the reference's.
    """

    name: str
    title: str
    group: Group
    n_cases: int = 1
    fidelity: str | None = None
    tolerance: float | None = None
    setup: Setup | None = None
    light_changes: bool = True

    @property
    def shares_process(self) -> bool:
        """Whether it is measured beside others of its kind in one process."""
        return self.group in ("knob", "effect")


def points_of(case: FixedScene) -> tuple[Point, ...]:
    """Every way that is tried on a scene, those that it will refuse included."""
    return (*_main(case), *_knobs(case), *_effects(case))


_STATED: tuple[tuple[Literal["sums", "frames"], Literal["hole", "full"], str, int], ...] = (
    ("sums", "hole", "quick", QUICK_EPOCHS),
    ("sums", "hole", "standard", SUM_EPOCHS),
    ("frames", "hole", "quick", QUICK_EPOCHS),
    ("frames", "hole", "standard", MAX_EPOCHS),
    ("frames", "full", "standard", MAX_EPOCHS),
)
"""Images that are made in a stated way: what is drawn, of which pixels, by whose knobs, with how many wavefronts."""
_STATED_NAMES = {
    ("sums", "hole"): ("sums", "sums of frames"),
    ("frames", "hole"): ("hole", "frames over the hole"),
    ("frames", "full"): ("full", "whole frames"),
}


def _main(case: FixedScene) -> list[Point]:
    points = [
        Point(REFERENCE, "reference: whole frames, all effects, finest knobs", "tier", setup=reference_setup(case)),
        Point("etc", "closed form, one call", "closed_form"),
        Point("etc_many", "closed form, per case of 10 000 in one call", "closed_form", n_cases=10_000),
    ]
    for draw, region, fidelity, epochs in _STATED:
        name, title = _STATED_NAMES[draw, region]
        setup = Setup(draw, region, FIDELITIES[fidelity], epochs, scene_model=case.scene_model)
        points.append(Point(f"{name}_{fidelity}", f"{title}, {fidelity} knobs", "images", setup=setup))
    points += [Point(name, f"--fidelity {name}", "tier", fidelity=name) for name in ("quick", "standard")]
    points += [
        Point(f"tolerance_{value:g}", f"--tolerance {value:g}", "tolerance", tolerance=value)
        for value in TOLERANCES_MEASURED
    ]
    return points


def _knobs(case: FixedScene) -> list[Point]:
    best = reference_setup(case)

    def one(name: str, title: str, **changes: Any) -> Point:
        knobs = {key: changes.pop(key) for key in tuple(changes) if key in type(best.knobs).model_fields}
        setup = best.changed(knobs=best.knobs.model_copy(update=knobs), **changes)
        return Point(name, title, "knob", setup=setup)

    epochs = [count for count in (1, 2, 4) if count < min(case.n_frames, REFERENCE_EPOCHS)]
    other = "exact" if case.scene_model == "paper" else "paper"
    return [
        *(one(f"wavelengths_{n}", f"{n} wavelengths a band", wavelength_nodes=n) for n in (1, 2, 3, 4, 5)),
        *(one(f"pixel_nodes_{n}", f"{n} x {n} nodes a pixel", pixel_nodes=n) for n in (1, 2, 3, 4)),
        one("single", "single precision", precision="single"),
        *(one(f"pupil_{n}", f"{n} samples across the pupil", pupil_samples=n) for n in (64, 128)),
        *(one(f"epochs_{n}", f"{n} wavefront{'s' * (n > 1)} a visit", epochs=n) for n in epochs),
        one("window", "window around the hole", region="hole"),
        one(f"{other}_scene", f"{other} scene model", scene_model=other),
    ]


def _effects(case: FixedScene) -> list[Point]:
    best, instrument, scene = reference_setup(case), case.instrument, case.scene
    switches = instrument.detector_of(case.band).switches
    points = [
        Point(
            f"no_{name}",
            f"without {name.replace('_', ' ')}",
            "effect",
            light_changes=False,
            setup=best.changed(switches={name: False}),
        )
        for name, on in switches.model_dump().items()
        if on
    ]
    points.append(Point("no_sky", "without sky", "effect", setup=best.changed(sky=False)))
    points.append(Point("no_drift", "without drift of the wavefront", "effect", setup=best.changed(drift=False)))
    if scene.stars:
        names = tuple(star.name for star in scene.stars)
        points.append(Point("no_other_stars", "without other stars", "effect", setup=best.changed(left_out=names)))
    return points


def named_points(case: FixedScene, names: tuple[str, ...], *, main_only: bool = False) -> tuple[Point, ...]:
    """Those of a scene with some names; all without any.

    Raises
    ------
    InputError
        For a name that no point of the scene has.
    """
    points = tuple(_main(case)) if main_only else points_of(case)
    known = {point.name for point in points}
    for name in names:
        if name not in known:
            raise InputError("--only", name, allowed=f"a point of {case.name}: {', '.join(sorted(known))}")
    return tuple(point for point in points if not names or point.name in names)
