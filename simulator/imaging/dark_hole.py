"""Dark hole of one band: the state of the mirror, how the search went, and how dark it is on an independent grid.

Electric-field conjugation finds the commands of the deformable mirror that cancel the starlight in the dark zone.

With the pupil field P and a separable mirror, the change of the focal-plane field per nanometre of actuator (k, l) is
``(4 pi i / lambda) (M_y B)_k P (M_x B)_l``, M the matrices of the transform that builds the point-spread functions and
B the influence functions: three matrix products give the exact Jacobian at any state of the mirror (Give'on et al.
2007, without finite differences). Each iteration linearises anew at the present state, solves the normal equations of
``sum |E + J c|^2 + beta max(diag) |c|^2`` for a few Tikhonov parameters beta around the last good one, and keeps the
step whose *true* field is darkest. Every few iterations the parameter is forced low: such a strong step may make the
hole brighter at first, and frees a one-sided search that has stalled.

A single mirror in the pupil cannot cancel amplitude errors on both sides of the star to first order. The re-linearised
search goes far below that limit, but it takes a perfect knowledge of the field and of the optics. ``single_jacobian``
is the less ideal state: one Jacobian, of the mirror at rest in the design without aberrations, used to the end.

Perfect knowledge of the field is one end of a scale. Pair-wise probing (Give'on et al. 2011; Groff et al. 2016) tells
the field from images with known bumps on the mirror, with an error that is white over the focal plane and the band and
has nothing to do with the field: two pairs of probes whose own light makes the noise leave a mean square error of
``1 / (4 N)`` of the peak, N the photons that an image would hold in a square lambda/D as bright as the peak.
With ``sensing_contrast`` every iteration works from such an estimate, drawn anew. Of the steps tried it keeps the one
whose image is darkest, as on a bench: the mean over the zone of an image is known far better than the field. The loop
ends at a quarter to a third of the error: each iteration adds what an estimate of its own tells.

The mirror does not point: steps that would move the image of a source are projected out, since the star is held on the
mask by a loop of its own. Left free, a one-sided search pushes the star away from its dark side, by up to half a
lambda/D, and the hole seems to begin closer to the star than it does.
"""

from dataclasses import replace
from typing import Literal

import numpy as np

from cpic_core import ComplexArray, FloatArray, NDArray, Record, announce, stream
from simulator.config import ARCSEC_PER_RAD
from simulator.imaging.deformable_mirror import DeformableMirror
from simulator.imaging.imager import Imager
from simulator.imaging.pupil import Aberrations, flat_aberrations
from simulator.imaging.zones import HoleMode, HoleSide, HoleZone

HoleMethod = Literal["relinearised", "single_jacobian"]


class ControlSettings(Record):
    """The settings of the search.

    Attributes
    ----------
    method : {"relinearised", "single_jacobian"}
        Jacobian anew at every iteration, or once of the design.
    bandwidth : float
        Controlled relative bandwidth around band centre, 0 to 0.5.
    n_wavelengths : int
        Gauss-Legendre wavelengths over it, 1 to 9.
    step_lambda_d, margin_lambda_d : float
        Spacing of the control points, and how far they reach beyond the zone.
    max_iterations : int
        Upper limit, 1 to 200.
    exponents : tuple of float
        Decimal logarithms of the Tikhonov parameters to try, relative to the largest diagonal element.
    strong_exponent, strong_every : float, int
        The strong step and its period; period 0 for none.
    tolerance : float
        The search ends when the best state improved by less than this fraction over a period (five iterations if
        there are no strong steps).
    goal_contrast : float or None
        The search also ends once the mean over the control points, relative to the present peak, is at or below
        this: going deeper costs a one-sided hole its Strehl ratio.
    hold_star : bool
        Leave tip and tilt alone.
    sensing_contrast : float
        Mean square error of an estimate of the field, relative to the peak, over one square lambda/D and the
        controlled bandwidth, 0 to 1; 0 for perfect knowledge. A control point at one wavelength has the mean square
        error of its smaller share of the light.
    sensing_seed : int
        Seed of these errors.
    """

    method: HoleMethod = "relinearised"
    bandwidth: float = 0.1
    n_wavelengths: int = 3
    step_lambda_d: float = 0.5
    margin_lambda_d: float = 0.1
    max_iterations: int = 25
    exponents: tuple[float, ...] = (-1.0, -2.0, -3.0, -4.0, -5.0, -6.0)
    strong_exponent: float = -6.0
    strong_every: int = 5
    tolerance: float = 0.02
    goal_contrast: float | None = None
    hold_star: bool = True
    sensing_contrast: float = 0.0
    sensing_seed: int = 0


