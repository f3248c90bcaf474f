import math

import numpy as np
import pytest

from cpic_core import InputError
from cpic_planner.validation import AlbedoModel, planet_albedo_model
from cpic_planner.validation.albedo_fit import albedo_model
from simulator import load_instrument, load_scene, planet_contrast, spectrum_generator
from simulator.passbands import Passbands
from simulator.target import LitPlanet, parametric_family, stellar_spectrum

BANDS = ("F520", "F662", "F720", "F850")
SIZE = {"radius_rjup": 1.2, "distance_au": 1.5, "phase_deg": 70.0}


@pytest.fixture(scope="module")
def passbands() -> Passbands:
    return Passbands.from_instrument(load_instrument())


def visible(passbands: Passbands) -> list:
    return [band for band in passbands.bands if band.name in BANDS]


@pytest.fixture(scope="module")
def model(passbands: Passbands) -> AlbedoModel:
    star = stellar_spectrum(3.0, teff_k=5230.0, log_g=4.5, metallicity=0.1)
    return albedo_model(visible(passbands), star, insolation_au=1.7, **SIZE)


@pytest.mark.parametrize(("log10_mh", "log10_fsed"), [(0.0, -2.0), (0.83, -0.31), (2.0, math.log10(6.0)), (1.6, 0.5)])
def test_contrasts_are_those_of_the_calculator(
    model: AlbedoModel, passbands: Passbands, log10_mh: float, log10_fsed: float
) -> None:
    family = parametric_family(log10_mh, log10_fsed)
    albedo = passbands.band_albedo(family, 5230.0, 4.5, 0.1, insolation_au=1.7)
    rho = SIZE["distance_au"] * math.sin(math.radians(SIZE["phase_deg"]))
    expected = [
        planet_contrast(SIZE["radius_rjup"], rho, 0.0, SIZE["phase_deg"], albedo[passbands.index(name)])
        for name in BANDS
    ]
    assert model.bands == BANDS
    assert model.contrast(log10_mh, log10_fsed) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("phase_function", ["lambert", "grid"])
def test_contrasts_are_those_of_the_images(passbands: Passbands, phase_function: str) -> None:
    tree = load_scene("paper_example").model_dump(mode="json")
    truth = {"model": "parametric", "log10_mh": 0.7, "log10_fsed": -0.6, "phase_function": phase_function}
    tree["planets"][0]["albedo"] = truth | {"insolation_au": 2.0}
    planet = spectrum_generator(load_scene(tree))[1].light
    assert isinstance(planet, LitPlanet)
    found = planet_albedo_model(planet, visible(passbands))
    expected = [planet.band_contrast(band) for band in visible(passbands)]
    assert found.contrast(0.7, -0.6) == pytest.approx(expected, rel=1e-9)
    assert found.insolation_au == 2.0


def test_insolation_follows_the_star(passbands: Passbands) -> None:
    tree = load_scene("paper_example").model_dump(mode="json")
    tree["planets"][0]["albedo"] = {"model": "jupiter"}
    planet = spectrum_generator(load_scene(tree))[1].light
    assert isinstance(planet, LitPlanet)
    found = planet_albedo_model(planet, visible(passbands))
    assert found.insolation_au == pytest.approx(0.65 * 1.35 / math.sqrt(planet.host.luminosity[0]))


def test_shapes_and_nodes(model: AlbedoModel) -> None:
    mh, fsed = np.linspace(0, 2, 5)[:, None], np.linspace(-2, 0.7, 7)
    contrast = model.contrast(mh, fsed)
    assert contrast.shape == (5, 7, 4)
    assert model.contrast_grid(mh[:, 0], fsed) == pytest.approx(contrast, rel=1e-12)
    assert contrast[3, 2] == pytest.approx(model.contrast(1.5, float(fsed[2])))
    assert model.wavelength_nm == pytest.approx([520, 662, 720, 850])
    assert model.log10_fsed[-1] == math.log10(6.0)


def test_what_was_clamped_is_flagged(passbands: Passbands) -> None:
    star = stellar_spectrum(3.0, "G2V")
    far = albedo_model(passbands.bands[:5], star, insolation_au=9.0, **SIZE)
    assert far.flags == ("insolation_clamped",)
    assert "extrapolated" in albedo_model(passbands.bands, star, insolation_au=2.0, **SIZE).flags


@pytest.mark.parametrize(
    ("changed", "key"),
    [
        ({"insolation_au": 0.0}, "insolation_au"),
        ({"phase_deg": 180.0}, "phase_deg"),
        ({"radius_rjup": 0.0}, "phase_deg"),
        ({"distance_au": -1.0}, "distance_au"),
        ({"phase_function": "other"}, "phase_function"),
    ],
)
def test_refusals(passbands: Passbands, changed: dict[str, float], key: str) -> None:
    with pytest.raises(InputError, match=key):
        albedo_model(visible(passbands), stellar_spectrum(3.0, "G2V"), **(SIZE | {"insolation_au": 2.0} | changed))


def test_no_band_and_parameters_out_of_range(refused, model: AlbedoModel) -> None:
    refused("bands", albedo_model, [], stellar_spectrum(3.0, "G2V"), insolation_au=2.0, **SIZE)
    refused("log10_mh", model.contrast, 2.1, 0.0)
    refused("log10_fsed", model.contrast, 1.0, [0.0, math.nan])


def test_light_of_its_own_has_no_albedo(refused, passbands: Passbands) -> None:
    tree = load_scene("paper_example").model_dump(mode="json")
    own = {"name": "hot", "separation_arcsec": 0.6, "pa_deg": 45, "spectrum": "blackbody", "teff_k": 1500, "v_mag": 20}
    planet = spectrum_generator(load_scene(tree | {"planets": [own]}))[1].light
    assert isinstance(planet, LitPlanet)
    refused("light of its own", planet_albedo_model, planet, visible(passbands))
