import inspect
import json
import re
from shlex import split

import numpy as np
import pytest

from cpic_planner.api import closed_forms
from cpic_planner.cli.main import main
from cpic_planner.etc import band_law, build_model, contrast_limit, light_share, separation_grid
from cpic_planner.etc.questions import exposure_time, signal_to_noise
from cpic_planner.queries import EtcQuestion, Strategy
from cpic_planner.ranking import optimise
from cpic_planner.results import EtcStarsResult
from cpic_planner.targets import find_target
from simulator.config import load_instrument

COMMAND = "etc"


def answers(done, *arguments):
    out, _ = done(*arguments, "--json")
    return json.loads(out)["answers"]


@pytest.fixture(scope="module")
def star():
    return find_target("tau Cet")[0]


@pytest.fixture(scope="module")
def model():
    return build_model(load_instrument())


HERE = ["tau Cet", "--band", "F520", "--separation-arcsec", "0.5"]


def test_three_levels_of_a_time(done, model, star):
    where = {"separation_arcsec": 0.5, "bands": ["F520"]}
    for options, level in (
        (["--snr", "7"], {"snr": 7.0}),
        (["--sigma", "4"], {"sigma": 4.0}),
        (["--detect"], {"detect": True}),
    ):
        (told,) = answers(done, *HERE, *options)
        (known,) = exposure_time(build_model(load_instrument(), ["F520"]), star, **level, **where)
        assert told["question"] == "exposure_time"
        assert told["value"] == pytest.approx(known.value, rel=1e-12)


def test_three_levels_of_a_limit(done, star):
    model = build_model(load_instrument(), ["F520"])
    for options, level in (
        (["--snr", "5"], {"snr": 5.0}),
        (["--sigma", "5"], {"sigma": 5.0}),
        ([], {}),
        (["--detect"], {}),
    ):
        (told,) = answers(done, *HERE, "--contrast-limit", "--time-s", "7200", *options)
        (known,) = contrast_limit(model, star, time_s=7200.0, separation_arcsec=0.5, **level)
        assert told["value"] == pytest.approx(known.value, rel=1e-12)
    (photometry,) = answers(done, *HERE, "--contrast-limit", "--snr", "5")
    (plain,) = answers(done, *HERE, "--contrast-limit", "--sigma", "5")
    assert photometry["snr"] == pytest.approx(5.0, rel=1e-9)
    assert plain["significance"] == pytest.approx(5.0, rel=1e-9)
    assert photometry["value"] > plain["value"]


def test_a_limit_and_a_time_are_inverse(done):
    (limit,) = answers(done, *HERE, "--contrast-limit", "--snr", "5", "--time-s", "3600")
    (time,) = answers(done, *HERE, "--snr", "5", "--contrast", repr(limit["value"]))
    assert time["value"] <= 3600.0 * (1 + 1e-9)
    assert time["snr"] == pytest.approx(5.0, rel=1e-6)


def test_several_separations_and_contrasts_pair_up(done):
    rows = answers(
        done,
        *split(
            "'tau Cet' --band F520 --band F662 --separation-arcsec 0.5 --separation-arcsec 0.7 --contrast "
            "1e-8 --contrast 2e-8"
        ),
    )
    assert [(row["band"], row["separation_arcsec"], row["contrast"]) for row in rows] == [
        ("F520", 0.5, 1e-8),
        ("F520", 0.7, 2e-8),
        ("F662", 0.5, 1e-8),
        ("F662", 0.7, 2e-8),
    ]
    alone = answers(done, "tau Cet", "--band", "F662", "--separation-arcsec", "0.7", "--contrast", "2e-8")
    assert rows[3]["value"] == pytest.approx(alone[0]["value"], rel=1e-12)
    free = answers(done, "tau Cet", "--band", "F520", "--contrast", "1e-9", "--contrast", "1e-8")
    assert [row["contrast"] for row in free] == [1e-9, 1e-8]


def over_half(model, answer):
    """Significance of an answer over that of half of the planets, by the terms of its noise."""
    terms = answer.budget
    quiet = (terms["signal_e"] / answer.significance) ** 2
    speckles = sum(terms[name] for name in ("speckle_e2", "common_speckle_e2", "companion_wings_e2"))
    place, visit_s = answer.separation_arcsec, answer.frames_per_visit * (answer.exposure_s + 1.1)
    lit = light_share(model, answer.band, place, visit_s) * terms["speckle_e2"] / speckles
    half = band_law(model, answer.band).half(place, speckles / quiet, lit, answer.independent_visits, at_place=False)
    return answer.significance / float(half)