class Search(Record, eq=False):
    """The result of the search.

    Attributes
    ----------
    commands_nm : ndarray, shape (a, a)
        The darkest state met.
    history : tuple of float
        Mean intensity over control points and wavelengths, relative to the peak with a flat wavefront: before the
        first iteration, then after each.
    strong : tuple of bool
        Which iterations were strong steps; all others never brighten the hole.
    ended : {"converged", "goal", "iterations"}
        Why it stopped.
    """

    commands_nm: FloatArray
    history: tuple[float, ...]
    strong: tuple[bool, ...]
    ended: Literal["converged", "goal", "iterations"]


class Conjugation:
    """Field and Jacobian at the control points of one band, for any state of the mirror.

    Parameters
    ----------
    imager : Imager
        Optical model; its ``transform`` and pupil grid are used as they are.
    static : Aberrations
        Static wavefront on the imager's pupil grid.
    mirror : DeformableMirror
        The mirror.
    zone : HoleZone
        The dark zone.
    settings : ControlSettings
        Grid and wavelengths.
    """

    def __init__(
        self, imager: Imager, static: Aberrations, mirror: DeformableMirror, zone: HoleZone, settings: ControlSettings
    ) -> None:
        nodes, weights = np.polynomial.legendre.leggauss(settings.n_wavelengths)
        self.wavelengths_m = imager.center_m * (1.0 + 0.5 * settings.bandwidth * nodes)
        self.band, self.transmission = imager.band, imager.transmission
        self.aberrations, self.mirror = static, mirror
        step, margin = (value * imager.lambda_d_arcsec for value in (settings.step_lambda_d, settings.margin_lambda_d))
        y, x = zone.control_axes(step, margin)
        self.n_y, self.n_x = y.size, x.size
        self._functions = mirror.influence(len(imager.transmission))
        origin = [imager.transform(np.zeros(1), wavelength)[0] for wavelength in self.wavelengths_m]
        on_axis = [abs(row @ imager.transmission @ row) ** 2 for row in origin]
        peak = 0.5 * float(weights @ on_axis)
        self._factors = np.sqrt(0.5 * weights / peak)
        self._origin = origin
        self._y = [imager.transform(y, wavelength) for wavelength in self.wavelengths_m]
        self._x = [imager.transform(x, wavelength) for wavelength in self.wavelengths_m]

    def pupil(self, commands_nm: FloatArray, index: int, aberrations: Aberrations | None = None) -> ComplexArray:
        """Return the pupil field at one wavelength.

        Parameters
        ----------
        commands_nm : ndarray
            Commands of the mirror's actuators, nm of surface, shape (a, a).
        index : int
            Number of the wavelength.
        aberrations : Aberrations, optional
        """
        opd_nm = 2.0 * (self._functions @ commands_nm @ self._functions.T)
        static = self.aberrations if aberrations is None else aberrations
        return static.pupil(self.transmission, float(self.wavelengths_m[index]), opd_nm=opd_nm)

    def fields(self, commands_nm: FloatArray) -> ComplexArray:
        """Return the field at the control points, shape (wavelengths, n_y, n_x).

        Scaled so that the sum of squares over wavelengths is the intensity relative to the flat-wavefront peak.
        """
        fields = []
        for index, (factor, y, x) in enumerate(zip(self._factors, self._y, self._x, strict=True)):
            fields.append(factor * (y @ (self.pupil(commands_nm, index) @ x.T)))
        return np.stack(fields)

    def strehl(self, commands_nm: FloatArray) -> float:
        """Return the on-axis intensity relative to the flat wavefront, over the controlled wavelengths."""
        total = 0.0
        for index, (factor, row) in enumerate(zip(self._factors, self._origin, strict=True)):
            total += float(abs(factor * (row @ self.pupil(commands_nm, index) @ row)) ** 2)
        return total

    def pointing_modes(self) -> FloatArray:
        """Return the directions of commands that tip and tilt the transmitted wavefront, orthonormal, (a * a, 2)."""
        samples = len(self.transmission)
        position = (np.arange(samples) + 0.5) / samples - 0.5
        functions, modes = self._functions, []
        for plane in (position[:, None], position[None, :]):
            modes.append((functions.T @ (self.transmission * plane) @ functions).ravel())
        basis: FloatArray = np.linalg.qr(np.stack(modes, axis=1) * self.mirror.alive.reshape(-1, 1))[0]
        return basis

    def jacobian(self, commands_nm: FloatArray, index: int, aberrations: Aberrations | None = None) -> ComplexArray:
        """Return the derivative of ``fields[index]`` by each command, per nm, shape (n_y * n_x, a * a).

        Parameters
        ----------
        commands_nm : ndarray
            Commands of the mirror's actuators, nm of surface, shape (a, a).
        index : int
            Number of the wavelength.
        aberrations : Aberrations, optional
        """
        actuators, samples = self.mirror.n_actuators, len(self.transmission)
        scale = self._factors[index] * 4j * np.pi / (self.wavelengths_m[index] * 1e9)
        axes = self._y[index], self._x[index]
        left, right = ((matrix[:, None, :] * self._functions.T).reshape(-1, samples) for matrix in axes)
        product = left @ (scale * self.pupil(commands_nm, index, aberrations)) @ right.T
        blocks = product.reshape(self.n_y, actuators, self.n_x, actuators).transpose(0, 2, 1, 3)
        return np.asarray(blocks.reshape(self.n_y * self.n_x, actuators**2))


