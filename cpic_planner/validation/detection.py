"""The blind detector: sources in a residual, found without knowing where they are."""

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cpic_core import FloatArray, InputError, Outcome, Reason, Status, check_positive, check_whole, checked_scalar
from cpic_planner.etc import MAX_SIGMA, SearchedRegion, false_alarms, search_threshold, snr_at
from cpic_planner.validation.apertures import checked_image
from cpic_planner.validation.reduced import ReducedStack
from cpic_planner.validation.search_field import REPORTED_SIGMA, FilteredState, Peak, SearchedProgramme, SearchField
from cpic_planner.validation.speckle_maps import SpeckleMaps
from simulator.imaging import AnyPsf, BandGeometry

MATCH_LAMBDA_D = 0.5
"""A detection this close to a planet's place is the planet."""

_CLEANED_SIGMA = 5.0  # sources that are taken out before others are looked for
_MAX_CLEANED = 10
_LEAST_SAMPLES = 3.0
MAX_VISITS = 10_000


@dataclass(frozen=True)
class Candidate:
    """One peak of the significance map.

    Attributes
    ----------
    x_arcsec, y_arcsec : float
        Place from the star on the detector, refined between pixels by parabolas; x grows with the column.
    x_pixel, y_pixel : float
        The same in pixels of the stamp.
    separation_arcsec : float
        Distance from the star.
    snr_mf : float
        Matched-filtered flux over its standard deviation, estimated from the residual without this source.
    significance : float
        Level of a standard normal variate that noise at this place reaches as rarely: heavy tails and the error of the
        estimated noise are in it.
    flux_e : float
        Electrons of the source on the clear disc (before mask, apodizer and aperture), from the unmasked image: low
        beside the mask.
    false_alarms : float
        Number of noise peaks that a search of this region expects at or above this one.
    detected : bool
        Whether ``snr_mf`` reaches ``threshold``.
    law : tuple of float
        Significance of a detection, and the law of noise here: `cpic_planner.etc.snr_at`.
    """

    x_arcsec: float
    y_arcsec: float
    x_pixel: float
    y_pixel: float
    separation_arcsec: float
    snr_mf: float
    significance: float
    flux_e: float
    false_alarms: float
    detected: bool
    law: tuple[float, float, float, float]

    @functools.cached_property
    def threshold(self) -> float:
        """The ``snr_mf`` that a detection needs here."""
        return float(snr_at(*self.law)[0])


@dataclass(frozen=True, eq=False)
class BlindSearch:
    """The findings of a search.

    Attributes
    ----------
    candidates : tuple of Candidate
        Peaks of 2.5 sigma and more, brightest first; empty where the threshold is undefined.
    threshold : Outcome of float
        Least `Candidate.significance` of a detection; ``unreachable`` in a region too small to know its noise.
    sigma : float
        Gaussian significance that was asked for.
    per_search : bool
        Whether it holds for the whole search instead of for each resolution element.
    region : SearchedRegion
        Positions that were searched.
    roughness : float
        Variance of the gradient of the significance map, per square pixel; 0 where undefined.
    white_level : float
        White noise found over predicted, in variance.
    drift_nm : float
        Wavefront offset of a visit that explains the speckles; 0 where the optics know no drift.
    dof : float
        Degrees of freedom of the variance, median over the region.
    sigma_e : ndarray, shape (n, n)
        Standard deviation of the flux of a source at every searched position, electrons on the clear disc; 0 elsewhere.
    snr_map : ndarray, shape (n, n)
        Flux over that; 0 elsewhere. Sources that were taken out are not in it.
    at_places : tuple of Candidate
        What the map shows at the places that were asked for: one trial each, whose threshold is ``sigma``.
    """

    candidates: tuple[Candidate, ...]
    threshold: Outcome[float]
    sigma: float
    per_search: bool
    region: SearchedRegion
    roughness: float
    white_level: float
    drift_nm: float
    dof: float
    sigma_e: FloatArray
    snr_map: FloatArray
    at_places: tuple[Candidate, ...] = ()

    @property
    def detections(self) -> tuple[Candidate, ...]:
        """Candidates above their threshold."""
        return tuple(candidate for candidate in self.candidates if candidate.detected)

    def near(self, x_arcsec: float, y_arcsec: float, reach_arcsec: float) -> list[Candidate]:
        """Return the candidates within reach of a place.

        Parameters
        ----------
        x_arcsec, y_arcsec : float
            Offsets from the star on the detector.
        reach_arcsec : float
        """
        return [
            one
            for one in self.candidates
            if math.hypot(one.x_arcsec - x_arcsec, one.y_arcsec - y_arcsec) <= reach_arcsec
        ]

    def strongest_near(self, x_arcsec: float, y_arcsec: float, geometry: BandGeometry) -> Candidate | None:
        """Return the strongest candidate that is as near to a place as a detection of a planet there; None without one.

        Parameters
        ----------
        x_arcsec, y_arcsec : float
            Offsets from the star on the detector.
        geometry : BandGeometry
        """
        near = self.near(x_arcsec, y_arcsec, MATCH_LAMBDA_D * geometry.lambda_d_arcsec)
        return max(near, key=lambda item: item.snr_mf, default=None)


