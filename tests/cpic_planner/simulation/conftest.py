import pytest

from simulator.config import load_instrument

SMALL = {"detector": {"n_columns": 236, "n_rows": 206, "star_column": 118, "star_row": 100}}
STAR = {"name": "star", "cstar": {"v_mag": 4.0, "teff_k": 5200}}


@pytest.fixture(scope="session")
def small():
    """An instrument whose visible frames are small and fast; its dark holes are those of the default one."""
    return load_instrument(SMALL)


@pytest.fixture
def star():
    """A scene of one star."""
    return dict(STAR)
