"""Kill each long command many times, at named steps and at random times, and start it again; fill its disk too.

``python tests/faults/kills.py --count 50`` (``make kills``). Each case is a run in a folder of its own, with files of
somebody else in and beside it, that is broken and then started again. It must end well, with the bytes of a run that
was left alone, and with nothing of somebody else's changed. Half of the kills come at steps of writing, evenly spread;
half after a random part of the processor time that the whole run takes. A case that ended before it was broken is drawn
again. Ends with status 1 where a case failed.

With ``--workers 2`` all kills come after a random part of the time that the whole run takes, and those alone count that
found workers alive: the run is killed, they see to their end themselves, and what they still write is nobody's.
"""

import argparse
import random
import sys
import tempfile
from collections import Counter
from pathlib import Path

import harness

COMMANDS = ("simulate", "whatif", "confirm", "plan")


def whole_run(server, question, folder, workers=1):
    """A run that is left alone: hashes of what it wrote, its steps, and the time that it works (s), imports apart.

    With workers, the time that it takes; what it writes is what it writes without.
    """
    for name in ("first", "whole"):
        place = harness.Place(folder / name, question)
        done = server.run(place.argv, place.folder, root=str(place.out))
        place.check_finished(done, place.results())
    whole, steps = place.results(), done.proof
    if workers == 1:
        return whole, steps, done.cpu_s
    for name in ("first workers", "workers"):
        place = harness.Place(folder / name, question, workers=workers)
        done = server.run(place.argv, place.folder)
        place.check_finished(done, whole)
    return whole, steps, done.wall_s


def cases(question, steps, whole_s, named, timed, full, seed, workers=1):
    """Faults of one command: kills at steps, then at random times, then full disks."""
    draw = random.Random(f"{seed} {question}")
    for number in range(named):
        yield {"kind": "kill", "at": (2 * number + 1) * len(steps) // (2 * named)}
    for _ in range(timed):
        yield {"kind": "time", "after_s": draw.uniform(0.02, 0.98) * whole_s, "draw": draw, "workers": workers}
    grows = [at for at, step in enumerate(steps) if step.split()[0] in ("open", "write", "mkdir")]
    for number in range(full):
        yield {"kind": "full", "at": grows[(2 * number + 1) * len(grows) // (2 * full)]}


def check_killed(server, question, folder, fault, whole):
    """Kill after a time; returns whether there was still something to kill, of workers too where it has them."""
    workers = fault.get("workers", 1)
    place = harness.Place(folder, question, workers=workers)
    after = "kill_after_s" if workers == 1 else "kill_after_wall_s"
    done = server.run(place.argv, place.folder, **{after: fault["after_s"]})
    place.check_untouched()
    if done.signal == 9:
        place.check_no_half(whole)
    place.check_finished(server.run(place.argv, place.folder), whole)
    place.remove()
    return done.signal == 9 and (workers == 1 or done.workers > 0)


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=50, help="kills of each command")
    parser.add_argument("--full", type=int, default=5, help="full disks of each command")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--commands", nargs="+", default=COMMANDS, choices=COMMANDS)
    options = parser.parse_args(argv)
    failed = 0
    with tempfile.TemporaryDirectory() as scratch:
        for question in options.commands:
            folder, counts = Path(scratch) / question, Counter()
            folder.mkdir()
            server = harness.Server(folder / "server", learns=options.workers == 1)
            whole, steps, whole_s = whole_run(server, question, folder, options.workers)
            print(f"{question}: {len(steps)} steps, {len(whole)} files, {whole_s:.1f} s", flush=True)
            named, full = ((options.count + 1) // 2, options.full) if options.workers == 1 else (0, 0)
            timed = options.count - named
            every = cases(question, steps, whole_s, named, timed, full, options.seed, options.workers)
            for number, fault in enumerate(every):
                try:
                    if fault["kind"] == "time":
                        while not check_killed(server, question, folder / str(number), fault, whole):
                            fault["after_s"] = fault["draw"].uniform(0.02, 0.8) * whole_s
                    else:
                        harness.check_broken(server, question, folder / str(number), fault, whole, steps)
                    counts[fault["kind"]] += 1
                except AssertionError as error:
                    failed += 1
                    at = steps[fault["at"]] if "at" in fault else f"{fault['after_s']:.2f} s"
                    print(f"{question}: {fault['kind']} at {at}: {error}"[:2000], flush=True)
            server.close()
            print(
                f"{question}: {counts['kill']} of {named} kills at steps, {counts['time']} of {timed} "
                f"at random times, {counts['full']} of {full} full disks, {options.workers} worker(s): same bytes",
                flush=True,
            )
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
