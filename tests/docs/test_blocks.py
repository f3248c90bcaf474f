"""Blocks of code in the README and the pages can be run as they stand; ``make pages`` runs those that take long."""

import contextlib
import itertools
import re
import shlex

import pytest
import yaml

from cpic_planner.cli import main as command_line
from cpic_planner.planets import load_population
from cpic_planner.queries import Question
from cpic_planner.survey.strategy import load_strategies
from cpic_planner.web import application
from simulator import load_instrument, load_scene
from tests.cpic_planner.web.conftest import Browser
from tests.docs.blocks import PAGES, ROOT, blocks_of, python_of
from tests.yield_packages import write

BLOCKS = [block for path in PAGES for block in blocks_of(path)]
FOREIGN = ("pip ", "make ", "openssl ", "export ", "for who ", "T=", "dask ")
LOADERS = {
    "instrument": load_instrument,
    "scene": load_scene,
    "strategies": load_strategies,
    "population": load_population,
}
# What pages name and do not show.
FILES = {
    "my_stars.csv": "name,distance_pc,v_mag,sp_type\nBob,7.0,4.5,G8V\n",
    "favourites.txt": "tau Cet\neps Eri\n",
    "my_spectrum.txt": "# wavelength (nm), geometric albedo\n400 0.45\n700 0.4\n1000 0.2\n",
    "visits.csv": "star,start_utc,band,exposure_s,n_frames,em_gain,telescope_h,planets\n"
    "eps Eri,2028-01-20,F520,10,200,100,4,0\n",
    "my_planets.csv": "star,planet,period_days,semi_major_axis_au,msini_mjup\nHD 10700,x,600,1.3,0.5\n",
    "reality.yaml": "throughput: x0.7\n",
}


def named(block):
    return f"{block.page.removeprefix('docs/')}:{block.line}"


def each(wanted):
    return pytest.mark.parametrize("block", [pytest.param(block, id=named(block)) for block in BLOCKS if wanted(block)])


class _Asked(Exception):
    """A command line was understood as a question."""


@contextlib.contextmanager
def _only_asked(monkeypatch):
    """Let commands read their question and stop there."""
    of = Question.of.__func__

    def stop(cls, tree):
        raise _Asked(of(cls, tree))

    with monkeypatch.context() as patched:
        patched.setattr(Question, "of", classmethod(stop))
        yield


def write_files(folder, page):
    """Write the files that a page shows, and those that it only names."""
    for name, text in FILES.items():
        (folder / name).write_text(text, encoding="utf-8")
    write(folder / "my_package")
    for block in BLOCKS:
        if block.page == page and block.file_name:
            head = block.text.partition("\n")[2] if block.file_name.endswith((".csv", ".txt")) else block.text
            # The reader's own mask: any that makes a dark hole.
            head = re.sub(r"my_mask\.fits, apodizer_kind: \w+, apodizer_samples: \d+", "lpx43", head)
            (folder / block.file_name).write_text(head, encoding="utf-8")


def arguments(line):
    """Return the words behind ``cpic`` of a line; None for a line of another program."""
    words = shlex.split(re.split(r" [|>] ", line)[0])
    return words[1:] if words[0].rpartition("/")[2] == "cpic" else None


@each(lambda block: block.commands)
def test_commands_are_understood(block, tmp_path, monkeypatch):
    """Each command names options that exist, with values that they take, and files that the page shows."""
    write_files(tmp_path, block.page)
    (tmp_path / "cpic-whatif").mkdir()
    (tmp_path / "mine").mkdir()
    for folder in ("cpic-whatif", "mine"):
        (tmp_path / folder / "visits.csv").write_text(FILES["visits.csv"])
    monkeypatch.chdir(tmp_path)
    for line in block.commands:
        given = arguments(line)
        if given is None:
            assert line.startswith(FOREIGN), line
            continue
        assert_understood(line, given, monkeypatch)


def assert_understood(line, given, monkeypatch):
    """Assert that a command line is a question, without answering it."""
    with _only_asked(monkeypatch):
        command, words = command_line.app.built, given
        while hasattr(command, "commands"):
            command, words = command.commands[words[0]], words[1:]
        if given[0] not in command_line.QUESTIONS:
            command.make_context(line, list(words))  # reads the options, runs nothing
            return
        with pytest.raises(_Asked):
            command.main(list(words), standalone_mode=False)


