"""Time one question to our calculator beside one to pyEDITH's, and write ``calculators.json`` and ``calculators.md``.

``python reports/benchmarks/calculators.py --install`` (two minutes, one package and what it needs) makes an environment
for pyEDITH; ``--peer PATH/bin/python`` takes one of yours. pyEDITH runs this file too, in a process of its own, so that
nothing of ours is imported at the top.
"""

from __future__ import annotations

import argparse
import datetime
import json
import math
import os
import platform
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from importlib import metadata
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
PACKAGE = "pyEDITH==1.7.2"
THREADS = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
STAR, SNR, CONTRAST, SEPARATION_ARCSEC = "tau Cet", 7.0, 1e-8, 0.5
BANDS = ("F520", "F662", "F720", "F850")
WAVELENGTHS_UM = (0.5, 0.6, 0.7, 0.8)
# The example of pyEDITH that needs no files but itself, inputs/input_toymodel.edith of its repository, without the
# second wavelength and what it repeats of the defaults of the toy model.
TOY = {
    "observatory_preset": "ToyModel",
    "observing_mode": "IMAGER",
    "wavelength": WAVELENGTHS_UM[0],
    "snr": SNR,
    "photometric_aperture_radius": 0.85,
    "CRb_multiplier": 2.0,
    "distance": 14.8,
    "Fstar_10pc": 42.25486348,
    "FstarV_10pc": 42.25486348,
    "stellar_radius": 0.95,
    "nzodis": 3.0,
    "ra": 236.00757736823,
    "dec": 2.51516683165,
    "separation": 0.0628,
    "Fp/Fs": 6.309573444801917e-11,
    "Fp_min/Fs": 1e-10,
    "diameter": 7.87,
    "toverhead_fixed": 8381.3,
    "toverhead_multi": 1.1,
    "temperature": 290.0,
    "T_contamination": 0.95,
    "T_optical": 0.362,
    "contrast": 1.05e-13,
    "noisefloor_factor": 0.03,
    "bandwidth": 0.2,
    "nrolls": 1,
    "nchannels": 2,
    "npix_multiplier": 1,
    "DC": 3e-5,
    "RN": 0.0,
    "tread": 1000.0,
    "CIC": 1.3e-3,
    "QE": 0.897,
    "dQE": 0.75,
}
OURS, THEIRS, CORE = "cpic-planner", "pyEDITH", "pyEDITH, its innermost function alone"
WORDS = {
    "one": "one star, one planet, one band or wavelength",
    "four": "the same in four bands or wavelengths",
    "cold": "one band or wavelength by a command in a fresh process",
    "cold four": "four bands by a command in a fresh process",
}
MODELLED = (
    (
        "asked",
        f"time for SNR {SNR:g} of one planet of {STAR}",
        f"time for SNR {SNR:g} of one planet of its toy example",
    ),
    ("star", "by name: catalogue, spectrum, its companions", "flux at one wavelength, given"),
    ("planet", "contrast and separation, given", "the same"),
    ("light", "photon-weighted over the band", "one wavelength times a bandwidth"),
    ("coronagraph", "measured on simulated images: throughput and speckles by place", "one throughput, one contrast"),
    ("sky", "zodiacal light at the star's place, exozodi", "the same"),
    ("detector", "read noise and charge after an EM register, full wells, converter", "dark, read, clock charge, QE"),
    ("frames and EM gain", "searched for the least time, within the full wells", "one time of reading, given"),
    ("speckle floor", "drift by visit and within one, speckles common to visits", "one factor on the contrast"),
    ("visits and references", "number searched, references counted in the time", "a factor on the background"),
    ("beside the time", "verdict, chance of detection, budget, what would help", "rates of each source"),
)


# ---- in the environment of pyEDITH ----


def their_jobs() -> dict[str, Callable[[int], float]]:
    """Return what is timed of pyEDITH: functions of a number that changes the question a little, of seconds."""
    import pyEDITH as edith  # noqa: N813 (as short as it is called here)
    from pyEDITH import parse_input

    edith.set_verbosity("error")

    def asked(turn: int, wavelength_um: float) -> dict[str, Any]:
        changed = {"Fp/Fs": float(TOY["Fp/Fs"]) * (1.0 + 1e-3 * turn), "wavelength": wavelength_um}
        return parse_input.parse_parameters(TOY | changed)

    def one(turn: int, wavelength_um: float = WAVELENGTHS_UM[0]) -> float:
        return float(edith.calculate_texp(asked(turn, wavelength_um))[0][0].to_value("s"))

    question = asked(0, WAVELENGTHS_UM[0])
    observation, scene, observatory = edith.Observation(), edith.AstrophysicalScene(), edith.Observatory()
    observation.load_configuration(question)
    observation.set_output_arrays()
    scene.load_configuration(question)
    scene.calculate_zodi_exozodi(question)
    observatory.create_observatory(parse_input.get_observatory_config(question))
    observatory.load_configuration(question, observation, scene)

    def core(turn: int) -> float:
        edith.calculate_exposure_time_or_snr(observation, scene, observatory, mode="exposure_time")
        return float(observation.exptime[0].to_value("s"))

    def four(turn: int) -> float:
        return sum(one(turn, item) for item in WAVELENGTHS_UM)

    return {"one": one, "four": four, "core": core}


