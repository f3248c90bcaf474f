"""Cases of the public functions: good calls with one to three arguments of another kind."""

import contextlib
import functools
import inspect
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
from hypothesis import strategies as st

import cpic_planner
from cpic_core import exclusive_lock
from cpic_planner.api import answered
from cpic_planner.queries import EtcQuestion
from tests.fuzz.values import OBJECTS, STARS, fresh, objects
from tests.fuzz.watched import Case, of_function

NOWHERE = "/dev/null/nowhere"
"""No file or folder can be made there: it is refused before any work."""
HELD = "held"
"""A folder that a run holds (`held`): functions that would work for minutes refuse it after everything else."""
_IMAGES = {"fidelity", "tolerance", "realisations", "images", "out"}
"""Keywords by which the calculator makes images, and folders for them."""
_SEARCHED = ("contrast_curve", "roc_curve")


@functools.cache
def _bias() -> Any:
    """A sequence of one small frame."""
    small = {"name": "small", "detector": {"n_columns": 60, "n_rows": 50, "star_column": 30, "star_row": 25}}
    return cpic_planner.calibrate("BIAS", n_frames=1, em_gain=1.0, instrument=small)


@functools.cache
def _answer(snr: float) -> Any:
    """An answer of the calculator, to be compared."""
    return answered(EtcQuestion.of({"target": "tau Cet", "bands": ["F520"], "snr": snr})).result


def _stamps() -> SimpleNamespace:
    axis = np.arange(21) - 10.0
    stamp = np.exp(-np.add.outer(axis**2, axis**2) / 8.0) / 60.0
    return SimpleNamespace(band="F520", off_axis=stamp, on_axis=stamp * 1e-6, pixel_scale_arcsec=0.016153)


def prepare(folder: Path) -> None:
    """Write the files that good calls read."""
    (folder / "stars.csv").write_text(STARS)
    np.savez(folder / "psf.npz", **{key: value for key, value in vars(_stamps()).items() if key != "band"})
    np.savez(folder / "surface.npz", surface_nm=np.outer(np.arange(21.0), np.arange(21.0)))


@contextlib.contextmanager
def held(folder: Path) -> Iterator[None]:
    """Hold `HELD` below a folder as a run does, so that no other run takes it, ``force`` or not."""
    (folder / HELD).mkdir()
    with exclusive_lock(folder / HELD / "run.lock"):
        yield


def good_calls(folder: Path) -> dict[str, dict[str, Any]]:
    """Return arguments of each public function with which it answers in milliseconds, or is refused at last.

    Parameters
    ----------
    folder : Path
        Of a table ``stars.csv``.
    """
    star = {"target": "tau Cet", "bands": ["F520"], "separation_arcsec": 0.5}
    ranked = {"catalog": str(folder / "stars.csv"), "bands": ["F520"], "n_planets": 20}
    body = {"separation_arcsec": 0.5, "pa_deg": 45.0, "radius_rjup": 1.0, "phase_deg": 90.0}
    bright = {"v_mag": 4.0, "spectral_type": "G2V", "distance_pc": 5.0}
    scene = {"name": "mine", "cstar": bright, "planets": [body]}
    rates = {"planet_rate": 0.02, "background_rate": 0.2, "floor_rate": 1e-6, "convention": "ayo"}
    return {
        "signal_to_noise": star | {"time_s": 1e5},
        "exposure_time": star | {"snr": 5.0},
        "contrast_limit": star | {"time_s": 1e5},
        "optimise": {"target": "tau Cet", "bands": ["F520"], "snr": 5.0},
        "rank_targets": ranked,
        "rank_sensitivity": ranked,
        "explain_rank": {"target": "A one"} | ranked,
        "compare_ranks": {"other": "as_published"} | ranked,
        "make_plan": {"out": HELD} | ranked,
        "confirm_scene": {"scene": "paper_example", "out": HELD, "bands": ["F520"]},
        "confirm_targets": {"target": "no such star", "bands": ["F520"]},
        "simulate_products": {
            "what": "paper_example",
            "out": HELD,
            "band": "F520",
            "exposure_s": 10.0,
            "em_gain": 10.0,
        },
        "compare_strategies": {"strategies": "survey_default", "out": HELD},
        "contrast_curve": {"target": "tau Cet", "bands": ["F520"], "separation_arcsec": [0.5]},
        "roc_curve": star | {"contrast": 3e-9},
        "compare_answers": {"before": _answer(5.0), "after": _answer(8.0)},
        "reduce_products": {"what": str(folder / "stars.csv"), "out": HELD},
        "read_level1": {"path": str(folder / "stars.csv")},
        "star_visibility": {"target": "tau Cet", "n_days": 5},
        "load_targets": {"source": "snapshot"},
        "load_known_planets": {"source": "snapshot"},
        "load_population": {"source": "jupiters"},
        "load_strategies": {"source": "survey_default"},
        "load_instrument": {"source": {"name": "mine"}},
        "load_scene": {"source": scene},
        "load_psf": {"path": str(folder / "psf.npz"), "instrument": None, "band": "F520", "energy": 0.5},
        "load_dm_surface": {"path": str(folder / "surface.npz"), "samples": 42, "unit": "nm"},
        "lambert_phase": {"phase_deg": 90.0},
        "planet_contrast": {
            "radius_rjup": 1.0,
            "separation_ra_au": 1.0,
            "separation_dec_au": 0.5,
            "phase_deg": 90.0,
            "geometric_albedo": 0.5,
        },
        "planet_albedo": {"wavelength_nm": 600.0, "model": "jupiter"},
        "star_photlam": {"magnitude_v": 5.0, "spectral_type": "G2V"},
        "spectrum_generator": {"scene": scene},
        "scenes_from_table": {
            "table": pd.DataFrame({"v_mag": [5.0], "sp_type": ["G2V"], "distance_pc": [5.0], "name": ["A"]})
        },
        "single_band_psf": {"band": "F520", "fidelity": "quick"},
        "save_psf": {"psf": _stamps(), "path": str(folder / "saved.npz")},
        "write_coronagraph_table": {"instrument": {"name": "mine"}, "band": "F520", "path": str(folder / "table.csv")},
        "observe": {"scene": scene, "band": "F520", "exposure_s": 10.0, "n_frames": 1, "fidelity": "quick"},
        "calibrate": {"kind": "BIAS", "n_frames": 1, "em_gain": 1.0},
        "check_level0": {"path": str(folder / "stars.csv")},
        "write_level0": {"observation": _bias(), "out_dir": str(folder / "level0"), "overwrite": True, "truth": True},
        "stream": {"seed": 1},
        "time_for_rates": rates | {"snr": 7.0},
        "snr_for_rates": rates | {"time_s": 1e4},
        "Strategy": {"visits": 2},
        "ReferencePlanet": {"radius_rjup": 1.0},
        "RateConvention": {"planet_noise": 1.0, "background_noise": 2.0},
        "Knobs": {},
        "Planet": body,
        "SceneStar": bright,
        "Scene": scene,
    }


