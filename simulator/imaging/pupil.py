"""The pupil: apodizers and static aberrations, maps of amplitude and phase that are fixed for a seed.

Both are Gaussian random fields with power ``max(f, 1)^-slope``, f in cycles per pupil diameter, up to half a cycle per
sample: the law of the drift screens, and everything that the pupil grid can hold. They are drawn on a grid twice as
wide, so that opposite edges of the pupil are independent, and scaled to the exact rms over the clear disc. The maps are
*piecewise constant on their own grid*, as the steps of the apodizer are: a finer pupil grid repeats the samples
(`simulator.imaging.pupil.upsample`) and sees the same optics.
"""

from __future__ import annotations

import functools
import math
import re
from collections.abc import Iterable
from importlib.resources import files
from pathlib import Path
from typing import Literal, TypeAlias, get_args

import numpy as np

from cpic_core import FloatArray, InputError, NDArray, Record, check_word, is_file, stream
from simulator.config import Instrument
from simulator.config.map_files import MapFile, read_maps, real_map

Kind: TypeAlias = Literal["amplitude", "intensity"]
KINDS: tuple[str, ...] = get_args(Kind)
MIN_SIDE, MAX_SIDE, MAX_FILE_SIDE = 8, 2048, 8192
ROUNDING = 1e-6  # single precision and resampling
STRIPS = 32  # of a cell that the rim of the disc cuts
SHIPPED_NAME = re.compile(r"lpx\d+")


@functools.cache
def shipped_apodizers() -> tuple[str, ...]:
    """Return the names of the masks that come with the package."""
    folder = files("simulator.imaging") / "data"
    stems = (entry.name.removesuffix(".npz") for entry in folder.iterdir() if entry.name.endswith(".npz"))
    return tuple(sorted(stem for stem in stems if SHIPPED_NAME.fullmatch(stem)))


def load_apodizer(name_or_path: str | Path, *, kind: Kind = "amplitude", samples: int | None = None) -> FloatArray:
    """Return the amplitude transmission of an apodizer.

    Parameters
    ----------
    name_or_path : str or Path
        Name of a shipped mask (``lpx43``), an npz file with one array (or one named ``transmission``, ``amplitude`` or
        ``intensity``), or a FITS file (first image). The map spans the pupil diameter exactly. Pickled objects are
        refused.
    kind : {"amplitude", "intensity"}
        What a file holds. A laboratory measures intensity; its square root is the amplitude. Shipped masks are
        amplitudes.
    samples : int, optional
        Average the amplitude over the cells of a grid with this many samples a side: for measured maps whose side
        does not divide the pupil grid. The light of an unaberrated core (the mean amplitude) is kept; what varies
        within a cell, and with it some energy far from the core, is lost.

    Returns
    -------
    ndarray of float64, shape (n, n), read-only
        Transmission of the field amplitude, 0 to 1, indexed ``[y, x]``.

    Raises
    ------
    InputError
        If the file cannot be read, is not a square map of even side (any side with ``samples``), leaves 0 to 1, is
        opaque, or contradicts ``kind``.
    """
    name = str(name_or_path)
    check_word("apodizer kind", kind, KINDS)
    if samples is not None and (samples % 2 or not MIN_SIDE <= samples <= MAX_SIDE):
        raise InputError("samples", samples, allowed=f"an even number, {MIN_SIDE} to {MAX_SIDE}")
    if name in shipped_apodizers():
        if kind != "amplitude":
            raise InputError("apodizer kind", kind, allowed="amplitude for a shipped mask", hint=name)
        file = _shipped_maps(name)
    elif is_file(name):
        file = read_maps("apodizer", name)
    else:
        raise InputError("apodizer", name, allowed=f"an npz or FITS file, or one of: {', '.join(shipped_apodizers())}")
    found = file.maps[0] if file.is_fits or len(file.maps) == 1 else file.named("transmission", *KINDS)
    if found is None:
        raise InputError("apodizer", name, allowed="an npz file with an array named transmission")
    if found.name.lower() in KINDS and found.name.lower() != kind:
        raise InputError("apodizer kind", kind, allowed=f"{found.name.lower()}, the name of the array", hint=name)
    mask = _in_range(name, real_map("apodizer", name, found.data, sides=(MIN_SIDE, MAX_FILE_SIDE)))
    if kind == "intensity":
        mask = np.sqrt(mask)
    if samples is not None:
        mask = cell_means(mask, samples)
    if len(mask) % 2 or len(mask) > MAX_SIDE:
        hint = f"found {len(mask)}; average it onto another grid with samples"
        raise InputError("apodizer", name, allowed=f"an even number of samples, {MIN_SIDE} to {MAX_SIDE}", hint=hint)
    mask.flags.writeable = False
    return mask


