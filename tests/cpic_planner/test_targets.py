"""Targets from any table: the same columns, the cuts, the flags, and content that decides hashes."""

import logging

import numpy as np
import pytest

from catalogs import open_catalogue
from cpic_core import InputError
from cpic_planner import load_targets
from cpic_planner.targets import find_target, find_targets, rank_sample, sample_text
from simulator.config import content_hash

TABLE = """name,plx,V,SpT,ra,dec,companion_sep_arcsec,companion_v_mag,close_companion
near,200,5.0,G2V,10,20,5,7.5,
wide,100,6.5,K1IV,200,-20,40,9,
plain,50,8.0,K5III,,,,,yes
"""


@pytest.fixture
def mine(tmp_path):
    (tmp_path / "mine.csv").write_text(TABLE)
    return tmp_path / "mine.csv"


def test_frame_of_a_file_has_the_columns_of_the_snapshots(mine):
    frame, snapshot = load_targets(mine), load_targets()
    assert list(frame.columns) == list(snapshot.columns)
    assert frame["name"].tolist() == ["near", "wide", "plain"]
    assert frame["distance_pc"].tolist() == [5.0, 10.0, 20.0]
    assert "mine.csv" in frame.attrs["catalogue"]
    assert "SIMBAD" in snapshot.attrs["catalogue"]
    assert len(snapshot) == 1077
    assert load_targets(str(mine)).equals(frame)
    assert set(frame["teff_k_src"]) == {"derived:spectral type (Pecaut & Mamajek 2013; Cox 2000)"}
    assert set(frame["metallicity_src"]) == {"assumed:0"}
    assert "measured" in set(snapshot["metallicity_src"])


def test_cuts_hold_for_a_file_too(refused, mine):
    assert load_targets(mine, v_mag_max=7)["name"].tolist() == ["near", "wide"]
    assert load_targets(mine, dwarfs_only=True)["name"].tolist() == ["near"]
    assert load_targets(mine, singles_only=True)["name"].tolist() == ["wide"]
    refused("dwarfs_only and singles_only", load_targets, mine, dwarfs_only=True, singles_only=True)
    refused("v_mag_max", load_targets, mine, v_mag_max=1)
    refused("no such cut", load_targets, mine, v_max=7)


def test_companions_of_a_file_are_flagged_and_their_light_is_placed(mine):
    near, _ = find_target("near", catalog=mine)
    assert near.companion_v_mag[0] == 7.5
    assert near.companion_separation_arcsec[0] == 5.0
    assert {"companion_light_on", "companion_pa_unknown"} <= set(near.flags[0])
    assert "companion_position_old" in near.flags[0], "nobody says when it was seen"
    assert np.isnan(near.companion_pa_deg[0])
    plain, _ = find_target("plain", catalog=mine)
    assert {"companion_light_unknown", "position_unknown", "giant"} <= set(plain.flags[0])
    assert np.isnan(plain.ra_deg[0])


def test_content_decides_the_hash_and_the_name_of_the_file_does_not(mine, tmp_path):
    (tmp_path / "other.csv").write_text(TABLE.replace("name,plx", "star,parallax"))
    one, two = rank_sample(catalog=mine), rank_sample(catalog=tmp_path / "other.csv")
    assert content_hash(one.content()) == content_hash(two.content())
    (tmp_path / "other.csv").write_text(TABLE.replace("6.5", "6.6"))
    assert content_hash(rank_sample(catalog=tmp_path / "other.csv").content()) != content_hash(one.content())


def test_sample_in_words(mine):
    assert sample_text(open_catalogue(), None, False, False).startswith(
        "every FGK star of the snapshot with parallax >= 25 mas and V <= 7; all luminosity classes"
    )
    assert sample_text(open_catalogue(mine), None, False, False).startswith("every star of mine.csv; all")
    assert sample_text(open_catalogue(mine), 6, True, True).startswith("every star of mine.csv with V <= 6; dwarfs")


def test_remarks_on_a_file_reach_the_log_once(mine, caplog):
    mine.write_text(TABLE.replace("name,plx,V", "name,plx,V").replace(",ra,dec,", ",right,up,"))
    with caplog.at_level(logging.WARNING):
        load_targets(mine)
    assert [record.getMessage() for record in caplog.records] == ["mine.csv: columns not used: right, up"]


