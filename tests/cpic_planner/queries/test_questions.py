"""One declaration of a field: its option, keyword, schema, YAML key and hash."""

import inspect
import json
from pathlib import Path
from typing import ClassVar

import pytest

import cpic_planner
from catalogs import band_from_file, open_catalogue
from cpic_core import InputError
from cpic_planner.api.keywords import takes
from cpic_planner.cli.command import command_of
from cpic_planner.cli.main import main
from cpic_planner.queries import (
    ConfirmQuestion,
    EtcQuestion,
    ImageQuestion,
    PlanQuestion,
    Question,
    RankQuestion,
    Strategy,
    asked,
    called_as,
    option_names,
    options_of,
)
from cpic_planner.schemas import QUESTIONS, generated
from simulator import load_instrument

BY_NAME = {name: __import__(path.split(":")[0], fromlist=["x"]) for name, path in QUESTIONS.items()}
MODELS = {name: getattr(BY_NAME[name], path.split(":")[1]) for name, path in QUESTIONS.items()}


class Warmer(PlanQuestion):
    """A plan with one more field, declared once."""

    KIND: ClassVar[str] = "warmer"

    tilt_deg: float = asked(0.5, "Tilt of the mirror.", ge=0, le=3)
    colour: str = asked("red", "Colour of the folder.", physics=False)


def told(*arguments):
    """The question that a command with these options gets."""
    seen = []

    def run(question: Warmer) -> None:
        """Remember."""
        seen.append(question)

    command_of(run, Warmer).main(list(arguments), standalone_mode=False)
    return seen[0] if seen else None


def test_the_drift_of_a_plan_is_an_option_that_reaches_its_images():
    plain, drifting = told("--top", "2"), told("--top", "2", "--drift-nm", "0.2")
    assert plain.instrument.drift.visit_nm == 0.05
    assert drifting.instrument.drift.visit_nm == pytest.approx(0.2, rel=1e-12)
    assert drifting.instrument.drift.walk_nm_per_sqrt_hour == pytest.approx(0.2, rel=1e-12)
    assert drifting.instrument.detector == plain.instrument.detector
    assert plain.content_hash != drifting.content_hash


def test_a_field_is_an_option_a_keyword_a_key_and_in_schema_and_hash(refused, tmp_path, capsys):
    plain, tilted = told("--top", "2"), told("--top", "2", "--tilt-deg", "2")
    assert (plain.tilt_deg, tilted.tilt_deg) == (0.5, 2.0)
    told("--help")
    help_text = " ".join(capsys.readouterr().out.split())
    assert "--tilt-deg <float> Tilt of the mirror. [default: 0.5; 0 to 3 deg]" in help_text

    @takes(Warmer)
    def warm(question: Warmer) -> Warmer:
        """Ask.

        Returns
        -------
        Warmer
        """
        return question

    assert inspect.signature(warm).parameters["tilt_deg"].default == 0.5
    assert warm(top=2, tilt_deg=2) == tilted
    assert "tilt_deg : float, optional\n    Tilt of the mirror (0 to 3 deg)." in warm.__doc__
    refused(r"^tilt_deg = 9 deg: .*0 to 3", warm, tilt_deg=9)
    refused(r"^--tilt-deg = 9.0 deg: .*0 to 3", told, "--tilt-deg", "9")

    schema = Warmer.model_json_schema()["properties"]["tilt_deg"]
    assert (schema["minimum"], schema["maximum"], schema["default"]) == (0, 3, 0.5)
    assert schema["description"] == "Tilt of the mirror."

    path = tmp_path / "mine.yaml"
    path.write_text("kind: question\ntop: 2\ntilt_deg: 2\nstrategy: {n_modes: 4}\n")
    read = told("--question", str(path))
    assert read.hashed() == Warmer.of({"top": 2, "tilt_deg": 2.0, "strategy": {"n_modes": 4}}).hashed()
    above = told("--question", str(path), "--tilt-deg", "1", "--library", "idealised")
    assert (above.tilt_deg, above.strategy) == (1.0, Strategy(n_modes=4, library="idealised"))

    assert plain.content_hash != tilted.content_hash
    painted = told("--top", "2", "--colour", "blue", "--workers", "3", "--force", "--out", "there")
    assert painted.content_hash == plain.content_hash


