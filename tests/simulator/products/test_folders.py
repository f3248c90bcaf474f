import subprocess
import sys

import pytest

from simulator.products.folders import claim, clear_stale_parts, temporary_folders


class Stop(RuntimeError):
    pass


def below(root):
    return sorted(str(path.relative_to(root)) for path in root.rglob("*"))


def fill(root):
    for name in ("SCI/1/a.fits", "Params/4/V01/log.csv"):
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text("x")


def guarded(root):
    return temporary_folders(
        [root / "SCI/1", root / "Params/4"], whole=root / "Params/4/V01", done=root / "SCI/1/b.fits"
    )


def failing(root, *steps):
    """Do something and fail."""
    with guarded(root):
        for step in steps:
            step()
        raise Stop


def test_what_was_made_goes_on_failure_only(tmp_path):
    root = tmp_path / "tree"
    with pytest.raises(Stop):
        failing(root, lambda: fill(root), (root / "SCI/1/a.fits").unlink)
    assert not root.exists()
    with guarded(root):
        fill(root)
    before = below(tmp_path)
    with pytest.raises(Stop):
        failing(root)
    assert below(tmp_path) == before


def test_files_of_others_stay(tmp_path):
    # Somebody was faster, and the parameters are theirs.
    with pytest.raises(Stop):
        failing(tmp_path, lambda: fill(tmp_path), (tmp_path / "SCI/1/b.fits").touch)
    assert "Params/4/V01/log.csv" in below(tmp_path)


def test_parts_of_the_dead_go_and_those_of_the_living_stay(tmp_path):
    path = tmp_path / "a.fits"
    mine, dead, other = (tmp_path / name for name in (".a.fits.1.part", ".a.fits.2.part", ".b.fits.1.part"))
    other.write_text("x")
    script = (
        "import sys\nfrom simulator.products.folders import claim\n"
        f"file = open({str(dead)!r}, 'wb')\nclaim(file)\nprint('ready', flush=True)\nsys.stdin.read()"
    )
    with (
        subprocess.Popen([sys.executable, "-c", script], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process,
        mine.open("wb") as file,
    ):
        assert process.stdout is not None
        assert process.stdout.readline() == b"ready\n"
        claim(file)
        clear_stale_parts(path)
        assert mine.exists()
        assert dead.exists()  # its writer lives
        process.kill()
        process.wait()
        clear_stale_parts(path)
        assert mine.exists()
        assert not dead.exists()
    clear_stale_parts(path)
    assert below(tmp_path) == [".b.fits.1.part"]