def test_a_catalogue_is_read_once_for_many_names(mine, monkeypatch):
    from cpic_planner import signal_to_noise
    from cpic_planner.api import functions

    opened = []
    monkeypatch.setattr(functions, "as_catalogue", lambda source: opened.append(source) or open_catalogue(source))
    answers = signal_to_noise(["near", "wide"], time_s=3000, separation_arcsec=0.5, bands=["F520"], catalog=mine)
    assert len(answers) == 2
    assert opened == [mine]


@pytest.mark.parametrize(
    ("star", "arcsec"),
    [
        ("alf Cen A", 10.2),
        ("alf Cen B", 10.2),
        ("70 Oph A", 6.7),
        ("36 Oph A", 5.2),
        ("ksi Boo A", 4.6),
        ("gam Vir A", 3.8),
        ("alf CMi", 5.1),
    ],
)
def test_companions_stand_where_they_are_at_the_date(star, arcsec):
    there, _ = find_target(star, date_utc="2028-07-01")
    assert there.date_utc == "2028-07-01T00:00:00"
    assert there.companion_separation_arcsec[0] == pytest.approx(arcsec, abs=0.2)
    assert 0.0 < there.companion_position_error_arcsec[0] < 0.15
    assert "companion_position_old" not in there.flags[0]
    earlier, _ = find_target(star, date_utc="1975-07-01")
    assert abs(earlier.companion_separation_arcsec[0] - arcsec) > 0.3


@pytest.mark.parametrize("companions", ["on", "off"])
def test_stars_that_are_named_together_are_those_that_are_named_alone(companions):
    names = ["alf Cen A", "alpha Cen B", "tau Cet", "61 Cyg", "61 Cyg B", "tau Cet", "HIP 8102"]
    found = find_targets(names, companions=companions, date_utc="2030-01-01")
    for name, (star, note) in zip(names, found, strict=True):
        alone, said = find_target(name, companions=companions, date_utc="2030-01-01")
        assert star.content() == alone.content()
        assert (note, star.hd, star.gj) == (said, alone.hd, alone.gj)
    assert find_targets([]) == []
    with pytest.raises(InputError, match="star = no star"):
        find_targets(["tau Cet", "no star", "nor this"])


def test_the_date_is_the_start_of_the_mission_unless_given():
    from simulator import load_instrument

    start = load_instrument().mission.start_utc
    one, other = find_target("61 Cyg A")[0], find_target("61 Cyg A", date_utc=start)[0]
    assert one.date_utc == other.date_utc == start
    assert content_hash(one.content()) == content_hash(other.content())
    later = find_target("61 Cyg A", date_utc="2031-01-01")[0]
    assert content_hash(later.content()) != content_hash(one.content())
    # 5.28 arcsec a year (van Leeuwen 2007), less 3 years.
    moved = np.hypot((later.ra_deg - one.ra_deg) * np.cos(np.deg2rad(one.dec_deg)), later.dec_deg - one.dec_deg)
    assert moved[0] * 3600.0 == pytest.approx(5.28 * 3.0, rel=0.01)
    refused = pytest.raises(InputError, match="date_utc = soon")
    with refused:
        find_target("61 Cyg A", date_utc="soon")


def test_flags_say_what_is_not_known_of_a_companion():
    every = rank_sample(date_utc="2028-07-01")
    flags = dict(zip(every.name.tolist(), every.flags, strict=True))
    for name in ("36 Oph A", "gam Vir A"):
        assert "stability_extrapolated" in flags[name]
    assert "stability_extrapolated" not in flags["70 Oph A"]
    unknown = np.array(["companion_pa_unknown" in own for own in every.flags])
    lit = np.array(["companion_light_on" in own for own in every.flags])
    np.testing.assert_array_equal(unknown, lit & np.isnan(every.companion_pa_deg))
    old = np.array(["companion_position_old" in own for own in every.flags])
    assert 10 < unknown.sum() <= old.sum() < lit.sum(), "lists without angles have no dates either"


def test_companions_can_stay_where_they_were_first_listed():
    there, _ = find_target("alf Cen A", catalog="simbad_2012", date_utc="2028-07-01")
    assert there.companion_separation_arcsec[0] == pytest.approx(19.11)
    assert "companion_position_old" in there.flags[0]


def test_a_frame_of_targets_has_the_date_and_its_places():
    frame = load_targets(date_utc="2028-07-01").set_index("name")
    assert load_targets(date_utc="2028-07-01").attrs["date_utc"] == "2028-07-01T00:00:00"
    assert frame.loc["70 Oph A", "companion_separation_arcsec"] == pytest.approx(6.68, abs=0.02)
    assert frame.loc["70 Oph A", "companion_position_error_arcsec"] == 0.02
