"""Where `PsfMetrics` come from: shipped files for every instrument preset, a cache for any other instrument.

A file is valid for the content key in its name: the apodizer's values, telescope, geometry of mask and hole, static
wavefront, mirror and its control, jitter, pixel scale, band edges and spectral slope of the drift; not detector noise,
optical transmission or the size of the drift. Presets whose optics are the same share a file.

The visible bands of the default instrument are stored exactly. To keep the package small, the maps and profiles of all
others are rounded, each value by less than 4e-6 of itself (1.3e-4 in the map of the wings): far below the difference
between this optical model and any real instrument.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import fields
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simulator.arrays import read_npz
from simulator.cache import compute_once
from simulator.config import Instrument, content_hash
from simulator.imaging.aperture import aperture_sums, overlap_weights
from simulator.imaging.deformable_mirror import load_dm_surface
from simulator.imaging.hole_store import SCHEMA as HOLE_SCHEMA
from simulator.imaging.hole_store import configured_apodizer, rounded
from simulator.imaging.metrics import PsfMetrics
from simulator.knobs import Knobs
from simulator.numeric import numeric_context
from simulator.work import announce

WING_NODES = 12  # wavelengths that far wings need
SCHEMA = 6  # raise when the meaning of a stored number or the optical model changes
DIGITS = {"core_table": 18, "raw_contrast": 18, "column_profile": 18, "wing_profile": 18, "wing_map": 13}
"""Binary digits that a rounded file keeps of each value."""


def metrics_key(instrument: Instrument, band: str) -> str:
    """Content key of a band's metrics, 16 hex digits.

    Parameters
    ----------
    instrument : Instrument
    band : str
        Name of a band of the instrument, such as ``F520``.
    """
    configuration = instrument.band(band)
    mask = configured_apodizer(instrument)
    edges: Any = [configuration.center_nm, configuration.width_nm]
    if configuration.transmission_file is not None:
        from simulator.passbands import Passbands

        nodes = Passbands.from_instrument(instrument).wavelength_nodes(band, Knobs().wavelength_nodes)
        edges = [*edges, *(rounded(part) for part in nodes)]
    surface = instrument.dark_hole.surface_files.get(band)
    return content_hash(
        {
            "schema": [SCHEMA, HOLE_SCHEMA],
            "fields": sorted(field.name for field in fields(PsfMetrics)),
            "band": band,
            "edges": edges,
            "apodizer": hashlib.sha256(mask.astype("<f8").tobytes()).hexdigest(),
            "telescope": instrument.telescope.model_dump(mode="json"),
            "geometry": [
                instrument.hole_inner_arcsec(band),
                instrument.hole_outer_arcsec(band),
                instrument.mask_half_width_arcsec(band),
                instrument.aperture_radius_arcsec(band),
                instrument.pixel_scale_arcsec(band),
            ],
            "wavefront": instrument.wavefront.model_dump(mode="json"),
            "mirror": instrument.mirror.model_dump(mode="json"),
            "dark_hole": instrument.dark_hole.model_dump(mode="json", exclude={"surface_files"}),
            "surface": surface and hashlib.sha256(load_dm_surface(surface).astype("<f8").tobytes()).hexdigest(),
            "psd_slope": instrument.drift.psd_slope,
            "knobs": Knobs().model_dump(mode="json"),
        }
    )


def shipped_metrics(key: str, band: str) -> Path:
    """File of the metrics with a content key; it exists for the bands of the instrument presets.

    Parameters
    ----------
    key : str
        Content key, 16 hex digits.
    band : str
        Name of a band of the instrument, such as ``F520``.
    """
    return Path(str(files("simulator.imaging") / "data" / f"metrics_{band}_{key}.npz"))


@numeric_context()
def psf_metrics(instrument: Instrument, band: str) -> PsfMetrics:
    """Metrics of a band at the standard knobs: from the shipped file, the cache, or a new measurement.

    Parameters
    ----------
    instrument : Instrument
    band : str
        Name of a band of the instrument, such as ``F520``.

    Raises
    ------
    InputError
        For an unknown band or an unusable apodizer.
    """
    key = metrics_key(instrument, band)
    path = shipped_metrics(key, band) if band.isalnum() else None
    if path is not None and path.is_file():
        return PsfMetrics.from_arrays(_unpacked(read_npz(path)))
    return PsfMetrics.from_arrays(compute_once(f"metrics-{key}", lambda: measure(instrument, band)))


def measure(instrument: Instrument, band: str) -> dict[str, NDArray[Any]]:
    """Arrays of the metrics of a band, measured anew, with the state of its dark hole.

    Parameters
    ----------
    instrument : Instrument
    band : str
        Name of a band of the instrument, such as ``F520``.
    """
    from simulator.imaging.build import build_imager, hole_state_of
    from simulator.imaging.measure import measure_metrics

    imager, wide = build_imager(instrument, band), build_imager(instrument, band, Knobs(wavelength_nodes=WING_NODES))
    announce(f"measuring the optics of {instrument.name} in {band}, once: about 5 s on a free processor")
    metrics = measure_metrics(imager, instrument.drift.psd_slope, wide)
    state = hole_state_of(instrument, band, float(metrics.raw_contrast[metrics.hole].mean()))
    return metrics.to_arrays() | {"hole_state": np.asarray(state)}


def _unpacked(stored: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """Arrays of a shipped file, rounded or exact."""
    arrays = dict(stored)
    for name in DIGITS:
        if arrays[name].dtype == np.uint8:
            arrays[name] = np.ascontiguousarray(np.moveaxis(arrays[name], 0, -1)).view("<f4")[..., 0].astype(float)
    if "halo_map" not in arrays:
        weights = overlap_weights(float(arrays["aperture_radius_arcsec"] / arrays["pixel_scale_arcsec"]))
        arrays["halo_map"] = aperture_sums(arrays["raw_contrast"] * arrays["peak_off_axis"], weights)
    return arrays
