"""Write a sequence as Level-0 products: the file, its truth, and its folder of parameters."""

import contextlib
import csv
import hashlib
import io
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from importlib import metadata
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
from simulator.camera import Frame, camera_keywords
from simulator.config import SKY_KINDS, Detector, Section
from simulator.observing import FrameSequence
from simulator.products import keywords
from simulator.products.ephemeris import Ephemeris, SequenceTimes, ephemeris, sequence_times
from simulator.products.sequence import (
    ProductName,
    camera_of,
    claim,
    clear_stale_parts,
    pointing_deg,
    product_name,
    settings_of,
    sky_places,
    star_deg,
    temporary_folders,
)

DISTRIBUTION = "cpic-planner"
MAX_ROWS = 999


def software_version() -> str:
    """Return the version of the installed distribution; ``source`` where it runs without having been installed."""
    try:
        return metadata.version(DISTRIBUTION)
    except metadata.PackageNotFoundError:
        return "source"


def sequence_values(
    sequence: FrameSequence, name: ProductName, times: SequenceTimes, sky: Ephemeris
) -> tuple[dict[str, keywords.Value], dict[str, keywords.Value]]:
    """Return the values of the primary header and those that all images share, under the names of the table.

    Keywords that the sequence supplies replace those that follow from its configuration, but not names, times and
    counts, which are the writer's. Supplied keywords that the table does not know go to the images.

    Raises
    ------
    InputError
        For a keyword of the wrong type.
    """
    table = keywords.load_keywords()
    given = {key: value for key, value in sequence.header.items() if value is not None}
    supplied = {table.canonical(key): keywords.checked_value(table, key, value) for key, value in given.items()}
    found = _configured(sequence) | _where(sequence, sky) | supplied | _own(sequence, name, times)
    found["EPERADU"] = float(found["GAIN"]) / float(found.get("EMGAIN", 1.0))
    values = {key: keywords.checked_value(table, key, value) for key, value in found.items() if value is not None}
    homes = {key: table.keywords[key].hdu if key in table.keywords else "image" for key in values}
    primary = {key: value for key, value in values.items() if homes[key] != "image"}
    return primary, {key: value for key, value in values.items() if homes[key] != "primary"}


def _own(sequence: FrameSequence, name: ProductName, times: SequenceTimes) -> dict[str, Any]:
    count = int(sequence.n_frames)
    exposure_s = float(sequence.exposure_s)
    return {
        "CAMERA": sequence.camera,
        "OBSTYPE": sequence.kind,
        "FILENAME": name.file.name,
        "OBSID": name.obsid,
        "IMG_VER": f"V{name.version:02d}",
        "KEYTABLE": keywords.load_keywords().version,
        "NFRAME": count,
        "NEXTEND": count,
        "NEFFECT": len(sequence.ledger),
        **{keyword.name: keyword.values[0] for keyword in keywords.load_keywords() if keyword.values},
        "DATE-OBS": times.start_utc,
        "DATE-END": times.stop_utc,
        "EXPSTART": float(times.begin_mjd[0]),
        "EXPEND": float(times.end_mjd[-1]),
        "EXPTIME": exposure_s,
        "READTIME": float(sequence.readout_s),
        "INTTIME": count * exposure_s,
        "NCALFILE": len(sequence.calibration_files),
    }


def _configured(sequence: FrameSequence) -> dict[str, Any]:
    camera, instrument, scene, band = camera_of(sequence), sequence.instrument, sequence.scene, sequence.band
    values: dict[str, Any] = {
        "OBJECT": sequence.kind if scene is None else scene.name,
        "FILTER": band or None,
        "SWNAME": DISTRIBUTION,
        "SWVER": software_version(),
        "FPRINT": str(fingerprint()),
        "CONFHASH": instrument.content_hash,
        "SCENHASH": None if scene is None else scene.content_hash,
        "SEED": int(sequence.seed),
        "DMFILE": instrument.dark_hole.surface_files.get(band),
        "DETNAM": sequence.camera,
        "ADCBITS": camera.adc_bits,
        "PIXSIZE": camera.pixel_um,
        **camera_keywords(camera, sequence.em_gain),
        "PIXSCALE": instrument.pixel_scale_arcsec(band) if band else None,
        # The mask is part of the camera: the roll of the telescope does not turn it.
        "MASKROT": 0.0 if sequence.kind in SKY_KINDS else None,
    }
    if isinstance(camera, Detector):
        values["EMGAIN"] = float(sequence.em_gain)
    for keyword in keywords.load_keywords():
        if keyword.section in sequence.sections:
            values[keyword.name] = fits_section(sequence.sections[keyword.section]) or None
    return values


