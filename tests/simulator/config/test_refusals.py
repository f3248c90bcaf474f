"""What the readers of the configuration refuse, each in one line that names key, value and what is allowed."""

from simulator.config import (
    SequenceConfig,
    albedo_spec,
    checked_utc,
    declination_deg,
    load_instrument,
    load_scene,
    load_simulation,
    right_ascension_deg,
    validate,
)

SCENE = {"name": "s", "cstar": {"name": "star", "v_mag": 1.35, "teff_k": 5230}}
PLANET = {
    "name": "b",
    "radius_rjup": 1,
    "distance_au": 0.8775,
    "phase_deg": 90,
    "separation_arcsec": 0.65,
    "pa_deg": 315,
}
DISC = {"contrast": 1e-6, "inner_arcsec": 0.3, "outer_arcsec": 0.6, "slope": -2, "inclination_deg": 60, "pa_deg": 40}


def with_planet(change):
    planet = {key: value for key, value in (PLANET | change).items() if value != "(left out)"}
    return load_scene(SCENE | {"planet": planet})


def sequence(keys):
    sky = {"scene": load_scene("paper_example")} if keys["kind"] in ("SCI", "DSF", "CALS") else {}
    return validate(SequenceConfig, {"instrument": load_instrument()} | sky | keys)


READERS = {
    "instrument": load_instrument,
    "start_utc": lambda value: checked_utc("start_utc", value),
    "right_ascension": right_ascension_deg,
    "declination": declination_deg,
    "albedo": albedo_spec,
    "planet": with_planet,
    "scene": lambda change: load_scene(SCENE | change),
    "whole_scene": load_scene,
    "disc": lambda change: load_scene({"name": "s", "cstar": {"v_mag": 3.0, "teff_k": 5230}, "disc": DISC | change}),
    "sequence": sequence,
    "simulation": lambda tree: load_simulation({"name": "x"} | tree),
}


def test_bad_input_is_refused_in_one_line(refusal):
    refusal.by(READERS)
