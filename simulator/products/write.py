"""Write a sequence as Level-0 products: the file, its truth, and its folder of parameters."""

import contextlib
import csv
import hashlib
import io
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import IO, Any

import numpy as np

from cpic_core import (
    InputError,
    as_path,
    check_flag,
    check_writable,
    dump_json,
    fingerprint,
    numeric_context,
    utf8,
    whole_file,
    write_text,
)
from simulator.camera import Frame
from simulator.config import Detector
from simulator.products.ephemeris import Ephemeris, SequenceTimes, ephemeris, sequence_times
from simulator.products.keywords import KEYWORD_FILE, Value, load_keywords
from simulator.products.naming import ProductName, claim, clear_stale_parts, product_name, temporary_folders
from simulator.products.sequence import FrameSequence, camera_of, check_sequence, pointing_deg, settings_of, star_deg
from simulator.products.truth import TruthWriter, frame_values, ledger_cards, sequence_values, software_version
from simulator.products.units import append_image, append_primary, header_cards

CONFIGURATION_FILE = "configuration.json"
PARAMS_FILES = (CONFIGURATION_FILE, "keywords.yaml", "attitude.csv", "temperature.csv")
SUM_KEYWORD = "PARMSUM"
SCHEMA_VERSION = 1


def log_times(times: SequenceTimes) -> tuple[str, ...]:
    """Return the times of the logs: begin of every exposure and end of the last."""
    return (*times.begin_utc, times.stop_utc)


def params_of(
    sequence: FrameSequence,
    name: ProductName,
    times: SequenceTimes,
    sky: Ephemeris,
    primary: Mapping[str, Value],
) -> dict[str, str]:
    """Return the texts of the four files of one observation by their names.

    ``configuration.json`` holds instrument and scene as `simulator.load_instrument` and `simulator.load_scene` read
    them, the settings of the sequence, the effect ledger, and the sums of the other files; its own sum stands in the
    primary header. The logs have one row for the begin of every exposure and one for the end of the last; all that they
    say is modelled.

    Parameters
    ----------
    sequence : FrameSequence
    name : ProductName
    times : SequenceTimes
    sky : Ephemeris
    primary : mapping of str to Value
        Keywords and values of the primary header.
    """
    utc, camera = log_times(times), camera_of(sequence)
    warmth = [camera.temperature_k if isinstance(camera, Detector) else ""] * len(utc)
    others = {
        "keywords.yaml": KEYWORD_FILE.read_text(encoding="utf-8"),
        "attitude.csv": _attitude(sequence, utc, sky),
        "temperature.csv": _table(("utc", "detector_k"), zip(utc, warmth, strict=True)),
    }
    sums = {file: sum_of(utf8(text)) for file, text in others.items()}
    return {CONFIGURATION_FILE: dump_json(_configuration(sequence, name, times, primary) | {"files": sums})} | others


def sum_of(content: bytes) -> str:
    """Return the sha256 of a file of parameters; the primary header has its first 16 digits."""
    return hashlib.sha256(content).hexdigest()


def _configuration(
    sequence: FrameSequence, name: ProductName, times: SequenceTimes, primary: Mapping[str, Value]
) -> dict[str, Any]:
    instrument, scene = sequence.instrument, sequence.scene
    sections = {key: [[part.start, part.stop] for part in section] for key, section in sequence.sections.items()}
    words = ("key", "effect", "decision", "size", "reason")
    return {
        "schema_version": SCHEMA_VERSION,
        "software": {"name": primary["SWNAME"], "version": software_version(), "fingerprint": str(fingerprint())},
        "obsid": name.obsid,
        "file": name.file.as_posix(),
        "sequence": settings_of(sequence) | {"start_utc": times.start_utc},
        "header": dict(primary),
        "sections": sections,
        "calibration_files": list(sequence.calibration_files),
        "effects": [{key: getattr(row, key) for key in words} for row in sequence.ledger],
        "configuration_hash": instrument.content_hash,
        "instrument": instrument.model_dump(mode="json"),
        "provenance": {key: asdict(item) for key, item in instrument.provenance.items()},
        "scene": None if scene is None else scene.model_dump(mode="json"),
    }


