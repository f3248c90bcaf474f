"""What the ETC knows of the instrument: the same passbands, PSF metrics and detector as the images."""

from __future__ import annotations

import functools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from catalogs.errors import InputError
from catalogs.user_files import digest_of
from cpic_planner.etc.camera import FrameCamera
from cpic_planner.queries.strategy import ReferenceStar, Strategy
from cpic_planner.registry.libraries import LibraryNoise, StarSettings
from simulator.camera.track_loss import aperture_loss_per_s
from simulator.config import Instrument, content_hash
from simulator.imaging.metrics import PsfMetrics
from simulator.imaging.store import metrics_key, psf_metrics
from simulator.passbands import Passbands

__all__ = ["EtcModel", "ReferenceStar", "Strategy", "build_model"]


@dataclass(frozen=True)
class EtcModel:
    """Instrument, its one passband quadrature and one set of PSF metrics per band."""

    instrument: Instrument
    passbands: Passbands
    metrics: dict[str, PsfMetrics]
    strategy: Strategy

    @functools.cached_property
    def _cameras(self) -> dict[str, FrameCamera]:
        return {band: FrameCamera.of(self.instrument, band) for band in self.metrics}

    @functools.cached_property
    def _losses(self) -> dict[str, float]:
        return {band: aperture_loss_per_s(self.instrument, band) for band in self.metrics}

    def camera(self, band: str) -> FrameCamera:
        """One frame of the band's camera."""
        return self._cameras[band]

    def loss_per_s(self, band: str) -> float:
        """Rate of particles that void an aperture of the band."""
        return self._losses[band]

    @property
    def bands(self) -> tuple[str, ...]:
        """Bands of this model, by wavelength."""
        return tuple(self.metrics)

    def named(self, bands: Sequence[str] | None) -> tuple[str, ...]:
        """Bands that are asked for, each once; all of the model without any.

        Raises
        ------
        InputError
            If the model does not have one.
        """
        names = tuple(dict.fromkeys((bands,) if isinstance(bands, str) else bands or self.bands))
        for name in names:
            if name not in self.metrics:
                raise InputError("band", name, allowed=", ".join(self.bands))
        return names

    def content(self) -> dict[str, Any]:
        """Everything of the model that decides a number, for content hashes; files by what is in them."""
        files = {
            name: digest_of(band.transmission_file)
            for name, band in self.instrument.bands.items()
            if band.transmission_file is not None
        }
        return {
            "instrument": self.instrument.model_dump(mode="json"),
            "strategy": self.strategy.model_dump(mode="json"),
            "optics": {band: metrics_key(self.instrument, band) for band in self.bands},
            "files": files,
        }

    def time_s(self, visit_s: ArrayLike) -> NDArray[np.float64]:
        """Wall time of an observation whose science visit takes ``visit_s``; 0 for none."""
        visit = np.asarray(visit_s, float)
        return np.where(visit > 0, self.instrument.overhead_s + self._time_factor * visit, 0.0)

    def visit_s(self, time_s: ArrayLike) -> NDArray[np.float64]:
        """Length of the science visit in an observation of ``time_s`` of wall time."""
        return np.maximum(np.asarray(time_s, float) - self.instrument.overhead_s, 0.0) / self._time_factor

    @property
    def _time_factor(self) -> float:
        return self.strategy.reference_library.time_factor(self.strategy)

    def library_noise(self, band: str, star_e_s: NDArray[np.float64]) -> LibraryNoise:
        """Return the noise of the library that the strategy names, for science stars of these rates."""
        column = self.passbands.names.index(band)

        def rate_e_s(star: StarSettings) -> NDArray[np.float64]:
            temperature = star.teff_k, star.log_g, star.metallicity
            rates = self.passbands.star_rate_e_s(star.v_mag, *temperature, self.instrument.telescope.area_cm2)
            return np.asarray(rates[..., column], float)

        return self.strategy.reference_library.noise(self.strategy, star_e_s, rate_e_s)


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
        If a band is unknown.

    Notes
    -----
    Models are kept: the same instrument, bands and strategy give the same object. The first use of a near-infrared band
    measures its optics, which takes some seconds.
    """
    if isinstance(bands, str):
        bands = (bands,)
    names = tuple(dict.fromkeys(bands)) if bands else instrument.visible_bands()
    chosen = strategy or Strategy()
    for name in names:
        camera = FrameCamera.of(instrument, name)
        if chosen.mode == "photon_counting" and camera.register_stages == 0:
            raise InputError(
                "mode",
                chosen.mode,
                allowed=f"analogue in {name}",
                hint="only a multiplying register makes single electrons countable",
            )
    tree = instrument.model_dump(mode="json")
    digest = content_hash({"instrument": tree, "files": sorted(set(_files(tree)))})
    return _model(digest, names, chosen, _Held(instrument))


def _files(tree: Any) -> Iterator[tuple[str, int, int]]:
    """Files that a configuration names, with their time and size."""
    if isinstance(tree, dict | list):
        for part in tree.values() if isinstance(tree, dict) else tree:
            yield from _files(part)
    elif isinstance(tree, str) and "." in tree:
        try:
            state = Path(tree).stat()
        except (OSError, ValueError):
            return
        yield tree, state.st_mtime_ns, state.st_size


class _Held:
    """An instrument that counts as equal to any other: the digest beside it tells them apart."""

    def __init__(self, instrument: Instrument) -> None:
        self.instrument = instrument

    def __hash__(self) -> int:
        return 0

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Held)


@functools.lru_cache(maxsize=16)
def _model(digest: str, bands: tuple[str, ...], strategy: Strategy, held: _Held) -> EtcModel:
    instrument = held.instrument
    return EtcModel(
        instrument=instrument,
        passbands=Passbands.from_instrument(instrument),
        metrics={name: psf_metrics(instrument, name) for name in bands},
        strategy=strategy,
    )
