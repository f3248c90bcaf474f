"""Addresses as questions, and files that come with them."""

import hashlib
import json
import random
import re
import shlex
from shlex import split
from urllib.parse import parse_qsl

import pytest

from cpic_core import InputError
from cpic_planner.cli.main import main
from cpic_planner.queries import options_of
from cpic_planner.web.addresses import ETC, FILE_FIELDS, RANK, parameter, python_lines, read_submission
from simulator.config import load_instrument


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


STARS = b"name,v_mag,sp_type,distance_pc\nBob,4.5,G8V,7\nAnn,5.0,K1V,9\n"
DARK = b"kind: instrument\nname: noisier\ndetector: {read_noise_e: 160}\n"
SPECTRUM = b"wavelength_nm,albedo\n400,0.3\n700,0.5\n1100,0.2\n"
PLANETS = b"planet,star,status,semi_major_axis_au,mass_mjup,star_mass_msun\ntau Cet x,tau Cet,confirmed,1.8,1.0,0.78\n"
FILES = {
    "catalog": ("my stars.csv", STARS),
    "instrument": ("noisier.yaml", DARK),
    "albedo": ("grey.csv", SPECTRUM),
    "known_planets": ("mine.csv", PLANETS),
}
SAME = [
    (("catalog",), {"target": "Bob", "snr": "5"}, "etc Bob --catalog 'my stars.csv' --snr 5"),
    (("instrument",), {"target": "tau Cet", "detect": "on"}, "etc 'tau Cet' --instrument noisier.yaml --detect"),
    (("albedo",), {"target": "tau Cet", "snr": "5"}, "etc 'tau Cet' --albedo grey.csv --snr 5"),
    (("known_planets",), {"target": "tau Cet x", "time": "5h"}, "etc 'tau Cet x' --known-planets mine.csv --time 5h"),
    (
        ("catalog", "instrument", "albedo"),
        {"target": "Ann", "bands": "F520"},
        "etc Ann --catalog 'my stars.csv' --instrument noisier.yaml --albedo grey.csv --band F520",
    ),
    (("catalog",), {"bands": "F520"}, "rank --catalog 'my stars.csv' --band F520"),
]


def sent(names):
    return [(name, *FILES[name]) for name in names]


@pytest.mark.parametrize(("names", "fields", "command"), SAME)
def test_the_answer_is_that_of_the_command_with_the_same_files(
    send, capsys, tmp_path, monkeypatch, names, fields, command
):
    page = "/priorities" if command.startswith("rank") else "/etc"
    empty = tmp_path / "empty"
    empty.mkdir()
    monkeypatch.chdir(empty)
    told = send(page, sent(names), fields=[*fields.items(), ("format", "json")])
    assert told.status == 200, told.text
    assert list(empty.iterdir()) == []
    for name, data in FILES.values():
        (tmp_path / name).write_bytes(data)
    monkeypatch.chdir(tmp_path)
    assert main([*split(command), "--json"]) == 0
    assert told.text == capsys.readouterr().out
    for name in names:
        file, data = FILES[name]
        assert f"{file}: sha256 {hashlib.sha256(data).hexdigest()}" in told.headers["cpic-files"]


def test_a_page_has_the_figure_in_itself_and_says_what_was_sent(send):
    told = send("/etc", sent(["catalog"]), fields=[("target", "Bob"), ("snr", "5"), ("bands", "F520")])
    assert told.status == 200
    assert hashlib.sha256(STARS).hexdigest() in told.text
    assert 'src="data:image/svg+xml;base64,' in told.text
    assert "Values of the figure" in told.text
    assert "/etc.values" not in told.text
    assert "img-src 'self' data:" in told.headers["content-security-policy"]
    assert told.headers["cache-control"] == "no-store"
    assert 'enctype="multipart/form-data"' in told.text
    assert "Python" not in told.text


def test_nothing_is_kept_of_a_file(send, ask):
    fields = [("target", "Bob"), ("snr", "5"), ("bands", "F520"), ("format", "json")]
    near = send("/etc", sent(["catalog"]), fields=fields).json
    far = send("/etc", [("catalog", "my stars.csv", STARS.replace(b",7\n", b",14\n"))], fields=fields).json
    assert near["distance_pc"], far["distance_pc"] == (7.0, 14.0)
    assert near["answers"][0]["value"] != far["answers"][0]["value"]
    assert ask("/etc?target=Bob&catalog=my+stars.csv").status == 400
    dim = send(
        "/etc", [("albedo", "grey.csv", b"nm,albedo\n400,0.1\n1100,0.1\n")], fields=[("target", "tau Cet"), *fields[1:]]
    )
    bright = send("/etc", sent(["albedo"]), fields=[("target", "tau Cet"), *fields[1:]])
    assert dim.json["answers"][0]["contrast"] < bright.json["answers"][0]["contrast"]


def test_names_in_files_lead_to_no_file_of_the_server(send, tmp_path, monkeypatch):
    secret = tmp_path / "secret.txt"
    secret.write_text("500 0.5\nxyzzy\n")
    (tmp_path / "grid.db").write_bytes(b"SQLite format 3\0xyzzy")
    monkeypatch.chdir(tmp_path)
    for name in (str(secret), "secret.txt", "../secret.txt", "/etc/passwd", "~/.netrc"):
        for text in (
            f"bands: {{F520: {{transmission_file: {name}}}}}",
            f"coronagraph: {{apodizer: {name}}}",
            f"coronagraph: {{table: {name}}}",
            f"wavefront: {{map_file: {name}}}",
            f"base: {name}",
        ):
            made = f"kind: instrument\nname: x\n{text}\n".encode()
            told = send("/etc", [("instrument", "x.yaml", made)], fields=[("target", "tau Cet"), ("format", "csv")])
            assert told.status == 400, (text, told.text)
            assert told.text.count("\n") == 1
            assert "xyzzy" not in told.text
            assert "root:" not in told.text
    grid = [("albedo", "grid.db", b"SQLite format 3\0")]
    told = send("/etc", grid, fields=[("target", "tau Cet"), ("log10_mh", "1"), ("log10_fsed", "1"), ("format", "csv")])
    assert told.status == 400
    assert "xyzzy" not in told.text


