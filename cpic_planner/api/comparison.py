"""Two answers compared: runs in their folders, and answers in files. Rankings go to `compare_rankings`."""

from __future__ import annotations

import math
import pkgutil
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from cpic_core import InputError, Record, differing_words, listed, parse_json, read_file, shortened
from cpic_planner import results
from cpic_planner.results.compared import differing
from cpic_planner.schemas import RESULTS

_MOST_BYTES, _LONGEST, _NAMED = 400_000_000, 80, 5
_ALLOWED = "the folder of a run, or an answer as --json prints it"
_ABOUT = frozenset(("schema_version", "kind", "config_hash", "fingerprint", "version", "note", "notes", "not_modelled"))
_OUTCOMES = {
    *("best_band", "calibration", "calibration_text", "counts", "counts_limited_by", "n_in_catalogue", "n_ranked"),
    *("sample", "statement", "leading_planet", "slot_utc", "sources"),
}
"""Fields beside the rows that say what came out, not what was asked."""
_ASKED = {"question", "level", "reference_library", "n_modes", "centring", "annulus_lambda_d", "sigma", "verdict_mode"}
"""Columns of rows that repeat what was asked."""
_OF_STAR = ("hip", "v_mag", "distance_pc")
_FIRST = ("verdict", "status", "limited_by", "reason", "detected", "best_band", "chosen_band")
_MAIN = ("value", "score", "rank", "order", "mean", "contrast_limit", "time_s", "snr")
_NAMES = ("name", "target", "star", "strategy", "first", "second", "scene", "planet", "fact", "quantity", "key", "band")
_HOW = {"out", "workers", "scheduler", "force", "json", "format", "dry-run", "strict", "brief", "columns"}
"""Options of commands that decide no number."""


class Compared(Record, eq=False):
    """An answer that was read.

    Attributes
    ----------
    name : str
        Its file or folder.
    result : Result
    command : sequence of str
        That of its run; empty where it is not known.
    """

    name: str
    result: Any
    command: Sequence[str] = ()

    @classmethod
    def read(cls, path: str | Path, *, key: str) -> Compared:
        """Read the folder of a run, or the file of an answer.

        Raises
        ------
        InputError
            For what is neither.
        """
        from cpic_planner.jobs.folder import DamagedListError, RunFolder
        from cpic_planner.jobs.job import RECORD

        place, command = Path(path), []
        if place.is_dir():
            try:
                folder = RunFolder.read(place, mend=False)
            except DamagedListError as error:
                raise InputError(key, str(path), allowed=_ALLOWED, hint=f"its list is damaged: {error}") from None
            file = f"{folder.kind}.json" if folder is not None else ""
            if folder is None or file not in folder.names():
                raise InputError(key, str(path), allowed=_ALLOWED, hint="it holds no finished run")
            if RECORD in folder.names():
                command = list(_tree(place / RECORD, key).get("command", ()))
            tree = _tree(place / file, key)
        else:
            tree = _tree(place, key)
        kind = str(tree.get("kind"))
        if kind not in RESULTS:
            raise InputError(key, str(path), allowed=_ALLOWED, hint="the file is of no known kind of answer")
        try:
            return cls(place.name or str(place), pkgutil.resolve_name(RESULTS[kind]).model_validate(tree), command)
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            hint = f"{'.'.join(map(str, first['loc']))}: {first['msg']}"
            raise InputError(key, str(path), allowed=_ALLOWED, hint=hint) from None

    def record(self) -> results.ComparedAnswer:
        """Return what is written into results."""
        about = {name: getattr(self.result, name, "") for name in ("kind", "config_hash", "fingerprint")}
        return results.ComparedAnswer(name=self.name, **about)


def _tree(path: Path, key: str) -> dict[str, Any]:
    content = read_file(path, key=key, allowed=_ALLOWED, max_bytes=_MOST_BYTES)
    try:
        tree = parse_json(content)
    except ValueError as error:
        raise InputError(key, str(path), allowed=_ALLOWED, hint=shortened(str(error))) from None
    if not isinstance(tree, dict):
        raise InputError(key, str(path), allowed=_ALLOWED, hint="the file holds no single answer")
    return tree


