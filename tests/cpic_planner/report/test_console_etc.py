"""What the terminal says of answers that are, and that are not, a detection."""

import re
from shlex import split

import pytest

from cpic_planner.cli.main import main


def told(capsys, *arguments):
    status = main([*arguments])
    captured = capsys.readouterr()
    assert status == 0, captured.err
    return " ".join(captured.out.split())


@pytest.mark.parametrize("star", ["omi2 Eri", "bar"])
def test_an_snr_below_the_threshold_is_not_a_detection(capsys, tmp_path, star):
    """SNR 5 is reached at the inner edge of the hole, where the threshold is highest: also for a star of one's own."""
    table = tmp_path / "mine.csv"
    table.write_text("name,distance_pc,v_mag,sp_type\nbar,5.0,4.4,K0V\n", encoding="utf-8")
    own = ["--catalog", str(table)] if star == "bar" else []
    text = told(capsys, "etc", star, "--snr", "5", "--band", "F520", *own)
    assert "✓" not in text
    assert "· measured, not detected" in text
    shown = float(re.search(r"in F520 is not a detection: ([\d.]+) % of such programmes show", text)[1])
    # The programme reaches 6.9 times the noise of the filtered image; 5 sigma in the tails of errors of two visits ask
    # for about 8, and the planet's own light scatters that by 1.4: Phi(-0.8).
    assert 10.0 < shown < 30.0
    assert "where the threshold is highest (a question for a detection takes that into account)" in text
    placed = told(capsys, "etc", star, "--snr", "5", "--band", "F520", "--separation-arcsec", "0.34", *own)
    assert "is not a detection" in placed
    assert "it was put" not in placed


def test_an_snr_of_a_tenth_has_no_mark_and_no_law(capsys, monkeypatch):
    """A faint planet; a near-infrared band would have to measure its optics first."""
    text = told(capsys, *split("etc 'tau Cet' --band F850 --time-s 36000 --contrast 1e-10 --separation-arcsec 0.65"))
    assert "✓" not in text
    assert "· measured, not detected" in text
    assert "Limited by photons (too faint even if the wavefront did not drift" in text


def test_a_detection_states_both_probabilities(capsys):
    """The first question of README and notebook."""
    text = told(capsys, "etc", "tau Cet", "--detect", "--separation-arcsec", "0.45")
    assert text.count("✓ detected") == 3
    assert "at least half of such programmes show the planet by a search that knows no place" in text
    assert "Each visit has a wavefront of its own" not in text
    explained = told(capsys, "etc", "tau Cet", "--detect", "--separation-arcsec", "0.45", "--explain")
    assert "by a blind search and at the known place: F520 at 0.450″ 50.0 and" in explained
    assert "Each visit has a wavefront of its own" in explained
    limit = told(capsys, "etc", "tau Cet", "--contrast-limit", "--separation-arcsec", "0.5")
    assert "✓" not in limit
    assert "Detected" not in limit


def test_the_ranking_says_what_score_zero_is_ordered_by(capsys):
    text = told(capsys, "rank", "--v-mag-max", "4", "--planets", "300", "--limit", "110")
    assert text.count("✓ detected") == 14
    assert "stars have a score above zero; the others follow by the margin of the reference planet" in text
    assert "Reference planets in 10.0 h, by a search that does not know the place, the best number of visits" in text
    assert ": 14 detected, 75 limited by photons" in text
    assert "○ insufficient time" in text
    assert "○ too faint" in text
    assert "✓ ok" not in text
