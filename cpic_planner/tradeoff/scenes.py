"""The fixed scenes on which speed and accuracy are measured: one for each place where shortcuts can fail."""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from catalogs.errors import InputError
from simulator.config import Instrument, Scene, load_instrument, load_scene
from simulator.config.base import validate
from simulator.config.scene import Planet
from simulator.imaging.frame import SceneModel

__all__ = ["PLANET", "SCENES", "FixedScene", "fixed_scene"]

PLANET = "planet"
_ALBEDO, _RADIUS_AU = 0.5, 71492.0 / 149597870.7


@dataclass(frozen=True)
class FixedScene:
    """A scene with the frames that it is observed in.

    Attributes
    ----------
    name, title, why : str
        Short name, heading, and why it is in the list.
    band : str
    exposure_s, n_frames, em_gain
        Of the science visit; the reference visit has as many frames.
    tree : dict
        The scene, as `simulator.load_scene` reads it, or ``preset`` with what differs.
    scene_model : {"exact", "paper"}
        How the scene is asked to be made.
    detector : dict
        What differs from the default instrument's detector of the band.
    """

    name: str
    title: str
    why: str
    band: str
    exposure_s: float
    n_frames: int
    em_gain: float
    tree: Mapping[str, Any]
    scene_model: SceneModel = "exact"
    detector: Mapping[str, Any] = field(default_factory=dict)

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
        own = dict(self.detector)
        visible = instrument.band(self.band).camera == "VIS"
        return instrument.changed({"detector": own} if visible else {"near_infrared": {"detector": own}})


def _planet(contrast: float, separation_arcsec: float, pa_deg: float = 315.0) -> dict[str, Any]:
    """A Jupiter of grey albedo so far from its star that it has this contrast at quadrature."""
    return {
        "name": PLANET,
        "radius_rjup": 1.0,
        "phase_deg": 90.0,
        "albedo": _ALBEDO,
        "distance_au": _RADIUS_AU * math.sqrt(_ALBEDO / (math.pi * contrast)),
        "separation_arcsec": separation_arcsec,
        "pa_deg": pa_deg,
    }


def _star(v_mag: float, spectral_type: str) -> dict[str, Any]:
    return {"magnitude": v_mag, "spectral_type": spectral_type, "ra_deg": 100.0, "dec_deg": 20.0}


SCENES: dict[str, FixedScene] = {
    scene.name: scene
    for scene in (
        FixedScene(
            name="faint",
            title="Faint planet",
            why="few electrons a frame and long exposures: sky, dark current, read noise and lost frames "
            "make the noise",
            band="F662",
            exposure_s=300.0,
            n_frames=6,
            em_gain=50.0,
            tree={"name": "faint planet", "cstar": _star(5.5, "G2V"), "planets": [_planet(4e-8, 0.65)]},
        ),
        FixedScene(
            name="saturating",
            title="Bright star that saturates",
            why="the star overflows its pixels and the register beside the mask: tails of charge enter the dark hole, "
            "and frames no longer add up",
            band="F662",
            exposure_s=60.0,
            n_frames=6,
            em_gain=50.0,
            tree={"name": "bright star", "cstar": _star(1.35, "K1V"), "planets": [_planet(1e-8, 0.65)]},
        ),
        FixedScene(
            name="binary",
            title="Close binary",
            why="a companion 2 arcsec away and 4 mag fainter lays its wings over the hole: they need "
            "more wavelengths than the planet does",
            band="F720",
            exposure_s=60.0,
            n_frames=6,
            em_gain=50.0,
            tree={
                "name": "close binary",
                "cstar": _star(3.0, "G2V"),
                "planets": [_planet(1e-7, 0.6)],
                "stars": [
                    {"name": "B", "magnitude": 7.0, "spectral_type": "K5V", "separation_arcsec": 2.0, "pa_deg": 60.0}
                ],
            },
        ),
        FixedScene(
            name="edge",
            title="Planet at the edge of the mask",
            why="its aperture touches the inner edge of the hole, where speckles are brightest and change fastest with "
            "wavelength, and the cross cuts its light",
            band="F662",
            exposure_s=60.0,
            n_frames=6,
            em_gain=30.0,
            tree={"name": "planet at the edge", "cstar": _star(3.0, "G2V"), "planets": [_planet(4e-8, 0.37, 45.0)]},
        ),
        FixedScene(
            name="field",
            title="Dense field",
            why="300 stars of 13 to 20 mag on the detector (the preset star_field) around a star of 6 mag: each is a "
            "source to be rendered, and few matter in the hole",
            band="F662",
            exposure_s=100.0,
            n_frames=6,
            em_gain=200.0,
            tree={"preset": "star_field", "v_mag": 6.0, "planets": [_planet(5e-8, 0.65)]},
        ),
        FixedScene(
            name="infrared",
            title="Near infrared",
            why="another camera with larger pixels, no register, reads up the ramp and no sums of frames; the planet "
            "is bright, since dark current and read noise hide all others",
            band="F1265",
            exposure_s=300.0,
            n_frames=6,
            em_gain=1.0,
            tree={"name": "infrared planet", "cstar": _star(3.0, "K0V"), "planets": [_planet(2e-7, 0.9)]},
        ),
        FixedScene(
            name="paper",
            title="Scene model of the paper",
            why="the example of Zhu et al. 2025 made by their shortcut: nearest of 4 x 4 cells of a pixel, no mask in "
            "front of the planet; its reference is made so too",
            band="F520",
            exposure_s=17.0,
            n_frames=6,
            em_gain=30.0,
            tree={"name": "paper shortcut", "cstar": _star(1.35, "K1V"), "planets": [_planet(2e-8, 0.65)]},
            scene_model="paper",
        ),
    )
}


def fixed_scene(name: str) -> FixedScene:
    """One of the scenes by name.

    Raises
    ------
    InputError
        If there is none of that name.
    """
    if name not in SCENES:
        raise InputError("--scene", name, allowed=", ".join(SCENES))
    return SCENES[name]