class _NormalEquations:
    """``J^T J`` of stacked real and imaginary parts, and ``J^T E``, over all wavelengths, for living actuators."""

    def __init__(self, problem: Conjugation, settings: ControlSettings) -> None:
        self.problem, method = problem, settings.method
        self.alive = problem.mirror.alive.ravel()
        self.held = problem.pointing_modes()[self.alive] if settings.hold_star else None
        self.fixed: list[FloatArray] | None = None
        if method == "single_jacobian":
            rest = np.zeros(problem.mirror.alive.shape)
            design = flat_aberrations(len(problem.transmission))
            self.fixed = [self._real(problem.jacobian(rest, index, design)) for index in self._indices]
            self.matrix = np.asarray(sum(part.T @ part for part in self.fixed))

    @property
    def _indices(self) -> range:
        return range(self.problem.wavelengths_m.size)

    def _real(self, jacobian: ComplexArray) -> FloatArray:
        living = jacobian if self.alive.all() else jacobian[:, self.alive]
        parts = np.concatenate([living.real, living.imag])
        if self.held is not None:  # steps have no part along directions that change nothing
            parts -= (parts @ self.held) @ self.held.T
        return parts

    def at(self, commands_nm: FloatArray, fields: ComplexArray) -> tuple[FloatArray, FloatArray]:
        """Return the matrix and right-hand side at a state."""
        matrix, side = np.zeros((self.alive.sum(),) * 2), np.zeros(self.alive.sum())
        for index in self._indices:
            if self.fixed is None:
                part = self._real(self.problem.jacobian(commands_nm, index))
                matrix += part.T @ part
            else:
                part = self.fixed[index]
            field = fields[index].ravel()
            side += part.T @ np.concatenate([field.real, field.imag])
        return (matrix if self.fixed is None else self.matrix), side


def sensed(fields: ComplexArray, settings: ControlSettings, rng: np.random.Generator) -> ComplexArray:
    """Return an estimate of the field at the control points, by probing.

    Parameters
    ----------
    fields : ndarray, shape (wavelengths, n_y, n_x)
        The field as `Conjugation.fields` gives it, to whose square each wavelength contributes by its weight; an error
        that is white over the band therefore is the same at all of them.
    settings : ControlSettings
    rng : numpy.random.Generator
        Source of the errors.
    """
    if settings.sensing_contrast == 0:
        return fields
    rms = np.sqrt(settings.sensing_contrast / 2.0) / settings.step_lambda_d
    real, imaginary = rng.normal(0.0, rms, (2, *fields.shape))
    estimate: ComplexArray = fields + (real + 1j * imaginary)
    return estimate


def _step(matrix: FloatArray, side: FloatArray, exponent: float) -> FloatArray:
    """Return the Tikhonov solution of the normal equations."""
    from scipy.linalg import cho_factor, cho_solve

    damped = matrix.copy()
    damped.flat[:: len(damped) + 1] += 10.0**exponent * matrix.diagonal().max()
    answer: FloatArray = cho_solve(cho_factor(damped, overwrite_a=True, check_finite=False), -side, check_finite=False)
    return answer


