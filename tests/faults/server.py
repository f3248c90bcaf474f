"""A process that has imported the command line, and forks a process of its own for each command: ``python server.py``.

A request is a line of JSON on stdin, the answer one on stdout. So a command costs what it works, not what it imports,
and each begins as fresh as the first. Nothing here runs threads: what a fork copies is whole.
"""

import contextlib
import gc
import importlib
import json
import os
import random
import resource
import sys
import tempfile
import time

import points
import tiny

_TICK_S = 1 / os.sysconf("SC_CLK_TCK")


def run(request):
    """Run one command in this process; returns its exit status."""
    os.chdir(request["cwd"])
    if request.get("most_files"):
        resource.setrlimit(resource.RLIMIT_NOFILE, (request["most_files"],) * 2)
    for key, value in request.get("environment", {}).items():
        os.environ.pop(key, None)
        if value is not None:
            os.environ[key] = value
    for number, name, mode in ((0, "stdin", "r"), (1, "stdout", "w"), (2, "stderr", "w")):
        place = request["streams"][number]
        if place is None:
            os.close(number)
            stream = None
        else:
            flags = os.O_RDONLY if number == 0 else os.O_WRONLY | os.O_CREAT | os.O_TRUNC
            handle = os.open(place, flags, 0o666)
            os.dup2(handle, number)
            os.close(handle)
            stream = open(number, mode, encoding="utf-8", closefd=False)  # noqa: SIM115 - to the end
        setattr(sys, name, stream)
        setattr(sys, f"__{name}__", stream)
    proof, fault = request["proof"], request.get("fault") or {}
    kind, at = fault.get("kind", ""), fault.get("at", -1)
    if kind == "clock":
        points.jump(fault["shift_s"], at, proof)
    elif kind == "version":
        points.become(fault["version"], proof)
    elif kind == "homeless":
        points.lose_home(proof)
    elif kind == "unreadable":
        points.lose(request["root"], fault["name"], proof)
    steps = None
    if request.get("root") and kind != "unreadable":
        steps = points.Steps(request["root"], kind, at, proof)
        steps.install()
    module = importlib.import_module("cpic_planner.cli.main")  # the package offers the function of this name
    if request["argv"][0] == "tiny":
        module.app = tiny.app
        importlib.import_module("cpic_planner.jobs.job").versions = dict  # which take half of the time
    status = module.main(request["argv"])
    if steps is not None and steps.at < 0:
        points.note(proof, steps.names)
    if request.get("learn"):
        points.note(request["learn"], sorted(sys.modules))
    if request["argv"][0] == "tiny":
        os._exit(status)  # which saves the end of the interpreter
    return status


def watched(child, request):
    """Wait for a process; kill it once it has worked as long as asked, or once so much time has passed.

    Returns
    -------
    dict
        Status, signal, time worked and passed (s), and how many processes it had of its own when it was killed.
    """
    after_s, passed_s, began = request.get("kill_after_s"), request.get("kill_after_wall_s"), time.monotonic()
    workers = 0
    while after_s is not None or passed_s is not None:
        done, code, used = os.wait4(child, os.WNOHANG)
        if done:
            break
        with contextlib.suppress(OSError), open(f"/proc/{child}/stat") as file:
            fields = file.read().rpartition(")")[2].split()
            worked_s = (int(fields[11]) + int(fields[12])) * _TICK_S
            if time.monotonic() - began >= passed_s if after_s is None else worked_s >= after_s:
                time.sleep(random.random() * _TICK_S)  # within the tick
                with open(f"/proc/{child}/task/{child}/children") as file:
                    workers = len(file.read().split())
                os.kill(child, 9)
                after_s = passed_s = None
        time.sleep(0.001)
    else:
        _, code, used = os.wait4(child, 0)
    status, signal = (os.WEXITSTATUS(code), 0) if os.WIFEXITED(code) else (-1, os.WTERMSIG(code))
    spent = {"cpu_s": used.ru_utime + used.ru_stime, "wall_s": time.monotonic() - began}
    return {"status": status, "signal": signal, "memory_mb": used.ru_maxrss / 1000, "workers": workers} | spent


def main():
    requests = os.fdopen(os.dup(0), encoding="utf-8")
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    importlib.import_module("cpic_planner.cli.main")
    with tempfile.TemporaryDirectory() as folder:
        tiny.app(["--out", folder])  # what a process works out once, forks find

    for line in requests:
        request = json.loads(line)
        assert len(os.listdir("/proc/self/task")) == 1, "a fork would copy half of the threads"
        gc.freeze()
        child = os.fork()
        if child == 0:
            sys.exit(run(request))  # through the end of the interpreter, as any command
        answer = watched(child, request)
        if request.get("learn"):
            with open(request["learn"]) as file:
                for name in json.load(file):
                    with contextlib.suppress(ImportError):
                        importlib.import_module(name)
        answers.write(f"{json.dumps(answer)}\n")
        answers.flush()


if __name__ == "__main__":
    main()
