"""What the terminal says of answers that are, and that are not, a detection."""

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
    """SNR 5 is reached at the inner edge of the hole, where the threshold is 9.65: also for a star of one's own."""
    table = tmp_path / "mine.csv"
    table.write_text("name,distance_pc,v_mag,sp_type\nbar,5.0,4.4,K0V\n", encoding="utf-8")
    own = ["--catalog", str(table)] if star == "bar" else []
    text = told(capsys, "etc", star, "--snr", "5", "--band", "F520", *own)
    assert "✓" not in text
    assert "· measured, not detected" in text
    assert "The answer in F520 is not a detection: the significance is" in text
    assert "and the threshold 9.65" in text
    assert "inner edge of the dark hole, where the threshold is highest; --detect asks for a detection" in text
    placed = told(capsys, "etc", star, "--snr", "5", "--band", "F520", "--separation-arcsec", "0.34", *own)
    assert "is not a detection" in placed
    assert "The planet was put" not in placed


def test_an_snr_of_a_tenth_has_no_mark_and_no_law(capsys, monkeypatch):
    """A faint planet; a near-infrared band would have to measure its optics first."""
    text = told(capsys, *split("etc 'tau Cet' --band F850 --time-s 36000 --contrast 1e-10 --separation-arcsec 0.65"))
    assert "✓" not in text
    assert "· measured, not detected" in text
    assert "limited: F850 by photons (too faint even if the wavefront did not drift" in text


def test_a_detection_states_both_probabilities(capsys):
    """The first question of README and notebook."""
    text = told(capsys, "etc", "tau Cet", "--detect", "--separation-arcsec", "0.45")
    assert text.count("✓ detected") == 2
    assert "by a blind search and at the known place: F520 32.9 and 58.5 %; F662 10.3 and 58.5 %" in text
    assert "by simulated images that begins at 0.94 of the threshold" in text
    limit = told(capsys, "etc", "tau Cet", "--contrast-limit", "--separation-arcsec", "0.5")
    assert "✓" not in limit
    assert "Detected" not in limit


def test_the_ranking_says_what_score_zero_is_ordered_by(capsys):
    text = told(capsys, "rank", "--v-mag-max", "4", "--planets", "300", "--limit", "30")
    assert text.count("✓ detected") == 5
    assert "stars have a score above zero; the others follow by the margin of the reference planet" in text
    assert "Reference planets in 10.0 h: 5 detected" in text
    assert "○ too faint" in text
    assert "✓ ok" not in text