def conjugate(problem: Conjugation, settings: ControlSettings, start_nm: FloatArray | None = None) -> Search:
    """Return the search for the darkest state.

    Parameters
    ----------
    problem : Conjugation
        Optics, mirror, zone.
    settings : ControlSettings
        Method, steps and stopping rules.
    start_nm : ndarray, shape (a, a), optional
        First state of the mirror; at rest if omitted.

    Returns
    -------
    Search
    """
    mirror = problem.mirror
    equations = _NormalEquations(problem, settings)
    limit = mirror.stroke_nm / 2
    state = np.zeros(mirror.alive.shape) if start_nm is None else np.where(mirror.alive, start_nm, 0.0)

    def moved(step: FloatArray) -> FloatArray:
        commands = state.copy()
        commands[mirror.alive] += step
        return np.clip(commands, -limit, limit)

    def intensity(fields: ComplexArray) -> float:
        return float(np.vdot(fields, fields).real / fields[0].size)

    fields = problem.fields(state)
    history, strong_steps = [intensity(fields)], []
    best, darkest = state, history[0]
    bests = [darkest]
    order = sorted(settings.exponents, reverse=True)
    last = len(order) // 2
    period = settings.strong_every or 5
    ended: Literal["converged", "goal", "iterations"] = "iterations"

    rng = stream(settings.sensing_seed, "sensing", problem.band)

    def reached() -> bool:
        return settings.goal_contrast is not None and darkest <= settings.goal_contrast * problem.strehl(best)

    for iteration in range(settings.max_iterations):
        if reached():
            ended = "goal"
            break
        if iteration:
            done = f"step {iteration} of at most {settings.max_iterations} done, contrast {darkest:.1e}"
            announce(f"digging the dark hole of {problem.band}: {done}")
        # The last iterations of a search that runs to its limit polish the state that the last strong step opened.
        turn = settings.strong_every > 0 and (iteration + 1) % settings.strong_every == 0
        strong = turn and iteration < settings.max_iterations - 3
        matrix, side = equations.at(state, sensed(fields, settings, rng))
        first = order[max(last - 1, 0) : last + 2] if iteration else order
        rounds = ([settings.strong_exponent],) if strong else (first, order)
        chosen: tuple[float, FloatArray, ComplexArray] | None = None
        for exponents in rounds:
            for exponent in exponents:
                trial = moved(_step(matrix, side, exponent))
                trial_fields = problem.fields(trial)
                value = intensity(trial_fields)
                if strong or value < (chosen[0] if chosen else history[-1]):
                    chosen = (value, trial, trial_fields)
                    last = last if strong else order.index(exponent)
            if chosen is not None:
                break
        if chosen is None:
            ended = "converged"
            break
        value, state, fields = chosen
        history.append(value)
        strong_steps.append(strong)
        if value < darkest:
            darkest, best = value, state
        bests.append(darkest)
        # Judged just before a strong step, so that the previous one had a whole period to pay.
        due = (iteration + 2) % period == 0 and len(bests) > period
        if due and darkest > (1 - settings.tolerance) * bests[-1 - period]:
            ended = "converged"
            break
    best = best.copy()
    best.flags.writeable = False
    return Search(best, tuple(history), tuple(strong_steps), ended)


SCORE_STEP_LAMBDA_D = 0.25
SCORE_WAVELENGTHS = 8  # an even number shares no node with an odd number of controlled wavelengths
CHORDS = 16  # of the aperture: exact to rounding for an aperture of about one lambda/D
LIMIT_CONTRAST = {"4q": 2e-9, "2q": 8e-9}
GOAL_CONTRAST = {"4q": 1.05e-9, "2q": 6e-9}
SINGLE_LIMIT = 5e-8
KICK_NM, KICK_SEED = 1.0, 1


class HoleScore(Record):
    """Contrast over the zone: intensity over the peak of the unmasked PSF with the same apodizer and mirror.

    Attributes
    ----------
    mean, median, p95, max : float
        Over points 0.25 lambda/D apart.
    strehl : float
        Peak relative to the same apodizer with a flat wavefront.
    core_throughput : float
        Energy of an unmasked source in the aperture (an ideal circle), relative to the clear disc.
    """

    mean: float
    median: float
    p95: float
    max: float
    strehl: float
    core_throughput: float


