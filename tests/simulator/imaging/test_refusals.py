"""What the optics refuse, each in one line that names the setting."""

from simulator.config.map_files import pixel_scale
from simulator.imaging import read_maps
from simulator.imaging.deformable_mirror import DeformableMirror

READERS = {
    "mirror": lambda settings: DeformableMirror(**settings),
    "pixel_scale": lambda header: pixel_scale("map", "file", header),
    "map_path": lambda path: read_maps("psf", path),
}


def test_bad_input_is_refused_in_one_line(refusal):
    refusal.by(READERS)