@functools.cache
def _shipped_maps(name: str) -> MapFile:
    return read_maps("apodizer", str(files("simulator.imaging") / "data" / f"{name}.npz"))


def _in_range(name: str, mask: FloatArray) -> FloatArray:
    """Return the map within 0 to 1; what rounding left outside is cut off."""
    low, high = float(mask.min()) + 0.0, float(mask.max()) + 0.0  # no -0 in messages
    if low < -ROUNDING or high > 1 + ROUNDING:
        hint = f"found {low:.6g} to {high:.6g}"
        if low >= -ROUNDING:
            hint += f"; divide by {_likely_scale(high)}"
        raise InputError("apodizer", name, allowed="transmission from 0 to 1", hint=hint)
    if high <= 0:
        raise InputError("apodizer", name, allowed="a mask that is not opaque everywhere")
    return np.clip(mask, 0.0, 1.0)


def _likely_scale(high: float) -> str:
    """Return the words for what a map with this maximum was probably scaled to."""
    if 50 < high <= 100.5:
        return "100 if it is in per cent"
    for bits in (8, 16):
        if high == 2**bits - 1:
            return f"{high:g} if it is a picture of {bits} bits"
    return "the value of the open part"


def cell_means(values: FloatArray, samples: int) -> FloatArray:
    """Return the mean of a piecewise constant square map over the cells of another grid on the same square.

    Parameters
    ----------
    values : ndarray, shape (n, n)
    samples : int
        Cells a side, at least 1.

    Returns
    -------
    ndarray, shape (samples, samples)
    """
    n = len(values)
    edges = np.arange(samples + 1)[:, None] / samples * n
    covered = np.clip(edges - np.arange(n), 0.0, 1.0)  # part of each step that lies below each edge
    weights = np.diff(covered, axis=0) * (samples / n)
    return np.asarray(np.clip(weights @ values @ weights.T, values.min(), values.max()))


def disc_coverage(samples: int) -> FloatArray:
    """Return the fraction of each cell of the pupil grid that lies in the clear disc.

    Parameters
    ----------
    samples : int
        Cells a side, even.

    Returns
    -------
    ndarray, shape (samples, samples)
        Good to 1e-3 in the cells that the rim cuts, exactly 0 or 1 elsewhere.
    """
    half = samples // 2
    chord = np.sqrt(0.25 - ((np.arange(half * STRIPS) + 0.5) / (samples * STRIPS)) ** 2)
    covered = np.clip(chord * samples - np.arange(half)[:, None], 0.0, 1.0)
    quarter = covered.reshape(half, half, STRIPS).mean(axis=-1)
    quarter = 0.5 * (quarter + quarter.T)
    upper = np.concatenate([quarter[:, ::-1], quarter], axis=1)
    return np.concatenate([upper[::-1], upper])


def upsample(transmission: FloatArray, samples: int) -> FloatArray:
    """Repeat each step so that the map has ``samples`` samples a side: exact, since steps are constant.

    Parameters
    ----------
    transmission : ndarray
        Map of steps, shape (n, n).
    samples : int
        Samples of the pupil grid a side.

    Raises
    ------
    InputError
        If ``samples`` is not a multiple of the number of steps.
    """
    factor, rest = divmod(samples, len(transmission))
    if rest or factor < 1:
        allowed = f"a multiple of the {len(transmission)} apodizer steps"
        hint = "or average the map onto that many steps: load_apodizer(..., samples=)"
        raise InputError("pupil_samples", samples, allowed=allowed, hint=hint)
    return np.repeat(np.repeat(transmission, factor, axis=0), factor, axis=1)