def compare_answers(
    before: str | Path | results.Result, after: str | Path | results.Result
) -> results.AnswerComparison | results.RankComparison:
    """Return what differs between two answers to one kind of question, and what explains it.

    Parameters
    ----------
    before, after : str, Path or Result
        The output folder of a run, a file of JSON (``--json``, ``plan.json`` ...), or a result; of rankings also
        tables that ``cpic rank --out`` wrote.

    Returns
    -------
    AnswerComparison or RankComparison
        The second of rankings, as `compare_ranks` returns it.

    Raises
    ------
    InputError
        For what is no answer, and for answers of two kinds.
    """
    from cpic_planner.ranking.sensitivity import Ranking, compare_rankings, load_ranking

    read: list[Any] = []
    for key, given in (("before", before), ("after", after)):
        if isinstance(given, results.Result):
            read.append(Compared(key, given))
        elif not isinstance(given, str | Path):
            raise InputError(key, given, allowed=_ALLOWED)
        elif Path(given).suffix.lower() in (".csv", ".ecsv"):
            read.append(load_ranking(given, key=key))
        else:
            read.append(Compared.read(given, key=key))
    kinds = ["rank" if isinstance(item, Ranking) else item.result.kind for item in read]
    if kinds[0] != kinds[1]:
        hint = "answers to two kinds of question do not compare"
        raise InputError("after", f"an answer of kind {kinds[1]}", allowed=f"one of kind {kinds[0]}", hint=hint)
    if kinds[0] == "rank":
        return compare_rankings(
            *(item if isinstance(item, Ranking) else Ranking.of(item.result, item.name) for item in read)
        )
    return compared_answers(*read)


def compared_answers(before: Compared, after: Compared) -> results.AnswerComparison:
    """Return the comparison of two answers of one kind."""
    old, new = _rows(before.result), _rows(after.result)
    differ = _question(before, after)
    mine, theirs = (getattr(item.result, "fingerprint", "") for item in (before, after))
    software = differing_words(mine, theirs) if mine and theirs else []
    changes = [change for key in new if key in old for change in _changes(key, old[key], new[key])]
    changes.sort(key=lambda one: (_kind(one.quantity), -_size(one)))
    gone, came = ([key for key in one if key not in other] for one, other in ((old, new), (new, old)))
    hashes = {getattr(item.result, "config_hash", "") for item in (before, after)}
    differs = bool(changes or gone or came)
    asked, made = bool(differ) or len(hashes) > 1, bool(software)
    explained = (
        "nothing" if not differs else "both" if asked and made else "question" if asked else "software" if made else ""
    )
    found = results.AnswerComparison(
        before=before.record(),
        after=after.record(),
        settings=differ,
        software=software,
        only_before=gone,
        only_after=came,
        changes=changes,
        explained_by=explained or "unknown",
        statement="",
    )
    return found.model_copy(update={"statement": _statement(found, asked and not differ)})


def _kind(quantity: str) -> int:
    """Return where a quantity stands: verdicts, what the answer is about, other numbers, parts of numbers."""
    name = quantity.rpartition(".")[2]
    return 0 if name in _FIRST else 1 if name in _MAIN else 2 + ("." in quantity)


