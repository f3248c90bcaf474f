"""Fixed scenes on which speed and accuracy are measured, the ways to model them, and the machine.

The fixed scenes on which speed and accuracy are measured: one for each place where shortcuts can fail.
"""

import contextlib
import functools
import math
import os
import platform
from dataclasses import replace
from importlib import metadata
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import Field

from cpic_core import InputError, Record, load_yaml
from cpic_planner.queries import Strategy
from cpic_planner.results import MachineRecord, SceneFrames
from simulator.config import Instrument, Planet, Scene, content_hash, load_instrument, load_scene, validate
from simulator.imaging import SceneModel
from simulator.knobs import FIDELITIES
from simulator.ledger import MAX_EPOCHS, SUM_EPOCHS, Shortcuts


def this_machine() -> MachineRecord:
    """Return the processor, memory and software of this machine; nothing that names it."""
    from threadpoolctl import threadpool_info

    np.ones((2, 2)) @ np.ones((2, 2))
    libraries = [item for item in threadpool_info() if item["user_api"] == "blas"]
    blas = sorted({f"{item['internal_api']} {item['version']}" for item in libraries})
    tree = {
        "processor": _processor(),
        "cores": len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1,
        "memory_gb": _memory_gb(),
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        **{name: metadata.version(name) for name in ("numpy", "scipy", "numba")},
        "blas": ", ".join(blas) or "unknown",
        "blas_threads": 1,
    }
    return MachineRecord(key=content_hash(tree), **tree)


def _processor() -> str:
    with contextlib.suppress(OSError):
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


def _memory_gb() -> float:
    try:
        return round(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 1e9, 1)
    except (ValueError, OSError, AttributeError):
        return 0.0


PLANET = "planet"
ANNULUS_LAMBDA_D = 2.0
"""Half width of the annulus whose apertures measure the speckles of a single visit."""
_LIST = Path(__file__).resolve().parents[1] / "presets" / "tradeoff" / "scenes.yaml"
_ALBEDO, _RADIUS_AU = 0.5, 71492.0 / 149597870.7


class FixedScene(SceneFrames):
    """A scene with the frames that it is observed in.

    Attributes
    ----------
    tree : dict
        The scene, as `simulator.load_scene` reads it, or ``preset`` with what differs.
    detector : dict
        What differs from the default instrument's detector of the band.
    strategy : dict
        Of a programme of visits that are reduced as one: fields of `Strategy`, such as ``visits``,
        ``reference_visits``, ``n_modes`` and ``library``. Without any, one visit and one of the reference are
        compared frame by frame.
    """

    tree: dict[str, Any]
    detector: dict[str, Any] = Field(default_factory=dict)
    strategy: dict[str, Any] = Field(default_factory=dict)

    @property
    def is_programme(self) -> bool:
        """Whether visits are drawn many times and reduced as one."""
        return bool(self.strategy)

    @functools.cached_property
    def how(self) -> Strategy:
        """How it is observed and reduced."""
        own = dict(self.strategy) or {"annulus_lambda_d": ANNULUS_LAMBDA_D}
        return validate(Strategy, {"n_modes": 0, "visits": 1} | own, where="strategy")

    @property
    def visits(self) -> int:
        """Science visits."""
        return self.how.visits or 1

    @functools.cached_property
    def scene(self) -> Scene:
        """Star, planet and whatever else there is."""
        tree = dict(self.tree)
        if "preset" not in tree:
            return load_scene(tree)
        shown = load_scene(tree["preset"])
        planets = tuple(validate(Planet, body, where="planet") for body in tree["planets"])
        star = shown.cstar.model_copy(update={"v_mag": tree["v_mag"]})
        return shown.model_copy(update={"planets": planets, "cstar": star})

    @functools.cached_property
    def instrument(self) -> Instrument:
        """The default instrument, its detector as configured here."""
        instrument = load_instrument()
        if not self.detector:
            return instrument
        camera = "detector" if instrument.band(self.band).camera == "VIS" else "near_infrared"
        own = dict(self.detector)
        return instrument.changed({camera: own if camera == "detector" else {"detector": own}})


