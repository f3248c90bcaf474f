""""""

import io
import re
from pathlib import Path

import pytest
from rich.console import Console

from cpic_planner.ranking.sensitivity import Ranking, compare_rankings
from cpic_planner.report import (
    best_row,
    print_check,
    print_etc,
    print_explanation,
    print_moves,
    print_plan,
    print_planned,
    print_rank,
    print_sensitivity,
    print_simulation,
)
from cpic_planner.report.words import size_text
from cpic_planner.results import (
    CheckResult,
    FindingRecord,
    LeftOutRow,
    PeriodRecord,
    SimulatedProgramme,
    SimulatedSequence,
    SimulationResult,
    VisitRow,
)
from cpic_planner.simulation import simulation_estimate
from simulator.config import load_simulation


def shown(function, *arguments, width=100, **options):
    stream = io.StringIO()
    function(*arguments, Console(file=stream, width=width, highlight=False), **options)
    return stream.getvalue()


@pytest.fixture(scope="module")
def comparison(rank):
    """The first two stars change places; the hostile name is among the rows."""
    first, second, *others = rank.targets
    swapped = [
        second.model_copy(update={"rank": 1, "score": first.score, "completeness": 0.5, "visits": 7}),
        first.model_copy(update={"rank": 2, "score": second.score}),
        *others,
    ]
    after = rank.model_copy(update={"targets": swapped, "time_s": 2.0 * rank.time_s})
    return compare_rankings(Ranking.of(rank, "[old].json"), Ranking.of(after, "new"))


@pytest.mark.parametrize("width", [40, 60, 100, 200])
def test_tables_fit_any_width(rank, plan, etc_answers, sensitivity, explanation, comparison, width):
    for text in (
        shown(print_moves, comparison, width=width),
        shown(print_sensitivity, sensitivity, width=width),
        shown(print_explanation, explanation, width=width),
        shown(print_rank, rank, width=width),
        shown(print_plan, plan, width=width),
        shown(print_etc, etc_answers, width=width),
    ):
        assert max(len(line) for line in text.splitlines()) <= width


def test_rank_at_100_columns_is_one_line_a_star(rank):
    text = shown(print_rank, rank, limit=20)
    lines = [line for line in text.splitlines() if line.strip()[:2].strip().isdigit() and "F" in line]
    assert len([line for line in lines if "F520" in line or "F662" in line]) == 20
    for word in ("% per h", "compl %", "known %", "blind %", "status", "speckle floor", "▲ saturated"):
        assert word in text
    for word in ("α Cen B", "Population (compl %): giants (Giant planets, 0.21 planets per star,", "per hour of it"):
        assert word in " ".join(text.split())


@pytest.mark.parametrize("width", [80, 100, 120, 160, 190, 230])
def test_rank_keeps_what_matters_at_any_width(rank, width):
    head = next(line for line in shown(print_rank, rank, width=width).splitlines() if "star" in line and "#" in line)
    wanted = {
        80: "% per h compl % known % blind % status",
        100: "visits band",
        120: "margin",
        160: "V mag dist pc contrast sep ″",
        190: "in visit wall",
        230: "gain frames × s",
    }
    for at, words in wanted.items():
        if width >= at:
            assert all(word in head for word in words.split()), (at, head)


def test_the_score_is_not_shown_twice(rank):
    by_margin = rank.model_copy(update={"score_name": "detection_margin"})
    text = shown(print_rank, by_margin, width=160)
    assert "by detection margin" in text
    assert "% per h" not in text
    assert text.count(" margin") >= 1
    by_limit = rank.model_copy(update={"score_name": "contrast_limit"})
    assert "−log C" in shown(print_rank, by_limit, width=160)


def test_rank_limit(rank):
    text = shown(print_rank, rank, limit=3)
    assert "first 3 of 20" in text
    assert "α Cen A" not in text


def test_wide_terminals_show_settings(rank):
    assert "frames × s" in shown(print_rank, rank, width=230)


def test_sensitivity(sensitivity):
    text = shown(print_sensitivity, sensitivity, width=120)
    assert re.search(r"\n +3 +7 +0\.42 +11 +14 ", text)
    assert re.search(r"α Cen A +6 +wavefront", text)
    assert re.search(r"\n +7 +10 +– +0 +20 ", text)
    assert "detected: stars whose reference planet is detected (7 nominally)" in " ".join(text.split())
    assert {"of 10", "of 20"} <= set(re.findall(r"of \d+", text.splitlines()[1]))
    assert sensitivity.statement in " ".join(text.split())
    assert "decide" not in text
    assert "wavefront drift twice as large" in text