def _where(sequence: FrameSequence, sky: Ephemeris) -> dict[str, Any]:
    """Return the pointing, state of the telescope, and angles."""
    values: dict[str, Any] = {}
    for end, row in enumerate((0, -1)):
        for axis, letter in enumerate("XYZ"):
            values[f"POSI{end}_{letter}"] = float(sky.position_km[row, axis])
            values[f"VELO{end}_{letter}"] = float(sky.velocity_km_s[row, axis])
        for key, angles in (("SUNANGL", sky.sun_deg), ("MOONANG", sky.moon_deg), ("TEL_ALT", sky.limb_deg)):
            if angles is not None:
                values[f"{key}{end}"] = float(angles[row])
    if sequence.scene is None:
        return values
    star, pointing = star_deg(sequence), pointing_deg(sequence)
    if star is not None and pointing is not None:
        values |= {"RA_OBJ": star[0], "DEC_OBJ": star[1], "RADESYS": "ICRS", "EQUINOX": 2000.0}
        for end in (0, 1):
            values |= {f"RA_PNT{end}": pointing[0], f"DEC_PNT{end}": pointing[1]}
    if "CTYPE1" in sequence.header:
        values["WCSAXES"] = 2
    return values | {"POS_ANG0": sequence.roll_deg % 360.0, "POS_ANG1": sequence.roll_deg % 360.0}


def frame_values(
    shared: Mapping[str, keywords.Value], index: int, times: SequenceTimes, frame: Frame
) -> dict[str, keywords.Value]:
    """Return the values of one image: those that all share, and its own times and counts.

    Parameters
    ----------
    shared : mapping of str to Value
        Header values that all images of the file share.
    index : int
        Number of the frame, from 0.
    times : SequenceTimes
    frame : Frame
    """
    begin, end = float(times.begin_mjd[index]), float(times.end_mjd[index])
    counts = {keyword.name: int(getattr(frame, keyword.frame)) for keyword in keywords.load_keywords() if keyword.frame}
    return {**shared, "FRAMEID": index + 1, "EXPBEG": begin, "EXPEND": end, **counts}


def explaining_cards(shared: Mapping[str, keywords.Value], profile: keywords.Profile) -> list[keywords.Card]:
    """Return the comments of every header: how counts become electrons, and what places without coordinates are.

    Parameters
    ----------
    shared : mapping of str to Value
        Header values that all images of the file share.
    profile : Profile
        Spellings that the comments name.
    """
    names = [profile[key][0] for key in ("BIASLEV", "GAIN", "EMGAIN") if key in shared]
    texts = [f"electrons in a pixel = (adu - {names[0]}) * {' / '.join(names[1:])}"]
    if shared.get("CTYPE1") == "EAST":
        texts.append("no coordinates of the star are known: places are degrees from it")
    return [("COMMENT", text, "") for text in texts]


def ledger_cards(sequence: FrameSequence) -> Iterator[tuple[str, keywords.Value, str]]:
    """Yield the numbered cards of the effect ledger, ``kept | effect | reason | size``, and of the calibration maps.

    The size is the predicted one, where there is one.

    Raises
    ------
    InputError
        If there are more of either than three digits count.
    """
    table = keywords.load_keywords()
    texts = [f"{row.decision} | {row.effect} | {row.reason}" for row in sequence.ledger]
    texts = [
        text if row.size is None else f"{text} | {row.size:.3g}"
        for row, text in zip(sequence.ledger, texts, strict=True)
    ]
    for what, key, rows in (("ledger", "EFF", texts), ("calibration_files", "CALF", sequence.calibration_files)):
        if len(rows) > MAX_ROWS:
            raise InputError(what, len(rows), allowed=f"at most {MAX_ROWS} rows")
        for number, text in enumerate(rows, start=1):
            yield f"{key}{number:03d}", keywords.checked_value(table, "OBJECT", text), ""


def fits_section(section: Section) -> str:
    """Return ``"[c1:c2,r1:r2]"``, one-based and inclusive as in FITS headers; ``""`` for a section of no pixels."""
    rows, columns = section
    if rows.stop <= rows.start or columns.stop <= columns.start:
        return ""
    return f"[{columns.start + 1}:{columns.stop},{rows.start + 1}:{rows.stop}]"


