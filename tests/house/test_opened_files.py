"""Files that somebody named are opened in one place, `cpic_core.files`; other readings of files are listed."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
FLOORS = ("cpic_core", "catalogs", "simulator", "cpic_planner")

READING_METHODS = {"read_text", "read_bytes", "open"}
OWN = {"SqliteModels.open", "NpzModels.open"}  # classes of ours
READING_CALLS = set(
    """
    open io.open os.open os.fdopen np.load np.loadtxt np.genfromtxt np.fromfile np.memmap fits.open fits.getdata
    fits.getheader Table.read text_tables.read ascii.read parse pq.read_table sqlite3.connect zipfile.ZipFile
    tarfile.open urlopen urllib.request.urlopen
    """.split()
)
LAST_WORDS = READING_METHODS | {name.rpartition(".")[2] for name in READING_CALLS}
_ANY_LAST_WORD = re.compile(rf"\b({'|'.join(sorted(LAST_WORDS))})\s*\(")

# What may stay where it is, and why. A name that somebody gave may not be among it.
ALLOWED = {
    "catalogs/catalogue.py": "shipped tables",
    "catalogs/shipped.py": "shipped tables",
    "catalogs/table_files.py": "parses bytes that were read",
    "cpic_core/cache.py": "entries of our own cache",
    "cpic_core/files.py": "the place; writes, opens the lock",
    "cpic_core/lazy_names.py": "stubs of packages",
    "cpic_core/yaml_files.py": "shipped documents",
    "cpic_core/provenance.py": "installed packages and the records of their installer",
    "simulator/products/check.py": "shipped table of keywords, and what files gave it",
    "simulator/products/write.py": "shipped table of keywords",
    "simulator/products/sequence.py": "temporary files of our own",
    "simulator/reduction/level1.py": "opens what files gave it",
    "simulator/config/map_files.py": "opens what files gave it",
    "simulator/target/star_spectrum.py": "opens what files gave it",
    "simulator/target/albedo_grid.py": "SQLite opens by name, after files looked at the file",
    "cpic_planner/jobs/folder.py": "adds lines to the list of a run",
    "cpic_planner/validation/confirm.py": "arrays of a part, in memory",
    "cpic_planner/report/words.py": "shipped words",
    "cpic_planner/schemas/__init__.py": "shipped schemas",
    "cpic_planner/web/forms.py": "shipped words",
    "cpic_planner/cli/main.py": "/dev/null",
    "cpic_planner/cli/progress.py": "/dev/null",
    "cpic_planner/tradeoff/scenes.py": "/proc/cpuinfo",
    "cpic_planner/tradeoff/measure.py": "/proc/self/status",
}


def reading(source):
    """Lines of a module on which a file is read or opened, and by what."""
    if not _ANY_LAST_WORD.search(source):
        return
    for node in ast.walk(ast.parse(source)):
        if not isinstance(node, ast.Call):
            continue
        method = node.func.attr if isinstance(node.func, ast.Attribute) else ""
        if (method or getattr(node.func, "id", "")) not in LAST_WORDS:
            continue
        name = ast.unparse(node.func)
        if name in READING_CALLS or (method in READING_METHODS and name not in OWN):
            yield node.lineno, name


def test_files_are_opened_in_one_place():
    """And a module that reads nothing any more leaves the list of exceptions."""
    found = {}
    for path in sorted(path for floor in FLOORS for path in (ROOT / floor).rglob("*.py")):
        name = path.relative_to(ROOT).as_posix()
        found |= {name: lines} if (lines := list(reading(path.read_text(encoding="utf-8")))) else {}
    elsewhere = {name: lines for name, lines in found.items() if name not in ALLOWED}
    assert elsewhere == {}, "read it with cpic_core.files, or say in ALLOWED why not"
    assert set(ALLOWED) - set(found) == set()


LINES = (
    "open(path)|Path(path).open('rb')|path.read_text()|np.load(path)|fits.open(path)|Table.read(path)|os.open(path, 0)"
)


@pytest.mark.parametrize("line", [*LINES.split("|"), "Path(name).read_bytes()", "sqlite3.connect(name)"])
def test_a_reading_is_seen(line):
    assert [number for number, _ in reading(f"\n{line}\n")] == [2]


def test_writing_is_none():
    assert list(reading("write_text(path, 'x')\nstack.enter_context(file)\n")) == []
