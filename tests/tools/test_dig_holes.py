"""The shipped dark holes and metrics are made by one program."""

from simulator.config import load_instrument, preset_names
from simulator.imaging import metrics_key, psf_metrics
from simulator.imaging.pupil import shipped_file
from tools import dig_holes

EVERY = [
    (preset, band)
    for preset in preset_names("instrument")
    for instrument in [load_instrument(preset)]
    if instrument.coronagraph.table is None
    for band in instrument.bands
]


def test_rebuild_writes_what_is_shipped(tmp_path, monkeypatch):
    every = list(dig_holes._shipped_bands())
    assert len(every) == len({metrics_key(made, band) for made, band in every})
    assert {metrics_key(load_instrument(preset), band) for preset, band in EVERY} == {
        metrics_key(made, band) for made, band in every
    }
    monkeypatch.setattr(dig_holes, "_shipped_bands", lambda: [every[0], every[-1]])
    monkeypatch.setattr(dig_holes, "measure", lambda instrument, band: psf_metrics(instrument, band).to_arrays())
    written = dig_holes.rebuild(tmp_path, holes=False)
    assert len(written) == 2
    for path in written:  # exact and rounded: rounding what is rounded changes nothing
        assert path.read_bytes() == (shipped_file("metrics", "", "").parent / path.name).read_bytes()
