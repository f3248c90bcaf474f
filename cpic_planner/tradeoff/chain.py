"""The work that is timed on a fixed scene: both visits drawn, calibrated and measured, and the closed form."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from cpic_core import BoolArray, FloatArray, InputError, NDArray
from cpic_planner import etc, validation
from cpic_planner.confirm import scene_target
from cpic_planner.targets import Targets
from cpic_planner.tradeoff.setup import ANNULUS_LAMBDA_D, PLANET, SEED, FixedScene, Setup, visit
from cpic_planner.validation.task import gap_s
from simulator.camera import FrameNoise
from simulator.imaging import aperture_sums, centred_axis, forget_starlight, overlap_weights, psf_metrics
from simulator.knobs import FIDELITIES
from simulator.observing import Observation, hole_stacks
from simulator.target import scene_sources

_AWAY_RADII = 2.5


@dataclass(frozen=True, eq=False)
class Places:
    """Apertures on the stamp around the mask; made by `Places.of`.

    Attributes
    ----------
    white : ndarray of bool, shape (n, n)
        Centres of apertures wholly inside the hole, none of which touches the planet.
    near : ndarray of bool, shape (n, n)
        Those of them near the planet's separation.
    annulus : ndarray of bool, shape (n, n)
        Pixels of the hole near that separation.
    weights : ndarray
        Of the pixels of an aperture.
    level : ndarray, shape (n, n)
        Expected white variance of the planet's aperture, without its own light, over that of the aperture on each
        pixel: halo and companions differ from place to place.
    star_e_s, source_noise_fraction : float
        Light of the star on the clear disc, and `PsfMetrics.source_noise_fraction`.
    """

    white: BoolArray
    near: BoolArray
    annulus: BoolArray
    weights: FloatArray
    level: FloatArray
    star_e_s: float
    source_noise_fraction: float

    @classmethod
    def of(cls, case: FixedScene) -> Self:
        """Return the frames of a scene: the same for every way, so that ways can be compared."""
        metrics = psf_metrics(case.instrument, case.band)
        alone = case.scene.model_copy(update={"stars": (), "extended": ()})
        star, planet, *_ = scene_sources(alone, case.instrument, case.band)
        pixel, radius = metrics.pixel_scale_arcsec, metrics.aperture_radius_arcsec
        offset = centred_axis(len(metrics.raw_contrast), pixel)
        separation = np.hypot(planet.x_arcsec, planet.y_arcsec)
        distance = np.abs(np.hypot(offset[:, None], offset) - separation)
        around = distance <= ANNULUS_LAMBDA_D * metrics.lambda_d_arcsec
        away = np.hypot(offset[:, None] - planet.y_arcsec, offset - planet.x_arcsec) > _AWAY_RADII * radius
        white = metrics.zone.covers(offset, offset, -radius) & away
        weights = overlap_weights(radius / pixel)
        at = int(np.abs(offset - planet.y_arcsec).argmin()), int(np.abs(offset - planet.x_arcsec).argmin())
        return cls(
            white=white,
            near=white & around,
            annulus=metrics.zone.covers(offset, offset) & around,
            weights=weights,
            level=_level(case, weights, at),
            star_e_s=star.rate_e_s,
            source_noise_fraction=metrics.source_noise_fraction,
        )


def _level(case: FixedScene, weights: FloatArray, at: tuple[int, int]) -> FloatArray:
    """Return the closed-form variance at the planet over that at each place, from the expected light at quick knobs."""
    setup = Setup("frames", "hole", FIDELITIES["quick"], 1, scene_model=case.scene_model)
    observed = visit(case, setup, planets=False, n_frames=1)
    noise = FrameNoise.of(observed.instrument.detector_of(case.band), case.em_gain, case.exposure_s)
    sums = aperture_sums(noise.charge_variance_e2(observed.expected_e + noise.clock_e), weights**2)
    return np.where(sums > 0, sums[at] / np.where(sums > 0, sums, 1.0), 1.0)


_NOT_PLACE = ("background_mean",)


@dataclass(frozen=True)
class ClosedForm:
    """A fixed scene as the calculator sees it: a star, its planet's contrast and place, and the frames."""

    model: etc.EtcModel
    target: Targets
    case: FixedScene
    x_arcsec: float
    y_arcsec: float
    contrast: float

    def noise(self, n_cases: int = 1) -> etc.StackNoise:
        """Return one question, or as many at once, of planets that differ."""
        case, place = self.case, np.ones((1, n_cases))
        x, y, contrast = self.x_arcsec * place, self.y_arcsec * place, self.contrast * np.linspace(1.0, 2.0, n_cases)
        rates = etc.aperture_rates(self.model, self.target, case.band, x, y, contrast[None])
        frames, camera = (case.exposure_s, case.n_frames, case.em_gain), self.model.camera(case.band)
        if not case.is_programme:
            return etc.stack_noise(rates, *frames, camera)
        gap = gap_s(self.model, case.band, validation.Frames(*frames, case.visits))
        visits = etc.Programme.of(case.how, case.visits, gap)
        programme = etc.with_modes(self.model, case.band, np.hypot(x, y), rates, visits, *frames)
        return etc.stack_noise(rates, *frames, camera, case.how, programme)

    def answer(self) -> dict[str, float]:
        """Return the flux and variance of the visit, e- and e-^2, as the images are measured.

        A single visit has no error of the mean background; of a programme ``white_e2`` is all of the variance.
        """
        noise = self.noise()
        if self.case.is_programme:
            flux_e, snr = float(np.ravel(noise.signal_e)[0]), float(np.ravel(noise.snr)[0])
            return {"flux_e": flux_e, "white_e2": (flux_e / snr) ** 2, "speckle_e2": 0.0}
        terms = {name: float(np.ravel(part)[0]) for name, part in noise.terms.items() if name not in _NOT_PLACE}
        speckle = terms.pop("speckle")
        return {"flux_e": float(np.ravel(noise.signal_e)[0]), "white_e2": sum(terms.values()), "speckle_e2": speckle}