def serve() -> None:
    """Answer requests, a line of JSON each, until the input ends."""
    out, sys.stdout = sys.stdout, sys.stderr  # packages may print
    jobs = their_jobs()
    about = {name: metadata.version(name) for name in ("pyEDITH", "numpy", "astropy")}
    print(json.dumps(about | {"Python": platform.python_version()}), file=out, flush=True)
    for line in sys.stdin:
        name, first, repeats = json.loads(line)
        print(json.dumps(timed(jobs[name], first, repeats)), file=out, flush=True)


# ---- in ours ----


def timed(job: Callable[[int], float], first: int, repeats: int) -> tuple[float, float]:
    """Return the processor time of one of several runs of a job, and its last answer, both seconds."""
    began = time.process_time()
    for turn in range(first, first + repeats):
        answer = job(turn)
    return (time.process_time() - began) / repeats, answer


def our_jobs() -> dict[str, Callable[[int], float]]:
    """Return what is timed of ours, as `their_jobs`."""
    import cpic_planner as api

    def ask(turn: int, bands: tuple[str, ...]) -> float:
        planet = {"contrast": CONTRAST * (1.0 + 1e-3 * turn), "separation_arcsec": SEPARATION_ARCSEC}
        return sum(answer.value or math.nan for answer in api.exposure_time(STAR, snr=SNR, bands=bands, **planet))

    return {"one": lambda turn: ask(turn, BANDS[:1]), "four": lambda turn: ask(turn, BANDS)}


def command_time(command: list[str], folder: Path) -> float:
    """Return the processor time of a command in a folder with all that it starts, seconds."""
    before = os.times()
    subprocess.run(command, env=clean(), capture_output=True, check=True, cwd=folder)
    after = os.times()
    return after.children_user + after.children_system - before.children_user - before.children_system


def clean() -> dict[str, str]:
    """Return the environment of other processes: one thread, compiled modules kept, nothing of this one's paths."""
    dropped = ("PYTHONPATH", "PYTHONHOME", "PYTHONDONTWRITEBYTECODE")
    return {key: value for key, value in os.environ.items() if key not in dropped} | THREADS


def measured(python: Path, rounds: int, folder: Path) -> dict[str, Any]:
    """Time everything in turns, once before it counts.

    Parameters
    ----------
    python : Path
        Interpreter with pyEDITH.
    rounds : int
    folder : Path
        Where the file of its command is written.
    """
    example = folder / "toy.edith"
    example.write_text("".join(f"{name} = {value}\n" for name, value in TOY.items()), encoding="utf-8")
    etc = [str(Path(sys.executable).with_name("cpic")), "etc", STAR, "--snr", f"{SNR:g}", "--contrast", f"{CONTRAST:g}"]
    etc += ["--separation-arcsec", f"{SEPARATION_ARCSEC:g}"]
    commands = {
        ("cold", OURS): [*etc, "--band", BANDS[0]],
        ("cold", THEIRS): [str(python.with_name("pyedith")), "etc", "--edith", str(example)],
        ("cold four", OURS): [*etc, *(word for band in BANDS for word in ("--band", band))],
    }
    with subprocess.Popen(
        [str(python), str(Path(__file__).resolve()), "--serve"],
        env=clean(),
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        cwd=folder,  # what it imports leaves a log where it is
    ) as peer:
        assert peer.stdin is not None
        assert peer.stdout is not None
        about, ours = json.loads(peer.stdout.readline()), our_jobs()
        taken: dict[tuple[str, str], list[float]] = {}
        answers: dict[tuple[str, str], float] = {}

        def keep(key: tuple[str, str], seconds: float, answer: float, turn: int) -> None:
            if turn:
                taken.setdefault(key, []).append(seconds)
                answers[key] = answer

        def theirs(name: str, turn: int) -> tuple[float, float]:
            peer.stdin.write(json.dumps([name, 10 * turn, 10]) + "\n")
            peer.stdin.flush()
            seconds, answer = json.loads(peer.stdout.readline())
            return seconds, answer

        for turn in range(rounds + 1):
            for name in ("one", "four"):
                keep((name, OURS), *timed(ours[name], 10 * turn, 10), turn)
                keep((name, THEIRS), *theirs(name, turn), turn)
            keep(("one", CORE), *theirs("core", turn), turn)
            for key, command in commands.items():
                keep(key, command_time(command, folder), math.nan, turn)
        peer.stdin.close()
    rows = [
        {
            "job": job,
            "calculator": name,
            "cpu_s": float(f"{statistics.median(seconds):.3g}"),
            "least_s": float(f"{min(seconds):.3g}"),
            "most_s": float(f"{max(seconds):.3g}"),
        }
        | ({} if math.isnan(answers[job, name]) else {"answer_s": float(f"{answers[job, name]:.4g}")})
        for (job, name), seconds in taken.items()
    ]
    own = {name: metadata.version(name) for name in ("cpic-planner", "numpy")} | {"Python": platform.python_version()}
    return {
        "date": datetime.datetime.now(datetime.UTC).date().isoformat(),
        "processor": processor(),
        "load": f"{os.getloadavg()[1]:.1f}",
        "versions": {OURS: own, THEIRS: about},
        "rounds": rounds,
        "rows": rows,
    }