def _read(name: str, entry: dict[str, Any]) -> FixedScene:
    """Return a scene of the list, its planet as a body that has the contrast it is given."""
    entry = _ENTRIES.get(entry.get("like", ""), {}) | entry
    entry.pop("like", None)
    body = dict(entry.pop("planet"))  # scenes may share theirs
    distance_au = _RADIUS_AU * math.sqrt(_ALBEDO / (math.pi * body.pop("contrast")))
    planet = {"name": PLANET, "radius_rjup": 1.0, "phase_deg": 90.0, "albedo": _ALBEDO, "distance_au": distance_au}
    return FixedScene(name=name, **entry | {"tree": entry["tree"] | {"planets": [planet | body]}})


_ENTRIES: dict[str, dict[str, Any]] = load_yaml(_LIST)
SCENES = {name: _read(name, entry) for name, entry in _ENTRIES.items()}


def fixed_scene(name: str) -> FixedScene:
    """Return one of the scenes by name.

    Raises
    ------
    InputError
        If there is none of that name.
    """
    if name not in SCENES:
        raise InputError("--scene", name, allowed=", ".join(SCENES))
    return SCENES[name]


class Effort(Record):
    """The number of realisations for the noise, and the time of repeated calls.

    Attributes
    ----------
    budget_s : float
        Time for repeated calls.
    realisations : int
        From sums of frames.
    visits_by_frames : int
        Science visits of all realisations together where every frame is drawn; two realisations at least.
    changes : int
        Realisations of ways that share their random numbers, and change one thing of the reference.
    """

    budget_s: float = 1.5
    realisations: int = 48
    visits_by_frames: int = 24
    changes: int = 3

    def number_of(self, point: "Point", draw: str, visits: int) -> int:
        """Return the realisations of a way."""
        if draw == "sums":
            return self.realisations
        return self.changes if point.shares_process else max(2, self.visits_by_frames // visits)


FULL_EFFORT = Effort()
GLANCE = Effort(budget_s=0.0, realisations=3, visits_by_frames=2, changes=2)


SEED = 1
REFERENCE_EPOCHS = 1000
"""More than any visit has frames: one wavefront a frame."""


class Setup(Shortcuts):
    """Everything that a shortcut can change.

    Attributes
    ----------
    scene_model : {"exact", "paper"}
    """

    scene_model: SceneModel = "exact"

    def sky_of(self, instrument: Instrument) -> Instrument:
        """Return an instrument under the sky that is modelled."""
        return instrument if self.sky else _dark_sky(instrument)


def _dark_sky(instrument: Instrument) -> Instrument:
    """Return a sky without light in front of the telescope but the targets': 40 mag in every square arcsecond."""
    sky = instrument.sky
    lights = {"earthshine": sky.earthshine, "stray_light": sky.stray_light}
    dark = {name: light.model_copy(update={"brightness_v_mag_arcsec2": None}) for name, light in lights.items()}
    changes = dark | {"model": "uniform", "brightness_v_mag_arcsec2": 40.0}
    return instrument.model_copy(update={"sky": sky.model_copy(update=changes)})


def reference_setup(case: FixedScene) -> Setup:
    """Return everything: whole frames one by one, every effect, the finest knobs, a wavefront for every frame."""
    return Setup("frames", "full", FIDELITIES["reference"], REFERENCE_EPOCHS, scene_model=case.scene_model)


Group = Literal["closed_form", "images", "tier", "tolerance", "knob", "effect"]
REFERENCE = "reference"
TOLERANCES_MEASURED = (0.003, 0.01, 0.03, 0.1, 0.3)
QUICK_EPOCHS = 2


class Point(Record):
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
    """

    name: str
    title: str
    group: Group
    n_cases: int = 1
    fidelity: str | None = None
    tolerance: float | None = None
    setup: Setup | None = None

    @property
    def shares_process(self) -> bool:
        """Whether it is measured beside others of its kind in one process."""
        return self.group in ("knob", "effect")


def points_of(case: FixedScene, *, main_only: bool = False) -> tuple[Point, ...]:
    """Return every way that is tried on a scene, those that it will refuse included.

    Parameters
    ----------
    case : FixedScene
    main_only : bool
        Leave out the reference with one thing changed.
    """
    if case.is_programme or main_only:
        return tuple(_main(case))
    return (*_main(case), *_knobs(case), *_effects(case))


_STATED: tuple[tuple[str, str, Literal["sums", "frames"], Literal["hole", "full"], int], ...] = (
    ("sums_quick", "sums of frames", "sums", "hole", QUICK_EPOCHS),
    ("sums_standard", "sums of frames", "sums", "hole", SUM_EPOCHS),
    ("hole_quick", "frames over the hole", "frames", "hole", QUICK_EPOCHS),
    ("hole_standard", "frames over the hole", "frames", "hole", MAX_EPOCHS),
    ("full_standard", "whole frames", "frames", "full", MAX_EPOCHS),
)
"""Images made in a stated way: name with the knobs, title, what is drawn, of which pixels, with how many wavefronts."""
_OF_PROGRAMMES = ("etc", "etc_many", "sums_quick", "hole_standard")


def _main(case: FixedScene) -> list[Point]:
    points = [Point("etc", "closed form, one call", "closed_form")]
    points.append(Point("etc_many", "closed form, per case of 10 000 in one call", "closed_form", n_cases=10_000))
    for name, title, draw, region, epochs in _STATED:
        knobs = name.partition("_")[2]
        setup = Setup(draw, region, FIDELITIES[knobs], epochs, scene_model=case.scene_model)
        points.append(Point(name, f"{title}, {knobs} knobs", "images", setup=setup))
    dials = [Point(name, f"--fidelity {name}", "tier", fidelity=name) for name in ("quick", "standard")]
    if case.is_programme:
        # Standard knobs tell a visit to 0.05 %, far below what any number of realisations tells of a programme.
        setup = Setup("sums", "hole", FIDELITIES["standard"], SUM_EPOCHS)
        best = Point(REFERENCE, "reference: sums of frames, standard knobs, most realisations", "tier", setup=setup)
        few = replace(setup, knobs=FIDELITIES["quick"], epochs=1)
        one = Point("sums_one", "sums of frames, quick knobs, one wavefront a visit", "images", setup=few)
        return [best, *(point for point in points if point.name in _OF_PROGRAMMES), one, *dials]
    setup = reference_setup(case)
    best = Point(REFERENCE, "reference: whole frames, all effects, finest knobs", "tier", setup=setup)
    levels = [(f"tolerance_{level:g}", level) for level in TOLERANCES_MEASURED]
    dials += [Point(name, f"--tolerance {level:g}", "tolerance", tolerance=level) for name, level in levels]
    return [best, *points, *dials]


def _knobs(case: FixedScene) -> list[Point]:
    best = reference_setup(case)

    def one(name: str, title: str, **changes: Any) -> Point:
        return Point(name, title, "knob", setup=replace(best, **changes))

    def one_of_optics(name: str, title: str, **knobs: Any) -> Point:
        return one(name, title, knobs=best.knobs.model_copy(update=knobs))

    epochs = [count for count in (1, 2, 4) if count < min(case.n_frames, REFERENCE_EPOCHS)]
    other = "exact" if case.scene_model == "paper" else "paper"
    return [
        *(one_of_optics(f"wavelengths_{n}", f"{n} wavelengths a band", wavelength_nodes=n) for n in (1, 2, 3, 4, 5)),
        *(one_of_optics(f"pixel_nodes_{n}", f"{n} x {n} nodes a pixel", pixel_nodes=n) for n in (1, 2, 3, 4)),
        one_of_optics("single", "single precision", precision="single"),
        *(one_of_optics(f"pupil_{n}", f"{n} samples across the pupil", pupil_samples=n) for n in (64, 128)),
        *(one(f"epochs_{n}", f"{n} wavefront{'s' * (n > 1)} a visit", epochs=n) for n in epochs),
        one("window", "window around the hole", region="hole"),
        one(f"{other}_scene", f"{other} scene model", scene_model=other),
    ]


def _effects(case: FixedScene) -> list[Point]:
    switches = case.instrument.detector_of(case.band).switches.model_dump()
    changes: dict[str, dict[str, Any]] = {name: {"switches": {name: False}} for name, on in switches.items() if on}
    changes |= {"sky": {"sky": False}, "drift": {"still": ("visit_nm", "walk_nm_per_sqrt_hour", "orbital_nm")}}
    if case.scene.stars:
        changes["other_stars"] = {"left_out": tuple(star.name for star in case.scene.stars)}
    best, points = reference_setup(case), []
    for name, change in changes.items():
        words = "drift of the wavefront" if name == "drift" else name.replace("_", " ")
        points.append(Point(f"no_{name}", f"without {words}", "effect", setup=replace(best, **change)))
    return points