def test_a_curve_that_is_not_sent_is_missed_and_other_optics_are_refused(send):
    for text, word in (
        ("wavefront: {opd_rms_nm: 15}", "other optics"),
        ("bands: {F520: {center_nm: 530}}", "other optics"),
        ("coronagraph: {inner_arcsec: {F520: 0.19}}", "other optics"),
    ):
        file = ("instrument", "x.yaml", f"kind: instrument\n{text}\n".encode())
        told = send("/etc", [file], fields=[("target", "tau Cet"), ("bands", "F520"), ("format", "csv")])
        assert told.status == 400
        assert word in told.text, told.text


@pytest.mark.parametrize(
    "files",
    [
        [("catalog", "../../etc/x.csv", STARS.replace(b"Bob", b"Bob\0"))],
        [("target", "x.csv", STARS)],
        [("catalog", "x", STARS)],
        [("catalog", "", STARS)],
        [("catalog", ".csv", STARS)],
        [("catalog", "a\tb.csv", STARS)],
        [("catalog", "x.csv", STARS), ("catalog", "y.csv", STARS)],
        [("catalog", "x.csv", STARS), ("instrument", "x.csv", DARK)],
        [("catalog", "x.csv", b"")],
        [("catalog", "x.csv", b"\xff\xfe\x00")],
        [
            (
                "catalog",
                "x.xml",
                b'<?xml version="1.0"?><!DOCTYPE x [<!ENTITY e SYSTEM "file:///etc/passwd">]><VOTABLE>&e;',
            )
        ],
        [("catalog", "x.csv.gz", b"\x1f\x8b\x08\x00")],
        [("instrument", "x.yaml", b"!!python/object/apply:os.system [echo]")],
        [("instrument", "x.yaml", b"a: &a [" + b"*a," * 100 + b"]")],
        [("instrument", "x.yaml", b"[" * 10_000)],
        [("instrument", "x.yaml", STARS)],
        [("albedo", "x.csv", b"1e3 nan\n")],
        [("albedo", "x.csv", b"400 5\n500 5\n")],
        [("known_planets", "x.csv", b"planet\n")],
    ],
    ids=lambda files: "+".join(name for _, name, _ in files)[:30] or "nameless",
)
def test_hostile_files_are_refused_in_one_line(send, files):
    told = send("/etc", files, fields=[("target", "Bob"), ("v_mag", ""), ("format", "csv")])
    assert told.status == 400
    assert told.text.count("\n") == 1
    assert "Traceback" not in told.text
    assert "root:" not in told.text


def test_bodies_have_a_size_and_only_questions_take_them(send, browser):
    large = b"name,v_mag,sp_type,distance_pc\n" + b"B,4,G2V,7\n" * 300_000
    told = send("/etc", [("catalog", "x.csv", large)], fields=[("target", "B")])
    assert (told.status, told.text.count("\n")) == (413, 1)
    assert send("/star", [("catalog", "x.csv", STARS)]).status == 405
    assert send("/etc", sent(["catalog"]), origin="http://elsewhere.example").status == 403
    assert browser.get("/etc", method="POST", body=b"x", content_length="1", content_type="text/plain").status == 400


def test_any_bytes_come_through_as_they_are():
    draw = random.Random(5)
    for _ in range(200):
        data = bytes(draw.choices(b"\r\n-xy\0\xff", k=draw.randrange(60)))
        if b"\r\n--edge" in b"\r\n" + data:
            continue
        body = (
            b'--edge\r\nContent-Disposition: form-data; name="catalog"; filename="a.csv"\r\n\r\n'
            + data
            + b"\r\n--edge--\r\n"
        )
        assert read_submission("multipart/form-data; boundary=edge", body).files == {"a.csv": data}


@pytest.mark.parametrize(
    "body", [b"", b"--edge", b"--edge\r\n", b"--edge--x", b"x--edge--", b"--edge\r\nx--edge--", b"\0" * 99]
)
def test_broken_bodies_are_refused(body):
    with pytest.raises(InputError, match="body"):
        read_submission("multipart/form-data; boundary=edge", body)


def test_the_form_takes_files_and_keeps_the_question(ask):
    form = ask("/etc/own?target=tau+Cet&snr=5").text
    for name in set(FILE_FIELDS) - {"other", "table"}:
        assert re.search(rf'<input type="file" name="{name}"', form)
        assert form.count(f'name="{name}"') == 1
    assert 'value="tau Cet"' in form
    assert 'href="/etc/own?target=tau+Cet&amp;snr=5&amp;bands=F520"' in ask("/etc?target=tau+Cet&snr=5&bands=F520").text
    assert ask("/priorities/own").status == 200


def test_noise_that_was_sent_counts(send):
    assert load_instrument().detector.read_noise_e != 160
    fields = [("target", "tau Cet"), ("snr", "5"), ("bands", "F520"), ("em_gain", "1"), ("format", "json")]
    noisy = send("/etc", sent(["instrument"]), fields=fields).json["answers"][0]
    quiet = send("/etc", fields=fields).json["answers"][0]
    assert json.dumps(noisy["budget"]) != json.dumps(quiet["budget"])
    assert noisy["value"] is None or noisy["value"] > quiet["value"]
