"""Points of a module's source where one operator, comparison or constant can be changed, and the names they keep.

What is left alone decides nothing that a test could see: annotations, decorators, assertions, what is raised and the
text of it, f-strings, and the keywords ``strict`` and ``maxsize``.
"""

from __future__ import annotations

import ast
import bisect
import io
import itertools
import random
import tokenize
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import yaml

ROOT = Path(__file__).resolve().parents[2]
EQUIVALENT = Path(__file__).with_name("equivalent.yaml")

# Modules by path, and tests that mirror them under other names than tests/<path>/test_<module>.py.
MODULES: dict[str, tuple[str, ...]] = {
    "simulator/imaging/drift.py": (),
    "cpic_planner/etc/rates.py": (
        "tests/cpic_planner/etc/test_smear.py",
        "tests/cpic_planner/etc/test_sky.py",
        "tests/cpic_planner/etc/test_planet.py",
    ),
    "cpic_planner/etc/noise.py": (
        "tests/cpic_planner/etc/test_paper.py",
        "tests/cpic_planner/etc/test_library.py",
        "tests/cpic_planner/etc/test_modes.py",
    ),
    "simulator/signal/speckles.py": (),
    "simulator/signal/saturation.py": (),
    "cpic_planner/etc/detection.py": (
        "tests/cpic_planner/etc/test_tails.py",
        "tests/cpic_planner/etc/test_search_level.py",
    ),
    "simulator/camera/noise.py": ("tests/simulator/camera/test_track_loss.py",),
    "simulator/detectors/variance.py": (),
    "simulator/ledger/visit.py": ("tests/simulator/ledger/test_sizes.py", "tests/simulator/ledger/test_light.py"),
    "cpic_planner/validation/photometry.py": (),
    "cpic_planner/validation/search.py": (),
    "cpic_planner/survey/detection.py": (),
    "simulator/detectors/gain.py": (),
    "cpic_planner/survey/visibility.py": (),
    "cpic_planner/ranking/completeness.py": (
        "tests/cpic_planner/ranking/test_in_zone.py",
        "tests/cpic_planner/ranking/test_known_completeness.py",
    ),
}

PARTNER = {
    "+": "-",
    "-": "+",
    "*": "/",
    "/": "*",
    "//": "*",
    "%": "*",
    "**": "*",
    "<<": ">>",
    ">>": "<<",
    "&": "|",
    "|": "&",
    "^": "&",
    "and": "or",
    "or": "and",
}
COMPARISONS = {
    "<": ("<=", ">"),
    "<=": ("<", ">="),
    ">": (">=", "<"),
    ">=": (">", "<="),
    "==": ("!=",),
    "!=": ("==",),
    "is": ("is not",),
    "is not": ("is",),
    "in": ("not in",),
    "not in": ("in",),
}
UNSEEN_KEYWORDS = ("strict", "maxsize")


@dataclass(frozen=True)
class Point:
    """One change of one place; ``edits`` are (start, end, text) in bytes of the source, ``lines`` its statement."""

    module: str
    function: str
    line: str
    change: str
    occurrence: int
    row: int
    lines: tuple[int, int]
    edits: tuple[tuple[int, int, bytes], ...]

    @property
    def name(self) -> tuple[str, str, str, str, int]:
        """What stays the same when other lines move: the occurrence counts equal changes of equal lines."""
        return self.module, self.function, self.line, self.change, self.occurrence

    def apply(self, source: bytes) -> bytes:
        """Source with this change."""
        for start, end, text in sorted(self.edits, reverse=True):
            source = source[:start] + text + source[end:]
        return source


