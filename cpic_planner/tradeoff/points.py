"""The ways to an answer that are measured on every fixed scene.

Planet flux and noise of a way to an answer, with common random numbers, so that few frames tell ways apart.
"""

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, cast

import numpy as np

from cpic_core import FloatArray, stream
from cpic_planner.results import TradeoffRow
from cpic_planner.tradeoff.chain import Drawn, NotApplicable, Places, aperture_flux_e, stamp_of
from cpic_planner.tradeoff.setup import REFERENCE_EPOCHS, SEED, FixedScene, Setup, reference_setup, visit
from cpic_planner.validation import calibrated_frames, pedestal_e
from simulator.camera import Frame, FrameNoise
from simulator.imaging import Psf, aperture_sums, centred_axis, single_band_psf, visit_frames
from simulator.knobs import FIDELITIES, Knobs
from simulator.ledger import MAX_EPOCHS, SUM_EPOCHS
from simulator.observing import Observation, hole_stacks

Group = Literal["closed_form", "images", "tier", "tolerance", "knob", "effect"]
REFERENCE = "reference"
TOLERANCES_MEASURED = (0.003, 0.01, 0.03, 0.1, 0.3)
QUICK_EPOCHS = 2


@dataclass(frozen=True)
class Point:
    """One way to an answer.

    Attributes
    ----------
    name, title : str
    group : str
        ``closed_form``: the exposure-time calculator; ``images``: images made in a stated way; ``tier`` and
        ``tolerance``: what the effect ledger chooses for a dial; ``knob`` and ``effect``: the reference with one thing
        changed.
    n_cases : int
        Questions that one call answers.
    fidelity, tolerance
        Of the dial.
    setup : Setup or None
        What is modelled, where the ledger does not decide it.
    light_changes : bool
        Whether the light on the detector differs from the reference's.
    """

    name: str
    title: str
    group: Group
    n_cases: int = 1
    fidelity: str | None = None
    tolerance: float | None = None
    setup: Setup | None = None
    light_changes: bool = True

    @property
    def shares_process(self) -> bool:
        """Whether it is measured beside others of its kind in one process."""
        return self.group in ("knob", "effect")


def points_of(case: FixedScene, *, main_only: bool = False) -> tuple[Point, ...]:
    """Return every way that is tried on a scene, those that it will refuse included.

    Parameters
    ----------
    case : FixedScene
    main_only : bool
        Leave out the reference with one thing changed.
    """
    if case.is_programme or main_only:
        return tuple(_main(case))
    return (*_main(case), *_knobs(case), *_effects(case))


_STATED: tuple[tuple[str, str, Literal["sums", "frames"], Literal["hole", "full"], int], ...] = (
    ("sums_quick", "sums of frames", "sums", "hole", QUICK_EPOCHS),
    ("sums_standard", "sums of frames", "sums", "hole", SUM_EPOCHS),
    ("hole_quick", "frames over the hole", "frames", "hole", QUICK_EPOCHS),
    ("hole_standard", "frames over the hole", "frames", "hole", MAX_EPOCHS),
    ("full_standard", "whole frames", "frames", "full", MAX_EPOCHS),
)
"""Images made in a stated way: name with the knobs, title, what is drawn, of which pixels, with how many wavefronts."""
_OF_PROGRAMMES = ("etc", "etc_many", "sums_quick", "hole_standard")


