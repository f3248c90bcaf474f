"""One job in a process of its own, timed stage by stage from outside the package; used by make.py.

``python reports/profile/stages.py JOB OUT.json``: the package is the one that PYTHONPATH names. Every function of
`STAGES` is replaced by one that notes its processor time less that of the stages it calls in turn, and how much work it
was given. What a package does not have, because it is older, is left out.
"""

from __future__ import annotations

import functools
import importlib
import io
import json
import resource
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import redirect_stdout
from dataclasses import asdict, dataclass, field
from pathlib import Path
from types import ModuleType
from typing import Any

JOBS: dict[str, tuple[str, ...]] = {
    "cpic plan": ("-q", "plan", "--top", "5", "--workers", "1"),
    "cpic simulate": (
        "-q",
        "simulate",
        "paper_example",
        "--band",
        "F662",
        "--exposure-s",
        "20",
        "--em-gain",
        "20",
        "--frames",
        "30",
        "--workers",
        "1",
    ),
    "cpic etc": ("etc", "tau Cet", "--time-s", "36000", "--json"),
    "cpic rank": ("rank", "--json"),
}
WRITES = ("cpic plan", "cpic simulate")

# Stage: functions of it. Time belongs to the innermost stage.
STAGES: dict[str, tuple[str, ...]] = {
    "ranking": ("cpic_planner.ranking.order:rank_targets",),
    "separation, exposure and gain": (
        "cpic_planner.ranking.optimiser:best_in_band",
        "cpic_planner.ranking.optimiser:optimise",
        "cpic_planner.ranking.optimiser:_least_in_band",
    ),
    "completeness": ("cpic_planner.ranking.completeness:completeness",),
    "sensitivity of the ranking": ("cpic_planner.ranking.sensitivity:sensitivity",),
    "optical models and stamps": (
        "simulator.imaging.psf:single_band_psf",
        "simulator.imaging.store:psf_metrics",
        "simulator.imaging.build:hole_state_of",
    ),
    "transforms to the focal plane": ("simulator.imaging.imager:Imager._grid",),
    "propagation": ("simulator.imaging.imager:FocalGrid.intensity",),
    "drift screens": ("simulator.imaging.drift:ScreenModel.draw", "simulator.imaging.drift:screen_model"),
    "other sources, whole-frame star": (
        "simulator.observing.observation:off_axis_light",
        "simulator.observing.observation:full_star_map",
        "simulator.observing.scene_light:off_axis_light",
        "simulator.observing.scene_light:full_star_map",
        "simulator.observing.scene_light:star_column_light",
    ),
    "effect ledger": ("simulator.ledger.prediction:forecast", "simulator.ledger.choice:choose"),
    "generators of random numbers": ("cpic_core.random_streams:stream",),
    "camera, frame by frame": ("simulator.camera.visible:VisibleCamera.expose",),
    "camera, sums of frames": ("simulator.camera.visible:stack_electrons",),
    "camera, means": (
        "simulator.camera.visible:VisibleCamera.prepare",
        "simulator.observing.hole_stack:hole_stackable",
    ),
    "calibration of frames": ("cpic_planner.validation.frames:calibrated_frames",),
    "rejection of particles": ("cpic_planner.validation.rejection:reject_cosmic_rays",),
    "subtraction of the reference": (
        "cpic_planner.validation.reduced:reduce_stack",
        "cpic_planner.validation.roll:roll_subtract",
    ),
    "blind search": ("cpic_planner.validation.detection:search",),
    "photometry and positions": (
        "cpic_planner.validation.measure:measure_planets",
        "cpic_planner.validation.measure:planet_templates",
        "cpic_planner.validation.measure:positions_of",
    ),
    "rate of the star": (
        "cpic_planner.validation.star_flux:observe_off_mask",
        "cpic_planner.validation.star_flux:star_flux_off_mask",
    ),
    "report and pictures": ("cpic_planner.report.write:write_report",),
    "Level-0 files": ("simulator.products.write:write_level0",),
}
REST = "everything else"


@dataclass
class Stage:
    """Processor time of a stage, and the work that its floor is computed from."""

    cpu_s: float = 0.0
    calls: int = 0
    work: dict[str, float] = field(default_factory=dict)

    def add(self, **amounts: float) -> None:
        """Count work."""
        for name, amount in amounts.items():
            self.work[name] = self.work.get(name, 0.0) + amount


def _propagated(stage: Stage, given: tuple[Any, ...], _: Any) -> None:
    grid = given[0]
    n = len(grid.imager.transmission)
    nodes = [getattr(axis[0], "n_nodes", None) or len(axis[0]) for axis in (grid.rows, grid.columns)]
    # A quarter of the real operations of two complex products: what parity leaves where both axes are symmetric.
    stage.add(flop=grid.imager.weights.size * 2.0 * n * nodes[1] * (n + nodes[0]))


def _pixels(stage: Stage, given: tuple[Any, ...], _: Any) -> None:
    # Photons, register, read noise: three draws a pixel.
    stage.add(normals=3.0 * given[1].mean_e.size)


def _screens(stage: Stage, given: tuple[Any, ...], _: Any) -> None:
    if hasattr(given[0], "amplitude"):
        stage.add(normals=2.0 * given[0].amplitude.size)


