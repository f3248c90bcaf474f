"""``cpic simulate``."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterator
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from cpic_planner.cli.options import ForceOption, InstrumentOption, JsonOption, Tier
from cpic_planner.cli.output import console, note, print_json, progress
from cpic_planner.jobs.engine import check_address

__all__ = ["HELP", "simulate"]

HELP = """Make Level-0 data with truth: scenes, whole simulations, every star of a table, or calibration frames.

WHAT is a scene (preset or YAML file), a simulation (preset or YAML file: a list of sequences), or a table of stars
(CSV, ECSV, VOTable, FITS; each row a scene); several may be given. Each combination of band, exposure and gain is one
sequence of frames: one file, one number. Options that describe sequences are for scenes, tables and calibration kinds.
A simulation has its own; --frames, --seed, --fidelity, --tolerance, --instrument, --off and --start-utc replace those.

--fidelity sets the optics and leaves every effect in. --tolerance 0.02 leaves out effects, sources and nodes whose
predicted sizes add up to at most 2 % of planet flux, of SNR and of any pixel (of the spread of one frame), and never
takes finer optics than --fidelity; what it leaves out is printed (with --dry-run before anything is made), and stands
in header, truth and simulation.json.

Writes SCI, CAL, Truth and Params, simulation.json and run.json into --out. Stopped half way, it continues when started
again on the same folder; the files are the same for any number of workers.

Examples:

  cpic simulate paper_example --band F520 --exposure-s 17 --em-gain 20

  cpic simulate my_scene.yaml --band F520,F662 --exposure-s 30,300

  cpic simulate paper_alpha_cen_b --frames 2 --workers 2 --out paper

  cpic simulate my_stars.csv --band F662 --frames 5 --dry-run

  cpic simulate --kind BIAS --frames 10

  cpic simulate paper_example --band F520 --off cosmic_rays --off smear

  cpic simulate paper_example --band F520 --frames 20 --tolerance 0.02 --dry-run

  cpic simulate --list-presets"""


class Kind(StrEnum):
    """What is observed."""

    SCI = "SCI"
    DSF = "DSF"
    CALS = "CALS"
    BIAS = "BIAS"
    DARK = "DARK"
    FLAT = "FLAT"
    BKG = "BKG"
    LASER = "LASER"


class Role(StrEnum):
    """Which visit: each has a wavefront of its own."""

    SCIENCE = "science"
    REFERENCE = "reference"
    CALIBRATION = "calibration"


class Camera(StrEnum):
    """Camera of BIAS and DARK."""

    VIS = "VIS"
    NIR = "NIR"


_OPTIONS = {"what": "WHAT", "switches": "--off"} | {
    key: f"--{key.replace('_', '-')}"
    for key in (
        "kind",
        "band",
        "exposure_s",
        "em_gain",
        "frames",
        "roll_deg",
        "star_offset_arcsec",
        "role",
        "camera",
        "level_e",
        "seed",
        "start_utc",
        "fidelity",
        "tolerance",
    )
}


def simulate(
    what: Annotated[
        list[str] | None, typer.Argument(metavar="WHAT...", help="Scenes, simulations, or tables of stars.")
    ] = None,
    kind: Annotated[
        Kind | None, typer.Option("--kind", help="Type of the sequence [default: SCI]; BIAS to LASER need no WHAT.")
    ] = None,
    bands: Annotated[
        list[str] | None,
        typer.Option(
            "--band",
            metavar="BAND",
            help="Band, e.g. F662; repeat, or F520,F662, for several [default: all visible bands].",
        ),
    ] = None,
    exposures: Annotated[
        list[str] | None,
        typer.Option(
            "--exposure-s", metavar="S", help="Exposure of a frame; repeat, or 30,300, for several [default: 10]."
        ),
    ] = None,
    frames: Annotated[int | None, typer.Option("--frames", min=1, help="Frames of a sequence [default: 1].")] = None,
    gains: Annotated[
        list[str] | None,
        typer.Option("--em-gain", metavar="GAIN", help="Actual EM gain; repeat, or 1,20, for several [default: 1]."),
    ] = None,
    roll_deg: Annotated[float | None, typer.Option("--roll-deg", help="Roll of the telescope [default: 0].")] = None,
    star_offset: Annotated[
        str | None,
        typer.Option(
            "--star-offset-arcsec",
            metavar="X,Y",
            help="Place of the star relative to the centre of the mask [default: 0,0].",
        ),
    ] = None,
    role: Annotated[
        Role | None, typer.Option("--role", help="Which visit: each has a wavefront of its own [default: science].")
    ] = None,
    camera: Annotated[Camera | None, typer.Option("--camera", help="Of BIAS and DARK [default: VIS].")] = None,
    level_e: Annotated[
        float | None, typer.Option("--level-e", help="Electrons of a pixel of FLAT, of the whole spot of LASER.")
    ] = None,
    seed: Annotated[int | None, typer.Option("--seed", min=0, help="Seed of every random number [default: 1].")] = None,
    start_utc: Annotated[
        str | None, typer.Option("--start-utc", help="Begin of the first frame [default: that of the mission].")
    ] = None,
    instrument: InstrumentOption = None,
    fidelity: Annotated[
        Tier | None, typer.Option("--fidelity", help="Speed against accuracy of the optics [default: standard].")
    ] = None,
    tolerance: Annotated[
        float | None,
        typer.Option(
            "--tolerance",
            help="Leave out what is predicted to change planet flux, SNR and pixels by less than this, 0 to 0.5 "
            "[default: 0, nothing].",
        ),
    ] = None,
    off: Annotated[
        list[str] | None,
        typer.Option("--off", metavar="EFFECT", help="Leave an effect of the camera out, or all; repeat for several."),
    ] = None,
    workers: Annotated[int, typer.Option("--workers", min=1, max=256, help="Local worker processes.")] = 1,
    scheduler: Annotated[
        str | None,
        typer.Option(
            "--scheduler", callback=check_address, help="Dask scheduler, tcp://host:port; it sees --out as we do."
        ),
    ] = None,
    out: Annotated[Path, typer.Option("--out", help="Output folder.")] = Path("out/simulate"),
    force: ForceOption = False,
    truth: Annotated[bool, typer.Option("--truth/--no-truth", help="Write the truth beside the products.")] = True,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Show sequences, time, memory and disk, then stop.")
    ] = False,
    list_presets: Annotated[bool, typer.Option("--list-presets", help="Show the presets, then stop.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Simulate and print."""
    if list_presets:
        _print_presets(as_json)
        return
    from cpic_planner.simulation.inputs import simulation_from

    settings: dict[str, Any] = {
        "kind": kind and kind.value,
        "band": _split(bands),
        "exposure_s": _numbers("--exposure-s", exposures),
        "em_gain": _numbers("--em-gain", gains),
        "roll_deg": roll_deg,
        "star_offset_arcsec": _pair("--star-offset-arcsec", star_offset),
        "role": role and role.value,
        "camera": camera and camera.value,
        "level_e": level_e,
    }
    changes: dict[str, Any] = {
        "frames": frames,
        "seed": seed,
        "fidelity": fidelity and fidelity.value,
        "tolerance": tolerance,
        "switches": dict.fromkeys(_split(off) or (), False) or None,
        "start_utc": start_utc,
    }
    with _options_named():
        simulation, remarks = simulation_from(
            what or (),
            settings={key: value for key, value in settings.items() if value is not None},
            changes={key: value for key, value in changes.items() if value is not None},
            instrument=instrument,
        )
    for remark in remarks:
        note(remark)
    if dry_run:
        from cpic_planner.simulation.cost import estimate

        plan = estimate(simulation, truth=truth, workers=workers)
        if as_json:
            print_json(plan)
        else:
            from cpic_planner.report.products import print_planned

            print_planned(plan, console())
        return
    from cpic_planner.simulation.run import simulate as run

    total = sum(len(list(entry.grid())) * entry.frames for entry in simulation.sequences)
    with progress("frames", total=total) as advance:
        done = run(
            simulation,
            out,
            workers=workers,
            scheduler=scheduler,
            force=force,
            truth=truth,
            advance=advance,
            command=sys.argv[1:],
        )
    if done.resumed_parts:
        note(f"kept {done.resumed_parts} finished sequences of an earlier run")
    if as_json:
        print_json(done.result)
        return
    from cpic_planner.report.products import print_simulation

    print_simulation(done.result, out, console())