def test_comparison(comparison):
    text = " ".join(shown(print_moves, comparison, limit=1).split())
    assert "What moves from [old].json (before) to new (after): the first of either" in text
    assert "2 1 τ Cet" in text
    assert "1 2 α Cen B" in text
    assert "ε Eri" not in text
    assert "→ 50 %" in text
    assert "2 of " in text
    assert "τ Cet moves most, up from rank 2 to 1" in text or "α Cen B moves most, down from rank 1 to 2" in text
    assert f"Settings that differ: time_s {comparison.settings[0].before} → {comparison.settings[0].after}." in text


def test_explanation(explanation):
    text = shown(print_explanation, explanation, width=120)
    assert "in zone %  whole %" in text
    assert "30.0     20.0" in text
    assert "in zone %: fraction of the population in the dark quadrants; whole %: fraction whose" in " ".join(
        text.split()
    )
    assert text.startswith("τ Cet (HIP 8102)\nTwo sentences. [bold]Brackets[/bold] stay.\n")
    assert text.index("α Cen B") < text.index("ε Eri")
    assert "F662: the EM gain is held by the converter's range." in text
    assert "EM gain up to 390 keeps bright starlight" in text
    assert "no EM gain leaves every pixel" in text
    assert "×1.31 half the drift of the wavefront." in " ".join(text.split())
    assert "Rank under other assumptions: 4 (drift x2)." in text
    assert "speckles that the subtraction leaves" in shown(print_explanation, explanation, width=160)


def test_the_first_and_the_last_star_have_one_neighbour(explanation):
    alone = explanation.model_copy(update={"better": None, "worse": None, "ranks": {}})
    text = shown(print_explanation, alone)
    assert "Rank under other" not in text
    assert "α Cen B" not in text


def test_plan(plan):
    text = shown(print_plan, plan)
    assert "→ F662" in text
    assert "□ inside inner edge" in text
    assert "Predicted over recovered SNR 1.03 ± 0.04 over 6 measurements: the ETC agrees" in text
    assert "α Cen B: confirmed in F662, F720; ETC agrees, 0.97 ± 0.04" in text
    assert re.search(r"31\.[78] ± 1\.3  0\.98 ± 0\.06 +8/8  ✓ confirmed", shown(print_plan, plan, width=160))
    assert "○ seen at its place" in text
    assert "8/8  ✓ confirmed" in text
    assert "Images altered" not in text
    assert "in which the blind search finds the planet" in " ".join(text.split())
    rolled = " ".join(shown(print_plan, plan.model_copy(update={"reference_library": "roll"})).split())
    assert "in which the planet is significant at its known place" in rolled
    assert "blind search" not in rolled


def test_in_short_a_plan_has_a_legend_and_two_sentences(plan):
    text = shown(print_plan, plan, full=False)
    below = " ".join(text[text.index("band: → marks the one to observe in") :].split())
    assert "found: realisations in which the blind search finds the planet" in below
    assert len(re.findall(r"\.(?:\s|$)", below)) == 1  # how the prediction holds
    rolled = " ".join(shown(print_plan, plan.model_copy(update={"reference_library": "roll"}), full=False).split())
    assert "found: realisations in which the planet is significant at its known place" in rolled
    left = [LeftOutRow(name="tau Cet", rank=n, usable_h=0.0, message="not seen") for n in (1, 2)]
    period = PeriodRecord(start_utc="2028-01-01", n_days=3, pointing="default", left_out=left, not_checked=[])
    told = shown(print_plan, plan.model_copy(update={"period": period}), full=False)
    assert "2 stars left out for visibility: -v names them." in told


def test_etc(etc_answers):
    text = shown(print_etc, etc_answers)
    assert "τ Cet (HIP 8102): V 3.50 mag, 3.650 pc; wall time" in text
    assert "→ F520" in text
    assert "1.42 h" in text
    assert "limits the SNR to 7.1" in text
    assert "wall time for SNR 10" in shown(print_etc, etc_answers, asked="wall time for SNR 10")