FLAT_BELOW_CYCLES = 1.0


class Aberrations(Record, eq=False):
    """Static wavefront of the instrument on an ``n x n`` pupil grid, ``[y, x]``.

    Attributes
    ----------
    opd_nm : ndarray, shape (n, n)
        Optical path difference, the same at every wavelength.
    amplitude : ndarray, shape (n, n)
        Factor on the amplitude transmission, mean 1 over the disc.
    """

    opd_nm: FloatArray
    amplitude: FloatArray

    def pupil(
        self, transmission: FloatArray, wavelength_m: float, *, opd_nm: FloatArray | float = 0.0
    ) -> NDArray[np.complex128]:
        """Return the field behind pupil and aberrations, with a further path difference (mirror, drift) on top.

        Parameters
        ----------
        transmission : ndarray
            Amplitude transmission of the pupil, shape (samples, samples).
        wavelength_m : float
            Wavelength, m.
        opd_nm : ndarray or float, optional
            Optical path difference over the pupil, nm, shape (samples, samples).
        """
        phase = 2 * np.pi / (wavelength_m * 1e9) * (self.opd_nm + opd_nm)
        field: NDArray[np.complex128] = (transmission * self.amplitude) * np.exp(1j * phase)
        return field

    def plus_opd(self, opd_nm: FloatArray) -> Aberrations:
        """Return these aberrations with a mirror (twice its surface) or a screen added for good."""
        return _frozen(self.opd_nm + opd_nm, self.amplitude.copy())

    def pointed(self, transmission: FloatArray) -> Aberrations:
        """Return the same with the star brought to the centre: no tip and tilt where light is transmitted.

        To first order in the phase the image of a point peaks where the slope of the wavefront, weighted with the
        amplitude transmission, is zero.
        """
        samples = len(transmission)
        position = (np.arange(samples) + 0.5) / samples - 0.5
        planes = np.stack([np.ones_like(transmission), *np.meshgrid(position, position, indexing="ij")])
        weighted = (planes * transmission).reshape(3, -1)
        content = np.linalg.solve(weighted @ planes.reshape(3, -1).T, weighted @ self.opd_nm.ravel())
        tilt = np.tensordot(content[1:], planes[1:], axes=1)
        return _frozen(self.opd_nm - tilt, self.amplitude.copy())

    def upsampled(self, samples: int) -> Aberrations:
        """Return the same optics on a finer pupil grid: every sample repeated.

        Add the mirror first (`plus_opd`): sampled anew on the finer grid it would be another surface, and a hole solved
        on this grid would fill up.

        Raises
        ------
        InputError
            If ``samples`` is not a multiple of the present number.
        """
        factor, rest = divmod(samples, len(self.opd_nm))
        if rest or factor < 1:
            raise InputError("pupil_samples", samples, allowed=f"a multiple of {len(self.opd_nm)}")
        block = np.ones((factor, factor))
        return _frozen(np.asarray(np.kron(self.opd_nm, block)), np.asarray(np.kron(self.amplitude, block)))


def pupil_disc(samples: int) -> NDArray[np.bool_]:
    """Return the samples whose centres lie in the clear disc."""
    position = (np.arange(samples) + 0.5) / samples - 0.5
    return np.asarray(np.hypot(position[:, None], position) <= 0.5)


