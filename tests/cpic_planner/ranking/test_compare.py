"""What moves between two rankings, against brute force over their rows; files read back as the ranking they are of."""

import csv
import json
from functools import cache

import pytest
from scipy.stats import kendalltau

import cpic_planner as cp
from cpic_planner.ranking.sensitivity import Ranking, compare_rankings, load_ranking
from cpic_planner.report import ranking_csv, ranking_ecsv
from cpic_planner.results import RankComparison, RankResult
from simulator import load_instrument

ASKED = {"v_mag_max": 4.0, "bands": ["F520", "F662"], "n_planets": 200}
CALM = load_instrument({"drift": {"visit_nm": 0.025, "walk_nm_per_sqrt_hour": 0.025}})


@cache
def nominal():
    return cp.rank_targets(**ASKED)


@cache
def steady():
    return cp.rank_targets(**ASKED, instrument=CALM)


@cache
def moved():
    return cp.compare_ranks(CALM, **ASKED)


def files(folder):
    """The ranking as the three kinds of files that hold one."""
    texts = {"csv": ranking_csv(nominal()), "ecsv": ranking_ecsv(nominal()), "json": nominal().model_dump_json()}
    for ending, text in texts.items():
        (folder / f"old.{ending}").write_text(text, encoding="utf-8")
    return [folder / f"old.{ending}" for ending in texts]


def test_the_first_stars_of_a_ranking_are_a_ranking_too(tmp_path):
    """A file of the first ones says how they were ranked, as that of all does."""
    path = tmp_path / "ten.ecsv"
    path.write_text(ranking_ecsv(nominal(), 10), encoding="utf-8")
    read = load_ranking(path)
    assert read.rows == nominal().targets[:10]
    assert compare_rankings(read, Ranking.of(nominal())).settings is not None


def test_a_ranking_and_itself_move_nothing():
    same = compare_rankings(Ranking.of(nominal()), Ranking.of(nominal()))
    assert {(move.places, move.why) for move in same.targets} == {(0, "unchanged")}
    assert {move.score_ratio for move in same.targets} <= {1.0, None}
    assert [(item.top, item.kept, item.kendall_tau_b) for item in same.agreement] == [(10, 10, 1.0), (50, 50, 1.0)]
    assert (same.n_moved, same.largest_mover, same.largest_mover_places) == (0, "", 0)
    assert same.settings == same.detected_more == same.detected_less == same.only_before == same.only_after == []
    assert "No star with a score above zero moves" in same.statement


def test_half_the_drift_against_brute_force():
    """The question stands after, the other instrument before; every number from the rows of two rankings."""
    before = {row.name: row for row in steady().targets}
    after = {row.name: row for row in nominal().targets}
    assert [move.name for move in moved().targets] == [row.name for row in nominal().targets]
    for move in moved().targets:
        old, new = before[move.name], after[move.name]
        assert (move.before.rank, move.after.rank) == (old.rank, new.rank)
        assert move.places == old.rank - new.rank
        assert move.score_ratio == (pytest.approx(new.score / old.score) if old.score else None)
        for name in ("score", "completeness", "band", "visits", "limited_by", "status", "completeness_time_s"):
            assert (getattr(move.before, name), getattr(move.after, name)) == (getattr(old, name), getattr(new, name))
    scored = [name for name in after if max(before[name].score, after[name].score) > 0]
    assert moved().n_moved == sum(before[name].rank != after[name].rank for name in scored) > 0
    found = [{row.name for row in rows if row.status == "ok"} for rows in (before.values(), after.values())]
    assert set(moved().detected_less) == found[0] - found[1] != set()
    assert set(moved().detected_more) == found[1] - found[0]
    assert (moved().before.n_detected, moved().after.n_detected) == tuple(map(len, found))
    for item in moved().agreement:
        first = [name for name in scored if min(before[name].rank, after[name].rank) <= item.top]
        scores = [[rows[name].score for name in first] for rows in (before, after)]
        assert item.n_compared == len(first)
        assert item.kendall_tau_b == pytest.approx(kendalltau(*scores).statistic, abs=1e-12)
        assert item.kept == sum(max(before[name].rank, after[name].rank) <= item.top for name in after)
    assert moved().agreement[0].kendall_tau_b < 1
    falls = {name: abs(before[name].rank - after[name].rank) for name in scored}
    near = [name for name in scored if min(before[name].rank, after[name].rank) <= 50]
    assert abs(moved().largest_mover_places) == max(falls[name] for name in near) == falls[moved().largest_mover]
    keys = {item.key: (item.before, item.after) for item in moved().settings}
    assert keys["instrument.drift.visit_nm"] == ("0.025", "0.05")
    assert {key.rpartition(".")[0] for key in keys} <= {"instrument", "instrument.drift"}


