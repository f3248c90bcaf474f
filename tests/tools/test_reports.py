"""A report says which code made it: what its processes read is recorded, and what has changed since is named."""

import json
import shutil

import pytest

from tools import reports

SCRIPT = """
import subprocess, sys
from pathlib import Path
from cpic_core import first, provenance
here = Path(__file__).parent
(here / "scratch.csv").write_text("1")
number = (here / "settings.yaml").read_text() + (here / "scratch.csv").read_text()
provenance.every(here.parents[1] / "cpic_core")
subprocess.run([sys.executable, "-c", "import cpic_core.second"], check=True)
(here / "report.md").write_text(f"# Report\\n\\n{number}\\n")
"""
FILES = {
    "cpic_core/__init__.py": "",
    "cpic_core/first.py": '"""Words."""\nNUMBER = 1\n',
    "cpic_core/second.py": "NUMBER = 2\n",
    "cpic_core/unused.py": "NUMBER = 3\n",
    "cpic_core/provenance.py": "def every(folder):\n    return [path.read_bytes() for path in folder.glob('*.py')]",
    "reports/one/make.py": SCRIPT,
    "reports/one/settings.yaml": "a: 1\n",
    "reports/one/report.md": "# Report\n",
    "docs/page.md": "[report](../reports/one.md) and ![it](../reports/one/report.md)\n",
    "README.template.md": "",
    "ARCHITECTURE.md": "",
    "CONTRIBUTING.md": "",
}
READ = {"cpic_core/__init__.py", "cpic_core/first.py", "cpic_core/provenance.py", "cpic_core/second.py"}
READ |= {"reports/one/make.py", "reports/one/settings.yaml"}


@pytest.fixture
def project(tmp_path, monkeypatch):
    """A project of one report."""
    shutil.copytree(reports.ROOT / "tools/recorder", tmp_path / "tools/recorder")
    for name, text in FILES.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    monkeypatch.setattr(reports, "ROOT", tmp_path)
    monkeypatch.setattr(reports, "REPORTS", tmp_path / "reports")
    monkeypatch.delenv("PYTHONPATH", raising=False)
    reports._digest.cache_clear()
    yield tmp_path
    reports._digest.cache_clear()


@pytest.fixture
def made(project):
    """The project with its report made."""
    assert reports.main(["one"]) == 0
    return project


def test_what_all_processes_read_is_recorded_and_what_they_wrote_is_not(made):
    """The fingerprint of a run opens every file of the packages: it does not count."""
    record = reports.read("one")
    assert set(record.files) == READ
    assert record.seconds > 0
    assert reports.changed("one") == []
    assert (made / "reports/one/report.md").read_text() == "# Report\n\na: 1\n1\n"


@pytest.mark.parametrize(
    ("file", "text", "named"),
    [
        ("cpic_core/first.py", '"""Other words."""\n\nNUMBER = 1  # as before\n"""A number."""\n', []),
        ("cpic_core/first.py", '"""Words."""\nNUMBER = 4\n', ["cpic_core/first.py"]),
        ("cpic_core/second.py", None, ["cpic_core/second.py"]),
        ("cpic_core/unused.py", "NUMBER = 4\n", []),
        ("reports/one/settings.yaml", "a: 2\n", ["reports/one/settings.yaml"]),
        ("reports/one/make.py", SCRIPT + "1 / 1\n", ["reports/one/make.py"]),
        ("reports/one/report.md", "# By hand\n", ["reports/one/report.md"]),
    ],
)
def test_what_has_changed_since_is_named(made, capsys, file, text, named):
    (made / file).unlink() if text is None else (made / file).write_text(text)
    capsys.readouterr()
    assert reports.changed("one") == named
    assert reports.main(["--check"]) == 0  # figures need not be made anew at each change
    told = capsys.readouterr().out.splitlines()
    assert told[:1] == [f"reports/one is older than {file}" for file in named]


@pytest.mark.parametrize(
    ("one", "other", "same"),
    [
        ("x = 1", "x = 1  # one", True),
        ("def f():\n    return 1", 'def f():\n    """Return 1."""\n    return 1', True),
        ("class A:\n    x = 1", "class A:\n    x = 1\n    'about x'", True),
        ("f(a, b)", "f(\n    a,\n    b,\n)", True),
        ("x = 1", "x = 1.0", False),
        ("x = 'a'", "x = 'b'", False),
        ("x = None", "x = 0", False),
        ("f(a, b)", "f(b, a)", False),
        ("x = a + b", "x = a - b", False),
        ("def f(a=1): ...", "def f(a=2): ...", False),
        ("@cache\ndef f(): ...", "def f(): ...", False),
        ("raise E from None", "raise E", False),
    ],
)
def test_the_digest_of_a_module_is_that_of_its_code(tmp_path, one, other, same):
    paths = tmp_path / "one.py", tmp_path / "other.py"
    for path, text in zip(paths, (one, other), strict=True):
        path.write_text(text)
    assert (reports.digest(paths[0]) == reports.digest(paths[1])) is same


def test_a_report_that_fails_stops_no_other_and_is_named(made, capsys):
    """It keeps the record of the last time that it was made."""
    shutil.copytree(made / "reports/one", made / "reports/two")
    (made / "reports/two/make.py").write_text("raise SystemExit('no such star')")
    before = (made / "reports/two/made.json").read_text()
    assert reports.main([]) == 1
    told = capsys.readouterr()
    assert "no such star" in told.err
    assert "failed: two" in told.err
    assert "one " in told.out
    assert (made / "reports/two/made.json").read_text() == before


@pytest.mark.parametrize(
    ("script", "says", "recorded"),
    [
        (SCRIPT + "raise SystemExit(1)  # a figure is not what was asked", "exit status 1", True),
        ("print('nothing to do')", "wrote no report.md", False),
    ],
)
def test_a_report_is_recorded_where_it_was_written(project, capsys, script, says, recorded):
    (project / "reports/one/make.py").write_text(script)
    assert reports.main(["one"]) == 1
    assert says in capsys.readouterr().err
    assert (project / "reports/one" / reports.MADE).exists() is recorded


def test_older_ones_alone_are_made(made, capsys):
    shutil.copytree(made / "reports/one", made / "reports/two")
    assert reports.main(["--older"]) == 0
    out = capsys.readouterr().out
    assert "0 reports" in out
    (made / "cpic_core/first.py").write_text("NUMBER = 7\n")
    reports._digest.cache_clear()
    (made / "reports/two" / reports.MADE).unlink()
    assert reports.main(["one", "--older"]) == 0
    assert "1 reports" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("file", "text", "says"),
    [
        ("reports/one/made.json", "{", "reports/one/made.json"),
        ("reports/one/made.json", None, "python -m tools.reports one makes it"),
        ("docs/page.md", "[r](../reports/two.md)", "docs/page.md quotes reports/two.md, which is missing"),
        ("README.template.md", "![r](reports/one/a.png)", "README.template.md quotes reports/one/a.png, which is"),
        ("reports/one/report.md", "![r](b.png)", "reports/one/report.md quotes b.png, which is missing"),
    ],
)
def test_what_cannot_be_followed_fails(made, capsys, file, text, says):
    (made / file).unlink() if text is None else (made / file).write_text(text)
    assert reports.main(["--check"]) == 1
    assert says in capsys.readouterr().err


def test_every_committed_report_has_its_record_and_what_pages_quote():
    assert len(reports.names()) >= 15
    for name in reports.names():
        assert reports.read(name).files
        assert json.loads((reports.folders()[name] / reports.MADE).read_text(encoding="utf-8"))["report"]
    assert reports.missing_quotes() == []