def _main(case: FixedScene) -> list[Point]:
    points = [Point("etc", "closed form, one call", "closed_form")]
    points.append(Point("etc_many", "closed form, per case of 10 000 in one call", "closed_form", n_cases=10_000))
    for name, title, draw, region, epochs in _STATED:
        knobs = name.partition("_")[2]
        setup = Setup(draw, region, FIDELITIES[knobs], epochs, scene_model=case.scene_model)
        points.append(Point(name, f"{title}, {knobs} knobs", "images", setup=setup))
    dials = [Point(name, f"--fidelity {name}", "tier", fidelity=name) for name in ("quick", "standard")]
    if case.is_programme:
        # Standard knobs tell a visit to 0.05 %, far below what any number of realisations tells of a programme.
        setup = Setup("sums", "hole", FIDELITIES["standard"], SUM_EPOCHS)
        best = Point(REFERENCE, "reference: sums of frames, standard knobs, most realisations", "tier", setup=setup)
        few = replace(setup, knobs=FIDELITIES["quick"], epochs=1)
        one = Point("sums_one", "sums of frames, quick knobs, one wavefront a visit", "images", setup=few)
        return [best, *(point for point in points if point.name in _OF_PROGRAMMES), one, *dials]
    setup = reference_setup(case)
    best = Point(REFERENCE, "reference: whole frames, all effects, finest knobs", "tier", setup=setup)
    levels = [(f"tolerance_{level:g}", level) for level in TOLERANCES_MEASURED]
    dials += [Point(name, f"--tolerance {level:g}", "tolerance", tolerance=level) for name, level in levels]
    return [best, *points, *dials]


def _knobs(case: FixedScene) -> list[Point]:
    best = reference_setup(case)

    def one(name: str, title: str, **changes: Any) -> Point:
        return Point(name, title, "knob", setup=replace(best, **changes))

    def one_of_optics(name: str, title: str, **knobs: Any) -> Point:
        return one(name, title, knobs=best.knobs.model_copy(update=knobs))

    epochs = [count for count in (1, 2, 4) if count < min(case.n_frames, REFERENCE_EPOCHS)]
    other = "exact" if case.scene_model == "paper" else "paper"
    return [
        *(one_of_optics(f"wavelengths_{n}", f"{n} wavelengths a band", wavelength_nodes=n) for n in (1, 2, 3, 4, 5)),
        *(one_of_optics(f"pixel_nodes_{n}", f"{n} x {n} nodes a pixel", pixel_nodes=n) for n in (1, 2, 3, 4)),
        one_of_optics("single", "single precision", precision="single"),
        *(one_of_optics(f"pupil_{n}", f"{n} samples across the pupil", pupil_samples=n) for n in (64, 128)),
        *(one(f"epochs_{n}", f"{n} wavefront{'s' * (n > 1)} a visit", epochs=n) for n in epochs),
        one("window", "window around the hole", region="hole"),
        one(f"{other}_scene", f"{other} scene model", scene_model=other),
    ]


def _effects(case: FixedScene) -> list[Point]:
    switches = case.instrument.detector_of(case.band).switches.model_dump()
    changes: dict[str, dict[str, Any]] = {name: {"switches": {name: False}} for name, on in switches.items() if on}
    changes |= {"sky": {"sky": False}, "drift": {"drift": False}}
    if case.scene.stars:
        changes["other_stars"] = {"left_out": tuple(star.name for star in case.scene.stars)}
    best, points = reference_setup(case), []
    for name, change in changes.items():
        words = "drift of the wavefront" if name == "drift" else name.replace("_", " ")
        setup, new = replace(best, **change), "switches" not in change
        points.append(Point(f"no_{name}", f"without {words}", "effect", setup=setup, light_changes=new))
    return points


def ratio_of_programmes(
    ours: Mapping[str, Sequence[float]],
    theirs: Mapping[str, Sequence[float]],
    what: Callable[..., float],
    *,
    paired: bool,
) -> tuple[float, float]:
    """Return the ratio of what two series of realisations say, and its error by leaving one out (jackknife).

    Parameters
    ----------
    ours, theirs : dict
        ``contrast`` and ``contrast_error``, one value a realisation.
    what : callable
        Of both: `flux_of_programme` or `snr_of_programme`.
    paired : bool
        Whether the random numbers are the same, realisation by realisation, and drop out of the ratio.
    """
    (whole, parts), (other, others) = (_left_out(series, what) for series in (ours, theirs))
    ratio = whole / other
    if paired and len(parts) == len(others):
        return ratio, _jackknife(parts / others)
    return ratio, ratio * math.hypot(_jackknife(parts) / whole, _jackknife(others) / other)


