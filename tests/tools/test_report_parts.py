"""Tables and pictures that the scripts of the reports share."""

import base64
import platform

import pytest
from matplotlib.figure import Figure

from cpic_planner.report.drawing import Picture
from tools.report_parts import csv_text, machine, png, table, write_picture


def test_a_table_has_its_head_first():
    assert table(["star", "SNR"], [["tau Cet", 5], ("eps Eri", 7.5)]).splitlines() == [
        "| star | SNR |",
        "| --- | --- |",
        "| tau Cet | 5 |",
        "| eps Eri | 7.5 |",
    ]


def test_numbers_have_six_digits_and_columns_are_those_of_the_first_row():
    text = csv_text([{"a": 1 / 3, "b": "x, y"}, {"a": 2, "b": None, "c": 5}])
    assert text == 'a,b\n0.333333,"x, y"\n2,\n'


def test_the_same_figure_gives_the_same_bytes():
    first, second = (png(Figure(figsize=(1, 1)), dpi) for dpi in (50, 50))
    assert first == second
    assert first.startswith(b"\x89PNG")
    assert b"Software" not in first
    assert len(png(Figure(figsize=(1, 1)), 100)) > len(first)


@pytest.mark.parametrize(("kind", "suffix"), [("image/svg+xml", ".svg"), ("image/png", ".png")])
def test_a_picture_is_written_under_the_suffix_of_its_kind(tmp_path, kind, suffix):
    content = b"drawn"
    picture = Picture(f"data:{kind};base64,{base64.b64encode(content).decode()}", alt="", caption="")
    assert write_picture(tmp_path, "snr", picture) == f"snr{suffix}"
    assert (tmp_path / f"snr{suffix}").read_bytes() == content


def test_the_machine_names_python_and_the_packages():
    assert machine("numpy").endswith(f"Python {platform.python_version()}, numpy {__import__('numpy').__version__}")
