import pytest

from cpic_planner.cli.main import main


@pytest.mark.parametrize("command", ["plan", "confirm paper_example", "simulate paper_example"])
def test_what_is_no_address_is_refused_before_any_work(command, tmp_path, capsys):
    assert main([*command.split(), "--scheduler", "nonsense", "--out", str(tmp_path / "out")]) == 2
    assert capsys.readouterr().err.strip().splitlines() == [
        "cpic: --scheduler = nonsense: not accepted; allowed: an address tcp://host:port"
    ]
    assert not (tmp_path / "out").exists()