@pytest.mark.parametrize(
    "level",
    [
        {"time_s": 20000.0},
        {"snr": 7.0},
        {"detect": True},
        {"time_s": 20000.0, "contrast_limit": True},
        {"time_s": 20000.0, "contrast_limit": True, "snr": 5.0},
        {"sigma": 3.0},
    ],
)
def test_the_best_place_has_no_better_neighbour(model, star, level):
    question = EtcQuestion.of(level | {"target": "tau Cet"})
    one = build_model(load_instrument(), ["F662"])
    (best,) = closed_forms(question, one, star)
    grid = separation_grid(one, "F662")
    others = closed_forms(question.model_copy(update={"separation_arcsec": tuple(grid)}), one, star)
    if question.contrast_limit or question.asks_time:
        values = [other.value for other in others if other.value is not None]
        assert best.value <= min(values) * 1.01
    else:
        # It is the place of clearest detection in the visits that are best for it; those of highest SNR are fewer.
        clearest = np.zeros(len(grid))
        for visits in (8, 11, 13, 15, 17, 20):
            many = build_model(load_instrument(), ["F662"], Strategy(visits=visits))
            them = closed_forms(question.model_copy(update={"separation_arcsec": tuple(grid)}), many, star)
            clearest = np.maximum(clearest, [0.0 if one.value is None else over_half(many, one) for one in them])
        place = np.argmin(np.abs(grid - best.separation_arcsec))
        assert grid[place] == pytest.approx(best.separation_arcsec, rel=1e-9)
        assert clearest[place] >= clearest.max() * 0.99


def test_the_best_place_is_that_of_the_ranking(model, star):
    for answer in closed_forms(EtcQuestion.of({"target": "tau Cet"}), model, star):
        ranked = optimise(model, star, time_s=36000.0, bands=[answer.band])
        assert answer.separation_arcsec == pytest.approx(ranked.separation_arcsec[0], rel=0.03)


def test_out_of_reach_the_place_is_where_most_is_reached(model, star):
    one = build_model(load_instrument(), ["F662"])
    (answer,) = closed_forms(EtcQuestion.of({"target": "tau Cet", "snr": 1000.0}), one, star)
    assert answer.reason == "common_speckle_floor"
    most = float(re.search(r"the most is ([\d.]+)", answer.message)[1])
    everywhere = {"target": "tau Cet", "time_s": 1e9, "separation_arcsec": separation_grid(one, "F662")}
    everywhere["strategy"] = {"visits": 1000}
    for other in closed_forms(EtcQuestion.of(everywhere), one, star):
        assert other.snr <= most * 1.005


def test_frames_set_the_time_in_every_band(done):
    rows = answers(done, *split("'tau Cet' --exposure-s 17 --frames 30 --separation-arcsec 0.6 --reference-ratio 2"))
    model = build_model(load_instrument())
    for row in rows:
        assert (row["exposure_s"], row["n_frames"]) == (17.0, 30)
        pace = 17.0 + model.camera(row["band"]).readout_s
        assert row["time_s"] == pytest.approx(model.instrument.overhead_s + 3 * 30 * pace)
    limits = answers(done, *HERE, "--exposure-s", "17", "--frames", "30", "--contrast-limit", "--snr", "5")
    assert limits[0]["n_frames"] == 30


def test_strategies_reach_the_calculator(done, star):
    plain = answers(done, *HERE)[0]["value"]
    ideal = answers(done, *HERE, "--library", "idealised")[0]
    assert ideal["value"] > plain
    assert "idealised" in ideal["flags"]
    faint = answers(done, *HERE, "--library", "reference_star", "--reference-v-mag", "8")[0]
    bright = answers(done, *HERE, "--library", "reference_star", "--reference-v-mag", "1.5")[0]
    assert faint["value"] < bright["value"]
    dusty = answers(done, *HERE, "--exozodi", "20")[0]
    assert dusty["budget"]["exozodi_e2"] > 0
    assert dusty["value"] < plain
    counted = answers(done, *HERE, "--mode", "photon_counting", "--counting-sigma", "4")[0]
    strategy = Strategy(mode="photon_counting", counting_sigma=4.0)
    (known,) = signal_to_noise(
        build_model(load_instrument(), ["F520"], strategy), star, time_s=36000.0, separation_arcsec=0.5
    )
    assert counted["value"] == pytest.approx(known.value, rel=1e-12)
    rolled = answers(
        done, "tau Cet", "--band", "F520", "--separation-arcsec", "0.6", "--library", "roll", "--roll-deg", "20"
    )
    assert rolled[0]["status"] == "ok"