def power_law_map(samples: int, psd_slope: float, rng: np.random.Generator, *, remove_tilt: bool) -> FloatArray:
    """Return a random map with power ``max(f, 1)^-psd_slope``, zero mean and unit rms over the disc.

    Parameters
    ----------
    samples : int
        Samples across the pupil, even, 8 to 2048.
    psd_slope : float
        Exponent of the power spectral density per unit area of the frequency plane, 0 to 6.
    rng : numpy.random.Generator
        Source of the draws.
    remove_tilt : bool
        Also remove tip and tilt, by least squares over the disc.

    Returns
    -------
    ndarray, shape (samples, samples)
    """
    frequency = np.fft.fftfreq(2 * samples, 1.0 / samples)  # cycles per diameter, in steps of one half
    positive = np.fft.rfftfreq(2 * samples, 1.0 / samples)
    radius = np.hypot(frequency[:, None], positive)
    filtered = np.fft.rfft2(rng.standard_normal((2 * samples, 2 * samples)))
    filtered *= np.maximum(radius, FLAT_BELOW_CYCLES) ** (-psd_slope / 2)
    filtered[0, 0] = 0.0
    screen = np.fft.irfft2(filtered)[:samples, :samples]
    inside = pupil_disc(samples)
    position = (np.arange(samples) + 0.5) / samples - 0.5
    y, x = np.meshgrid(position, position, indexing="ij")
    screen -= screen[inside].mean()
    if remove_tilt:  # on a disc symmetric about both axes piston, tip and tilt are orthogonal
        for plane in (y, x):
            screen -= plane * ((screen * plane)[inside].sum() / (plane**2)[inside].sum())
    return np.asarray(screen / math.sqrt(float((screen[inside] ** 2).mean())))


@functools.lru_cache(maxsize=4)
def draw_aberrations(
    seed: int, *, samples: int = 128, opd_rms_nm: float = 20.0, amplitude_rms: float = 0.003, psd_slope: float = 2.5
) -> Aberrations:
    """Return the aberrations of one instrument.

    Parameters
    ----------
    seed : int
        Names the instrument: the same seed gives the same maps; phase and amplitude use independent streams.
    samples : int
        Samples across the pupil, even. Another number is another instrument, not the same one sampled otherwise.
    opd_rms_nm : float
        Rms of the optical path difference over the clear disc, without piston, tip and tilt, 0 to 1000 nm (A: 20 nm).
    amplitude_rms : float
        Rms of the relative amplitude error over the clear disc, without its mean, 0 to 0.1 (A: 0.3 %).
    psd_slope : float
        Slope of the power of both, 0 to 6 (A: 2.5).
    """
    phase = power_law_map(samples, psd_slope, stream(seed, "static_opd"), remove_tilt=True)
    amplitude = power_law_map(samples, psd_slope, stream(seed, "static_amplitude"), remove_tilt=False)
    return _frozen(opd_rms_nm * phase, 1.0 + amplitude_rms * amplitude)


def flat_aberrations(samples: int) -> Aberrations:
    """Return perfect optics."""
    return _frozen(np.zeros((samples, samples)), np.ones((samples, samples)))


def _frozen(opd_nm: FloatArray, amplitude: FloatArray) -> Aberrations:
    amplitude = np.maximum(amplitude, 0.0)
    opd_nm.flags.writeable = amplitude.flags.writeable = False
    return Aberrations(opd_nm, amplitude)


HOLE_SCHEMA = 2  # raise when the search or the meaning of a stored number changes


def configured_apodizer(instrument: Instrument) -> NDArray[np.float64]:
    """Return the amplitude transmission of an apodizer on its own steps, nothing beyond the clear disc's rim."""
    coronagraph = instrument.coronagraph
    mask = load_apodizer(coronagraph.apodizer, kind=coronagraph.apodizer_kind, samples=coronagraph.apodizer_samples)
    return mask * disc_coverage(len(mask))


def rounded(values: Iterable[float]) -> list[float]:
    """Return the numbers for a key: 12 digits, so that the last bits of another library's sums do not count."""
    return [float(f"{value:.12g}") for value in values]


def shipped_file(kind: str, key: str, band: str) -> Path:
    """Return the file of the hole or the metrics with a content key; it exists for the bands of the instrument presets.

    Parameters
    ----------
    kind : str
        ``hole`` or ``metrics``.
    key : str
        Content key, 16 hex digits.
    band : str
        Name of a band of the instrument, such as ``F520``.
    """
    return Path(str(files("simulator.imaging") / "data" / f"{kind}_{band}_{key}.npz"))


def shipped(kind: str, key: str, band: str) -> Path | None:
    """Return the `shipped_file` of a content key, None if there is none."""
    path = shipped_file(kind, key, band)
    return path if band.isalnum() and path.is_file() else None