def test_words_about_a_field_are_in_no_hash():
    class One(Question):
        depth_um: float = asked(1.0, "How deep.", ge=0)

    class Other(Question):
        depth_um: float = asked(1.0, "How far it goes in.", ge=0, option="--deep", metavar="D", unit="micron")

    assert One(depth_um=2).content_hash == Other(depth_um=2).content_hash != One(depth_um=3).content_hash


WAYS = {
    "n_modes": ("--n-modes", 3),
    "reference_ratio": ("--reference-ratio", 0.5),
    "sigma": ("--threshold-sigma", 4.0),
    "annulus_lambda_d": ("--annulus-lambda-d", 2.5),
    "library": ("--library", "idealised"),
    "mode": ("--mode", "photon_counting"),
}


@pytest.mark.parametrize("field", WAYS)
def test_every_setting_of_a_strategy_has_one_name(field):
    """By option, by keyword, and in files."""
    option, value = WAYS[field]
    for name in ("etc", "rank", "plan", "confirm"):
        assert option_names(MODELS[name])[f"strategy.{field}"] == option
    question = EtcQuestion.of({"target": "tau Cet", "strategy": {field: value}})
    assert getattr(question.strategy, field) == value


@pytest.mark.parametrize("name", ["etc", "rank", "plan", "known"])
def test_what_is_wrong_in_the_file_of_an_instrument_is_said_of_that_option(name):
    assert option_names(MODELS[name])["instrument"] == "--instrument"
    assert option_names(MODELS[name])["instrument.changes"] == "--set"


def test_every_field_of_a_strategy_is_an_option():
    flags = {option.path[0] for option in options_of(Strategy)}
    assert flags == set(Strategy.model_fields)
    star = {option.path[1]: option.flag for option in options_of(Strategy) if len(option.path) > 1}
    assert star == {
        "v_mag": "--reference-v-mag",
        "teff_k": "--reference-teff-k",
        "log_g": "--reference-log-g",
        "metallicity": "--reference-metallicity",
    }


def test_two_sigmas_are_told_apart(capsys):
    assert main(["etc", "--help"]) == 0
    text = " ".join(capsys.readouterr().out.split())
    assert "--threshold-sigma, strategy.sigma" in text
    assert "cpic etc --sigma" in text
    arguments = ["etc", "tau Cet", "--band", "F520", "--separation-arcsec", "0.5", "--contrast-limit", "--json"]
    limits = []
    for more in (["--threshold-sigma", "3"], []):
        assert main([*arguments, *more]) == 0
        limits.append(json.loads(capsys.readouterr().out)["answers"][0])
    assert limits[0]["threshold"] < limits[1]["threshold"]
    assert limits[0]["value"] < limits[1]["value"]


@pytest.mark.parametrize("name", MODELS)
def test_options_of_a_question_have_names_of_their_own(name):
    options = list(options_of(MODELS[name]))
    flags = [option.flag for option in options]
    assert len(set(flags)) == len(flags)
    for option in options:
        assert option.text[:1].isupper() or option.text.startswith(("jupiter", "log10", "2:")), option
        assert "{" not in option.text or "{" + option.text.split("{")[1].split("}")[0] + "}" in option.text


@pytest.mark.parametrize("name", MODELS)
def test_schemas_of_questions_hold_every_field(refused, name, capsys):
    assert main(["schema", f"{name}-question"]) == 0
    schema = json.loads(capsys.readouterr().out)
    assert set(schema["properties"]) == set(MODELS[name].model_fields)
    refused("etc-question", generated, "nothing-question")


