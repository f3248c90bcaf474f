import dataclasses

import pytest

from catalogs.errors import InputError
from cpic_planner.tradeoff.points import points_of
from cpic_planner.tradeoff.run import tradeoff
from cpic_planner.tradeoff.worker import GLANCE, measure_point, measure_shared
from cpic_planner.version import __version__
from simulator.knobs import FIDELITIES, Knobs


def points(case, *names):
    return tuple(point for point in points_of(case) if point.name in names)


@pytest.mark.long
def test_rows_of_every_group(small_case, monkeypatch):
    monkeypatch.setitem(FIDELITIES, "reference", Knobs(wavelength_nodes=3, pixel_nodes=3))  # for speed
    found = {
        point.name: measure_point(small_case, point, GLANCE, "here", 0.0)
        for point in points(small_case, "reference", "etc", "tolerance_0.3")
    }
    shared = measure_shared(small_case, points(small_case, "wavelengths_1", "no_flat"), GLANCE, "here")
    found |= {row.point: row for row in shared}
    assert {row.status for row in found.values()} == {"ok"}
    for row in found.values():
        assert row.wall_s > 0
        assert row.peak_memory_mb > 20
        assert row.flux_e == pytest.approx(found["reference"].flux_e, rel=0.02)
        assert row.n_frames == 2
        assert (row.cold_s is None) == (row.point in ("wavelengths_1", "no_flat"))
    assert found["etc"].wall_s < 0.1 * found["reference"].wall_s
    assert len(found["reference"].samples["white_e2"]) == len(found["wavelengths_1"].samples["white_e2"]) == 4
    assert found["reference"].settings["region"] == "full"
    assert found["reference"].settings["epochs"] == 2
    assert found["tolerance_0.3"].predicted_error["snr"] <= 0.3


def test_a_row_that_does_not_apply_has_a_reason(small_case):
    case = dataclasses.replace(small_case, em_gain=1000.0, exposure_s=1e5)
    row = measure_point(case, points(case, "sums_quick")[0], GLANCE, "here", 0.0)
    assert (row.status, row.reason) == ("invalid", "not_applicable")
    assert row.message != ""
    assert row.wall_s is None


def test_only_keeps_the_other_rows(small_case, make):
    pairs = {key: [1e-6, 2e-6] for key in ("speckle_e2_s2", "walk_e2_s2", "one_epoch_e2_s2")}
    white = {"white_e2": [10.0] * 4, "own_e2": [5.0]}
    common = {"version": __version__, "n_frames": 2}
    kept = [
        make.row("reference", group="tier", samples=white | pairs, **common),
        make.row("hole_quick", machine="elsewhere", samples=white, **common),
        make.row("full_standard", version=__version__, n_frames=3),
    ]
    earlier = make.result(kept, version=__version__, quick_look=True, machine=make.machine("elsewhere"))
    told, stored = [], []
    result = tradeoff(
        [(small_case, points(small_case, "etc"))],
        earlier=earlier,
        quick_look=True,
        advance=told.append,
        keep=stored.append,
    )
    assert told == ["faint, etc"]
    assert stored == [result]
    rows = {row.point: row for row in result.rows}
    assert set(rows) == {"reference", "hole_quick", "etc"}
    assert rows["etc"].machine == result.machine.key
    assert rows["etc"].cold_s > rows["etc"].wall_s
    assert rows["hole_quick"].machine == "elsewhere"
    assert [item.key for item in result.other_machines] == ["elsewhere"]
    assert rows["hole_quick"].snr_error == pytest.approx(0.0, abs=1e-12)
    assert result.speed_ups == {}  # times of two machines are not compared


def test_refusals(small_case, make):
    work = [(small_case, points(small_case, "etc"))]
    with pytest.raises(InputError, match=r"--only = etc: not accepted; allowed: reference too: faint has none yet"):
        tradeoff(work, quick_look=True)
    old = make.result([make.row("reference", group="tier")], version="0.0.1", quick_look=True)
    with pytest.raises(InputError, match=r"results of version 0.0.1 with --quick-look"):
        tradeoff(work, earlier=old, quick_look=True)
    other = make.result([make.row("reference", group="tier")], version=__version__, quick_look=True)
    with pytest.raises(InputError, match="a new one"):
        tradeoff(work, earlier=other)
