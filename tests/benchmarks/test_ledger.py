"""The ledger that decides what is simulated: closed forms, and the choice among them."""

from simulator import load_instrument, load_scene
from simulator.knobs import dial_of
from simulator.ledger import choose, forecast

INSTRUMENT = load_instrument()
FRAMES = {"band": "F662", "exposure_s": 3.0, "n_frames": 30, "em_gain": 300.0}


def test_what_is_predicted(timed):
    scene = load_scene("paper_example")
    assert timed("ledger: forecast", lambda: forecast(scene, INSTRUMENT, **FRAMES)).sizes


def test_what_is_chosen(timed):
    seen, dial = forecast(load_scene("paper_example"), INSTRUMENT, **FRAMES), dial_of(tolerance=0.02)
    assert timed("ledger: choose", lambda: choose(seen, dial), repeats=5).rows