REFUSED = ("confirm_targets", "make_plan", "confirm_scene", "simulate_products", "compare_strategies")
REFUSED += ("reduce_products", "read_level1")
"""Of these even the good call is refused, by the last thing that is looked at: else it works for long."""
NO_CALLS = (
    "ExternalPsf",
    "Instrument",
    "Observation",
    "Outcome",
    "Outcomes",
    "Passbands",
    "Psf",
    "Calibration",
    "NotOk",
    "InputError",
    "Reason",
    "Status",
)
"""Public names that are made by others, not called."""


@functools.cache
def keywords_of(name: str) -> tuple[str, ...]:
    """Return the names of the arguments of a public function or model."""
    function = getattr(cpic_planner, name)
    fields = getattr(function, "model_fields", None)
    if fields is not None:
        return tuple(fields)
    kinds = (inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY)
    names = tuple(item.name for item in inspect.signature(function).parameters.values() if item.kind in kinds)
    if name == "load_targets":
        names += ("v_mag_max", "dwarfs_only", "singles_only", "companions", "date_utc")
    return names


def _asked(name: str) -> list[str]:
    """Names of the arguments that cases change."""
    images = _IMAGES if name in ("signal_to_noise", "exposure_time", "contrast_limit", *_SEARCHED) else ()
    return [item for item in keywords_of(name) if item not in images and item != "progress"]  # a function of theirs


def _call(name: str, arguments: dict[str, Any], good: dict[str, Any]) -> Case:
    """A case of a function; what makes it refuse at last stays as it is, and so does a folder that it would fill."""
    stays = {"confirm_targets": "target", "write_level0": "out_dir"}.get(name, "out" if name in REFUSED else "")
    arguments |= {key: value for key, value in good.items() if key == stays}
    function = getattr(cpic_planner, name)
    return name, arguments, lambda: of_function(lambda: function(**arguments))


@st.composite
def cases(draw: Any, folder: Path) -> Case:
    """Draw a call of a public function."""
    good = good_calls(folder)
    name = draw(st.sampled_from(sorted(good)))
    arguments = dict(good[name])
    for _ in range(draw(st.sampled_from((1, 1, 2, 3)))):
        key = draw(st.sampled_from(_asked(name)))
        near = _near(good[name].get(key))
        arguments[key] = draw(st.one_of(objects, st.sampled_from(near)) if near else objects)
    return _call(name, arguments, good[name])


def every_one(folder: Path) -> Iterator[Case]:
    """Give each argument of each public function each object of another kind, alone."""
    for name, good in good_calls(folder).items():
        for key in _asked(name):
            for thing in (*OBJECTS, *_near(good.get(key))):
                yield _call(name, {item: fresh(value) for item, value in good.items()} | {key: fresh(thing)}, good)


def _near(value: Any) -> list[Any]:
    """Values that are like a good one, but in another form, or with one part of another kind."""
    if isinstance(value, float):
        return [np.array(value), [value], [value, -value], str(value), {"value": value}, value * 1e300]
    if isinstance(value, dict):
        return [value | {key: fresh(item)} for key in (*value, 1) for item in OBJECTS]
    if isinstance(value, str | list):
        return [[value, 5], [value, value], [[value]], {value if isinstance(value, str) else "a": value}]
    return []
