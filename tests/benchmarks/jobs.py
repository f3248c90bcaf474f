"""What is timed, against which workload, and which figures of README and reports it stands behind.

A time means little without its machine, so every job is divided by a workload of its own kind that runs in turns with
it in the same process. That ratio is what ``baseline.json`` keeps and what a later run is compared with.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

__all__ = ["FACTOR", "JOBS", "Job", "Quote"]

# A ratio above this multiple of its baseline is a regression. Two machines of other makes differ less than that in the
# ratio of equal kinds of work, and what is worth stopping for is more.
FACTOR = 1.6
# What starts processes, reads and writes files or runs once varies more.
LOOSE = 2.2

Kind = Literal["copy", "draws", "fft", "dgemm", "python"]
CAMERA, IMAGES, ETC, README = (
    "reports/camera_speed/report.md",
    "reports/imaging_speed/report.md",
    "reports/etc_accuracy/report.md",
    "README.md",
)


@dataclass(frozen=True)
class Quote:
    """A figure that a text quotes.

    Attributes
    ----------
    file : str
        Path in the repository.
    pattern : str
        Regular expression that finds it once; its group is the number.
    unit_s : float
        Seconds in its unit; 0 for a ratio to the peer of the job.
    """

    file: str
    pattern: str
    unit_s: float = 1.0


@dataclass(frozen=True)
class Job:
    """One timed piece of work.

    Attributes
    ----------
    like : str
        Workload that it is divided by.
    quotes : tuple of Quote
    factor : float
        How many times its baseline is a regression.
    ours : str
        For the work of another package: our job of the same result.
    at_least : float
        How many times longer than ours the other's has to be.
    """

    like: Kind
    quotes: tuple[Quote, ...] = ()
    factor: float = FACTOR
    ours: str = ""
    at_least: float = 0.0


def row(file: str, name: str) -> Quote:
    """A table row whose second cell is processor time in seconds."""
    return Quote(file, rf"(?m)^\| {name} \| ([\d.e+]+) \|")


_NUMBER = r"([\d.]+)"
_FRAMES = {
    "frame: dark, 30 s, gain 300": r"dark, 30 s, gain 300",
    "frame: V = 5, 30 s, gain 300": r"star of V = 5, F662, 30 s, gain 300",
    "frame: paper's example, 17 s, gain 20": r"paper's example, F520, 17 s, gain 20",
    "frame: paper's example, 300 s, gain 20": r"paper's example, F520, 300 s, gain 20 \(blooms\)",
}
_FLATS = {
    f"flat: {level} e-, gain {gain}": rf"flat of {level} e-, gain {gain}"
    for level in (50, 1000, 20000)
    for gain in (1, 20, 300)
}
_SEQUENCES = {
    "30 frames to Level 0: paper's example": "30 frames to Level 0 with truth: paper's example, F520, 17 s, gain 20",
    "30 frames to Level 0: V = 5": "30 frames to Level 0 with truth: star of V = 5, F662, 30 s, gain 300",
}
_PARTICLES = {
    f"particles of 3000 s: {name}": rf"particles of 3000 s at 1 /s/cm², `{name}`"
    for name in ("physical", "paper", "template")
}
_ANSWERS = {
    f"etc: {name}, {count}": rf"{name}, one star{'' if count == 'four bands' else ' and band'}"
    rf"{', four bands' if count == 'four bands' else ''}"
    for name in ("SNR for a time", "time for an SNR", "contrast limit")
    for count in ("one band", "four bands")
}
_PROGRAMMES = tuple(
    f"one star, programme {how}, four bands: {question}"
    for how in ("chosen", "given")
    for question in ("signal_to_noise", "exposure_time", "detection_time", "contrast_limit")
)
_TIERS = ("quick", "standard", "reference")
_SOURCES = (1, 10, 100, 1000)
_REGIONS, _MODES = ("quadrant", "annulus", "whole stamp"), (1, 10, 29)
_HOLES = [(preset, band) for preset in ("4q", "2q") for band in ("F520", "F662", "F720", "F850")]

JOBS: dict[str, Job] = {
    **{job: Job("draws", (row(CAMERA, name),)) for job, name in _FRAMES.items()},
    **{job: Job("draws", (row(CAMERA, name),)) for job, name in _FLATS.items()},
    **{job: Job("draws", (row(CAMERA, name),), LOOSE) for job, name in _SEQUENCES.items()},
    **{job: Job("draws", (row(CAMERA, name),)) for job, name in _PARTICLES.items()},
    "30 frames: one draw": Job("draws", (row(CAMERA, "30 frames as one draw"),)),
    "30 frames: one by one": Job("draws", (row(CAMERA, "30 frames added up in electrons, one by one"),)),
    "hole: sums of 30 frames": Job("draws"),
    "write one FITS file of 30 frames": Job("copy", factor=LOOSE),
    "fresh process, cold kernels": Job(
        "python", (Quote(CAMERA, rf"empty cache of compiled code takes {_NUMBER} s"),), LOOSE
    ),
    "fresh process, warm kernels": Job("python", (Quote(CAMERA, rf"with a full one {_NUMBER} s"),), LOOSE),
    "frame: peer emccd-detect": Job("draws", factor=LOOSE, ours="active pixels: flat of 1000 e-, gain 20"),
    "frame: peer getframes": Job("draws", factor=LOOSE, ours="active pixels: flat of 1000 e-, gain 20"),
    "active pixels: flat of 1000 e-, gain 20": Job("draws"),
    **{job: Job("python", (row(ETC, name),)) for job, name in _ANSWERS.items()},
    **{job: Job("python") for job in _PROGRAMMES},
    "etc: catalogue x 8 bands": Job("copy", (row(ETC, r"rates and least times, catalogue \(\d+\) x 8 bands"),)),
    "etc: best frames of the catalogue": Job("copy"),
    "ranking of the catalogue": Job("copy", (row(ETC, "full ranking of the catalogue"),), LOOSE),
    "cold `cpic etc`": Job("python", (Quote(README, rf"A cold `cpic etc` takes {_NUMBER} s"),), LOOSE),
    "cold `cpic rank`": Job("python", (Quote(README, rf"`cpic rank` {_NUMBER} s"),), LOOSE),
    **{
        f"stamps of four bands: {tier}": Job("dgemm", (row(IMAGES, f"four bands, 137 px, `{tier}`"),))
        for tier in _TIERS
    },
    "stamps of four bands: peer HCIPy": Job(
        "dgemm", (row(IMAGES, "four bands, 137 px, `standard`, HCIPy"),), ours="stamps of four bands: standard"
    ),
    "star over a frame": Job("dgemm", (row(IMAGES, "F520, star behind the mask, 1081 px, `standard` nodes"),)),
    "star over a frame: peer HCIPy": Job(
        "dgemm",
        (row(IMAGES, "F520, star behind the mask, 1081 px, `standard` nodes, HCIPy"),),
        LOOSE,
        ours="star over a frame",
    ),
    "star over a frame: closed form": Job(
        "fft", (row(IMAGES, "F520, star behind the mask, 1081 px, closed-form pixels"),)
    ),
    "star over a frame: one node a pixel": Job(
        "dgemm", (row(IMAGES, r"F520, star behind the mask, 1081 px, one node a pixel \(whole frames\)"),)
    ),
    **{
        f"dark hole {mode}, {band}": Job("dgemm", (row(IMAGES, f"dark hole {mode}, {band}"),), LOOSE)
        for mode, band in _HOLES
    },
    "Jacobian": Job("dgemm", (row(IMAGES, r"Jacobian, F662, one wavelength, \d+ actuators"),)),
    "one propagation: peer HCIPy": Job("dgemm", (), LOOSE),
    **{
        f"scene of {count} sources, 1024 px": Job("fft", (row(IMAGES, f"ours, {count} source{'s' * (count > 1)}"),))
        for count in _SOURCES
    },
    **{f"scene of {count} sources, 137 px": Job("fft") for count in _SOURCES},
    "scene of 1000 sources, 1024 px: 4 x 4 cells": Job(
        "fft",
        (row(IMAGES, "4 x 4 cells, 1000 sources, kernels of 513 px made anew"),),
        LOOSE,
        ours="scene of 1000 sources, 1024 px",
    ),
    "scene of 1 source, 1024 px: peer HCIPy": Job(
        "dgemm", (row(IMAGES, "HCIPy, 1 source"),), LOOSE, ours="scene of 1 sources, 1024 px"
    ),
    **{f"subtraction: {region}, {modes} modes": Job("dgemm", factor=LOOSE) for region in _REGIONS for modes in _MODES},
    **{
        f"subtraction: {region}, {modes} modes: peer pyKLIP": Job(
            "dgemm", ours=f"subtraction: {region}, {modes} modes", at_least=10.0
        )
        for region in _REGIONS
        for modes in _MODES
    },
    "subtraction: two rolls, temporal": Job("dgemm"),
    "subtraction: two rolls, none": Job("dgemm"),
    "ledger: forecast": Job("python"),
    "ledger: choose": Job("python"),
    "plan: one target, one band, standard": Job("python", factor=LOOSE),
    "plan: picture of three panels": Job("python"),
    "plan: figures of the catalogue": Job("python"),
}
