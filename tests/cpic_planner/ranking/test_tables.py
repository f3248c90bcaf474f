"""Rankings under a coronagraph of tables: no planet that counts is left out."""

import numpy as np

from cpic_planner import etc
from cpic_planner.ranking import faintest_contrast, ring_of
from cpic_planner.targets import find_target
from simulator import load_instrument

TABLE = """separation_lambda_d,core_throughput,raw_contrast,contrast_stability,occulter_transmission,core_area_lambda_d2
3,0.2,1e-13,0,0.25,0.6
8,0.2,1e-13,0,0.9,2.5
20,0.2,1e-13,0,0.3,0.8
"""


def test_what_is_too_faint_to_count_is_a_bound_where_sky_and_core_change(tmp_path):
    """In front of a bright sky the noise is that of the core's own sky: no place of a ring detects less.

    Most sky and the largest cores are in the middle of the zone, where the bound would be too high by the root of
    0.9 * 2.5 / (0.25 * 0.6) = 4 at the edges.
    """
    (tmp_path / "wide.csv").write_text(TABLE, encoding="utf-8")
    instrument = load_instrument(
        {
            "telescope": {"diameter_m": 4.0},
            "coronagraph": {"table": str(tmp_path / "wide.csv")},
            "bands": {"g": {"center_nm": 550, "width_nm": 50, "t_opt": 0.3, "qe": 0.9}},
            "detector": {"pixel_scale_arcsec": 0.012, "read_noise_e": 0, "em_gain_max": 1, "gain_e_adu": 1},
            "sky": {"model": "uniform", "brightness_v_mag_arcsec2": 15.0},
        }
    )
    model, star = etc.build_model(instrument), find_target("47 UMa")[0]
    metrics, frames = model.metrics["g"], (np.array([100.0]), np.array([50.0]), np.array([1.0]))
    bound = faintest_contrast(
        model,
        star,
        "g",
        **dict(zip(("exposure_s", "n_frames", "em_gain"), frames, strict=True)),
        visits=np.array([1.0]),
        law=None,
    )[0]
    place = np.linspace(*metrics.zone.usable_range_arcsec(metrics.aperture_radius_arcsec), 400)
    rates = etc.aperture_rates(model, star, "g", *etc.diagonal(metrics.zone, place[None, :]), np.ones((1, 400)))
    noise = etc.stack_noise(rates, *frames, model.camera("g"), model.strategy, programme=etc.ONE_VISIT)
    needed = etc.threshold_array(metrics.resolution_elements(place), model.strategy.sigma) / noise.significance[0]
    ratio = bound[ring_of(metrics.zone, place)] / needed
    assert (ratio <= 1.0).all()
    assert ratio.max() > 0.8  # and not an idle one