def flux_of_programme(contrast: FloatArray, contrast_error: FloatArray) -> float:
    """Return the mean contrast."""
    return float(contrast.mean())


def snr_of_programme(contrast: FloatArray, contrast_error: FloatArray) -> float:
    """Return the mean contrast over the quadratic mean of its errors (`cpic_planner.validation.mean_snr`)."""
    return float(contrast.mean() / np.sqrt((contrast_error**2).mean()))


def compared_programme(row: TradeoffRow, best: TradeoffRow) -> TradeoffRow:
    """Compare a row with the many realisations of the reference."""
    whats, names = (flux_of_programme, snr_of_programme), ("flux", "snr")
    if row.group == "closed_form":
        assert row.flux_e is not None
        variance = row.samples["whole_e2"][0]
        snr = row.flux_e / math.sqrt(variance)
        said = row.flux_e / (best.flux_e or math.nan), snr / snr_of_programme(*_series(best))
        own = [
            ratio_of_programmes(best.samples, best.samples, what, paired=False)[1] / math.sqrt(2.0) for what in whats
        ]
        ratios = [(value, value * error) for value, error in zip(said, own, strict=True)]
    else:
        snr = snr_of_programme(*_series(row))
        variance = ((row.flux_e or 0.0) / snr) ** 2
        paired = row.settings["draw"] == best.settings["draw"]
        ratios = [ratio_of_programmes(row.samples, best.samples, what, paired=paired) for what in whats]
    errors = {f"{name}_error": ratio - 1.0 for name, (ratio, _) in zip(names, ratios, strict=True)}
    errors |= {f"{name}_uncertainty": error for name, (_, error) in zip(names, ratios, strict=True)}
    return row.model_copy(update={"variance_e2": variance, "snr": snr, **errors})


def _series(row: TradeoffRow) -> FloatArray:
    return np.array([row.samples["contrast"], row.samples["contrast_error"]])


def _left_out(series: Mapping[str, Sequence[float]], what: Callable[..., float]) -> tuple[float, FloatArray]:
    values = np.array([series["contrast"], series["contrast_error"]])
    return what(*values), np.array([what(*np.delete(values, k, axis=1)) for k in range(values.shape[1])])


def _jackknife(parts: FloatArray) -> float:
    n = len(parts)
    return float(np.sqrt((n - 1) / n * np.sum((parts - parts.mean()) ** 2)))


_LEAST_COVERED = 0.4


class _Noiseless(Observation):
    """An observation whose one frame is the expectation."""

    def frame(self, index: int) -> Frame:
        return Frame(adu=cast(Any, self.expected), mask=np.zeros(self.shape, dtype=np.uint8))


def expected_flux_e(case: FixedScene, setup: Setup, shown: Observation, bare_e_s: FloatArray) -> float:
    """Return the planet's aperture in the expected visit: with the planet minus without it, no noise.

    Frames are calibrated as noisy ones are; the expectation of sums is divided by the gain alone.

    Parameters
    ----------
    case : FixedScene
    setup : Setup
    shown : Observation
        Science visit.
    bare_e_s : ndarray
        What `light_without` makes.
    """
    bare = replace(shown, light=replace(shown.light, static_e_s=bare_e_s))
    return case.n_frames * aperture_flux_e(shown, _calibrated(shown, setup) - _calibrated(bare, setup))


def light_without(case: FixedScene, setup: Setup) -> FloatArray:
    """Return the electrons per second of everything but the central star and the planets."""
    return visit(case, setup, planets=False, n_frames=1, epochs=1).light.static_e_s


def _calibrated(shown: Observation, setup: Setup) -> FloatArray:
    if setup.draw == "frames":
        values = {item.name: getattr(shown, item.name) for item in dataclasses.fields(shown) if item.init}
        return np.asarray(calibrated_frames(_Noiseless(**values | {"n_frames": 1}), cropped=True).electrons[0])
    gain = shown.instrument.channel(shown.camera).detector.gain_e_adu
    return shown.expected[stamp_of(shown)] * (gain / shown.em_gain)


