"""Maps of where residual speckles are strong and how heavy their tails are, per unit of star light."""

import functools
import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Generic, TypeVar

import numpy as np

from cpic_core import BoolArray, FloatArray, InputError, announce, compute_once, stream
from simulator.config import Drift, content_hash
from simulator.imaging import (
    AnyPsf,
    ExternalPsf,
    Psf,
    TablePsf,
    centred_axis,
    matched_kernel,
    metrics_key,
    visit_responses,
)
from simulator.signal import programme_law

_P = TypeVar("_P", Psf, TablePsf)

N_VISITS = 256
SCHEMA = 1  # raised when the same key would give other maps
_SEED = 20250207  # other screens than those of any observation
_HOUR_S, _ANNULUS_LAMBDA_D = 3600.0, 1.5


@dataclass(frozen=True, eq=False)
class SpeckleMaps:
    """Residual of two visits whose wavefronts differ by independent offsets; made by `speckle_maps`.

    The variances are those of a matched-filtered sum over the sum of the squared kernel: what a pixel of white noise
    would need to have the same effect. Units: square of the star's light on the clear disc, at ``visit_nm``.

    Attributes
    ----------
    linear, square : ndarray, shape (n, n)
        Variance of ``2 Re(E0* dE)`` (grows with offset^2) and of ``|dE|^2`` (offset^4); 0 beyond the hole.
    nominal, stray : ndarray, shape (n, n)
        Star behind the mask, and the mean of ``|dE|^2``; 0 beyond the hole.
    tail_square, tail_cross : float
        Excess kurtosis over that of a Laplace law, of ``|dE|^2`` and of its product with the linear term: below 1,
        since a passband and a kernel average over speckles.
    visit_nm : float
        Offset of each visit.
    n_visits : int
        Visits behind the variances; 0 where they are known exactly (no drift).
    kernel : ndarray, shape (k, k)
        Weights of the filter, k odd.
    """

    linear: FloatArray
    square: FloatArray
    nominal: FloatArray
    stray: FloatArray
    tail_square: float
    tail_cross: float
    visit_nm: float
    n_visits: int
    kernel: FloatArray


def filter_kernel(psf: AnyPsf) -> FloatArray:
    """Return the weights of the matched filter of a PSF (`simulator.imaging.matched_kernel`)."""
    return matched_kernel(psf.off_axis, psf.geometry.lambda_d_arcsec / psf.geometry.pixel_scale_arcsec)


