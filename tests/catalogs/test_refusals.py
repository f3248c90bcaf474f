"""What stars, bands, names and YAML are refused, each in one line that names key, value and what is allowed."""

from catalogs.bands import Band
from catalogs.coordinates import propagate
from catalogs.names import resolve_star
from catalogs.spectral_types import parse_spectral_type, stellar_parameters
from catalogs.strict_yaml import parse_yaml

BAND = {"name": "X", "camera": "VIS", "center_nm": 600.0, "width_nm": 10.0, "t_opt": 0.5, "qe": 0.5}
STILL = {"ra_deg": 1.0, "dec_deg": 2.0, "pm_ra_mas_yr": 0.0, "pm_dec_mas_yr": 0.0, "parallax_mas": 50.0, "rv_km_s": 0.0}

READERS = {
    "stellar_parameters": stellar_parameters,
    "spectral_type": parse_spectral_type,
    "star": resolve_star,
    "yaml": parse_yaml,
    "band": lambda change: Band(**(BAND | change)),
    "motion": lambda change: propagate(**(STILL | change), epoch_yr=2000.0, to_epoch_yr=2020.0),
}


def test_bad_input_is_refused_in_one_line(refusal):
    refusal.by(READERS)
