"""Planet flux and noise of a way to an answer, with common random numbers, so that few frames tell ways apart."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from cpic_planner.tradeoff.chain import Drawn, NotApplicable, aperture_flux_e
from cpic_planner.tradeoff.places import Places
from cpic_planner.tradeoff.scenes import FixedScene
from cpic_planner.tradeoff.setup import SEED, Setup, visit
from cpic_planner.validation.frames import calibrated_frames
from cpic_planner.validation.reduced import pedestal_e
from simulator.camera.frame import Frame
from simulator.camera.noise import FrameNoise
from simulator.hole_stack import hole_stacks
from simulator.imaging.aperture import aperture_sums
from simulator.imaging.drift import visit_frames
from simulator.imaging.imager import centred_axis
from simulator.imaging.psf import Psf, single_band_psf
from simulator.knobs import FIDELITIES, Knobs
from simulator.observation import Observation
from simulator.rng import stream

FloatArray = NDArray[np.float64]
_LEAST_COVERED = 0.4


class _Noiseless(Observation):
    """An observation whose one frame is the expectation."""

    def iter_full_frames(self) -> Iterator[Frame]:
        yield Frame(adu=cast(Any, self.expected), mask=np.zeros(self.shape, dtype=np.uint8))


def expected_flux_e(case: FixedScene, setup: Setup, shown: Observation, bare_e_s: FloatArray) -> float:
    """Planet's aperture in the expected visit: with the planet minus without it, no noise.

    Frames of the visible camera are calibrated as noisy ones are; the expectation of sums and of the infrared camera is
    divided by the gain alone.

    Parameters
    ----------
    case : FixedScene
    setup : Setup
    shown : Observation
        Science visit.
    bare_e_s : ndarray
        What `light_without` makes.
    """
    bare = dataclasses.replace(shown, light=dataclasses.replace(shown.light, static_e_s=bare_e_s))
    return case.n_frames * aperture_flux_e(shown, _calibrated(shown, setup) - _calibrated(bare, setup))


def light_without(case: FixedScene, setup: Setup) -> FloatArray:
    """Electrons per second of everything but the central star and the planets.

    Parameters
    ----------
    case : FixedScene
    setup : Setup
    """
    return visit(case, setup, planets=False, n_frames=1, epochs=1).light.static_e_s


def _calibrated(seen: Observation, setup: Setup) -> FloatArray:
    if setup.draw == "frames" and seen.camera == "VIS":
        values = {item.name: getattr(seen, item.name) for item in dataclasses.fields(seen) if item.init}
        result: FloatArray = calibrated_frames(_Noiseless(**values | {"n_frames": 1}), cropped=True).electrons[0]
        return result
    rows, columns, _ = seen.area.stamp(seen.psf.on_axis.shape[0])
    visible = seen.camera == "VIS"
    gain = seen.instrument.detector.gain_e_adu if visible else seen.instrument.near_infrared.detector.gain_e_adu
    return seen.expected[rows, columns] * (gain / seen.em_gain)


def white_of_frames(places: Places, drawn: Sequence[Drawn]) -> FloatArray:
    """Variance of aperture sums from frame to frame at the planet's place, one value a frame, e-^2 of one frame.

    Every aperture of the hole counts, scaled to the planet's place as closed forms expect (`Places.level`).

    Frames that lose a pixel count for less: a pixel that was seen in the fraction ``c`` of the frames has ``1 / c``
    times the variance in their filled mean.

    Parameters
    ----------
    places : Places
    drawn : sequence of Drawn
    """
    weights, found = places.weights, []
    for part in drawn:
        n = len(part.electrons)
        covered = part.usable.mean(axis=0)
        kept = aperture_sums(covered, weights) / weights.sum()
        chosen = places.white & (kept > _LEAST_COVERED)
        if not chosen.any():
            raise NotApplicable("a limit or particles void every aperture of the hole")
        left = np.where(part.usable, part.electrons - part.electrons.mean(axis=0), 0.0) * (n / (n - 1.0)) ** 0.5
        squares = aperture_sums(left, weights)[:, chosen] ** 2 * (places.level[chosen] / kept[chosen] ** 2)
        found.append(squares.mean(axis=1))
    return np.concatenate(found)


def white_of_sums(case: FixedScene, setup: Setup, places: Places, n_draws: int) -> FloatArray:
    """The same from sums of frames, one value a draw: draws less what they are expected to be.

    Parameters
    ----------
    case : FixedScene
    setup : Setup
    places : Places
    n_draws : int
        Draws of each planet.
    """
    seen = visit(case, setup)
    stacks = hole_stacks(seen, epochs=1)
    dark_e = pedestal_e(seen.instrument.detector, case.exposure_s)
    found = []
    for number in range(n_draws):
        mean = (stacks.mean_rates(number)[0] * case.exposure_s + dark_e) * case.n_frames
        left = np.where(stacks.region, stacks.draw(number)[0] - mean, 0.0)
        squares = aperture_sums(left, places.weights) ** 2 * places.level
        found.append(squares[places.white].mean() / case.n_frames)
    return np.array(found)


def own_noise_e2(case: FixedScene, setup: Setup, places: Places, flux_e: float) -> float:
    """Variance that the planet's own light adds to its aperture in the visit, e-^2."""
    noise = FrameNoise.of(setup.instrument(case).detector_of(case.band), case.em_gain, case.exposure_s)
    return noise.factor2 * noise.photons * places.source_noise_fraction * flux_e