def test_reasons_are_true():
    """Each reason names what differs, and how many stars cross where the star's own score does not decide."""
    before = {row.name: row for row in steady().targets}
    after = {row.name: row for row in nominal().targets}
    for move in moved().targets[:30]:
        old, new = before[move.name], after[move.name]
        shown = f"completeness {100 * old.completeness:.3g} % → {100 * new.completeness:.3g} %"
        if min(old.completeness, new.completeness) >= 1e-4:
            assert (shown in move.why) == (f"{old.completeness:.3g}" != f"{new.completeness:.3g}"), move.why
        assert ("→ detected" in move.why) == (old.status != "ok" == new.status)
        assert ("detected →" in move.why) == (old.status == "ok" != new.status)
        assert (f"visits {old.visits} → {new.visits}" in move.why) == (old.visits != new.visits)
        assert "excluded" not in move.why, "what is known of the stars is the same"
        if move.places > 0 and new.score < old.score:
            passed = [row for row in before.values() if row.rank < old.rank and after[row.name].rank > new.rank]
            assert f"passes {len(passed)} star" in move.why
            assert "that lose" in move.why
    assert any("that lose" in move.why for move in moved().targets)


def test_knowledge_that_excludes_planets_is_a_reason():
    all_planets = cp.rank_targets(**ASKED, exclusions="none")
    moved = compare_rankings(Ranking.of(all_planets), Ranking.of(nominal()))
    ceti = next(move for move in moved.targets if move.name == "tau Cet")
    assert ceti.places < 0
    assert "excluded by what is known 0 % → " in ceti.why
    assert [item.key for item in moved.settings] == ["population.exclusions"]


def test_files_read_back_as_the_ranking(tmp_path):
    for path in files(tmp_path):
        read = load_ranking(path)
        assert read.rows == nominal().targets, path
        assert (read.header is None) == (path.suffix == ".csv")
        assert read.header is None or read.config_hash == nominal().config_hash
        told = compare_rankings(read, Ranking.of(nominal()))
        assert (told.n_moved, {move.why for move in told.targets}) == (0, {"unchanged"})
        assert told.settings == (None if path.suffix == ".csv" else [])
        assert told.before.name == path.name
    old = cp.compare_ranks(str(path), **ASKED, instrument=CALM)
    assert [move.places for move in old.targets] == [
        next(row.rank for row in nominal().targets if row.name == move.name) - move.after.rank for move in old.targets
    ]
    assert RankComparison.model_validate_json(old.model_dump_json()) == old


def test_older_and_newer_files_are_read(tmp_path):
    """Columns that a version does not know are left out, those that came later are empty."""
    plain = list(csv.reader(ranking_csv(nominal()).splitlines()))
    gone = plain[0].index("rank_in_catalogue")
    rows = [[*row[:gone], *row[gone + 1 :], "airmass" if i == 0 else "1.2"] for i, row in enumerate(plain)]
    (tmp_path / "old.csv").write_text("\n".join(",".join(row) for row in rows))
    read = load_ranking(tmp_path / "old.csv")
    assert [row.rank_in_catalogue for row in read.rows] == [None] * len(nominal().targets)
    assert compare_rankings(read, Ranking.of(nominal())).n_moved == 0
    tree = json.loads(nominal().model_dump_json())
    for name in ("instrument", "n_in_catalogue"):
        del tree[name]
    (tmp_path / "old.json").write_text(json.dumps(tree))
    assert load_ranking(tmp_path / "old.json").rows == nominal().targets


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("plan.json", '{"kind": "plan", "targets": []}'),
        ("broken.json", "{"),
        ("stars.csv", "name,v_mag\ntau Cet,3.5\n"),
        ("words.csv", None),
        ("binary.csv", "\x00\xff"),
        ("none.csv", ""),
        ("damaged.ecsv", "# %ECSV 1.0\n# ---\n# {\n"),
    ],
)
def test_what_is_no_ranking_is_refused(refused, tmp_path, name, text):
    words = ranking_csv(nominal()).replace(str(nominal().targets[0].score), "many")
    (tmp_path / name).write_bytes(
        (words if text is None else text).encode("latin-1" if name == "binary.csv" else "utf-8")
    )
    line = refused(f"^other = {name}: .*cpic rank --json", cp.compare_ranks, tmp_path / name, **ASKED)
    assert "many" in line or text is not None


