"""A minimal Level-1 reduction of written products recovers the light that went into them."""

import numpy as np
import pytest
from astropy.io import fits

from simulator import calibrate, load_instrument, observe, write_level0
from simulator.camera import MaskBit
from simulator.detectors import excess_noise_factor2

SCENE = {"name": "field star", "cstar": {"v_mag": 3.5, "teff_k": 5800, "ra": 10.0, "dec": 20.0}}
# What a minimal reduction has no step for.
OFF = {"nonlinearity": False, "parallel_cti": False, "serial_cti": False, "interference": False}
BAND, EXPOSURE_S, GAIN, FRAMES = "F662", 60.0, 20.0, 6


@pytest.fixture(scope="module")
def tree(tmp_path_factory):
    """Bias, dark, flat and science sequences as Level-0 files, with truth for the science."""
    folder = tmp_path_factory.mktemp("level0")
    instrument = load_instrument()
    common = {"instrument": instrument, "switches": OFF}
    sequences = {
        "bias": calibrate("BIAS", n_frames=6, em_gain=GAIN, **common),
        "dark": calibrate("DARK", n_frames=6, exposure_s=EXPOSURE_S, em_gain=GAIN, **common),
        "flat": calibrate("FLAT", n_frames=6, exposure_s=1.0, band=BAND, level_e=30_000, **common),
        "flat_bias": calibrate("BIAS", n_frames=6, realisation=1, **common),
        "science": observe(SCENE, band=BAND, exposure_s=EXPOSURE_S, n_frames=FRAMES, em_gain=GAIN, **common),
    }
    paths = {name: write_level0(item, folder, truth=name == "science") for name, item in sequences.items()}
    return paths, sequences["science"], next(folder.glob("Truth/**/*_TRUTH.fits"))


def stack_of(path):
    """Frames, each with the level of its own overscan taken off: the first step of any reduction."""
    with fits.open(path) as units:
        frames = np.stack([unit.data.astype(float) for unit in units[1:]])
        columns = slice(
            *(
                int(end) - shift
                for end, shift in zip(
                    units[1].header["OVERSCAN"].strip("[]").split(",")[0].split(":"), (1, 0), strict=True
                )
            )
        )
        return frames - np.median(frames[:, :, columns], axis=(1, 2), keepdims=True), units[1].header


def clipped_mean(frames):
    """Mean over frames without what lies far above the median: particles."""
    hit = frames - np.median(frames, axis=0) > 25
    return np.where(hit, 0.0, frames).sum(axis=0) / (~hit).sum(axis=0)


@pytest.mark.long
def test_reduction_recovers_the_input_map_within_its_noise(tree):
    paths, sequence, truth_path = tree
    science, header = stack_of(paths["science"])
    bias = stack_of(paths["bias"])[0].mean(axis=0)
    dark = clipped_mean(stack_of(paths["dark"])[0]) - bias
    flat_frames, flat_header = stack_of(paths["flat"])
    flat = (clipped_mean(flat_frames) - stack_of(paths["flat_bias"])[0].mean(axis=0)) * flat_header["GAIN"]
    columns, rows = (
        slice(int(a) - 1, int(b)) for a, b in (part.split(":") for part in header["DATASEC"].strip("[]").split(","))
    )
    active = (rows, columns)
    flat = flat[active] / np.median(flat[active])
    with fits.open(truth_path) as units:
        masks = np.stack([unit.data[active] for unit in units if unit.name == "MASK"])
    assert len(masks) == FRAMES
    electrons = (science - bias - dark)[(slice(None), *active)] * header["GAIN"] / header["EMGAIN"]
    unusable = (masks & (MaskBit.BAD | MaskBit.HOT | MaskBit.WARM | MaskBit.SATURATED | MaskBit.COSMIC_RAY)) != 0
    used = (~unusable).sum(axis=0)
    found = np.where(unusable, 0.0, electrons).sum(axis=0) / np.maximum(used, 1) / np.maximum(flat, 0.1)
    light = sequence.mean_rate_map[active] * EXPOSURE_S
    good = (used >= 3) & (light < 1000)
    detector = sequence.instrument.detector
    factor2 = float(excess_noise_factor2(GAIN))
    one = factor2 * (light + detector.cic_e) + (detector.read_noise_e**2 + detector.gain_e_adu**2 / 12) / GAIN**2
    # Means of six frames. The bias of the science and that of the dark cancel.
    calibration = (one - factor2 * light) / 6
    flat_noise = light**2 * (30_000 + 2 * detector.read_noise_e**2) / 30_000**2 / 6
    sigma = np.sqrt(one / np.maximum(used, 1) + calibration + flat_noise)
    pull = ((found - light) / sigma)[good]
    assert good.mean() > 0.97
    core = pull[np.abs(pull) < 5]
    assert abs(core.mean()) < 0.03
    assert core.std() == pytest.approx(1, abs=0.05)
    # Absolute level over the halo: a per cent of what light there is.
    ring = good & (light > 20)
    assert (found[ring].sum() - light[ring].sum()) / light[ring].sum() == pytest.approx(0, abs=0.01)
    assert np.mean(np.abs(pull) > 6) < 1e-3
