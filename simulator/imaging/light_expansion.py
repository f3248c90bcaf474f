"""Light of the star on a grid of pixels under random wavefronts, without a transform each.

The errors of a visit are some 1e-4 rad: the field behind the mask is ``E0 + dE``, dE linear in the screen, its light
``|E0|^2 + 2 Re(E0* dE) + |dE|^2``. Of the 16 384 waves of a screen only as many combinations move the field over the
hole as it has degrees of freedom. They are drawn, standard normal numbers ``c``, and nothing else is:

    light = static + J c + |F c|^2

with J exact in every wavelength, and F the field of the middle wavelength: those of the others are the same one,
stretched in proportion to the wavelength, with ``|dE|^2`` as its fourth inverse power. Both terms come from the same
numbers. A Gaussian of their covariance would lose the tails, and so would a quadratic term of its own numbers.

The combinations are those in the range of the operator from waves to the field, found by one step of subspace iteration
from fixed random screens (Halko, Martinsson & Tropp 2011, SIAM Rev. 53, 217). They depend smoothly on the optics: a
seed gives the same images but for rounding, whatever library solves the linear algebra.

The field is band-limited: a Gauss-Legendre rule over each open side of an axis holds it, and its light.
"""

from __future__ import annotations

import functools
import hashlib
import math
from collections.abc import Iterator, Mapping
from dataclasses import field
from typing import Any, NamedTuple

import numpy as np
import scipy

from cpic_core import ArrayLike, FloatArray, NDArray, Record, announce, compute_once, stream
from simulator.config import Drift, content_hash
from simulator.imaging.drift import LAST_INDEX, ScreenModel, low_order_map, screen_model
from simulator.imaging.imager import Imager
from simulator.imaging.sampling import PixelAxis

LARGEST_NM, RMS_ERROR = 1.0, 0.005
"""Rms of all wavefront errors together up to which the expansion holds, and its error there: of the rms of aperture
sums, at the worst place of the hole of any band (`reports/speed/speed_accuracy`)."""
BEYOND_LAMBDA_D = 3.0  # degrees of freedom that a side of the hole has beyond its length
FIELD_NODES, LIGHT_NODES = 8, 12  # of a side, beyond those that a band-limited function of its length needs
EVENNESS = 0.5
"""Weight of dark places in the choice of waves: 0 counts the light that they hold, 1 as much as bright ones."""
_SEED, _BATCH, _BLOCK, _SCHEMA = 7, 64, 50, 2
Single = NDArray[np.float32]


class _Side(NamedTuple):
    """An open side of an axis: its parts of the nodes of the field, of those of the light, and of the pixels.

    ``up`` (m, k) reads the field at the nodes of the light; ``bare`` (w, p, m) the pixels of the light of each
    wavelength at its own nodes, ``sums`` those of the middle one's, stretched and weighted.
    """

    field: slice
    light: slice
    pixels: slice
    up: Single
    bare: Single
    sums: Single


