"""What commands tell while they work: nothing within two seconds, then a bar on a terminal or lines elsewhere."""

import contextlib
import io
import itertools
import json
import logging
import re
import time

import pytest

from cpic_core import LOGGER, announce
from cpic_planner.cli import command, progress
from cpic_planner.cli.main import main
from cpic_planner.cli.progress import Reporter, watch


class Clock:
    """Seconds that pass when told."""

    now = 1000.0

    def __call__(self):
        return self.now


@pytest.fixture(autouse=True)
def _as_a_user_has_it(monkeypatch):
    monkeypatch.setattr(progress, "SHOW_AFTER_S", 2.0)


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture
def lines():
    return []


@pytest.fixture
def reporter(lines, clock):
    made = Reporter("rank", lines.append, clock)
    logger = logging.getLogger(LOGGER)
    logger.addHandler(made)
    logger.setLevel(logging.INFO)
    yield made
    logger.removeHandler(made)
    logger.setLevel(logging.NOTSET)


def run(reporter, clock, seconds, step=0.25):
    """Let time pass, with the ticks of the thread."""
    for _ in range(round(seconds / step)):
        clock.now += step
        reporter.tick()


def test_two_seconds_are_not_mentioned(reporter, clock, lines):
    run(reporter, clock, 1.75)
    with reporter.working("confirming", 3) as advance:
        run(reporter, clock, 1.75)
        advance("tau Cet F520", 3)
    run(reporter, clock, 1.75)
    assert lines == []


def test_a_call_that_tells_nothing_is_seen_to_live(reporter, clock, lines):
    run(reporter, clock, 200)
    assert lines == [
        f"cpic: rank ({text} so far)" for text in ("2 s", "12 s", "22 s", "32 s", "42 s", "52 s", "112 s", "3 min")
    ]


def test_pieces_are_counted_and_the_rest_is_estimated(reporter, clock, lines):
    with reporter.working("confirming", 40) as advance:
        for i in range(40):
            run(reporter, clock, 10)
            advance(f"star {i}")
    assert lines[0] == "cpic: confirming (0 of 40 done, 2 s so far)"
    assert lines[1] == "cpic: confirming: star 0 (1 of 40 done, 12 s so far, about 8 min left)"
    late = [int(re.search(r"\((\d+) of 40 done", line).group(1)) for line in lines[7:-1]]
    assert all(4 <= after - before <= 6 for before, after in itertools.pairwise(late[:-1]))  # tenths
    assert lines[-1] == "cpic: confirming: done in 7 min"
    assert len(lines) < 20


def test_announcements_say_what_is_done(reporter, clock, lines):
    announce("digging the dark hole of F520")
    run(reporter, clock, 3)
    announce("measuring the optics of F520")
    run(reporter, clock, 10)
    assert lines == [
        "cpic: rank: digging the dark hole of F520 (2 s so far)",
        "cpic: rank: measuring the optics of F520 (12 s so far)",
    ]


def test_other_work_is_told_after_the_first_minute_too(reporter, clock, lines):
    run(reporter, clock, 65)
    announce("writing the report")
    run(reporter, clock, 10)
    assert lines[-1].startswith("cpic: rank: writing the report (")


def test_after_results_it_begins_anew(reporter, clock, lines):
    run(reporter, clock, 5)
    reporter.rest()
    run(reporter, clock, 1.75)
    assert len(lines) == 1


def test_a_failure_is_not_called_done(reporter, clock, lines):
    with contextlib.suppress(RuntimeError), reporter.working("confirming", 3):
        run(reporter, clock, 5)
        raise RuntimeError
    assert lines == ["cpic: confirming (0 of 3 done, 2 s so far)"]
    assert reporter._stack[-1].title == "rank"


def test_scripts_hear_nothing_unless_they_ask(caplog, capsys):
    announce("digging")
    assert capsys.readouterr() == ("", "")
    with caplog.at_level(logging.INFO):
        announce("digging")
    assert [record.getMessage() for record in caplog.records] == ["digging"]


@pytest.fixture
def hasty(monkeypatch):
    """Lines come at once, and often."""
    monkeypatch.setattr(progress, "LINE_EVERY_S", 0.05)
    monkeypatch.setattr(progress, "SHOW_AFTER_S", 0.02)
    monkeypatch.setattr(progress, "_TICK_S", 0.01)


def slow_rank(monkeypatch):
    """A ranking that takes long enough to be mentioned."""
    from cpic_planner.ranking import order

    real = order.ranked

    def wait(*args, **kwargs):
        time.sleep(0.2)
        return real(*args, **kwargs)

    monkeypatch.setattr(order, "ranked", wait)


@pytest.mark.parametrize("quiet", [False, True])
def test_every_command_is_watched_and_stdout_stays_clean(capsys, monkeypatch, hasty, quiet):
    slow_rank(monkeypatch)
    options = ["rank", "--json", "--band", "F520", "--planets", "10", "--v-mag-max", "3"]
    assert main(["-q", *options] if quiet else options) == 0
    out, err = capsys.readouterr()
    assert json.loads(out)["kind"] == "rank"
    assert bool(re.search(r"^cpic: rank: ranking \d+ stars \(\d+ s so far\)$", err, re.M)) is not quiet
    assert "\x1b" not in err
    assert not logging.getLogger(LOGGER).handlers


def test_verbose_lines_come_at_once_and_not_twice(capsys, monkeypatch):
    assert main(["-v", "rank", "--band", "F520", "--planets", "10", "--v-mag-max", "2"]) == 0
    err = capsys.readouterr().err
    assert len(re.findall(r"ranking \d+ stars", err)) <= 1


def test_progress_of_its_own_outside_a_command(capsys, hasty):
    with command.progress("frames", total=2) as advance:
        advance("one")
        time.sleep(0.1)
        advance("two")
    assert "cpic: frames" in capsys.readouterr().err


def test_a_bar_on_a_terminal_leaves_nothing_behind(monkeypatch, clock):
    class Terminal(io.StringIO):
        def isatty(self):
            return True

    screen = Terminal()
    monkeypatch.setattr("sys.stderr", screen)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "100")
    reporter = Reporter("etc", None, clock)
    run(reporter, clock, 1.75)
    assert screen.getvalue() == ""
    with reporter.working("confirming [x]", 4) as advance:
        run(reporter, clock, 5)
        advance("tau Cet", 3)
    shown = screen.getvalue()
    assert "confirming [x]: tau Cet" in shown
    assert "3/4" in shown
    assert shown.endswith("\x1b[2K")
    with watch("etc") as own:
        assert own._write is None
