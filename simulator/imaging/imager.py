"""The optical model from pupil field to detector pixels, propagated by HCIPy or by its bare matrix products.

The pupil holds ``n x n`` samples of constant field each (the steps of the apodizer, phase screens piecewise
constant). Its Fraunhofer field is the sampled transform times ``sinc(u/n) sinc(v/n)``, u in lambda/D: with that
envelope the field of a step mask is exact at any n and any distance from the axis. Fields are scaled so that the
clear pupil disc carries unit energy.

Static aberrations and the mirror are piecewise constant on their own grid, which the pupil grid repeats, and pointing
jitter is part of the pixel's response (`simulator.imaging.sampling`): all settings of the knobs see the same optics.

The two matrix products of a separable transform are the propagator, taken apart by parity
(`simulator.imaging.pupil_symmetry`). HCIPy's Fraunhofer propagator is the cross-check (``engine="hcipy"``): a test
holds both together to 1e-12 of the peak.
"""

import functools
import hashlib
import math
from typing import Any, Literal

import numpy as np

from cpic_core import FloatArray, InputError, NDArray, Record, load_quietly
from simulator.config import ARCSEC_PER_RAD
from simulator.imaging import pupil_symmetry as parity
from simulator.imaging.pupil import Aberrations
from simulator.imaging.sampling import PixelAxis, centred_axis, integrate_pixels, pixel_axis
from simulator.imaging.zones import BandGeometry, HoleZone
from simulator.knobs import Knobs

ComplexArray = NDArray[np.complexfloating[Any, Any]]
Engine = Literal["hcipy", "matrix"]
Waves = tuple[parity.HalfWaves, ...]  # of one axis, one for each wavelength
KEPT_SAMPLES = 2**22  # of pupil fields over all wavelengths that an imager keeps: 64 MB
KEPT_WAVES = 2**19  # values of a grid's transforms that are kept for the next one with the same nodes: 4 MB
N_KEPT_GRIDS = 24