_SECTION = re.compile(r"\[(\d+):(\d+),(\d+):(\d+)\]", re.ASCII)


def read_section(text: str, shape: Sequence[int]) -> Section | None:
    """Return what `fits_section` wrote as slices; None for what is no part of an image of this shape, (rows, columns).

    Parameters
    ----------
    text : str
    shape : sequence of int
    """
    match = _SECTION.fullmatch(text)
    if match is None:
        return None
    left, right, low, high = map(int, match.groups())
    inside = 1 <= left <= right <= shape[1] and 1 <= low <= high <= shape[0]
    return (slice(low - 1, high), slice(left - 1, right)) if inside else None


# Electrons are no unit of the FITS standard: there the names of the columns say it.
_UNITS = {"begin_mjd": "d", "end_mjd": "d", "ra_deg": "deg", "dec_deg": "deg"}
_UNITS |= {"x_arcsec": "arcsec", "y_arcsec": "arcsec", "x_pixel": "pix", "y_pixel": "pix"}


@dataclass
class TruthWriter:
    """Writes the truth of one sequence while its frames go by.

    Units: primary; ``EXPECTED_ADU`` and ``EXPECTED_E``, the mean frame after and before the camera (32-bit floats);
    ``SOURCES``; ``EFFECTS``, the effect ledger where it has predicted sizes; ``MASK`` of every frame, numbered by
    EXTVER, losslessly compressed, with the bits of the Level-1 data model (`simulator.camera.MaskBit`);
    ``FRAMES``, one row a frame: times, counts, electrons by step, and the DATASUM of the Level-0 image that the row
    belongs to.
    """

    file: IO[bytes]
    sequence: FrameSequence
    times: SequenceTimes
    _rows: list[dict[str, Any]] = field(default_factory=list)

    def begin(
        self, name: ProductName, primary: Mapping[str, keywords.Value], shared: Mapping[str, keywords.Value]
    ) -> None:
        """Write what belongs to the whole sequence.

        Parameters
        ----------
        name : ProductName
        primary : mapping of str to Value
            Keywords and values of the primary header.
        shared : mapping of str to Value
            Header values that all images of the file share.
        """
        table = keywords.load_keywords()
        profile = table.profile("csst")
        copied = {keyword.name for keyword in table if keyword.truth in ("identity", "copied")}
        values = {key: value for key, value in primary.items() if key in copied}
        values |= {"FILENAME": name.truth.name, "L0FILE": name.file.name}
        keywords.append_primary(self.file, keywords.header_cards(values, table, profile))
        wcs = {
            keyword.name: shared[keyword.name] for keyword in table if keyword.truth == "map" and keyword.name in shared
        }
        for title, unit, attribute in (("EXPECTED_ADU", "adu", "expected"), ("EXPECTED_E", "electron", "expected_e")):
            cards = keywords.header_cards({"BUNIT": unit} | wcs, table, profile)
            keywords.append_image(self.file, getattr(self.sequence, attribute).astype(np.float32), cards, title, 1)
        sources = self._sources()
        if sources:
            keywords.append_table(self.file, sources, _UNITS, "SOURCES")
        if any(row.size is not None for row in self.sequence.ledger):
            keywords.append_table(self.file, self._effects(), _UNITS, "EFFECTS")

    def _effects(self) -> dict[str, Any]:
        """Return the columns of the effect ledger; nan where no size was predicted."""
        rows = self.sequence.ledger
        words = {key: [keywords.escaped(getattr(row, key)) for row in rows] for key in ("key", "effect", "decision")}
        size = np.array([np.nan if row.size is None else row.size for row in rows], dtype=np.float64)
        return words | {"size": size, "reason": [keywords.escaped(row.reason) for row in rows]}

    def _sources(self) -> dict[str, Any]:
        """Return the columns of the table of sources; no columns without sources."""
        truth = self.sequence.truth
        if truth is None or not truth.sources:
            return {}
        sources = truth.sources
        columns: dict[str, Any] = {"name": [keywords.escaped(source.name) for source in sources]}
        columns |= {key: [getattr(source, key) for source in sources] for key in ("kind", "x_arcsec", "y_arcsec")}
        places = sky_places(self.sequence, columns["x_arcsec"], columns["y_arcsec"])
        columns |= {} if places is None else {"ra_deg": places[0], "dec_deg": places[1]}
        columns |= {key: np.array(getattr(truth, key), dtype=np.float64) for key in ("x_pixel", "y_pixel")}
        rates = np.array([source.rate_e_s for source in sources])
        flags = [keywords.escaped("; ".join(source.flags)) for source in sources]
        return columns | {"rate_e_s": rates, "rate_to_first": rates / rates[0], "flags": flags}

    def add(self, frame: Frame, datasum: str) -> None:
        """Write the mask of the next frame and keep its row.

        Parameters
        ----------
        frame : Frame
        datasum : str
            Checksum of the frame's image, as text.
        """
        number, times = len(self._rows), self.times
        keywords.append_compressed(self.file, frame.mask, "MASK", number + 1)
        begin, end = float(times.begin_mjd[number]), float(times.end_mjd[number])
        counts = {each.frame: int(getattr(frame, each.frame)) for each in keywords.load_keywords() if each.frame}
        charges = {f"charge_{key}_e": float(value) for key, value in frame.charge.items()}
        row = {"frame": number + 1, "begin_mjd": begin, "end_mjd": end, **counts, "datasum": int(datasum), **charges}
        self._rows.append(row)

    def end(self) -> None:
        """Write the table of frames. A step of the charge that a frame does not name moved no electrons in it."""
        names = list(dict.fromkeys(key for row in self._rows for key in row))
        columns = {key: [row.get(key, 0.0) for row in self._rows] for key in names}
        keywords.append_table(self.file, columns, _UNITS, "FRAMES")


