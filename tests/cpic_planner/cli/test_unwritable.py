"""Every command refuses an output that cannot be written before it does any work, and writes through links."""

import os

import pytest

from cpic_planner.jobs import Job

NOWHERE = "/dev/null/nowhere"
SCENE = ("--band", "F520", "--exposure-s", "17", "--em-gain", "20")
STAR = ("tau Cet", "--band", "F520", "--separation-arcsec", "0.5")
ANSWERS = {
    ("rank", "--out", "no/such/ranking.csv"): "cpic_planner.api.prepared",
    ("rank", "--plot", "no/such/ranking.png"): "cpic_planner.api.prepared",
    ("etc", *STAR, "--snr", "5", "--plot", "no/such/etc.png"): "cpic_planner.api.answered",
    ("visibility", "tau Cet", "--out", "no/such/days.csv"): "cpic_planner.api.visibility_of",
    ("visibility", "tau Cet", "--plot", "no/such/days.png"): "cpic_planner.api.visibility_of",
    ("known", "eps Eri", "--scene", "no/such/scene.yaml"): "cpic_planner.etc.build_model",
    ("instrument", "table", "--band", "F662", "--out", "no/such/f662.csv"): "simulator.imaging.table_psf._columns",
    ("catalog", "refresh", "--out", "no/such/stars.ecsv"): "catalogs.refresh_stars",
}
"""Commands that write a file, and the first of what they work long at."""


def never(*arguments, **keywords):
    raise AssertionError("it went to work")


@pytest.mark.parametrize(
    "arguments",
    [
        ("plan",),
        ("simulate", "paper_example", *SCENE),
        ("simulate", "--kind", "BIAS"),
        ("confirm", "paper_example"),
        ("whatif", "survey_default"),
        ("tradeoff", "--quick-look", "--scene", "faint"),
        ("curve", *STAR),
        ("roc", *STAR, "--contrast", "3e-9"),
    ],
    ids=" ".join,
)
def test_a_folder(refuses, monkeypatch, tmp_path, arguments):
    monkeypatch.setattr(Job, "digest", property(never))
    refuses((*arguments, "--out", NOWHERE), ["--out = /dev/null/nowhere", "a writable folder (Not a directory)"])
    (tmp_path / "thesis.tex").write_text("precious")
    refuses((*arguments, "--out", tmp_path), ["an empty folder or one of an earlier run", "thesis.tex"])
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]


@pytest.mark.parametrize("arguments", ANSWERS, ids=" ".join)
def test_a_file(refuses, monkeypatch, arguments):
    monkeypatch.setattr(ANSWERS[arguments], never)
    refuses(arguments, [f"{arguments[-2]} = {arguments[-1]}", "a writable file (No such file or directory)"])


@pytest.mark.parametrize("kind", ["pipe", "device", "folder", "nothing"])
@pytest.mark.parametrize("arguments", ANSWERS, ids=" ".join)
def test_what_is_no_file_is_not_replaced(refuses, monkeypatch, tmp_path, arguments, kind):
    monkeypatch.setattr(ANSWERS[arguments], never)
    there, path = tmp_path / "there", tmp_path / os.path.basename(arguments[-1])
    if kind == "pipe":
        os.mkfifo(there)
    elif kind == "folder":
        there.mkdir()
    path.symlink_to("/dev/null" if kind == "device" else there)
    reason = "No such file or directory" if kind == "nothing" else f"this is a {kind}"
    refuses((*arguments[:-1], path), [f"{arguments[-2]} = {path}", reason])
    assert path.is_symlink()
    assert there.is_fifo() == (kind == "pipe")


@pytest.mark.parametrize(
    "arguments",
    [
        ("rank", "--v-mag-max", "2", "--band", "F520", "--planets", "2", "--out", "ranking.csv"),
        ("rank", "--v-mag-max", "2", "--band", "F520", "--planets", "2", "--plot", "ranking.svg"),
        ("visibility", "tau Cet", "--days", "2", "--out", "days.csv"),
        ("known", "eps Eri", "--planets", "50", "--scene", "scene.yaml"),
        ("instrument", "table", "--band", "F662", "--out", "f662.csv"),
    ],
    ids=" ".join,
)
def test_a_link_stays_and_what_it_leads_to_is_written(done, tmp_path, arguments):
    path, target = tmp_path / arguments[-1], tmp_path / "target"
    target.write_text("old")
    path.symlink_to("target")
    _, err = done(*arguments[:-1], path)
    assert os.readlink(path) == "target"
    assert len(target.read_text()) > 100
    assert f"{target}, to which {path} is a link" in err
