"""One frame of a visible camera, its expectation and its electrons: what tests ask of a camera in one call."""

import numpy as np

from simulator.camera import VisibleCamera


def expected_adu_map(rate_map_e_s, exposure_s, em_gain, detector):
    camera = VisibleCamera(detector)
    return camera.expected_adu(camera.prepare(rate_map_e_s, exposure_s, em_gain))


def expose_frame(rate_map_e_s, exposure_s, em_gain, detector, *, seed, path):
    camera = VisibleCamera(detector)
    return camera.expose(camera.prepare(rate_map_e_s, exposure_s, em_gain), seed=seed, path=path)


def to_electrons(adu, detector, em_gain):
    return (np.asarray(adu, np.float64) - detector.bias_adu) * (detector.gain_e_adu / em_gain)
