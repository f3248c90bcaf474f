"""Write a sequence as Level-0 products: the file, its truth, and its folder of parameters."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO, Any

import numpy as np

from catalogs.errors import InputError
from simulator.camera.frame import Frame
from simulator.files import whole_file
from simulator.numeric import numeric_context
from simulator.products.ephemeris import ephemeris
from simulator.products.folders import claim, clear_stale_parts, temporary_folders
from simulator.products.headers import frame_values, ledger_cards, sequence_values
from simulator.products.keywords import load_keywords
from simulator.products.naming import ProductName, product_name
from simulator.products.params import log_times, write_params
from simulator.products.places import star_deg
from simulator.products.sequence import FrameSequence, check_sequence
from simulator.products.times import sequence_times
from simulator.products.truth import TruthWriter
from simulator.products.units import append_image, append_primary, header_cards

__all__ = ["refuse_taken", "write_level0"]

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
    times = sequence_times(
        observation.start_utc, observation.exposure_s, observation.readout_s, int(observation.n_frames)
    )
    name = product_name(observation, times, obsid)
    root = Path(out_dir)
    refuse_taken(root, name, overwrite=overwrite)
    sky = ephemeris(observation.instrument.mission.orbit, log_times(times), star_deg(observation))
    primary, shared = sequence_values(observation, name, times, sky)
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
                    progress(index + 1, int(observation.n_frames))
            if writer is not None:
                writer.end()
            if not overwrite and (root / name.file).exists():
                raise _exists(root / name.file)  # by another process: its truth and parameters stay
            # Before the truth gets its name: without parameters there is no product.
            write_params(root / name.params, observation, name, times, sky, primary)
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
            raise InputError(
                "obsid",
                name.obsid,
                allowed="a number that no other observation of the tree has",
                hint=f"it is that of {other}",
            )


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
