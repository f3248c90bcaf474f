"""Does one choice that the paper does not state make our signal-to-noise ratios those of its Table 1?

The paper's Eqs. 3 and 4, written out for the four bands at once, with everything that they hang on as an argument; at
the numbers of the preset they are the calculator's `snr_paper`. Each choice is varied alone, then with each other one.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cpic_planner.etc import aperture_rates, build_model
from cpic_planner.etc.noise import ONE_VISIT, SPECKLE_COHERENCE, residual_law
from cpic_planner.validation import aperture_weights
from reports.external.comparison import recorded
from reports.paper.paper_table1.measure import (
    instrument,
    model,
    science_scene,
    sequences,
    table_case,
    target,
    true_contrast,
)
from simulator import single_band_psf
from simulator.detectors import clean_fraction, noise_factor2
from simulator.target import scene_sources

FloatArray = NDArray[np.float64]
TABLE = recorded("paper")["table1"]
BANDS = tuple(TABLE)
CONTRAST, SNR, EXPOSURE_S, FRAMES = (
    np.array([float(row[name]) for row in TABLE.values()]) for name in ("contrast", "snr", "exposure_s", "frames")
)
STAR_MAG = 1.35
AGREES = 0.05  # of the SNR; the scatter that Eq. 4 takes from some hundred pixels is uncertain by as much
RADII_PX, SIDES_PX = np.geomspace(0.3, 30.0, 60), np.arange(1.0, 42.0, 2.0)
DRIFTS_NM = np.geomspace(0.003, 10.0, 12)
N_VALUES, N_PAIR, ZOOMS = 1001, 41, 4
AS_PRESET, OWN_CONTRASTS = "as in the preset", "our contrasts instead of those of Table 1"
MEAN_FRAME = "counts of the mean frame in Eq. 4"
WIDE, READ_NOISE = "wide aperture, same λ/D", "read noise, or any at the output"


@dataclass(frozen=True)
class Light:
    """What the model gives of the four bands, an array each; lengths in px, light per electron of the star."""

    star_e_s: FloatArray
    halo: FloatArray
    errors: FloatArray
    sky_e_s: FloatArray
    smear_s: FloatArray
    loss_per_s: FloatArray
    speckle2: FloatArray
    in_circle: FloatArray
    in_square: FloatArray
    lambda_d_px: FloatArray
    annulus_px: FloatArray


@dataclass(frozen=True)
class Choices:
    """What the ratios hang on; numbers or arrays whose last axis is the band.

    ``square_px`` is the side of a square that takes the place of the circle; ``core`` and ``halo`` are parts of the
    planet's and the star's light over ours; ``references`` star-only frames per science frame; ``speckle_share`` the
    rms of what a subtraction leaves over the star's light; ``left`` the part of the planet that it leaves;
    ``own_noise`` the variance of the planet's own electrons over their number; ``correlation`` the variance of sums
    over pixels over that of as many pixels of their own; ``calibrator_mag`` V of the star to which the planet is
    measured, whose error Eq. 4 gives too; ``in_adu`` leaves the scatter of the background in units of the converter.
    """

    aperture_px: Any
    background_px: Any
    read_noise_e: Any
    em_gain: Any
    cic_e: Any
    dark_e_s: Any
    sky_mag: Any
    t_opt: Any
    width_nm: Any
    drift_nm: Any
    contrast: Any
    frames: Any
    exposure_s: Any
    square_px: Any = None
    core: Any = 1.0
    halo: Any = 1.0
    references: Any = 1.0
    speckle_share: Any = 0.0
    left: Any = 1.0
    own_noise: Any = 1.0
    correlation: Any = 1.0
    calibrator_mag: Any = None
    in_adu: bool = False


def _light_of(band: str, contrast: float) -> dict[str, Any]:
    """Light of a band: around the planet, what drifts leave of the star, and a planet's in circles and squares."""
    case = next(one for one in map(table_case, sequences()) if one.band == band)
    _, planet, *_ = scene_sources(science_scene("off"), instrument(), band)
    place = [np.array([[value]]) for value in (planet.x_arcsec, planet.y_arcsec, contrast)]
    rates = aperture_rates(model(), target("off"), band, *place)
    area, core = rates.aperture_pixels, float(np.ravel(rates.core)[0])
    star = float(np.ravel(rates.planet_e_s)[0]) / core / contrast
    still = rates.halo_e_s - rates.errors_e_s
    per_pixel = {"halo": still / star, "errors": rates.errors_e_s / star}
    per_pixel |= {"sky_e_s": rates.sky_e_s, "smear_s": rates.smear_e / star}
    visit_s, left = case.n_frames * (case.exposure_s + model().camera(band).readout_s), []
    for drift in DRIFTS_NM:
        drifting = build_model(instrument().changed({"drift": {"visit_nm": float(drift)}}))
        law = residual_law(aperture_rates(drifting, target("off"), band, *place), ONE_VISIT)
        left.append(float(np.ravel(law.variance(visit_s))[0]) / (area**2 * SPECKLE_COHERENCE * star**2))
    psf = single_band_psf(band, instrument=instrument())
    image, middle = psf.off_axis, len(psf.off_axis) // 2
    offset = np.abs(np.arange(len(image)) - middle)
    circles = [(image * aperture_weights(image.shape, middle, middle, radius)).sum() for radius in RADII_PX]
    lambda_d_px = instrument().lambda_d_arcsec(band) / psf.pixel_scale_arcsec
    radius = instrument().coronagraph.aperture_radius_lambda_d * lambda_d_px
    exact = core / (image * aperture_weights(image.shape, middle, middle, radius)).sum()  # mean over places in a pixel
    inside = [offset <= side / 2 for side in SIDES_PX]
    return {name: float(np.ravel(value)[0]) / area for name, value in per_pixel.items()} | {
        "star_e_s": star,
        "loss_per_s": rates.loss_per_s,
        "speckle2": left,
        "in_circle": exact * np.array(circles),
        "in_square": exact * np.array([image[np.ix_(part, part)].sum() for part in inside]),
        "lambda_d_px": lambda_d_px,
        "annulus_px": float(np.ravel(rates.background_apertures)[0]) * area,
    }


