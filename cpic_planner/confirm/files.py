"""Questions about Level-1 files: their scene, instrument and frames, as headers and the parameters beside them say."""

import functools
from pathlib import Path
from typing import Any

from cpic_core import InputError, Record, as_path, digest_of, parse_json, read_file
from cpic_planner import validation
from cpic_planner.queries import ConfirmQuestion
from simulator.config import Scene, load_instrument, load_scene

_MOST_BYTES = 100_000_000
_UNKNOWN_STAR = {"v_mag": 5.0, "teff_k": 5772.0}
"""Star of files without a scene: its colour shapes the point-spread function, its light no answer."""


class MeasuredFiles(Record, eq=False):
    """The files of a question, and the question with what they say.

    Attributes
    ----------
    question : ConfirmQuestion
        With scene, instrument and bands.
    programmes : tuple of Level1Programme
        One a band.
    bare : bool
        Whether nothing but the headers tells of the scene.
    """

    question: ConfirmQuestion
    programmes: tuple[validation.Level1Programme, ...]
    bare: bool

    @functools.cached_property
    def sums(self) -> list[str]:
        """Checksums (SHA-256) of all files that are read, by band and visit."""
        return [
            f"{programme.band} {role} {number} {digest_of(one.path)}"
            for programme in self.programmes
            for role, visits in programme.visits.items()
            for number, files in enumerate(visits)
            for one in files
        ]

    def programme_question(self, programme: validation.Level1Programme) -> tuple[ConfirmQuestion, float]:
        """Return the question of one band with the frames and the strategy of its files, and the roll of it.

        Of two rolls the roll is the middle; the science visits are those of the smaller one.
        """
        config, strategy = self.question, self.question.strategy
        science, reference = programme.n_frames("science"), programme.n_frames("reference")
        visits = {role: len(programme.visits[role]) for role in ("science", "reference")}
        told: dict[str, Any] = {"visits": visits["science"], "visit_gap_h": strategy.visit_gap_h}
        roll_deg = programme.rolls_deg[0]
        if len(strategy.rolls_deg) > 1:
            turn = (programme.rolls_deg[1] - roll_deg) % 360.0
            if not 0 < turn <= 180:
                allowed = "a reference visit at a roll up to 180 deg larger than that of the science visit"
                raise InputError(f"{programme.first.path.name}: POS_ANG0", roll_deg, unit="deg", allowed=allowed)
            told["roll_deg"], roll_deg = turn, roll_deg + turn / 2.0
        else:
            told |= {"reference_visits": visits["reference"], "reference_ratio": reference / science}
        frames = {"exposure_s": programme.exposure_s, "em_gain": programme.em_gain}
        frames |= {"n_frames": max(round(science / visits["science"]), 1)}
        changed = strategy.model_copy(update=told)
        return config.model_copy(update=frames | {"bands": (programme.band,), "strategy": changed}), roll_deg


def measured_files(question: ConfirmQuestion, folder: str | Path) -> MeasuredFiles:
    """Return the files below a folder that a question is about.

    Parameters
    ----------
    question : ConfirmQuestion
        Its scene, instrument and bands stand above those of the files.
    folder : str or Path

    Raises
    ------
    InputError
        If the folder has no Level-1 files of science and reference visits, or they do not fit together or to the
        instrument.
    """
    place = as_path("from_products", folder)
    if not place.is_dir():
        raise InputError("from_products", str(folder), allowed="a folder with Level-1 files")
    programmes = tuple(validation.level1_programmes(place, question.bands, question.references))
    first = programmes[0].first
    stated = _parameters(place, first)
    instrument, scene = question.instrument, question.scene
    if stated is not None and not question.is_given("instrument"):
        instrument = load_instrument(stated["instrument"])
    bare = scene is None and (stated is None or stated.get("scene") is None)
    if bare and len(question.strategy.rolls_deg) > 1:
        allowed, hint = (
            "together with a scene",
            "two rolls show every planet twice: planets are measured at known places",
        )
        raise InputError("strategy.library", question.strategy.library, allowed=allowed, hint=hint)
    if scene is None:
        scene = _bare_scene(first) if bare or stated is None else load_scene(stated["scene"])
    for programme in programmes:
        if programme.band not in instrument.bands:
            allowed = ", ".join(instrument.bands)
            raise InputError(f"{programme.first.path.name}: FILTER", programme.band, allowed=allowed)
        programme.check(instrument.pixel_scale_arcsec(programme.band))
    told: dict[str, Any] = {"scene": scene, "instrument": instrument, "realisations": 1}
    bands = tuple(programme.band for programme in programmes)
    return MeasuredFiles(question.model_copy(update=told | {"bands": bands}), programmes, bare)


def _parameters(folder: Path, file: validation.Level1File) -> dict[str, Any] | None:
    """Return the configuration that was written with the Level-0 file that a file is made of; None where it is not."""
    if file.header.get("SCENHASH") is None:
        return None
    for path in sorted(folder.rglob(f"Params/{file.header.get('OBSID')}/V*/configuration.json")):
        content = read_file(path, key="parameters", allowed="a file of parameters", max_bytes=_MOST_BYTES)
        found: dict[str, Any] = dict(parse_json(content))
        # Numbers are those of a run: two runs in one folder may share them.
        if all(
            found.get("header", {}).get(key) == file.header.get(key) for key in ("SCENHASH", "CONFHASH", "DATE-OBS")
        ):
            return found
    return None


def _bare_scene(file: validation.Level1File) -> Scene:
    """Return the scene that a header tells: the star with its name and place, and nothing else."""
    name = str(file.header.get("OBJECT") or "star")
    star: dict[str, Any] = {"name": name, **_UNKNOWN_STAR}
    if (place := file.star_deg) is not None:
        star |= {"ra_deg": place[0], "dec_deg": place[1]}
    return load_scene({"name": name, "cstar": star})
