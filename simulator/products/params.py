"""The folder ``Params``: resolved configuration, table of keywords, logs of attitude and temperature."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from simulator.config.detector import Detector
from simulator.files import dump_json, write_text
from simulator.products.ephemeris import Ephemeris
from simulator.products.headers import software_version
from simulator.products.keywords import KEYWORD_FILE, Value
from simulator.products.naming import ProductName
from simulator.products.places import pointing_deg
from simulator.products.sequence import FrameSequence, camera_of
from simulator.products.times import SequenceTimes

__all__ = ["CONFIGURATION_FILE", "PARAMS_FILES", "log_times", "write_params"]

CONFIGURATION_FILE = "configuration.json"
PARAMS_FILES = (CONFIGURATION_FILE, "keywords.yaml", "attitude.csv", "temperature.csv")
SCHEMA_VERSION = 1


def log_times(times: SequenceTimes) -> tuple[str, ...]:
    """Times of the logs: begin of every exposure and end of the last."""
    return (*times.begin_utc, times.stop_utc)


def write_params(
    folder: Path,
    sequence: FrameSequence,
    name: ProductName,
    times: SequenceTimes,
    sky: Ephemeris,
    primary: Mapping[str, Value],
) -> None:
    """Write the four files of one observation; each is whole or not there.

    ``configuration.json`` holds instrument and scene as `simulator.load_instrument` and `simulator.load_scene` read
    them, the settings of the sequence, and the effect ledger. The logs have one row for the begin of every exposure and
    one for the end of the last; all that they say is modelled.

    Parameters
    ----------
    folder : Path
    sequence : FrameSequence
    name : ProductName
    times : SequenceTimes
    sky : Ephemeris
    primary : mapping of str to Value
        Keywords and values of the primary header.
    """
    folder.mkdir(parents=True, exist_ok=True)
    write_text(folder / CONFIGURATION_FILE, dump_json(_configuration(sequence, name, times, primary)))
    write_text(folder / "keywords.yaml", KEYWORD_FILE.read_text(encoding="utf-8"))
    utc = log_times(times)
    write_text(folder / "attitude.csv", _attitude(sequence, utc, sky))
    camera = camera_of(sequence)
    warmth = [camera.temperature_k if isinstance(camera, Detector) else ""] * len(utc)
    write_text(folder / "temperature.csv", _table(("utc", "detector_k"), zip(utc, warmth, strict=True)))


def _configuration(
    sequence: FrameSequence, name: ProductName, times: SequenceTimes, primary: Mapping[str, Value]
) -> dict[str, Any]:
    instrument, scene = sequence.instrument, sequence.scene
    return {
        "schema_version": SCHEMA_VERSION,
        "software": {"name": primary["SWNAME"], "version": software_version()},
        "obsid": name.obsid,
        "file": name.file.as_posix(),
        "sequence": {
            "camera": sequence.camera,
            "kind": sequence.kind,
            "band": sequence.band,
            "n_frames": int(sequence.n_frames),
            "exposure_s": float(sequence.exposure_s),
            "readout_s": float(sequence.readout_s),
            "em_gain": float(sequence.em_gain),
            "seed": int(sequence.seed),
            "start_utc": times.start_utc,
            "roll_deg": float(sequence.roll_deg),
            "shape": [int(side) for side in sequence.shape],
        },
        "header": dict(primary),
        "sections": {key: [[part.start, part.stop] for part in section] for key, section in sequence.sections.items()},
        "calibration_files": list(sequence.calibration_files),
        "effects": [
            {"key": row.key, "effect": row.effect, "decision": row.decision, "size": row.size, "reason": row.reason}
            for row in sequence.ledger
        ],
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
    rows = (
        [
            time,
            *where,
            turn,
            *(f"{value:.6f}" for value in sky.position_km[row]),
            *(f"{value:.9f}" for value in sky.velocity_km_s[row]),
            *(f"{values[row]:.6f}" for values in given.values()),
        ]
        for row, time in enumerate(utc)
    )
    return _table((*names, *given), rows)


def _table(names: Iterable[str], rows: Iterable[Iterable[Any]]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(names)
    writer.writerows(rows)
    return text.getvalue()