@dataclass(frozen=True, eq=False)
class Searcher:
    """A search that is made ready for the noise of a stack, to look at one or more images; made by `searcher`.

    Attributes
    ----------
    field : SearchField
    sigma : float
        Gaussian significance of a detection.
    per_search : bool
        Whether it holds for the whole search.
    visit_nm : float
        Wavefront offset of a visit where its fitted number is 1; 0 where the optics know no drift.
    """

    field: SearchField
    sigma: float
    per_search: bool
    visit_nm: float

    def search(self, image_e: FloatArray, places_arcsec: Sequence[tuple[float, float]] = ()) -> BlindSearch:
        """Look for sources in an image.

        Parameters
        ----------
        image_e : ndarray, shape (n, n)
            Residual of the stack, or the same with planets that were put in: its noise is the stack's.
        places_arcsec : sequence of (x, y)
            Known places in the searched region that are judged one by one, the others taken out.
        """
        field, image = self.field.anew(), checked_image(image_e)
        if field.samples < _LEAST_SAMPLES:
            text = f"{field.samples:.3g} independent samples of noise: too few to know the noise"
            threshold: Outcome[float] = Outcome.refuse(Status.UNREACHABLE, Reason.TOO_FEW_ELEMENTS, text, unit="sigma")
            zero = np.zeros(image.shape)
            return BlindSearch(
                candidates=(),
                threshold=threshold,
                sigma=self.sigma,
                per_search=self.per_search,
                region=field.size,
                roughness=0.0,
                white_level=1.0,
                drift_nm=0.0,
                dof=0.0,
                sigma_e=zero,
                snr_map=zero,
            )
        peaks: list[Peak] = []
        while True:
            state = field.measure(image)
            level = search_threshold(field.size, state.roughness, sigma=self.sigma, per_search=self.per_search)
            found = field.peaks(state)
            clean = max(_CLEANED_SIGMA, level.unwrap())
            if not found or found[0].significance < clean or len(peaks) >= _MAX_CLEANED:
                break
            peaks.append(found[0])
            image = image - field.source(found[0])
            field.exclude(found[0].x_pixel, found[0].y_pixel)
        known = self._known(field, image, state, peaks, places_arcsec)
        peaks = field.with_final_noise(peaks, state)
        peaks += [peak for peak in found if peak.significance >= REPORTED_SIGMA]
        about = level.unwrap(), field.pairs, field.size, state.roughness
        candidates = [_candidate(peak, field.offset_arcsec(peak), *about) for peak in peaks]
        found_here = tuple(sorted(candidates, key=lambda one: -one.snr_mf))
        return BlindSearch(
            candidates=found_here,
            threshold=level,
            sigma=self.sigma,
            per_search=self.per_search,
            region=field.size,
            roughness=state.roughness,
            white_level=math.exp(state.fit.logs[0]),
            drift_nm=self.visit_nm * math.exp(0.5 * state.fit.logs[1]),
            dof=float(np.median(field.dof(state.fit))),
            sigma_e=field.unfold(state.sigma_e),
            snr_map=field.unfold(state.snr),
            at_places=known,
        )

    def _known(
        self,
        cleaned: SearchField,
        image: FloatArray,
        state: FilteredState,
        peaks: Sequence[Peak],
        places_arcsec: Sequence[tuple[float, float]],
    ) -> tuple[Candidate, ...]:
        """Return what stands at known places; peaks are out of field, image and state, lest wings count as noise."""
        found, size, roughness = [], cleaned.size, state.roughness
        for number, place in enumerate(places_arcsec):
            field, seen, (x, y) = cleaned.anew(), state, cleaned.pixel_of(*place)
            others = [*places_arcsec[:number], *places_arcsec[number + 1 :]]
            if others:
                for other in others:
                    field.exclude(*field.pixel_of(*other))
                seen = field.measure(image)
            # Noise moves a peak: what is not resolved from the place is its own, whichever pixel is the highest.
            near = (math.hypot(peak.x_pixel - x, peak.y_pixel - y) for peak in peaks)
            own = [peak for peak, apart in zip(peaks, near, strict=True) if apart <= field.lambda_d_pixels]
            here = field.at(seen, x, y, own)
            found.append(_candidate(here, field.offset_arcsec(here), self.sigma, field.pairs, size, roughness))
        return tuple(found)


