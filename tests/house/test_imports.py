"""Heavy libraries stay out until they are needed: calls and commands, one after the other in a new process."""

import json
import subprocess
import sys
from textwrap import dedent

import pytest

HEAVY = "pandas synphot hcipy matplotlib photutils sep astropy astroquery pyvo requests scipy.stats numba dask".split()
IMAGES = "cpic_planner.validation cpic_planner.confirm.etc_images simulator.observing.observation"

# What is run, the strictest first, and what is not loaded by then either.
CALLS = [
    ("import catalogs, simulator, cpic_planner", "scipy yaml pydantic"),
    (
        """
        from catalogs.names import resolve_star
        from catalogs.stars import load_stars
        load_stars(), resolve_star("tau Cet")
        """,
        "scipy yaml pydantic",
    ),
    ("import simulator.effects", "scipy"),
    ("from catalogs.catalogue import open_catalogue; open_catalogue('mine.csv')", "scipy"),
    (
        """
        from simulator.config import load_instrument
        from simulator.imaging.store import psf_metrics
        psf_metrics(load_instrument(), "F662").core_throughput(0.3, 0.3)
        """,
        "scipy",
    ),
    (
        """
        from simulator.passbands import Passbands
        from simulator.target import planet_contrast, stellar_spectrum
        bands = Passbands.from_bands()
        bands.star_rate_e_s(1.0, 5800.0, 4.4, 0.0, 1.0), bands.band_albedo("jupiter", 5800.0, 4.4, 0.0)
        stellar_spectrum(1.0, "K1V")
        """,
        "scipy",
    ),
    (
        """
        from simulator import load_scene, spectrum_generator
        from simulator.target.sources import scene_sources
        table = spectrum_generator("paper_background")
        table.x_arcsec, [row.photlam for row in table], table.flags
        scene_sources(load_scene("paper_background"), load_instrument(), "F520")
        """,
        "scipy",
    ),
    (
        """
        from simulator.effects import sky_rate_e_s_arcsec2
        zodiacal = load_instrument({"sky": {"season": "date"}})
        sky_rate_e_s_arcsec2(zodiacal, "F520", ra_deg=1.0, dec_deg=2.0, start_utc="2028-01-01")
        """,
        "",
    ),
]
# A ranking in one band loads what a ranking in four does, in a quarter of the time.
COMMANDS = [
    ("etc 'tau Cet' --tolerance 0.5 --json", IMAGES),
    ("etc 'tau Cet' --snr 5", ""),
    ("etc 'HIP 71681' --json", ""),
    ("rank --json --planets 100 --v-mag-max 4", ""),
    ("rank --limit 3 --band F520 --planets 100 --v-mag-max 4", ""),
    ("--version", ""),
    ("rank --catalog snapshot --limit 3 --band F520 --v-mag-max 4", ""),
    ("catalog info", ""),
    ("catalog columns", ""),
    ("catalog refresh --help", ""),
    ("schema plan", ""),
    ("cache info", ""),
    ("simulate --help", ""),
    ("simulate --list-presets", ""),
    ("check --help", ""),
]
LAST = [
    ("from cpic_planner.report import answers, document, ranking, ranking_figures, writing", " ".join(HEAVY)),
    (
        """
        from cpic_planner.report.drawing import new_figure, save, style
        with style():
            figure = new_figure(2)
            figure.add_subplot().plot([1, 2])
            save(figure, "svg", alt="", caption="")
        """,
        "matplotlib.pyplot",
    ),
    (
        # functions are not shadowed by modules of their name
        """
        import cpic_planner.cli.main, cpic_planner.validation.confirm, cpic_planner.confirm.plan
        for package in (simulator, cpic_planner):
            for name in package.__all__:
                assert not str(type(getattr(package, name))).count("module"), name
        """,
        "",
    ),
]
RUN = "import shlex; from cpic_planner.cli.main import main; assert main(shlex.split({!r})) == 0"
STEPS = [
    *((dedent(code), [*HEAVY, *others.split()]) for code, others in CALLS),
    *((RUN.format(words), [*HEAVY, *others.split()]) for words, others in COMMANDS),
    *((dedent(code), others.split()) for code, others in LAST),
]
SCRIPT = f"""
import contextlib, io, json, sys, traceback
told = []
for code, heavy in {STEPS!r}:
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            exec(code)
        told.append([m for m in heavy if m in sys.modules])
    except Exception:
        told.append(traceback.format_exc())
print(json.dumps(told))
"""


@pytest.fixture(scope="module")
def loads(tmp_path_factory):
    """What each step had loaded of what it may not, or how it failed."""
    folder = tmp_path_factory.mktemp("here")
    (folder / "mine.csv").write_text("name,distance_pc,v_mag,sp_type\nfirst,10,5.5,G2V\nsecond,20,6,K1V\n")
    command = [sys.executable, "-W", "error", "-c", SCRIPT]
    return json.loads(subprocess.run(command, cwd=folder, stdout=subprocess.PIPE, text=True, check=True).stdout)


@pytest.mark.parametrize("number", range(len(STEPS)), ids=lambda number: " ".join(STEPS[number][0].split())[-60:])
def test_nothing_heavy_is_loaded(loads, number):
    assert loads[number] == []


def test_public_names_exist_here_and_there():
    import cpic_planner
    import simulator

    assert set(simulator.__all__) <= set(cpic_planner.__all__)
    for name in cpic_planner.__all__:
        assert getattr(cpic_planner, name) is not None