def processor() -> str:
    """Return the name of the processor and its cores."""
    information = Path("/proc/cpuinfo")
    lines = information.read_text(encoding="utf-8").splitlines() if information.exists() else []
    named = next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), "processor")
    return f"{named} ({platform.machine()}, {os.cpu_count()} cores)"


def milliseconds(value_s: float) -> str:
    """Return a time in milliseconds with three digits."""
    return f"{1e3 * value_s:.3g}" if value_s < 1.0 else f"{1e3 * value_s:.0f}"


def report(found: dict[str, Any]) -> str:
    """Return the text of the report."""
    ours = {row["job"]: row["cpu_s"] for row in found["rows"] if row["calculator"] == OURS}
    lines = []
    for row in sorted(found["rows"], key=lambda row: list(WORDS).index(row["job"])):
        times = "" if row["calculator"] == OURS else f"{row['cpu_s'] / ours[row['job']]:.1f}"
        cells = [WORDS[row["job"]], row["calculator"], milliseconds(row["cpu_s"])]
        cells += [f"{milliseconds(row['least_s'])} to {milliseconds(row['most_s'])}", times]
        lines.append(f"| {' | '.join(cells)} |")
    versions = "; ".join(
        ", ".join(f"{part} {number}" for part, number in parts.items()) for parts in found["versions"].values()
    )
    modelled = "\n".join(f"| {what} | {ours} | {theirs} |" for what, ours, theirs in MODELLED)
    return f"""# One question to two calculators

Regenerate with `python reports/benchmarks/calculators.py --install`; everything below is written by it, the figures are
in `calculators.json`. Measured on {found["date"]}: {found["processor"]}, load average {found["load"]};
{versions}.

Processor time of one thread. The two take turns {found["rounds"]} times in one run, after one turn that does not count;
a warm question is the mean of ten, each with another contrast, so that no answer can be kept. The table has medians.

| question | calculator | processor time (ms) | least to most (ms) | times ours |
|---|---|---|---|---|
{chr(10).join(lines)}

pyEDITH is asked as its manual says: `parse_parameters` and `calculate_texp` with a dictionary, and `pyedith etc --edith
FILE` on the command line. An imager has one wavelength at a time there, so that four are four calls. Its innermost
function alone is `calculate_exposure_time_or_snr` on objects that are ready; ours has no such part that is public.

The two do not answer the same question about the sky: each is asked for its own telescope. What each models:

| | cpic-planner | pyEDITH, toy model |
|---|---|---|
{modelled}

The toy model is the only observatory of pyEDITH that needs no files from elsewhere. Its others read a coronagraph from
a table of images, which is fetched from a server on first use; their times are not in the table.
"""


def installed(folder: Path) -> Path:
    """Make an environment with pyEDITH, and return its interpreter."""
    subprocess.run([sys.executable, "-m", "venv", str(folder)], check=True)
    python = folder / "bin" / "python"
    subprocess.run([str(python), "-m", "pip", "install", "--quiet", PACKAGE], check=True)
    return python


def main() -> None:
    """Run what was asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    how = parser.add_mutually_exclusive_group(required=True)
    how.add_argument("--install", action="store_true", help=f"make an environment with {PACKAGE}")
    how.add_argument("--peer", type=Path, metavar="PYTHON", help="interpreter of an environment that has pyEDITH")
    how.add_argument("--again", action="store_true", help="write the report from the figures that are there")
    how.add_argument("--serve", action="store_true", help=argparse.SUPPRESS)
    parser.add_argument("--rounds", type=int, default=9, help="turns that count (%(default)s)")
    asked = parser.parse_args()
    if asked.serve:
        serve()
        return
    figures = HERE / "calculators.json"
    if not asked.again:
        os.environ.update(THREADS)
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            python = installed(folder / "environment") if asked.install else asked.peer
            found = measured(python, max(1, asked.rounds), folder)
        figures.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    (HERE / "calculators.md").write_text(report(json.loads(figures.read_text(encoding="utf-8"))), encoding="utf-8")


if __name__ == "__main__":
    main()
