"""Dark hole of one band: the state of the mirror, how the search went, and how dark it is on an independent grid."""

from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from cpic_core import FloatArray, NDArray
from simulator.config import ARCSEC_PER_RAD
from simulator.imaging.conjugation import Conjugation, ControlSettings, HoleMethod, Search, conjugate
from simulator.imaging.deformable_mirror import DeformableMirror
from simulator.imaging.imager import Imager
from simulator.imaging.pupil import Aberrations
from simulator.imaging.zones import HoleMode, HoleSide, HoleZone

SCORE_STEP_LAMBDA_D = 0.25
SCORE_WAVELENGTHS = 8  # an even number shares no node with an odd number of controlled wavelengths
CHORDS = 16  # of the aperture: exact to rounding for an aperture of about one lambda/D
LIMIT_CONTRAST = {"4q": 2e-9, "2q": 8e-9}
GOAL_CONTRAST = {"4q": 1.05e-9, "2q": 6e-9}
SINGLE_LIMIT = 5e-8
KICK_NM, KICK_SEED = 1.0, 1


@dataclass(frozen=True)
class HoleScore:
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


@dataclass(frozen=True, eq=False)
class HoleState:
    """The fields that a hole that was reached shares with one that was not.

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


class DarkHole(HoleState):
    """A hole as dark as asked."""


class UnreachedHole(HoleState):
    """The search ended above the asked contrast: never to be taken for a hole."""

    @property
    def reason(self) -> str:
        """One sentence for people."""
        return (
            f"{self.band} {self.zone.mode}: mean contrast {self.wide.mean:.2g} after {len(self.search.strong)} "
            f"iterations ({self.search.ended}), asked {self.limit_contrast:.2g}"
        )


HoleResult: TypeAlias = DarkHole | UnreachedHole


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
    inner_arcsec: float | None = None,
    settings: ControlSettings | None = None,
    limit_contrast: float | None = None,
) -> HoleResult:
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
    inner_arcsec : float, optional
        Inner edge of the squares per axis; the imager's if omitted.
    settings : ControlSettings, optional
        `default_settings` of the mode if omitted.
    limit_contrast : float, optional
        Mean contrast over the controlled bandwidth that makes it a `DarkHole`: 2e-9 in ``4q``, 8e-9 in ``2q``, 5e-8
        with a single Jacobian, and half the sensing error more.

    Returns
    -------
    DarkHole or UnreachedHole

    Raises
    ------
    InputError
        If a parameter is out of range or the grids differ.
    """
    mirror = mirror or DeformableMirror()
    inner, outer = imager.hole_arcsec
    zone = HoleZone(inner if inner_arcsec is None else inner_arcsec, outer, mode, side)
    settings = settings or default_settings(mode)
    if limit_contrast is None:
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
    kind = DarkHole if wide.mean <= limit_contrast else UnreachedHole
    return kind(imager.band, zone, settings.method, search.commands_nm, search, before, wide, own, limit_contrast)


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
