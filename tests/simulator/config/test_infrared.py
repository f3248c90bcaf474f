import pytest

from catalogs.errors import InputError
from simulator.config import load_instrument
from simulator.config.detector import InfraredSwitches


def test_shipped_camera_is_labelled_assumed():
    instrument = load_instrument()
    detector = instrument.near_infrared.detector
    assert detector.shape == (512, 640)
    known = {key: item for key, item in instrument.provenance.items() if key.startswith("near_infrared.detector.")}
    numbers = set()
    for key, value in detector.model_dump().items():
        if key in ("flaws", "persistence"):
            numbers |= {f"near_infrared.detector.{key}.{name}" for name in value}
        elif key != "switches":
            numbers.add(f"near_infrared.detector.{key}")
    assert set(known) == numbers
    assert {item.confidence for item in known.values()} == {"A"}
    assert all(item.source for item in known.values())


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("n_columns", 8),
        ("n_rows", 1.5),
        ("star_column", 640),
        ("star_row", 512),
        ("pixel_um", 0.5),
        ("full_well_e", 10),
        ("nonlinearity_at_full_well", 0.5),
        ("dark_e_s", -1),
        ("read_noise_e", -1),
        ("reset_noise_e", float("nan")),
        ("gain_e_adu", 0),
        ("adc_bits", 17),
        ("bias_adu", 65535),
        ("bias_adu", 6e4 + 1),
        ("readout_mode", "fowler"),
        ("n_reads", 1),
        ("n_reads", 1001),
        ("frame_time_s", 0),
        ("interpixel_coupling", 0.3),
    ],
)
def test_bad_values_are_named_in_one_line(key, value):
    with pytest.raises(InputError) as caught:
        load_instrument({"near_infrared": {"detector": {key: value}}})
    assert "near_infrared.detector" in str(caught.value)
    assert key in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("section", "key", "value"),
    [
        ("flaws", "prnu_rms", 0.4),
        ("flaws", "seed", -1),
        ("flaws", "hot_fraction", 0.6),
        ("flaws", "columns", 1),
        ("persistence", "fraction", 1),
        ("persistence", "decay_s", 0),
        ("switches", "cic", True),
        ("switches", "flat", "perhaps"),
    ],
)
def test_bad_values_of_sections(section, key, value):
    with pytest.raises(InputError, match=rf"near_infrared\.detector\.{section}\.{key}"):
        load_instrument({"near_infrared": {"detector": {section: {key: value}}}})


def test_bias_below_the_top_of_the_converter():
    with pytest.raises(InputError, match="bias_adu.*below the ADC maximum 4095"):
        load_instrument({"near_infrared": {"detector": {"bias_adu": 5000, "adc_bits": 12}}})


def test_switched():
    detector = load_instrument().near_infrared.detector
    none = detector.switched(off=("all",))
    assert not any(none.switches.model_dump().values())
    some = none.switched(on=("flat", "dark"))
    assert {name for name, on in some.switches.model_dump().items() if on} == {"flat", "dark"}
    assert all(detector.switched(on=("all",)).switches.model_dump().values())
    assert set(InfraredSwitches.model_fields) == set(detector.switches.model_dump())
    with pytest.raises(InputError, match="switches = cic"):
        detector.switched(off=("cic",))


@pytest.mark.parametrize(
    ("mode", "exposure_s", "reads"),
    [
        ("single", 30.0, 1),
        ("cds", 30.0, 2),
        ("cds", 0.0, 2),
        ("up_the_ramp", 30.0, 8),
        ("up_the_ramp", 0.0, 2),
        ("up_the_ramp", 0.033, 2),
        ("up_the_ramp", 0.066, 3),
        ("up_the_ramp", 0.0989, 3),
        ("up_the_ramp", 0.231, 8),
        ("up_the_ramp", 1e6, 8),
    ],
)
def test_reads_that_fit_into_an_exposure(mode, exposure_s, reads):
    detector = load_instrument({"near_infrared": {"detector": {"readout_mode": mode}}}).near_infrared.detector
    assert detector.reads_of(exposure_s) == reads