def test_refusals_name_what_the_reader_wrote(refused):
    tree = {"target": "tau Cet", "snr": 5.0, "time_s": 60.0}
    refused(r"^snr = given with time_s: .*one of the two", EtcQuestion.of, tree)
    with (
        pytest.raises(InputError, match=r"^--snr = given with --time-s: .*one of the two"),
        called_as(option_names(EtcQuestion)),
    ):
        EtcQuestion.of(tree)
    for where, key in ((PlanQuestion, "--roll-deg"), (RankQuestion, "--roll-deg")):
        with pytest.raises(InputError, match=f"^{key} = 300"), called_as(option_names(where)):
            where.of({"strategy": {"roll_deg": 300}})


@pytest.mark.parametrize(
    "name",
    [
        "stars.txt",
        "stars.parquet",
        "time_s.txt",
        "bands",
        "band.csv",
        "catalog",
        "catalog.dat",
        "instrument.csv",
        "date.txt",
    ],
)
@pytest.mark.parametrize(
    ("content", "said"),
    [("", "an empty file"), ("name\nHD 1\n", "one column"), ("name,v_mag,d,sp\nHD 1,x,10,G2V\n", "column v_mag = x")],
)
def test_files_are_named_as_they_are_called_and_not_as_an_option(tmp_path, name, content, said):
    (tmp_path / name).write_text(content)
    with pytest.raises(InputError, match=rf"^{name}( |:).*{said}"), called_as(option_names(RankQuestion)):
        open_catalogue(tmp_path / name)
    absent = tmp_path / "absent" / name
    with pytest.raises(InputError, match=f"^--catalog = {absent}"), called_as(option_names(RankQuestion)):
        open_catalogue(absent)


@pytest.mark.parametrize("name", ["band.txt", "time_s.dat", "snr"])
def test_curves_are_named_as_they_are_called_and_not_as_an_option(tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    Path(name).write_text("# nm\n500 0.5\n400 0.5\n450 0.5\n")
    for path in (name, tmp_path / name):
        with pytest.raises(InputError, match=f"^{name} line 4 wavelength = "), called_as(option_names(EtcQuestion)):
            band_from_file(path, "X", t_opt=0.5, qe=0.5)


def test_old_options_are_read_and_name_the_new_one(capsys):
    here = ["etc", "tau Cet", "--band", "F520", "--separation-arcsec", "0.5", "--json"]
    assert main([*here, "--photon-counting"]) == 0
    old = capsys.readouterr()
    assert old.err == "cpic: --photon-counting is now --mode photon_counting\n"
    assert main([*here, "--mode", "photon_counting"]) == 0
    assert capsys.readouterr().out == old.out


def test_images_are_hashed_by_what_they_do():
    """A name of the dial or the tolerance that means the same: one configuration."""
    nominal = load_instrument()
    by_name, by_value = (
        ImageQuestion(instrument=nominal, **dial) for dial in ({"fidelity": "reference"}, {"tolerance": 0.0})
    )
    assert by_name.hashed() == by_value.hashed()
    assert ImageQuestion(instrument=nominal, fidelity="standard").hashed() == ImageQuestion(instrument=nominal).hashed()
    assert ImageQuestion(instrument=nominal, tolerance=0.05).hashed() != by_value.hashed()
    assert ImageQuestion.of({"strategy": Strategy(n_modes=2)}) == ImageQuestion.of({"strategy": {"n_modes": 2}})


def test_images_refuse_what_they_cannot_measure(refused):
    counting = {"strategy": {"mode": "photon_counting"}, "fidelity": "reference"}
    refused("not yet frame by frame", ImageQuestion.of, counting)
    refused(r"tolerance.*fidelity.*one of the two", ImageQuestion.of, {"tolerance": 0.0, "fidelity": "quick"})
    with pytest.raises(InputError, match=r"audit.*every realisation frame by frame"):
        ConfirmQuestion.of({"scene": "paper_example", "fidelity": "reference", "audit": True})


@pytest.mark.parametrize("command", ["plan", "confirm"])
@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--fidelity", "quick", "--tolerance", "0.1"], ["--tolerance", "--fidelity", "one of the two"]),
        (["--tolerance", "0.6"], ["--tolerance", "0.6", "0 to 0.5"]),
        (["--tolerance", "nan"], ["--tolerance", "finite"]),
        (["--fidelity", "fast"], ["--fidelity", "quick", "reference"]),
        (["--simulator-overrides", "throughput=x9"], ["--simulator-overrides bands.*.t_opt = x9"]),
        (["--question", "nowhere.yaml"], ["nowhere.yaml"]),
    ],
)
def test_refusals_are_one_line(capsys, tmp_path, command, options, words):
    what = ["paper_example"] if command == "confirm" else []
    status = main([command, *what, *options, "--out", str(tmp_path / "o")])
    captured = capsys.readouterr()
    assert (status, captured.out, captured.err.count("\n")) == (2, "", 1)
    assert not (tmp_path / "o").exists()
    for word in words:
        assert word in captured.err