@contextlib.contextmanager
def _options_named() -> Iterator[None]:
    """Refusals that name the option where one gave the value."""
    from catalogs.errors import InputError

    try:
        yield
    except InputError as error:
        key = error.key.split(".")[0]
        if key not in _OPTIONS:
            raise
        value = ",".join(map(str, error.value)) if isinstance(error.value, tuple) else error.value
        raise InputError(_OPTIONS[key], value, unit=error.unit, allowed=error.allowed, hint=error.hint) from None


def _split(texts: list[str] | None) -> tuple[str, ...] | None:
    """Items of an option that is repeated, or holds several with commas between."""
    if not texts:
        return None
    return tuple(part.strip() for text in texts for part in text.split(","))


def _numbers(option: str, texts: list[str] | None) -> tuple[float, ...] | None:
    parts = _split(texts)
    return None if parts is None else tuple(_number(option, part) for part in parts)


def _number(option: str, text: str) -> float:
    from catalogs.errors import InputError

    try:
        return float(text)
    except ValueError:
        raise InputError(option, text, allowed="a number, or several with commas between") from None


def _pair(option: str, text: str | None) -> tuple[float, ...] | None:
    from catalogs.errors import InputError

    if text is None:
        return None
    pair = _numbers(option, [text])
    if pair is None or len(pair) != 2:
        raise InputError(option, text, unit="arcsec", allowed="two numbers with a comma between, as 0.35,-0.35")
    return pair


def _print_presets(as_json: bool) -> None:
    from simulator.config.presets import preset_names
    from simulator.config.scene import load_scene
    from simulator.config.simulation_file import load_simulation

    simulations = {name: load_simulation(name).description for name in preset_names("simulation")}
    scenes = {name: load_scene(name).name for name in preset_names("scene")}
    if as_json:
        from simulator.files import dump_json

        sys.stdout.write(dump_json({"simulations": simulations, "scenes": scenes}))
        return
    width = max(map(len, (*simulations, *scenes)))
    for title, presets in (("Simulations", simulations), ("Scenes", scenes)):
        typer.echo(f"{title}:")
        for name, text in presets.items():
            typer.echo(f"  {name:{width}}  {text}")