def test_the_budget_adds_up_and_is_sorted(etc_answers):
    lines = shown(print_etc, etc_answers).splitlines()
    start = next(i for i, line in enumerate(lines) if line.startswith("Noise in F520 at 0.410″"))
    assert "81.2 e- rms under a signal of 812 e-" in lines[start]
    terms = [line.split("  ") for line in lines[start + 3 : start + 6]]
    assert [term[0] for term in terms] == ["speckles that the subtraction leaves", "planet's own light", "dark current"]
    shares = [float(line.split()[-2]) for line in lines[start + 3 : start + 6]]
    assert shares == [74.3, 24.3, 1.4]
    assert lines[start + 3].count("█") == 24
    assert not any("sky" in line for line in lines)  # below one part in two thousand


@pytest.mark.parametrize(("width", "cells"), [(120, 24), (80, 19), (62, 0)])
def test_bars_take_the_room_there_is(etc_answers, width, cells):
    lines = shown(print_etc, etc_answers, width=width).splitlines()
    line = next(line for line in lines if line.startswith("speckles that"))
    assert line.count("█") == cells
    assert line.split()[-1 if cells == 0 else -2] == "74.3"
    assert "planet's own light" in lines[lines.index(line) + 1]


def test_what_binds_and_what_would_help(etc_answers):
    text = " ".join(shown(print_etc, etc_answers, width=120).split())
    assert "The exposure is held by the longest frame of the camera; the EM gain is held by the gain register's" in text
    assert "What would raise the SNR: ×1.31 half the drift of the wavefront; longer visits would lower it" in text
    assert "EM gain up to" not in text
    explained = " ".join(shown(print_etc, etc_answers, width=120, explain=True).split())
    for words in (
        "In frames of 40.0 s:",
        "EM gain up to 1000 keeps",
        "EM gain up to 30.0 keeps bright",
        "no EM gain leaves every pixel",
    ):
        assert words in explained


def test_limits_have_their_column_where_there_is_room(etc_answers):
    assert "t: longest, g: register" in shown(print_etc, etc_answers, width=160)
    assert "held by " not in shown(print_etc, etc_answers, width=80).splitlines()[1]


def test_every_budget_on_request(etc_answers):
    twin = etc_answers.answers[0].model_copy(update={"band": "F720", "value": 6000.0})
    two = etc_answers.model_copy(update={"answers": [*etc_answers.answers, twin]})
    assert shown(print_etc, two).count("Noise in") == 1
    assert shown(print_etc, two, every_budget=True).count("Noise in") == 2


def test_nothing_reached_has_no_budget(etc_answers):
    none = etc_answers.model_copy(update={"answers": etc_answers.answers[1:], "best_band": None})
    text = shown(print_etc, none)
    assert "Noise in" not in text
    assert "→" not in text


def test_one_row_is_marked_among_several_separations(etc_answers):
    first = etc_answers.answers[0]
    slow = first.model_copy(update={"value": 9000.0, "separation_arcsec": 0.6})
    two = etc_answers.model_copy(update={"answers": [slow, first]})
    assert best_row(two) is first
    assert shown(print_etc, two).count("→") == 1
    snrs = [
        row.model_copy(update={"question": "signal_to_noise", "significance": s, "threshold": t})
        for row, s, t in ((first, 20.0, 10.0), (slow, 18.0, 6.0))
    ]
    assert best_row(etc_answers.model_copy(update={"answers": snrs})) is snrs[1]


def test_flags_are_words(etc_answers):
    text = " ".join(shown(print_etc, etc_answers).split())
    assert (
        "! a close companion is known but cannot be placed: its light is not included (companion_light_unknown)" in text
    )


def test_names_are_not_markup(rank):
    odd = rank.targets[0].model_copy(update={"name": "[bold]x[/bold] [/]"})
    assert "[bold]x[/bold]" in shown(print_rank, rank.model_copy(update={"targets": [odd]}))


def test_terminals_without_unicode_get_question_marks_not_errors(rank, plan, etc_answers, sensitivity, explanation):
    raw = io.BytesIO()
    stream = io.TextIOWrapper(raw, encoding="ascii")
    console = Console(file=stream, width=100, highlight=False)
    print_rank(rank, console)
    print_plan(plan, console)
    print_etc(etc_answers, console)
    print_sensitivity(sensitivity, console)
    print_explanation(explanation, console)
    stream.flush()
    assert b"margin" in raw.getvalue()
    assert b"########################" in raw.getvalue()


def printed(show, width=110):
    console = Console(file=io.StringIO(), width=width, highlight=False)
    show(console)
    return console.file.getvalue()