def closed_form(case: FixedScene) -> ClosedForm:
    """Prepare the calculator for a fixed scene."""
    # Programmes are drawn as sums of frames, which no particle hits.
    instrument = validation.images_of(case.instrument) if case.is_programme else case.instrument
    model, target = etc.build_model(instrument, [case.band], case.how), scene_target(case.scene)
    planet = next(item for item in scene_sources(case.scene, case.instrument, case.band) if item.kind == "planet")
    x, y = planet.x_arcsec, planet.y_arcsec
    if case.is_programme:  # one of two rolls stands for both
        x, y = etc.planet_offsets(model, target, case.band, float(np.hypot(x, y)))
    return ClosedForm(model, target, case, float(x), float(y), planet.contrast or 0.0)


class NotApplicable(Exception):
    """A way that a scene does not allow, with its reason."""

    def __init__(self, message: str, reason: str = "not_applicable") -> None:
        super().__init__(message)
        self.reason = reason


@dataclass(frozen=True, eq=False)
class Images:
    """Images of a programme, ready to be drawn and measured any number of times; made by `images_of_programme`.

    Attributes
    ----------
    task : ConfirmTask
    modelling : Modelling
        How they are made.
    """

    task: validation.ConfirmTask
    modelling: validation.Modelling
    _visits: validation.VisitPair
    _planets: tuple[validation.PlanetTemplate, ...]

    def measured(self, number: int) -> validation.Measurement:
        """Draw all visits once, reduce them as one, and measure the planet at its place.

        Parameters
        ----------
        number : int
            Of the realisation: the same for all ways that draw sums with as many wavefronts.

        Raises
        ------
        NotApplicable
            If nothing is left of the planet's place.
        """
        sums = self._visits if self.modelling.draw == "sums" else None
        visits, drawn, _ = next(validation.realisations(self.task, self.modelling, [number], sums))
        star = validation.StarFlux.known(visits.science.truth.sources[0].rate_e_s)
        (one,), _ = validation.measure_planets(visits, drawn, list(self._planets), star, searched=False)
        if one is None:
            raise NotApplicable("limits cut off the planet's aperture or what is around it")
        return one


