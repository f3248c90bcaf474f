"""Registries: one entry is enough for a choice by name, everywhere."""

import contextlib
import io
import json
import re
import subprocess
import sys
from dataclasses import replace
from types import MappingProxyType

import numpy as np
import pytest
from pydantic import BaseModel, TypeAdapter, ValidationError
from rich.console import Console

from cpic_core import InputError, Registry, special
from cpic_planner import validation
from cpic_planner.confirm import confirm_scene
from cpic_planner.etc import aperture_rates, build_model, stack_noise
from cpic_planner.etc.questions import contrast_limit, exposure_time, signal_to_noise
from cpic_planner.planets import PopulationChoice
from cpic_planner.queries import ConfirmQuestion, ReferencePlanet, Strategy
from cpic_planner.queries.shared import LIBRARIES, Library, LibraryNoise
from cpic_planner.ranking import explain_star, rank_targets
from cpic_planner.registry import REDUCTIONS, SCORES, Reduction, Score, ScoreName, StarNumbers
from cpic_planner.report import explanation_blocks, print_blocks, rank_blocks
from cpic_planner.report.words import flag_text
from cpic_planner.results import Explanation, RankResult
from cpic_planner.targets import find_target, rank_sample
from cpic_planner.validation import prepare_task, visit_pair
from simulator.config import load_instrument, load_scene

FEW = rank_sample(v_mag_max=2.5)
SMALL = PopulationChoice(PopulationChoice.default().config, n_planets=50)
BRIGHTNESS = Score(
    name="planet_brightness",
    label="−log P",
    meaning="minus log10 of the contrast of the reference planet, less one",
    aim="how bright a reference planet is",
    unit="dex",
    value=lambda numbers: 1.0 + np.log10(numbers.contrast),
    from_zero=False,
    decimals=3,
)


class Master(Library):
    """Frames of many stars: they cost no time of their own and their noise is a tenth."""

    name = "master"
    meaning = "a master of many stars"
    searched = "searched blind, over a master of many stars,"
    caveats = MappingProxyType({"master_of_many": "the stars of the master are not modelled"})

    def time_factor(self, settings):
        return 1.0

    def noise(self, settings, star_e_s, rate_e_s):
        one = np.ones(1)
        return LibraryNoise(0.1 * one, 0.1 * one, 0.1 * one, 0.0, one, 1.0, 1.0)

    def reference_scene(self, settings, scene):
        return replace_star(scene.without_planets(), v_mag=4.0)


def replace_star(scene, **changes):
    return scene.model_copy(update={"cstar": scene.cstar.model_copy(update=changes)})


def reference_noise_e2(model, star):
    place = np.array([[0.4]])
    rates = aperture_rates(model, star, "F520", place, place, np.array([[1e-8]]))
    return float(stack_noise(rates, 10.0, 100.0, 100.0, model.camera("F520")).terms["reference"][0, 0])


def printed(blocks):
    console = Console(width=110, record=True, file=io.StringIO())
    print_blocks(blocks, console, full=True)
    return " ".join(console.export_text().split())


def test_a_registry_is_a_type():
    class Choice(BaseModel):
        score: ScoreName

    assert Choice(score="completeness").score == "completeness"
    for wrong in ("best", 3, None):
        with pytest.raises(ValidationError, match="Input should be 'completeness_per_hour', .* or 'contrast_limit'"):
            Choice(score=wrong)
    assert TypeAdapter(ScoreName).json_schema() == {"enum": list(SCORES), "type": "string"}
    with SCORES.holding(BRIGHTNESS):
        assert Choice(score="planet_brightness").score == "planet_brightness"
        assert TypeAdapter(ScoreName).json_schema()["enum"][-1] == "planet_brightness"
    assert "planet_brightness" not in SCORES


def test_names_are_unique_and_unknown_ones_refused(refused):
    registry = Registry("score", [BRIGHTNESS])
    assert registry.choices() == tuple(registry) == ("planet_brightness",)
    assert len(registry) == 1
    refused("^score = planet_brightness", registry.register, BRIGHTNESS)
    for wrong in ("best", ["best"]):
        assert wrong not in registry
        with pytest.raises(InputError, match=r"^score = .*best.*planet_brightness"):
            registry[wrong]
    with pytest.raises(ValueError, match="stop"), registry.holding(replace(BRIGHTNESS, name="other")):
        raise ValueError("stop")
    assert registry.choices() == ("planet_brightness",)


@pytest.mark.parametrize("registry", [SCORES, LIBRARIES, REDUCTIONS], ids=lambda registry: registry.key)
def test_every_entry_is_worded(registry):
    for name, entry in registry.items():
        assert entry.name == name
        assert len(entry.meaning) > 20 or name == "none"
        assert not entry.meaning.endswith(".")
    assert all(len(entry.label) <= 8 and entry.aim for entry in SCORES.values())
    assert all(entry.found and entry.searched for entry in LIBRARIES.values())


