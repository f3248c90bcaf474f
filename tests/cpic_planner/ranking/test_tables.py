"""Rankings under a coronagraph of tables: no planet that counts is left out."""

import numpy as np

from cpic_planner import rank_targets
from cpic_planner.ranking import in_zone
from simulator import load_instrument

TABLE = """separation_lambda_d,core_throughput,raw_contrast,contrast_stability,occulter_transmission,core_area_lambda_d2
3,0.05,2e-9,2e-11,0.1,1.0
6,0.30,5e-10,1e-11,0.8,2.5
20,0.10,5e-10,1e-11,0.3,1.2
"""


def test_what_is_too_faint_to_count_is_bounded_where_sky_and_core_change(tmp_path, monkeypatch):
    """The same completeness as where every planet of the zone is worked out."""
    (tmp_path / "wide.csv").write_text(TABLE, encoding="utf-8")
    instrument = load_instrument(
        {
            "telescope": {"diameter_m": 4.0},
            "coronagraph": {"table": str(tmp_path / "wide.csv")},
            "bands": {"g": {"center_nm": 550, "width_nm": 50, "t_opt": 0.3, "qe": 0.9}},
            "detector": {"pixel_scale_arcsec": 0.012},
        }
    )
    asked = {"instrument": instrument, "stars": ["tau Cet", "eps Eri", "47 UMa", "61 Vir"], "time_s": 36000}
    quick = rank_targets(**asked)
    monkeypatch.setattr(in_zone, "_SURE", 0.0)
    every = rank_targets(**asked)
    left, right = ({row.name: row for row in found.targets} for found in (quick, every))
    assert any(row.completeness > 0.01 for row in right.values())
    for name, row in right.items():
        np.testing.assert_allclose(left[name].completeness, row.completeness, rtol=2e-3)
