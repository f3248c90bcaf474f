"""Runs that are broken on purpose, and what has to hold of them: the client of ``server.py``."""

import hashlib
import json
import os
import shutil
import stat
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

HERE = Path(__file__).resolve().parent
STORY = ("run.json", "run.lock", "cpic-run.jsonl")  # when, where and how: not the same twice
NULL = "/dev/null"
STARS = """name,v_mag,sp_type,teff_k,log_g,metallicity,distance_pc,luminosity_lsun,ra_deg,dec_deg
first,3.73,K2V,5080,4.6,-0.1,3.2,0.34,53.2,-9.5
second,3.5,G8V,5283,4.5,-0.5,3.65,0.5,26.0,-15.9
third,4.4,G0V,5950,4.4,0.0,8.7,1.1,88.6,20.3
"""
SIMULATION = {
    "kind": "simulation",
    "name": "x",
    "instrument": {"detector": {"n_columns": 60, "n_rows": 50, "star_column": 30, "star_row": 25}},
    "defaults": {"frames": 3},
    "sequences": [{"kind": "BIAS"}, {"kind": "DARK", "exposure_s": 5}],
}
STRATEGIES = {
    "kind": "strategies",
    "name": "cheap",
    "description": "One visit of each of three stars",
    "universe": {"duration_days": 730, "slot_days": 60, "universes": 100, "exclusions": "none", "facts": "off"},
    "defaults": {
        "time_budget_h": 300,
        "targets": {"names": ["alf Cen A", "eps Eri", "tau Cet"]},
        "visit": {"bands": ["F520"], "time_s": 36000},
        "revisits": {"max_visits": 4},
    },
    "strategies": [{"name": "single", "description": "One visit"}],
}
FILES = {"stars.csv": STARS, "x.yaml": json.dumps(SIMULATION), "w.yaml": json.dumps(STRATEGIES)}
QUESTIONS = {
    "tiny": "tiny",  # a job of the tests, by the main program of cpic
    "simulate": "simulate x.yaml",
    "confirm": "confirm paper_science --band F520 --fidelity quick --no-audit --realisations 2",
    "plan": "plan --catalog stars.csv --top 2 --time-s 1000 --band F520 --realisations 2 --planets 99 --fidelity quick",
    "whatif": "whatif w.yaml --images 0",
}
SECRET = "precious\n"
DECOYS = (
    "thesis.tex",
    "manifest.json",
    "parts/thesis.json",
    "parts/thesis.blob",
    "SCI/61771/notes.fits",
    "Params/mine/notes.txt",
    ".cpic-01234567/product",  # as if it were a temporary folder of a run
    ".plan.json.abcdefgh.part",
)


@dataclass(frozen=True)
class Done:
    """The end of a command, its output, and what the fault wrote when it was reached (None where it was not).

    ``workers`` are the processes of its own that it had when it was killed.
    """

    status: int
    signal: int
    cpu_s: float
    wall_s: float
    memory_mb: float
    workers: int
    out: str
    err: str
    proof: object


class Server:
    """Runs commands in forks of a process that has imported what they need.

    Parameters
    ----------
    scratch : Path
        Folder for its files.
    learns : bool
        Whether it imports what a command has imported. Dask starts no scheduler in a fork of a process that did.
    """

    def __init__(self, scratch, *, learns=True):
        self._scratch, self._learned, self._learns = Path(scratch), set(), learns
        self._scratch.mkdir(exist_ok=True)
        self._scratch.chmod(0o777)
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
        alone = {"OMP_NUM_THREADS": "1", "JE_ARROW_MALLOC_CONF": "background_thread:false"}  # no thread before a fork
        self._process = subprocess.Popen([sys.executable, HERE / "server.py"], env=os.environ | alone, **pipes)

    def close(self):
        self._process.stdin.close()
        self._process.stdout.close()
        self._process.wait()

    def run(self, argv, cwd, *, streams=(NULL, "out", "err"), **more):
        """Run ``cpic`` with some words in a folder.

        Parameters
        ----------
        argv : list of str
        cwd : Path
        streams : tuple
            Files of stdin, stdout and stderr; None for one that is closed.
        **more
            ``root``, below which steps are counted; ``fault``, a mapping of its ``kind``, ``at`` and what it needs;
            ``environment``; ``kill_after_s``, processor time, or ``kill_after_wall_s``; ``most_files`` that it may have
            open.
        """
        places = {name: self._scratch / name for name in ("out", "err", "proof")}
        for path in places.values():
            path.unlink(missing_ok=True)
        given = [str(places.get(stream, stream)) if stream is not None else None for stream in streams]
        request = {"argv": [str(word) for word in argv], "cwd": str(cwd), "streams": given}
        request |= {"proof": str(places["proof"])} | more
        if self._learns and argv[0] not in self._learned:
            self._learned.add(argv[0])
            request["learn"] = str(self._scratch / "modules")
        self._process.stdin.write(f"{json.dumps(request)}\n")
        self._process.stdin.flush()
        answer = json.loads(self._process.stdout.readline())
        texts = {name: path.read_text() if path.exists() else "" for name, path in places.items()}
        proof = json.loads(texts["proof"]) if texts["proof"] else None
        return Done(**answer, out=texts["out"], err=texts["err"], proof=proof)


