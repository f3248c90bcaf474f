"""No command writes what steers a terminal, whatever the names of stars, planets, scenes, bands and folders hold."""

import csv
import json
import unicodedata

import pytest

STEERS = "\x1b[31mα\x07\x9b1m\u202e\u2066\x7f é[mas]"
STAR = {"name": STEERS, "v_mag": 4.0, "spectral_type": "K2V", "distance_pc": 4.0}
PLANET = {
    "name": f"{STEERS} b",
    "separation_arcsec": 0.5,
    "pa_deg": 45,
    "radius_rjup": 1.0,
    "phase_deg": 90,
    "albedo": 0.3,
}
FRAMES = ("--band", "F520", "--exposure-s", "10", "--em-gain", "20")
COMMANDS = {
    "etc": ("etc", STEERS, "--catalog", "stars.csv", "--band", "F520", "--separation-arcsec", "0.5"),
    "rank": ("rank", "--catalog", "stars.csv", "--band", "F520", "--planets", "4"),
    "explain": ("rank", "--catalog", "stars.csv", "--band", "F520", "--planets", "4", "--explain", STEERS),
    "known": ("known", "--catalog", "stars.csv", "--known-planets", "none+planets.csv", "--date", "2028-01-01"),
    "visibility": ("visibility", STEERS, "--catalog", "stars.csv", "--days", "4"),
    "simulate": ("simulate", "scene.yaml", *FRAMES, "--dry-run"),
    "confirm": ("confirm", "scene.yaml", "--band", "F520", "--dry-run"),
    "instrument": ("instrument", "show", "instrument.yaml"),
    "differences": ("instrument", "diff", "cpic_default", "instrument.yaml"),
    "check": ("check", STEERS),
    "cache": ("cache", "info"),
    "catalog": ("catalog", "info"),
}


@pytest.fixture
def hostile(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / STEERS).mkdir()
    (tmp_path / STEERS / "CPIC_1.fits").write_bytes(b"")
    for name in ("CPIC_DATA_DIR", "CPIC_CACHE_DIR"):
        monkeypatch.setenv(name, str(tmp_path / STEERS))
    tables = {
        "stars.csv": {"name": STEERS, "v_mag": 4.0, "distance_pc": 4.0, "sp_type": "K2V", "ra_deg": 20, "dec_deg": 5},
        "planets.csv": {"star": STEERS, "planet": f"{STEERS} b", "period_days": 1500, "mass_mjup": 1.5}
        | {"star_mass_msun": 0.8, "reference": STEERS},
    }
    for name, row in tables.items():
        with open(name, "w", newline="") as file:
            csv.writer(file).writerows([row.keys(), row.values()])
    files = {
        "scene.yaml": {"kind": "scene", "name": STEERS, "cstar": STAR, "planets": [PLANET]},
        "instrument.yaml": {"kind": "instrument", "name": STEERS},
    }
    for name, tree in files.items():
        (tmp_path / name).write_text(json.dumps(tree))


@pytest.mark.parametrize("name", COMMANDS)
def test_no_command_steers_the_terminal(hostile, call, name):
    status, out, err = call(*COMMANDS[name])
    assert status == (name == "check"), err
    steering = {sign for sign in out + err if unicodedata.category(sign) in ("Cc", "Cf", "Zl", "Zp")} - {"\n"}
    assert steering == set()
    assert "\\x1b[31mα" in out
    assert name in ("rank", "explain", "simulate", "check") or "[mas]" in "".join(
        out.split()
    )  # no markup; some tables cut long names


def test_brackets_are_no_markup(done):
    assert "plx [mas]" in " ".join(done("catalog", "columns")[0].split())