class Imager(Record, eq=False):
    """Optical model of one band; made by `simulator.imaging.build.build_imager`.

    Attributes
    ----------
    band : str
        Name of the band.
    wavelengths_m, weights : ndarray, shape (w,)
        Quadrature over the band; weights sum to one.
    diameter_m : float
        Pupil diameter.
    transmission : ndarray, shape (n, n)
        Amplitude of the apodizer alone, on the pupil grid.
    pixel_scale_arcsec, mask_half_width_arcsec : float
        Detector pixel, and half width of the opaque cross ``|x| < w or |y| < w`` in the focal plane.
    aperture_radius_arcsec : float
        Radius of the photometric aperture.
    zone : HoleZone
        The dark quadrants.
    lambda_d_arcsec : float
        lambda/D at band centre.
    knobs : Knobs
        Numerical settings.
    static : Aberrations or None
        Static wavefront with the mirror in it, on the same pupil grid; None for perfect optics.
    jitter_arcsec : float
        Standard deviation of the pointing per axis.
    """

    band: str
    wavelengths_m: FloatArray
    weights: FloatArray
    diameter_m: float
    transmission: FloatArray
    pixel_scale_arcsec: float
    mask_half_width_arcsec: float
    aperture_radius_arcsec: float
    zone: HoleZone
    lambda_d_arcsec: float
    knobs: Knobs
    static: Aberrations | None = None
    jitter_arcsec: float = 0.0

    @property
    def apodizer_energy(self) -> float:
        """Energy that the apodizer passes, relative to the clear disc."""
        step = self.diameter_m / len(self.transmission)
        return float((self.transmission**2).sum() * step**2 / self._clear_area)

    @property
    def center_m(self) -> float:
        """Wavelength of the band's centre, m."""
        return self.lambda_d_arcsec * self.diameter_m / ARCSEC_PER_RAD

    @property
    def geometry(self) -> BandGeometry:
        """Lengths and hole of the band."""
        return BandGeometry.like(self, self.knobs.stamp_pixels)

    @property
    def hole_arcsec(self) -> tuple[float, float]:
        """Inner and outer edge of the dark quadrants, per axis."""
        return self.zone.inner_arcsec, self.zone.outer_arcsec

    @property
    def pixel_solid_angle_sr(self) -> float:
        """Solid angle of one pixel."""
        return (self.pixel_scale_arcsec / ARCSEC_PER_RAD) ** 2

    @functools.cached_property
    def content_key(self) -> str:
        """Digest of everything that images depend on: equal for two models of the same optics."""
        parts = (
            self.band,
            self.diameter_m,
            self.pixel_scale_arcsec,
            self.mask_half_width_arcsec,
            self.knobs,
            self.aperture_radius_arcsec,
            self.zone,
            self.lambda_d_arcsec,
            self.jitter_arcsec,
        )
        digest = hashlib.sha256(repr(parts).encode())
        maps = [] if self.static is None else [self.static.opd_nm, self.static.amplitude]
        for array in (self.wavelengths_m, self.weights, self.transmission, *maps):
            digest.update(repr(array.shape).encode() + np.ascontiguousarray(array).tobytes())
        return digest.hexdigest()

    @property
    def _clear_area(self) -> float:
        return math.pi / 4.0 * self.diameter_m**2

    def stamp_axis(self, *, masked: bool) -> PixelAxis:
        """Return the nodes of one axis of the star-centred stamp."""
        return self.axis(centred_axis(self.knobs.stamp_pixels, self.pixel_scale_arcsec), masked=masked)

    def axis(self, centres_arcsec: FloatArray, *, masked: bool, pixel_nodes: int | None = None) -> PixelAxis:
        """Return the nodes of an axis with the given pixel centres."""
        half_width = self.mask_half_width_arcsec if masked else 0.0
        nodes = pixel_nodes or self.knobs.pixel_nodes + self._jitter_nodes
        return pixel_axis(centres_arcsec, self.pixel_scale_arcsec, nodes, half_width, self.jitter_arcsec)

    @property
    def _jitter_nodes(self) -> int:
        """Nodes to add where jitter widens a pixel by much of what the telescope resolves."""
        phase = 2 * math.pi * self.jitter_arcsec / self.lambda_d_arcsec
        return max(0, math.ceil(3.2 * (phase - 0.6)))

    def pupil(self, index: int, opd_nm: FloatArray | None = None) -> NDArray[Any]:
        """Return the field behind the pupil at one wavelength, a screen added to the static wavefront; real if flat.

        Parameters
        ----------
        index : int
            Wavelength.
        opd_nm : ndarray, shape (n, n), optional
            Optical path difference of the screen.
        """
        return self.pupil_at(float(self.wavelengths_m[index]), opd_nm)

    def pupil_at(self, wavelength_m: float, opd_nm: FloatArray | None = None) -> NDArray[Any]:
        """Return the same at any wavelength."""
        if self.static is not None:
            return self.static.pupil(self.transmission, wavelength_m, opd_nm=0.0 if opd_nm is None else opd_nm)
        if opd_nm is None:
            return self.transmission
        phased: ComplexArray = self.transmission * np.exp(2j * np.pi / (wavelength_m * 1e9) * opd_nm)
        return phased

    def quadrants(self, index: int) -> tuple[FloatArray, FloatArray]:
        """Return the real and imaginary part of the static `pupil` by quadrants, shape (2, 2, h, h)."""
        if self.wavelengths_m.size * self.transmission.size > KEPT_SAMPLES:
            return _split(self.pupil(index))
        return self._kept_quadrants[index]

    @functools.cached_property
    def _kept_quadrants(self) -> list[tuple[FloatArray, FloatArray]]:
        return [_split(self.pupil(index)) for index in range(self.wavelengths_m.size)]

    def waves(self, angles_arcsec: FloatArray, wavelength_m: float) -> parity.HalfWaves:
        """Return the `transform` of one axis by parity: real matrices, with the same envelope and area element."""
        step = self.diameter_m / len(self.transmission)
        scale = step / math.sqrt(wavelength_m) / self._clear_area**0.25
        dtype = np.empty(0, self.knobs.field_dtype).real.dtype
        cycles = angles_arcsec / ARCSEC_PER_RAD / wavelength_m * step
        return parity.half_waves(cycles, len(self.transmission), scale, dtype)

    def transform(self, angles_arcsec: FloatArray, wavelength_m: float) -> ComplexArray:
        """Return the matrix of one axis: pupil samples to focal-plane field, with sinc envelope and area element."""
        n = len(self.transmission)
        step = self.diameter_m / n
        position = (np.arange(n) - n / 2 + 0.5) * step
        frequency = angles_arcsec / ARCSEC_PER_RAD / wavelength_m
        scale = step / math.sqrt(wavelength_m) / self._clear_area**0.25
        envelope = scale * np.sinc(frequency * step)
        matrix: ComplexArray = np.exp(-2j * np.pi * np.outer(frequency, position)) * envelope[:, None]
        return matrix.astype(self.knobs.field_dtype, copy=False)

    def field(
        self,
        index: int,
        y_arcsec: FloatArray,
        x_arcsec: FloatArray,
        *,
        opd_nm: FloatArray | None = None,
        engine: Engine = "matrix",
    ) -> ComplexArray:
        """Return the focal-plane field of an on-axis unit source at one wavelength, per square root of steradian.

        Parameters
        ----------
        index : int
            Wavelength.
        y_arcsec, x_arcsec : ndarray
            Axes of the grid of angles.
        opd_nm : ndarray, shape (n, n), optional
            Optical path difference on top of the static one.
        engine : {"matrix", "hcipy"}
            Propagator.

        Returns
        -------
        ndarray of complex, shape (len(y_arcsec), len(x_arcsec))
        """
        if engine == "hcipy":
            return self._hcipy_field(self.pupil(index, opd_nm), float(self.wavelengths_m[index]), y_arcsec, x_arcsec)
        return self._grid(y_arcsec, x_arcsec).field(index, opd_nm)

    def _hcipy_field(self, pupil: Any, wavelength: float, y_arcsec: FloatArray, x_arcsec: FloatArray) -> ComplexArray:
        try:
            hcipy = load_quietly("hcipy")
        except ImportError:
            hint = "HCIPy is not installed, and only this cross-check needs it: pip install hcipy"
            raise InputError("engine", "hcipy", allowed="matrix", hint=hint) from None
        n = len(self.transmission)
        grid = hcipy.make_pupil_grid(n, self.diameter_m)
        x, y = x_arcsec / ARCSEC_PER_RAD, y_arcsec / ARCSEC_PER_RAD
        focal = hcipy.CartesianGrid(hcipy.SeparatedCoords([x, y]), weights=1.0)
        entrance = hcipy.Wavefront(hcipy.Field(np.full(n * n, self._clear_area**-0.5, dtype=complex), grid), wavelength)
        behind = hcipy.Apodizer(hcipy.Field(pupil.ravel(), grid)).forward(entrance)
        answer = np.asarray(hcipy.FraunhoferPropagator(grid, focal).forward(behind).electric_field.shaped)
        step = self.diameter_m / n / wavelength
        return np.asarray(answer * np.sinc(y * step)[:, None] * np.sinc(x * step), dtype=np.complex128)

    def intensity(
        self, y_arcsec: FloatArray, x_arcsec: FloatArray, *, opd_nm: FloatArray | None = None, engine: Engine = "matrix"
    ) -> FloatArray:
        """Return the band-averaged intensity, as energy per detector pixel area, without jitter."""
        if engine == "matrix":
            return self._grid(y_arcsec, x_arcsec).intensity(opd_nm)
        total = np.zeros((len(y_arcsec), len(x_arcsec)))
        for index, weight in enumerate(self.weights):
            part = self.field(index, y_arcsec, x_arcsec, opd_nm=opd_nm, engine=engine)
            total += float(weight) * (part.real**2 + part.imag**2)
        total *= self.pixel_solid_angle_sr
        return total

    def image(
        self,
        y: PixelAxis,
        x: PixelAxis,
        *,
        source_arcsec: tuple[float, float] = (0.0, 0.0),
        opd_nm: FloatArray | None = None,
        engine: Engine = "matrix",
    ) -> FloatArray:
        """Return the pixel-integrated image of a unit source at ``source_arcsec = (x, y)``.

        A source off the axis shifts the field and leaves the mask where it is (there is no Lyot stop, so the
        masked image is the unmasked one times the mask).
        """
        source_x, source_y = source_arcsec
        light = self.intensity(y.nodes_arcsec - source_y, x.nodes_arcsec - source_x, opd_nm=opd_nm, engine=engine)
        return integrate_pixels(light, y, x)

    def focal_grid(self, y: PixelAxis, x: PixelAxis, *, source_arcsec: tuple[float, float] = (0.0, 0.0)) -> "FocalGrid":
        """Return the transforms to a grid of pixels, kept for a stack of wavefronts."""
        nodes = self._grid(y.nodes_arcsec - source_arcsec[1], x.nodes_arcsec - source_arcsec[0])
        return FocalGrid(self, nodes.rows, nodes.columns, y, x)

    def _grid(self, y_arcsec: FloatArray, x_arcsec: FloatArray) -> "FocalGrid":
        y, x = (np.ascontiguousarray(axis, dtype=np.float64) for axis in (y_arcsec, x_arcsec))
        values = (y.size + x.size) * len(self.transmission) * self.wavelengths_m.size
        waves = _kept_waves if values <= KEPT_WAVES else _kept_waves.__wrapped__
        return FocalGrid(self, *waves(self, y.tobytes(), x.tobytes()))


