"""Images of a coronagraph of tables, from the point-spread functions of a file."""

import numpy as np
import pytest

from cpic_core import InputError
from simulator import Planet, Scene, SceneStar, load_instrument, observe
from simulator.imaging.table_metrics import airy

TABLE = """separation_arcsec,core_throughput,raw_contrast,contrast_stability
0.15,0.02,1e-9,0
0.3,0.1,1e-9,0
0.6,0.1,1e-9,0
"""
PIXEL, SIDE = 0.02, 101


@pytest.fixture
def instrument(tmp_path):
    (tmp_path / "c.csv").write_text(TABLE, encoding="utf-8")
    own = {
        "telescope": {"diameter_m": 3.0},
        "coronagraph": {"table": str(tmp_path / "c.csv"), "psf": {"v": str(tmp_path / "psf.npz")}},
        "bands": {"v": {"center_nm": 600, "width_nm": 60, "t_opt": 0.4, "qe": 0.8}},
        "detector": {"pixel_scale_arcsec": PIXEL},
    }
    made = load_instrument(own)
    offset = (np.arange(SIDE) - SIDE // 2) * PIXEL / made.lambda_d_arcsec("v")
    off_axis = 0.3 * airy(np.hypot(offset[:, None], offset), 0.0, 0.1) * (PIXEL / made.lambda_d_arcsec("v")) ** 2
    np.savez(
        tmp_path / "psf.npz",
        off_axis=off_axis,
        on_axis=np.full((SIDE, SIDE), 1e-12),
        pixel_scale_arcsec=PIXEL,
        mask_half_width_arcsec=0.0,
    )
    return made


def light(instrument, separation):
    """Noiseless light of a planet, e-/s."""
    planet = Planet(
        name="b", spectrum="blackbody", teff_k=5772.0, v_mag=15.0, separation_arcsec=separation, pa_deg=30.0
    )
    scenes = [
        Scene(name="s", cstar=SceneStar(name="s", v_mag=5.0, teff_k=5800.0, distance_pc=10.0), planets=planets)
        for planets in ((planet,), ())
    ]
    both, alone = (observe(scene, band="v", instrument=instrument, exposure_s=10.0, n_frames=1) for scene in scenes)
    return float((both.mean_rate_map - alone.mean_rate_map).sum())


def test_a_planet_is_as_bright_as_the_table_has_it_there(instrument):
    """At 0.15 arcsec the core gets a fifth of what it gets from 0.3 arcsec on, and halfway 0.6 of it."""
    far = light(instrument, 0.45)
    assert light(instrument, 0.15) / far == pytest.approx(0.2, rel=5e-3)
    assert light(instrument, 0.225) / far == pytest.approx(0.6, rel=5e-3)


def test_without_a_file_the_core_is_a_gaussian_of_as_much_light(instrument):
    bare = instrument.changed({"coronagraph": {"psf": None}})
    assert light(bare, 0.15) / light(bare, 0.45) == pytest.approx(0.2, rel=5e-3)
    with pytest.raises(InputError, match="without coronagraph.table"):
        load_instrument({"coronagraph": {"psf": "psf.npz"}})