def test_several_stars_are_answered_as_each_alone(done):
    asked = ["--band", "F520", "--band", "F662", "--time", "5h"]
    names = ["tau Cet", "eps Eri b", "HIP 71681"]
    out, _ = done(*names, *asked, "--json")
    together = json.loads(out)
    alone = [json.loads(done(name, *asked, "--json")[0]) for name in names]
    assert together["answers"] == [row for one in alone for row in one["answers"]]
    assert [star["planet"] for star in together["stars"]] == [None, "eps Eri b", None]
    for star, one in zip(together["stars"], alone, strict=True):
        assert {name: star[name] for name in ("target", "hip", "best_band", "note")} == {
            name: one[name] for name in ("target", "hip", "best_band", "note")
        }
    # Its record of stated errors counts through the answers of all stars.
    assert [item["answer"] for item in together["fidelity"]["answers"]] == [
        number for number, row in enumerate(together["answers"]) if row["n_frames"] is not None
    ]
    assert together["config_hash"] not in [one["config_hash"] for one in alone]
    frame = EtcStarsResult.model_validate(together).to_pandas()
    assert frame["target"].tolist() == [row["target"] for row in together["answers"]]
    out, _ = done(*names, *asked, "--columns", "target,band,value", "--format", "csv")
    lines = [f"{row['target']},{row['band']}," for row in together["answers"]]
    assert [line[: len(begin)] for line, begin in zip(out.splitlines()[1:], lines, strict=True)] == lines


def test_the_table_of_several_stars_says_who_is_detected_and_what_limits_the_others(done):
    out, _ = done("tau Cet", "eps Ind", "eps Eri", "--band", "F520", "--time", "5h", "--contrast", "2.8e-9")
    text = " ".join(out.split())
    verdicts = [
        row["verdict"]
        for row in answers(done, *split("'tau Cet' 'eps Ind' 'eps Eri' --band F520 --time 5h --contrast 2.8e-9"))
    ]
    assert verdicts == ["detected", "measured_not_detected", "detected"]
    assert "knows no place: τ Cet, ε Eri." in text
    assert "in the best one limited: ε Ind" in text
    assert "3 targets; SNR in 5.00 h" in text


def test_checks_in_images_name_the_star(done):
    asked = "'tau Cet' 'eps Ind' --band F520 --time-s 3600 --fidelity standard --realisations 2"
    rows = [line.split()[:3] for line in done(*split(asked))[0].partition("Checked in images")[2].splitlines()]
    assert [row[:3] for row in rows if row[2:] == ["F520"]] == [["τ", "Cet", "F520"], ["ε", "Ind", "F520"]]


@pytest.mark.parametrize("option", ["--budget", "--explain", "--plot=x.png"])
def test_what_is_about_one_star_is_refused_of_several(refuses, option):
    refuses(["tau Cet", "eps Ind", option], [option.partition("=")[0], "2 targets"])


def test_drawn_instruments_are_those_of_modelled_optics(refuses):
    refuses(["tau Cet", "--instrument", "hwo_like", "--instruments", "3"], ["coronagraph.table", "no ensemble"])


