"""The question of ``cpic simulate``: Level-0 data of which scenes and sequences."""

from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from pydantic import BeforeValidator

from cpic_core import InputError
from cpic_planner.queries.changes import InstrumentParts
from cpic_planner.queries.question import Parts, asked
from cpic_planner.queries.shared import MAX_VISITS, Fidelity, Reduction, RunQuestion, TablesQuestion, several
from simulator.config import ReferenceScheme, SequenceConfig, SequenceKind

_CHANGES = ("frames", "seed", "fidelity", "tolerance", "switches", "start_utc")


def _split(value: Any) -> Any:
    """Return the items of a list whose texts may hold several with commas between."""
    items = several(value)
    if items and all(isinstance(item, str) for item in items):
        return tuple(part.strip() for text in items for part in text.split(","))
    return items


def _numbers(value: Any) -> Any:
    """Return the numbers of a list, or of texts with commas between."""
    try:
        return tuple(float(item) if isinstance(item, str) else item for item in _split(value))
    except ValueError:
        raise InputError("", value, allowed="a number, or several with commas between") from None


def _pair(value: Any) -> Any:
    pair = _numbers(value)
    if len(pair) != 2:
        raise InputError("", value, unit="arcsec", allowed="two numbers with a comma between, as 0.35,-0.35")
    return pair


Names = Annotated[tuple[str, ...], BeforeValidator(_split)]
Numbers = Annotated[tuple[float, ...], BeforeValidator(_numbers)]
Pair = Annotated[tuple[float, float], BeforeValidator(_pair)]


_NUMBERS: dict[str, Any] = {"command": str, "accepts": "float or sequence of float"}
_PAIR: dict[str, Any] = {"metavar": "X,Y", "command": str, "several": False, "accepts": "pair of float"}


class SwitchParts(Parts):
    """Options of the switches of effects."""

    off: Names | None = asked(
        None, "Leave an effect of the camera out, or all; repeat for several.", metavar="EFFECT", command=str
    )

    def made(self, base: Any) -> dict[str, bool]:
        """Return the effects that are left out as switches."""
        return dict(base or {}) | dict.fromkeys(self.off or (), False)


class NamedInstrumentParts(InstrumentParts):
    """Options of an instrument that is only named where nothing of it is changed."""

    def made(self, base: Any) -> Any:
        """Return the instrument, or what names it."""
        return super().made(base) if self.changes else base if self.instrument is None else self.instrument


def _of_programme(name: str, *, unset: str, **settings: Any) -> Any:
    """Declare a field that means what that of this name in a `Reduction` does, without a default of its own."""
    return asked(None, Reduction.model_fields[name].description or "", unset=unset, **settings)


