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
IMAGES, README = "reports/speed/imaging_speed/report.md", "README.md"


@dataclass(frozen=True)
class Quote:
    """A figure that a text quotes.

    Attributes
    ----------
    file : str
        Path in the repository.
    pattern : str
        Regular expression that finds it once; its group is the number.
    """

    file: str
    pattern: str


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
_FRAMES = ("dark, 30 s, gain 300", "V = 5, 30 s, gain 300", *(f"paper's example, {s} s, gain 20" for s in (17, 300)))
_PROGRAMMES = [
    f"one star, programme {how}, four bands: {question}"
    for how in ("chosen", "given")
    for question in ("signal_to_noise", "exposure_time", "detection_time", "contrast_limit")
]
_TIERS = ("quick", "standard", "reference")
_SOURCES = (1, 10, 100, 1000)
_REGIONS, _MODES = ("quadrant", "annulus", "whole stamp"), (1, 10, 29)
_HOLES = [f"dark hole {preset}, {band}" for preset in ("4q", "2q") for band in ("F520", "F662", "F720", "F850")]

JOBS: dict[str, Job] = {
    **{f"frame: {name}": Job("draws") for name in _FRAMES},
    **{f"flat: {level} e-, gain {gain}": Job("draws") for level in (50, 1000, 20000) for gain in (1, 20, 300)},
    **{f"30 frames to Level 0: {name}": Job("draws", factor=LOOSE) for name in ("paper's example", "V = 5")},
    **{f"particles of 3000 s: {name}": Job("draws") for name in ("physical", "paper", "template")},
    "30 frames: one draw": Job("draws"),
    "30 frames: one by one": Job("draws"),
    "hole: sums of 30 frames": Job("draws"),
    "write one FITS file of 30 frames": Job("copy", factor=LOOSE),
    "fresh process, cold kernels": Job("python", factor=LOOSE),
    "fresh process, warm kernels": Job("python", factor=LOOSE),
    **{
        f"etc: {name}, {count}": Job("python")
        for name in ("SNR for a time", "time for an SNR", "contrast limit")
        for count in ("one band", "four bands")
    },
    **{job: Job("python") for job in _PROGRAMMES},
    "etc: catalogue x 8 bands": Job("copy"),
    "etc: best frames of the catalogue": Job("copy"),
    "ranking of the catalogue": Job("copy", factor=LOOSE),
    "cold `cpic etc`": Job("python", (Quote(README, rf"A cold `cpic etc` takes {_NUMBER} s"),), LOOSE),
    "cold `cpic rank`": Job("python", (Quote(README, rf"`cpic rank` {_NUMBER} s"),), LOOSE),
    **{
        f"stamps of four bands: {tier}": Job("dgemm", (row(IMAGES, f"four bands, 137 px, `{tier}`"),))
        for tier in _TIERS
    },
    "stamps of four bands: peer HCIPy": Job("dgemm", ours="stamps of four bands: standard"),
    "star over a frame": Job("dgemm"),
    "star over a frame: peer HCIPy": Job("dgemm", factor=LOOSE, ours="star over a frame"),
    "star over a frame: closed form": Job("fft"),
    "star over a frame: one node a pixel": Job("dgemm"),
    **{job: Job("dgemm", factor=LOOSE) for job in _HOLES},
    "Jacobian": Job("dgemm"),
    "one propagation: peer HCIPy": Job("dgemm", factor=LOOSE),
    **{f"scene of {count} sources, 1024 px": Job("fft") for count in _SOURCES},
    **{f"scene of {count} sources, 137 px": Job("fft") for count in _SOURCES},
    "scene of 1000 sources, 1024 px: 4 x 4 cells": Job("fft", factor=LOOSE, ours="scene of 1000 sources, 1024 px"),
    "scene of 1 source, 1024 px: peer HCIPy": Job("dgemm", factor=LOOSE, ours="scene of 1 sources, 1024 px"),
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
