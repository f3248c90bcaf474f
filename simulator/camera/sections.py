"""Named parts of the frame: active pixels, shielded pixels, prescan and overscan."""

from __future__ import annotations

from simulator.config.detector import Detector
from simulator.config.infrared import InfraredDetector

__all__ = ["Section", "fits_section", "sections_of"]

Section = tuple[slice, slice]


def sections_of(detector: Detector | InfraredDetector) -> dict[str, Section]:
    """Row and column slices of the named parts of the frame.

    Parameters
    ----------
    detector : Detector or InfraredDetector
        Gives frame and borders.

    Returns
    -------
    dict of str to (slice, slice)
        ``active`` (pixels that see light), ``image`` (active and shielded pixels), ``prescan`` and
        ``overscan_columns`` (every row), ``overscan_rows`` (columns of the image), ``dark_left`` and ``dark_right``
        (rows of the image), ``dark_bottom`` and ``dark_top`` (active columns). All but ``image`` are disjoint and
        cover the frame; a part of no pixels has an empty slice. A near-infrared frame has active pixels only.
    """
    if isinstance(detector, InfraredDetector):
        whole = (slice(0, detector.n_rows), slice(0, detector.n_columns))
        return {"active": whole, "image": whole}
    edge = detector.layout
    rows, columns = detector.active_shape
    left = edge.prescan_columns
    first, bottom = left + edge.dark_columns_left, edge.dark_rows_bottom
    last, top = first + columns, bottom + rows
    right, above = last + edge.dark_columns_right, top + edge.dark_rows_top
    every_row, image_rows, image_columns = slice(0, detector.n_rows), slice(0, above), slice(left, right)
    return {
        "active": (slice(bottom, top), slice(first, last)),
        "image": (image_rows, image_columns),
        "prescan": (every_row, slice(0, left)),
        "overscan_columns": (every_row, slice(right, detector.n_columns)),
        "overscan_rows": (slice(above, detector.n_rows), image_columns),
        "dark_left": (image_rows, slice(left, first)),
        "dark_right": (image_rows, slice(last, right)),
        "dark_bottom": (slice(0, bottom), slice(first, last)),
        "dark_top": (slice(top, above), slice(first, last)),
    }


def fits_section(section: Section) -> str:
    """``"[c1:c2,r1:r2]"``, one-based and inclusive as FITS headers write it; ``""`` for a section of no pixels."""
    rows, columns = section
    if rows.stop <= rows.start or columns.stop <= columns.start:
        return ""
    return f"[{columns.start + 1}:{columns.stop},{rows.start + 1}:{rows.stop}]"
