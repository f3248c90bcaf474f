"""Names and places of Level-0 products (Zhu et al. 2025), and their folders and temporary files.

Names and places of Level-0 products (Zhu et al. 2025, section Level 0 Data Products).
"""

import contextlib
import re
import shutil
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from cpic_core import InputError
from simulator.config import content_hash
from simulator.products.ephemeris import SequenceTimes, stamp
from simulator.products.sequence import SCIENCE_KINDS, FrameSequence, settings_of


@contextlib.contextmanager
def temporary_folders(folders: Iterable[Path], *, whole: Path, done: Path) -> Iterator[None]:
    """Remove on failure what was not there before: the folders where they are empty, and ``whole`` with its files.

    Where there is a file ``done``, somebody else was faster, and ``whole`` is theirs.

    Parameters
    ----------
    folders : iterable of Path
        Folders that may be made.
    whole : Path
        Folder that is written as a whole.
    done : Path
        File that is there when it is done.
    """
    made = {place for folder in folders for place in (folder, *folder.parents) if not place.exists()}
    new = not whole.exists()
    try:
        yield
    except BaseException:
        with contextlib.suppress(OSError):
            if new and not done.exists():
                shutil.rmtree(whole)
        for place in sorted(made, key=lambda path: len(path.parts), reverse=True):
            with contextlib.suppress(OSError):
                place.rmdir()  # which refuses one that somebody else has put a file in
        raise


def claim(file: IO[bytes]) -> None:
    """Mark a temporary file as one that a living process writes; the mark dies with the process."""
    import fcntl

    with contextlib.suppress(OSError):  # a file system without locks
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)


def clear_stale_parts(path: Path) -> None:
    """Remove temporary files of ``path`` that no living process has claimed: what killed runs of it left."""
    import fcntl

    for part in path.parent.glob(f".{path.name}.*.part"):
        with contextlib.suppress(OSError), part.open("rb") as file:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            part.unlink()


OBSID_DIGITS = 11
_NAME = re.compile(
    r"CSST_CPIC_(?P<camera>VIS|NIR)_(?P<kind>BIAS|DARK|FLAT|BKG|LASER|SCI|DSF|CALS)"
    r"_(?P<start>\d{14})_(?P<end>\d{14})_(?P<obsid>\d{11})_X_L0_V(?P<version>\d\d)\.fits",
    re.ASCII,
)


@dataclass(frozen=True)
class ProductName:
    """Parts of the name of one Level-0 file, and the places of what belongs to it.

    Attributes
    ----------
    camera, kind : str
    start, end : str
        Fourteen digits, UTC.
    obsid : str
        Eleven digits.
    version : int
    day : int
        Modified Julian Date of the begin, whole days.
    """

    camera: str
    kind: str
    start: str
    end: str
    obsid: str
    version: int
    day: int

    @property
    def stem(self) -> str:
        """File name without its ending."""
        return f"CSST_CPIC_{self.camera}_{self.kind}_{self.start}_{self.end}_{self.obsid}_X_L0_V{self.version:02d}"

    @property
    def times(self) -> tuple[str, ...]:
        """What files of one observation share, whatever their version."""
        return self.camera, self.kind, self.start, self.end

    @property
    def branch(self) -> str:
        """``SCI`` or ``CAL``."""
        return "SCI" if self.kind in SCIENCE_KINDS else "CAL"

    @property
    def file(self) -> Path:
        """Level-0 file below the root of the tree."""
        return Path(self.branch, str(self.day), f"{self.stem}.fits")

    @property
    def truth(self) -> Path:
        """Truth of the file, in a branch of its own: what reads a folder of Level 0 must not find it."""
        return Path("Truth", str(self.day), f"{self.stem}_TRUTH.fits")

    @property
    def params(self) -> Path:
        """Folder of configuration, keyword table and logs of the observation."""
        return Path("Params", self.obsid, f"V{self.version:02d}")

    @classmethod
    def parse(cls, name: str, day: int = 0) -> "ProductName | None":
        """Take a file name apart; None if it is not that of a Level-0 file.

        Parameters
        ----------
        name : str
            Name of a file.
        day : int, optional
            Day of the folder, MJD.
        """
        found = _NAME.fullmatch(name)
        if found is None:
            return None
        camera, kind, start, end, obsid, version = found.groups()
        return cls(camera, kind, start, end, obsid, int(version), day)


def product_name(sequence: FrameSequence, times: SequenceTimes, obsid: str | int | None) -> ProductName:
    """Return the name of a sequence's file.

    Parameters
    ----------
    sequence : FrameSequence
    times : SequenceTimes
        The stamps are begin of the first and end of the last exposure.
    obsid : str, int or None
        Number of the observation; `obsid_of` the sequence if None.
    """
    mission = sequence.instrument.mission
    number = obsid_of(sequence) if obsid is None else checked_obsid(obsid, mission.obsid_prefix)
    start, stop, version = stamp(times.start_utc), stamp(times.stop_utc), mission.product_version
    return ProductName(sequence.camera, sequence.kind, start, stop, number, version, times.day)


def checked_obsid(obsid: Any, prefix: str) -> str:
    """Return the number of an observation as eleven digits.

    Parameters
    ----------
    obsid : object
        What was given.
    prefix : str
        Digits that it begins with.

    Raises
    ------
    InputError
        If it is not eleven digits that begin with ``prefix``.
    """
    text = str(obsid) if isinstance(obsid, str | int) and not isinstance(obsid, bool) else ""
    if re.fullmatch(r"\d{11}", text, re.ASCII) is None or not text.startswith(prefix):
        raise InputError("obsid", obsid, allowed=f"{OBSID_DIGITS} digits that begin with {prefix}")
    return text


def obsid_of(sequence: FrameSequence) -> str:
    """Return a number made from the content of a sequence: the same sequence has the same one in every run."""
    prefix, scene = sequence.instrument.mission.obsid_prefix, sequence.scene
    identity = settings_of(sequence)
    del identity["readout_s"]  # which is of the instrument
    identity |= {"instrument": sequence.instrument.content_hash, "scene": None if scene is None else scene.content_hash}
    identity["header"] = {key: str(value) for key, value in sequence.header.items()}
    digits = OBSID_DIGITS - len(prefix)
    return f"{prefix}{int(content_hash(identity), 16) % 10**digits:0{digits}d}"
