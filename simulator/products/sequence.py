"""A sequence of frames as it is written: its name and places, and visits in windows of the orbit.

Names and places of Level-0 products are those of Zhu et al. 2025, section Level 0 Data Products.
"""

from __future__ import annotations

import contextlib
import math
import re
import shutil
from collections import defaultdict
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, TypeAlias

import numpy as np

from cpic_core import ArrayLike, FloatArray, InputError, Record
from simulator import config
from simulator.products.ephemeris import CircularOrbit, SequenceTimes, stamp
from simulator.target import detector_to_sky

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from simulator.camera import Frame
    from simulator.observing import FrameSequence


def settings_of(sequence: FrameSequence) -> dict[str, Any]:
    """Return the settings of a sequence as plain values, by name."""
    return {
        "camera": str(sequence.camera),
        "kind": str(sequence.kind),
        "band": str(sequence.band),
        "n_frames": int(sequence.n_frames),
        "exposure_s": float(sequence.exposure_s),
        "readout_s": float(sequence.readout_s),
        "em_gain": float(sequence.em_gain),
        "seed": int(sequence.seed),
        "start_utc": str(sequence.start_utc),
        "roll_deg": float(sequence.roll_deg),
        "shape": [int(side) for side in sequence.shape],
    }


def camera_of(sequence: FrameSequence) -> config.AnyDetector:
    """Return the configuration of the camera that took a sequence."""
    return sequence.instrument.channel(sequence.camera).detector


def star_deg(sequence: FrameSequence) -> tuple[float, float] | None:
    """Return the right ascension and declination of the target; None if it has none."""
    star = None if sequence.scene is None else sequence.scene.cstar
    if star is None or star.ra_deg is None or star.dec_deg is None:
        return None
    return float(star.ra_deg), float(star.dec_deg)


Places: TypeAlias = tuple[FloatArray, FloatArray]


def sky_places(sequence: FrameSequence, x_arcsec: ArrayLike, y_arcsec: ArrayLike) -> Places | None:
    """Return right ascension and declination at offsets from the target on the detector; None if it has none.

    Parameters
    ----------
    sequence : FrameSequence
    x_arcsec, y_arcsec : array_like
        Offsets along columns and rows.
    """
    from astropy import units as u
    from astropy.coordinates import offset_by

    star = star_deg(sequence)
    if star is None:
        return None
    separation, angle = detector_to_sky(x_arcsec, y_arcsec, roll_deg=sequence.roll_deg, parity=_parity_of(sequence))
    ra, dec = offset_by(star[0] * u.deg, star[1] * u.deg, angle * u.deg, separation * u.arcsec)
    return np.asarray(ra.to_value("deg")) % 360.0, np.asarray(dec.to_value("deg"))


def pointing_deg(sequence: FrameSequence) -> tuple[float, float] | None:
    """Return the place on the sky of the centre of the mask; None if the target has no coordinates."""
    offset = [-float(sequence.header.get(key) or 0.0) for key in ("STAROFFX", "STAROFFY")]
    if not any(offset):
        return star_deg(sequence)
    places = sky_places(sequence, *offset)
    return None if places is None else (float(places[0]), float(places[1]))


def _parity_of(sequence: FrameSequence) -> int:
    """Return the orientation of the detector: that of the world coordinates where they are given."""
    names = ("CD1_1", "CD1_2", "CD2_1", "CD2_2")
    if not all(name in sequence.header for name in names):
        return sequence.instrument.detector.parity
    a, b, c, d = (float(sequence.header[name]) for name in names)
    return 1 if a * d > b * c else -1


_ROUNDING_S = 1e-6


class VisitPart(Record):
    """The part of a visit that is taken in one window of the orbit: the frames of one sequence.

    Attributes
    ----------
    role : {"science", "reference"}
    visit : int
        Number of the visit among those of its role, from 0.
    n_visits : int
        Visits of its role.
    step : int
        Which band, exposure and gain of the entry it has.
    window : int
        Number of the window of the visit, from 0.
    start_s : float
        Begin of its first exposure after that of the programme, s.
    first_frame, n_frames : int
        Its frames among those of the visit.
    """

    role: str
    visit: int
    n_visits: int
    step: int
    window: int
    start_s: float
    first_frame: int
    n_frames: int

    @property
    def folder(self) -> str:
        """Folder of the visit."""
        return f"visit_{self.visit + 1:03d}_{self.role}"


def orbit_s(entry: config.SequenceConfig) -> float:
    """Return the period of the orbit: that of the orbital drift, of the modelled orbit where nothing drifts with it."""
    instrument = entry.instrument
    return instrument.drift.orbital_period_s or CircularOrbit(instrument.mission.orbit).period_s