def matched_sum(image: FloatArray, kernel: FloatArray) -> FloatArray:
    """Return the sum of image times kernel around every pixel; nothing beyond the edge. Shape (..., y, x).

    Parameters
    ----------
    image : ndarray
        Image, (y, x), or several.
    kernel : ndarray
        Weights, (y, x), odd sides; at most twice the image.
    """
    from scipy.fft import irfft2, next_fast_len, rfft2

    (rows, columns), (high, wide) = image.shape[-2:], kernel.shape
    size = [next_fast_len(rows + high // 2, real=True), next_fast_len(columns + wide // 2, real=True)]
    # The sum around the first pixel, so that nothing wraps around into the image.
    turned = np.roll(np.pad(kernel, ((0, size[0] - high), (0, size[1] - wide))), (-(high // 2), -(wide // 2)), (0, 1))
    sums = irfft2(rfft2(image, size) * np.conj(rfft2(turned)), size)
    return np.asarray(sums[..., :rows, :columns])


def speckle_maps(psf: AnyPsf, drift: Drift, *, n_visits: int = N_VISITS) -> SpeckleMaps:
    """Return the maps by Monte Carlo over visits: a few seconds a band, once; they are kept in the cache.

    Parameters
    ----------
    psf : Psf
        Optics of one band; maps of an external PSF, which has no wavefront, are 0, and those of a table are of the
        residual of its visits.
    drift : Drift
        Its ``visit_nm`` is the unit of offset, its slope that of the screens.
    n_visits : int
        At least 32.

    Raises
    ------
    InputError
        With fewer visits.
    """
    if n_visits < 32:
        raise InputError("n_visits", n_visits, allowed="at least 32")
    visit_nm = drift.visit_nm or drift.walk_nm_per_sqrt_hour
    weights = filter_kernel(psf)
    if isinstance(psf, TablePsf):
        key = content_hash({"table": metrics_key(psf.instrument, psf.band), "drift": drift.model_dump(mode="json")})
        visit_nm, unit = 1.0, _maps_of_table(_Keyed(psf, key), drift, n_visits)
    elif isinstance(psf, ExternalPsf) or not visit_nm > 0:
        nominal = np.where(psf.geometry.hole, np.asarray(psf.on_axis, float), 0.0)
        empty = np.zeros(nominal.shape)
        return SpeckleMaps(empty, empty, nominal, empty, 0.0, 0.0, visit_nm, 0, weights)
    else:
        unit = _unit_maps(_Keyed(psf, _key(psf, drift.psd_slope, n_visits)), drift.psd_slope, n_visits)
    return SpeckleMaps(
        linear=visit_nm**2 * unit["linear"],
        square=visit_nm**4 * unit["square"],
        nominal=unit["nominal"],
        stray=visit_nm**2 * unit["stray"],
        tail_square=float(unit["tails"][0]),
        tail_cross=float(unit["tails"][1]),
        visit_nm=visit_nm,
        n_visits=n_visits,
        kernel=weights,
    )


def _key(psf: Psf, slope: float, n_visits: int) -> str:
    """Return everything that decides the maps."""
    spectrum = None
    if psf.spectrum is not None:
        arrays = (psf.spectrum.wavelength_nm, psf.spectrum.photlam)
        spectrum = hashlib.sha256(b"".join(np.asarray(part, "<f8").tobytes() for part in arrays)).hexdigest()
    return content_hash(
        {
            "schema": SCHEMA,
            "optics": metrics_key(psf.instrument, psf.band),
            "knobs": psf.knobs.model_dump(mode="json"),
            "spectrum": spectrum,
            "slope": slope,
            "visits": n_visits,
            "kernel": "matched",
        }
    )


@dataclass(frozen=True)
class _Keyed(Generic[_P]):
    """A PSF that counts as equal to any other of its key."""

    psf: _P = field(compare=False)
    key: str


@functools.lru_cache(maxsize=16)
def _unit_maps(keyed: "_Keyed[Psf]", slope: float, n_visits: int) -> dict[str, FloatArray]:
    """Return the maps of an offset of 1 nm, from the cache or measured."""

    def maps_of(found: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
        return {item: found[item] for item in ("linear", "square", "nominal", "stray", "tails")}

    return compute_once(f"speckles-{keyed.key}", lambda: _measured(keyed.psf, slope, n_visits), maps_of)


def _measured(psf: Psf, slope: float, n_visits: int) -> dict[str, FloatArray]:
    announce(f"measuring how drift moves the speckles in {psf.band}, once: some seconds")
    hole, imager = psf.geometry.hole, psf.imager
    rows, columns = np.flatnonzero(hole.any(axis=1)), np.flatnonzero(hole.any(axis=0))
    offset = centred_axis(len(hole), imager.pixel_scale_arcsec)
    axes = [imager.axis(offset[part], masked=True) for part in (rows, columns)]
    responses = visit_responses(imager, axes[0], axes[1], slope, n_visits, _SEED)
    return _filtered_maps(hole, filter_kernel(psf), responses)


@functools.lru_cache(maxsize=16)
def _maps_of_table(keyed: "_Keyed[TablePsf]", drift: Drift, n_visits: int) -> dict[str, FloatArray]:
    """Return the maps of a table: of visits of an hour, each with half of what is left of a pair."""
    psf = keyed.psf
    place, hole = psf.figures.floor_separation_arcsec, psf.geometry.hole
    left = programme_law(psf.figures, drift, place, _ANNULUS_LAMBDA_D).law(1.0, 1.0).variance(_HOUR_S)
    rows, columns = np.flatnonzero(hole.any(axis=1)), np.flatnonzero(hole.any(axis=0))
    box, rng = np.ix_(rows, columns), stream(_SEED, "table")
    half = np.broadcast_to(0.5 * left, place.shape)
    moved = np.array([psf.moved(place, half, rng)[box] for _ in range(n_visits)])
    linear = 2.0 * psf.field[box] * moved.real
    return _filtered_maps(hole, filter_kernel(psf), (psf.on_axis[box], linear, np.abs(moved) ** 2))


def _filtered_maps(hole: BoolArray, kernel: FloatArray, responses: tuple[FloatArray, ...]) -> dict[str, FloatArray]:
    """Return the maps from the star behind the mask and both changes of its light, on rows and columns of the hole."""
    rows, columns = np.flatnonzero(hole.any(axis=1)), np.flatnonzero(hole.any(axis=0))
    # Kernels at an edge reach over the cross: filtered on the whole box of the hole.
    box = (slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1))
    inside = hole[box]
    place = np.ix_(rows - rows[0], columns - columns[0])
    spread = matched_sum(inside.astype(float), kernel**2)[inside]

    def filtered(images: FloatArray) -> FloatArray:
        whole = np.zeros((len(images), *inside.shape))
        whole[(slice(None), *place)] = images
        sums = matched_sum(np.where(inside, whole, 0.0), kernel)[:, inside]
        return np.asarray(sums - sums.mean(axis=0))

    def on_stamp(pixels: tuple[Any, ...], values: FloatArray) -> FloatArray:
        stamp = np.zeros(hole.shape)
        stamp[pixels] = values
        return np.where(hole, stamp, 0.0)

    linear, square = filtered(responses[1]), filtered(responses[2])
    of_linear, of_square, both = (np.mean(part, axis=0) for part in (linear**2, square**2, linear * square))
    # Joint cumulants of order 4, in units of those of a Laplace law: 3 variance^2, for the difference of two visits.
    fourth = float(np.sum((square**4).mean(axis=0) - 3.0 * of_square**2) / (6.0 * np.sum(of_square**2)))
    crossed = np.sum((linear**2 * square**2).mean(axis=0) - of_linear * of_square - 2.0 * both**2)
    tails = [max(fourth, 0.0), max(float(crossed / (2.0 * np.sum(of_linear * of_square))), 0.0)]
    sampled, box_shape = np.ix_(rows, columns), (rows.size, columns.size)
    return {
        "linear": on_stamp(np.nonzero(hole), 2.0 * of_linear / spread),
        "square": on_stamp(np.nonzero(hole), 2.0 * of_square / spread),
        "nominal": on_stamp(sampled, responses[0].reshape(box_shape)),
        "stray": on_stamp(sampled, responses[2].mean(axis=0).reshape(box_shape)),
        "tails": np.array(tails),
    }


def whole_kernels(region: BoolArray, kernel: FloatArray) -> BoolArray:
    """Return the centres of the kernels that lie wholly in a region.

    Parameters
    ----------
    region : ndarray of bool
    kernel : ndarray
        Smaller than the region; it counts where it is above 0.
    """
    from scipy.ndimage import binary_erosion

    return np.asarray(binary_erosion(region, structure=kernel > 0))


def mirror_share(image: FloatArray, kernel: FloatArray, region: BoolArray) -> float:
    """Return the part of the residual at the opposite place that is best subtracted: least squares in a region.

    Parameters
    ----------
    image, kernel : ndarray
    region : ndarray of bool
        Of the shape of the image.
    """
    places = whole_kernels(region, kernel)
    sums = matched_sum(image, kernel)
    here, there = sums[places], sums[::-1, ::-1][places]
    here, there = here - here.mean(), there - there.mean()
    return float(here @ there / (there @ there)) if np.count_nonzero(places) > 1 and there.any() else 0.0