def told(path):
    """What a path holds, without following it: kind, mode, and content or target."""
    about = path.lstat()
    if stat.S_ISLNK(about.st_mode):
        return "link", os.readlink(path)
    if stat.S_ISDIR(about.st_mode):
        return "folder", oct(about.st_mode)
    return "file", oct(about.st_mode), hashlib.sha256(path.read_bytes()).hexdigest()


def tree(folder):
    """Everything below a folder by name."""
    return {path.relative_to(folder).as_posix(): told(path) for path in sorted(folder.rglob("*"))}


class Place:
    """A folder of its own for one question: its files, files of somebody else beside and in the run's folder.

    Parameters
    ----------
    folder : Path
        Made here.
    question : str
        Name of one of `QUESTIONS`.
    decoys : bool
        Whether files of somebody else stand in the folder of the run, which is then forced.
    workers : int
        Worker processes.
    """

    def __init__(self, folder, question, *, decoys=True, workers=1):
        self.folder, self.out = Path(folder), Path(folder) / "run"
        self.argv = ["-q", *QUESTIONS[question].split(), "--out", "run", *["--force"] * decoys]
        self.argv += ["--workers", str(workers)] if workers > 1 else []
        self.argv = [*self.argv[1:], self.argv[0]]
        beside = self.folder / "beside"
        beside.mkdir(parents=True)
        for name in ("plan.json", "cpic-run.jsonl", "run.lock", "secret"):
            (beside / name).write_text(SECRET)
        for name, text in FILES.items():
            (self.folder / name).write_text(text)
        for name in DECOYS if decoys else ():
            (self.out / name).parent.mkdir(parents=True, exist_ok=True)
            (self.out / name).write_text(SECRET)
        if decoys:
            (self.out / "link.blob").symlink_to(beside / "secret")
        self._inside = set(DECOYS) | {"link.blob"} if decoys else set()
        self._foreign = self.foreign()

    def foreign(self):
        """Everything in and beside the folder of the run that no run wrote."""
        outside = {name: what for name, what in tree(self.folder).items() if name.split("/")[0] != "run"}
        return outside | {name: told(self.out / name) for name in self._inside if os.path.lexists(self.out / name)}

    def results(self):
        """Hash of every file that a run wrote, but those of its story; hidden ones too."""
        if not self.out.exists():
            return {}
        found = {name: what for name, what in tree(self.out).items() if what[0] != "folder" and name not in STORY}
        return {name: what[-1] for name, what in found.items() if name not in self._inside}

    def check_untouched(self):
        assert self.foreign() == self._foreign, "something foreign was touched"

    def check_no_half(self, whole):
        """What has a name is whole: the same as of an undisturbed run."""
        found = {name: what for name, what in self.results().items() if not name.startswith(".")}
        assert found.items() <= whole.items(), {name: what for name, what in found.items() if whole.get(name) != what}

    def check_finished(self, done, whole):
        assert (done.status, done.signal) == (0, 0), done
        assert self.results() == whole
        self.check_untouched()

    def remove(self):
        shutil.rmtree(self.folder)


def check_broken(server, question, folder, fault, whole, steps):
    """Break a run at one step, start it again without the fault, and check all that is promised.

    Returns
    -------
    Done
        How the broken run ended.
    """
    place = Place(folder, question)
    broken = server.run(place.argv, place.folder, root=str(place.out), fault=fault)
    assert broken.proof == {"step": steps[fault["at"]], "number": fault["at"]}, (fault, broken)
    if fault["kind"] == "kill":
        assert broken.signal == 9, broken
    elif broken.status != 0:
        assert broken.status == 1, broken
        assert broken.out == "", broken
        assert broken.err.count("\n") == 1, broken
        assert {"full": "No space left on device", "broken": "Input/output error"}[fault["kind"]] in broken.err, broken
    else:
        assert place.results() == whole
    place.check_untouched()
    place.check_no_half(whole)
    again = server.run(place.argv, place.folder)
    place.check_finished(again, whole)
    place.remove()
    return broken