def _question(before: Compared, after: Compared) -> list[results.SettingChange]:
    """Return what differs in what two answers, and the commands of their runs, say of the questions."""
    trees = [_asked(item.result) for item in (before, after)]
    given = [own for item in (before, after) if (own := getattr(item.result, "asked", None)) is not None]
    if len(given) == len(trees):
        # They say all that was asked: nothing else has to be told from what follows of it.
        names = dict.fromkeys(name for own in given for name in own)
        follow = ("asked", "reference_planet", *_ASKED, *(_OF_STAR if _differ(trees, "target") else ()))
        for tree, own in zip(trees, given, strict=True):
            for name in follow:
                tree.pop(name, None)
            tree |= {name: own.get(name, tree.get(name, "by default")) for name in names}
    found = differing(*trees)
    found = [change for change in found if not change.key.endswith(".statement")]  # which follows from the rest
    if before.command and after.command:
        said = [change.key.rpartition(".")[2] for change in found]
        old, new = (_options(item.command) for item in (before, after))
        for change in differing(old, new):
            word = change.key.removeprefix("--").replace("-", "_")
            if not any(name.startswith(word) for name in said):
                found.append(change)
    return found


def _differ(trees: Sequence[Mapping[str, Any]], name: str) -> bool:
    return trees[0].get(name) != trees[1].get(name)


def _options(command: Sequence[str]) -> dict[str, str]:
    """Return the options of a command that decide numbers, and what it is about."""
    found: dict[str, str] = {}
    name = "argument"
    for word in command:
        if re.match("--?[A-Za-z]", word):
            name, _, value = word.partition("=")
            found[name] = f"{found[name]}, {value}" if name in found and value else found.get(name, value)
        elif name != "argument" or command[0] != word:
            found[name] = f"{found[name]}, {word}" if found.get(name) else word
            name = "argument"
    return {name: value or "given" for name, value in found.items() if name.removeprefix("--") not in _HOW}


def _asked(result: results.Result) -> dict[str, Any]:
    """Return what an answer says of its question: its fields beside the rows, and what rows repeat."""
    tree: dict[str, Any] = {}
    for name, value in vars(result).items():
        if name not in _ABOUT | _OUTCOMES and not _holds_rows(value):
            tree[name] = _without_rows(value)
    for name in results.rows_of(type(result)):
        for row in getattr(result, name) or ():
            for column in _ASKED & vars(row).keys():
                texts = tree.setdefault(column, [])
                if isinstance(texts, list) and (text := getattr(row, column)) is not None and text not in texts:
                    texts.append(text)
            if isinstance(settings := getattr(row, "settings", None), Mapping):
                tree.setdefault("settings", {})[_name(row)] = settings
    return tree


def _holds_rows(value: Any) -> bool:
    return isinstance(value, Sequence) and not isinstance(value, str) and any(map(_is_result, value[:1]))


def _is_result(value: Any) -> bool:
    return isinstance(value, results.Result)


def _without_rows(value: Any) -> Any:
    if not _is_result(value):
        return value
    return {name: _without_rows(below) for name, below in vars(value).items() if not _holds_rows(below)}


def _name(row: results.Result, result: Any = None) -> str:
    """Return what tells a row of a result from the others, in words: not the star that all of it is about."""
    above = () if result is None else type(result).model_fields
    words = (getattr(row, name, None) for name in _NAMES if name in type(row).model_fields and name not in above)
    return " ".join(str(word) for word in words if isinstance(word, str) and word)


def _rows(result: Any, above: str = "") -> dict[str, dict[str, Any]]:
    """Return the values of all rows of a result and of those inside them, by what the rows are about.

    Values of the result beside its rows are those of a row without a name. Several rows of one name are numbered.
    """
    own: dict[str, Any] = {}
    found = {above: own}
    for name, value in vars(result).items():
        if name in _ABOUT | _ASKED | {"settings"}:
            continue
        if _holds_rows(value):
            seen: Counter[str] = Counter()
            for place, row in enumerate(value):
                word = _name(row, result) or f"{name} {place + 1}"
                seen[word] += 1
                label = f"{word} ({seen[word]})" if seen[word] > 1 else word
                below = _rows(row, f"{above}: {label}" if above else label)
                for key, values in below.items():
                    found.setdefault(key, {}).update(values)
                if not above and place and name != "answers":
                    found[label]["order"] = place + 1
        elif above or name in _OUTCOMES:
            own |= dict(_values(value, name))
    return {key: values for key, values in found.items() if values}


