"""Reduce Level-0 files: which calibrations each sequence is reduced with, and every master and sequence a task."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from cpic_core import InputError, digest_of
from cpic_planner import results
from cpic_planner.jobs import Cost, Job, Runner, Task, contents_of
from cpic_planner.queries import ReduceQuestion
from cpic_planner.version import __version__
from simulator import reduction
from simulator.config import Instrument
from simulator.reduction import Level0, Plan

RESULT_VERSION = 1
"""Raised when the same files give other numbers, so that old folders are not continued."""
MASTERS = "Masters"
_START_S, _MASTER_S_MPX, _SEQUENCE_S_MPX = 1.0, 0.08, 0.15
_MEMORY_MB = 550.0


class _Found:
    """The files of a question, read as far as their headers."""

    def __init__(self, question: ReduceQuestion) -> None:
        self.left_out: list[str] = []
        self.maps: dict[str, Path] = {}
        self.sequences: dict[str, Level0] = {}
        own = self._read(question.what, question.instrument)
        calibrations = own if question.masters is None else self._read(question.masters, question.instrument)
        self.calibrations = [item for _, item, _ in calibrations if item.kind in reduction.MASTER_KINDS]
        for name, item, named in own:
            if item.kind == "BIAS" or (item.kind in reduction.MASTER_KINDS and not named):
                continue
            if name in self.sequences:
                hint = f"{self.sequences[name].path} has the same name"
                raise InputError("what", str(item.path), allowed="files of different names", hint=hint)
            self.sequences[name] = item
        if not self.sequences:
            allowed = "Level-0 files, or folders of them, with frames other than bias, dark and flat"
            raise InputError(
                "what", ", ".join(map(str, question.what)), allowed=allowed, hint=next(iter(self.left_out), "")
            )
        self.plans = {name: reduction.plans_for(item, self.calibrations) for name, item in self.sequences.items()}
        self.masters = {
            plan.name: plan for plans in self.plans.values() for top in plans.values() for plan in top.all()
        }

    def _read(self, places: Sequence[Path], instrument: Instrument) -> list[tuple[str, Level0, bool]]:
        """Return Level-0 files with the names of their Level-1 files and whether they were named themselves."""
        found: list[tuple[str, Level0, bool]] = []
        for place in places:
            if not place.exists():
                raise InputError("what", str(place), allowed="a file or a folder that exists")
            for path, named in reduction.files_under(place):
                below = Path() if named else path.parent.relative_to(place)
                name = (below / reduction.level1_name(path)).as_posix()
                try:
                    found.append((name, reduction.read_level0(path, instrument), named))
                except InputError as error:
                    if kind := reduction.map_kind(path):
                        self.maps[kind] = path
                    elif named:
                        raise
                    else:
                        self.left_out.append(f"{path}: {error}")
        return found

    def files(self) -> list[Path]:
        """Return every file that decides the result."""
        raw = {item.path for item in self.sequences.values()}
        raw |= {file.path for plan in self.masters.values() for file in plan.files}
        return sorted(raw | set(self.maps.values()))


def reduction_job(question: ReduceQuestion) -> Job[results.ReductionResult]:
    """Return the job that reduces the files of a question.

    Parameters
    ----------
    question : ReduceQuestion

    Raises
    ------
    InputError
        For a named file that cannot be reduced, and where there is nothing to reduce.
    """
    found = _Found(question)
    maps = {kind: str(path.resolve()) for kind, path in found.maps.items()}

    def work(runner: Runner[Any]) -> results.ReductionResult:
        folder, root = runner.folder.path.resolve(), str(runner.folder.temporary.resolve())
        for kind in reduction.MASTER_KINDS:  # in the order in which they need each other
            tasks = [
                Task(plan.name, (plan, maps, root, str(folder)), text=plan.name, steps=_n_frames(plan.files))
                for plan in found.masters.values()
                if plan.kind == kind
            ]
            runner.finish(make_master, tasks)
        tasks = [
            Task(name, (name, item, found.plans[name], maps, root, str(folder)), steps=item.n_frames)
            for name, item in found.sequences.items()
        ]
        bodies = runner.finish(reduce_one, tasks)
        return results.ReductionResult(
            version=__version__,
            config_hash=runner.digest,
            n_frames=sum(item.n_frames for item in found.sequences.values()),
            masters=[_master_row(plan) for plan in found.masters.values()],
            sequences=[results.ReducedSequence(**bodies[name]["row"]) for name in found.sequences],
            left_out=found.left_out,
        )

    def decides() -> Mapping[str, Any]:
        files = {str(path): digest_of(path) for path in found.files()}
        return {"instrument": question.instrument.content_hash, "files": files, "sequences": list(found.sequences)}

    def cost() -> Cost:
        pixels = {name: item.shape[0] * item.shape[1] / 1e6 for name, item in found.sequences.items()}
        masters = sum(_n_frames(plan.files) for plan in found.masters.values())
        times = [_SEQUENCE_S_MPX * pixels[name] * item.n_frames for name, item in found.sequences.items()]
        frames = sum(item.n_frames for item in found.sequences.values())
        disk = sum(5.0 * pixels[name] * item.n_frames + 8.0 * pixels[name] for name, item in found.sequences.items())
        start_s = _START_S + _MASTER_S_MPX * max(pixels.values()) * masters
        counts = {"n_sequences": len(times), "n_frames": frames, "n_steps": frames + masters}
        return Cost(counts, times, start_s, _MEMORY_MB, disk, worker_mb=_MEMORY_MB)

    names = [*found.sequences, *(reduction.error_file(Path(name)).as_posix() for name in found.sequences)]
    return Job(
        kind="reduction",
        results=RESULT_VERSION,
        decides=decides,
        work=work,
        products=[*names, *(f"{MASTERS}/{name}.fits" for name in found.masters)],
        cost=cost,
    )


def _n_frames(files: Sequence[Level0]) -> int:
    return sum(file.n_frames for file in files)


def _master_row(plan: Plan) -> results.MasterRow:
    return results.MasterRow(
        kind=plan.kind,
        file=f"{MASTERS}/{plan.name}.fits",
        n_frames=_n_frames(plan.files),
        exposure_s=plan.files[0].exposure_s,
        em_gain=plan.files[0].em_gain,
        made_of=[str(file.path) for file in plan.files],
        made_with=[used.name for used in plan.uses],
    )


def _masters_of(plans: Mapping[str, Plan] | Sequence[Plan], maps: Mapping[str, str], folder: str) -> reduction.Masters:
    """Read the masters that were made."""
    every = plans.values() if isinstance(plans, Mapping) else plans
    made = {plan.kind: reduction.read_master(Path(folder, MASTERS, f"{plan.name}.fits")) for plan in every}
    return reduction.Masters(made, {kind: Path(path) for kind, path in maps.items()})


def make_master(plan: Plan, maps: Mapping[str, str], root: str, folder: str) -> dict[str, Any]:
    """Make one master below ``root/NAME``; return the size and checksum of its file."""
    own, name = Path(root, plan.name), f"{MASTERS}/{plan.name}.fits"
    own.mkdir(exist_ok=True)
    master = reduction.make_master(plan, _masters_of(plan.uses, maps, folder), own)
    reduction.write_master(own / name, master, plan.files[0].exposure_s)
    return {"files": contents_of(own, [name])}


def reduce_one(
    name: str, level0: Level0, plans: Mapping[str, Plan], maps: Mapping[str, str], root: str, folder: str
) -> dict[str, Any]:
    """Reduce one sequence below ``root/NAME``; return its row, and size and checksum of its files."""
    own = Path(root, name)
    own.mkdir(parents=True, exist_ok=True)
    made = reduction.reduce_sequence(level0, _masters_of(plans, maps, folder), own / name, own)
    row = results.ReducedSequence(
        file=name,
        error_file=reduction.error_file(Path(name)).as_posix(),
        level0=str(level0.path),
        kind=level0.kind,
        target=str(level0.header.get("OBJECT", "")),
        band=str(level0.header.get("FILTER", "")),
        exposure_s=level0.exposure_s,
        em_gain=level0.em_gain,
        assumed=list(level0.assumed),
        **{key: getattr(made, key) for key in ("n_frames", "steps", "mask_counts", "median_e", "error_e")},
    )
    return {"files": contents_of(own, [row.file, row.error_file]), "row": row.model_dump(mode="json")}