@pytest.mark.parametrize("name", ["etc", "rank", "visibility", "known"])
def test_examples_of_the_help_are_understood(name, tmp_path, monkeypatch):
    """Those of all commands that answer in seconds; long proofs run them."""
    write_files(tmp_path, "README.md")
    (tmp_path / "my_limits.yaml").write_text("moon_deg: 40\n")
    monkeypatch.chdir(tmp_path)
    said = command_line.app.built.commands[name].help
    examples = re.findall(r"^ *(cpic .*)$", said, re.MULTILINE)
    assert len(examples) >= 5
    for line in examples:
        assert_understood(line, arguments(line), monkeypatch)


@each(lambda block: block.language == "python")
def test_python_is_valid(block):
    python_of(block)


@each(lambda block: block.language == "yaml")
def test_settings_are_read(block, tmp_path, monkeypatch):
    """A file of a page is what its kind says."""
    write_files(tmp_path, block.page)
    monkeypatch.chdir(tmp_path)
    tree = yaml.safe_load(block.text)
    kind = tree.get("kind", "scene" if "cstar" in tree else "")
    LOADERS[kind](block.file_name)


def test_targets_of_make_exist():
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))
    for block in BLOCKS:
        assert set(re.findall(r"^make ([a-z-]+)", block.text, re.MULTILINE)) <= targets, named(block)


# Proofs run what pages show with fewer draws, as the notebooks; these values stand in the place of those of the page.
FEWER = {
    "plan": ["--top", "1", "--realisations", "1", "--fidelity", "quick", "--force"],
    "confirm": ["--realisations", "1", "--fidelity", "quick"],
    "whatif": ["--universes", "20", "--images", "0", "--no-facts", "--workers", "1", "--force"],
    "simulate": ["--frames", "1", "--force"],
    "rank": ["--planets", "200"],
}
LEFT_OUT = ("catalog refresh", "serve", "tradeoff", "--scheduler", "paper_exposure_gain")


def fewer(given):
    """Return the words of a command with fewer draws."""
    own = [] if "--from-products" in given else list(FEWER.get(given[0], []))
    if "--tolerance" in given and "--fidelity" in own:
        del own[own.index("--fidelity") : own.index("--fidelity") + 2]
    own += ["--instruments", "4"] if "--instruments" in given else []
    kept = list(given)
    for option, value in itertools.pairwise([*own, ""]):
        while option.startswith("--") and option in kept:
            at = kept.index(option)
            del kept[at : at + 1 + (not value.startswith("--") and bool(value))]
    return [*kept, *own, "-q"]


@pytest.mark.pages
@pytest.mark.parametrize("page", sorted({block.page for block in BLOCKS if block.commands}))
def test_commands_of_a_page_run(page, tmp_path, monkeypatch, capsys):
    write_files(tmp_path, page)
    monkeypatch.chdir(tmp_path)
    for block in BLOCKS:
        for line in block.commands if block.page == page else ():
            given = arguments(line)
            if given is None or any(words in line for words in LEFT_OUT):
                continue
            status = command_line.main(fewer(given))
            told = capsys.readouterr().err
            assert status == 0 or (status == 1 and given[0] == "check"), f"{line}: {told}"


@pytest.mark.pages
@pytest.mark.parametrize("page", sorted({block.page for block in BLOCKS if block.language == "python"}))
def test_python_of_a_page_runs(page, tmp_path, monkeypatch):
    write_files(tmp_path, page)
    monkeypatch.chdir(tmp_path)
    values = {}
    for block in BLOCKS:
        if block.page == page and block.language == "python":
            exec(python_of(block), values)


@pytest.mark.pages
def test_addresses_are_answered():
    """Addresses of the pages are those of the server, and each is a question that can be asked."""
    browser = Browser(application())
    found = [line.split()[0] for block in BLOCKS for line in block.text.splitlines() if re.match(r"/\w+\?", line)]
    assert len(found) >= 5
    for address in found:
        told = browser.get(address)
        assert told.status == 200, f"{address}: {re.sub('<[^>]*>', ' ', told.text)[-500:]}"
