"""What an instrument is, on the command line."""

import csv
import io
import json

import pytest

from cpic_planner.queries.changes import ALIASES
from simulator.config import load_instrument

COMMAND = "instrument"


def rows(done, *arguments):
    result = json.loads(done(*arguments, "--json")[0])
    assert result["kind"] == "instrument"
    return {row["key"]: row for row in result["values"]}


def test_every_value_has_its_key_and_source(done):
    values = rows(done, "show")
    instrument = load_instrument()
    assert float(values["drift.visit_nm"]["value"]) == instrument.drift.visit_nm
    assert float(values["bands.F850.qe"]["value"]) == instrument.bands["F850"].qe
    assert values["telescope.diameter_m"]["confidence"] == "P"
    assert "off-axis" in values["telescope.diameter_m"]["source"]
    assert (values["drift.visit_nm"]["unit"], values["drift.visit_nm"]["short_name"]) == ("nm", "visit_drift")


def test_keys_are_those_that_can_be_set(done):
    listed = rows(done, "keys")
    assert set(ALIASES) == {row["short_name"] for row in listed.values()} - {""}
    drift = rows(done, "keys", "drift")
    assert set(drift) == {key for key in listed if key.startswith("drift.")}
    assert set(rows(done, "keys", "bands.*.qe")) == {f"bands.{band}.qe" for band in load_instrument().bands}


def test_a_change_is_all_that_differs(done):
    changed = rows(done, "diff", "cpic_default", "--set", "drift=0.1nm")
    assert {key: (float(row["value"]), float(row["other"])) for key, row in changed.items()} == {
        "drift.visit_nm": (0.1, 0.05),
        "drift.walk_nm_per_sqrt_hour": (0.1, 0.05),
    }
    assert rows(done, "diff", "cpic_default") == {}
    assert "coronagraph.apodizer" in "".join(rows(done, "diff", "cpic_2q")) or rows(done, "diff", "cpic_2q")


def test_forms(done):
    text = done("show", "--key", "drift", "--format", "csv")[0]
    assert next(row["key"] for row in csv.DictReader(io.StringIO(text))) == "drift.visit_nm"
    assert done("show", "--key", "drift", "--format", "latex")[0].count(r"\\") == 10


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["show", "nothing"], ["nothing", "cpic_default"]),
        (["show", "--key", "drft"], ["drft", "known keys"]),
        (["show", "--set", "drift=0.1"], ["--set drift", "a unit (nm), or an x"]),
        (["show", "--set", "drift"], ["--set", "KEY=VALUE"]),
        (["diff", "cpic_default", "--set", "throughput=x-1"], ["--set bands.*.t_opt", "at least 0"]),
        (["show", "--format", "csv", "--json"], ["--json", "--format"]),
    ],
)
def test_refusals(refuses, arguments, words):
    refuses(arguments, words)