@functools.cache
def light() -> Light:
    """Light of the four bands."""
    found = [_light_of(band, contrast) for band, contrast in zip(BANDS, CONTRAST, strict=True)]
    return Light(**{name: np.array([one[name] for one in found]) for name in found[0]})


@functools.cache
def preset() -> Choices:
    """The numbers of the instrument preset and of its sequences."""
    config, camera = instrument(), model().camera(BANDS[0])
    return Choices(
        aperture_px=config.coronagraph.aperture_radius_lambda_d * light().lambda_d_px,
        background_px=light().annulus_px,
        read_noise_e=camera.read_noise_e,
        em_gain=table_case(sequences()[0]).em_gain,
        cic_e=camera.cic_e,
        dark_e_s=camera.dark_e_s,
        sky_mag=config.sky.brightness_v_mag_arcsec2,
        t_opt=config.band(BANDS[0]).t_opt,
        width_nm=np.array([config.band(band).width_nm for band in BANDS]),
        drift_nm=config.drift.visit_nm,
        contrast=CONTRAST,
        frames=FRAMES,
        exposure_s=EXPOSURE_S,
    )


def _between(grid: FloatArray, values: FloatArray, at: Any) -> FloatArray:
    """Values of each band at points of a grid, by straight lines between logarithms."""
    points = np.broadcast_to(at, np.broadcast_shapes(np.shape(at), (len(BANDS),)))
    found = [np.interp(np.log(points[..., k]), np.log(grid), np.log(values[k])) for k in range(len(BANDS))]
    return np.exp(np.stack(found, axis=-1))


