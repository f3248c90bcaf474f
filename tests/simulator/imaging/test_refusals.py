"""What the optics refuse, each in one line that names the setting."""

import numpy as np

from simulator.config.map_files import pixel_scale
from simulator.imaging import HoleZone, read_maps
from simulator.imaging.dark_hole import ControlSettings
from simulator.imaging.deformable_mirror import DeformableMirror
from simulator.imaging.pupil import draw_aberrations
from simulator.imaging.scene_image import KernelTransfer, PointSources, scene_image

TRANSFER = KernelTransfer(np.eye(3), 0.02)
ONE = PointSources([0.0], [0.0], [1.0])
WINDOW = {"y_centres_arcsec": [0.0], "x_centres_arcsec": [0.0], "pixel_arcsec": 0.02}

READERS = {
    "aberrations": lambda change: draw_aberrations(**({"seed": 1} | change)),
    "control": lambda settings: ControlSettings(**settings),
    "mirror": lambda settings: DeformableMirror(**settings),
    "hole_zone": lambda zone: HoleZone(*zone),
    "window": lambda change: scene_image(TRANSFER, sources=ONE, **(WINDOW | change)),
    "pixel_scale": lambda header: pixel_scale("map", "file", header),
    "map_path": lambda path: read_maps("psf", path),
}


def test_bad_input_is_refused_in_one_line(refusal):
    refusal.by(READERS)
