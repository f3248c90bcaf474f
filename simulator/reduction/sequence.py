"""One sequence from Level 0 to Level 1."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from cpic_core import FloatArray, NDArray, Record
from simulator.camera import MaskBit
from simulator.products.keywords import Value, load_keywords
from simulator.products.write import fits_section
from simulator.reduction.frames import Staged, expected, raw_variance, scatter_of, staged
from simulator.reduction.level0 import Level0
from simulator.reduction.level1 import write_level1
from simulator.reduction.masters import Masters
from simulator.reduction.steps import Calibration, Master, Pixels, light

_TRAIL_ROWS = 4
NO_REJECTION = "none: a single frame has no other to be compared with"
REJECTION = "in time, by the exact law of the register (chance 1e-6 a pixel and frame)"


class Reduced(Record, eq=False):
    """Calibrations, flags and levels of a reduced sequence.

    Attributes
    ----------
    steps : dict of str to str
        Where each calibration came from, by step in the order of the reduction.
    mask_counts : dict of str to int
        Pixels of all frames with each bit, by the name of the bit; ``good`` has none.
    median_e, error_e : float
        Median of the light and of its error over good pixels.
    n_frames : int
    """

    steps: dict[str, str]
    mask_counts: dict[str, int]
    median_e: float
    error_e: float
    n_frames: int


def reduce_sequence(level0: Level0, masters: Masters, path: Path, scratch: Path | None = None) -> Reduced:
    """Reduce a sequence and write its Level-1 file with that of its errors.

    Parameters
    ----------
    level0 : Level0
    masters : Masters
        Masters from frames and maps; what is missing is taken from header and overscan.
    path : Path
        The Level-1 file.
    scratch : Path, optional
        Folder for raw frames on the way, 5 bytes a pixel.

    Raises
    ------
    InputError
        For a map that does not fit the frames.
    """
    columns = None
    if "BIAS" not in masters.made and "bias" not in masters.maps and "overscan_rows" in level0.sections:
        columns = _columns(level0, masters.calibration(level0), scratch)
    known = masters.calibration(level0, columns)
    flaws = np.zeros(level0.shape, dtype=np.uint8)
    for master in (known.bias, known.dark, known.flat):
        flaws |= 0 if master.mask is None else master.mask
    active = level0.sections["active"]
    counts = {"good": 0} | {str(bit.name).lower(): 0 for bit in MaskBit}
    total, count = np.zeros(level0.shape), np.zeros(level0.shape, dtype=np.int64)
    medians: list[float] = []
    with staged([level0], known.bias, known.cic_e, scratch) as frames:
        frames.reject()

        def reduced() -> Iterator[tuple[FloatArray, NDArray[np.uint8], dict[str, Value]]]:
            for index in range(len(frames)):
                image, mask = frames.frame(index)
                Staged.tally(image, mask, total, count)
                found = light(Pixels(image), known).image[active]
                bits = (mask | flaws)[active]
                found[(bits & MaskBit.BAD) != 0] = 0.0
                good = bits == 0
                counts["good"] += int(np.count_nonzero(good))
                flagged = {bit: int(np.count_nonzero(bits & bit)) for bit in MaskBit}
                for bit, number in flagged.items():
                    counts[str(bit.name).lower()] += number
                mean, spread = scatter_of(found[good])
                medians.append(float(np.median(found[good])) if good.any() else 0.0)
                own: dict[str, Value] = {**frames.own[index], "LEVEL": frames.levels_adu[index]}
                own |= {"FRAMEID": index + 1, "I_MEAN": mean, "I_STD": spread if good.any() else 0.0}
                own |= {"CR_NUM": flagged[MaskBit.COSMIC_RAY], "SP_NUM": flagged[MaskBit.SATURATED]}
                yield found, bits, own

        sizes: list[float] = []

        def errors() -> tuple[FloatArray, FloatArray]:
            mean = total / np.maximum(count, 1)
            likely = expected(mean, count, known, level0)
            bias = {name: -one for name, one in known.bias.shared.items()}
            made = light(Pixels(likely, raw_variance(likely, known, level0), None, bias), known)
            assert made.variance is not None
            shared = made.shared_variance[active]
            error = np.sqrt(made.variance[active] + shared)
            sizes.append(float(np.median(error[flaws[active] == 0])))
            return error, np.sqrt(shared)

        steps = _steps(known, level0)
        primary, image = _headers(level0, known, flaws, steps, path)
        write_level1(path, primary, image, reduced(), errors, n_frames=level0.n_frames)
    return Reduced(steps, counts, float(np.median(medians)), sizes[0], level0.n_frames)


def _columns(level0: Level0, known: Calibration, scratch: Path | None) -> Master:
    """Return the stripes of the bias, for want of a master, by the overscan rows of the frames themselves."""
    rows, part = level0.sections["overscan_rows"]
    rows = slice(min(rows.start + _TRAIL_ROWS, rows.stop - 1), rows.stop)
    stripes, noise = np.zeros(level0.shape), np.zeros(level0.shape)
    with staged([level0], known.bias, known.cic_e, scratch) as frames:
        mean, count = frames.mean()
    to_adu = known.em_gain / known.gain_e_adu
    stripes[:, part] = np.median(mean[rows, part] - known.cic_e[rows, part] * to_adu, axis=0)
    # A median of n values has pi / 2 of the variance of their mean.
    seen = np.maximum(count[rows, part].sum(axis=0), 1)
    noise[:, part] = np.sqrt(np.pi / 2.0 * raw_variance(known.cic_e * to_adu, known, level0)[rows, part][0] / seen)
    return Master(stripes, {"overscan rows": noise}, None, "none: stripes from the overscan rows of the frames")


def _steps(known: Calibration, level0: Level0) -> dict[str, str]:
    """Return what each step was made with."""
    curve = "of the instrument" if known.output_b or known.pixel_b else "none"
    return {
        "saturation": f"full wells of {'the header' if 'FULLWELL' in level0.header else 'the instrument'}, converter",
        "bad_pixels": "; ".join(m.name for m in (known.dark, known.flat) if m.mask is not None) or "none",
        "bias": known.bias.name,
        "level": "overscan of each frame" if level0.unlit().any() else "BIASLEV of the header: no overscan",
        "gain": f"{known.gain_e_adu:g} e-/ADU, register {known.em_gain:g}",
        "clock_charge": f"mean {float(np.median(known.cic_e)):.3g} e- of the instrument or its map",
        "nonlinearity": curve,
        "dark": known.dark.name,
        "smear": f"line shift of the instrument over {level0.exposure_s:g} s" if known.smear else "none",
        "flat": known.flat.name,
        "transfer": "none: charge stays where it arrived",
        "cosmic_rays": REJECTION if level0.n_frames > 1 else NO_REJECTION,
    }


def _headers(
    level0: Level0, known: Calibration, flaws: NDArray[np.uint8], steps: dict[str, str], path: Path
) -> tuple[dict[str, Value], dict[str, Value]]:
    """Return the values of the primary header and those that all images share."""
    table, (rows, columns) = load_keywords(), level0.sections["active"]
    primary: dict[str, Value] = {}
    image: dict[str, Any] = {}
    for keyword in table:
        value = level0.header.get(keyword.name)
        if value is None or keyword.section or not keyword.fits(value):
            continue
        if keyword.hdu != "image":
            primary[keyword.name] = value
        if keyword.hdu != "primary":
            image[keyword.name] = value
    primary |= {"OBSTYPE": level0.kind, "EXPTIME": level0.exposure_s, "CAMERA": "VIS"}
    image |= {"EMGAIN": known.em_gain, "GAIN": known.gain_e_adu, "RDNOISE": level0.detector.read_noise_e}
    for key, first in (("CRPIX1", columns.start), ("CRPIX2", rows.start)):
        if key in image:
            image[key] = float(image[key]) - first
    primary |= {"L0FILE": level0.path.name, "L0SEC": fits_section((rows, columns))}
    primary |= {"BP_NAM": steps["bad_pixels"], "BP_NUM": int(np.count_nonzero(flaws[rows, columns]))}
    for letter, master in (("B", known.bias), ("D", known.dark), ("F", known.flat)):
        mean, spread = scatter_of(master.value[rows, columns])
        primary |= {f"{letter}_NAM": master.name, f"{letter}_MEAN": mean, f"{letter}_STD": spread}
    primary |= {"CIC_NAM": steps["clock_charge"], "NL_NAM": steps["nonlinearity"], "CR_MOD": steps["cosmic_rays"]}
    return primary, image
