"""Measurement of `PsfMetrics` from the optical model, with the speckle floor of reference differential imaging.

Science and reference visit each have their own wavefront offset. To first order in the phase the field of visit k is
``E0 + v E_k`` with v the rms in nm, so that its image is ``I0 + v L_k + v^2 Q_k`` with ``L = 2 Re(E0* E_k)`` and
``Q = |E_k|^2``. The noiseless mean of the reference library of one visit is its image; what is left of the science
image after subtracting it (temporal centring) is summed in apertures wholly inside the hole, and the floor is the rms
of these sums over positions and pairs of visits. Gaussian offsets leave no term between L and Q, so that the variance
is ``a v^2 + b v^4``. Modes after the mean hold the walk and the noise of the reference visit; they do not lower the
part that the visits' offsets leave.

The sum of L in an aperture is linear in the screen: a is exact, from what each aperture sees of every wave of the
screens. The sum of Q is a quadratic form of the waves: b is exact too, in a few apertures all over the hole, and smooth
between them.

The variance from visit to visit of the light that random wavefront errors put into an aperture is exact.

The field ``dE`` of an error is linear in its screen, so that the light ``|dE|^2`` in an aperture is a quadratic form of
the waves' amplitudes, which are independent normal numbers a: ``Q = |R a|^2``, where each row of R is what one mode of
the field in the aperture sees of the waves. Its variance is ``2 tr (R R^T)^2``, the covariance of two such forms
``2 tr M M'`` with ``M = R^T R``.

Apertures see the light less the mean of the hole, whose own variance is up to two thirds of what is left in corners:
exact in the screens that matter most and estimated in the others, to some 1 %.

A field behind a pupil has few modes in an aperture little larger than lambda/D: those that bring less than 1e-3 of the
light of the brightest are left out, by which the variance is 1e-4 too small.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cpic_core import ComplexArray, FloatArray, InputError, NDArray, overlap_weights, stream
from simulator.imaging.aperture import aperture_sums, core_cells, cumulative_table, figures_of_stamps
from simulator.imaging.drift import ScreenModel, screen_model
from simulator.imaging.imager import FocalGrid, Imager
from simulator.imaging.metrics import PsfMetrics
from simulator.imaging.sampling import PixelAxis, centred_axis, pixel_axis

Aperture = tuple[int, int, FloatArray]
FAINT = 1e-3  # light of a mode that does not count, over that of the brightest
APART = 1e-2  # share of an aperture's light that does not count in its small covariance with the mean of the hole
PROBES = 64  # random screens that find what the mean of the hole varies by
_SEED = 20250102


class ErrorLight:
    """Light ``|dE|^2`` of screens of 1 nm in weighted pixels, to second order in the screen.

    Parameters
    ----------
    imager : Imager
    axes : tuple of PixelAxis
        Pixels along y and x.
    psd_slope : float
        Exponent of the power spectrum of the screens, ``f^-slope``.
    """

    def __init__(self, imager: Imager, axes: tuple[PixelAxis, PixelAxis], psd_slope: float) -> None:
        samples = len(imager.transmission)
        self.grid: FocalGrid = imager.focal_grid(*axes)
        self.screens: ScreenModel = screen_model(samples, psd_slope)
        self.owners = [axis.owners for axis in axes]
        self.counted = axes[0].weights[:, None] * axes[1].weights
        waves = zip(self.grid.rows, self.grid.columns, strict=True)
        self.waves = [[np.asarray(part.full(samples), np.complex128) for part in pair] for pair in waves]
        per_nm = 2.0 * np.pi / (imager.wavelengths_m * 1e9) * np.sqrt(imager.weights * imager.pixel_solid_angle_sr)
        self.pupils = [float(scale) * imager.pupil(index) for index, scale in enumerate(per_nm)]

    def readings(self, row: int, column: int, weights: FloatArray) -> FloatArray:
        """Return the pupil's maps whose readings of a screen, squared and added, are the weighted light; (m, n, n).

        Parameters
        ----------
        row, column : int
            First pixel.
        weights : ndarray
            Of the pixels from there on, 0 or more.
        """
        near = zip(self.owners, (row, column), weights.shape, strict=True)
        rows, columns = (slice(*np.searchsorted(pixel, [first, first + n])) for pixel, first, n in near)
        by_node = weights[np.ix_(self.owners[0][rows] - row, self.owners[1][columns] - column)]
        by_node = by_node * self.counted[rows, columns]
        found = []
        for (to_y, to_x), pupil in zip(self.waves, self.pupils, strict=True):
            (from_y, basis_y), (from_x, basis_x) = _basis(to_y[rows]), _basis(to_x[columns])
            light = _pairs(from_y).T @ by_node @ _pairs(from_x)
            n_y, n_x = len(basis_y), len(basis_x)
            form = light.reshape(n_y, n_y, n_x, n_x).swapaxes(1, 2).reshape(n_y * n_x, -1)
            power, modes = np.linalg.eigh(form)
            bright = power > FAINT * power[-1]
            kept = (np.sqrt(power[bright]) * modes[:, bright].conj()).T.reshape(-1, n_y, n_x)
            found.append(pupil * (basis_y.T @ kept @ basis_x))
        maps = np.concatenate(found)
        return np.concatenate([maps.real, maps.imag])

    def light(self, screens: FloatArray, weights: FloatArray) -> FloatArray:
        """Return the weighted light of screens, shape (k,).

        Parameters
        ----------
        screens : ndarray, shape (k, n, n)
            Nm.
        weights : ndarray
            Of all pixels.
        """
        by_node = self.counted * weights[np.ix_(*self.owners)]
        total = np.zeros(len(screens))
        for index, pupil in enumerate(self.pupils):
            for number, screen in enumerate(screens):
                total[number] += (by_node * np.abs(self.grid.transformed(index, pupil * screen)) ** 2).sum()
        return total

    def product(self, coefficients: FloatArray, weights: FloatArray) -> FloatArray:
        """Return the product of the form of the weighted light with the waves of some screens, of the same shape.

        Parameters
        ----------
        coefficients : ndarray, shape (..., 128, 128)
            As of `ScreenModel.screens`.
        weights : ndarray
            Of all pixels.
        """
        by_node = self.counted * weights[np.ix_(*self.owners)]
        screens = self.screens.screens(coefficients)
        back = np.zeros(screens.shape)
        for index, ((to_y, to_x), pupil) in enumerate(zip(self.waves, self.pupils, strict=True)):
            for number, screen in enumerate(screens):
                field = self.grid.transformed(index, pupil * screen)
                back[number] += (pupil * (to_y.T @ (by_node * field.conj()) @ to_x)).real
        return self.screens.coefficients(back)


def _basis(waves: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
    """Return the factors of the waves at some nodes, (k, b) and (b, n): few that are orthonormal over the pupil."""
    left, size, right = np.linalg.svd(waves, full_matrices=False)
    several = size > np.sqrt(FAINT) * 1e-2 * size[0]
    return left[:, several] * size[several], right[several]


def _pairs(values: ComplexArray) -> ComplexArray:
    """Return the products of the conjugate of each column with each, shape (k, b^2)."""
    return (values.conj()[:, :, None] * values[:, None, :]).reshape(len(values), -1)


def light_variance(fine: ErrorLight, coarse: ErrorLight, mean: FloatArray, apertures: Sequence[Aperture]) -> FloatArray:
    """Return the variance of the light of screens of 1 nm, summed in apertures less the sum by ``mean``, one for each.

    Parameters
    ----------
    fine : ErrorLight
        Of the apertures.
    coarse : ErrorLight
        The same pixels, perhaps with fewer nodes, for the mean.
    mean : ndarray
        Weights of all pixels.
    apertures : sequence
        First row and column of each, and the weights of the pixels from there on.
    """
    screens, found = fine.screens, np.full(len(apertures), _mean_variance(coarse, mean))
    for number, aperture in enumerate(apertures):
        seen = screens.coefficients(fine.readings(*aperture))
        shape = seen.shape[1:]
        seen = seen.reshape(len(seen), -1)
        power, turned = np.linalg.eigh(seen @ seen.T)
        found[number] += 2.0 * float((power**2).sum())
        several = np.cumsum(power) > APART * power.sum()
        main = screens.screens((turned[:, several].T @ seen).reshape(-1, *shape))
        found[number] -= 4.0 * float(coarse.light(main, mean).sum())
    return found


def _mean_variance(light: ErrorLight, mean: FloatArray) -> float:
    """Return the variance of the sum by ``mean``: exact in what random screens find, estimated in what is left."""
    rng = stream(_SEED, "hole_mean")
    shape = tuple(light.screens.coefficients(light.grid.imager.transmission).shape)

    def product(vectors: FloatArray) -> FloatArray:
        return light.product(vectors.reshape(-1, *shape), mean).reshape(len(vectors), -1)

    found, _ = np.linalg.qr(product(rng.standard_normal((PROBES, shape[0] * shape[1]))).T)
    rest = rng.standard_normal((PROBES, len(found)))
    rest -= rest @ found @ found.T
    return 2.0 * float((product(found.T) ** 2).sum() + (product(rest) ** 2).sum() / PROBES)


N_BINS = 32
KERNEL_LAMBDA_D = 1.5
_BLOCK = 64  # apertures whose maps of the pupil are held at a time
SAMPLED = 6  # places along each side of a quadrant in which the light of the errors is measured
_THIN, _PROBED = 3, 9  # step, in pixels, and number of the places where a matched filter is looked at
DEGREE = 4  # of the polynomial between them, in the logarithms of x and y


def measure_floor(imager: Imager, psd_slope: float, kernel: FloatArray) -> dict[str, FloatArray | float]:
    """Measure the floor in apertures, and what a matched filter makes of it: fields of `PsfMetrics` by name.

    ``linear`` is exact; ``square`` is good to 1 % in the bins, mostly what quadrants differ by: it is exact in 36
    apertures and follows a polynomial between them. The first-order phase is good to 1 % of the floor up to 2 nm and to
    some 10 % at 10 nm.

    Parameters
    ----------
    imager : Imager
    psd_slope : float
        Exponent of the power spectrum of the screens, ``f^-slope``.
    kernel : ndarray
        Weights of the matched filter (`matched_kernel`).

    Raises
    ------
    InputError
        If no pixel of the detector lies inside the hole.
    """
    zone, pixel, radius = imager.zone, imager.pixel_scale_arcsec, imager.aperture_radius_arcsec
    first, last = int(np.floor(zone.inner_arcsec / pixel)), int(np.ceil(zone.outer_arcsec / pixel))
    side: FloatArray = np.arange(first, last + 1, dtype=np.float64) * pixel
    y_centres, x_centres = zone.axes(side)
    y, x = (imager.axis(centres, masked=True) for centres in (y_centres, x_centres))
    hole = zone.covers(y_centres, x_centres)
    place = zone.covers(y_centres, x_centres, -radius)
    if not place.any():  # a hole smaller than the aperture: centres inside it must do
        place = hole
    if not place.any():
        allowed = f"an inner edge well inside the outer edge, {zone.outer_arcsec} arcsec"
        raise InputError("coronagraph.inner_lambda_d", zone.inner_arcsec, unit="arcsec per axis", allowed=allowed)
    separation = np.hypot(y_centres[:, None], x_centres)[place]
    weights = overlap_weights(radius / pixel)

    centres = np.argwhere(place)
    apertures = [_clipped(int(row), int(column), weights, side.size) for row, column in centres]
    mean = hole * (weights.sum() / hole.sum())
    linear = 2.0 * _cross_variance(imager, (y, x), psd_slope, mean, apertures)
    coarse = (imager.axis(centres, masked=True, pixel_nodes=1) for centres in (y_centres, x_centres))
    fine, light = (ErrorLight(imager, axes, psd_slope) for axes in ((y, x), (next(coarse), next(coarse))))
    rows, columns = np.nonzero(place)
    offsets = np.abs(y_centres[rows]), np.abs(x_centres[columns])
    chosen = _sampled(*offsets)
    measured = light_variance(fine, light, mean, [apertures[number] for number in chosen])
    square = 2.0 * _everywhere(*offsets, chosen, measured)

    edges = np.geomspace(separation.min(), separation.max(), N_BINS + 1)
    _, bins = np.unique(np.searchsorted(edges[1:-1], separation), return_inverse=True)  # empty bins drop out
    counts = np.bincount(bins)

    def binned(values: FloatArray) -> FloatArray:
        return np.concatenate([[values.mean()], np.bincount(bins, values) / counts])

    floor_linear = binned(linear)
    grid = (centres % _THIN == 0).all(axis=1)
    thin = np.flatnonzero(grid | (np.bincount(bins[grid], minlength=len(counts)) == 0)[bins])
    cuts = [_clipped(int(row), int(column), kernel, side.size) for row, column in centres[thin]]
    cuts = [(row, column, cut * hole[row:, column:][: cut.shape[0], : cut.shape[1]]) for row, column, cut in cuts]
    norm, area = np.array([float(np.sum(cut**2)) for *_, cut in cuts]), float(np.sum(weights**2))
    gain = np.sqrt(norm * area) / float(np.sum(weights * _middle(kernel, len(weights))))
    crossed = 2.0 * _cross_variance(imager, (y, x), psd_slope, 0.0 * mean, cuts) / norm
    crossed = crossed * area / floor_linear[1:][bins[thin]]

    levels = [np.sort(crossed[np.abs(bins[thin] - number) <= 1]) for number in range(len(counts))]
    fifths = np.array([[part.mean() for part in _fifths(level)] for level in levels])
    gains = np.bincount(bins[thin], gain) / np.bincount(bins[thin])

    several = thin[np.linspace(0, len(thin) - 1, _PROBED).astype(int)]
    lights, tails = [], []
    for number in several:
        seen = fine.screens.coefficients(fine.readings(*cuts[int(np.flatnonzero(thin == number)[0])]))
        seen = seen.reshape(len(seen), -1)
        power = np.linalg.eigvalsh(seen @ seen.T)
        own = float(np.sum(power**2))
        lights.append(4.0 * own / float(norm[thin == number][0]) * area / square[number])
        tails.append(2.0 * float(np.sum(power**4)) / own**2)
    positions, roughness = kernel_smoothness(kernel)
    return {
        "floor_separation_arcsec": binned(separation)[1:],
        "floor_linear": floor_linear,
        "floor_square": binned(square),
        "filter_gain": gains,
        "filter_linear": fifths,
        "filter_square": float(np.mean(lights)),
        "filter_tails": float(np.mean(tails)),
        "filter_positions": positions,
        "filter_roughness": roughness,
    }


def _sampled(y: FloatArray, x: FloatArray) -> NDArray[np.intp]:
    """Return the apertures on a grid all over a quadrant, one quadrant after the other; all of them if few."""
    if len(y) <= SAMPLED**2:
        return np.arange(len(y))
    found = []
    for i, at_y in enumerate(_spread(y)):
        for j, at_x in enumerate(_spread(x)):
            same = np.flatnonzero((y == at_y) & (x == at_x))
            found.append(same[(i + 2 * j) % len(same)])
    return np.array(found)


def _spread(offsets: FloatArray) -> FloatArray:
    """Return a few of the distinct values, in equal steps of their logarithms as far as they can."""
    values = np.unique(offsets)
    wanted = np.geomspace(values[0], values[-1], SAMPLED)
    return np.asarray(values[np.unique(np.abs(values[:, None] - wanted).argmin(axis=0))])


def _everywhere(y: FloatArray, x: FloatArray, chosen: NDArray[np.intp], values: FloatArray) -> FloatArray:
    """Return the values at all apertures from some: a polynomial of logarithms in the distances from both axes."""
    if len(chosen) == len(y):
        return values
    u, v = (2.0 * np.log(at / at.min()) / np.log(at.max() / at.min()) - 1.0 for at in (y, x))
    order = np.add.outer(np.arange(DEGREE + 1), np.arange(DEGREE + 1)).ravel()
    terms = np.polynomial.chebyshev.chebvander2d(u, v, [DEGREE, DEGREE])[:, order <= DEGREE]
    fitted = np.linalg.lstsq(terms[chosen], np.log(values), rcond=None)[0]
    return np.asarray(np.exp(terms @ fitted))


def matched_kernel(source: FloatArray, lambda_d_pixels: float) -> FloatArray:
    """Return the weights of the matched filter, odd shape, centred: a unit source, cut to a disc of 1.5 lambda/D.

    The sharp edge of an aperture would leave more peaks of noise than the thresholds of a smooth field foresee.

    Parameters
    ----------
    source : ndarray
        Unmasked source on a stamp, (y, x).
    lambda_d_pixels : float
        lambda/D at band centre.
    """
    reach = KERNEL_LAMBDA_D * lambda_d_pixels
    half = min(int(np.ceil(reach)), len(source) // 2)
    offset = np.arange(-half, half + 1)
    return np.where(np.hypot(offset[:, None], offset) <= reach + 0.5, _middle(source, 2 * half + 1), 0.0)


def _fifths(ordered: FloatArray) -> list[FloatArray]:
    """Return five equal parts of ordered values; few of them count several times."""
    return np.split(np.repeat(ordered, 5), 5)


def _middle(image: FloatArray, side: int) -> FloatArray:
    """Return the middle of an image, with nothing beyond its edges."""
    more = max(side - len(image), 0) // 2
    wide = np.pad(np.asarray(image, float), more)
    centre = len(wide) // 2
    cut = slice(centre - side // 2, centre + side // 2 + 1)
    return wide[cut, cut]


def kernel_smoothness(kernel: FloatArray) -> tuple[float, float]:
    """Return the positions of white noise, seen through a filter, that are worth one, and its roughness.

    The first is the sum of the squared autocorrelation; the second the variance of the gradient of the noise over its
    variance along one axis, per square pixel, of a Gaussian with the same correlation of neighbours.
    """
    spectrum = np.abs(np.fft.rfft2(kernel, (4 * len(kernel),) * 2)) ** 2
    alone = np.fft.irfft2(spectrum)
    alone /= alone[0, 0]
    return float(np.sum(alone**2)), -2.0 * float(np.log(alone[0, 1]))


def _clipped(row: int, column: int, weights: FloatArray, side: int) -> Aperture:
    """Return the first row and column and the weights of an aperture's part in its quadrant of so many pixels."""
    half, spans = len(weights) // 2, []
    for at in (row, column):
        low = at // side * side
        spans.append((max(at - half, low), min(at + half + 1, low + side)))
    rows, columns = (slice(a - at + half, b - at + half) for at, (a, b) in zip((row, column), spans, strict=True))
    return spans[0][0], spans[1][0], weights[rows, columns]


