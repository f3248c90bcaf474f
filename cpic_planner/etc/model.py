"""What the ETC knows of the instrument: the same passbands, PSF metrics and detector as the images."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from catalogs.errors import InputError
from simulator.config import Instrument
from simulator.imaging.metrics import PsfMetrics
from simulator.imaging.store import metrics_key, psf_metrics
from simulator.passbands import Passbands

__all__ = ["EtcModel", "Strategy", "build_model"]


@dataclass(frozen=True)
class Strategy:
    """How an observation is made and reduced.

    Attributes
    ----------
    n_modes : int
        Modes of the reference library that RDI projects out.
    reference_ratio : float
        Reference frames per science frame (M/N); their time and noise are counted.
    sigma : float
        Detection level whose false-alarm probability a small-sample threshold keeps.
    annulus_lambda_d : float
        Half width of the annulus around the planet's separation whose apertures measure background and scatter:
        the speckle residual changes too much across the hole for one value.
    library : str
        Name of the reference library.
    """

    n_modes: int = 1
    reference_ratio: float = 1.0
    sigma: float = 5.0
    annulus_lambda_d: float = 1.5
    library: str = "same_star_planet_free"


@dataclass(frozen=True)
class EtcModel:
    """Instrument, its one passband quadrature and one set of PSF metrics per band."""

    instrument: Instrument
    passbands: Passbands
    metrics: dict[str, PsfMetrics]
    strategy: Strategy

    @property
    def bands(self) -> tuple[str, ...]:
        """Bands of this model, by wavelength."""
        return tuple(self.metrics)

    def content(self) -> dict[str, Any]:
        """Everything of the model that decides a number, for content hashes; files by what is in them."""
        files = {
            name: hashlib.sha256(Path(band.transmission_file).read_bytes()).hexdigest()
            for name, band in self.instrument.bands.items()
            if band.transmission_file is not None
        }
        return {
            "instrument": self.instrument.model_dump(mode="json"),
            "strategy": asdict(self.strategy),
            "optics": {band: metrics_key(self.instrument, band) for band in self.bands},
            "files": files,
        }

    def frame_pace_s(self, exposure_s: float) -> float:
        """Wall time per science frame, its share of reference frames and all readouts included."""
        return (1.0 + self.strategy.reference_ratio) * (exposure_s + self.instrument.detector.readout_s)

    def visit_s(self, time_s: ArrayLike) -> NDArray[np.float64]:
        """Length of the science visit in an observation of ``time_s`` of wall time."""
        return np.maximum(np.asarray(time_s, float) - self.instrument.overhead_s, 0.0) / (
            1.0 + self.strategy.reference_ratio
        )


def build_model(
    instrument: Instrument, bands: Sequence[str] | None = None, strategy: Strategy | None = None
) -> EtcModel:
    """Assemble the ETC's model of an instrument.

    Parameters
    ----------
    instrument : Instrument
    bands : sequence of str, optional
        Bands to use; all of the visible camera by default.
    strategy : Strategy, optional

    Raises
    ------
    InputError
        If a band is unknown or belongs to the near-infrared camera, which has no imaging model yet.
    """
    if isinstance(bands, str):
        bands = (bands,)
    names = tuple(dict.fromkeys(bands)) if bands else instrument.visible_bands()
    for name in names:
        if instrument.band(name).camera != "VIS":
            raise InputError("band", name, allowed=", ".join(instrument.visible_bands()),
                             hint="the near-infrared camera has no imaging model yet")  # fmt: skip
    return EtcModel(
        instrument=instrument,
        passbands=Passbands.from_instrument(instrument),
        metrics={name: psf_metrics(instrument, name) for name in names},
        strategy=strategy or Strategy(),
    )
