"""Kill each long command many times, at named steps and at random times, and start it again; fill its disk too.

``python tests/faults/kills.py --count 50`` (``make kills``). Each case is a run in a folder of its own, with files of
somebody else in and beside it, that is broken and then started again. It must end well, with the bytes of a run that
was left alone, and with nothing of somebody else's changed. Half of the kills come at steps of writing, evenly spread;
half after a random part of the processor time that the whole run takes. A case that ended before it was broken is drawn
again. Ends with status 1 where a case failed.
"""

import argparse
import random
import sys
import tempfile
from collections import Counter
from pathlib import Path

import harness

COMMANDS = ("simulate", "whatif", "confirm", "plan")


def whole_run(server, question, folder):
    """A run that is left alone: hashes of what it wrote, its steps, and its processor time (s) with all imported."""
    for name in ("first", "whole"):
        place = harness.Place(folder / name, question)
        done = server.run(place.argv, place.folder, root=str(place.out))
        place.check_finished(done, place.results())
    return place.results(), done.proof, done.cpu_s


def cases(question, steps, cpu_s, count, full, seed):
    """Faults of one command: kills at steps, then at random times, then full disks."""
    draw = random.Random(f"{seed} {question}")
    named = (count + 1) // 2
    for number in range(named):
        yield {"kind": "kill", "at": (2 * number + 1) * len(steps) // (2 * named)}
    for _ in range(count - named):
        yield {"kind": "time", "after_s": draw.uniform(0.02, 0.98) * cpu_s, "draw": draw}
    grows = [at for at, step in enumerate(steps) if step.split()[0] in ("open", "write", "mkdir")]
    for number in range(full):
        yield {"kind": "full", "at": grows[(2 * number + 1) * len(grows) // (2 * full)]}


def check_killed(server, question, folder, fault, whole):
    """Kill after a time; returns whether there was still something to kill."""
    place = harness.Place(folder, question)
    done = server.run(place.argv, place.folder, kill_after_s=fault["after_s"])
    place.check_untouched()
    if done.signal == 9:
        place.check_no_half(whole)
    place.check_finished(server.run(place.argv, place.folder), whole)
    place.remove()
    return done.signal == 9


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=50, help="kills of each command")
    parser.add_argument("--full", type=int, default=5, help="full disks of each command")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--commands", nargs="+", default=COMMANDS, choices=COMMANDS)
    options = parser.parse_args(argv)
    failed = 0
    with tempfile.TemporaryDirectory() as scratch:
        for question in options.commands:
            folder, counts = Path(scratch) / question, Counter()
            folder.mkdir()
            server = harness.Server(folder / "server")
            whole, steps, cpu_s = whole_run(server, question, folder)
            print(f"{question}: {len(steps)} steps, {len(whole)} files, {cpu_s:.1f} s of processor", flush=True)
            every = cases(question, steps, cpu_s, options.count, options.full, options.seed)
            for number, fault in enumerate(every):
                try:
                    if fault["kind"] == "time":
                        while not check_killed(server, question, folder / str(number), fault, whole):
                            fault["after_s"] = fault["draw"].uniform(0.02, 0.8) * cpu_s
                    else:
                        harness.check_broken(server, question, folder / str(number), fault, whole, steps)
                    counts[fault["kind"]] += 1
                except AssertionError as error:
                    failed += 1
                    at = steps[fault["at"]] if "at" in fault else f"{fault['after_s']:.2f} s"
                    print(f"{question}: {fault['kind']} at {at}: {error}"[:2000], flush=True)
            server.close()
            print(
                f"{question}: {counts['kill']} of {(options.count + 1) // 2} kills at steps, {counts['time']} of "
                f"{options.count // 2} at random times, {counts['full']} of {options.full} full disks: same bytes",
                flush=True,
            )
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