def _cross_variance(
    imager: Imager, axes: tuple[PixelAxis, PixelAxis], psd_slope: float, mean: FloatArray, apertures: list[Aperture]
) -> FloatArray:
    """Return the variance of ``2 Re(E0* dE)`` of 1 nm screens, in apertures less the sum by ``mean``, one for each.

    Every sum is taken back through the transforms to what it reads of the pupil.
    """
    samples, owners, grid = len(imager.transmission), [axis.owners for axis in axes], imager.focal_grid(*axes)
    counted, parts = axes[0].weights[:, None] * axes[1].weights, []
    for index, (wavelength, weight) in enumerate(zip(imager.wavelengths_m, imager.weights, strict=True)):
        pupil = imager.pupil(index)
        static = grid.transformed(index, pupil).conj() * counted
        scale = 4j * np.pi / (wavelength * 1e9) * weight * imager.pixel_solid_angle_sr
        parts.append((grid.rows[index].full(samples).T, static, grid.columns[index].full(samples), scale * pupil))

    def read(row: int, column: int, weights: FloatArray) -> FloatArray:
        """Return the map of the pupil by which the weighted sum of pixels from ``row, column`` on reads a screen."""
        near = zip(owners, (row, column), weights.shape, strict=True)
        rows, columns = (slice(*np.searchsorted(pixel, [first, first + n])) for pixel, first, n in near)
        by_node = weights[np.ix_(owners[0][rows] - row, owners[1][columns] - column)]
        total = np.zeros((samples, samples))
        for to_y, static, to_x, pupil in parts:
            total += (pupil * (to_y[:, rows] @ (static[rows, columns] * by_node) @ to_x[columns])).real
        return total

    screens, off = screen_model(samples, psd_slope), read(0, 0, mean)
    blocks = [apertures[start : start + _BLOCK] for start in range(0, len(apertures), _BLOCK)]
    return np.concatenate([screens.variance(np.array([read(*part) - off for part in block])) for block in blocks])


