from __future__ import annotations

import pickle

import numpy as np
import pytest

from simulator.config import Detector, load_instrument
from simulator.products.write import fits_section


def test_parts_of_the_default_frame(detector) -> None:
    parts = {name: fits_section(section) for name, section in detector.sections.items()}
    assert parts == {
        "active": "[25:1048,3:1026]",
        "image": "[9:1064,1:1032]",
        "prescan": "[1:8,1:1050]",
        "overscan_columns": "[1065:1080,1:1050]",
        "overscan_rows": "[9:1064,1033:1050]",
        "dark_left": "[9:24,1:1032]",
        "dark_right": "[1049:1064,1:1032]",
        "dark_bottom": "[25:1048,1:2]",
        "dark_top": "[25:1048,1027:1032]",
    }
    rows, columns = detector.sections["active"]
    assert (rows.stop - rows.start, columns.stop - columns.start) == detector.active_shape == (1024, 1024)


@pytest.mark.parametrize("borders", [(8, 16, 16, 16, 2, 6, 18), (0, 0, 0, 0, 0, 0, 0), (3, 0, 1, 0, 5, 0, 2)])
def test_parts_cover_the_frame_once(changed, borders) -> None:
    names = tuple(
        """
        prescan_columns dark_columns_left dark_columns_right overscan_columns dark_rows_bottom dark_rows_top
        overscan_rows
    """.split()
    )
    det: Detector = changed(layout=dict(zip(names, borders, strict=True)))
    covered = np.zeros((det.n_rows, det.n_columns), dtype=int)
    parts = det.sections
    for name, section in parts.items():
        if name != "image":
            covered[section] += 1
    assert (covered == 1).all()
    image = np.zeros_like(covered)
    for name in ("active", "dark_left", "dark_right", "dark_bottom", "dark_top"):
        image[parts[name]] += 1
    whole = np.zeros_like(covered)
    whole[parts["image"]] = 1
    assert np.array_equal(image, whole)


def test_a_part_of_no_pixels_has_no_section(changed) -> None:
    det = changed(layout={**changed().layout.model_dump(), "prescan_columns": 0})
    assert fits_section(det.sections["prescan"]) == ""


def test_every_near_infrared_pixel_is_active(infrared) -> None:
    assert {fits_section(s) for s in infrared.sections.values()} == {"[1:640,1:512]"}


def test_an_instrument_travels_to_other_processes() -> None:
    """Workers get it by pickle; models that are made from the chains of effects have to be found there."""
    instrument = load_instrument()
    assert pickle.loads(pickle.dumps(instrument)) == instrument