class _Axis(NamedTuple):
    """The open sides of an axis, and all nodes of the field and of the light, arcsec at the middle wavelength."""

    sides: tuple[_Side, ...]
    field: FloatArray
    light: FloatArray
    area: FloatArray
    length: float
    n_pixels: int

    def at(self, index: int) -> _Axis:
        """Return the same for one wavelength alone, as it is."""
        return self._replace(sides=tuple(side._replace(sums=side.bare[index : index + 1]) for side in self.sides))

    @classmethod
    def of(cls, axis: PixelAxis, imager: Imager, middle_m: float) -> _Axis:
        """Return the rules of an axis of pixels."""
        scales = middle_m / imager.wavelengths_m
        at, owners = axis.nodes_arcsec, axis.owners
        order = np.argsort(at, kind="stable")
        gaps = np.flatnonzero(np.diff(at[order]) > 1.5 * imager.pixel_scale_arcsec) + 1
        sides: list[_Side] = []
        field: list[FloatArray] = []
        light: list[FloatArray] = []
        area: list[FloatArray] = []
        length = 0.0
        for inside in np.split(order, gaps):
            stretched = np.outer(scales, at[inside])
            # A margin: a side may have a single node.
            margin = 0.25 * imager.pixel_scale_arcsec
            low, high = float(stretched.min()) - margin, float(stretched.max()) + margin
            resolved = (high - low) / imager.lambda_d_arcsec * imager.center_m / middle_m
            counts = math.ceil(resolved) + FIELD_NODES, math.ceil(2.0 * resolved) + LIGHT_NODES
            nodes = [_nodes(low, high, count) for count in counts]
            first, last = owners[inside].min(), owners[inside].max() + 1
            bare = np.zeros((scales.size, last - first, counts[1]))
            for index, scale in enumerate(scales):
                read = _reader(low, high, counts[1], scale * at[inside]) * axis.weights[inside, None]
                np.add.at(bare[index], owners[inside] - first, read)
            # Light as the fourth inverse power of the wavelength, half of it along either axis.
            power = np.sqrt(imager.weights) * scales**2
            sides.append(
                _Side(
                    slice(sum(map(len, field)), sum(map(len, field)) + counts[0]),
                    slice(sum(map(len, light)), sum(map(len, light)) + counts[1]),
                    slice(int(first), int(last)),
                    _reader(low, high, counts[0], nodes[1]).astype(np.float32),
                    bare.astype(np.float32),
                    (power[:, None, None] * bare).astype(np.float32),
                )
            )
            field.append(nodes[0])
            light.append(nodes[1])
            area.append((high - low) * np.polynomial.legendre.leggauss(counts[0])[1])
            length += resolved + BEYOND_LAMBDA_D
        joined = [np.concatenate(part) for part in (field, light, area)]
        return cls(tuple(sides), joined[0], joined[1], joined[2], length, axis.n_pixels)


def _nodes(low: float, high: float, count: int) -> FloatArray:
    """Return the Gauss-Legendre nodes of an interval."""
    x = np.polynomial.legendre.leggauss(count)[0]
    return np.asarray(0.5 * (low + high) + 0.5 * (high - low) * x)


def _reader(low: float, high: float, count: int, at: FloatArray) -> FloatArray:
    """Return the matrix that reads a polynomial from its values at the Gauss-Legendre nodes of an interval."""
    x, weights = np.polynomial.legendre.leggauss(count)
    values = np.polynomial.legendre.legvander((2.0 * at - low - high) / (high - low), count - 1)
    values *= np.arange(count) + 0.5
    read: FloatArray = values @ (np.polynomial.legendre.legvander(x, count - 1).T * weights)
    return read


