"""The question of ``cpic simulate``: Level-0 data of which scenes and sequences."""

from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from pydantic import BeforeValidator

from cpic_core import InputError
from cpic_planner.queries.changes import InstrumentParts
from cpic_planner.queries.question import Asked, Parts, asked
from cpic_planner.queries.shared import RunQuestion, TablesQuestion, asked_out, several
from simulator.config import Offset, SequenceConfig, SequenceSettings

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
_NUMBERS: dict[str, Any] = {"command": str, "accepts": "float or sequence of float", "read": _numbers}
_PAIR: dict[str, Any] = {"metavar": "X,Y", "command": str, "several": False, "accepts": "pair of float", "read": _pair}


_WHOLE = "programme", True


class SwitchParts(Parts):
    """Options of the switches of effects."""

    off: Names | None = asked(None, "Leave an effect of the camera out, or all; repeat for several.", metavar="EFFECT")

    def made(self, base: Any) -> dict[str, bool]:
        """Return the effects that are left out as switches."""
        return dict(base or {}) | dict.fromkeys(self.off or (), False)


class NamedInstrumentParts(InstrumentParts):
    """Options of an instrument that is only named where nothing of it is changed."""

    def made(self, base: Any) -> Any:
        """Return the instrument, or what names it."""
        return super().made(base) if self.changes else base if self.instrument is None else self.instrument


def _obsid(value: Any) -> Any:
    """Return a number that is written as a text of digits."""
    return int(value) if isinstance(value, str) and value.isdecimal() else value


class SimulateQuestion(RunQuestion, TablesQuestion, SequenceSettings):
    """Make Level-0 data with truth.

    A simulation has sequences of its own, of which only some values are replaced.
    """

    KIND: ClassVar[str] = "simulate"
    ALIASES: ClassVar[dict[str, str]] = SequenceConfig.ALIASES
    ASKED: ClassVar[dict[str, Asked]] = {
        "band": Asked(metavar="BAND", unset="all visible bands", read=_split),
        "exposure_s": Asked(metavar="S", **_NUMBERS),
        "em_gain": Asked(metavar="GAIN", **_NUMBERS),
        "star_offset_arcsec": Asked(**_PAIR),
        "offset_arcsec": Asked(**_PAIR),
        "reference_visits": Asked(unset="as many as science visits, none for a single one"),
        "reference_roll_deg": Asked(unset="{roll_deg}"),
        "realisation": Asked(unset="a number of its own for each sequence"),
        "obsid": Asked(command=str, unset="sequences are counted", accepts="int or str", read=_obsid),
        "start_utc": Asked(unset="that of the mission"),
        "switches": Asked(parts=SwitchParts, accepts="mapping of str to bool"),
    }

    what: Annotated[tuple[Any, ...], BeforeValidator(several)] = asked(
        (),
        "Scenes, simulations (presets, YAML files, mappings, objects), or tables of stars, each row of which is a "
        "scene; nothing for a calibration kind.",
        argument=True,
        metavar="WHAT...",
        accepts="simulation, scene, mapping, str, Path, or a list of them",
    )
    reference_scene: Any = asked(
        None,
        "What reference visits look at: a scene.",
        unset="the scene without its planets",
        accepts="scene, mapping, str or Path",
    )
    # Left as it is written: a simulation names instruments of its own.
    instrument: Any = asked(
        None,
        "Preset name or YAML file with what differs.",
        parts=NamedInstrumentParts,
        unset="cpic_default",
        accepts="Instrument, mapping, str or Path",
    )
    date_utc: str | None = asked(
        None,
        "Date of the places of the stars of a table and of their companions, UTC.",
        option="--date",
        unset="{start_utc}",
    )
    programme: bool = asked(
        False,
        "Take all that a reduction needs: science and reference visits, the star off the mask, bias, dark and flat "
        "frames, and a list of what each file is for.",
    )
    calibration_frames: int = asked(
        10, "Frames of each sequence of calibrations and of the star off the mask.", ge=2, le=10_000, only_with=_WHOLE
    )
    off_mask_arcsec: tuple[Offset, Offset] = asked(
        (2.0, 2.0),
        "Place of the star off the mask, from the centre of the mask; its exposure fills half of what its brightest "
        "pixel holds, and is no longer than that of the science frames.",
        only_with=_WHOLE,
        **_PAIR,
    )
    cubes: tuple[Literal["vip", "pyklip"], ...] = asked(
        (),
        "Write the calibrated frames into Cubes as this package takes them: cubes of science and references, angles, "
        "star off the mask; with the same options also from what is there already. Repeat for both.",
        option="--as",
        only_with=_WHOLE,
        physics=False,
    )
    truth: bool = asked(True, "Write the truth beside the products.")
    out: Path = asked_out("out/simulate")

    @property
    def given(self) -> dict[str, Any]:
        """Settings of `cpic_planner.simulation.simulation_from`."""
        names = "settings", "changes", "instrument", "date_utc", "off_mask_arcsec"
        frames = self.calibration_frames if self.programme else 0
        return {name: getattr(self, name) for name in names} | {"calibration_frames": frames}

    @property
    def settings(self) -> dict[str, Any]:
        """Keys of a sequence for scenes, tables and calibration kinds, as far as they are given."""
        names = (*SequenceSettings.model_fields, "reference_scene")
        return {name: getattr(self, name) for name in names if name in self.model_fields_set - {*_CHANGES}}

    @property
    def changes(self) -> dict[str, Any]:
        """Values that replace those of every sequence, as far as they are given."""
        return {name: getattr(self, name) for name in _CHANGES if name in self.model_fields_set}