def images_of_programme(
    case: FixedScene, setup: Setup | None, fidelity: str | None = None, tolerance: float | None = None
) -> Images:
    """Set up the visits of a programme.

    Parameters
    ----------
    case : FixedScene
    setup : Setup or None
        What is drawn, of which pixels, by which knobs and with how many wavefronts a visit; what the effect ledger
        chooses for the dial without.
    fidelity, tolerance
        Of the dial.

    Raises
    ------
    NotApplicable
        If the tier is too coarse for the scene, or sums cannot stand for its frames.
    """
    closed, frames = closed_form(case), validation.Frames(case.exposure_s, case.n_frames, case.em_gain, case.visits)
    model = etc.build_model(case.instrument, [case.band], case.how)
    place = closed.x_arcsec, closed.y_arcsec
    expected = validation.expected_of(model, closed.target, case.band, place, closed.contrast, frames)
    dial: validation.ImageSettings = {"seed": SEED, "fidelity": fidelity, "tolerance": tolerance}
    task = validation.task_of(model, case.scene, case.band, frames, [expected], planets=[PLANET], **dial)
    how = validation.modelling_of(task)
    if setup is not None:
        changes = {name: getattr(setup, name) for name in ("draw", "region", "knobs", "epochs")}
        how = replace(how, **changes, switches={}, left_out=(), still=())
    elif how.outcome.value is None:
        raise NotApplicable(how.outcome.message, how.outcome.reason.value)
    visits = validation.visit_pair(task, modelling=how)
    if how.draw == "sums" and visits.stackable.value is None:
        raise NotApplicable(visits.stackable.message)
    return Images(task, how, visits, validation.planet_templates(visits))


@dataclass(frozen=True, eq=False)
class Drawn:
    """Frames of one visit over the stamp, in electrons at the register input.

    Attributes
    ----------
    electrons : ndarray, shape (n, y, x)
        Calibrated; the mean of its pixel where a particle or a limit voids a pixel-frame.
    usable : ndarray of bool, shape (n, y, x)
    """

    electrons: FloatArray
    usable: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Work:
    """The outcome of the work.

    Attributes
    ----------
    science : Observation
    flux_e : float
        Planet's aperture in the science visit less that in the reference visit, electrons of the visit.
    drawn : tuple of Drawn
        Frames of both visits; none where sums were drawn.
    """

    science: Observation
    flux_e: float
    drawn: tuple[Drawn, ...]


def stamp_of(observation: Observation) -> tuple[slice, slice]:
    """Return the rows and columns of the stamp around the mask."""
    rows, columns, _ = observation.area.stamp(observation.psf.on_axis.shape[0])
    return rows, columns


def aperture_flux_e(observation: Observation, stamp_e: FloatArray) -> float:
    """Return the sum in the planet's aperture on a stamp."""
    planet = next(k for k, source in enumerate(observation.truth.sources) if source.kind == "planet")
    rows, columns = stamp_of(observation)
    y, x = observation.truth.y_pixel[planet] - rows.start, observation.truth.x_pixel[planet] - columns.start
    row, column = round(y), round(x)
    geometry = observation.psf.geometry
    weights = overlap_weights(geometry.aperture_radius_arcsec / geometry.pixel_scale_arcsec, y - row, x - column)
    half = len(weights) // 2
    return float((weights * stamp_e[row - half : row + half + 1, column - half : column + half + 1]).sum())


def drawn_frames(observation: Observation) -> Drawn:
    """Draw and calibrate the frames of a visit, particles taken out, as ``cpic confirm`` does."""
    frames = validation.calibrated_frames(observation, cropped=True)
    usable = validation.cleaned(frames)[1] if frames.detector.switches.cosmic_rays else frames.usable
    return Drawn(validation.filled(frames.electrons, usable)[0], usable)


def both_visits(case: FixedScene, setup: Setup) -> tuple[Observation, Observation]:
    """Return the science and reference visit, with new light of field stars: work that is timed begins without it."""
    forget_starlight()
    return visit(case, setup), visit(case, setup, role="reference")


def worked(case: FixedScene, setup: Setup, visits: tuple[Observation, Observation] | None = None) -> Work:
    """Do the whole work once.

    Parameters
    ----------
    case : FixedScene
    setup : Setup
    visits : tuple of Observation, optional
        Science and reference visit where they are there already.

    Returns
    -------
    Work

    Raises
    ------
    NotApplicable
        If the scene does not allow this way.
    """
    science, reference = visits or both_visits(case, setup)
    if setup.draw == "sums":
        try:
            epochs = setup.n_epochs(case)
            sums = [hole_stacks(observed, epochs=epochs).draw(summed=True)[0] for observed in (science, reference)]
        except InputError as error:
            raise NotApplicable(error.hint or str(error)) from None
        return Work(science, aperture_flux_e(science, sums[0] - sums[1]), ())
    drawn = tuple(drawn_frames(observed) for observed in (science, reference))
    means = [part.electrons.mean(axis=0) for part in drawn]
    return Work(science, case.n_frames * aperture_flux_e(science, means[0] - means[1]), drawn)
