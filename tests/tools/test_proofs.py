"""Evidence of the long proofs: of which code it is, when it is old, and what is kept of it."""

import json
import subprocess
import sys

import pytest

from tools import proofs

PROOF = """\
import pytest

from simulator.law import law


@pytest.mark.long
def test_law(record_property):
    record_property("law of 2", law(2))
    assert law(2) == 4


@pytest.mark.long
@pytest.mark.parametrize("x", [1, 3])
def test_squares(x):
    assert law(x) == x * x


def test_short():
    raise AssertionError
"""
LAW = '''\
"""The law."""


def law(x):
    """Square."""
    return x * x
'''


@pytest.fixture
def project(tmp_path):
    """A small project with one long proof, one short test and a module of each kind."""
    files = {
        "pyproject.toml": "[tool.pytest.ini_options]\npythonpath = ['.']\nmarkers = ['long: takes minutes']\n",
        "simulator/__init__.py": "",
        "simulator/law.py": LAW,
        "simulator/far.py": "FAR = 1\n",
        "cpic_planner/__init__.py": "",
        "cpic_planner/jobs/__init__.py": "",
        "cpic_planner/jobs/run.py": "RUN = 1\n",
        "tests/conftest.py": "FIXTURES = 1\n",
        "tests/simulator/test_law.py": PROOF,
        "tests/simulator/test_short.py": "def test_short():\n    assert True  # pytest.mark.long\n",
    }
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text, encoding="utf-8")
    return tmp_path


def change(project, name, old, new):
    path = project / name
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new), encoding="utf-8")


def names(project):
    path = project / "tests/simulator/test_law.py"
    return [file.relative_to(project).as_posix() for file in proofs.proved(path, project)]


def test_what_a_proof_proves(project):
    imported = ["tests/simulator/test_law.py", "tests/conftest.py", "simulator/law.py"]
    assert [path.name for path in proofs.long_proofs(project)] == ["test_law.py"]
    assert names(project) == imported
    change(
        project, "tests/simulator/test_law.py", "import pytest\n", 'import pytest\nPROVES = ("cpic_planner.jobs",)\n'
    )
    assert names(project) == [*imported[:2], "cpic_planner/jobs/__init__.py", "cpic_planner/jobs/run.py"]
    change(project, "tests/simulator/test_law.py", "cpic_planner.jobs", "cpic_planner.job")
    with pytest.raises(ValueError, match=r"test_law.py proves cpic_planner.job, which is no module"):
        names(project)
    change(project, "tests/simulator/test_law.py", '("cpic_planner.job",)', "()")
    with pytest.raises(ValueError, match=r"test_law.py proves no module: it needs PROVES"):
        names(project)


def test_names_of_a_room_are_followed_to_their_modules(project):
    (project / "simulator/__init__.pyi").write_text("from simulator.far import FAR as FAR\n", encoding="utf-8")
    proof = "tests/simulator/test_law.py"
    change(project, proof, "from simulator.law", "from simulator import FAR\nfrom simulator.law")
    assert names(project)[2:] == ["simulator/__init__.py", "simulator/far.py", "simulator/law.py"]


def test_evidence_is_kept_and_grows_old_with_the_code(project):
    name = "tests/simulator/test_law.py"
    assert proofs.old(project) == {name: "no evidence"}
    proofs.prove(project, [name], workers=1)
    assert proofs.old(project) == {}
    tests = proofs.evidence(project)[name]["tests"]
    assert list(tests) == ["test_law", "test_squares[1]", "test_squares[3]"]
    assert tests["test_law"] == {"result": "passed", "figures": {"law of 2": "4"}}
    assert "| `simulator/test_law.py`: test_law | passed | law of 2 4 | 1 |" in (
        project / "reports/long_proofs/report.md"
    ).read_text(encoding="utf-8")

    before = (project / "reports/long_proofs/proofs.json").read_bytes()
    change(project, "simulator/law.py", '"""Square."""', '"""Return\n\n    the square."""  # of any number')
    change(project, "simulator/far.py", "1", "2")
    assert proofs.old(project) == {}, "words and modules that it does not prove"
    proofs.prove(project, [name], workers=1)
    assert (project / "reports/long_proofs/proofs.json").read_bytes() == before, "nothing of place and time"

    change(project, "simulator/law.py", "x * x", "x * x + 0")
    assert proofs.old(project) == {name: "older than the code"}


def test_what_fails_is_no_evidence(project):
    change(project, "simulator/law.py", "x * x", "x + x")
    name = "tests/simulator/test_law.py"
    proofs.prove(project, [name], workers=1)
    assert proofs.old(project) == {name: "failure: test_squares[1]"}
    change(project, "tests/simulator/test_law.py", "@pytest.mark.long\n", "")
    assert proofs.old(project) == {}, "no long proof any more"
    proofs.prove(project, [], workers=1)
    assert proofs.evidence(project) == {}


@pytest.mark.parametrize(
    ("old", "new", "same"),
    [
        ('"""Square."""\n', "", True),
        ("return x * x", "# why\n    return (x * x)", True),
        ("x * x", "x * 2", False),
        ("x * x", "'x' * x", False),
        ("def law(x):", "def law(x=0):", False),
        ("def law(x):", "def rule(x):", False),
    ],
)
def test_digest_is_of_what_the_code_does(tmp_path, old, new, same):
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    for folder, text in (("a", LAW), ("b", LAW.replace(old, new))):
        (tmp_path / folder / "law.py").write_text(text, encoding="utf-8")
    first, second = (proofs.digest_of([tmp_path / folder / "law.py"], tmp_path / folder) for folder in "ab")
    assert (first == second) is same


def test_the_command_names_what_is_old(project):
    """As a program of its own, in a copy: exit code 1 and one line for each."""
    (project / "tools").mkdir()
    (project / "tools/__init__.py").touch()
    (project / "tools/proofs.py").write_bytes((proofs.ROOT / "tools/proofs.py").read_bytes())

    def run(*words):
        command = [sys.executable, "-m", "tools.proofs", *words]
        return subprocess.run(command, cwd=project, capture_output=True, text=True, check=False)

    asked = run("--check")
    assert asked.returncode == 1
    assert asked.stderr == "tests/simulator/test_law.py: no evidence\nrun make test-long\n"
    assert run("--workers", "1").returncode == 0
    assert run("--check").returncode == 0
    assert json.loads((project / proofs.EVIDENCE / "proofs.json").read_text())["schema_version"] == 1