class FocalGrid(Record, eq=False):
    """The transforms of an imager to a grid of the focal plane, one pair a wavelength.

    Attributes
    ----------
    imager : Imager
        The optical model.
    rows, columns : tuple of HalfWaves
        Transforms to the nodes of the two axes.
    y, x : PixelAxis or None
        The pixels that the nodes belong to.
    """

    imager: Imager
    rows: Waves
    columns: Waves
    y: PixelAxis | None = None
    x: PixelAxis | None = None

    def transformed(self, index: int, pupil: NDArray[Any]) -> ComplexArray:
        """Return any pupil map in the focal plane, shape (k_y, k_x)."""
        rows = self.rows[index]
        parts = parity.parts_of(*_split(pupil), rows.cosine.dtype)
        field: ComplexArray = parity.field_of(parts, rows, self.columns[index])
        return field

    def field(self, index: int, opd_nm: FloatArray | None = None) -> ComplexArray:
        """Return the field of an on-axis unit source at one wavelength."""
        return self.transformed(index, self.imager.pupil(index, opd_nm))

    def intensity(self, opd_nm: FloatArray | None = None) -> FloatArray:
        """Return the band-averaged intensity at the nodes, as energy per pixel area."""
        imager, y, x = self.imager, self.rows[0], self.columns[0]
        total = np.zeros((1 + y.mirrored, 1 + x.mirrored, len(y.cosine), len(x.cosine)))
        screen = None if opd_nm is None else parity.quadrants_of(opd_nm)
        largest = 0.0 if opd_nm is None else float(np.abs(opd_nm).max())
        for index, (wavelength, weight) in enumerate(zip(imager.wavelengths_m, imager.weights, strict=True)):
            real, imaginary = imager.quadrants(index)
            if screen is not None:
                per_nm = 2.0 * math.pi / (float(wavelength) * 1e9)
                cosine, sine = parity.unit_phases(per_nm * screen, per_nm * largest)
                real, imaginary = real * cosine - imaginary * sine, real * sine + imaginary * cosine
            scale = math.sqrt(float(weight) * imager.pixel_solid_angle_sr)
            parts = parity.parts_of(scale * real, scale * imaginary, y.cosine.dtype)
            parity.add_intensity(total, parts, self.rows[index], self.columns[index], None)
        return parity.unfolded(total, (y.n_nodes, x.n_nodes), (y.sides, x.sides))

    def image(self, opd_nm: FloatArray | None = None) -> FloatArray:
        """Return the pixel-integrated image."""
        return self.pixels(self.intensity(opd_nm))

    def pixels(self, values: FloatArray) -> FloatArray:
        """Return the values at the nodes, integrated over the pixels."""
        if self.y is None or self.x is None:
            raise ValueError("a grid of points has no pixels")
        return integrate_pixels(values, self.y, self.x)


def _split(pupil: NDArray[Any]) -> tuple[FloatArray, FloatArray]:
    return parity.quadrants_of(pupil.real), parity.quadrants_of(pupil.imag)


@functools.lru_cache(maxsize=N_KEPT_GRIDS)
def _kept_waves(imager: Imager, y: bytes, x: bytes) -> tuple[Waves, Waves]:
    """Return the transforms to the nodes of two axes, given as the bytes of their angles."""
    rows = tuple(imager.waves(np.frombuffer(y), float(wavelength)) for wavelength in imager.wavelengths_m)
    if x == y:
        return rows, rows
    return rows, tuple(imager.waves(np.frombuffer(x), float(wavelength)) for wavelength in imager.wavelengths_m)