def test_a_name_without_quotation_marks_is_told(refuses):
    refuses(["tau", "Cet"], ["star = tau", "TARGET of several words stands in quotation marks"])


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--snr", "5", "--sigma", "5"], ["--snr", "--sigma"]),
        (["--snr", "5", "--detect"], ["--snr", "--detect"]),
        (["--detect", "--time-s", "100"], ["--detect", "--time-s"]),
        (["--sigma", "5", "--exposure-s", "3", "--frames", "5"], ["--sigma", "--frames"]),
        (["--sigma", "0"], ["sigma", "1e-06"]),
        (["--sigma", "nan"], ["sigma", "finite"]),
        (["--contrast-limit", "--snr", "0"], ["snr", "0.001"]),
        (["--contrast-limit", "--snr", "5", "--sigma", "5"], ["--snr", "--sigma"]),
        (["--contrast-limit", "--contrast", "1e-9"], ["--contrast"]),
        (["--contrast", "2"], ["contrast", "0 to 1"]),
        (["--separation-arcsec", "-0.5"], ["--separation-arcsec", "-0.5"]),
        (["--separation-arcsec", "0.5", "--semi-major-axis-au", "2"], ["--separation-arcsec", "--semi-major-axis-au"]),
        (
            [*split("--separation-arcsec 0.5 --separation-arcsec 0.6 --contrast 1e-9 --contrast 1e-9 --contrast 1e-9")],
            ["--contrast", "3 times", "2 times"],
        ),
        (["--library", "reference_star"], ["--reference-v-mag", "missing"]),
        (["--library", "reference_star", "--reference-v-mag", "60"], ["--reference-v-mag", "60", "-30 to 40"]),
        (
            ["--library", "reference_star", "--reference-v-mag", "3", "--reference-teff-k", "9"],
            ["--reference-teff-k", "1000"],
        ),
        (["--reference-v-mag", "3"], ["--reference-v-mag", "--library reference_star"]),
        (["--reference-teff-k", "5000"], ["--reference-teff-k", "--library reference_star"]),
        (["--roll-deg", "20"], ["--roll-deg", "--library roll"]),
        (["--library", "roll", "--roll-deg", "0"], ["--roll-deg", "0", "180"]),
        (["--library", "roll", "--reference-ratio", "2"], ["--reference-ratio", "--library roll"]),
        (["--reference-ratio", "0"], ["--reference-ratio", "0"]),
        (["--counting-sigma", "4"], ["--counting-sigma", "--mode photon_counting"]),
        (["--mode", "photon_counting", "--counting-sigma", "-1"], ["--counting-sigma", "-1"]),
        (["--mode", "photon_counting", "--band", "F940"], ["--mode", "photon_counting", "F940", "register"]),
        (["--exozodi", "-1"], ["--exozodi = -1", "zodi"]),
        (["--exozodi", "nan"], ["--exozodi", "finite"]),
        (["--plot", "x.gif"], ["--plot", "x.gif", "png"]),
        (["--plot", "no/such/folder/x.png"], ["--plot", "writable"]),
        (["--json", "--explain"], ["--explain", "--json"]),
        (["--json", "--budget"], ["--budget", "--json"]),
        (["--time-s", "inf"], ["--time-s", "finite"]),
        (["--exposure-s", "0"], ["--exposure-s"]),
        (["--em-gain", "0.5"], ["--em-gain", "1 to"]),
    ],
)
def test_contradictions_and_bad_numbers_are_one_line(refuses, options, words):
    refuses(["tau Cet", *options], words)


@pytest.mark.parametrize(
    "options", [["--snr", "8"], ["--contrast-limit", "--sigma", "5"], [], ["--contrast", "1e-9", "--contrast", "1e-8"]]
)
def test_plots(done, tmp_path, options):
    path = tmp_path / "answer.png"
    out, err = done("tau Cet", "--band", "F520", *options, "--plot", str(path), "--json")
    assert path.read_bytes().startswith(b"\x89PNG")
    assert f"wrote {path}" in err
    assert json.loads(out)["kind"] == "etc"


@pytest.mark.long
def test_examples_of_the_help_work(capsys, tmp_path, monkeypatch):
    import shlex

    from cpic_planner.cli.star_commands import etc

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("cpic_planner.confirm.etc_images.AIM", 0.3)  # images as few as will do
    monkeypatch.setattr("cpic_planner.confirm.etc_images.FEWEST", 2)
    (tmp_path / "my_stars.csv").write_text("name,distance_pc,v_mag,sp_type\nmy star,5,4,G2V\n")
    examples = re.findall(r"^  cpic (.*)$", inspect.getdoc(etc), re.M)
    assert len(examples) >= 9
    for example in examples:
        assert main(shlex.split(example)) == 0, example
    assert (tmp_path / "limit.png").exists()
    capsys.readouterr()


