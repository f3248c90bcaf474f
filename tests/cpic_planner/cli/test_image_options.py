"""Options of images are handed over once: every command that makes them has the same ones, with the same defaults."""

import dataclasses
import inspect

import pytest

from catalogs.errors import InputError
from cpic_planner.cli.confirm_command import confirm
from cpic_planner.cli.image_options import ImageOptions, renamed, takes_images
from cpic_planner.cli.main import main
from cpic_planner.cli.options import Tier
from cpic_planner.cli.plan_command import plan
from cpic_planner.confirmed import ImageConfig
from simulator import load_instrument

FIELDS = {field.name: field.default for field in dataclasses.fields(ImageOptions)}


@pytest.mark.parametrize("command", [plan, confirm])
def test_a_command_has_every_option_and_not_the_bundle(command):
    parameters = inspect.signature(command).parameters
    assert "images" not in parameters
    for name, default in FIELDS.items():
        assert parameters[name].default == default
    assert len(parameters) > len(FIELDS)


def test_values_arrive_in_one_object():
    seen = []

    @takes_images
    def command(scene: str, *, images: ImageOptions) -> None:
        seen.append((scene, images))

    command(**(FIELDS | {"scene": "x", "seed": 7, "fidelity": Tier.QUICK}))
    assert seen == [("x", ImageOptions(seed=7, fidelity=Tier.QUICK))]


def test_the_tree_is_that_of_the_configuration():
    nominal = load_instrument()
    given = ImageOptions(tolerance=0.02, realisations=3, seed=9, bands=["F520"], reference_ratio=0.5)
    config = ImageConfig(**given.config_tree(nominal))
    assert (config.dial.fidelity, config.dial.tolerance["snr"]) == ("custom", 0.02)
    assert (config.realisations, config.seed, config.bands) == (3, 9, ("F520",))
    assert config.strategy.reference_ratio == 0.5
    plain = ImageConfig(**ImageOptions().config_tree(nominal))
    assert plain == ImageConfig(instrument=nominal)
    assert plain.dial.fidelity == "standard"


def test_both_names_of_the_dial_are_refused():
    with pytest.raises(InputError, match="--tolerance.*--fidelity.*one of the two"):
        ImageOptions(tolerance=0.0, fidelity=Tier.QUICK).config_tree(load_instrument())


@pytest.mark.parametrize("command", ["plan", "confirm"])
@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--fidelity", "quick", "--tolerance", "0.1"], ["--tolerance", "--fidelity", "one of the two"]),
        (["--tolerance", "0.6"], ["--tolerance", "0.6", "0 to 0.5"]),
        (["--tolerance", "-0.1"], ["--tolerance", "0 to 0.5"]),
        (["--tolerance", "nan"], ["--tolerance", "finite"]),
        (["--fidelity", "fast"], ["--fidelity", "quick", "reference"]),
    ],
)
def test_refusals_are_one_line(capsys, tmp_path, command, options, words):
    what = ["paper_example"] if command == "confirm" else []
    status = main([command, *what, *options, "--out", str(tmp_path / "o")])
    captured = capsys.readouterr()
    assert status == 2
    assert captured.out == ""
    assert captured.err.count("\n") == 1
    assert not (tmp_path / "o").exists()
    for word in words:
        assert word in captured.err


def test_a_refusal_takes_the_name_of_its_option():
    error = InputError("plan.tolerance", 2, allowed="0 to 0.5")
    assert "--tolerance" in str(renamed(error, "plan", {"tolerance": "--tolerance"}))
    assert renamed(error, "plan", {}) is error


def test_the_same_dial_has_one_hash():
    """A name or the tolerance that means the same: one configuration."""
    nominal = load_instrument()
    by_name, by_value = (
        ImageConfig(instrument=nominal, **dial) for dial in ({"fidelity": "reference"}, {"tolerance": 0.0})
    )
    assert by_name.hashed() == by_value.hashed()
    assert ImageConfig(instrument=nominal, fidelity="standard").hashed() == ImageConfig(instrument=nominal).hashed()
    assert ImageConfig(instrument=nominal, tolerance=0.05).hashed() != by_value.hashed()