def snr(chosen: Choices) -> FloatArray:
    """The ratios of Eqs. 3 and 4, the last axis by band."""
    one, base = light(), preset()
    camera = model().camera(BANDS[0])
    passed = np.asarray(chosen.t_opt / base.t_opt * chosen.width_nm / base.width_nm)
    star, kept = one.star_e_s * passed, chosen.frames * clean_fraction(one.loss_per_s, chosen.exposure_s)
    if chosen.square_px is None:
        area, core = np.pi * chosen.aperture_px**2, _between(RADII_PX, one.in_circle, chosen.aperture_px)
    else:
        area, core = np.square(chosen.square_px), _between(SIDES_PX, one.in_square, chosen.square_px)
    sky = one.sky_e_s * passed * 10.0 ** (-0.4 * (chosen.sky_mag - base.sky_mag))
    scattered = one.errors * np.square(np.asarray(chosen.drift_nm) / base.drift_nm)
    charge = (star * (one.halo * chosen.halo + scattered) + sky + chosen.dark_e_s) * chosen.exposure_s
    charge = charge + star * one.smear_s + chosen.cic_e
    read = (np.square(chosen.read_noise_e) + camera.rounding_e**2) / np.square(chosen.em_gain)
    excess2 = noise_factor2(np.asarray(chosen.em_gain, float), camera.register_stages)
    white = kept * (1.0 + 1.0 / chosen.references) * (excess2 * charge + read)
    residual = _between(DRIFTS_NM, one.speckle2, chosen.drift_nm)
    residual = residual + np.square(one.halo * chosen.halo * chosen.speckle_share)
    scatter2 = (white + np.square(kept * chosen.exposure_s * star) * residual) * chosen.correlation
    if chosen.in_adu:
        scatter2 = scatter2 * np.square(chosen.em_gain / instrument().detector.gain_e_adu)
    error2 = scatter2 * area * (1.0 + area / chosen.background_px)

    def ratio(rate: Any) -> FloatArray:
        signal = rate * kept * chosen.exposure_s * core * chosen.core * chosen.left
        return np.asarray(signal / np.sqrt(chosen.own_noise * signal + error2))

    planet = ratio(star * chosen.contrast)
    if chosen.calibrator_mag is None:
        return planet
    calibrator = ratio(star * 10.0 ** (-0.4 * (chosen.calibrator_mag - STAR_MAG)))
    return np.asarray(1.0 / np.hypot(1.0 / planet, 1.0 / calibrator))


@dataclass(frozen=True)
class Choice:
    """A number that the paper does not state.

    Attributes
    ----------
    name, unit : str
    fields : callable
        What of `Choices` a value changes.
    searched, held : tuple of float
        Values that are tried, and those that are held possible; the same one twice where the paper states it.
    magnitude : bool
        Whether its values are magnitudes, which are evenly spaced.
    """

    name: str
    unit: str
    fields: Callable[[Any], dict[str, Any]]
    searched: tuple[float, float]
    held: tuple[float, float]
    magnitude: bool = False

    def values(self, low: float, high: float, number: int) -> FloatArray:
        return np.linspace(low, high, number) if self.magnitude else np.geomspace(low, high, number)