def white_of_frames(places: Places, drawn: Sequence[Drawn]) -> FloatArray:
    """Return aperture sums' variance from frame to frame at the planet's place, one value a frame, e-^2 of one.

    Every aperture of the hole counts, scaled to the planet's place as closed forms expect (`Places.level`).

    Frames that lose a pixel count for less: a pixel that was seen in the fraction ``c`` of the frames has ``1 / c``
    times the variance in their filled mean.
    """
    weights, samples = places.weights, []
    for part in drawn:
        n = len(part.electrons)
        covered = part.usable.mean(axis=0)
        kept = aperture_sums(covered, weights) / weights.sum()
        chosen = places.white & (kept > _LEAST_COVERED)
        if not chosen.any():
            raise NotApplicable("a limit or particles void every aperture of the hole")
        left = np.where(part.usable, part.electrons - part.electrons.mean(axis=0), 0.0) * (n / (n - 1.0)) ** 0.5
        squares = aperture_sums(left, weights)[:, chosen] ** 2 * (places.level[chosen] / kept[chosen] ** 2)
        samples.append(squares.mean(axis=1))
    return np.concatenate(samples)


def white_of_sums(case: FixedScene, setup: Setup, places: Places, n_draws: int) -> FloatArray:
    """Return the same from sums of frames, one value a draw: draws less what they are expected to be.

    Parameters
    ----------
    case : FixedScene
    setup : Setup
    places : Places
    n_draws : int
        Draws of each planet.
    """
    observed = visit(case, setup)
    stacks = hole_stacks(observed, epochs=1)
    dark_e = pedestal_e(observed.instrument.detector_of(case.band), case.exposure_s)
    samples = []
    for number in range(n_draws):
        mean = (stacks.mean_rates(number)[0] * case.exposure_s + dark_e) * case.n_frames
        left = np.where(stacks.region, stacks.draw(number)[0] - mean, 0.0)
        squares = aperture_sums(left, places.weights) ** 2 * places.level
        samples.append(squares[places.white].mean() / case.n_frames)
    return np.array(samples)


def own_noise_e2(case: FixedScene, setup: Setup, places: Places, flux_e: float) -> float:
    """Return the variance that the planet's own light adds to its aperture in the visit, e-^2."""
    noise = FrameNoise.of(setup.instrument(case).detector_of(case.band), case.em_gain, case.exposure_s)
    return noise.factor2 * noise.photons * places.source_noise_fraction * flux_e


def speckle_samples(case: FixedScene, setup: Setup, places: Places, n_pairs: int) -> FloatArray:
    """Return the variance of aperture sums that subtracting the references leaves, one value a pair, (e-/s)^2.

    Both visits have one wavefront; `walk_samples` tells what more of them change.
    """
    return _residuals(case, setup, places, setup.knobs, 1, n_pairs)


def walk_samples(case: FixedScene, setup: Setup, places: Places, n_pairs: int) -> tuple[FloatArray, FloatArray]:
    """Return the same at the cheapest knobs: at the way's epochs, and at one epoch with the same offsets."""
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
    samples = []
    for number in range(n_pairs):
        means = []
        for role in ("science", "reference"):
            path = (scene.name, "SCI", role, case.band, number)
            streams = (stream(SEED, *path, part) for part in ("visit", "walk"))
            means.append(visit_frames(grid, instrument.drift, epochs, cadence_s, *streams).mean(axis=0))
        left = np.zeros(annulus.shape)
        left[np.ix_(rows, columns)] = means[0] - means[1]
        sums = aperture_sums(left, weights)[places.near] - left[annulus].mean() * weights.sum()
        samples.append((sums**2).mean())
    return np.array(samples) * places.star_e_s**2
