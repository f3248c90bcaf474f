"""What stars, planets and sources refuse, each in one line that names the quantity and what is allowed."""

import re

import pytest

from cpic_core import InputError
from simulator import lambert_phase, planet_albedo, planet_contrast, spectrum_generator, star_photlam
from simulator.config import load_instrument, load_scene
from simulator.target import contrast_at, parametric_family, read_spectrum, scene_sources, stellar_spectrum
from simulator.target.albedo_grid import read_albedo


def star(options):
    """Spectrum and its photons refuse the same."""
    with pytest.raises(InputError) as refused:
        stellar_spectrum(**options)
    with pytest.raises(InputError, match=re.escape(str(refused.value))):
        star_photlam(**options)
    raise refused.value


READERS = {
    "planet_albedo": lambda options: planet_albedo(500.0, **options),
    "planet_contrast": lambda numbers: planet_contrast(*numbers),
    "contrast_at": lambda distance_au: contrast_at(1.0, distance_au, 90.0, 0.5),
    "template": lambda spectral_type: stellar_spectrum(3.0, spectral_type, model="pickles"),
    "parametric_family": lambda parameters: parametric_family(*parameters),
    "lambert_phase": lambert_phase,
    "scenes": spectrum_generator,
    "sources": lambda tree: scene_sources(load_scene({"name": "s"} | tree), load_instrument(), "F520"),
    "star": star,
}


@pytest.fixture
def files(tmp_path):
    """Readers of what stands in spectrum.txt."""

    def written(text):
        (tmp_path / "spectrum.txt").write_text(text, encoding="utf-8")
        return tmp_path / "spectrum.txt"

    return {
        "albedo_file": lambda text: read_albedo(written(text)),
        "spectrum_file": lambda text: read_spectrum(written(text)),
    }


def test_bad_input_is_refused_in_one_line(refusal, files):
    refusal.by(READERS | files)