# Name, unit, field of `Choices`, values that are searched and held possible; magnitudes at the end.
PLAIN: tuple[tuple[str, str, str, tuple[float, float], tuple[float, float]], ...] = (
    # A radius that is "appropriate"; 1: the peak pixel; the background is a square in a quadrant at most.
    ("small aperture, same pixels", "px", "aperture_px", (0.35, 3.0), (1.0, 3.0)),
    ("wide aperture, same pixels", "px", "aperture_px", (3.0, 25.0), (3.0, 15.0)),
    ("side of a square aperture", "px", "square_px", (1.0, 41.0), (1.0, 21.0)),
    ("background area", "px", "background_px", (1.0, 1e5), (50.0, 1200.0)),
    # Data sheet of such a detector, at -40 °C at most; gains of 1, 20 and 300 are in the figures.
    (READ_NOISE, "e-", "read_noise_e", (1.0, 1e4), (43.0, 200.0)),
    ("EM gain", "", "em_gain", (1.0, 1000.0), (1.0, 1000.0)),
    ("clock-induced charge", "e-/px", "cic_e", (1e-3, 1e4), (2e-3, 0.2)),
    ("dark current", "e-/s/px", "dark_e_s", (1e-5, 1e4), (1e-5, 0.055)),
    # What the elements can have; widths of 1 to 20 %.
    ("throughput of the optics", "", "t_opt", (1e-3, 1.0), (0.02, 0.46)),
    ("one width for all bands", "nm", "width_nm", (1.0, 300.0), (5.0, 100.0)),
    # Other apodizers; 1e-8 in the hole at most; a "library"; no drift is mentioned; all that is left at most.
    ("light in the core (Strehl, jitter)", "of ours", "core", (0.01, 3.0), (0.3, 2.0)),
    ("starlight in the hole", "of ours", "halo", (0.01, 1e5), (0.5, 20.0)),
    ("star-only frames", "per frame", "references", (1e-3, 1e3), (1 / 30, 100.0)),
    ("drift between the sets", "nm", "drift_nm", (3e-3, 10.0), (3e-3, 1.0)),
    ("starlight that is left", "of all", "speckle_share", (1e-3, 100.0), (1e-3, 1.0)),
    # 30 modes take 7 % at most; excess noise; the size of the PSF; the number of frames is stated.
    ("planet that the SVD leaves", "", "left", (0.05, 1.0), (0.9, 1.0)),
    ("variance of the planet's electrons", "", "own_noise", (1.0, 1e4), (1.0, 2.0)),
    ("variance of sums over that of pixels", "", "correlation", (0.1, 100.0), (1.0, 13.0)),
    ("frames added up", "", "frames", (1.0, 300.0), (30.0, 30.0)),
    # "Usually" 21; the calibration star is seen in a figure.
    ("sky and stray light", "mag/arcsec²", "sky_mag", (5.0, 23.0), (19.0, 22.0)),
    ("V of the calibration star, its error added", "mag", "calibrator_mag", (10.0, 25.0), (12.0, 21.0)),
)


def choices() -> list[Choice]:
    """Every choice that has a number."""
    now, one, config = preset(), light(), instrument()
    centers = np.array([config.band(band).center_nm for band in BANDS])

    def radius(value: Any) -> dict[str, Any]:
        return {"aperture_px": value * one.lambda_d_px}

    def width(band: str) -> Choice:
        mine = np.array([name == band for name in BANDS])
        fields = {"fields": lambda value: {"width_nm": np.where(mine, value, now.width_nm)}}
        return Choice(f"width of {band}", "nm", **fields, searched=(1, 300), held=(5, 100))

    def relative(value: Any) -> dict[str, Any]:
        return {"width_nm": value * centers}

    def plain(name: str, unit: str, field: str, *spans: tuple[float, float]) -> Choice:
        return Choice(name, unit, lambda value: {field: value}, *spans, magnitude=field.endswith("_mag"))

    about = "contrast (radius, phase, albedo, distance)"
    return [
        Choice("small aperture, same λ/D", "λ/D", radius, (0.1, 0.7), (0.35, 0.7)),
        Choice(WIDE, "λ/D", radius, (0.7, 5.0), (0.7, 3.0)),
        *(plain(*line) for line in PLAIN),
        Choice("one relative width for all bands", "", relative, (1e-3, 0.5), (0.01, 0.2)),
        *map(width, BANDS),
        # The contrast is stated.
        Choice(about, "of Table 1", lambda value: {"contrast": value * CONTRAST}, (0.1, 1.5), (1.0, 1.0)),
    ]