def result(count):
    rows = [
        SimulatedSequence(
            obsid=f"4{number:010d}",
            kind="SCI",
            target="a [red] star with a long name",
            camera="VIS",
            band="F520",
            exposure_s=0.01,
            n_frames=50,
            em_gain=20,
            start_utc="2028-01-01T00:00:00",
            role="reference",
            settings={},
            file=f"SCI/{61771 + number}/{number}.fits",
            truth=None,
            params="",
            adu_min=180,
            adu_max=16383,
            saturated_pixels=12345,
            clipped_pixels=0,
            cosmic_rays=77,
            size_bytes=12_300_000,
            sha256="",
        )
        for number in range(count)
    ]
    return SimulationResult(
        version="", config_hash="", name="x", description="", n_frames=1, size_bytes=1, sequences=rows
    )


def test_a_row_says_what_the_frames_hold():
    text = printed(lambda console: print_simulation(result(1), Path("out"), console))
    for word in ("x: 1 sequence", "40000000000", "SCI reference", "a [red] star", "F520", "50 × 0.01", "180–16383"):
        assert word in text
    for word in ("12\u202f345", "77", "12.3 MB", "out/SCI/61771/0.fits"):
        assert word in text


def test_visits_of_a_programme_are_listed_with_their_windows():
    def row(role, visit, window):
        return VisitRow(
            visit=visit,
            n_visits=2,
            role=role,
            window=window,
            folder=f"visit_00{visit}_{role}",
            file="",
            obsid="40000000001",
            band="F520",
            start_utc=f"2028-01-0{visit}T0{window}:00:00.123456",
            begin_mjd=61771.0,
            end_mjd=61771.1,
            n_frames=8 if window == 1 else 3,
            first_frame=0,
            exposure_s=30,
            em_gain=1,
            roll_deg=15,
            seed=1,
            streams=[],
        )

    programme = SimulatedProgramme(
        file="programme.json",
        target="a star",
        reference="another star",
        visits=2,
        reference_visits=1,
        reference_scheme="other_star",
        visit_gap_h=0,
        orbit_s=5553.6,
        span_days=1.104,
        sequences=[row("science", 1, 1), row("science", 1, 2), row("reference", 1, 1), row("science", 2, 1)],
    )
    whole = result(2).model_copy(update={"programmes": [programme]})
    text = printed(lambda console: print_simulation(whole, Path("out"), console))
    assert "a star: 2 science visits and 1 reference visit of another star" in text
    (first,) = [line.split() for line in text.splitlines() if line.startswith("visit_001_science")]
    assert first == ["visit_001_science", "F520", "2028-01-01T01:00:00", "11", "×", "30", "2", "15"]
    assert "The programme spans 1.10 days with the scheme other_star of references" in text
    assert "out/programme.json" in text


def test_long_runs_are_cut_and_say_so():
    text = printed(lambda console: print_simulation(result(60), Path("out"), console))
    assert "and 20 more: see out/simulation.json" in text
    assert "out/SCI/61771, out/SCI/61772, out/SCI/61773 and 57 more" in text


def test_narrow_terminals_keep_numbers():
    text = printed(lambda console: print_simulation(result(1), Path("out"), console), width=80)
    for word in ("40000000000", "50 × 0.01", "180–16383", "12.3 MB"):
        assert word in text


def test_plan_names_begin_and_cost():
    plan = simulation_estimate(load_simulation("calibration_set"))
    text = printed(lambda console: print_planned(plan, console, limit=3))
    for word in ("calibration_set: 15 sequences", "40000000003", "20 × 0", "2028-01-01T00:00:22", "and 12 more"):
        assert word in text
    for word in ("97 frames", "1 worker(s)", "disk"):
        assert word in text


def test_findings_are_grouped_by_file():
    findings = [
        FindingRecord(path="a.fits", hdu=1, keyword="DATASUM", message="is wrong", severity="error"),
        FindingRecord(path="a.fits", hdu=None, keyword="", message="is [red] old", severity="warning"),
        FindingRecord(path="b.fits", hdu=0, keyword="OBSID", message="is that of a.fits too", severity="error"),
    ]
    checked = CheckResult(paths=["."], n_files=2, n_errors=2, n_warnings=1, findings=findings)
    text = printed(lambda console: print_check(checked, console))
    assert text.count("a.fits\n") == 1
    for word in ("DATASUM", "is [red] old", "2 Level-0 files checked: 2 errors, 1 warning"):
        assert word in text


@pytest.mark.parametrize(("size", "text"), [(1500, "1.50 kB"), (2.5e6, "2.50 MB"), (3.21e9, "3.21 GB"), (0, "0 kB")])
def test_sizes(size, text):
    assert size_text(size) == text
