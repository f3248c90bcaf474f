"""Nothing is lost in an output folder: whatever stands in it and was not written by the run is there afterwards."""

import hashlib
import json
import os
import signal
import subprocess
import sys

import pytest

from cpic_core import InputError
from cpic_planner.cli.main import main
from cpic_planner.jobs.folder import LIST_NAME, open_run_folder


def test_finished_parts_are_reused_and_foreign_configurations_refused(tmp_path):
    out = tmp_path / "deep" / "run"
    with open_run_folder(out, kind="plan", config_hash="aaaa") as folder:
        assert not folder.resumed
        assert folder.part("x F520") is None
        assert folder.save_part("x F520", {"value": 0.1}) == {"value": 0.1}
    with open_run_folder(out, kind="plan", config_hash="aaaa") as folder:
        assert folder.resumed
        assert folder.part("x F520") == {"value": 0.1}
    with pytest.raises(InputError, match="configuration aaaa"), open_run_folder(out, kind="plan", config_hash="bbbb"):
        pass
    with open_run_folder(out, kind="plan", config_hash="bbbb", force=True) as folder:
        assert not folder.resumed
        assert folder.part("x F520") is None


@pytest.mark.parametrize("damage", [lambda t: t[: len(t) // 2], lambda t: t.replace("0.1", "0.2"), lambda t: ""])
def test_damaged_part_is_done_again(tmp_path, damage, caplog):
    with open_run_folder(tmp_path / "o", kind="plan", config_hash="h") as folder:
        folder.save_part("k", {"value": 0.1})
        path = next((tmp_path / "o" / "parts").iterdir())
        path.write_text(damage(path.read_text()))
        assert folder.part("k") is None
    assert "damaged" in caplog.text


def test_names_that_look_alike_on_disk_are_kept_apart(tmp_path):
    with open_run_folder(tmp_path / "o", kind="plan", config_hash="h") as folder:
        folder.save_part("* alf Cen", {"v": 1})
        folder.save_part("_ alf Cen", {"v": 2})
        assert folder.part("* alf Cen") == {"v": 1}
        assert all("/" not in p.name and "*" not in p.name for p in (tmp_path / "o" / "parts").iterdir())


def test_live_folder_is_refused_and_free_again_after_kill(tmp_path):
    out = tmp_path / "o"
    code = (
        "import time\nfrom cpic_planner.jobs.folder import open_run_folder\n"
        f"with open_run_folder({str(out)!r}, kind='plan', config_hash='h') as f:\n"
        "    f.save_part('done', {'v': 1}); print('in', flush=True); time.sleep(60)"
    )
    holder = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    assert holder.stdout.readline().strip() == "in"
    for force in (False, True):
        refused(out, match=f"in use by pid {holder.pid}", force=force)
    os.kill(holder.pid, signal.SIGKILL)
    holder.wait()
    holder.stdout.close()
    with open_run_folder(out, kind="plan", config_hash="h") as folder:
        assert folder.resumed
        assert folder.part("done") == {"v": 1}


def test_somebody_elses_folder_is_left_alone(tmp_path):
    (tmp_path / "thesis.tex").write_text("precious")
    with pytest.raises(InputError, match="thesis.tex"), open_run_folder(tmp_path, kind="plan", config_hash="h"):
        pass
    assert sorted(p.name for p in tmp_path.iterdir()) == ["thesis.tex"]
    with open_run_folder(tmp_path, kind="plan", config_hash="h", force=True):
        pass
    assert (tmp_path / "thesis.tex").read_text() == "precious"


def test_unusable_folder_is_one_clear_line(tmp_path):
    (tmp_path / "file").write_text("")
    with (
        pytest.raises(InputError, match="a writable folder"),
        open_run_folder(tmp_path / "file", kind="plan", config_hash="h"),
    ):
        pass


def test_a_folder_in_which_nothing_was_finished_is_taken_over(tmp_path):
    with open_run_folder(tmp_path, kind="plan", config_hash="aaaa"):
        pass
    with open_run_folder(tmp_path, kind="plan", config_hash="bbbb") as folder:
        assert not folder.resumed
        folder.write("simulation.json", "{}")
    with pytest.raises(InputError, match="bbbb"), open_run_folder(tmp_path, kind="plan", config_hash="aaaa"):
        pass


MINE = "0000000a-0000000b-0000000c-0000000d-0000000e"


def opened(path, fingerprint, **more):
    return open_run_folder(path, kind="plan", config_hash="aaaa", fingerprint=fingerprint, **more)


@pytest.mark.parametrize(
    ("other", "word"),
    [
        (MINE.replace("0a", "ff"), "code"),
        (MINE.replace("0d", "ff"), "libraries"),
        ("of older code", "code and presets"),
    ],
)
def test_what_other_software_began_is_refused_unless_forced_and_then_begun_anew(tmp_path, other, word, caplog):
    with opened(tmp_path, other) as folder:
        folder.save_part("x", {"value": 0.1})
    with pytest.raises(InputError, match=f"made with other {word}.*--force"), opened(tmp_path, MINE):
        pass
    with opened(tmp_path, MINE, force=True) as folder:
        assert not folder.resumed
        assert folder.part("x") is None
    assert f"{tmp_path}: begun anew: what it holds was made with other {word}" in caplog.text


def test_a_part_that_other_software_made_is_done_again(tmp_path):
    with opened(tmp_path, MINE) as folder:
        folder.save_part("x", {"value": 0.1})
        path = next((tmp_path / "parts").iterdir())
        path.write_text(path.read_text().replace(MINE, MINE.replace("0c", "ff")))
        assert folder.part("x") is None


def test_another_processor_goes_on_and_says_what_that_means(tmp_path, caplog):
    other = MINE.replace("0e", "ff")
    with opened(tmp_path, MINE) as folder:
        folder.save_part("x", {"value": 0.1})
        assert folder.fingerprints == [MINE]
    for _ in range(2):
        with opened(tmp_path, other) as folder:
            assert folder.resumed
            assert folder.part("x") == {"value": 0.1}
            assert folder.fingerprints == [MINE, other]
    assert caplog.text.count("another processor takes part: computed numbers equal within 1e-09") == 1


PRODUCTS = ("plan.json", "report.html")


def run(path, config_hash="aaaa", *, kind="plan", force=False):
    """A small run: two parts and two products."""
    with open_run_folder(path, kind=kind, config_hash=config_hash, products=PRODUCTS, force=force) as folder:
        for key in ("a", "b"):
            if folder.part(key) is None:
                folder.save_part(key, {"value": config_hash})
        for name in PRODUCTS:
            folder.write(name, f"{name} of {config_hash}")
    return folder


def content(folder):
    """Everything in a folder: hashes of files, targets of links."""
    return {
        path.relative_to(folder).as_posix(): os.readlink(path)
        if path.is_symlink()
        else hashlib.sha256(path.read_bytes()).hexdigest()
        if path.is_file()
        else "folder"
        for path in sorted(folder.rglob("*"))
    }


def refused(path, *, match, **more):
    """Run where it must be refused; nothing may change."""
    before = content(path)
    with pytest.raises(InputError, match=match):
        run(path, **more)
    assert content(path) == before


def test_a_folder_with_a_manifest_and_parts_of_another_program_is_left_alone(tmp_path, capsys):
    """The command of the review: it deleted the thesis, and ended well."""
    web = tmp_path / "web"
    (web / "parts" / "sub").mkdir(parents=True)
    (web / "manifest.json").write_text('{"name": "My web app"}')
    (web / "parts" / "sub" / "thesis").write_text("thesis")
    before = content(web)
    simulate = ["simulate", "--kind", "BIAS", "--frames", "1", "--out", str(web)]
    assert main(simulate) == 2
    assert "manifest.json" in capsys.readouterr().err
    assert content(web) == before
    assert main([*simulate, "--force"]) == 0
    assert before.items() <= content(web).items()


@pytest.mark.parametrize("manifest", ["", "[1, 2]", '{"name": "x"', '{"schema_version": 1, "kind": "plan"}'])
@pytest.mark.parametrize("force", [False, True])
def test_products_that_no_list_names_stay(tmp_path, manifest, force):
    (tmp_path / "manifest.json").write_text(manifest)
    (tmp_path / "report.html").write_text("mine")
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "mine").write_text("mine")
    refused(tmp_path, match=r"report\.html" if force else r"manifest\.json", force=force)


@pytest.mark.parametrize("name", ["report.html", LIST_NAME, "run.lock", "parts"])
@pytest.mark.parametrize("force", [False, True])
def test_links_are_not_followed(tmp_path, name, force):
    out, away = tmp_path / "out", tmp_path / "away"
    out.mkdir()
    if name == "parts":
        away.mkdir()
        (away / "x").write_text("precious")
    else:
        away.write_text("precious")
    (out / name).symlink_to(away)
    refused(tmp_path / "out", match=name, force=force)
    assert (away / "x" if name == "parts" else away).read_text() == "precious"


def test_a_lock_file_of_somebody_else_is_not_emptied(tmp_path):
    away, out = tmp_path / "away", tmp_path / "out"
    out.mkdir()
    (out / "run.lock").write_text("versions of my packages")
    refused(out, match=r"run\.lock", force=True)
    (out / "run.lock").unlink()
    away.touch()
    (out / "run.lock").hardlink_to(away)
    refused(out, match=r"run\.lock", force=True)
    assert away.read_text() == ""


def test_force_removes_what_the_list_names_and_nothing_else(tmp_path):
    out = tmp_path / "out"
    run(out, kind="confirm")
    (out / "parts" / "sub").mkdir()
    decoys = ("notes.txt", "parts/notes.txt", "parts/sub/thesis", "parts/.a.part", ".report.html.x.part", "whatif.json")
    for name in decoys:
        (out / name).write_text("precious")
    before = content(out)
    run(out, "bbbb", force=True)
    run(tmp_path / "fresh", "bbbb")
    after, fresh = content(out), content(tmp_path / "fresh")
    mine = {name: what for name, what in before.items() if what == hashlib.sha256(b"precious").hexdigest()}
    assert len(mine) == 6
    fresh.pop(LIST_NAME), after.pop(LIST_NAME)  # name temporary folders
    assert after == fresh | mine | {"parts/sub": "folder"}


def test_folders_that_a_run_made_go_with_it_where_they_are_empty(tmp_path):
    run(tmp_path)
    with open_run_folder(tmp_path, kind="plan", config_hash="bbbb", force=True):
        assert not (tmp_path / "parts").exists()
    (tmp_path / "mine" / "parts").mkdir(parents=True)
    run(tmp_path / "mine", force=True)
    with open_run_folder(tmp_path / "mine", kind="plan", config_hash="bbbb", force=True):
        assert list((tmp_path / "mine" / "parts").iterdir()) == []


@pytest.mark.parametrize("config_hash", ["aaaa", "bbbb"])
def test_what_was_changed_since_is_set_aside_and_said(tmp_path, config_hash, caplog):
    """Whether the same run is continued or another one is forced."""
    run(tmp_path)
    (tmp_path / "report.html").write_text("annotated")
    (tmp_path / "plan.json").unlink()
    (tmp_path / "away").write_text("precious")
    (tmp_path / "plan.json").symlink_to("away")
    run(tmp_path, config_hash, force=True)
    assert (tmp_path / "report.html.changed-1").read_text() == "annotated"
    assert os.readlink(tmp_path / "plan.json.changed-1") == "away"
    assert (tmp_path / "away").read_text() == "precious"
    assert (tmp_path / "report.html").read_text() == f"report.html of {config_hash}"
    assert "report.html was changed after it was written: kept as report.html.changed-1" in caplog.text
    (tmp_path / "report.html").write_text("annotated again")
    run(tmp_path, config_hash)
    assert (tmp_path / "report.html.changed-2").read_text() == "annotated again"


def test_a_second_name_of_a_product_keeps_its_content(tmp_path):
    run(tmp_path / "out")
    (tmp_path / "kept.html").hardlink_to(tmp_path / "out" / "report.html")
    run(tmp_path / "out", "bbbb", force=True)
    assert (tmp_path / "kept.html").read_text() == "report.html of aaaa"


def test_the_parts_of_a_run_are_not_removed_behind_a_link(tmp_path):
    run(tmp_path / "out")
    (tmp_path / "out" / "parts").rename(tmp_path / "away")
    (tmp_path / "out" / "parts").symlink_to(tmp_path / "away")
    refused(tmp_path / "out", match="parts", config_hash="bbbb", force=True)
    assert len(list((tmp_path / "away").iterdir())) == 2


DAMAGE = {
    "empty": lambda text: "",
    "first line cut": lambda text: text[:20],
    "not JSON": lambda text: text.replace('{"folder"', '{"folder', 1),
    "leads out": lambda text: text.replace('"parts/', '"../', 1),
    "absolute": lambda text: text.replace('"report.html"', '"/etc/passwd"', 1),
    "another program": lambda text: text.replace("cpic-planner", "npm", 1),
    "no object": lambda text: "[1]\n" + text,
    "a temporary folder of others": lambda text: text.replace(".cpic-", "parts", 1),
}


@pytest.mark.parametrize("damage", DAMAGE)
@pytest.mark.parametrize("force", [False, True])
def test_a_damaged_list_is_set_aside_and_nothing_is_removed_by_it(tmp_path, damage, force, caplog):
    out = tmp_path / "out"
    run(out)
    text = DAMAGE[damage]((out / LIST_NAME).read_text())
    (out / LIST_NAME).write_text(text)
    before = content(out)
    with pytest.raises(InputError, match=r"plan\.json" if force else "no list"):
        run(out, "bbbb", force=force)
    assert content(out) == {name.replace(LIST_NAME, f"{LIST_NAME}.damaged-1"): what for name, what in before.items()}
    assert f"kept as {LIST_NAME}.damaged-1" in caplog.text


def test_a_flipped_name_in_the_list_removes_nothing_of_somebody_else(tmp_path):
    """The content must be that of the list too."""
    run(tmp_path)
    (tmp_path / "report.htmm").write_text("report.html of AAAA")  # as long as ours
    path = tmp_path / LIST_NAME
    path.write_text(path.read_text().replace('"report.html"', '"report.htmm"'))
    with pytest.raises(InputError, match=r"report\.html"):
        run(tmp_path, "bbbb", force=True)
    assert (tmp_path / "report.htmm").read_text() == "report.html of AAAA"


def test_a_list_of_another_version_is_refused(tmp_path):
    run(tmp_path)
    path = tmp_path / LIST_NAME
    path.write_text(path.read_text().replace('"schema_version": 3', '"schema_version": 2'))
    refused(tmp_path, match="another version", force=True)


def test_the_line_of_a_file_that_never_got_its_name_is_cut_off(tmp_path):
    run(tmp_path)
    path = tmp_path / LIST_NAME
    path.write_text(path.read_text() + '{"file": "parts/c')
    folder = run(tmp_path)
    assert folder.resumed
    assert all(json.loads(line) for line in path.read_text().splitlines())


def test_a_list_that_lost_its_end_names_less(tmp_path):
    run(tmp_path)
    path = tmp_path / LIST_NAME
    lines = [line for line in path.read_text().splitlines() if "report.html" not in line]
    path.write_text("\n".join([*lines, '{"fi']))
    refused_line = r"report\.html.*did not write"
    with pytest.raises(InputError, match=refused_line):
        run(tmp_path, "bbbb", force=True)
    assert (tmp_path / "report.html").read_text() == "report.html of aaaa"


KILLED_AT = ("os.fsync", "pathlib.Path.replace", "pathlib.Path.unlink", "pathlib.Path.mkdir", "pathlib.Path.rmdir")
SCRIPT = """
import os, pathlib, sys
from cpic_planner.jobs.folder import open_run_folder
out, config_hash, name, left = sys.argv[1], sys.argv[2], sys.argv[3], int(sys.argv[4])
home, word = (os, "fsync") if name == "os.fsync" else (pathlib.Path, name.split(".")[-1])
plain = getattr(home, word)
def dying(*given, **more):
    global left
    if left == 0:
        os.kill(os.getpid(), 9)
    left -= 1
    return plain(*given, **more)
setattr(home, word, dying)
with open_run_folder(out, kind="plan", config_hash=config_hash, products=("plan.json",), force=True) as folder:
    if folder.part("a") is None:
        folder.save_part("a", {"value": config_hash})
    folder.write("plan.json", config_hash)
"""


@pytest.mark.parametrize("name", KILLED_AT)
def test_a_kill_at_any_moment_neither_blocks_nor_loses(tmp_path, name):
    """One run replaces another and dies at the first, second, ... call of what changes the disk."""
    finished = False
    for step in range(12):
        out = tmp_path / str(step)
        with open_run_folder(out, kind="plan", config_hash="aaaa", products=("plan.json",)) as folder:
            folder.save_part("a", {"value": "aaaa"})
            folder.write("plan.json", "aaaa")
        (out / "parts" / "mine.json").write_text("precious")
        pid = os.fork()
        if pid == 0:  # a process of its own, without a second start of the interpreter
            sys.argv = ["x", str(out), "bbbb", name, str(step)]
            try:
                exec(compile(SCRIPT, "script", "exec"), {})
            finally:
                os._exit(0)
        finished = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) != -signal.SIGKILL
        with open_run_folder(out, kind="plan", config_hash="bbbb", products=("plan.json",), force=True) as folder:
            folder.write("plan.json", "bbbb")
            if folder.part("a") is None:
                folder.save_part("a", {"value": "bbbb"})
        left = {path.relative_to(out).as_posix() for path in out.rglob("*") if path.is_file()}
        litter = {path for path in left if path.startswith(f".{LIST_NAME}.")}  # of a kill while the list was begun
        part = next(iter((out / "parts").glob("a-*.json"))).name
        assert left - litter == {LIST_NAME, "run.lock", "plan.json", f"parts/{part}", "parts/mine.json"}, step
        assert (out / "plan.json").read_text() == "bbbb"
        assert (out / "parts" / "mine.json").read_text() == "precious"
        if finished:
            break
    assert finished
    assert step >= 1
