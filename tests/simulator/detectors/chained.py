"""Let a program beside this file add an effect to the chain, before anything reads the chain."""

import json
import subprocess
import sys
from pathlib import Path


def told_by(name, *numbers):
    command = [sys.executable, str(Path(__file__).with_name(name)), *map(str, numbers)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    return json.loads(done.stdout)
