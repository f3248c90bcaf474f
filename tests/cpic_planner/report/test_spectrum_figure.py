import base64
import re

from cpic_planner.report.image_figures import spectrum_figure
from cpic_planner.results import BandConfirmation
from simulator.config import load_instrument, load_scene

SCENE = {
    "name": "s",
    "cstar": {"v_mag": 4.0, "teff_k": 5500, "distance_pc": 4.0},
    "planets": [
        {"name": "b$", "radius_rjup": 1, "phase_deg": 90, "separation_arcsec": 0.5, "pa_deg": 10, "albedo": "jupiter"},
        {"name": "c", "radius_rjup": 0.4, "phase_deg": 90, "separation_arcsec": 0.6, "pa_deg": 20, "albedo": 0.3},
    ],
}


def drawn_words(picture):
    return re.findall(r"<!-- (.*?) -->", base64.b64decode(picture.uri.split(",", 1)[1]).decode())


def measured(planet, band, contrast):
    return BandConfirmation(
        band=band,
        planet=planet,
        status="ok",
        reason="",
        message="",
        separation_arcsec=0.5,
        pa_deg=0.0,
        true_contrast=contrast,
        recovered_contrast=1.1 * contrast,
        contrast_error=0.2 * contrast,
        contrast_mean_error=0.07 * contrast,
    )


def test_every_planet_with_a_measurement_is_drawn():
    bands = [measured("b$", "F520", 1e-8), measured("b$", "F850", 6e-9), measured("c", "F520", 8e-10)]
    picture = spectrum_figure(load_scene(SCENE), load_instrument(), bands)
    words = drawn_words(picture)
    assert {"b$: input", "b$: recovered", "c: recovered", "input in the band"} <= set(words)
    assert "of b$, c in 3 measurements" in picture.alt
    one = spectrum_figure(load_scene(SCENE), load_instrument(), bands[:2])
    assert not any("c: recovered" in word for word in drawn_words(one))
    assert one.uri == spectrum_figure(load_scene(SCENE), load_instrument(), bands[:2]).uri


def test_nothing_measured_is_no_picture():
    refused = measured("b$", "F520", 1e-8).model_copy(update={"recovered_contrast": None})
    assert spectrum_figure(load_scene(SCENE), load_instrument(), [refused]) is None
    assert spectrum_figure(load_scene(SCENE), load_instrument(), []) is None