class DarkHole(Record, eq=False):
    """The state of the mirror that a search found; a dark hole only where it was `reached`.

    Attributes
    ----------
    band : str
        Name of the band.
    zone : HoleZone
        The dark zone.
    method : {"relinearised", "single_jacobian"}
        How the state was found.
    commands_nm : ndarray, shape (a, a)
        Surface commands, read-only.
    search : Search
        History of the search.
    before : HoleScore
        The mirror at rest, over the controlled bandwidth.
    wide : HoleScore
        The result over the controlled bandwidth, flat spectrum.
    own : HoleScore
        The result in the band's own width, at the imager's wavelengths and weights.
    limit_contrast : float
        Mean of ``wide`` at or below which the hole counts as reached.
    """

    band: str
    zone: HoleZone
    method: HoleMethod
    commands_nm: FloatArray
    search: Search
    before: HoleScore
    wide: HoleScore
    own: HoleScore
    limit_contrast: float

    @property
    def reached(self) -> bool:
        """Whether the hole is as dark as asked."""
        return self.wide.mean <= self.limit_contrast

    @property
    def reason(self) -> str:
        """One sentence for people on a hole that was not reached."""
        return (
            f"{self.band} {self.zone.mode}: mean contrast {self.wide.mean:.2g} after {len(self.search.strong)} "
            f"iterations ({self.search.ended}), asked {self.limit_contrast:.2g}"
        )


def default_settings(
    mode: HoleMode, method: HoleMethod = "relinearised", sensing_contrast: float = 0.0
) -> ControlSettings:
    """Return the settings that reach the stated contrast in every visible band of the default instrument.

    The goals end a search where more depth would cost more Strehl ratio than it is worth: in ``4q`` at the floor of the
    apodizer (F520 converges above it), in ``2q`` at about half the asked contrast. The single Jacobian is damped as in
    a control loop that cannot try out each step. With errors of sensing, ten rounds of probes are taken; a strong step
    would drive the mirror by the errors alone, and late steps are damped more than without errors.

    Parameters
    ----------
    mode : HoleMode
    method : HoleMethod, optional
    sensing_contrast : float, optional
        Error of the estimates of the field, see `ControlSettings`.
    """
    if method == "single_jacobian":
        few = ControlSettings(method=method, max_iterations=10, strong_every=0, exponents=(-1.0, -2.0, -3.0))
        return replace(few, sensing_contrast=sensing_contrast)
    goal = GOAL_CONTRAST[mode]
    if sensing_contrast > 0:
        ladder = (1.0, 0.0, -1.0, -2.0, -3.0, -4.0, -5.0)
        return ControlSettings(
            max_iterations=10,
            exponents=ladder,
            strong_every=0,
            tolerance=0.0,
            goal_contrast=goal,
            sensing_contrast=sensing_contrast,
        )
    return ControlSettings(max_iterations=40 if mode == "2q" else 25, goal_contrast=goal)


