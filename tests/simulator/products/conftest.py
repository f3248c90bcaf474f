"""A sequence that is quick to make: small frames of both cameras, of every kind."""

import shutil
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from simulator import load_instrument, load_scene
from simulator.camera import Frame, MaskBit
from simulator.config import Instrument, Scene
from simulator.ledger import EffectRow
from simulator.products import write_level0
from simulator.target import Source, scene_sources, wcs_keywords

INSTRUMENT = load_instrument()
SCENE = load_scene("paper_example")
LEDGER = (
    EffectRow("photon noise", "kept", "Poisson"),
    EffectRow("a long one", "skipped", "because " + "it is long, " * 12 + "and ends here"),
)
SIDE = (24, 40)


@dataclass(frozen=True)
class FakeTruth:
    sources: tuple[Source, ...]
    x_pixel: tuple[float, ...]
    y_pixel: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class FakeSequence:
    """What `simulator.observing.FrameSequence` asks for."""

    camera: str = "VIS"
    kind: str = "SCI"
    band: str = "F662"
    n_frames: int = 3
    exposure_s: float = 10.0
    em_gain: float = 20.0
    readout_s: float = 1.1
    seed: int = 7
    start_utc: str = "2028-03-04T05:06:07.25"
    roll_deg: float = 30.0
    parity: int = -1
    instrument: Instrument = INSTRUMENT
    scene: Scene | None = SCENE
    shape: tuple[int, int] = SIDE
    star: tuple[float, float] = (20.0, 12.0)
    extra: dict[str, Any] = field(default_factory=dict)
    calibration_files: tuple[str, ...] = ()
    ledger: tuple[EffectRow, ...] = LEDGER
    made: list[int] = field(default_factory=list)

    @property
    def header(self):
        found = {"GAIN": 59.0, "ROLE": "science", "HOLEMODE": "4q", "MYKEY": 3.5}
        if self.scene is not None:
            star = self.scene.cstar
            found |= wcs_keywords(
                self.instrument.pixel_scale_arcsec(self.band),
                self.star,
                (star.ra_deg, star.dec_deg),
                roll_deg=self.roll_deg,
                parity=self.parity,
            )
        return found | self.extra

    @property
    def sections(self):
        if self.shape == (1050, 1080):
            return self.instrument.detector.sections
        rows, columns = self.shape
        return {
            "active": (slice(2, rows - 2), slice(4, columns - 4)),
            "image": (slice(0, rows - 2), slice(4, columns - 4)),
            "prescan": (slice(0, rows), slice(0, 4)),
            "overscan_columns": (slice(0, rows), slice(columns - 4, columns)),
            "overscan_rows": (slice(rows - 2, rows), slice(4, columns - 4)),
            "dark_bottom": (slice(0, 2), slice(4, columns - 4)),
            "dark_top": (slice(rows - 2, rows - 2), slice(4, columns - 4)),
        }

    @property
    def truth(self):
        if self.scene is None:
            return None
        sources = scene_sources(self.scene, self.instrument, self.band, roll_deg=self.roll_deg)
        pixel = self.instrument.pixel_scale_arcsec(self.band)
        return FakeTruth(
            sources,
            tuple(self.star[0] + source.x_arcsec / pixel for source in sources),
            tuple(self.star[1] + source.y_arcsec / pixel for source in sources),
        )

    @property
    def expected(self):
        return 200.0 + self.expected_e * self.em_gain / 59.0

    @property
    def expected_e(self):
        rows, columns = self.shape
        return np.add.outer(np.arange(rows) / 3.0, np.arange(columns) / 7.0)

    def adu(self, index):
        noise = np.random.default_rng((self.seed, index)).normal(0.0, 3.0, self.shape)
        return np.clip(np.rint(self.expected + noise), 0, 16383).astype(np.uint16)

    def mask(self, index):
        mask = np.zeros(self.shape, np.uint8)
        mask[3, 4 + index % 30] = MaskBit.COSMIC_RAY | MaskBit.SATURATED
        mask[-1, -1] = MaskBit.HOT
        return mask

    def frame(self, index):
        self.made.append(index)
        return Frame(
            adu=self.adu(index),
            mask=self.mask(index),
            charge={"photons": 1000.0 + index, "read_out": 990.0 + index},
            n_saturated_pixels=1,
            n_cosmic_rays=index,
        )

    def iter_full_frames(self):
        for index in range(self.n_frames):
            yield self.frame(index)


def of_kind(kind: str, camera: str = "VIS", **values) -> FakeSequence:
    """A sequence of any kind; calibrations see no sky."""
    band = {"VIS": "F662", "NIR": "F1265"}[camera]
    if kind in ("SCI", "DSF", "CALS"):
        return FakeSequence(camera=camera, kind=kind, band=band, **values)
    dark = kind in ("BIAS", "DARK")
    exposure = 0.0 if kind == "BIAS" else 10.0
    return FakeSequence(
        **{"camera": camera, "kind": kind, "band": "" if dark and camera == "VIS" else band, "scene": None}
        | {"exposure_s": exposure}
        | values
    )


@pytest.fixture
def sequence():
    """The default sequence, or one with other values."""
    return lambda **values: replace(FakeSequence(), made=[], **values)


@pytest.fixture
def kind_of():
    """Sequences by kind and camera."""
    return of_kind


@pytest.fixture(scope="session")
def written(tmp_path_factory):
    """A tree with one good observation of small frames, to be copied."""
    root = tmp_path_factory.mktemp("products") / "tree"
    write_level0(replace(FakeSequence(), made=[]), root, obsid=40000000012)
    return root


@pytest.fixture
def tree(written, tmp_path):
    """Root of a tree with one good observation of small frames."""
    return Path(shutil.copytree(written, tmp_path / "tree"))


@pytest.fixture
def good(tree):
    """Its file."""
    return tree / "SCI" / "61834" / "CSST_CPIC_VIS_SCI_20280304050607_20280304050639_40000000012_X_L0_V01.fits"