def _calibrated(stage: Stage, _: tuple[Any, ...], answer: Any) -> None:
    stage.add(bytes=3.0 * answer.electrons.nbytes)  # frames and their bias in, electrons out


def _rejected(stage: Stage, given: tuple[Any, ...], answer: Any) -> None:
    stage.add(bytes=given[0].nbytes + given[1].nbytes + answer.rejected.nbytes)


def _streams(stage: Stage, _: tuple[Any, ...], __: Any) -> None:
    stage.add(streams=1.0)


WORK: dict[str, Callable[[Stage, tuple[Any, ...], Any], None]] = {
    "propagation": _propagated,
    "drift screens": _screens,
    "camera, frame by frame": _pixels,
    "camera, sums of frames": _pixels,
    "calibration of frames": _calibrated,
    "rejection of particles": _rejected,
    "generators of random numbers": _streams,
}


class Stopwatch:
    """Exclusive processor time of nested stages."""

    def __init__(self) -> None:
        self.stages: dict[str, Stage] = {name: Stage() for name in (*STAGES, REST)}
        self.running = [REST]
        self.since = time.process_time()

    def _note(self) -> None:
        now = time.process_time()
        self.stages[self.running[-1]].cpu_s += now - self.since
        self.since = now

    def start(self) -> None:
        """Begin anew."""
        self.stages.update({name: Stage() for name in self.stages})
        self.since = time.process_time()

    def stop(self) -> None:
        """Note the time up to now."""
        self._note()

    def wrapped(self, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """The function, timed."""
        count = WORK.get(name)

        @functools.wraps(function)
        def timed(*given: Any, **named: Any) -> Any:
            self._note()
            self.running.append(name)
            try:
                answer = function(*given, **named)
            finally:
                self._note()
                self.running.pop()
            self.stages[name].calls += 1
            if count is not None:
                count(self.stages[name], given, answer)
            return answer

        return timed

    def install(self) -> None:
        """Replace the functions of all stages wherever they were imported."""
        for name, functions in STAGES.items():
            for place in functions:
                path, _, what = place.partition(":")
                try:
                    owner: Any = importlib.import_module(path)
                except ModuleNotFoundError:
                    continue
                *holders, last = what.split(".")
                for holder in holders:
                    owner = getattr(owner, holder)
                function = getattr(owner, last, None)
                if function is not None:
                    self._replace(owner, last, function, self.wrapped(name, function))

    @staticmethod
    def _replace(owner: Any, last: str, function: Any, timed: Any) -> None:
        setattr(owner, last, timed)
        if not isinstance(owner, ModuleType):
            return
        for path, module in list(sys.modules.items()):
            if path.split(".")[0] in {"simulator", "cpic_planner"}:
                for attribute in [key for key, value in vars(module).items() if value is function]:
                    setattr(module, attribute, timed)


def _loaded() -> None:
    """Import what the jobs need: loading libraries is not a stage of the physics."""
    for name in (
        "cpic_planner.cli.main",
        "cpic_planner.confirm.plan",
        "cpic_planner.report.write",
        "simulator.observing.observation",
        "simulator.products",
        "cpic_planner.cli.image_commands",
        "cpic_planner.cli.image_commands",
        "cpic_planner.cli.etc_command",
        "cpic_planner.cli.rank_command",
        "matplotlib.figure",
        "scipy.stats",
        "matplotlib.backends.backend_agg",
        "photutils.aperture",
        "astropy.io.fits",
        "scipy.optimize",
        "scipy.special",
        "sep",
    ):
        importlib.import_module(name)


def _run(job: str, folder: Path) -> None:
    main = importlib.import_module("cpic_planner.cli.main").main
    arguments = [*JOBS[job], "--out", str(folder)] if job in WRITES else [*JOBS[job]]
    with redirect_stdout(io.StringIO()):
        status = main(arguments)
    if status:
        raise SystemExit(status)


def main(job: str, out: str) -> None:
    """Run a job once to warm up (not the plan: a scene of one frame stands for it), then time it."""
    _loaded()
    watch = Stopwatch()
    watch.install()
    with tempfile.TemporaryDirectory() as folder:
        if job == "cpic plan":  # compiles the camera, fills the caches of the disk
            main_ = importlib.import_module("cpic_planner.cli.main").main
            with redirect_stdout(io.StringIO()):
                main_(
                    [
                        "-q",
                        "plan",
                        "--top",
                        "1",
                        "--realisations",
                        "1",
                        "--workers",
                        "1",
                        "--band",
                        "F662",
                        "--out",
                        f"{folder}/warm",
                    ]
                )
        else:
            _run(job, Path(folder) / "warm")
        wall, cpu = time.perf_counter(), time.process_time()
        watch.start()
        _run(job, Path(folder) / "timed")
        watch.stop()
        wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)
    stages = {name: asdict(stage) for name, stage in watch.stages.items() if stage.calls or name == REST}
    Path(out).write_text(json.dumps({"wall_s": wall, "cpu_s": cpu, "peak_bytes": peak, "stages": stages}))


if __name__ == "__main__":
    main(*sys.argv[1:3])
