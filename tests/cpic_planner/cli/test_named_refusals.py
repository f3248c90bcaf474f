"""Whatever value an option does not take, the refusal is one line that names the option as it was written."""

import contextlib

import pytest

from tests.fuzz.command_line import GOOD, named, options_of

BAD = ("nan", "inf", "-1", "1e400", "words", "", "99999999999999999999999")
QUICK = {good[0]: good for good in reversed(GOOD) if good[0] not in ("check", "cache", "tradeoff")}
ELSEWHERE = {"--v-mag": "--sp-type"}
"""Options of which a good value asks for another one."""


@pytest.mark.parametrize(
    ("command", "option", "words"),
    [
        ("etc", "--albedo=nan", "allowed: a finite number, 0 to 1.5"),
        ("known", "--albedo=-1", "allowed: 0 to 1.5"),
        ("etc", "--seed=99999999999999999999999", "allowed: at least 0, below 9223372036854775808"),
        ("etc", "--question=words", "allowed: a readable YAML file"),
        ("roc", "--log10-fsed=-1", "given with --contrast"),
        ("simulate", "--reference-scene=words", "allowed: a YAML file or a preset"),
        ("instrument", "--key=words", "allowed: a key of the instrument"),
        ("rank", "--explain=words", "allowed: a star of stars.csv"),
        ("rank", "--known-planets=snapshot", "allowed: planets of stars of the sample"),
    ],
)
def test_the_option_is_named(refuses, tmp_path, monkeypatch, command, option, words):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "stars.csv").write_text("name,v_mag,distance_pc,sp_type\nA one,4.0,4.0,K2V\n")
    refuses(("-q", *named(QUICK[command], tmp_path), option), [f"cpic: {option.split('=')[0]} = ", words])


@pytest.mark.long
@pytest.mark.parametrize("command", sorted(QUICK))
def test_a_refusal_names_its_option(call, tmp_path, monkeypatch, command):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "stars.csv").write_text("name,v_mag,distance_pc,sp_type\nA one,4.0,4.0,K2V\n")
    (tmp_path / "out").mkdir()
    good = named(QUICK[command], tmp_path)
    for option in options_of(*good[:2]):
        if not option.takes_value or option.names[0] in ("--out", "--plot"):
            continue
        for value in BAD:
            with contextlib.suppress(SystemExit):
                status, _, err = call("-q", *good, f"{option.names[0]}={value}")
                names = (*option.names, ELSEWHERE.get(option.names[0], option.names[0]))
                assert status in (0, 2, 3), (option, value, err)
                assert status != 2 or (err.count("\n") == 1 and any(name in err for name in names)), (
                    option,
                    value,
                    err,
                )


def test_answers_of_a_file_are_named_by_its_line(refuses, tmp_path):
    path = tmp_path / "question.yaml"
    path.write_text("kind: question\ntarget: tau Cet\nsnr: -5\n")
    refuses(("-q", "etc", "--question", path), ["cpic: question.yaml line 3: snr = -5"])
    refuses(("-q", "etc", "--question", path, "--snr", "-3"), ["cpic: --snr = -3"])
