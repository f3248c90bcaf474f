"""What is not known of an instrument, and draws of it."""

import numpy as np
import pytest
import yaml

from cpic_core import split_sourced
from cpic_planner.queries import Change, EnsembleChoice, changed, load_ensemble
from simulator.config import load_instrument, preset_names, preset_path

INSTRUMENT = load_instrument()
ENSEMBLE = load_ensemble()


@pytest.mark.parametrize("preset", preset_names("instrument"))
def test_every_inferred_or_assumed_number_of_a_preset_has_a_law_or_a_reason(preset):
    """Read from the presets themselves, so that a new assumed number without a law fails here."""
    tree = yaml.safe_load(preset_path("instrument", preset).read_text(encoding="utf-8"))
    doubtful = {key: item for key, item in split_sourced(tree)[1].items() if item.confidence in "AI"}
    assert doubtful or preset == "roman_hlc_like"  # all of it is published
    assert [key for key in doubtful if not ENSEMBLE.says(key)] == []
    values = split_sourced(tree)[0]
    for key in doubtful:
        value = values
        for part in key.split("."):
            value = value[part]
        number = isinstance(value, int | float) and not isinstance(value, bool)
        if not number:
            assert ENSEMBLE.says(key) not in ENSEMBLE.drawn


@pytest.mark.parametrize("end", [0.0, 1.0])
def test_instruments_at_the_ends_of_every_law_exist(end):
    """All numbers at one end together too: no law leaves what the instrument accepts."""
    changes = []
    for key, doubt in ENSEMBLE.drawn.items():
        value = float(doubt.law.quantile(np.array([end]))[0])
        if key not in ("contrast", "planets_per_star"):
            changes.append(Change(key=key, action="set" if doubt.factor is None else "scale", value=value))
            changed(INSTRUMENT, changes[-1:])
    assert changed(INSTRUMENT, changes) != INSTRUMENT


def test_every_equal_part_of_a_law_is_drawn_from_once():
    shares = EnsembleChoice(ENSEMBLE, 50, 3).shares()
    assert list(shares) == list(ENSEMBLE.drawn)
    for share in shares.values():
        np.testing.assert_array_equal(np.sort(np.floor(50 * share)), np.arange(50))
    first, second = shares["drift"], shares["detector.cic_e"]
    assert abs(np.corrcoef(first, second)[0, 1]) < 0.4  # 3 standard errors of 50 independent pairs


def test_a_number_less_changes_no_other():
    less = load_ensemble({"numbers": {"contrast": None}})
    some, all_of_them = (EnsembleChoice(item, 20, 1).draws() for item in (less, ENSEMBLE))
    assert "contrast" not in some
    for key, values in some.items():
        np.testing.assert_array_equal(values, all_of_them[key])
    other = EnsembleChoice(ENSEMBLE, 20, 2).draws()
    assert not np.array_equal(other["drift"], all_of_them["drift"])


def test_a_file_is_laid_over_the_preset(tmp_path):
    path = tmp_path / "mine.yaml"
    text = "kind: ensemble\nnumbers:\n  overhead_s: {label: overhead, value: 900, source: a test}\n"
    path.write_text(text, encoding="utf-8")
    mine = load_ensemble(path)
    assert mine.name == "mine"
    np.testing.assert_array_equal(EnsembleChoice(mine, 4, 1).draws()["overhead_s"], 900.0)
    assert mine.numbers["drift"] == ENSEMBLE.numbers["drift"]


def test_refusals(refused, tmp_path):
    law = {"law": "uniform", "low": 1, "high": 2}
    said = {"label": "x", "source": "a test"}
    for key, numbers in {
        "ensemble.numbers.drift.value": {"drift": said},
        "ensemble.numbers.drift.source": {"drift": {"label": "x", "factor": law}},
        "ensemble.numbers.drift.factor.law": {"drift": said | {"factor": {"law": "uniformly"}}},
        "ensemble.numbers.wavefront.opd_rms_nm.through": {"wavefront.opd_rms_nm": said | {"value": law}},
        "ensemble.numbers": 3,
    }.items():
        refused(key, load_ensemble, {"numbers": numbers})
    refused("ensemble.numbers", load_ensemble, {"numbers": dict.fromkeys(ENSEMBLE.drawn)})
    refused("ensemble", load_ensemble, tmp_path / "none.yaml")


def test_the_bands_of_the_catalogue_have_laws_too():
    for key in ("bands.F520.t_opt", "bands.F662.width_nm", "bands.F940.qe"):
        assert ENSEMBLE.says(key)