def _values(value: Any, name: str) -> Iterator[tuple[str, Any]]:
    """Yield the plain values below a field, by dotted names; a list is one value."""
    if _is_result(value):
        value = vars(value)
    if isinstance(value, Mapping):
        for word, below in value.items():
            yield from _values(below, f"{name}.{word}")
    elif _holds_rows(value):
        yield name, [item.model_dump(mode="json") for item in value]
    else:
        yield name, value


def _changes(row: str, old: Mapping[str, Any], new: Mapping[str, Any]) -> Iterator[results.AnswerChange]:
    for name in dict.fromkeys((*old, *new)):
        was, now = old.get(name), new.get(name)
        if was == now:
            continue
        numbers = all(isinstance(one, int | float) and not isinstance(one, bool) for one in (was, now))
        unit = results.unit_of(name.rpartition(".")[2])
        relative = now / was - 1.0 if numbers and was else None
        yield results.AnswerChange(
            row=row, quantity=name, before=_text(was), after=_text(now), unit=unit, relative=relative
        )


def _text(value: Any) -> str | None:
    if value is None:
        return None
    return f"{value:.6g}" if isinstance(value, float) else shortened(str(getattr(value, "value", value)), _LONGEST)


def _size(change: results.AnswerChange) -> float:
    """Return how large a change is: of numbers the logarithm of their ratio, of what came or went without end."""
    if change.relative is None:
        return math.inf if None in (change.before, change.after) else 1.0
    return abs(math.log(1.0 + change.relative)) if change.relative > -1.0 else math.inf


def _begin(verdict: str | None) -> str:
    """Return a verdict without the numbers that it is by."""
    return "none" if verdict is None else re.split(r"[;(]", verdict)[0].strip().replace("_", " ")


def _words(verdict: str) -> str:
    """Return a verdict without its numbers: what it says where only these differ."""
    return re.sub(r"[\d.]+", "", verdict)


def _statement(found: results.AnswerComparison, unstated: bool) -> str:
    """Say in words what differs and why; ``unstated``: hashes tell that the questions differ, and nothing else."""
    settings, software, changes = found.settings, found.software, found.changes
    keys = listed([change.key for change in settings], _NAMED)
    made = f"What made them differs in {listed(software, _NAMED)}." if software else ""
    if found.explained_by == "nothing":
        asked = f"The questions differ in {keys}, the answers do not." if settings else "No difference."
        return " ".join(filter(None, (asked, made)))
    words = []
    if changes:
        rows = len({change.row for change in changes})
        words.append(
            f"{len(changes)} value{'s' * (len(changes) != 1)} differ{'s' * (len(changes) == 1)} in {rows} "
            f"row{'s' * (rows != 1)} that both have."
        )
    verdicts = [one for one in changes if one.quantity.rpartition(".")[2] == "verdict"]
    moves = [(one.row, _begin(one.before), _begin(one.after)) for one in verdicts]
    if told := [f"{row} ({was} to {now})" for row, was, now in moves if _words(was) != _words(now)]:
        words.append(f"The verdict changes for {listed(told, _NAMED)}.")
    for side, names in (("first", found.only_before), ("second", found.only_after)):
        if names:
            words.append(f"Only the {side} has {listed(names, _NAMED)}.")
    if len(settings) == 1:
        one = settings[0]
        words.append(
            f"The questions differ in {one.key} alone ({one.before} to {one.after}), which explains this"
            f"{' together with what made them' if software else ''}."
        )
    elif settings:
        words.append(f"The questions differ in {keys}; compare answers that differ in one of them to tell which it is.")
    elif unstated and not software:
        words.append("The questions differ, by their hashes, in something that the answers do not state.")
    if software and not settings:
        words.append(f"The questions are the same as far as the answers state them. {made}")
    elif made:
        words.append(made)
    if found.explained_by == "unknown":
        words.append("This is not explained: question, code, data and libraries are the same as far as is stated.")
    return " ".join(words)