class _Finder(ast.NodeVisitor):
    def __init__(self, module: str, source: bytes):
        self.module = module
        self.found: list[tuple[int, str, str, tuple[int, int], tuple[tuple[int, int, bytes], ...]]] = []
        text = source.decode("utf-8")
        self.texts = text.splitlines()
        self.starts = [0]
        for line in text.splitlines(keepends=True):
            self.starts.append(self.starts[-1] + len(line.encode("utf-8")))
        skipped = (tokenize.NL, tokenize.NEWLINE, tokenize.COMMENT, tokenize.INDENT, tokenize.DEDENT)
        self.tokens = [
            (token.string, self._of_token(token.start), self._of_token(token.end))
            for token in tokenize.generate_tokens(io.StringIO(text).readline)
            if token.type not in skipped and token.string
        ]
        self.scope: list[str] = []
        self.statement: ast.stmt | None = None
        self.visit(ast.parse(source))

    def _of_token(self, place: tuple[int, int]) -> int:
        row, column = place
        held = self.texts[row - 1] if row <= len(self.texts) else ""
        return self.starts[row - 1] + len(held[:column].encode("utf-8"))

    def _span(self, node: ast.expr) -> tuple[int, int]:
        return self.starts[node.lineno - 1] + node.col_offset, self.starts[node.end_lineno - 1] + node.end_col_offset

    def _between(self, start: int, end: int) -> tuple[str, int, int]:
        """The operator that lies between two operands, and its place; brackets do not count."""
        found = [token for token in self.tokens if start <= token[1] and token[2] <= end and token[0] not in "()"]
        return " ".join(token[0] for token in found), found[0][1], found[-1][2]

    def _add(self, start: int, before: str, after: str, *edits: tuple[int, int, str]) -> None:
        where = self.statement.lineno, self.statement.end_lineno
        if hasattr(self.statement, "body"):
            where = self.statement.lineno, self.statement.body[0].lineno - 1
        self.found.append(
            (
                start,
                ".".join(self.scope) or "<module>",
                f"{before} -> {after}",
                where,
                tuple((first, last, text.encode("utf-8")) for first, last, text in edits),
            )
        )

    def points(self) -> list[Point]:
        """Points in the order of the source."""
        counts: Counter[tuple[str, str, str]] = Counter()
        points = []
        for start, function, change, where, edits in sorted(self.found):
            row = bisect.bisect_right(self.starts, start)
            key = function, self.texts[row - 1].strip(), change
            counts[key] += 1
            points.append(Point(self.module, *key, counts[key], row, where, edits))
        return points

    def visit(self, node: ast.AST) -> None:
        outer = self.statement
        if isinstance(node, ast.stmt):
            self.statement = node
        super().visit(node)
        self.statement = outer

    def _leave(self, node: ast.AST) -> None:
        """Nothing here is changed."""

    visit_Raise = visit_Assert = visit_JoinedStr = visit_arg = visit_Import = visit_ImportFrom = _leave

    def _definition(self, node: ast.FunctionDef | ast.ClassDef) -> None:
        self.scope.append(node.name)
        if isinstance(node, ast.FunctionDef):
            self.visit(node.args)
        for part in node.body:
            self.visit(part)
        self.scope.pop()

    visit_FunctionDef = visit_ClassDef = _definition

    def visit_AnnAssign(self, node: ast.AnnAssign) -> None:
        if node.value is not None:
            self.visit(node.value)

    def visit_keyword(self, node: ast.keyword) -> None:
        if node.arg not in UNSEEN_KEYWORDS:
            self.visit(node.value)

    def visit_BinOp(self, node: ast.BinOp) -> None:
        operator, start, end = self._between(self._span(node.left)[1], self._span(node.right)[0])
        if operator in PARTNER:
            edits = [(start, end, PARTNER[operator])]
            if operator == "**":  # binds closer than its partner
                whole = self._span(node)
                edits += [(whole[0], whole[0], "("), (whole[1], whole[1], ")")]
            self._add(start, operator, PARTNER[operator], *edits)
        self.generic_visit(node)

    def visit_AugAssign(self, node: ast.AugAssign) -> None:
        operator, start, end = self._between(self._span(node.target)[1], self._span(node.value)[0])
        if operator[:-1] in PARTNER:
            after = PARTNER[operator[:-1]] + "="
            self._add(start, operator, after, (start, end, after))
        self.generic_visit(node)

    def visit_BoolOp(self, node: ast.BoolOp) -> None:
        for one, other in itertools.pairwise(node.values):
            operator, start, end = self._between(self._span(one)[1], self._span(other)[0])
            self._add(start, operator, PARTNER[operator], (start, end, PARTNER[operator]))
        self.generic_visit(node)

    def visit_Compare(self, node: ast.Compare) -> None:
        operands = [node.left, *node.comparators]
        for one, other in itertools.pairwise(operands):
            operator, start, end = self._between(self._span(one)[1], self._span(other)[0])
            for after in COMPARISONS[operator]:
                self._add(start, operator, after, (start, end, after))
        self.generic_visit(node)

    def visit_UnaryOp(self, node: ast.UnaryOp) -> None:
        operator, start, end = self._between(self._span(node)[0], self._span(node.operand)[0])
        self._add(start, operator, "nothing", (start, end, ""))
        self.generic_visit(node)

    def visit_Constant(self, node: ast.Constant) -> None:
        value = node.value
        if isinstance(value, bool):
            after = repr(not value)
        elif isinstance(value, int):
            after = repr(value + 1)
        elif isinstance(value, float | complex):
            after = repr(2 * value if value else value + 1)
        else:
            return
        start, end = self._span(node)
        self._add(
            start,
            self.texts[node.lineno - 1].encode()[node.col_offset : node.end_col_offset].decode(),
            after,
            (start, end, after),
        )


def points_of(module: str, source: bytes) -> list[Point]:
    """Points of a module, in the order of the source."""
    return _Finder(module, source).points()


def population(modules: Iterable[str] = MODULES, root: Path = ROOT) -> list[Point]:
    """Points of all modules."""
    return [point for module in modules for point in points_of(module, (root / module).read_bytes())]


def sample(points: list[Point], count: int, seed: int) -> list[Point]:
    """``count`` points drawn without replacement, in the order of the population; all of them if there are fewer."""
    drawn = random.Random(seed).sample(range(len(points)), min(count, len(points)))
    return [points[place] for place in sorted(drawn)]


def equivalents(path: Path = EQUIVALENT) -> Iterator[tuple[tuple[str, str, str, str, int], str]]:
    """Names of the points that no test can tell from the original, and why; a key names one change or several."""
    for entry in yaml.safe_load(path.read_text(encoding="utf-8")) or ():
        changes = entry["change"] if isinstance(entry["change"], list) else [entry["change"]]
        for change in changes:
            yield (
                (entry["module"], entry["function"], entry["line"], change, entry.get("occurrence", 1)),
                entry["reason"],
            )


def mirrors(module: str, root: Path = ROOT) -> list[str]:
    """Test files that mirror a module."""
    folder, _, name = module.rpartition("/")
    found = [file for file in (f"tests/{folder}/test_{name}", *MODULES.get(module, ())) if (root / file).is_file()]
    if not found:
        raise SystemExit(f"{module} has no tests that mirror it: write tests/{folder}/test_{name}")
    return found
