import pytest

from cpic_planner.results import MachineRecord, TradeoffResult, TradeoffRow, TradeoffScene
from cpic_planner.tradeoff.scenes import SCENES, FixedScene

SMALL = {"n_columns": 236, "n_rows": 206, "star_column": 118, "star_row": 100}


@pytest.fixture(scope="session")
def small_case():
    """The faint planet in two frames of a small detector."""
    return FixedScene.of(SCENES["faint"], n_frames=2, detector=SMALL)


def machine(key="here"):
    return MachineRecord(
        key=key,
        processor="p",
        cores=2,
        memory_gb=8.0,
        system="s",
        python="3",
        numpy="2",
        scipy="1",
        numba="0",
        blas="b",
        blas_threads=1,
    )


def row(point, *, group="images", scene="faint", **values):
    common = {
        "title": point.replace("_", " "),
        "status": "ok",
        "wall_s": 1.0,
        "cpu_s": 0.9,
        "peak_memory_mb": 100.0,
        "repeats": 1,
        "flux_e": 100.0,
        "n_frames": 4,
        "machine": "here",
        "version": "1",
        "settings": {"draw": "frames", "region": "full"},
    }
    return TradeoffRow(scene=scene, point=point, group=group, **common | values)


def result_of(rows, **values):
    shown = [
        TradeoffScene(
            name=case.name,
            title=case.title,
            why=case.why,
            band=case.band,
            exposure_s=case.exposure_s,
            n_frames=4,
            em_gain=case.em_gain,
            scene_model=case.scene_model,
        )
        for case in SCENES.values()
        if any(item.scene == case.name for item in rows)
    ]
    common = {"version": "1", "quick_look": False, "machine": machine(), "scenes": shown, "rows": rows}
    return TradeoffResult(**common | values)


@pytest.fixture
def make():
    """Builders of rows, machines and results."""

    class Make:
        row = staticmethod(row)
        machine = staticmethod(machine)
        result = staticmethod(result_of)

    return Make