class SimulateQuestion(RunQuestion, TablesQuestion):
    """Make Level-0 data with truth.

    What a sequence is comes from `simulator.config.simulation.SequenceConfig`, which checks it; a simulation has
    sequences of its own, of which only some values are replaced.
    """

    KIND: ClassVar[str] = "simulate"
    ALIASES: ClassVar[dict[str, str]] = SequenceConfig.ALIASES

    what: Annotated[tuple[Any, ...], BeforeValidator(several)] = asked(
        (),
        "Scenes, simulations (presets, YAML files, mappings, objects), or tables of stars, each row of which is a "
        "scene; nothing for a calibration kind.",
        argument=True,
        metavar="WHAT...",
        command=str,
        several=True,
        accepts="simulation, scene, mapping, str, Path, or a list of them",
    )
    kind: SequenceKind | None = asked(None, "Type of the sequence; BIAS to LASER need no scene.", unset="SCI")
    band: Names | None = asked(
        None, "Band, e.g. F662; repeat, or F520,F662, for several.", metavar="BAND", unset="all visible bands"
    )
    exposure_s: Numbers | None = asked(
        None, "Exposure of a frame; repeat, or 30,300, for several.", metavar="S", unset="10", **_NUMBERS
    )
    frames: int | None = asked(None, "Frames of a sequence.", ge=1, unset="1")
    em_gain: Numbers | None = asked(
        None, "Actual EM gain; repeat, or 1,20, for several.", metavar="GAIN", unset="1", **_NUMBERS
    )
    roll_deg: float | None = asked(None, "Roll of the telescope.", unset="0")
    star_offset_arcsec: Pair | None = asked(
        None, "Place of the star relative to the centre of the mask.", unset="0,0", **_PAIR
    )
    role: Literal["science", "reference", "calibration"] | None = asked(
        None, "Which visit: each has a wavefront of its own; {visits} has both.", unset="science"
    )
    visits: int | None = _of_programme("visits", unset="1", ge=1, le=MAX_VISITS)
    reference_visits: int | None = _of_programme(
        "reference_visits", unset="as many as science visits, none for a single one", ge=0, le=100_000
    )
    reference_ratio: float | None = asked(
        None, "Reference frames of a programme per science frame.", unset="1", ge=0.001, le=1000
    )
    reference_scheme: ReferenceScheme | None = _of_programme("reference_scheme", unset="interleaved")
    reference_scene: Any = asked(
        None,
        "What reference visits look at: a scene.",
        command=str,
        unset="the scene without its planets",
        accepts="scene, mapping, str or Path",
    )
    reference_roll_deg: float | None = asked(None, "Roll of reference visits.", unset="{roll_deg}")
    visit_gap_h: float | None = asked(
        None,
        "Least time between the end of a visit with its references and the begin of the next.",
        unset="0",
        ge=0,
        le=1e5,
    )
    camera: Literal["VIS", "NIR"] | None = asked(None, "Camera of BIAS and DARK.", unset="VIS")
    level_e: float | None = asked(None, "Electrons of a pixel of FLAT, of the whole spot of LASER.")
    scene_model: Literal["exact", "paper"] | None = asked(
        None, "Light of the scene: exact, or in the paper's approximation.", unset="exact"
    )
    offset_arcsec: Pair | None = asked(None, "Place of the spot of LASER.", **_PAIR)
    ra_deg: float | None = asked(None, "Right ascension of BKG.")
    dec_deg: float | None = asked(None, "Declination of BKG.")
    realisation: int | None = asked(
        None, "Number of the noise realisation.", unset="a number of its own for each sequence"
    )
    obsid: int | str | None = asked(
        None,
        "Number of the first sequence, eleven digits.",
        command=str,
        unset="sequences are counted",
        accepts="int or str",
    )
    seed: int | None = asked(None, "Seed of every random number.", ge=0, lt=2**63, unset="1")
    start_utc: str | None = asked(None, "Begin of the first frame.", unset="that of the mission")
    # Left as it is written: a simulation names instruments of its own.
    instrument: Any = asked(
        None,
        "Preset name or YAML file with what differs.",
        parts=NamedInstrumentParts,
        unset="cpic_default",
        accepts="Instrument, mapping, str or Path",
    )
    fidelity: Fidelity | None = asked(None, "Speed against accuracy of the optics.", unset="standard")
    tolerance: float | None = asked(
        None,
        "Leave out what is predicted to change planet flux, SNR and pixels by less than this, 0 to 0.5.",
        unset="0, nothing",
    )
    switches: dict[str, bool] | None = asked(
        None,
        "Effects of the camera to switch on or off; all stands for every one.",
        parts=SwitchParts,
        accepts="mapping of str to bool",
    )
    date_utc: str | None = asked(
        None,
        "Date of the places of the stars of a table and of their companions, UTC.",
        option="--date",
        unset="{start_utc}",
    )
    truth: bool = asked(True, "Write the truth beside the products.")
    out: Path = asked(
        Path("out/simulate"), "Output folder; an interrupted run continues there.", physics=False, metavar="DIR"
    )

    @property
    def given(self) -> dict[str, Any]:
        """Settings of `cpic_planner.simulation.simulation_from`."""
        return {name: getattr(self, name) for name in ("settings", "changes", "instrument", "date_utc")}

    @property
    def settings(self) -> dict[str, Any]:
        """Keys of a sequence for scenes, tables and calibration kinds, as far as they are given."""
        own = (*_CHANGES, "instrument")
        names = [name for name in SequenceConfig.model_fields if name in type(self).model_fields and name not in own]
        return {name: getattr(self, name) for name in names if getattr(self, name) is not None}

    @property
    def changes(self) -> dict[str, Any]:
        """Values that replace those of every sequence, as far as they are given."""
        return {name: getattr(self, name) for name in _CHANGES if getattr(self, name) is not None}