def visit_responses(
    imager: Imager, y: PixelAxis, x: PixelAxis, psd_slope: float, n_visits: int, seed: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the pixel images I0, L_k and Q_k at unit rms (1 nm): (1, y, x), (n_visits, y, x) and (n_visits, y, x).

    Parameters
    ----------
    imager : Imager
    y, x : PixelAxis
    psd_slope : float
        Exponent of the power spectrum of the screens, ``f^-slope``.
    n_visits : int
        Number of visits.
    seed : int
        Seed of all random streams.
    """
    screens = screen_model(len(imager.transmission), psd_slope)
    rng = stream(seed, "rdi_floor")
    grid = imager.focal_grid(y, x)
    pupils = [imager.pupil(index) for index in range(imager.weights.size)]
    fields = [grid.transformed(index, pupil) for index, pupil in enumerate(pupils)]
    phase_per_nm = 2j * np.pi / (imager.wavelengths_m * 1e9)
    nominal = grid.image()
    linear, quadratic = (np.empty((n_visits, *nominal.shape)) for _ in range(2))
    for visit in range(n_visits):
        screen = screens.draw(rng, 1.0)
        cross, square = np.zeros(fields[0].shape), np.zeros(fields[0].shape)
        for index, (pupil, field, weight) in enumerate(zip(pupils, fields, imager.weights, strict=True)):
            change = phase_per_nm[index] * grid.transformed(index, pupil * screen)
            cross += 2 * weight * (field.conj() * change).real
            square += weight * np.abs(change) ** 2
        linear[visit] = grid.pixels(cross) * imager.pixel_solid_angle_sr
        quadratic[visit] = grid.pixels(square) * imager.pixel_solid_angle_sr
    return nominal, linear, quadratic


JITTER_NODES = 3
POINT = 1e-6  # width of a point that only jitter widens, pixels
FIELD_ARCSEC = 17.2  # the frame's diagonal and a margin: companions' wings across the whole detector
FRAME_ARCSEC = 8.75  # half side of the frame
WING_STEP_ARCSEC = 0.15
NEAR_ARCSEC, NEAR_STEP_LAMBDA_D = 8.0, 0.6  # half side and step of the map of apertures around a source


def stamp_figures(imager: Imager, on_axis: FloatArray, off_axis: FloatArray) -> dict[str, object]:
    """Return the figures that follow from the two stamps and the core of the PSF: milliseconds.

    Parameters
    ----------
    imager : Imager
    on_axis : ndarray
        Star behind the mask, (y, x).
    off_axis : ndarray
        Unmasked source, (y, x).
    """
    pixel, radius = imager.pixel_scale_arcsec, imager.aperture_radius_arcsec
    cells, step = core_cells(pixel, radius)
    axis = pixel_axis(cells * pixel, step, JITTER_NODES, jitter_arcsec=imager.jitter_arcsec)
    figures = figures_of_stamps(on_axis, off_axis, imager.image(axis, axis), imager.geometry, (1, 1))
    offset = centred_axis(len(on_axis), pixel)
    hole = imager.zone.covers(offset, offset, pixel / 2)
    brightest = float(on_axis[hole].max(initial=0.0))
    return figures | {"core_continuous": _circle_energy(imager), "peak_on_axis_hole": brightest}


def _circle_energy(imager: Imager) -> float:
    """Return the energy of the unmasked source in the ideal circle of the aperture."""
    pixel, radius = imager.pixel_scale_arcsec, imager.aperture_radius_arcsec
    nodes, weights = np.polynomial.legendre.leggauss(40)
    circle = 0.0
    for node, weight in zip(nodes, weights, strict=True):
        chord = float(np.sqrt(1 - node**2))
        y, x = (_points(imager, at) for at in (radius * chord * nodes, np.array([radius * node])))
        circle += weight * chord * float(weights @ imager.image(y, x)[:, 0])
    return circle * (radius / pixel) ** 2


def _wings(imager: Imager) -> dict[str, object]:
    """Return the unmasked PSF's azimuthal mean in rings one pixel wide, its means in boxes, its column sums.

    And its sums over apertures near the source.
    """
    pixel = imager.pixel_scale_arcsec
    half = int(np.ceil(FIELD_ARCSEC / pixel))
    pixels = np.arange(-half, half + 1)
    angles = centred_axis(2 * half + 1, pixel)
    image = imager.intensity(angles, angles)
    ring = np.rint(np.hypot(pixels[:, None], pixels)).astype(np.intp).ravel()
    totals, counts = np.bincount(ring, image.ravel()), np.bincount(ring)
    box = max(1, round(WING_STEP_ARCSEC / pixel / 2))
    arm = np.arange(0, FIELD_ARCSEC - 2 * WING_STEP_ARCSEC, WING_STEP_ARCSEC)
    centre = half + np.rint(np.concatenate([-arm[:0:-1], arm]) / pixel).astype(int)
    low, high = centre - box, centre + box + 1
    table = cumulative_table(image)
    sums = table[np.ix_(high, high)] - table[np.ix_(low, high)] - table[np.ix_(high, low)] + table[np.ix_(low, low)]
    weights = overlap_weights(imager.aperture_radius_arcsec / pixel)
    step = max(1, round(NEAR_STEP_LAMBDA_D * imager.lambda_d_arcsec / pixel))
    reach = int(NEAR_ARCSEC / pixel / step) * step
    near = slice(half - reach - len(weights) // 2, half + reach + len(weights) // 2 + 1)
    inside = slice(len(weights) // 2, -(len(weights) // 2), step)
    return {
        "wing_profile": totals[: half + 1] / counts[: half + 1],
        "wing_map": sums / (2 * box + 1) ** 2,
        "wing_map_step_arcsec": WING_STEP_ARCSEC,
        "column_profile": image.sum(axis=0),
        "aperture_map": aperture_sums(image[near, near], weights)[inside, inside],
        "aperture_map_step_arcsec": step * pixel,
    }


def _register_tail(rows: FloatArray, offset_arcsec: FloatArray, intervals: Sequence[tuple[float, float]]) -> float:
    """Return the largest running mean that ends at an edge of the hole, whichever way the rows are read out.

    A register of capacity q passes the charge above q on to the next pixel. Nothing is left over at the edge
    exactly if every run of pixels that ends there holds at most q a pixel on average.
    """
    worst = 0.0
    for low, high in intervals:
        for run in (rows[:, offset_arcsec < low][:, ::-1], rows[:, offset_arcsec > high]):
            worst = max(worst, float((run.cumsum(axis=1) / np.arange(1, run.shape[1] + 1)).max()))
    return worst


def _source_noise_fraction(imager: Imager) -> float:
    """Return the mean over nine positions within a pixel of ``sum(w^2 mu) / sum(w mu)``."""
    pixel, radius = imager.pixel_scale_arcsec, imager.aperture_radius_arcsec / imager.pixel_scale_arcsec
    half = int(np.ceil(radius + 0.5))
    axis = imager.axis(centred_axis(2 * half + 1, pixel), masked=False)
    thirds = (-1 / 3, 0.0, 1 / 3)
    fractions = []
    for dy in thirds:
        for dx in thirds:
            light = imager.image(axis, axis, source_arcsec=(dx * pixel, dy * pixel))
            weights = overlap_weights(radius, dy, dx)
            fractions.append(float((weights**2 * light).sum() / (weights * light).sum()))
    return float(np.mean(fractions))


def measure_metrics(imager: Imager, psd_slope: float, wide: Imager | None = None) -> PsfMetrics:
    """Return everything but the state of the hole: stamps, wings, brightest pixel and speckle floor; some seconds.

    Parameters
    ----------
    imager : Imager
    psd_slope : float
        Of the drift screens behind the floor.
    wide : Imager, optional
        The same optics with more wavelengths, for the far wings.
    """
    masked, clear = imager.stamp_axis(masked=True), imager.stamp_axis(masked=False)
    on_axis, off_axis = imager.image(masked, masked), imager.image(clear, clear)
    half = int(np.ceil(FRAME_ARCSEC / imager.pixel_scale_arcsec))
    offset = centred_axis(2 * half + 1, imager.pixel_scale_arcsec)
    coarse = imager.axis(offset, masked=True, pixel_nodes=1)
    frame = (wide or imager).image(coarse, coarse)
    hole, (_, columns) = imager.zone.covers(offset, offset), imager.zone.intervals()
    unit = matched_kernel(off_axis, imager.lambda_d_arcsec / imager.pixel_scale_arcsec)
    stamp = slice(half - len(on_axis) // 2, half + len(on_axis) // 2 + 1)
    beyond = np.concatenate([frame[: stamp.start, stamp], frame[stamp.stop :, stamp]])
    values = imager.geometry.figures() | stamp_figures(imager, on_axis, off_axis)
    values |= {
        "band": imager.band,
        "hole_state": "none",
        "strehl": strehl(imager),
        "apodizer_energy": imager.apodizer_energy,
        "peak_on_axis_frame": max(float(frame.max()), float(on_axis.max())),
        "peak_on_axis_columns": float(frame[:, hole.any(axis=0)].max()),
        "register_tail": _register_tail(frame[hole.any(axis=1)], offset, columns),
        "column_light": on_axis.sum(axis=0) + beyond.sum(axis=0),
        "source_noise_fraction": _source_noise_fraction(imager),
        "pupil_steps": len(imager.transmission),
    }
    values |= _wings(wide or imager) | measure_floor(imager, psd_slope, unit)
    return PsfMetrics.from_arrays({name: np.asarray(value) for name, value in values.items()})


def strehl(imager: Imager) -> float:
    """Return the on-axis intensity relative to the same apodizer with a flat wavefront and no jitter, over the band."""
    point = _points(imager, np.zeros(1))
    flat = replace(imager, static=None).intensity(np.zeros(1), np.zeros(1))
    return float(imager.image(point, point)[0, 0] / flat[0, 0])


def _points(imager: Imager, angles_arcsec: FloatArray) -> PixelAxis:
    """Return the points of an axis that only jitter widens."""
    width = POINT * imager.pixel_scale_arcsec
    return pixel_axis(angles_arcsec, width, JITTER_NODES, jitter_arcsec=imager.jitter_arcsec)