def test_completeness_of_a_band_that_must_not_win():
    """By hand: two bands, two stars; the second band counts for nothing."""
    nothing = np.zeros(2)
    numbers = StarNumbers(
        completeness=np.array([[0.2, 0.0], [-1.0, -1.0]]),
        completeness_per_hour=np.array([[0.1, 0.0], [-1.0, -1.0]]),
        detections_per_hour=nothing,
        margin=nothing,
        snr=nothing,
        significance=nothing,
        contrast=nothing,
        deepest_limit=np.array([1e-8, np.inf]),
        time_s=nothing,
    )
    assert SCORES["completeness"].value(numbers).tolist() == [0.2, 0.0]
    assert SCORES["completeness_per_hour"].value(numbers).tolist() == [0.1, 0.0]
    assert SCORES["contrast_limit"].value(numbers).tolist() == [8.0, -99.0]


def test_a_score_is_one_entry(refused):
    """Ranked by it, explained by it, written and read, and on the console."""
    model = build_model(load_instrument(), ["F520"])
    with SCORES.holding(BRIGHTNESS):
        asked = {"time_s": 7200.0, "population": SMALL, "score": "planet_brightness"}
        result = rank_targets(model, FEW, **asked)
        assert [row.score for row in result.targets] == pytest.approx(
            sorted((1.0 + np.log10(row.contrast) for row in result.targets), reverse=True), rel=1e-12
        )
        assert RankResult.model_validate_json(result.model_dump_json()) == result
        words = printed(rank_blocks(result))
        assert "by planet brightness" in words
        assert "−log P" in words
        assert f"Score: {BRIGHTNESS.meaning}." in words
        first = result.targets[0]
        assert f" {first.score:.3f} ".replace("-", "−") in words
        told = explain_star(model, FEW, first.name, **asked)
        assert told.sentences[0].startswith(f"Rank 1 of {len(FEW)} by planet brightness: ")
        assert Explanation.model_validate_json(told.model_dump_json()) == told
        assert "by planet brightness" in printed(explanation_blocks(told))
    refused("^score = planet_brightness", rank_targets, model, FEW, **asked)


def test_a_library_is_one_entry():
    """In the calculator, in images, in words; its time and its noise by hand."""
    star, _ = find_target("tau Cet")
    with LIBRARIES.holding(Master()):
        strategy = Strategy(library="master")
        model, plain = (build_model(load_instrument(), ["F520"], each) for each in (strategy, Strategy()))
        assert model.time_s(100.0) - model.instrument.overhead_s == 100.0
        assert model.visit_s(100.0) == pytest.approx(2.0 * plain.visit_s(100.0))
        best, same = (reference_noise_e2(each, star) for each in (model, plain))
        assert best == pytest.approx(0.1 * same, rel=1e-9)
        assert "master_of_many" in signal_to_noise(model, star, time_s=3600.0, separation_arcsec=0.5)[0].flags
        assert flag_text("master_of_many") == "the stars of the master are not modelled"
        task = prepare_task(model, star, "F520", time_s=1800.0, planet=ReferencePlanet(), seed=5, fidelity="quick")
        visits = visit_pair(task)
        assert visits.strategy.library == "master"
        assert visits.reference.scene.cstar.v_mag == 4.0
        assert visits.scale == pytest.approx(10 ** (-0.4 * (float(star.v_mag[0]) - 4.0)), rel=1e-9)
        reduced = visits.draw(0).reduced
        assert np.isfinite(reduced.image_e[reduced.region]).all()


class MedianOfReferences(Reduction):
    """The median of the references in every pixel; the noise of a median by order statistics."""

    name = "median"
    meaning = "the median of the reference images in every pixel"
    needs_images = True
    predicted = False

    def combined(self, references):
        return np.median(references, axis=0)

    def reference_variance(self, images, n_modes):
        """Return the variance of a median of normal numbers over that of their mean: pi / 2 of many."""
        x = np.linspace(-12.0, 12.0, 4001)
        below, density = special().ndtr(x), np.exp(-0.5 * x**2) / np.sqrt(2.0 * np.pi)
        if images % 2 == 0:  # near enough: exact for odd numbers
            return 0.5 * (self.reference_variance(images - 1, 0) + self.reference_variance(images + 1, 0))
        half = images // 2
        law = density * (below * (1.0 - below)) ** half
        return float(images * np.sum(law * x**2) / np.sum(law))


def test_the_noise_of_a_median():
    """By hand: one number is its own median, of three 1.3462 (Harter), of many pi / 2; and drawn ones."""
    median = MedianOfReferences()
    assert [median.reference_variance(n, 0) for n in (1, 3)] == pytest.approx([1.0, 3 * 0.448671], rel=1e-5)
    assert median.reference_variance(201, 0) == pytest.approx(np.pi / 2, rel=0.005)
    drawn = np.random.default_rng(1).standard_normal((7, 200_000))
    assert 7 * median.combined(drawn).var() == pytest.approx(median.reference_variance(7, 0), rel=0.01)