def test_quick_is_the_answer_without_a_dial(call):
    plain = json.loads(call(*HERE, "--snr", "5", "--json")[1])
    quick = json.loads(call(*HERE, "--snr", "5", "--fidelity", "quick", "--json")[1])
    assert plain == quick
    assert plain["fidelity"]["fidelity"] == "quick"
    (record,) = plain["fidelity"]["answers"]
    assert record["images"] is None
    assert 0.014 < record["closed_form_error"]["snr"] < 0.2
    assert call(*HERE, "--snr", "5") == call(*HERE, "--snr", "5", "--fidelity", "quick")


@pytest.mark.long
def test_standard_checks_every_answer_in_images(call):
    asked = [*HERE, "--separation-arcsec", "0.05", "--time-s", "3600", "--fidelity", "standard", "--realisations", "2"]
    result = json.loads(call(*asked, "--json")[1])
    assert len(result["answers"]) == 2
    (record,) = result["fidelity"]["answers"]
    assert (record["answer"], record["status"], record["fidelity"]) == (0, "ok", "standard")
    assert record["images"]["draw"] == "sums"
    assert record["images"]["modelled"]["effects"]
    assert result["fidelity"]["seed"] == 1
    values = [row["value"] for row in result["answers"]]
    closed = json.loads(call(*asked[:-4], "--json")[1])
    assert values == [row["value"] for row in closed["answers"]]
    assert result["config_hash"] != closed["config_hash"]
    other = json.loads(call(*asked, "--seed", "2", "--json")[1])
    assert other["config_hash"] != result["config_hash"]
    assert other["fidelity"]["answers"][0]["images"]["snr"] != record["images"]["snr"]


def test_a_contrast_limit_is_checked_by_a_planet_at_the_limit(call):
    asked = [*HERE, "--contrast-limit", "--time-s", "3600", "--fidelity", "standard", "--realisations", "2"]
    result = json.loads(call(*asked, "--json")[1])
    (record,) = result["fidelity"]["answers"]
    images = record["images"]
    assert images["light_ratio"] == pytest.approx(1.0, abs=0.005)
    # Of a stack half of the detections lie below the threshold of one visit.
    assert images["predicted_significance"] == pytest.approx(result["answers"][0]["significance"], rel=0.02)


def test_a_tolerance_makes_images_only_where_it_has_to(call, done):
    status, text, err = call(*HERE, "--time-s", "3600", "--tolerance", "0.2")
    assert (status, err) == (0, "")
    assert "F520 at 0.500″: closed forms are enough" in text
    assert "Checked in images" not in text
    result = json.loads(call(*HERE, "--time-s", "3600", "--tolerance", "0.0001", "--json")[1])
    (record,) = result["fidelity"]["answers"]
    assert (record["status"], record["reason"]) == ("invalid", "tolerance_not_met")
    assert result["fidelity"]["tolerance"] == 0.0001
    text, _ = done(*HERE, "--time-s", "3600", "--tolerance", "0.0001")
    assert "tolerance not met" in text
    assert record["message"].split(":")[0] in " ".join(text.split())


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--fidelity", "best"], ["--fidelity", "best"]),
        (["--fidelity", "quick", "--tolerance", "0.1"], ["--tolerance", "--fidelity", "one dial"]),
        (["--tolerance", "0.6"], ["--tolerance", "0.6", "0 to 0.5"]),
        (["--tolerance", "nan"], ["--tolerance", "nan"]),
        (["--realisations", "5"], ["--realisations", "5", "--fidelity standard"]),
        (["--realisations", "5", "--tolerance", "0.1"], ["--realisations", "5", "--fidelity standard"]),
        (["--realisations", "0", "--fidelity", "standard"], ["--realisations", "1"]),
        (["--seed", "5"], ["--seed", "5", "--fidelity standard"]),
        (["--ensemble", "default"], ["--ensemble", "given", "--instruments"]),
        (["--ensemble", "none", "--instruments", "3"], ["--ensemble", "none", "default"]),
        (["--instruments", "1"], ["--instruments", "2"]),
        (["--seed", "-1", "--fidelity", "standard"], ["--seed", "0"]),
    ],
)
def test_the_dial_refuses_in_one_line(refuses, options, words):
    refuses([*HERE, *options], words)
