"""The same bytes of commands and public functions for any number of processors."""

import importlib
import inspect
import os
import subprocess
import sys

import pytest

import cpic_planner.validation
from cpic_core import THREAD_VARIABLES, InputError, runtime

SCRIPT = """
import contextlib, hashlib, io, pathlib
import cpic_planner
from cpic_planner.cli.main import main

def told(what, data):
    print(what, hashlib.sha256(data).hexdigest())

seen = cpic_planner.observe("paper_example", band="F662", exposure_s=10.0, window="hole")
told("rates of a simulated frame", seen.rate_map(0).tobytes())
ranked = cpic_planner.rank_targets(time_s=36000.0, bands=["F520"], n_planets=5, v_mag_max=3.5)
told("ranking of the function", ranked.model_dump_json().encode())
shown = io.StringIO()
with contextlib.redirect_stdout(shown):
    assert main(["rank", "--band", "F662", "--planets", "5", "--v-mag-max", "3.5", "--json"]) == 0
    assert main(["etc", "tau Cet", "--band", "F662", "--json"]) == 0
    assert main(["simulate", "--kind", "BIAS", "--frames", "1", "--out", "bias", "--json"]) == 0
told("answers of commands", shown.getvalue().encode())
(product,) = pathlib.Path("bias").glob("CAL/*/*.fits")
told("a product", product.read_bytes())
"""


@pytest.mark.long
def test_bytes_do_not_depend_on_the_number_of_threads_nor_on_where_and_when(tmp_path):
    """`test_same_bytes` has every command, and one setting after the other."""
    clean = {name: value for name, value in os.environ.items() if name not in THREAD_VARIABLES}
    elsewhere = {"LC_ALL": "C", "TZ": "Pacific/Apia", "PYTHONHASHSEED": "7"}
    settings = ({"PYTHONHASHSEED": "0"}, {"OMP_NUM_THREADS": "1"} | elsewhere)  # threads as processors, and one
    printed = []
    for place, own in zip(("a", "another folder"), settings, strict=True):
        (tmp_path / place).mkdir()
        run = [sys.executable, "-c", SCRIPT]
        where = {"env": clean | own, "cwd": tmp_path / place}
        done = subprocess.run(run, **where, capture_output=True, text=True, check=True)
        printed.append(done.stdout.splitlines())
    assert len(printed[0]) == 4
    assert printed[0] == printed[1]


NEED_NONE = {
    "cpic_planner": set(
        """
        check_level0 compare_answers lambert_phase load_instrument load_known_planets load_population load_scene
        load_strategies load_targets planet_contrast read_level1 save_psf scenes_from_table stream
    """.split()
    )
}
"""Public functions that read files, or compute element by element or by other public functions."""

REDUCTION = """
    aperture_photometry calibrated_frames combine fit_albedo fit_position planet_albedo_model rdi_subtract
    reduce_stack reject_cosmic_rays roll_photometry roll_subtract
""".split()


def public_functions():
    for module, left_out in NEED_NONE.items():
        package = importlib.import_module(module)
        names = {name for name in package.__all__ if inspect.isfunction(getattr(package, name))}
        assert left_out < names
        yield from (pytest.param(getattr(package, name), id=name) for name in sorted(names - left_out))
    for name in REDUCTION:
        yield pytest.param(getattr(cpic_planner.validation, name), id=name)


@pytest.mark.parametrize("function", list(public_functions()))
def test_public_functions_compute_in_it(function, monkeypatch):
    entered = []

    def recorder():
        entered.append(True)
        return one_thread()

    one_thread = runtime._one_thread
    monkeypatch.setattr(runtime, "_one_thread", recorder)
    with pytest.raises((TypeError, InputError)):
        function(no_such_argument=1)
    assert entered == [True]
