"""Truth beside a Level-0 file: noise-free maps, sources, and for every frame its mask, charges and counts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from catalogs.errors import InputError
from simulator.camera.frame import Frame
from simulator.products.keywords import Value, escaped, load_keywords
from simulator.products.naming import ProductName
from simulator.products.places import sky_places
from simulator.products.sequence import FrameSequence, SourceTruth
from simulator.products.times import SequenceTimes
from simulator.products.units import append_compressed, append_image, append_primary, append_table, header_cards

__all__ = ["COUNTS", "TruthWriter"]

COUNTS = ("n_saturated_pixels", "n_register_saturated", "n_clipped", "n_cosmic_rays", "n_negative_rates")
_SHARED = (
    "TELESCOP",
    "INSTRUME",
    "CAMERA",
    "OBSID",
    "OBSTYPE",
    "OBJECT",
    "FILTER",
    "NFRAME",
    "TIMESYS",
    "DATE-OBS",
    "DATE-END",
    "EXPTIME",
    "SWNAME",
    "SWVER",
    "CONFHASH",
    "SCENHASH",
    "SEED",
)
_WCS = (
    "WCSAXES",
    "CTYPE1",
    "CTYPE2",
    "CUNIT1",
    "CUNIT2",
    "CRPIX1",
    "CRPIX2",
    "CRVAL1",
    "CRVAL2",
    "CD1_1",
    "CD1_2",
    "CD2_1",
    "CD2_2",
    "RADESYS",
    "EQUINOX",
)
# Electrons are no unit of the FITS standard: there the names of the columns say it.
_UNITS = {
    "begin_mjd": "d",
    "end_mjd": "d",
    "x_arcsec": "arcsec",
    "y_arcsec": "arcsec",
    "ra_deg": "deg",
    "dec_deg": "deg",
    "x_pixel": "pix",
    "y_pixel": "pix",
}


@dataclass
class TruthWriter:
    """Writes the truth of one sequence while its frames go by.

    Units: primary; ``EXPECTED_ADU`` and ``EXPECTED_E``, the mean frame after and before the camera (32-bit floats);
    ``SOURCES``; ``EFFECTS``, the effect ledger where it has predicted sizes; ``MASK`` of every frame, numbered by
    EXTVER, losslessly compressed, with the bits of the Level-1 data model (`simulator.camera.frame.MaskBit`);
    ``FRAMES``, one row a frame: times, counts, electrons by step, and the DATASUM of the Level-0 image that the row
    belongs to.
    """

    file: IO[bytes]
    sequence: FrameSequence
    times: SequenceTimes
    _rows: list[dict[str, Any]] = field(default_factory=list)

    def begin(self, name: ProductName, primary: Mapping[str, Value], shared: Mapping[str, Value]) -> None:
        """Write what belongs to the whole sequence.

        Parameters
        ----------
        name : ProductName
        primary : mapping of str to Value
            Keywords and values of the primary header.
        shared : mapping of str to Value
            Header values that all images of the file share.

        Raises
        ------
        InputError
            If an expected map has another shape than the frames, or is not finite.
        """
        table = load_keywords()
        profile = table.profile("csst")
        values = {key: primary[key] for key in _SHARED if key in primary}
        values |= {"FILENAME": name.truth.name, "L0FILE": name.file.name}
        append_primary(self.file, header_cards(values, table, profile))
        wcs = {key: shared[key] for key in _WCS if key in shared}
        for title, unit, attribute in (("EXPECTED_ADU", "adu", "expected"), ("EXPECTED_E", "electron", "expected_e")):
            cards = header_cards({"BUNIT": unit} | wcs, table, profile)
            append_image(self.file, self._map(attribute), cards, title, 1)
        sources = self._sources()
        if sources:
            append_table(self.file, sources, _UNITS, "SOURCES")
        if any(row.size is not None for row in self.sequence.ledger):
            append_table(self.file, self._effects(), _UNITS, "EFFECTS")

    def _effects(self) -> dict[str, Any]:
        """Columns of the effect ledger; nan where no size was predicted."""
        rows = self.sequence.ledger
        return {
            "key": [escaped(row.key) for row in rows],
            "effect": [escaped(row.effect) for row in rows],
            "decision": [row.decision for row in rows],
            "size": np.array([np.nan if row.size is None else row.size for row in rows], dtype=np.float64),
            "reason": [escaped(row.reason) for row in rows],
        }

    def _map(self, attribute: str) -> NDArray[np.float32]:
        values = np.asarray(getattr(self.sequence, attribute))
        if values.shape != tuple(self.sequence.shape) or not np.isfinite(values).all():
            allowed = f"finite numbers of the shape of a frame, {tuple(self.sequence.shape)}"
            raise InputError(attribute, f"array of shape {values.shape}", allowed=allowed)
        return values.astype(np.float32)

    def _sources(self) -> dict[str, Any]:
        """Columns of the table of sources; no columns without sources."""
        truth: SourceTruth | None = getattr(self.sequence, "truth", None)
        if truth is None or not truth.sources:
            return {}
        sources = truth.sources
        x, y = ([getattr(source, key) for source in sources] for key in ("x_arcsec", "y_arcsec"))
        rates = np.array([source.rate_e_s for source in sources])
        places = sky_places(self.sequence, x, y)
        where = {} if places is None else {"ra_deg": places[0], "dec_deg": places[1]}
        return {
            "name": [escaped(source.name) for source in sources],
            "kind": [source.kind for source in sources],
            "x_arcsec": x,
            "y_arcsec": y,
            **where,
            "x_pixel": np.array(truth.x_pixel, dtype=np.float64),
            "y_pixel": np.array(truth.y_pixel, dtype=np.float64),
            "rate_e_s": rates,
            "rate_to_first": rates / rates[0],
            "flags": [escaped("; ".join(source.flags)) for source in sources],
        }

    def add(self, frame: Frame, datasum: str) -> None:
        """Write the mask of the next frame and keep its row.

        Parameters
        ----------
        frame : Frame
        datasum : str
            Checksum of the frame's image, as text.
        """
        number = len(self._rows)
        append_compressed(self.file, frame.mask, "MASK", number + 1)
        self._rows.append(
            {
                "frame": number + 1,
                "begin_mjd": float(self.times.begin_mjd[number]),
                "end_mjd": float(self.times.end_mjd[number]),
                **{key: int(getattr(frame, key)) for key in COUNTS},
                "datasum": int(datasum),
                **{f"charge_{key}_e": float(value) for key, value in frame.charge.items()},
            }
        )

    def end(self) -> None:
        """Write the table of frames. A step of the charge that a frame does not name moved no electrons in it."""
        names = list(dict.fromkeys(key for row in self._rows for key in row))
        columns = {key: [row.get(key, 0.0) for row in self._rows] for key in names}
        append_table(self.file, columns, _UNITS, "FRAMES")