def _attitude(sequence: FrameSequence, utc: Sequence[str], sky: Ephemeris) -> str:
    pointing = pointing_deg(sequence)
    names = ["utc", "ra_deg", "dec_deg", "pos_ang_deg", "x_km", "y_km", "z_km", "vx_km_s", "vy_km_s", "vz_km_s"]
    angles = {"sun_deg": sky.sun_deg, "moon_deg": sky.moon_deg, "limb_deg": sky.limb_deg}
    given = {key: values for key, values in angles.items() if values is not None}
    where = ("", "") if pointing is None else tuple(f"{value:.9f}" for value in pointing)
    turn = "" if sequence.scene is None else f"{sequence.roll_deg % 360.0:.6f}"
    rows = []
    for row, time in enumerate(utc):
        position = [f"{part:.6f}" for part in sky.position_km[row]]
        velocity = [f"{part:.9f}" for part in sky.velocity_km_s[row]]
        rows.append([time, *where, turn, *position, *velocity, *(f"{values[row]:.6f}" for values in given.values())])
    return _table((*names, *given), rows)


def _table(names: Iterable[str], rows: Iterable[Iterable[Any]]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(names)
    writer.writerows(rows)
    return text.getvalue()


Progress = Callable[[int, int], None]


@numeric_context()
def write_level0(
    observation: FrameSequence,
    out_dir: str | Path,
    *,
    obsid: str | int | None = None,
    overwrite: bool = False,
    truth: bool = True,
    progress: Progress | None = None,
) -> Path:
    """Write one sequence as Level-0 products.

    ``SCI/<MJD>`` or ``CAL/<MJD>`` gets the FITS file: an empty primary unit and one image a frame. ``Truth/<MJD>`` gets
    the truth, in a branch of its own so that nothing that reads a folder of Level 0 finds it, and blind tests need only
    leave that branch out. ``Params/<OBSID>`` gets configuration, keyword table, and logs of attitude and temperature.
    The Level-0 file appears last: where it is, the others are.

    Parameters
    ----------
    observation : FrameSequence
        What `simulator.observe` returns, or a calibration sequence. Frames are taken one at a time.
    out_dir : str or Path
        Root of the tree; made where it does not exist.
    obsid : str or int, optional
        Number of the observation, eleven digits that begin with that of the instrument; made from the content of the
        sequence if absent.
    overwrite : bool
        Replace the products of the same name.
    truth : bool
        Write the truth too.
    progress : callable, optional
        Called with the number of frames that are written and the number of all, after each frame.

    Returns
    -------
    Path
        The Level-0 file.

    Raises
    ------
    InputError
        If the file exists and ``overwrite`` is false, if another observation of the tree has the same number, or if the
        sequence cannot be written.
    OSError
        If the disk is full or the folder is not writable.

    Notes
    -----
    A write that fails leaves neither file nor folder behind. One that is killed leaves its hidden temporary files,
    which the next write of the same file removes.
    """
    check_sequence(observation)
    table = load_keywords()
    profile = table.profile(observation.instrument.mission.keyword_profile)
    n_frames = int(observation.n_frames)
    times = sequence_times(observation.start_utc, observation.exposure_s, observation.readout_s, n_frames)
    name = product_name(observation, times, obsid)
    root = as_path("out_dir", out_dir)
    for key, value in (("overwrite", overwrite), ("truth", truth)):
        check_flag(key, value)
    if progress is not None and not callable(progress):
        raise InputError("progress", progress, allowed="a function of two whole numbers")
    check_writable(root, key="out_dir", folder=True)
    refuse_taken(root, name, overwrite=overwrite)
    sky = ephemeris(observation.instrument.mission.orbit, log_times(times), star_deg(observation))
    primary, shared = sequence_values(observation, name, times, sky)
    params = params_of(observation, name, times, sky, primary)
    primary[SUM_KEYWORD] = sum_of(utf8(params[CONFIGURATION_FILE]))[:16]
    header = [*header_cards(primary, table, profile), *ledger_cards(observation)]

    folders = [(root / place).parent for place in (name.file, name.truth, name.params)]
    with (
        temporary_folders(folders, whole=root / name.params, done=root / name.file),
        _new_file(root / name.file, overwrite=overwrite) as file,
    ):
        append_primary(file, header)
        with contextlib.ExitStack() as stack:
            writer = None
            if truth:
                writer = TruthWriter(stack.enter_context(_new_file(root / name.truth)), observation, times)
                writer.begin(name, primary, shared)
            for index, frame in enumerate(_frames(observation)):
                values = frame_values(shared, index, times, frame)
                datasum = append_image(file, frame.adu, header_cards(values, table, profile), "IMAGE", index + 1)
                if writer is not None:
                    writer.add(frame, datasum)
                if progress is not None:
                    progress(index + 1, n_frames)
            if writer is not None:
                writer.end()
            if not overwrite and (root / name.file).exists():
                raise _exists(root / name.file)  # by another process: its truth and parameters stay
            # Before the truth gets its name: without parameters there is no product.
            (root / name.params).mkdir(parents=True, exist_ok=True)
            for file_name, text in params.items():
                write_text(root / name.params / file_name, text)
        if not truth:
            # What an earlier file of this name left would be the truth of other frames.
            (root / name.truth).unlink(missing_ok=True)
    return root / name.file


def refuse_taken(root: Path, name: ProductName, *, overwrite: bool) -> None:
    """Refuse a file that exists, and a number that another observation of the tree has.

    Parameters
    ----------
    root : Path
        Top of the tree of products.
    name : ProductName
    overwrite : bool
        Whether a file that exists is replaced.

    Raises
    ------
    InputError
        Naming the file, unless ``overwrite``, or the number and the file that has it.
    """
    path = root / name.file
    if path.exists() and not overwrite:
        raise _exists(path)
    if root.exists() and not root.is_dir():
        raise InputError("out_dir", str(root), allowed="a folder")
    for other in sorted(root.glob(f"*/*/CSST_CPIC_*_{name.obsid}_X_L0_V??.fits")):
        found = ProductName.parse(other.name)
        if found is not None and other.parent.parent.name in ("SCI", "CAL") and found.times != name.times:
            allowed = "a number that no other observation of the tree has"
            raise InputError("obsid", name.obsid, allowed=allowed, hint=f"it is that of {other}")


def _exists(path: Path) -> InputError:
    return InputError("file", str(path), allowed="a file that does not exist yet", hint="overwrite=True replaces it")


@contextlib.contextmanager
def _new_file(path: Path, *, overwrite: bool = True) -> Iterator[IO[bytes]]:
    """Open a whole file in a folder that is made where it does not exist."""
    path.parent.mkdir(parents=True, exist_ok=True)
    clear_stale_parts(path)
    try:
        with whole_file(path, overwrite=overwrite) as file:
            claim(file)
            yield file
    except FileExistsError as error:
        if error.filename != str(path):
            raise
        raise _exists(path) from None


def _frames(sequence: FrameSequence) -> Iterator[Frame]:
    """Yield the frames of a sequence; refuse what is not as it said."""
    shape, count = tuple(sequence.shape), 0
    for frame in sequence.iter_full_frames():
        for what, array, kind in (("adu", frame.adu, np.uint16), ("mask", frame.mask, np.uint8)):
            _check_array(f"frame {count + 1} {what}", array, kind, shape)
        count += 1
        if count <= sequence.n_frames:
            yield frame
    if count != sequence.n_frames:
        raise InputError("n_frames", sequence.n_frames, allowed=f"the number of frames that were made, {count}")


def _check_array(key: str, array: Any, kind: type[np.generic], shape: tuple[int, ...]) -> None:
    if array.dtype != kind or array.shape != shape:
        raise InputError(key, f"{array.dtype} array of shape {array.shape}", allowed=f"{np.dtype(kind)}, shape {shape}")
