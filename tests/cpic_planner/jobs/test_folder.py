import os
import signal
import subprocess
import sys

import pytest

from cpic_core import InputError
from cpic_planner.jobs.folder import open_run_folder


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
    with (
        pytest.raises(InputError, match=f"in use by pid {holder.pid}"),
        open_run_folder(out, kind="plan", config_hash="h"),
    ):
        pass
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
