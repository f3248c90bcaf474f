"""Record the files of the project that a process and its children read and write.

Python imports a module of this name when it starts. `tools.reports` puts this folder on ``PYTHONPATH`` and names in
``CPIC_RECORDED_FILES`` the file that gets a line for each: ``r`` or ``w``, a space, the path within the project.
"""

import os
import re
import sys
from pathlib import Path

ROOT = f"{Path(__file__).resolve().parents[2]}{os.sep}"
COMPILED = re.compile(r"__pycache__/(\w+)\.[\w.-]+\.pyc$")
RECORD = os.open(os.environ["CPIC_RECORDED_FILES"], os.O_WRONLY | os.O_APPEND | os.O_CREAT)
KNOWN: set[str] = set()


def is_fingerprint() -> bool:
    """Return whether the fingerprint of a run opens the file, which opens all that are installed."""
    frame = sys._getframe(2)
    for _ in range(6):
        if frame.f_code.co_filename.endswith("cpic_core/provenance.py"):
            return True
        if frame.f_back is None:
            break
        frame = frame.f_back
    return False


def record(event: str, arguments: tuple[object, ...]) -> None:
    """Write a line for a file that is opened or renamed, once a process.

    Parameters
    ----------
    event : str
        Name of an audit event of the interpreter.
    arguments : tuple
        Those of the event: path, mode and flags of ``open``, both paths of ``os.rename``.
    """
    if event not in ("open", "os.rename"):
        return
    path = arguments[event == "os.rename"]
    if not isinstance(path, (str, os.PathLike)):
        return
    written = event == "os.rename" or bool(int(str(arguments[2] or 0)) & (os.O_WRONLY | os.O_RDWR))
    name = os.path.abspath(os.fspath(path))
    if not isinstance(name, str) or not name.startswith(ROOT):
        return
    name = name.removeprefix(ROOT)
    if not written:
        name = COMPILED.sub(r"\1.py", name)
    line = f"{'rw'[written]} {name}\n"
    if line in KNOWN or "__pycache__" in line or is_fingerprint():
        return
    KNOWN.add(line)
    os.write(RECORD, line.encode())


sys.addaudithook(record)
