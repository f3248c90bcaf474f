import pytest

from cpic_core import InputError
from cpic_planner.queries import options_of
from cpic_planner.web.asking import ETC, RANK, parameter


@pytest.mark.parametrize("asking", [ETC, RANK])
def test_parameters_are_the_fields_of_the_question(asking):
    names = [parameter(option) for option in options_of(asking.model)]
    assert len(names) == len(set(names))
    for option in options_of(asking.model):
        assert asking.by_name[parameter(option)] == option
        assert asking.by_name[".".join(option.path)] == option
    assert asking.left_out <= {option.flag for option in options_of(asking.model)}


@pytest.mark.parametrize("asking", [ETC, RANK])
def test_every_field_that_takes_a_file_is_guarded_or_left_out(asking):
    for option in options_of(asking.model):
        takes_files = "Path" in option.asked.accepts or " file" in option.text.lower()
        guarded = option.asked.names_file is not None or option.flag in asking.left_out
        assert guarded or not takes_files or option.path[-1] == "changes", option.flag


def test_one_question_has_one_form_whatever_it_is_called():
    canonical = ETC.canonical([("target", "tau Cet"), ("time_s", "7200"), ("bands", "F520"), ("library", "roll")])
    for given in (
        [("library", "roll"), ("band", "F520"), ("time", "2h"), ("target", " tau Cet ")],
        [("strategy.library", "roll"), ("time_s", "120min"), ("bands", "F520"), ("target", "tau Cet"), ("snr", "")],
    ):
        assert ETC.canonical(given) == canonical


def test_a_question_is_that_of_python():
    pairs = ETC.canonical([("target", "tau Cet"), ("snr", "5"), ("separation_arcsec", "0.4, 0.5"), ("visits", "3")])
    mine = ETC.model.of({"target": "tau Cet", "snr": 5, "separation_arcsec": [0.4, 0.5], "strategy": {"visits": 3}})
    assert ETC.question(pairs) == mine


@pytest.mark.parametrize(
    ("given", "name", "words"),
    [
        ({"targt": "tau Cet"}, "targt", "did you mean target"),
        ({"target": "tau Cet", "instrument": "/etc/passwd"}, "instrument", "files are named on the command line only"),
        ({"target": "tau Cet", "roll_deg": "20"}, "roll_deg", "together with library roll"),
        ({"target": "tau Cet", "fidelity": "standard"}, "fidelity", "the command line does"),
        ({"target": "tau Cet", "snr": "5", "sigma": "5"}, "snr", "one level at a time"),
        ({"target": "tau Cet", "time": "5"}, "time", "a time with a unit"),
        ({"target": "tau Cet", "planet_radius_rjup": "70"}, "planet_radius_rjup", "10"),
    ],
)
def test_refusals_name_the_parameter(given, name, words):
    with pytest.raises(InputError) as caught:
        ETC.question(ETC.canonical(given.items()))
    assert caught.value.key == name
    assert words in str(caught.value)