def test_other_words_are_refused(refused, tmp_path):
    refused("^other = cpic_defualt: .*earlier ranking.*presets: .*cpic_default", cp.compare_ranks, "cpic_defualt")
    refused("^other = .*gone.csv: .*No such file", cp.compare_ranks, tmp_path / "gone.csv")
    refused("bands|F999", cp.compare_ranks, "as_published", bands=["F999"])


def test_stars_of_one_ranking_alone_and_other_names_of_the_same(tmp_path):
    bright = cp.rank_targets(**ASKED | {"v_mag_max": 3.0})
    told = compare_rankings(Ranking.of(bright, "bright.json"), Ranking.of(nominal()))
    assert told.only_before == []
    assert set(told.only_after) == {row.name for row in nominal().targets} - {row.name for row in bright.targets}
    assert len(told.targets) == len(bright.targets)
    assert [item.key for item in told.settings] == ["sample"]
    other = [row.model_copy(update={"name": "HD 10700"}) if row.name == "tau Cet" else row for row in nominal().targets]
    told = compare_rankings(Ranking.of(nominal().model_copy(update={"targets": other})), Ranking.of(nominal()))
    assert told.only_before == told.only_after == []
    assert told.n_moved == 0


def test_filters_choose_rows_and_ranks_are_those_among_all():
    told = cp.compare_ranks(CALM, **ASKED, stars=["tau Cet", "alpha Cen B", "bet Hyi"])
    expected = {move.name: move for move in moved().targets}
    assert {move.name for move in told.targets} == {"tau Cet", "alf Cen B", "bet Hyi"}
    for move in told.targets:
        whole = expected[move.name]
        assert (move.before, move.after, move.places) == (whole.before, whole.after, whole.places)
    assert [item.top for item in told.agreement] == [3]
    one = compare_rankings(Ranking.of(steady()), Ranking.of(cp.rank_targets(**ASKED, stars="tau Cet")))
    assert (len(one.targets), len(one.only_before)) == (1, len(steady().targets) - 1)
    assert one.targets[0].places == expected["tau Cet"].places
    assert [(item.top, item.kept, item.kendall_tau_b) for item in one.agreement] == [(1, 1, None)]
    assert "of 1 star" in one.statement


def test_different_scores_have_an_order_and_no_ratio():
    margins = cp.rank_targets(**ASKED, score="detection_margin")
    told = compare_rankings(Ranking.of(margins), Ranking.of(nominal()))
    assert {move.score_ratio for move in told.targets} == {None}
    assert "by different scores, detection margin and completeness per hour" in told.statement
    assert told.n_moved > 0
    assert {move.why for move in told.targets} == {"unchanged"}


def test_nothing_in_common_is_refused(refused):
    none = Ranking("mine.csv", [nominal().targets[0].model_copy(update={"name": "nowhere"})], "0")
    refused("mine.csv", compare_rankings, none, Ranking.of(nominal()))


def test_a_result_in_memory_is_another_ranking():
    assert isinstance(steady(), RankResult)
    told = cp.compare_ranks(steady(), **ASKED)
    assert [move.places for move in told.targets] == [move.places for move in moved().targets]
    assert {item.key for item in told.settings} == {"instrument", "drift_nm"}
