"""Other programs, each in an environment of its own that is made once."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def program(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Path]:
    """Return the interpreter of an environment that holds some pinned packages; skip where they cannot be had.

    The folder that ``CPIC_PROGRAMS_CACHE`` names keeps environments from one run to the next.
    """
    named = os.environ.get("CPIC_PROGRAMS_CACHE")
    root = Path(named) if named else tmp_path_factory.mktemp("programs")

    def interpreter(*requirements: str) -> Path:
        folder = root / hashlib.sha256(" ".join(requirements).encode()).hexdigest()[:12]
        python, whole = folder / "bin" / "python", folder / "whole"
        if not whole.exists():
            install = [python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", *requirements]
            for command in ([sys.executable, "-m", "venv", "--clear", folder], install):
                done = subprocess.run(command, capture_output=True, text=True, check=False)
                if done.returncode:
                    pytest.skip(f"cannot install {', '.join(requirements)}: {done.stderr.strip()[-300:]}")
            whole.touch()
        return python

    return interpreter