@pytest.mark.parametrize("entry", [MedianOfReferences(), *REDUCTIONS.values()], ids=lambda entry: entry.name)
def test_a_reduction_is_one_entry(entry, refused, tmp_path):
    """Images use it, and the calculator predicts it or refuses it in one line: nothing disagrees silently."""
    planet = {"name": "b", "radius_rjup": 4.0, "distance_au": 7.0, "separation_arcsec": 0.6, "pa_deg": 315.0}
    tree = {"cstar": {"v_mag": 4.0, "spectral_type": "G2V"}, "planets": [planet | {"phase_deg": 70.0, "albedo": 0.5}]}
    scene = load_scene({"name": "drill"} | tree)
    with REDUCTIONS.holding(entry) if entry.name not in REDUCTIONS else contextlib.nullcontext():
        strategy = Strategy(centring=entry.name, visits=3)
        frames = {"exposure_s": 20.0, "n_frames": 20, "em_gain": 100.0, "fidelity": "quick", "realisations": 2}
        question = ConfirmQuestion(scene=scene, bands=("F662",), strategy=strategy, **frames)
        (band,) = confirm_scene(question).result.bands
        assert (band.predicted_snr is None) == (not entry.predicted)
        assert band.recovered_snr is not None
        task = validation.ConfirmTask(**images_of_drill(question))
        stack = visit_pair(task).draw(0).reduced
        expected = stack.inputs.science_e.copy()[stack.region][None]
        library = stack.inputs.library_e[:, stack.region]
        entry.centre(expected, library)
        assert stack.inputs.frames * expected[0] == pytest.approx(stack.image_e[stack.region], rel=1e-9, abs=1e-9)
        assert stack.rdi.centering == entry.name
        model, star = build_model(load_instrument(), ["F662"], strategy), find_target("tau Cet")[0]
        asked = {"separation_arcsec": 0.5, "time_s": 3600.0}
        if entry.predicted:
            assert signal_to_noise(model, star, **asked)[0].centring == entry.name
            return
        why = "^centring = .*; allowed: temporal .*no closed form"
        refused(why, signal_to_noise, model, star, **asked)
        refused(why, contrast_limit, model, star, **asked)
        refused(why, exposure_time, model, star, separation_arcsec=0.5, snr=5.0)
        refused(why, rank_targets, model, FEW, time_s=3600.0, population=SMALL)


@pytest.mark.parametrize("modes", [0, 2])
def test_rolls_are_reduced_by_the_same_entry(modes):
    """What the forward model leaves of a planet is what the subtraction does: exact where it follows the references."""
    rng, (y, x) = np.random.default_rng(2), np.indices((31, 31))
    waves = 50.0 * np.abs(rng.normal(size=(2, 31, 31)))
    first, second = (
        np.stack([waves[0] + rng.normal() * waves[1] + rng.normal(size=(31, 31)) for _ in range(7)]) for _ in range(2)
    )
    planets = [np.exp(-((x - column) ** 2 + (y - row) ** 2) / 4.0) for column, row in ((21, 15), (15, 21))]
    with REDUCTIONS.holding(MedianOfReferences()):
        shown = first + 30.0 * planets[0], second + 30.0 * planets[1]
        lit, dark = (
            validation.roll_subtract(*images, modes, centering="median") for images in (shown, (first, second))
        )
        expected = dark.project(*planets)
        for number in range(2):
            left = (lit.image_e[number] - dark.image_e[number]) / (30.0 * 7.0)
            assert left == pytest.approx(expected[number], abs=1e-11)


def images_of_drill(question):
    """The one task of the question."""
    model = build_model(question.instrument, question.bands, question.strategy)
    frames = validation.Frames(question.exposure_s, question.n_frames, question.em_gain, question.strategy.visits)
    return validation.task_of(
        model, question.scene, "F662", frames, [], planets=[], **question.image_settings
    ).to_dict()


def test_entries_are_chosen_on_the_command_line(tmp_path):
    path = tmp_path / "few.csv"
    path.write_text("name,distance_pc,v_mag,sp_type\nnear star,2,3,G2V\nfar star,20,5,G2V\n")
    code = (
        "import sys\n"
        "from dataclasses import replace\n"
        "from cpic_planner.queries.shared import LIBRARIES, Library\n"
        "from cpic_planner.registry import SCORES\n"
        "SCORES.register(replace(SCORES['detection_margin'], name='toy_score'))\n"
        "LIBRARIES.register(type('Toy', (Library,), {'name': 'toy_library'})())\n"
        "from cpic_planner.cli.main import main\n"
        "asked = sys.argv[1:], ['--help'], ['--score', 'best']\n"
        "for words in asked:\n"
        "    print('\\nended with', main(['rank', *words]))\n"
    )
    options = ["--catalog", str(path), "--score", "toy_score", "--library", "toy_library", "--planets", "100", "--json"]
    done = subprocess.run([sys.executable, "-c", code, *options], capture_output=True, text=True)
    assert re.findall(r"\nended with (.*)\n", done.stdout) == ["0", "0", "2"], done.stderr
    answer, shown, _, _ = re.split(r"\nended with .*\n", done.stdout)
    result = json.loads(answer)
    assert (result["score_name"], result["reference_library"]) == ("toy_score", "toy_library")
    assert [row["score"] for row in result["targets"]] == [row["detection_margin"] for row in result["targets"]]
    assert "toy_score" in shown
    assert "toy_library" in shown