def solve_dark_hole(
    imager: Imager,
    aberrations: Aberrations,
    mirror: DeformableMirror | None = None,
    *,
    mode: HoleMode = "4q",
    side: HoleSide = "right",
    settings: ControlSettings | None = None,
) -> DarkHole:
    """Find the mirror state of one band and say how dark it is.

    Parameters
    ----------
    imager : Imager
        Optical model of the band. The state belongs to its pupil grid: on another grid (unless that repeats this one)
        a hole of 1e-9 fills up to 5e-9.
    aberrations : Aberrations
        Static wavefront on that grid.
    mirror : DeformableMirror, optional
        The default mirror if omitted. Quantisation and noise do not enter the search; `score_hole` of
        ``mirror.realise(commands)`` tells what they cost.
    mode : {"4q", "2q"}
        Four quadrants, or two on one side of the star.
    side : {"right", "left", "top", "bottom"}
        Side for ``2q``.
    settings : ControlSettings, optional
        `default_settings` of the mode if omitted.

    Returns
    -------
    DarkHole
        It counts as reached at a mean contrast over the controlled bandwidth of 2e-9 in ``4q``, 8e-9 in ``2q``, 5e-8
        with a single Jacobian, and half the sensing error more.

    Raises
    ------
    InputError
        If a parameter is out of range or the grids differ.
    """
    mirror = mirror or DeformableMirror()
    zone = HoleZone(*imager.hole_arcsec, mode, side)
    settings = settings or default_settings(mode)
    limit_contrast = SINGLE_LIMIT if settings.method == "single_jacobian" else LIMIT_CONTRAST[mode]
    limit_contrast += settings.sensing_contrast / 2.0
    problem = Conjugation(imager, aberrations, mirror, zone, settings)
    wide_nodes, wide_weights = np.polynomial.legendre.leggauss(SCORE_WAVELENGTHS)
    wavelengths = imager.center_m * (1.0 + 0.5 * settings.bandwidth * wide_nodes)

    def score(commands: FloatArray) -> HoleScore:
        return score_hole(imager, aberrations, mirror, commands, zone, wavelengths, 0.5 * wide_weights)

    search = conjugate(problem, settings)
    before = score(np.zeros_like(search.commands_nm))
    at_rest = float(np.abs(search.commands_nm).max()) < 1e-3 * KICK_NM
    if search.ended == "converged" and at_rest and before.mean > limit_contrast:
        # Amplitude errors alone give a flat mirror no first step downwards: a nanometre of anything opens one.
        kick = KICK_NM * np.random.default_rng(KICK_SEED).standard_normal(search.commands_nm.shape)
        again = conjugate(problem, settings, start_nm=kick)
        search = again if min(again.history) < min(search.history) else search
    wide = score(search.commands_nm)
    own = score_hole(imager, aberrations, mirror, search.commands_nm, zone)
    return DarkHole(imager.band, zone, settings.method, search.commands_nm, search, before, wide, own, limit_contrast)


def score_hole(
    imager: Imager,
    aberrations: Aberrations,
    mirror: DeformableMirror,
    commands_nm: FloatArray,
    zone: HoleZone,
    wavelengths_m: FloatArray | None = None,
    weights: FloatArray | None = None,
) -> HoleScore:
    """Return the contrast of any state of the mirror over the zone, on a grid that the search does not use.

    Parameters
    ----------
    wavelengths_m, weights : ndarray, shape (w,), optional
        Quadrature over wavelength, weights summing to 1; the imager's own (the band's width) if omitted.
    """
    if wavelengths_m is None or weights is None:
        wavelengths_m, weights = imager.wavelengths_m, imager.weights
    opd_nm = mirror.opd_nm(commands_nm, len(imager.transmission))
    y, x = zone.score_axes(SCORE_STEP_LAMBDA_D * imager.lambda_d_arcsec)
    light, peak, flat, core = np.zeros((y.size, x.size)), 0.0, 0.0, 0.0
    for wavelength, weight in zip(wavelengths_m, weights, strict=True):
        pupil = aberrations.pupil(imager.transmission, float(wavelength), opd_nm=opd_nm)
        light += weight * np.abs(imager.transform(y, wavelength) @ pupil @ imager.transform(x, wavelength).T) ** 2
        origin = imager.transform(np.zeros(1), wavelength)[0]
        peak += weight * abs(origin @ pupil @ origin) ** 2
        flat += weight * abs(origin @ imager.transmission @ origin) ** 2
        core += weight * _circle_energy(imager, pupil, float(wavelength))
    contrast = light / peak
    return HoleScore(
        mean=float(contrast.mean()),
        median=float(np.median(contrast)),
        p95=float(np.percentile(contrast, 95)),
        max=float(contrast.max()),
        strehl=float(peak / flat),
        core_throughput=float(core),
    )


def _circle_energy(imager: Imager, pupil: NDArray[np.complex128], wavelength_m: float) -> float:
    """Return the energy within the aperture radius of the axis: chords at Chebyshev nodes, weighted by length."""
    angle = np.pi * np.arange(1, CHORDS + 1) / (CHORDS + 1)
    nodes, weights = np.polynomial.legendre.leggauss(CHORDS)
    radius = imager.aperture_radius_arcsec
    energy = 0.0
    for along, half_chord in zip(radius * np.cos(angle), np.sin(angle), strict=True):
        rows = imager.transform(radius * half_chord * nodes, wavelength_m)
        column = imager.transform(np.array([along]), wavelength_m)
        energy += half_chord**2 * float(weights @ np.abs(rows @ (pupil @ column.T))[:, 0] ** 2)
    return energy * np.pi / (CHORDS + 1) * (radius / ARCSEC_PER_RAD) ** 2
