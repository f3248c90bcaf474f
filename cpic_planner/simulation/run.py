"""Run a simulation: every sequence a task, every finished one kept, the rest done when it is started again."""

import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Unpack, cast

from cpic_core import InputError, digest_of, dump_json, fingerprint, is_file
from cpic_planner.jobs import Finished, Job, RunFolder, Runner, RunSettings, Task, run
from cpic_planner.results import SimulatedProgramme, SimulatedSequence, SimulationResult, VisitRow
from cpic_planner.simulation.inputs import check_light, disk_bytes, located, modelled, sequences_cost
from cpic_planner.simulation.sequences import PlannedSequence, plan_sequences
from cpic_planner.version import __version__
from simulator import products
from simulator.camera import Frame
from simulator.config import FrozenModel, SimulationConfig, content_hash

RESULT_VERSION = 3
"""Raised when the same configuration gives other frames, so that old folders are not continued."""


def simulation_job(
    planned: Sequence[PlannedSequence], simulation: SimulationConfig, *, truth: bool, notes: Sequence[str] = ()
) -> Job[SimulationResult]:
    """Return the job that makes the Level-0 products of a simulation.

    Parameters
    ----------
    planned : sequence of PlannedSequence
        Its sequences, see `cpic_planner.simulation.sequences.plan_sequences`.
    simulation : SimulationConfig
    truth : bool
        Write the truth beside the products.
    notes : sequence of str
        Remarks on the reading of tables of stars.
    """
    digests = _Digests()
    settings = [item.settings(digests) for item in planned]

    def work(runner: Runner) -> SimulationResult:
        folder = runner.folder
        for item in planned:
            products.refuse_taken(folder.path / item.folder, item.name, overwrite=True)
        root = str(folder.temporary.resolve())
        tasks = [Task(item.obsid, (item, root, truth), steps=item.n_frames) for item in planned]
        bodies = runner.finish(make_sequence, tasks, store=_Products(folder), tells=True)
        rows = [_row(item, own, bodies[item.obsid], truth) for item, own in zip(planned, settings, strict=True)]
        return SimulationResult(
            version=__version__,
            config_hash=runner.digest,
            name=simulation.name,
            description=simulation.description,
            n_frames=sum(item.n_frames for item in planned),
            size_bytes=sum(row.size_bytes for row in rows),
            sequences=rows,
            programmes=list(_programmes(planned, bodies)),
            notes=list(notes),
        )

    def write(folder: RunFolder, result: SimulationResult, bodies: Mapping[str, Any]) -> None:
        for programme in result.programmes:
            folder.write(programme.file, dump_json(programme.model_dump(mode="json")))

    return Job(
        kind="simulation",
        results=RESULT_VERSION,
        decides=lambda: {"truth": truth, "sequences": settings, "files": digests.files},
        work=work,
        write=write,
        products=[*(name for item in planned for name in _files(item, truth=truth)), *_manifests(planned)],
        cost=lambda: sequences_cost(planned, [modelled(item) for item in planned], truth=truth),
    )


def simulate(
    simulation: SimulationConfig,
    out: str | Path,
    *,
    truth: bool = True,
    notes: Sequence[str] = (),
    **how: Unpack[RunSettings],
) -> Finished[SimulationResult]:
    """Make the Level-0 products of a simulation.

    Parameters
    ----------
    simulation : SimulationConfig
        See `simulator.config.scene_files.load_simulation`.
    out : str or Path
        Root of the tree of products; continued when it holds part of the same simulation.
    truth : bool
        Write the truth beside the products.
    notes : sequence of str
        Remarks on the reading of tables of stars, as `cpic_planner.simulation.simulation_from` returns them.
    **how
        As of `cpic_planner.jobs.job.run`. Workers of another ``scheduler`` see ``out`` under the same name.
        ``advance`` is told about frames: one by one in this process, a sequence at a time with several workers.

    Raises
    ------
    InputError
        For bad input, too small a disk, or if ``out`` is in use or holds another configuration.
    """
    planned = plan_sequences(simulation)
    check_light(planned)
    job = simulation_job(planned, simulation, truth=truth, notes=notes)
    _check_room(Path(out), planned, truth=truth)
    return run(job, out, **how)


