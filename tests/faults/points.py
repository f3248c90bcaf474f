"""Faults in a process of its own: at a numbered step of writing files below a folder, or in its clocks.

A step is a call that changes what a file system holds, as the kernel would see it: open for writing, write, sync,
rename, link, remove, folder made or removed, cut, mode. They are caught where Python makes them (audit events,
``os.write``, ``os.fsync``, the files that ``os.fdopen`` returns), whoever asks for them. What is random in names is
written as ``*``.
"""

import datetime as real
import errno
import io
import json
import os
import re
import signal
import sys
import time

GROWS = ("open", "write", "mkdir", "link")  # what a full disk refuses
_RANDOM = [(re.compile(r"\.cpic-[0-9a-f]{8}"), ".cpic-*"), (re.compile(r"\.\w{8}\.part"), ".*.part")]
_OPEN, _CLOSE, _FSYNC, _WRITE, _KILL = os.open, os.close, os.fsync, os.write, os.kill


def note(path, tree):
    """Leave proof, by the functions as they were before any fault was put into them."""
    handle = _OPEN(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o666)
    _WRITE(handle, json.dumps(tree).encode())
    _FSYNC(handle)
    _CLOSE(handle)


class Steps:
    """Counts the steps below a folder, and breaks the one that is asked for.

    Parameters
    ----------
    root : str
        Folder; nothing outside counts.
    kind : str
        ``full`` (this step and all that need space after it fail with ENOSPC), ``broken`` (this step fails with EIO),
        ``kill`` (SIGKILL before the step, a write half done), or empty: only record.
    at : int
        Number of the step, from 0; above the last: only record.
    proof : str
        File that is written when the step is reached; in recording, at the end, with the names of all.
    """

    def __init__(self, root, kind, at, proof):
        self.root, self.kind, self.at, self.proof = f"{os.path.realpath(root)}/", kind, at, proof
        self.names, self.full, self.busy = [], False, False

    def install(self):
        sys.addaudithook(self._heard)
        os.write, os.fsync, os.fdopen = self._os_write, self._os_fsync, self._os_fdopen

    def named(self, path, folder=-1):
        """Name of a path in the order of steps; None outside the folder."""
        path = os.readlink(f"/proc/self/fd/{path}") if isinstance(path, int) else os.fsdecode(path)
        if isinstance(folder, int) and folder >= 0:
            path = f"{os.readlink(f'/proc/self/fd/{folder}')}/{path}"
        path = os.path.abspath(path)
        if not path.startswith(self.root):
            return None
        name = path[len(self.root) :]
        for pattern, text in _RANDOM:
            name = pattern.sub(text, name)
        return name

    def step(self, operation, path, folder=-1, half=None):
        """Count a step, and break it if it is the one; ``half`` does a part of it first."""
        if self.busy:
            return
        self.busy = True
        try:
            name = self.named(path, folder)
            if name is None:
                return
            number = len(self.names)
            self.names.append(f"{operation} {name}")
            if number == self.at:
                note(self.proof, {"step": self.names[-1], "number": number})
                if half is not None:
                    half()
                if self.kind == "kill":
                    _KILL(os.getpid(), signal.SIGKILL)
                    time.sleep(60)
                self.full = self.kind == "full"
                if self.kind == "broken":
                    raise OSError(errno.EIO, os.strerror(errno.EIO), name)
            if self.full and (operation in GROWS or number == self.at):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), name)
        finally:
            self.busy = False

    def _heard(self, event, args):
        if event == "open":
            path, _, flags = args
            if isinstance(path, str) and flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT):
                self.step("open", path)
        elif event in ("os.rename", "os.link"):
            self.step(event[3:], args[1], args[3])
        elif event in ("os.mkdir", "os.chmod"):
            self.step(event[3:], args[0], args[2])
        elif event in ("os.remove", "os.rmdir"):
            self.step(event[3:], args[0], args[1])
        elif event == "os.truncate":
            self.step("truncate", args[0])

    def _os_write(self, handle, data):
        self.step("write", handle, half=lambda: _WRITE(handle, data[: len(data) // 2]))
        return _WRITE(handle, data)

    def _os_fsync(self, handle):
        self.step("sync", handle)
        _FSYNC(handle)

    def _os_fdopen(self, handle, mode="r", buffering=-1, encoding=None, errors=None, *rest):
        if "+" not in mode:
            return open(handle, mode, buffering, encoding, errors, *rest)
        file = io.BufferedRandom(_Raw(self, handle, mode.replace("b", "")))
        return file if "b" in mode else io.TextIOWrapper(file, encoding, errors)


class _Raw(io.FileIO):
    """A file whose writes are steps."""

    def __init__(self, steps, handle, mode):
        super().__init__(handle, mode)
        self._steps = steps

    def write(self, data):
        part = bytes(data[: len(data) // 2])
        self._steps.step("write", self.fileno(), half=lambda: super(_Raw, self).write(part))
        return super().write(data)


def jump(shift_s, at, proof):
    """Let the clock of the day jump by ``shift_s`` seconds after ``at`` looks at it, in every module that looks."""
    looks = 0

    def shift():
        nonlocal looks
        looks += 1
        if looks == at + 1:
            note(proof, {"looks": at, "shift_s": shift_s})
        return shift_s if looks > at else 0.0

    class Kind(type):
        def __instancecheck__(cls, instance):
            return isinstance(instance, real.datetime)

    class Clock(real.datetime, metaclass=Kind):
        @classmethod
        def now(cls, tz=None):
            return real.datetime.now(tz) + real.timedelta(seconds=shift())

    now_s = time.time
    time.time = lambda: now_s() + shift()
    for name, module in list(sys.modules.items()):
        if name.startswith(("cpic_", "simulator", "catalogs")) and vars(module).get("datetime") is real.datetime:
            module.datetime = Clock


def become(version, proof):
    """Let the program be of another version."""
    from cpic_planner import version as module

    before = module.__version__
    for name, other in list(sys.modules.items()):
        if name.startswith("cpic_planner") and vars(other).get("__version__") == before:
            other.__version__ = version
    note(proof, {"version": version})


def lose_home(proof):
    """Let the user have no entry among the users: with HOME unset, there is no home."""
    import pwd

    asked = 0

    def unknown(uid):
        nonlocal asked
        asked += 1
        note(proof, {"asked": asked})
        raise KeyError(f"getpwuid(): uid not found: {uid}")

    pwd.getpwuid = unknown


def lose(root, name, proof):
    """Let a file below a folder be unreadable: EIO whenever it is opened."""
    place = f"{os.path.realpath(root)}/{name}"

    def heard(event, args):
        if event == "open" and isinstance(args[0], str) and os.path.abspath(args[0]) == place:
            note(proof, {"read": name})
            raise OSError(errno.EIO, os.strerror(errno.EIO), name)

    sys.addaudithook(heard)
