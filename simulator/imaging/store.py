"""Where `PsfMetrics` come from: shipped files for the default instrument, a cache for any other.

``python -m simulator.imaging.store --rebuild`` digs the shipped dark holes and measures the shipped metrics anew. A
file is valid for a content key: the apodizer's values, telescope, geometry of mask and hole, static wavefront, mirror
and its control, jitter, pixel scale, band edges and spectral slope of the drift; not detector noise, optical
transmission or the size of the drift.
"""

from __future__ import annotations

import argparse
import hashlib
import time
from collections.abc import Sequence
from dataclasses import fields
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simulator.arrays import read_npz, write_npz
from simulator.cache import compute_once
from simulator.config import Instrument, content_hash, load_instrument
from simulator.imaging.deformable_mirror import load_dm_surface
from simulator.imaging.hole_store import SCHEMA as HOLE_SCHEMA
from simulator.imaging.hole_store import configured_apodizer, rounded, shipped_hole, to_arrays
from simulator.imaging.metrics import PsfMetrics
from simulator.knobs import Knobs
from simulator.numeric import numeric_context

__all__ = ["main", "metrics_key", "psf_metrics", "rebuild"]

WING_NODES = 12  # wavelengths that far wings need
SCHEMA = 6  # raise when the meaning of a stored number or the optical model changes
SHIPPED_HOLES = ("cpic_default", "cpic_2q", "cpic_single_jacobian")


def metrics_key(instrument: Instrument, band: str) -> str:
    """Content key of a band's metrics, 16 hex digits."""
    configuration = instrument.band(band)
    mask = configured_apodizer(instrument)
    edges: Any = [configuration.center_nm, configuration.width_nm]
    if configuration.transmission_file is not None:
        from simulator.passbands import Passbands

        nodes = Passbands.from_instrument(instrument).wavelength_nodes(band, Knobs().wavelength_nodes)
        edges = [*edges, *(rounded(part) for part in nodes)]
    surface = instrument.dark_hole.surface_files.get(band)
    return content_hash({
        "schema": [SCHEMA, HOLE_SCHEMA],
        "fields": [field.name for field in fields(PsfMetrics)],
        "band": band,
        "edges": edges,
        "apodizer": hashlib.sha256(mask.astype("<f8").tobytes()).hexdigest(),
        "telescope": instrument.telescope.model_dump(mode="json"),
        "geometry": [instrument.hole_inner_arcsec(band), instrument.hole_outer_arcsec(band),
                     instrument.mask_half_width_arcsec(band), instrument.aperture_radius_arcsec(band),
                     instrument.pixel_scale_arcsec(band)],
        "wavefront": instrument.wavefront.model_dump(mode="json"),
        "mirror": instrument.mirror.model_dump(mode="json"),
        "dark_hole": instrument.dark_hole.model_dump(mode="json", exclude={"surface_files"}),
        "surface": surface and hashlib.sha256(load_dm_surface(surface).astype("<f8").tobytes()).hexdigest(),
        "psd_slope": instrument.drift.psd_slope,
        "knobs": Knobs().model_dump(mode="json"),
    })  # fmt: skip


def _shipped(band: str) -> Path:
    return Path(str(files("simulator.imaging") / "data" / f"metrics_{band}.npz"))


@numeric_context()
def psf_metrics(instrument: Instrument, band: str) -> PsfMetrics:
    """Metrics of a band at the standard knobs: from the shipped file, the cache, or a new measurement.

    Raises
    ------
    InputError
        For an unknown band or an unusable apodizer.
    """
    key = metrics_key(instrument, band)
    path = _shipped(band) if band.isalnum() else None
    if path is not None and path.is_file():
        arrays = read_npz(path)
        if str(arrays.get("key", "")) == key:
            return PsfMetrics.from_arrays(arrays)
    return PsfMetrics.from_arrays(compute_once(f"metrics-{key}", lambda: _measure(instrument, band)))


def _measure(instrument: Instrument, band: str) -> dict[str, NDArray[Any]]:
    from simulator.imaging.build import build_imager, hole_state_of
    from simulator.imaging.measure import measure_metrics

    imager, wide = build_imager(instrument, band), build_imager(instrument, band, Knobs(wavelength_nodes=WING_NODES))
    metrics = measure_metrics(imager, instrument.drift.psd_slope, wide)
    state = hole_state_of(instrument, band, float(metrics.raw_contrast[metrics.hole].mean()))
    return metrics.to_arrays() | {"hole_state": np.asarray(state)}


def rebuild(folder: str | Path, *, holes: bool = True) -> list[Path]:
    """Dig and write the dark holes of the shipped instruments, then measure the metrics of the default one.

    Parameters
    ----------
    folder : str or Path
        Where to write.
    holes : bool
        Dig the holes anew; False keeps the shipped ones.
    """
    from simulator.imaging.build import dig

    written = []
    for preset in SHIPPED_HOLES if holes else ():
        instrument = load_instrument(preset)
        for band in instrument.visible_bands():
            state, key = dig(instrument, band)
            path = Path(folder) / shipped_hole(instrument, band).name
            write_npz(path, to_arrays(state) | {"key": np.asarray(key)})
            written.append(path)
    instrument = load_instrument()
    for band in instrument.visible_bands():
        path = Path(folder) / f"metrics_{band}.npz"
        write_npz(path, _measure(instrument, band) | {"key": np.asarray(metrics_key(instrument, band))})
        written.append(path)
    return written


def main(argv: Sequence[str] | None = None) -> int:
    """Rebuild the shipped files."""
    parser = argparse.ArgumentParser(prog="python -m simulator.imaging.store", description=__doc__)
    parser.add_argument("--rebuild", action="store_true", required=True, help="measure and write every band")
    parser.add_argument("--keep-holes", action="store_true", help="measure the metrics only")
    parser.add_argument("--out", type=Path, default=_shipped("x").parent, help="folder (the package's data)")
    options = parser.parse_args(argv)
    began = time.perf_counter()
    for path in rebuild(options.out, holes=not options.keep_holes):
        print(f"{path.name}: {path.stat().st_size / 1e3:.0f} kB, {time.perf_counter() - began:.1f} s")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