@dataclass(frozen=True)
class _Products:
    """Sequences in the folder of a run: on record when all of their files are on disk."""

    folder: RunFolder

    def part(self, key: str) -> dict[str, Any] | None:
        stored = self.folder.part(key)
        return stored if stored is not None and _whole(self.folder.path, stored) else None

    def save_part(self, key: str, body: dict[str, Any]) -> dict[str, Any]:
        for name in reversed(body["files"]):  # the Level-0 file last: where it is, the others are
            self.folder.adopt(self.folder.temporary / key / name, name, **body["files"][name])
        return self.folder.save_part(key, body)


@dataclass
class _Digests:
    """Hashes of scenes and instruments, each taken once, and of the files that they name."""

    files: dict[str, str] = field(default_factory=dict)
    _known: dict[int, str] = field(default_factory=dict)

    def __call__(self, part: FrozenModel) -> str:
        if id(part) not in self._known:
            tree = part.model_dump(mode="json")
            self.files |= {name: digest_of(name) for name in _named_files(tree) if name not in self.files}
            self._known[id(part)] = content_hash(tree)
        return self._known[id(part)]


def _named_files(tree: Any) -> Iterator[str]:
    """Yield the texts of a configuration that are names of files."""
    if isinstance(tree, dict):
        for item in tree.values():
            yield from _named_files(item)
    elif isinstance(tree, list):
        for item in tree:
            yield from _named_files(item)
    elif isinstance(tree, str) and is_file(tree):
        yield tree


@dataclass
class _Tally:
    """The contents of the frames of a sequence, noted while they go by."""

    sequence: products.FrameSequence
    adu_min: int = 2**16 - 1
    adu_max: int = 0
    saturated_pixels: int = 0
    clipped_pixels: int = 0
    cosmic_rays: int = 0

    def __getattr__(self, name: str) -> Any:
        return getattr(self.sequence, name)

    def iter_full_frames(self) -> Iterator[Frame]:
        """Yield the frames of the sequence."""
        for frame in self.sequence.iter_full_frames():
            self.adu_min = min(self.adu_min, int(frame.adu.min()))
            self.adu_max = max(self.adu_max, int(frame.adu.max()))
            self.saturated_pixels = max(self.saturated_pixels, int(frame.lost.sum()))
            self.clipped_pixels = max(self.clipped_pixels, frame.n_clipped)
            self.cosmic_rays += frame.n_cosmic_rays
            yield frame


_TALLIED = ("adu_min", "adu_max", "saturated_pixels", "clipped_pixels", "cosmic_rays")


def make_sequence(
    item: PlannedSequence, root: str, truth: bool, *, progress: Callable[..., None] | None = None
) -> dict[str, Any]:
    """Make the files of one sequence below ``root/OBSID``; return their sizes and checksums, and what frames hold."""
    own = Path(root) / item.obsid
    try:
        tally = _Tally(item.build())
        shown = f"{item.target} {item.band}".strip()
        advance = None if progress is None else lambda done, total: progress(shown, 1)
        products.write_level0(
            cast(Any, tally), own / item.folder, obsid=item.obsid, overwrite=True, truth=truth, progress=advance
        )
    except InputError as error:
        raise located(error, f"sequence {item.obsid}") from None
    names = _files(item, truth=truth)
    files = {name: {"size_bytes": (own / name).stat().st_size, "sha256": digest_of(own / name)} for name in names}
    streams = {} if item.part is None else {"streams": list(tally.path)}
    return {"files": files} | {name: getattr(tally, name) for name in _TALLIED} | streams