def visit_parts(entry: config.SequenceConfig, paces_s: Sequence[float]) -> list[VisitPart]:
    """Place the visits of a programme in the windows of the orbit.

    A window is the part of the orbit in which light is taken, `Timing.window_turns` long; the programme begins with
    one. Every visit begins where a window for its role opens (`Timing`), takes whole frames until it closes, and goes
    on where the next one opens. The overhead of a visit lies before its first window; where a pair shares a window, its
    halves are shorter by it. Reference visits that are not as many as science visits are spread evenly among them.

    Parameters
    ----------
    entry : SequenceConfig
        A programme.
    paces_s : sequence of float
        Time from frame to frame of each of its bands, exposures and gains, s.

    Returns
    -------
    list of VisitPart
        In the order of time.

    Raises
    ------
    InputError
        If a frame does not fit into a window.
    """
    period_s, overhead_s, scheme = orbit_s(entry), entry.instrument.overhead_s, entry.reference_scheme
    shared = scheme in ("half", "swapped") and entry.references > 0
    length_s = config.Timing().window_turns * period_s
    half_s = length_s / 2.0
    taken_s = half_s - overhead_s if shared else length_s
    frames = {"science": entry.frames, "reference": entry.reference_entry().frames}
    counts = {"science": entry.visits, "reference": entry.references}
    after: dict[int, list[int]] = defaultdict(list)
    for number in range(entry.references):
        after[math.ceil((number + 0.5) * entry.visits / entry.references) - 1].append(number)
    parts: list[VisitPart] = []

    def place(role: str, visit: int, opens_s: float, free_s: float) -> float:
        """Place all sequences of a visit in windows that open ``opens_s`` after the begin of an orbit."""
        for step, ((_, exposure_s, _), pace_s) in enumerate(zip(entry.grid(), paces_s, strict=True)):
            a_window = math.floor((taken_s - exposure_s) / pace_s + _ROUNDING_S) + 1
            if a_window < 1:
                allowed = f"at most {max(taken_s, 0.0):.1f} s: a frame fits into the window of its visit"
                raise InputError("exposure_s", exposure_s, unit="s", allowed=allowed)
            orbit = math.ceil((free_s - opens_s - _ROUNDING_S) / period_s)
            for window, first in enumerate(range(0, frames[role], a_window)):
                # To the microsecond, as times are written.
                start_s = round((orbit + window) * period_s + opens_s, 6)
                n_frames = min(a_window, frames[role] - first)
                parts.append(VisitPart(role, visit, counts[role], step, window, start_s, first, n_frames))
                free_s = start_s + n_frames * pace_s
        return free_s

    free_s = 0.0
    for visit in range(entry.visits):
        if shared:
            # Both have windows of the same orbits, from the first of which both halves are free.
            begin_s = math.ceil((free_s - _ROUNDING_S) / period_s) * period_s
            turned = scheme == "swapped" and visit % 2 == 1
            ends = place("science", visit, half_s if turned else 0.0, begin_s)
            free_s = max(ends, place("reference", visit, 0.0 if turned else half_s, begin_s))
        else:
            free_s = place("science", visit, 0.0, free_s)
            opens_s = period_s / 4.0 if scheme == "other_star" else 0.0
            for number in after[visit]:
                free_s = place("reference", number, opens_s, free_s + overhead_s)
        free_s += overhead_s + 3600.0 * entry.visit_gap_h
    return sorted(parts, key=lambda part: part.start_s)


class PartOfVisit(Record):
    """The frames of a visit that one window of the orbit holds; everything else is that of the visit.

    Attributes
    ----------
    visit : FrameSequence
        The whole visit, whose frames can be made one by one: that of `simulator.observe`.
    part : VisitPart
    """

    visit: Any
    part: VisitPart

    def __getattr__(self, name: str) -> Any:
        return getattr(self.visit, name)

    @property
    def n_frames(self) -> int:
        """Number of frames in the window."""
        return self.part.n_frames

    @property
    def header(self) -> Mapping[str, Any]:
        """Keywords of the sequence, with those that say which part of the programme it is."""
        part = self.part
        own = {"VISIT": part.visit + 1, "NVISITS": part.n_visits, "VISWIN": part.window + 1}
        return {**self.visit.header, **own}

    def iter_full_frames(self) -> Iterator[Frame]:
        """Yield the frames of the window."""
        for index in range(self.part.first_frame, self.part.first_frame + self.part.n_frames):
            yield self.visit.frame(index)


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


class ProductName(Record):
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
        return "SCI" if self.kind in config.SKY_KINDS else "CAL"

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
    def parse(cls, name: str, day: int = 0) -> ProductName | None:
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
    return f"{prefix}{int(config.content_hash(identity), 16) % 10**digits:0{digits}d}"
