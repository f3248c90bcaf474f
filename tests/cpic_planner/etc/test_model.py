"""What the ETC keeps of an instrument.

Where a planet may stand.
"""

import math
import os

import numpy as np
import pytest

from cpic_core import InputError
from cpic_planner.etc import build_model, check_range, place_status, planet_offsets, usable_range_arcsec
from cpic_planner.etc.questions import signal_to_noise
from cpic_planner.queries import Strategy
from cpic_planner.queries.shared import ReferenceStar
from cpic_planner.targets import find_target
from simulator.config import load_instrument

TAU_CET = find_target("tau Cet")[0]


def test_times_there_and_back():
    for overhead, ratio in ((0.0, 1.0), (500.0, 0.1), (1e4, 10.0)):
        model = build_model(load_instrument({"overhead_s": overhead}), ["F520"], Strategy(reference_ratio=ratio))
        visits = np.geomspace(1e-3, 1e9, 50)
        np.testing.assert_allclose(model.visit_s(model.time_s(visits)), visits, rtol=1e-6 if overhead else 1e-14)
        assert float(model.time_s(100.0)) == pytest.approx(overhead + 100.0 * (1.0 + ratio))
        assert float(model.time_s(0.0)) == 0.0
        assert float(model.visit_s(overhead / 2)) == 0.0


def test_models_are_kept():
    one = build_model(load_instrument(), ["F520"])
    assert build_model(load_instrument(), "F520") is one
    assert build_model(load_instrument({"overhead_s": 7.0}), ["F520"]) is not one
    assert build_model(load_instrument(), ["F520"], Strategy(n_modes=2)) is not one


def test_bands_by_name(refused):
    model = build_model(load_instrument(), ["F662", "F520", "F662"])
    assert model.bands == ("F662", "F520")
    assert model.named(None) == model.named([]) == model.bands
    assert model.named("F520") == model.named(["F520", "F520"]) == ("F520",)
    refused("band = F850: not accepted; allowed: F662, F520", model.named, ["F520", "F850"])
    refused("", build_model, load_instrument(), ["F999"])


def test_a_file_that_changed_is_read_again(tmp_path, monkeypatch):
    """Same instrument, other light: the model, its numbers and its hash follow the file."""
    path, optics = tmp_path / "filter.txt", build_model(load_instrument(), ["F520"]).metrics["F520"]
    monkeypatch.setattr("cpic_planner.etc.model.psf_metrics", lambda instrument, band: optics)

    def answer(height, later):
        wavelength = np.linspace(480, 560, 161)
        inside = abs(wavelength - 520) < 25
        path.write_text(
            "# wavelength_nm transmission\n"
            + "".join(f"{w} {height * float(i)}\n" for w, i in zip(wavelength, inside, strict=True))
        )
        os.utime(path, ns=(later, later))
        instrument = load_instrument({"bands": {"F520": {"transmission_file": str(path)}}, "overhead_s": 0.0})
        model = build_model(instrument, ["F520"], Strategy(visits=1))
        found = signal_to_noise(
            model, TAU_CET, time_s=600.0, separation_arcsec=0.6, contrast=1e-8, exposure_s=1.0, em_gain=1.0
        )[0]
        return found.budget["signal_e"], model.content()["files"]

    first, second = answer(0.8, 10**18), answer(0.4, 2 * 10**18)
    assert second[0] == pytest.approx(0.5 * first[0], rel=1e-6)
    assert first[1] != second[1]


def test_strategies_that_contradict_themselves_are_refused():
    with pytest.raises(ValueError, match="reference_star"):
        Strategy(library="reference_star")
    for key, value in (("n_modes", -1), ("reference_ratio", 0.0), ("sigma", 21.0), ("roll_deg", 0.0), ("mode", "x")):
        with pytest.raises(ValueError, match=key):
            Strategy(**{key: value})
    with pytest.raises(ValueError, match="v_mag"):
        ReferenceStar(v_mag=99.0)
    with pytest.raises(InputError, match="mode"):
        build_model(
            load_instrument({"detector": {"switches": {"em_register": False}}}),
            ["F520"],
            Strategy(mode="photon_counting"),
        )


INSTRUMENT = load_instrument()
MODEL = build_model(INSTRUMENT)
ROLL = build_model(INSTRUMENT, None, Strategy(library="roll"))


def corners(model, band, place):
    """The circle of the aperture, as points on the detector."""
    x, y = planet_offsets(model, TAU_CET, band, place)
    angle = np.linspace(0, 2 * np.pi, 721)
    radius = model.instrument.aperture_radius_arcsec(band)
    return x + radius * np.cos(angle), y + radius * np.sin(angle)


def inside(model, band, x, y):
    a, b = model.instrument.hole_inner_arcsec(band), model.instrument.hole_outer_arcsec(band)
    return bool(np.all((np.minimum(abs(x), abs(y)) >= a - 1e-9) & (np.maximum(abs(x), abs(y)) <= b + 1e-9)))


@pytest.mark.parametrize("model", [MODEL, ROLL], ids=["diagonal", "two rolls"])
@pytest.mark.parametrize("band", MODEL.bands)
def test_an_answer_needs_the_whole_aperture_in_the_squares(model, band):
    for place in np.linspace(0.2, 1.05, 86):
        status = place_status(model, band, float(place))[0]
        assert (status == "ok") == inside(model, band, *corners(model, band, float(place)))


def test_the_edges_are_named():
    low, high = usable_range_arcsec(INSTRUMENT, "F520")
    assert place_status(MODEL, "F520", low)[0] == place_status(MODEL, "F520", high)[0] == "ok"
    assert place_status(MODEL, "F520", low * 0.999)[1] == "inside_inner_edge"
    assert place_status(MODEL, "F520", high * 1.001)[1] == "outside_outer_edge"
    assert "F520" in place_status(MODEL, "F520", 2.0)[2]


def test_a_small_roll_leaves_the_planet_in_its_own_shadow():
    small = build_model(INSTRUMENT, None, Strategy(library="roll", roll_deg=2.0))
    status, reason, text = place_status(small, "F520", 0.6)
    assert (status, reason) == ("unreachable", "roll_too_small")
    assert "2 deg" in text


def test_ranges(refused):
    assert check_range("a", np.float32(2.0), 1.0, 3.0, "s") == 2.0
    for bad in (True, np.True_, "2", None, math.nan, math.inf, 0.9, 3.1, [2.0], 1 + 2j):
        refused("^a = ", check_range, "a", bad, 1.0, 3.0, "s")
