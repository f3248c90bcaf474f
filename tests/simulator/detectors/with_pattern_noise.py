"""What the program says with one more effect in the chain of the visible camera; called with its rms and the gain."""

import json
import sys

from pattern_noise import PatternNoise

from simulator.detectors import chains

# The one line of the chain, before anything reads it.
chains.VISIBLE = (*chains.VISIBLE[:-1], PatternNoise(), chains.VISIBLE[-1])

import numpy as np  # noqa: E402

from cpic_core import InputError  # noqa: E402
from cpic_planner import signal_to_noise  # noqa: E402
from cpic_planner.report.words import term_text  # noqa: E402
from simulator import load_instrument, load_scene, observe  # noqa: E402
from simulator.camera import FrameNoise, VisibleCamera, stack_electrons, stackable  # noqa: E402
from simulator.ledger import camera_ledger, forecast  # noqa: E402

RMS_E, GAIN = float(sys.argv[1]), float(sys.argv[2])
PLANET = {"name": "b", "radius_rjup": 1, "distance_au": 0.2, "phase_deg": 60, "separation_arcsec": 0.6, "pa_deg": 315.0}
SCENE = {"name": "s", "cstar": {"name": "star", "v_mag": 4.0, "teff_k": 5800}, "planets": [PLANET]}
SETTINGS = {"band": "F662", "exposure_s": 10.0, "n_frames": 4, "em_gain": GAIN}


def with_rms(rms_e):
    """An instrument with a pattern."""
    return load_instrument({"detector": {"pattern_noise": {"rms_e": rms_e}}})


def variances(detector):
    """Variance of a dark frame in ADU^2, and of the sum of 50 in e-^2 at the register input, over 50."""
    camera = VisibleCamera(detector.switched(off=("all",), on=("pattern_noise", "read_noise")))
    exposure = camera.prepare(np.zeros((300, 300)), 1.0, GAIN)
    pair = [camera.expose(exposure, seed=1, path=("p", i)).adu.astype(float) for i in (0, 1)]
    assert stackable(camera, exposure).status.value == "ok"
    assert abs(camera.expected_adu(exposure) - detector.bias_adu).max() == 0
    stack = stack_electrons(camera, exposure, 50, seed=1, path=("s",))
    return [(pair[0] - pair[1]).var() / 2, stack.var() / 50]


def refusal():
    """What a value out of range is refused with."""
    try:
        with_rms(-1)
    except InputError as error:
        return str(error)
    return ""


plain, noisy = load_instrument(), with_rms(RMS_E)
off = noisy.switched({"pattern_noise": False})
sizes = forecast(load_scene(SCENE), noisy, **SETTINGS).sizes
seen = observe(SCENE, **SETTINGS, instrument=noisy, window="hole", tolerance=0.3)
asked = {"time_s": 3600.0, "separation_arcsec": 0.6, "bands": ["F662"], "exposure_s": 20.0, "em_gain": GAIN}
answers = [signal_to_noise("HIP 71681", instrument=instrument, **asked)[0] for instrument in (noisy, off)]
told = {
    "default": plain.detector.pattern_noise.rms_e,
    "source": plain.provenance["detector.pattern_noise.rms_e"].source,
    "refused": refusal(),
    "read_noise_e": noisy.detector.read_noise_e,
    "k": noisy.detector.gain_e_adu,
    "frames": variances(noisy.detector),
    "plain": variances(plain.detector),
    "rows": [
        next(row.to_dict() for row in camera_ledger(instrument) if row.key == "pattern_noise")
        for instrument in (noisy, plain, off)
    ],
    "noise": [float(FrameNoise.of(one.detector, GAIN, 1.0).variance_e2(0.0)) for one in (noisy, plain)],
    "size": sizes["pattern_noise"],
    "left_out": "pattern_noise" in seen.choice.switches,
    "snr": [answer.value for answer in answers],
    "budget": [dict(answer.budget) for answer in answers],
    "words": term_text("pattern_noise"),
}
print(json.dumps(told))