class VisitLight(Record, eq=False):
    """Light of the unit star on a grid of pixels for wavefronts told by few numbers; made by `visit_light`.

    Attributes
    ----------
    static : ndarray, shape (n_y, n_x)
        Image without errors.
    linear : ndarray, shape (r + 1, n_y * n_x), single precision
        What 1 nm of each combination of waves changes, to first order; the last row is that of the low-order map of
        `simulator.imaging.drift.low_order_map`.
    field : ndarray, shape (r + 1, 2 * k_y * k_x), single precision
        Real and imaginary part of the field of 1 nm.
    low_order : ndarray, shape (r + 1,)
        The low-order map in these numbers.
    """

    static: FloatArray
    linear: Single
    field: Single
    low_order: FloatArray
    _y: _Axis
    _x: _Axis

    def draw(self, rng: np.random.Generator, rms_nm: float) -> FloatArray:
        """Return the numbers of one random screen, nm, shape (r + 1,): as `ScreenModel.draw` draws its map.

        Parameters
        ----------
        rng : numpy.random.Generator
        rms_nm : float
            Expected rms of the screen over the disc, nm.
        """
        waves = np.zeros(len(self.linear))
        waves[:-1] = rms_nm * rng.standard_normal(len(waves) - 1)
        return waves

    def images(self, waves_nm: FloatArray, weights: ArrayLike | None = None) -> FloatArray:
        """Return the mean image of the epochs of each visit.

        Parameters
        ----------
        waves_nm : ndarray, shape (b, e, r + 1)
            Numbers of e wavefronts of b visits, as `draw` gives them.
        weights : array_like, shape (e,), optional
            Shares of the epochs; equal by default.

        Returns
        -------
        ndarray, shape (b, n_y, n_x)
            Fraction of the energy on the clear disc in every pixel.
        """
        linear, square = self.changes(waves_nm, weights)
        return np.asarray(np.maximum(self.static + (linear + square), 0.0))

    def changes(self, waves_nm: FloatArray, weights: ArrayLike | None = None) -> tuple[Single, Single]:
        """Return ``2 Re(E0* dE)`` and ``|dE|^2``, each (b, n_y, n_x): what `images` adds to the static one."""
        count, epochs, numbers = waves_nm.shape
        share = np.full(epochs, 1.0 / epochs) if weights is None else np.asarray(weights, float)
        shape = (count, *self.static.shape)
        linear = ((share @ waves_nm).astype(np.float32) @ self.linear).reshape(shape)
        rows = (np.sqrt(share)[:, None] * waves_nm).reshape(-1, numbers).astype(np.float32)
        light = np.zeros((count, self._y.light.size, self._x.light.size), np.float32)
        for first in range(0, len(rows), _BATCH):
            fields = rows[first : first + _BATCH] @ self.field
            fields = _read(fields.reshape(-1, self._y.field.size, self._x.field.size), self._y, self._x)
            np.multiply(fields, fields, out=fields)
            visit = (2 * first + np.arange(len(fields))) // (2 * epochs)
            begins = np.flatnonzero(np.diff(visit, prepend=-1))
            light[visit[begins]] += np.add.reduceat(fields, begins, axis=0)
        return linear, _add_pixels(np.zeros(shape, np.float32), light, self._y, self._x)


def _read(fields: NDArray[np.float32], y: _Axis, x: _Axis) -> Single:
    """Return a stack of fields, (b, k_y, k_x), at the nodes of the light, (b, m_y, m_x)."""
    along = np.empty((len(fields), y.field.size, x.light.size), np.float32)
    for side in x.sides:
        along[..., side.light] = fields[..., side.field] @ side.up.T
    read = np.empty((len(fields), y.light.size, x.light.size), np.float32)
    for side in y.sides:
        np.matmul(side.up, along[:, side.field], out=read[:, side.light])
    return read


def _add_pixels(image: Single, light: Single, y: _Axis, x: _Axis) -> Single:
    """Return images with the light of a stack of maps at the nodes, (b, m_y, m_x), of all wavelengths added."""
    count, n_waves = len(light), len(y.sides[0].sums)
    for across in x.sides:
        width = across.pixels.stop - across.pixels.start
        cut = np.ascontiguousarray(light[..., across.light]).reshape(-1, across.up.shape[0])
        sums = (cut @ across.sums.reshape(-1, across.up.shape[0]).T).reshape(count, -1, width)
        for side in y.sides:
            # Wavelengths and nodes of the rows in one sum.
            rows = slice(side.light.start * n_waves, side.light.stop * n_waves)
            every = side.sums.transpose(1, 2, 0).reshape(side.sums.shape[1], -1)
            image[:, side.pixels, across.pixels] += every @ sums[:, rows]
    return image


def expands(drift: Drift, visit_s: float) -> bool:
    """Return whether the expansion holds for all that moves the wavefront in a visit of so many seconds."""
    return drift.rms_nm(visit_s) <= LARGEST_NM


def visit_light(imager: Imager, y: PixelAxis, x: PixelAxis, psd_slope: float) -> VisitLight:
    """Return the expansion of the light on a grid of pixels; some two seconds once, then from the cache.

    Parameters
    ----------
    imager : Imager
    y, x : PixelAxis
        Pixels, the star behind the middle of the mask.
    psd_slope : float
        Exponent of the power spectrum of the screens, ``f^-slope``.
    """
    return _kept(_Builder.of(imager, y, x, psd_slope))