CONFIGURATION_FILE = "configuration.json"
PARAMS_FILES = (CONFIGURATION_FILE, "keywords.yaml", "attitude.csv", "temperature.csv")
ATTITUDE = ("ra_deg", "dec_deg", "pos_ang_deg", "x_km", "y_km", "z_km", "vx_km_s", "vy_km_s", "vz_km_s")
"""Columns that every log of attitude has besides the time."""
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
    primary: Mapping[str, keywords.Value],
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
        "keywords.yaml": keywords.KEYWORD_FILE.read_text(encoding="utf-8"),
        "attitude.csv": _attitude(sequence, utc, sky),
        "temperature.csv": _table(("utc", "detector_k"), zip(utc, warmth, strict=True)),
    }
    sums = {file: sum_of(utf8(text)) for file, text in others.items()}
    return {CONFIGURATION_FILE: dump_json(_configuration(sequence, name, times, primary) | {"files": sums})} | others


def sum_of(content: bytes) -> str:
    """Return the sha256 of a file of parameters; the primary header has its first 16 digits."""
    return hashlib.sha256(content).hexdigest()


def _configuration(
    sequence: FrameSequence, name: ProductName, times: SequenceTimes, primary: Mapping[str, keywords.Value]
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
    angles = {"sun_deg": sky.sun_deg, "moon_deg": sky.moon_deg, "limb_deg": sky.limb_deg}
    given = {key: values for key, values in angles.items() if values is not None}
    where = ("", "") if pointing is None else tuple(f"{value:.9f}" for value in pointing)
    turn = "" if sequence.scene is None else f"{sequence.roll_deg % 360.0:.6f}"
    rows = []
    for row, time in enumerate(utc):
        position = [f"{part:.6f}" for part in sky.position_km[row]]
        velocity = [f"{part:.9f}" for part in sky.velocity_km_s[row]]
        rows.append([time, *where, turn, *position, *velocity, *(f"{values[row]:.6f}" for values in given.values())])
    return _table(("utc", *ATTITUDE, *given), rows)


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
    if not hasattr(observation, "iter_full_frames"):
        raise InputError("observation", observation, allowed="what observe or calibrate returns")
    table = keywords.load_keywords()
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
    comments = explaining_cards(shared, profile)
    header = [*keywords.header_cards(primary, table, profile), *comments, *ledger_cards(observation)]

    folders = [(root / place).parent for place in (name.file, name.truth, name.params)]
    with (
        temporary_folders(folders, whole=root / name.params, done=root / name.file),
        _new_file(root / name.file, overwrite=overwrite) as file,
    ):
        keywords.append_primary(file, header)
        with contextlib.ExitStack() as stack:
            writer = None
            if truth:
                writer = TruthWriter(stack.enter_context(_new_file(root / name.truth)), observation, times)
                writer.begin(name, primary, shared)
            for index, frame in enumerate(observation.iter_full_frames()):
                values = frame_values(shared, index, times, frame)
                cards = [*keywords.header_cards(values, table, profile), *comments]
                datasum = keywords.append_image(file, frame.adu, cards, "IMAGE", index + 1)
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
