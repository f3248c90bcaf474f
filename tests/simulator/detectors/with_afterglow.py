"""What the program says with an effect that needs the frame before; called with its fraction and the gain."""

import json
import sys

from afterglow import Afterglow

from simulator.detectors import chains

# The one line of the chain, before anything reads it.
chains.VISIBLE = (*chains.VISIBLE[:8], Afterglow(), *chains.VISIBLE[8:])

import numpy as np  # noqa: E402

from cpic_core import InputError  # noqa: E402
from cpic_planner import signal_to_noise  # noqa: E402
from simulator import load_instrument, load_scene, observe  # noqa: E402
from simulator.camera import FrameNoise, VisibleCamera, stackable  # noqa: E402
from simulator.detectors import PastExposure  # noqa: E402
from simulator.ledger import camera_ledger, forecast  # noqa: E402
from simulator.observing import hole_stackable, hole_stacks  # noqa: E402

FRACTION, GAIN = float(sys.argv[1]), float(sys.argv[2])
PLANET = {"name": "b", "radius_rjup": 1, "distance_au": 0.2, "phase_deg": 60, "separation_arcsec": 0.6, "pa_deg": 315.0}
SCENE = {"name": "s", "cstar": {"name": "star", "v_mag": 4.0, "teff_k": 5800}, "planets": [PLANET]}
SETTINGS = {"band": "F662", "exposure_s": 10.0, "n_frames": 4, "em_gain": GAIN}
QUIET = ("photon_noise", "read_noise", "afterglow", "em_register")


def message(call, *args, **kwargs):
    """What a call is refused with."""
    try:
        call(*args, **kwargs)
    except InputError as error:
        return str(error)
    return ""


def moments(camera, rate_e_s):
    """Mean and variance of a pixel at the register input after a frame of the same light, and without one."""
    exposure = camera.prepare(np.full((300, 300), rate_e_s), 10.0, GAIN)
    past = [PastExposure(exposure.mean_e, 0.1)]
    per_adu = camera.detector.gain_e_adu / GAIN
    frames = [
        camera.expose(exposure, seed=1, path=("a", k), past=one).adu * per_adu for k, one in enumerate((past, ()))
    ]
    return [[float(frame.mean() - camera.detector.bias_adu * per_adu), float(frame.var())] for frame in frames]


def sequence(instrument):
    """Mean electrons that come back in frame 0 and frame 1 of a window, over those collected."""
    seen = observe(SCENE, **SETTINGS, instrument=instrument, window="hole")
    first, second = (seen.frame(k).charge for k in (0, 1))
    return [first.get("afterglow"), second["afterglow"] / float(np.minimum(seen.expected_e, 1e5).sum())]


plain, glowing = load_instrument(), load_instrument({"detector": {"afterglow": {"fraction": FRACTION}}})
off = glowing.switched({"afterglow": False})
camera = VisibleCamera(glowing.detector.switched(off=("all",), on=QUIET))
one = camera.prepare(np.full((40, 40), 100.0), 10.0, GAIN)
alone = {name: name == "afterglow" for name in type(glowing.detector.switches).model_fields}
window = observe(SCENE, **SETTINGS, instrument=glowing.switched(alone), window="hole")
lit = forecast(load_scene(SCENE), glowing, **SETTINGS)
asked = {"time_s": 3600.0, "separation_arcsec": 0.6, "bands": ["F662"], "exposure_s": 20.0, "em_gain": GAIN}
answers = [signal_to_noise("HIP 71681", instrument=instrument, **asked)[0] for instrument in (glowing, off)]
told = {
    "frames": moments(camera, 100.0),
    "noise": [float(FrameNoise.of(camera.detector, GAIN, 10.0).variance_e2(charge)) for charge in (0.0, 1000.0)],
    "sequence": sequence(glowing),
    "untouched": bool(
        np.array_equal(*(observe(SCENE, **SETTINGS, instrument=i, window="hole").frame(1).adu for i in (plain, off)))
    ),
    "rows": [
        next(row.to_dict() for row in camera_ledger(instrument) if row.key == "afterglow")
        for instrument in (glowing, plain, off)
    ],
    "size": lit.sizes["afterglow"],
    "stackable": stackable(camera, one).message,
    "hole": hole_stackable(window).message,
    "stack": message(window.stack),
    "hole_stacks": message(hole_stacks, window),
    "counting": message(signal_to_noise, "HIP 71681", instrument=glowing, **asked, mode="photon_counting"),
    "snr": [answer.value for answer in answers],
    "budget": [dict(answer.budget) for answer in answers],
}
print(json.dumps(told))
