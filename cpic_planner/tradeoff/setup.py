"""What one way to an answer models, and the observations that follow from it."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from cpic_planner.tradeoff.scenes import PLANET, FixedScene
from cpic_planner.validation.task import images_of
from simulator.config import Instrument, Scene
from simulator.imaging.frame import SceneModel
from simulator.knobs import FIDELITIES, Dial, Knobs
from simulator.ledger import Choice, choose, forecast
from simulator.observation import Observation, Role, observe

SEED = 1
REFERENCE_EPOCHS = 1000
"""More than any visit has frames: one wavefront a frame."""


@dataclass(frozen=True)
class Setup:
    """Everything that a shortcut can change.

    Attributes
    ----------
    draw : {"sums", "frames"}
        Sums of frames over the dark hole, or every frame.
    region : {"hole", "full"}
        Pixels that are simulated: the stamp around the mask, or whole frames.
    knobs : Knobs
        Numerical settings of the optics.
    epochs : int
        Most wavefronts of a visit.
    switches : dict
        Effects of the camera to switch off.
    left_out : tuple of str
        Sources of the scene to leave out.
    sky, drift : bool
        Whether the sky shines and the wavefront drifts.
    scene_model : {"exact", "paper"}
    """

    draw: Literal["sums", "frames"]
    region: Literal["hole", "full"]
    knobs: Knobs
    epochs: int
    switches: Mapping[str, bool] = field(default_factory=dict)
    left_out: tuple[str, ...] = ()
    sky: bool = True
    drift: bool = True
    scene_model: SceneModel = "exact"

    def changed(self, **changes: Any) -> Setup:
        """The same with something changed."""
        return dataclasses.replace(self, **changes)

    def instrument(self, case: FixedScene) -> Instrument:
        """The instrument of the scene as far as it is modelled."""
        instrument = case.instrument
        if self.draw == "sums":
            instrument = images_of(instrument)
        if not self.drift:
            instrument = instrument.changed({"drift": {"visit_nm": 0.0, "walk_nm_per_sqrt_hour": 0.0}})
        if not self.sky:
            instrument = _dark_sky(instrument)
        return instrument.switched(self.switches)

    def scene(self, case: FixedScene, *, planets: bool = True) -> Scene:
        """What is shown, without planets if so asked."""
        scene = case.scene
        kept = {
            "stars": tuple(star for star in scene.stars if star.name not in self.left_out),
            "planets": tuple(body for body in scene.planets if planets and body.name not in self.left_out),
            "extended": tuple(body for body in scene.extended if body.name not in self.left_out),
        }
        return scene.model_copy(update=kept)

    def n_epochs(self, case: FixedScene) -> int:
        """Wavefronts of one visit."""
        return min(self.epochs, case.n_frames)


def _dark_sky(instrument: Instrument) -> Instrument:
    """No light of the sky: 40 mag in every square arcsecond."""
    sky = instrument.sky.model_copy(update={"model": "uniform", "brightness_v_mag_arcsec2": 40.0})
    return instrument.model_copy(update={"sky": sky})


def reference_setup(case: FixedScene) -> Setup:
    """Everything: whole frames one by one, every effect, the finest knobs, a wavefront for every frame."""
    return Setup("frames", "full", FIDELITIES["reference"], REFERENCE_EPOCHS, scene_model=case.scene_model)


def choice_of(case: FixedScene, dial: Dial) -> Choice:
    """What the effect ledger decides where the planet's flux and SNR are asked for, as a confirmation does.

    Parameters
    ----------
    case : FixedScene
    dial : Dial
    """
    predicted = forecast(
        case.scene,
        case.instrument,
        band=case.band,
        exposure_s=case.exposure_s,
        n_frames=case.n_frames,
        em_gain=case.em_gain,
        scene_model=case.scene_model,
        planets=(PLANET,),
        reduced=True,
        full=dial.fidelity == "reference",
    )
    return choose(predicted, dial.of("planet_flux", "snr"), fixed=("hole_region",))


def chosen_by(case: FixedScene, choice: Choice) -> Setup:
    """The setup of a choice of the effect ledger.

    Parameters
    ----------
    case : FixedScene
    choice : Choice
    """
    return Setup(
        choice.draw,
        "hole" if choice.draw == "sums" else choice.region,
        choice.knobs,
        choice.epochs,
        switches=dict(choice.switches),
        left_out=tuple(choice.left_out),
        sky=choice.sky,
        scene_model=case.scene_model,
    )


def visit(
    case: FixedScene,
    setup: Setup,
    *,
    role: Role = "science",
    planets: bool = True,
    n_frames: int | None = None,
    epochs: int | None = None,
    realisation: int = 0,
) -> Observation:
    """One visit; reference visits show no planet."""
    return observe(
        setup.scene(case, planets=planets and role == "science"),
        band=case.band,
        exposure_s=case.exposure_s,
        n_frames=n_frames or case.n_frames,
        em_gain=case.em_gain,
        seed=SEED,
        fidelity=setup.knobs,
        instrument=setup.instrument(case),
        role=role,
        realisation=realisation,
        window=setup.region,
        scene_model=setup.scene_model,
        max_epochs=1 if setup.draw == "sums" else setup.epochs if epochs is None else epochs,
    )