def speckle_samples(case: FixedScene, setup: Setup, places: Places, n_pairs: int) -> FloatArray:
    """Variance of aperture sums that subtraction of the reference visit leaves, one value a pair, (e-/s)^2; no noise.

    Both visits have one wavefront; `walk_samples` tells what more of them change.
    """
    return _residuals(case, setup, places, setup.knobs, 1, n_pairs)


def walk_samples(case: FixedScene, setup: Setup, places: Places, n_pairs: int) -> tuple[FloatArray, FloatArray]:
    """The same at the cheapest knobs: at the way's epochs, and at one epoch with the same offsets."""
    cheap, count = FIDELITIES["quick"], setup.n_epochs(case)
    one = _residuals(case, setup, places, cheap, 1, n_pairs)
    return (one if count == 1 else _residuals(case, setup, places, cheap, count, n_pairs)), one


def _residuals(case: FixedScene, setup: Setup, places: Places, knobs: Knobs, epochs: int, n_pairs: int) -> FloatArray:
    instrument, scene = setup.instrument(case), setup.scene(case)
    if instrument.drift.visit_nm == 0 and instrument.drift.walk_nm_per_sqrt_hour == 0:
        return np.zeros(n_pairs)
    annulus, weights = places.annulus, places.weights
    psf: Psf = single_band_psf(case.band, fidelity=knobs, instrument=instrument)
    rows, columns = (np.flatnonzero(annulus.any(axis=axis)) for axis in (1, 0))
    offset = centred_axis(len(annulus), psf.imager.pixel_scale_arcsec)
    grid = psf.imager.focal_grid(*(psf.imager.axis(offset[part], masked=True) for part in (rows, columns)))
    cadence_s = (case.exposure_s + instrument.detector_of(case.band).readout_s) * case.n_frames / epochs
    found = []
    for number in range(n_pairs):
        means = [
            visit_frames(
                grid,
                instrument.drift,
                epochs,
                cadence_s,
                *(stream(SEED, scene.name, "SCI", role, case.band, number, part) for part in ("visit", "walk")),
            ).mean(axis=0)
            for role in ("science", "reference")
        ]
        left = np.zeros(annulus.shape)
        left[np.ix_(rows, columns)] = means[0] - means[1]
        sums = aperture_sums(left, weights)[places.near] - left[annulus].mean() * weights.sum()
        found.append((sums**2).mean())
    return np.array(found) * places.star_e_s**2
