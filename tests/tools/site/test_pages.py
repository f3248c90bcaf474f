"""Figures, answers and reports in the pages of the site."""

import pytest

from tools import readme
from tools.site import pages


def test_figures_of_reports_stand_by_their_names():
    assert pages.with_figures("of {{ plan.stars }} stars") == f"of {readme.plan()['stars']} stars"
    assert "| yes |" in pages.with_figures("{{ table.whatif }}")
    with pytest.raises(KeyError):
        pages.with_figures("{{ plan.nothing }}")


def test_commands_are_answered():
    text = pages.prepared('```{run}\ncpic etc "tau Cet" --snr 10 --band F520 --brief\n```\n')
    assert text.startswith('```console\n$ cpic etc "tau Cet" --snr 10 --band F520 --brief\n')
    assert "detected" in text
    assert text.endswith("```\n")


def test_a_command_that_fails_stops_the_build():
    with pytest.raises(RuntimeError, match="exit status 2: cpic: star = Nobody"):
        pages.answer("cpic etc Nobody --snr 10")


def test_reports_keep_their_figures_and_lose_their_files(tmp_path):
    source = tmp_path / "law" / "report.md"
    source.parent.mkdir()
    source.write_text("# A law\n\n![fit](fit.png)\n\n[numbers](law.csv), [paper](https://example.org/paper)\n")
    (source.parent / "fit.png").write_bytes(b"png")
    out = tmp_path / "out"
    out.mkdir()
    pages.copy_report(source, out)
    text = (out / "law.md").read_text()
    assert "![fit](law/fit.png)" in text
    assert "`law.csv`" in text
    assert "(https://example.org/paper)" in text
    assert (out / "law" / "fit.png").read_bytes() == b"png"


def test_the_gallery_has_every_figure_of_the_reports():
    text = pages.gallery()
    for path in (pages.ROOT / "reports").rglob("report.md"):
        for line in path.read_text(encoding="utf-8").splitlines():
            if line.startswith("!["):
                assert line.rpartition("(")[2].rstrip(")") in text
    assert text.count("![") > 10