def searcher(
    stack: ReducedStack,
    psf: AnyPsf,
    maps: SpeckleMaps,
    *,
    star_rate_e_s: float,
    sigma: float = 5.0,
    per_search: bool = False,
    known: Sequence[tuple[float, float]] = (),
    visits: int = 1,
    reference_visits: int = 1,
    common_fraction: float = 0.0,
    known_light_e_s: FloatArray | None = None,
) -> Searcher:
    """Return a search for sources everywhere in the dark hole, for an image of a stack or several.

    Parameters
    ----------
    stack : ReducedStack
    psf : Psf
        Its unmasked image is the template of a source.
    maps : SpeckleMaps
        Of this PSF, with the filter (`cpic_planner.validation.speckle_maps.speckle_maps`).
    star_rate_e_s : float
        Detected rate of the star on the clear pupil, above 0.
    sigma : float
        Gaussian significance, 2.5 to 20, that states the false-alarm probability. By default noise passes for a source
        with this probability in each resolution element of ``(lambda/D)^2``, as in `detection_threshold`.
    per_search : bool
        That probability for the whole search instead.
    known : sequence of (x_arcsec, y_arcsec)
        Sources that are neither reported nor allowed to count as noise.
    visits, reference_visits : int
        Visits that the science images of the stack, in their order, and all its references come from; each has a
        wavefront of its own. At least 1.
    common_fraction : float
        Believed rms, over that of a visit's offset, of the wavefront by which science and reference differ in every
        visit (`Drift.common_fraction`): it is fitted, from a prior around this number; 0 for none. 0 to 1.
    known_light_e_s : ndarray, shape (n, n), optional
        Light on the stamp that is no planet's nor the star's, such as the wings of another star; even by default.

    Raises
    ------
    InputError
        If an argument is out of range or a pixel is not finite.

    Notes
    -----
    The variance of a matched-filtered pixel is ``level white + drift linear + drift^2 square`` with the shapes of white
    noise, of ``2 Re(E0* dE)`` and of ``|dE|^2``; both factors are fitted to the residual, for each candidate without
    the disc of 1.22 lambda/D around it and, as far as speckles rule there, around its mirror image: pupil phases make
    pairs. V science and R reference visits leave (1/V + 1/R)/2 of the last two terms, and a part that all visits share;
    how the visits scatter around their mean, where no planet and nothing common is left, tells the noise V - 1 times
    over. The law of a position is Gaussian noise plus Laplace variates, one for each of `effective_visits` pairs, of
    the same kurtosis, over the error of the fit;
    as an equivalent Gaussian field it has the threshold of `search_threshold`. Up to ten sources beyond 5 sigma are
    subtracted, brightest first, before others are looked for. ``sep`` finds the peaks of the matched-filtered image.
    """
    check_positive("star_rate_e_s", star_rate_e_s, "e-/s")
    if not REPORTED_SIGMA <= sigma <= MAX_SIGMA:
        raise InputError("sigma", sigma, unit="sigma", allowed=f"{REPORTED_SIGMA:g} to {MAX_SIGMA:g}")
    for key, number in (("visits", visits), ("reference_visits", reference_visits)):
        check_whole(key, number, 1, MAX_VISITS)
    checked_scalar("common_fraction", common_fraction, low=0.0, high=1.0)
    image = checked_image(stack.image_e)
    if maps.linear.shape != image.shape:
        raise InputError("maps", maps.linear.shape, unit="px", allowed=f"maps of {image.shape}")
    programme = SearchedProgramme(visits, reference_visits, common_fraction)
    field = SearchField(stack, psf, maps, star_rate_e_s * stack.integration_s, known, programme, known_light_e_s)
    return Searcher(field, sigma, per_search, maps.visit_nm if maps.n_visits else 0.0)


def search(stack: ReducedStack, psf: AnyPsf, maps: SpeckleMaps, **how: Any) -> BlindSearch:
    """Look for sources everywhere in the dark hole of a stack; arguments as of `searcher`.

    Parameters
    ----------
    stack, psf, maps, how
        As of `searcher`.
    """
    return searcher(stack, psf, maps, **how).search(stack.image_e)


def _candidate(
    peak: Peak,
    offset_arcsec: tuple[float, float],
    level: float,
    pairs: float,
    region: SearchedRegion,
    roughness: float,
) -> Candidate:
    x_arcsec, y_arcsec = offset_arcsec
    return Candidate(
        x_arcsec=x_arcsec,
        y_arcsec=y_arcsec,
        x_pixel=peak.x_pixel,
        y_pixel=peak.y_pixel,
        separation_arcsec=math.hypot(x_arcsec, y_arcsec),
        snr_mf=peak.snr,
        significance=peak.significance,
        flux_e=peak.flux_e,
        false_alarms=float(false_alarms(max(peak.significance, 1.0), region, roughness)),
        detected=peak.significance >= level,
        law=(level, peak.laplace, peak.dof, pairs),
    )
