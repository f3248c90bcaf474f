"""What stars, bands, names and YAML are refused, each in one line that names key, value and what is allowed."""

import pytest
from astropy.table import Table
from hypothesis import given, settings, strategies as st

from catalogs import Band, load_known_planets, open_catalogue, parse_spectral_type, resolve_star, stellar_parameters
from catalogs.coordinates import propagate
from cpic_core import InputError, parse_yaml

BAND = {"name": "X", "camera": "VIS", "center_nm": 600.0, "width_nm": 10.0, "t_opt": 0.5, "qe": 0.5}

STILL = {"ra_deg": 1.0, "dec_deg": 2.0, "pm_ra_mas_yr": 0.0, "pm_dec_mas_yr": 0.0, "parallax_mas": 50.0, "rv_km_s": 0.0}

HEADER = {"name": "x", "distance_pc": "10", "v_mag": "5", "sp_type": "G2V"}

SIMPLE = "name,distance_pc,v_mag,sp_type\nfirst,10,5.5,G2V\nsecond,20,6,K1V\n"

READERS = {
    "stellar_parameters": stellar_parameters,
    "spectral_type": parse_spectral_type,
    "star": resolve_star,
    "yaml": parse_yaml,
    "band": lambda change: Band(**(BAND | change)),
    "catalogue": open_catalogue,
    "planets_source": load_known_planets,
    "motion": lambda change: propagate(**(STILL | change), epoch_yr=2000.0, to_epoch_yr=2020.0),
}


@pytest.fixture
def tables(tmp_path):
    """Readers of what stands in mine.csv."""

    def written(content):
        (tmp_path / "mine.csv").write_bytes(content if isinstance(content, bytes) else content.encode())
        return tmp_path / "mine.csv"

    def opened(content):
        return open_catalogue(written(content), strict=True)

    def with_column(change, unit=""):
        row = HEADER | change
        return opened(
            ",".join(f"{name}{unit if name in change else ''}" for name in row) + f"\n{','.join(row.values())}\n"
        )

    return {
        "user_table": opened,
        "known_planets": lambda text: load_known_planets(written(text), strict=True),
        "third_row": lambda line: opened(f"{SIMPLE}{line}\n"),
        "user_table_columns": lambda heading: with_column({heading: "10"}),
        "value_of_column": with_column,
        "unit_of_column": lambda units: with_column(dict.fromkeys(units, "1"), f" [{next(iter(units.values()))}]"),
    }


def test_bad_input_is_refused_in_one_line(refusal, tables):
    refusal.by(READERS | tables)


@pytest.mark.parametrize(
    ("content", "word"),
    [
        (bytes(range(256)) * 20, "binary"),
        ("name,dist,V,SpT\nZoë\x02,5,5,G2V\n".encode("latin-1"), "binary"),
        (b"SIMPLE  =                    T / broken", "FITS"),
    ],
)
def test_bytes_that_are_no_table_are_refused(tables, content, word):
    with pytest.raises(InputError, match=rf"mine\.csv.*{word}") as refused:
        tables["user_table"](content)
    assert "\n" not in str(refused.value)


TEXT = st.text(st.characters(codec="utf-8", categories=["L", "N"]), min_size=1, max_size=12)


def test_columns_of_arrays_are_left_out(refused, tmp_path):
    stars = Table({"name": ["a"], "dist": [[1.0, 2.0]], "V": [5.0], "SpT": ["G2V"]})
    stars.write(tmp_path / "t.fits")
    refused(r"t\.fits column distance_pc or parallax_mas = missing", open_catalogue, tmp_path / "t.fits")
    stars["plx"] = [10.0]
    stars.write(tmp_path / "more.fits")
    assert (
        "more.fits: columns of several values per row are left out: dist"
        in open_catalogue(tmp_path / "more.fits").notes
    )


@settings(max_examples=200, deadline=None)
@given(
    data=st.binary(max_size=300)
    | TEXT.map(str.encode)
    | st.lists(st.text("abc,;\n\t\"'#|0.5- ", max_size=40), max_size=6).map(lambda parts: "\n".join(parts).encode())
)
def test_any_file_is_read_or_refused_in_one_line(tmp_path_factory, data):
    path = tmp_path_factory.getbasetemp() / "any.csv"
    path.write_bytes(data)
    refused = None
    try:
        open_catalogue(path)
    except InputError as refusal:
        refused = str(refusal)
    assert refused is None or ("\n" not in refused and "any.csv" in refused)
