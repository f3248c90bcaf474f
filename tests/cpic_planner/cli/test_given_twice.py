"""No option silently keeps the last of two values: over every command and every option that takes one value."""

import itertools
import pkgutil

import pytest

from cpic_core import InputError
from cpic_planner import signal_to_noise
from cpic_planner.cli.command import command_of
from cpic_planner.cli.main import app
from cpic_planner.queries import EtcQuestion, SimulateQuestion, changed_instrument, options_of
from cpic_planner.schemas import QUESTIONS
from cpic_planner.web.addresses import ETC, IMAGES, RANK
from simulator import load_instrument


def commands(group, above=()):
    """Yield every command of a group with the words that call it."""
    for name, command in group.commands.items():
        if hasattr(command, "commands"):
            yield from commands(command, (*above, name))
        else:
            yield (*above, name), command


COMMANDS = dict(commands(app.built))


def context_of(words):
    """Return a command with the context in which it reads its arguments; its options come late from its question."""
    command = COMMANDS[words]
    context = command.make_context(words[-1], [], resilient_parsing=True)
    context.resilient_parsing = False
    return command, context


def of_one_value(command):
    """Return the options of a command that take one value, or say yes and no."""
    options = [option for option in command.params if option.param_type_name == "option" and not option.is_eager]
    said = [option for option in options if not option.is_flag or option.secondary_opts]
    return [option for option in said if not (option.multiple or option.count)]


def written(option, spelling):
    """Return an option with a value, as text; no value is looked at before options are counted."""
    return [spelling] if option.is_flag else [spelling, "1"]


def test_the_commands_are_there():
    assert {("etc",), ("confirm",), ("rank",), ("serve",), ("check",), ("catalog", "refresh")} <= set(COMMANDS)
    assert {words[0] for words in COMMANDS} >= set(QUESTIONS) - {"images"}


@pytest.mark.parametrize("words", COMMANDS, ids=" ".join)
def test_every_option_of_one_value_is_refused_when_it_is_given_twice(words):
    command, context = context_of(words)
    for option in of_one_value(command):
        for one, other in itertools.product([*option.opts, *option.secondary_opts], repeat=2):
            with pytest.raises(InputError, match=f"^{option.opts[0]} = given twice: not accepted; allowed: once"):
                command.parse_args(context, [*written(option, one), *written(option, other)])


def test_there_are_options_of_one_value():
    counts = {words: len(of_one_value(context_of(words)[0])) for words in COMMANDS}
    assert sum(counts.values()) > 200
    assert {words for words, count in counts.items() if not count} <= {
        ("check",),
        ("schema",),
        ("cache", "info"),
        ("cache", "clear"),
        ("catalog", "info"),
        ("catalog", "columns"),
    }


@pytest.mark.parametrize("name", [name for name in QUESTIONS if name != "images"])
def test_what_a_question_takes_once_is_no_list_on_the_command_line(name):
    model = pkgutil.resolve_name(QUESTIONS[name])
    built = {option.name: option for option in command_of(lambda question: None, model).params}
    for option in options_of(model):
        if not option.asked.argument:
            assert built[option.name].multiple == option.several, option.flag


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ("etc,tau Cet,--time,1h,--time,10h", ["--time-s = given twice", "--time-s and --time are one option"]),
        ("etc,tau Cet,--time=1h,--time-s,7200", ["--time-s = given twice", "--time"]),
        ("rank,--photon-counting,--mode,analogue", ["--mode = given twice"]),
        ("etc,tau Cet,--drift-nm,0.1,--set,drift=0.2nm", ["--drift-nm = 0.1", "drift.visit_nm is altered by drift"]),
        ("rank,--exozodi,2,--set,exozodi=3zodi", ["--exozodi = 2", "each value altered once"]),
        ("etc,tau Cet,--set,throughput=x0.5,--set,throughput=x0.7", ["--set", "each value altered once"]),
        ("etc,tau Cet,--set,read_noise=x2,--set,detector.read_noise_e=5e-", ["--set", "each value altered once"]),
        ("confirm,paper_example,--audit,--no-audit", ["--audit = given twice"]),
        ("instrument,show,--key,drift,--key,bands", ["--key = given twice"]),
    ],
)
def test_the_refusal_names_the_option_in_one_line(call, arguments, words):
    status, out, err = call(*arguments.split(","))
    assert (status, out) == (2, "")
    (line,) = [line for line in err.splitlines() if " is now " not in line]
    assert [word for word in words if word not in line] == [], line


def test_what_may_be_repeated_still_is(done):
    out, _ = done("etc", "tau Cet", "--band", "F520", "--band", "F662", "--detect", "--detect", "-q", "-q", "--brief")
    assert "F520" in out
    assert "F662" in out


@pytest.mark.parametrize("asking", [ETC, RANK, IMAGES], ids=lambda asking: asking.command)
def test_an_address_takes_each_parameter_of_one_value_once(asking):
    names = {option.flag: [name for name, own in asking.by_name.items() if own is option] for option in asking.options}
    for option in asking.options:
        if option.several or option.flag in asking.left_out or option.path[-1] == "changes":
            continue
        for one, other in itertools.product(names[option.flag], repeat=2):
            with pytest.raises(InputError, match="2 values"):
                asking.canonical([(one, "1"), (other, "2")])
    with pytest.raises(InputError, match="2 values"):
        asking.canonical([("time", "1h"), ("time_s", "7200")])


def test_a_field_under_two_names_is_refused():
    for alias, field in SimulateQuestion.ALIASES.items():
        with pytest.raises(InputError, match=f"^{field} = given twice.*{alias}|^{field} = given twice.*{field}"):
            SimulateQuestion.of({alias: 1, field: 2})


def test_a_keyword_and_the_strategy_say_a_thing_once():
    for name in ("visits", "reference_visits"):
        with pytest.raises(InputError, match=f"^{name} = given twice"):
            signal_to_noise("tau Cet", separation_arcsec=0.5, time_s=3600, strategy={name: 2}, **{name: 2})


def test_options_and_changes_without_contradiction_are_those_of_changes_alone():
    told = {"exozodi_zodis": 2.0, "drift_nm": 0.1}
    (parts,) = {option.parts for option in options_of(EtcQuestion) if option.path[-1] == "drift_nm"}
    changes = ["read_noise=x2", "exozodi=2zodi", "drift=0.1nm"]
    made = parts(changes=("read_noise=x2",), **told).made(None)
    assert made.model_dump() == changed_instrument("cpic_default", changes).model_dump()
    assert made.model_dump() != load_instrument().model_dump()