def variants() -> dict[str, dict[str, Any]]:
    """Other readings of the text, which have no number."""
    return {
        AS_PRESET: {},
        OWN_CONTRASTS: {"contrast": np.array([true_contrast(band) for band in BANDS])},
        "17 x 30 s are 17 frames of 30 s": {"frames": EXPOSURE_S, "exposure_s": FRAMES},
        "17 x 30 s are 30 frames of 17/30 s": {"exposure_s": EXPOSURE_S / FRAMES},
        "the ratio is that of one frame": {"frames": 1.0},
        MEAN_FRAME: {"own_noise": FRAMES},
        "scatter left in ADU in Eq. 4": {"in_adu": True},
        "excess noise in Eq. 4": {"own_noise": float(noise_factor2(preset().em_gain, 604))},
        "star-only frames without noise": {"references": 1e9},
        "peak pixel": {"square_px": 1.0},
    }


@dataclass(frozen=True)
class Found:
    """The best that choices do: their values, and our ratios over those of Table 1."""

    names: tuple[str, ...]
    values: tuple[float, ...]
    over: FloatArray

    @property
    def worst(self) -> float:
        """Largest factor less 1 by which a row is off."""
        return float(np.expm1(np.abs(np.log(self.over)).max()))


def _over(fields: dict[str, Any]) -> FloatArray:
    return snr(dataclasses.replace(preset(), **fields)) / SNR


def of_variant(name: str) -> Found:
    """What another reading gives."""
    return Found((name,), (), _over(variants()[name]))


def needed(choice: Choice, fields: dict[str, Any]) -> FloatArray:
    """Value of a choice that each row asks for; nan where none of those searched does."""
    values = choice.values(*choice.searched, N_VALUES)
    log = np.log(_over(fields | choice.fields(values[:, None])))
    found = np.full(len(BANDS), np.nan)
    for k, row in enumerate(log.T):
        at = np.flatnonzero(np.diff(np.sign(row)))
        if len(at):
            part = row[at[0]] / (row[at[0]] - row[at[0] + 1])
            found[k] = values[at[0]] + part * (values[at[0] + 1] - values[at[0]])
    return found


def best(chosen: Iterable[Choice], fields: dict[str, Any], *, held: bool, names: tuple[str, ...] = ()) -> Found:
    """Common values of choices with the least largest difference from Table 1, by grids that close in."""
    many = tuple(chosen)
    spans = [one.held if held else one.searched for one in many]
    number = N_VALUES if len(many) == 1 else N_PAIR
    for _ in range(ZOOMS):
        grids = [one.values(*span, number) for one, span in zip(many, spans, strict=True)]
        changed: dict[str, Any] = dict(fields)
        for one, part in zip(many, np.meshgrid(*grids, indexing="ij"), strict=True):
            changed |= one.fields(part[..., None])
        over = _over(changed)
        at = np.unravel_index(np.abs(np.log(over)).max(axis=-1).argmin(), over.shape[:-1])
        spans = [(grid[max(k - 3, 0)], grid[min(k + 3, number - 1)]) for grid, k in zip(grids, at, strict=True)]
    values = tuple(float(grid[k]) for grid, k in zip(grids, at, strict=True))
    return Found((*names, *(one.name for one in many)), values, over[at])


def _changes(fields: dict[str, Any]) -> set[str]:
    """What choices change, for those that exclude each other: a square takes the place of a circle."""
    return {"aperture_px" if name == "square_px" else name for name in fields}


def pairs(always: dict[str, Any], *, held: bool) -> list[Found]:
    """Every two choices, and every reading with every choice; the best first.

    What stands in ``always`` is changed in all of them. Values are those held possible, or all that are searched.
    """
    free = [(one, _changes(one.fields(1.0))) for one in choices() if not held or one.held[0] < one.held[1]]
    found = [
        best((one, other), always, held=held)
        for (one, mine), (other, its) in itertools.combinations(free, 2)
        if not mine & its
    ]
    for name, fields in variants().items():
        if name not in (AS_PRESET, OWN_CONTRASTS):
            others, base = _changes(fields), always | fields
            found += [best((one,), base, held=held, names=(name,)) for one, mine in free if not mine & others]
    return sorted(found, key=lambda one: one.worst)
