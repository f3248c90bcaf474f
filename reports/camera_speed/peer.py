"""Run another simulator in its own environment: ``python peer.py emccd-detect|getframes SETUP.npz``.

Reads one request a line from its input (JSON), answers each with one line of JSON. Needs numpy and the package alone.
``SETUP.npz`` holds the camera and the scenes that ours is given, in electrons per second: quantum efficiency is 1.
"""

from __future__ import annotations

import json
import math
import sys
import tempfile
import time
import warnings
from collections.abc import Callable
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

Register = Callable[[np.ndarray, int], np.ndarray]
Pair = tuple[Callable[[int], Any], Register]


def emccd_detect(setup: dict[str, Any], rates: np.ndarray, exposure_s: float, gain: float, mode: str) -> Pair:
    """Frames by emccd-detect, and its register alone."""
    from astropy.io import fits
    from emccd_detect.emccd_detect import EMCCDDetect
    from emccd_detect.rand_em_gain import rand_em_gain

    folder = Path(tempfile.mkdtemp(prefix="peer-"))
    paths = {}
    for name in ("response_map", "hot_map"):
        paths[name] = str(folder / f"{name}.fits")
        fits.HDUList([fits.PrimaryHDU(), fits.ImageHDU(setup[name])]).writeto(paths[name])
    fast = mode.startswith("fast")
    camera = EMCCDDetect(
        em_gain=gain,
        full_well_image=setup["full_well_e"],
        full_well_serial=setup["register_full_well_e"],
        dark_current=setup["dark_e_s"],
        cic=setup["cic_e"],
        read_noise=setup["read_noise_e"],
        bias=setup["bias_adu"] * setup["gain_e_adu"],
        qe=1.0,
        cr_rate=setup["cosmic_ray_rate"],
        pixel_pitch=setup["pixel_um"] * 1e-6,
        eperdn=setup["gain_e_adu"],
        nbits=int(setup["adc_bits"]),
        numel_gain_register=int(setup["stages"]),
        flat_path=paths["response_map"],
        hot_pixel_path=paths["hot_map"],
        row_read_time=setup["line_shift_s"],
        gain_CIC_Q="roman" if mode == "fast" else 0,
        upstream_spill_prob=0.5,
        fast_gain_mode=fast,
        fpn_path=None,
        bias_sigma_col=setup["stripe_adu"] * setup["gain_e_adu"],
        bias_sigma_row=0.0,
    )
    stages = dict.fromkeys(range(1, int(setup["stages"]) + 1), camera.avg_gain_P)

    def register(charge: np.ndarray, seed: int) -> np.ndarray:
        np.random.seed(seed)  # noqa: NPY002 (the package draws from the global generator)
        return np.asarray(rand_em_gain(charge.astype(float), stages, len(stages), fast, fast))

    return lambda seed: camera.sim_sub_frame(rates, exposure_s), register


def getframes(setup: dict[str, Any], rates: np.ndarray, exposure_s: float, gain: float, mode: str) -> Pair:
    """Frames by getframes with its buffers reused, and its register alone."""
    import getframes as gf
    from getframes.noise import apply_gain_stage

    config = gf.CameraConfig(
        name="camera",
        sensor_type="EMCCD",
        resolution=rates.shape,
        pixel_size_um=setup["pixel_um"],
        quantum_efficiency=1.0,
        full_well_e=setup["full_well_e"],
        output_full_well_e=setup["register_full_well_e"],
        bit_depth=int(setup["adc_bits"]),
        gain_e_per_adu=setup["gain_e_adu"],
        bias_offset_adu=setup["bias_adu"],
        read_noise_e=setup["read_noise_e"],
        dark_current_e_per_s=setup["dark_e_s"],
        dark_current_nonuniformity=setup["dsnu_rms"],
        hot_pixel_fraction=setup["hot_fraction"],
        hot_pixel_factor=setup["hot_factor"],
        dead_pixel_fraction=setup["dead_fraction"],
        bad_column_fraction=setup["bad_columns"] / rates.shape[1],
        prnu=setup["prnu_rms"],
        nonlinearity=setup["pixel_loss"],
        cti=setup["parallel_cti"],
        blooming=True,
        clock_induced_charge_e=setup["cic_e"],
        em_gain=gain,
        cosmic_ray_rate_per_cm2_s=setup["cosmic_ray_rate"],
        cosmic_ray_track_length_px=setup["track_px"],
        bias_structure_amplitude_adu=setup["stripe_adu"],
        readout_common_mode_noise_adu=setup["drift_adu"],
    )
    camera = gf.Camera(config, precision=mode)
    workspace, out = gf.DetectorWorkspace(), np.empty(rates.shape, np.uint32)
    rates = rates.astype(camera.precision)

    def frame(seed: int) -> np.ndarray:
        return np.asarray(
            camera.expose(rates, exposure_s, seed=seed, include_truth=False, workspace=workspace, out=out).data
        )

    def register(charge: np.ndarray, seed: int) -> np.ndarray:
        rng = np.random.default_rng(seed)
        factor = config.gain_excess_noise_factor
        return np.asarray(apply_gain_stage(charge.astype(camera.precision), gain, factor, rng))

    return frame, register


PEERS = {"emccd-detect": emccd_detect, "getframes": getframes}


def excess(
    register: Callable[[np.ndarray, int], np.ndarray], gain: float, mean: float, pixels: int
) -> dict[str, float]:
    """Variance of the output for Poisson input over that without a register, ``F^2``, and its standard error."""
    charge = np.random.default_rng(1).poisson(mean, pixels)
    out = register(charge, 2).astype(np.float64)
    residual = out - out.mean()
    variance = float((residual**2).mean())
    error = math.sqrt(float((residual**4).mean()) - variance**2) / math.sqrt(pixels)
    scale = gain**2 * mean
    return {"mean": float(out.mean()) / (gain * mean), "factor2": variance / scale, "error": error / scale}


def main() -> None:
    """Answer requests until the input ends."""
    name, setup_path = sys.argv[1:]
    warnings.simplefilter("ignore")
    answers, sys.stdout = sys.stdout, sys.stderr  # packages may print
    with np.load(setup_path) as file:
        setup = {key: file[key] if file[key].ndim else float(file[key]) for key in file.files}
    ready: dict[str, Pair] = {}
    print(json.dumps({"version": metadata.version(name), "numpy": np.__version__}), file=answers, flush=True)
    for line in sys.stdin:
        ask = json.loads(line)
        key = json.dumps([ask["scene"], ask["gain"], ask["mode"]])
        if key not in ready:
            rates = setup[ask["scene"]]
            ready[key] = PEERS[name](setup, rates, ask["exposure_s"], ask["gain"], ask["mode"])
        frame, register = ready[key]
        if "mean" in ask:
            answer = excess(register, ask["gain"], ask["mean"], ask["pixels"])
        else:
            began = time.process_time(), time.perf_counter()
            image = frame(ask["seed"])
            answer = {
                "cpu_s": time.process_time() - began[0],
                "wall_s": time.perf_counter() - began[1],
                "median": float(np.median(image)),
                "average": float(np.mean(image)),
            }
        print(json.dumps(answer), file=answers, flush=True)


if __name__ == "__main__":
    main()