def _files(item: PlannedSequence, *, truth: bool) -> list[str]:
    """Return the files of a sequence below the root, the Level-0 file first."""
    params = [item.name.params / file for file in products.PARAMS_FILES]
    return [item.place(path) for path in [item.name.file, *([item.name.truth] if truth else []), *params]]


def _manifests(planned: Sequence[PlannedSequence]) -> dict[str, list[PlannedSequence]]:
    """Return the sequences of each programme by the file that lists them."""
    found: dict[str, list[PlannedSequence]] = {}
    for item in planned:
        if item.part is not None:
            found.setdefault((Path(item.programme) / products.PROGRAMME_FILE).as_posix(), []).append(item)
    return found


def _programmes(planned: Sequence[PlannedSequence], bodies: Mapping[str, Any]) -> Iterator[SimulatedProgramme]:
    """Yield what each programme is."""
    for file, items in _manifests(planned).items():
        science = next(item for item in items if item.entry.role == "science").entry
        looked = {item.target for item in items if item.entry.role == "reference"}
        yield SimulatedProgramme(
            fingerprint=str(fingerprint()),
            file=file,
            target=science.scene.name if science.scene else "",
            reference=next(iter(looked), None),
            visits=science.visits,
            reference_visits=science.references,
            reference_scheme=science.reference_scheme,
            visit_gap_h=science.visit_gap_h,
            orbit_s=products.orbit_s(science),
            span_days=max(item.end_mjd for item in items) - min(item.begin_mjd for item in items),
            sequences=[_visit_row(item, bodies[item.obsid]["streams"]) for item in items],
        )


def _visit_row(item: PlannedSequence, streams: list[str | int]) -> VisitRow:
    assert item.part is not None
    shared = {name: getattr(item.part, name) for name in ("role", "n_visits", "first_frame", "n_frames")}
    shared |= {name: getattr(item, name) for name in ("obsid", "band", "exposure_s", "em_gain", "start_utc")}
    return VisitRow(
        visit=item.part.visit + 1,
        window=item.part.window + 1,
        folder=item.part.folder,
        file=(Path(item.part.folder) / item.name.file).as_posix(),
        begin_mjd=item.begin_mjd,
        end_mjd=item.end_mjd,
        roll_deg=item.entry.roll_deg,
        seed=item.entry.seed,
        streams=streams,
        **shared,
    )


def _whole(root: Path, body: dict[str, Any]) -> bool:
    """Return whether the files of a sequence are as they were left."""
    for name, known in body["files"].items():
        path = root / name
        if not path.is_file() or path.stat().st_size != known["size_bytes"] or digest_of(path) != known["sha256"]:
            return False
    return True


def _check_room(root: Path, planned: Sequence[PlannedSequence], *, truth: bool) -> None:
    """Refuse a simulation that the disk has no room for, before anything is written."""
    needed = sum(disk_bytes(item, truth=truth) for item in planned if not (root / item.place(item.name.file)).exists())
    whole = root.resolve()
    free = shutil.disk_usage(next(place for place in (whole, *whole.parents) if place.is_dir())).free
    if needed > free:
        allowed = f"a disk with {needed / 1e6:,.1f} MB to spare"
        hint = f"{free / 1e6:,.1f} MB are free there, {(needed - free) / 1e6:,.1f} MB too few"
        raise InputError("--out", str(root), allowed=allowed, hint=hint)


def _row(item: PlannedSequence, settings: dict[str, Any], body: Mapping[str, Any], truth: bool) -> SimulatedSequence:
    return SimulatedSequence(
        **item.row(),
        modelled=modelled(item),
        settings=settings,
        truth=item.place(item.name.truth) if truth else None,
        params=item.place(item.name.params),
        size_bytes=sum(known["size_bytes"] for known in body["files"].values()),
        sha256=body["files"][item.place(item.name.file)]["sha256"],
        **{name: body[name] for name in _TALLIED},
    )
