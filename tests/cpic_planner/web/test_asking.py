import shlex
from urllib.parse import parse_qsl

import pytest

from cpic_core import InputError
from cpic_planner.cli.main import main
from cpic_planner.queries import options_of
from cpic_planner.web.asking import ETC, RANK, parameter, python_lines


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


@pytest.mark.parametrize("more", ["", "&target=Bob", "&distance_pc=7&separation_au=4", "&contrast_limit=on"])
def test_a_star_that_is_in_no_table_has_a_page_a_command_and_lines_of_python(ask, capsys, more):
    address = f"/etc?v_mag=4.5&sp_type=G8V&bands=F520{more}"
    page, told = ask(address), ask(f"{address}&format=json")
    assert (page.status, told.status) == (200, 200)
    pairs = ETC.canonical(parse_qsl(address.partition("?")[2]))
    scope = {}
    exec(python_lines(ETC.question(pairs), pairs), scope)
    assert scope["answers"][0].value == told.json["answers"][0]["value"]
    assert main([*shlex.split(ETC.command_line(pairs))[1:], "--json"]) == 0
    assert capsys.readouterr().out == told.text
    assert "/star?" not in page.text.partition("</nav>")[2]