SIGNATURES = {
    "exposure_time": "target snr sigma detect separation_arcsec bands planet contrast exposure_s em_gain companions "
    "catalog instrument strategy fidelity tolerance realisations seed",
    "signal_to_noise": "target time_s separation_arcsec bands planet contrast exposure_s em_gain exact companions "
    "catalog instrument strategy fidelity tolerance realisations seed",
    "contrast_limit": "target time_s separation_arcsec bands sigma snr exposure_s em_gain exact companions catalog "
    "instrument strategy fidelity tolerance realisations seed",
    "optimise": "target time_s snr detect separation_arcsec bands planet companions catalog instrument strategy",
    "rank_targets": "time_s bands planet population n_planets seed score companions catalog instrument strategy "
    "v_mag_max dwarfs_only singles_only known_planets date_utc",
    "make_plan": "out top bands time_s planet strategy fidelity tolerance realisations simulator_overrides seed score "
    "population n_planets known_planets date_utc v_mag_max dwarfs_only singles_only companions catalog workers "
    "scheduler force instrument",
    "confirm_targets": "target time_s bands planet companions catalog instrument seed fidelity tolerance strategy "
    "realisations simulator_overrides workers",
    "confirm_scene": "scene bands time_s exposure_s n_frames em_gain instrument strategy realisations audit "
    "simulator_overrides fidelity tolerance seed workers scheduler out force",
    "simulate_products": "what out workers scheduler force truth instrument frames seed fidelity tolerance switches "
    "start_utc kind band exposure_s em_gain roll_deg star_offset_arcsec role camera level_e",
    "compare_strategies": "strategies out vary images workers scheduler force universes seed start_utc duration_days "
    "slot_days catalog instrument known_planets observed visibility background",
    "star_visibility": "target start_utc n_days step_days limits catalog instrument",
}


@pytest.mark.parametrize("name", SIGNATURES)
def test_public_functions_keep_their_keywords(name):
    function = getattr(cpic_planner, name)
    parameters = inspect.signature(function).parameters
    assert set(SIGNATURES[name].split()) <= set(parameters)
    for keyword in parameters:
        assert f"\n{keyword} : " in function.__doc__
    required = [item.name for item in parameters.values() if item.default is item.empty]
    assert required == {
        "signal_to_noise": ["target"],
        "contrast_limit": ["target"],
        "make_plan": ["out"],
        "confirm_scene": [],
        "rank_targets": [],
        "simulate_products": [],
        "compare_strategies": [],
    }.get(name, ["target"])


@pytest.mark.parametrize("model", [EtcQuestion, RankQuestion, PlanQuestion])
def test_a_band_that_is_given_twice_counts_once(model):
    given = {"target": "tau Cet"} if model is EtcQuestion else {}
    once, twice = (model.of(given | {"bands": bands}) for bands in (["F662", "F520"], ["F662", "F520", "F662"]))
    assert twice == once
    assert twice.band_names() == ("F662", "F520")
