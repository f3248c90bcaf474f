"""What the texts of tables mean: spectral types, names of stars, plain values."""

from catalogs import parse_spectral_type, resolve_star, stellar_parameters
from catalogs.stellar_physics import is_composite, is_giant, luminosity_class, spectral_letter
from cpic_core import parse_yaml


def position_and_class(text):
    found = parse_spectral_type(text)
    return [found.position, found.luminosity_rank]


def star(text):
    match = resolve_star(text)
    assert match.note == ""
    return match.name


def class_and_giants(text):
    found = luminosity_class(text)
    assert is_giant(text) == (found in ("III", "III-IV", "I", "I-II", "II", "II-III"))
    return found


READERS = {
    "position_and_class": position_and_class,
    "flags": lambda text: list(parse_spectral_type(text).flags),
    "temperature": lambda text: stellar_parameters(text).teff_k,
    "letter": spectral_letter,
    "luminosity_class": class_and_giants,
    "composite": is_composite,
    "scalar": lambda text: parse_yaml(f"key: {text}")["key"],
    "star": star,
}


def test_texts_mean_what_people_mean(reading):
    reading.by(READERS)