def waves_of(imager: Imager, y: PixelAxis, x: PixelAxis, psd_slope: float) -> Single:
    """Return the combinations of waves behind the numbers of `visit_light`, orthonormal, shape (r, 128, 128).

    Parameters
    ----------
    imager, y, x, psd_slope
        As of `visit_light`.
    """
    return _Builder.of(imager, y, x, psd_slope).waves()


@functools.lru_cache(maxsize=4)
def _kept(builder: _Builder) -> VisitLight:
    def made() -> dict[str, Any]:
        announce(f"finding the waves that move the light in {builder.imager.band}, once: some seconds")
        return builder.arrays(builder.waves())

    def read(found: Mapping[str, NDArray[Any]]) -> VisitLight:
        low_order = np.zeros(len(found["linear"]))
        low_order[-1] = 1.0
        static = builder.imager.focal_grid(*builder.pixels).image()
        return VisitLight(static, found["linear"], found["field"], low_order, builder.y, builder.x)

    return compute_once(f"light-{builder.key}", made, read)


class _Builder(Record):
    """The transforms from screens to nodes of the field, and back; equal to any other of its key."""

    key: str
    imager: Imager = field(compare=False)
    pixels: tuple[PixelAxis, PixelAxis] = field(compare=False)
    y: _Axis = field(compare=False)
    x: _Axis = field(compare=False)
    middle_m: float = field(compare=False)
    screens: ScreenModel = field(compare=False)

    @classmethod
    def of(cls, imager: Imager, y: PixelAxis, x: PixelAxis, psd_slope: float) -> _Builder:
        """Return those of a grid of pixels."""
        digest = hashlib.sha256(imager.content_key.encode())
        for axis in (y, x):
            for part in (axis.nodes_arcsec, axis.weights, axis.owners.astype(np.int64)):
                digest.update(part.tobytes())
        sizes = [BEYOND_LAMBDA_D, FIELD_NODES, LIGHT_NODES, EVENNESS, _SEED, _SCHEMA]
        key = content_hash({"optics": digest.hexdigest(), "slope": psd_slope, "sizes": sizes})
        middle_m = float((imager.weights * imager.wavelengths_m).sum())
        axes = [_Axis.of(axis, imager, middle_m) for axis in (y, x)]
        screens = screen_model(len(imager.transmission), psd_slope)
        return cls(key, imager, (y, x), axes[0], axes[1], middle_m, screens)

    def arrays(self, waves: Single) -> dict[str, Single]:
        """Return what 1 nm of each combination of waves changes, and of the low-order map."""
        maps = np.concatenate([self._maps(waves), low_order_map(len(self.imager.transmission))[None]]).astype(
            np.float32
        )
        return {"linear": self._linear(maps), "field": self._fields(maps)}

    def waves(self) -> Single:
        """Return the combinations that move the field over the hole, orthonormal, shape (r, 128, 128)."""
        shape = (2 * (LAST_INDEX + 1),) * 2
        symmetric = all(np.allclose(axis.field, -axis.field[::-1]) for axis in (self.y, self.x))
        # A real screen moves opposite sides of the star together.
        count = math.ceil(self.y.length * self.x.length * (1.0 if symmetric else 2.0))
        count = min(count, shape[0] * shape[1])
        drawn = stream(_SEED, "visit light").standard_normal((count, *shape), np.float32)
        moved = self._fields(self._maps(drawn)).reshape(count, 2, -1)
        power = (moved.astype(float) ** 2).sum(axis=(0, 1)).reshape(self.y.field.size, self.x.field.size)
        weight = (np.sqrt(np.outer(self.y.area, self.x.area)) * power ** (-0.5 * EVENNESS)).ravel()
        moved = np.concatenate([moved[:, part] * weight for part in (0, 1)], axis=1).astype(np.float32)
        seen = (_orthonormal(moved).reshape(count, 2, -1) * weight).astype(np.float32)
        return _orthonormal(self._back(seen).reshape(count, -1)).reshape(count, *shape)

    def _factor(self, wavelength_m: float, weight: float = 1.0) -> NDArray[np.complex64]:
        """Return the field behind the pupil by 1 nm of a screen."""
        scale = 2e-9 * math.pi / wavelength_m * math.sqrt(weight * self.imager.pixel_solid_angle_sr)
        return (1j * scale * self.imager.pupil_at(wavelength_m)).astype(np.complex64)

    def _transform(self, angles: FloatArray) -> NDArray[np.complex64]:
        return self.imager.transform(angles, self.middle_m).astype(np.complex64)

    def _maps(self, waves: Single) -> Single:
        blocks = [waves[first : first + _BLOCK] for first in range(0, len(waves), _BLOCK)]
        return np.concatenate([self.screens.screens(block.astype(np.float64)).astype(np.float32) for block in blocks])

    def _propagated(self, maps: Single, factor: NDArray[np.complex64]) -> Iterator[tuple[slice, NDArray[np.complex64]]]:
        rows, columns = self._transform(self.y.field), self._transform(self.x.field).T
        for first in range(0, len(maps), _BLOCK):
            block = slice(first, first + _BLOCK)
            yield block, rows @ (factor * maps[block]) @ columns

    def _fields(self, maps: Single) -> Single:
        """Return the field of the middle wavelength, real and imaginary part, shape (count, 2 k_y k_x)."""
        fields = np.empty((len(maps), 2, self.y.field.size, self.x.field.size), np.float32)
        for block, values in self._propagated(maps, self._factor(self.middle_m)):
            fields[block, 0], fields[block, 1] = values.real, values.imag
        return fields.reshape(len(maps), -1)

    def _back(self, seen: Single) -> Single:
        """Return the coefficients of the screens to which parts of the field are sensitive: the adjoint."""
        rows, columns = self._transform(self.y.field).conj().T, self._transform(self.x.field).conj()
        factor = self._factor(self.middle_m).conj()
        values = seen.reshape(len(seen), 2, self.y.field.size, self.x.field.size)
        blocks = []
        for first in range(0, len(seen), _BLOCK):
            part = values[first : first + _BLOCK]
            back = (factor * (rows @ (part[:, 0] + 1j * part[:, 1]) @ columns)).real
            blocks.append(self.screens.coefficients(back).astype(np.float32))
        return np.concatenate(blocks)

    def _linear(self, maps: Single) -> Single:
        """Return what maps of 1 nm change on the pixels to first order, every wavelength for itself."""
        imager = self.imager
        total = np.zeros((len(maps), self.y.n_pixels, self.x.n_pixels), np.float32)
        rows, columns = (self.imager.transform(axis.light, self.middle_m) for axis in (self.y, self.x))
        for index, (wavelength, weight) in enumerate(zip(imager.wavelengths_m, imager.weights, strict=True)):
            # The same transform at angles in proportion to the wavelength.
            stretch = self.middle_m / float(wavelength)
            scale = stretch * math.sqrt(float(weight) * imager.pixel_solid_angle_sr)
            static = (2.0 * scale * (rows @ imager.pupil(index) @ columns.T)).astype(np.complex64)
            y, x = self.y.at(index), self.x.at(index)
            for block, values in self._propagated(maps, self._factor(float(wavelength), float(weight))):
                real, imaginary = (_read(np.ascontiguousarray(part), y, x) for part in (values.real, values.imag))
                change = static.real * real + static.imag * imaginary
                _add_pixels(total[block], np.float32(stretch) * change, y, x)
        return total.reshape(len(maps), -1)


def _orthonormal(rows: Single) -> Single:
    """Return an orthonormal basis of the space of rows, each with the sign of what it adds."""
    basis, upper = scipy.linalg.qr(rows.T, mode="economic", overwrite_a=True, check_finite=False)  # in single precision
    return np.ascontiguousarray((basis * np.sign(np.diag(upper))).T)
