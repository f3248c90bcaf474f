"""Answers from realisations: what was recovered, whether the planet is confirmed, and the ETC's standing.

Predictions and measurements are compared over bands, targets and plans; positions and albedos of planets are theirs.
"""

import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np

from cpic_core import ArrayLike, FloatArray, InputError, Reason, Record, Status
from cpic_planner.queries import Strategy
from cpic_planner.results import AlbedoRecord, AuditRecord, BandConfirmation, ObservationRow, PositionRecord
from cpic_planner.validation.albedo_fit import AlbedoFit, AlbedoModel, fit_albedo, planet_albedo_model
from cpic_planner.validation.astrometry import Astrometry
from cpic_planner.validation.measure import Measurement, obstacle, planet_places
from cpic_planner.validation.realise import FrameStatistics
from cpic_planner.validation.star_flux import StarFlux
from cpic_planner.validation.task import ConfirmTask, Modelling, library_plan, modelling_of, not_observed
from simulator.config import Instrument, Scene, place, validate
from simulator.imaging import BandGeometry
from simulator.passbands import Passbands
from simulator.target import LitPlanet, spectrum_generator

PREDICTION_ERROR = 0.05
"""Relative accuracy of a predicted SNR at one place: the residual speckles of one instrument are a few per cent
brighter or fainter around a planet than the mean of the hole at its separation. The 20 cases of the report
blind_validator differ by 2.7 % rms and by 5 % at most."""
MIN_JACKKNIFE = 8
MIN_SNR = 3.0
"""A recovered SNR below this many of its errors says that the planet is missed, not by which factor."""
MOST_ERROR = 1.0 / (MIN_SNR + 2.0)
"""Largest error, in units of the predicted SNR, of a recovered SNR that tells about the ETC. Measurements are chosen by
their errors, since a choice by what was recovered would keep lucky ones; below this error a planet that is missed is
also one whose SNR was predicted too high by more than two errors."""


class Calibration(Record):
    """Ratio of predicted to recovered SNR, over one or many measurements.

    Attributes
    ----------
    etc_ratio : float or None
        Predicted over recovered SNR, weighted mean; ``None`` where nothing tells, or the planets are missed.
    etc_ratio_error : float or None
        Standard error, enlarged where three or more bands scatter more than their errors allow.
    etc_ratio_least : float or None
        Where the planets are missed: the ratio that is exceeded beyond two standard errors.
    n_bands : int
        Bands that tell, those that miss their planet included.
    n_faint : int
        Bands left out because their planets are too faint to measure the ETC by.
    """

    etc_ratio: float | None = None
    etc_ratio_error: float | None = None
    etc_ratio_least: float | None = None
    n_bands: int = 0
    n_faint: int = 0

    @classmethod
    def of(cls, recovered: float, error: float, *, n_bands: int = 1, n_faint: int = 0) -> "Calibration":
        """Return the ratio from a recovered SNR and its error, both in units of the predicted SNR.

        Parameters
        ----------
        recovered, error : float
        n_bands, n_faint : int, optional
            Measurements behind it, and those left out.
        """
        if recovered > MIN_SNR * error:
            return cls(1.0 / recovered, error / recovered**2, None, n_bands, n_faint)
        least = 1.0 / (max(recovered, 0.0) + 2.0 * error)
        return cls(None, None, least if least > 1.0 else None, n_bands, n_faint)

    @property
    def standing(self) -> str:
        """Say that the ETC agrees, or by how much it is optimistic or pessimistic: beyond two standard errors only."""
        if self.etc_ratio is None or self.etc_ratio_error is None:
            return "too faint to measure the ETC by" if self.etc_ratio_least is None else "ETC optimistic"
        if abs(self.etc_ratio - 1.0) <= 2.0 * self.etc_ratio_error:
            return "ETC agrees"
        word = "optimistic" if self.etc_ratio > 1.0 else "pessimistic"
        size = 100.0 * abs(self.etc_ratio - 1.0)
        return f"ETC {word} by {size:.{int(size < 10.0)}f} %"

    @property
    def number(self) -> str:
        """The ratio with its error as text; its bound where planets are missed."""
        if self.etc_ratio is None or self.etc_ratio_error is None:
            return "" if self.etc_ratio_least is None else f"above {self.etc_ratio_least:.2g}"
        places = 2 if self.etc_ratio_error >= _FINE else 3
        return f"{self.etc_ratio:.{places}f} +- {self.etc_ratio_error:.{places}f}"

    @property
    def text(self) -> str:
        """In words: the ratio first, then what it says."""
        if not self.n_bands:
            return _TOO_FAINT if self.n_faint else _NOTHING
        counted = f"{self.n_bands} measurement{'s' * (self.n_bands != 1)}"
        counted += f" ({self.n_faint} more too faint to count)" * bool(self.n_faint)
        if not self.number:
            return f"{counted} scatter too much to measure the ETC by"
        if self.etc_ratio is None:
            said = "the planets are missed, and the ETC is optimistic"
        elif self.standing == "ETC agrees":
            said = "the ETC agrees with the images within two standard errors"
        else:
            said = f"{self.standing.replace('ETC', 'the ETC is')}, beyond two standard errors"
        return f"predicted over recovered SNR {self.number} over {counted}: {said}"


_NOTHING = "no band was measured, so prediction and measurement could not be compared"
_TOO_FAINT = "the planets are too faint in these images to measure the ETC by"
_FINE = 0.03
"""Largest error of a ratio that is written with a third decimal."""


def snr_scatter(snr: float, significance: float, n_apertures: int | None) -> float:
    """Return the standard deviation of an SNR measured once.

    Parameters
    ----------
    snr, significance : float
        Expected values: with and without the planet's own noise.
    n_apertures : int or None
        Apertures behind the measured scatter.

    Notes
    -----
    Unit noise in the flux, less what a brighter measurement adds to its own error; and the error of the background's
    scatter, known to ``1 / sqrt(2 (n - 1))`` from n apertures, in its share of the variance. In that share the ratio is
    wider than a normal law, as Student's t with n - 1 degrees of freedom.
    """
    quiet = min((snr / significance) ** 2, 1.0) if significance > 0 else 1.0
    dof = n_apertures - 1 if n_apertures and n_apertures > 1 else math.inf
    relative = 1.0 / math.sqrt(2.0 * dof)
    wider = math.sqrt(1.0 + 2.0 / (dof - 2.0)) if dof > 2.0 else 2.0
    return float(math.hypot(1.0 - 0.5 * (1.0 - quiet), snr * relative * quiet) * wider**quiet)


def mean_snr(flux: ArrayLike, error: ArrayLike, *, significance: float, n_apertures: int) -> tuple[float, float]:
    """Return the SNR of one observation from many realisations of it, and the error of that.

    Parameters
    ----------
    flux, error : array_like
        Measured values and their 1-sigma errors, at least one.
    significance : float
        Expected, for the scatter of few realisations.
    n_apertures : int
        Apertures behind each error.

    Notes
    -----
    Mean flux over the quadratic mean of the errors: variances are unbiased, and the mean of single ratios is too large,
    by ``3 / (4 n)`` for n samples. Error by leaving one realisation out at a time (jackknife); below eight of them what
    `snr_scatter` expects of one, over the square root of their number.
    """
    values, variances = np.asarray(flux, float), np.asarray(error, float) ** 2
    n = len(values)
    snr = float(values.mean() / math.sqrt(variances.mean()))
    if n < MIN_JACKKNIFE:
        return snr, snr_scatter(abs(snr), max(significance, abs(snr)), n_apertures) / math.sqrt(n)
    left_out = (values.sum() - values) / (n - 1) / np.sqrt((variances.sum() - variances) / (n - 1))
    return snr, float(np.sqrt((n - 1) / n * np.sum((left_out - left_out.mean()) ** 2)))


def calibrate(bands: Sequence[BandConfirmation]) -> Calibration:
    """Return predicted over recovered SNR over bands: the inverse of the mean of their inverses by inverse variance.

    Parameters
    ----------
    bands : sequence of BandConfirmation
        Bands without a measurement are passed over, those too faint to tell are counted.

    Notes
    -----
    The variance of a band is that of its mean and that of the prediction, `PREDICTION_ERROR` of the mean ratio. The
    mean is taken of recovered SNRs in units of the predicted ones, whose errors are normal.
    """
    used = [b for b in bands if b.predicted_snr and b.recovered_snr is not None and b.recovered_snr_error is not None]
    names = "predicted_snr", "recovered_snr", "recovered_snr_error"
    return calibration_of(*([getattr(band, name) for band in used] for name in names))


def calibration_of(predicted: ArrayLike, recovered: ArrayLike, error: ArrayLike) -> Calibration:
    """Return the same from SNRs and the errors of the recovered ones.

    Parameters
    ----------
    predicted, recovered, error : array_like
        Of one band or many.
    """
    scale, ratios, own = (np.array(values, float, ndmin=1) for values in (predicted, recovered, error))
    ratios, own = ratios / scale, own / scale
    told = np.hypot(own, PREDICTION_ERROR * ratios) <= MOST_ERROR * np.maximum(ratios, 1.0)
    ratios, own, n_faint = ratios[told], own[told], int(np.sum(~told))
    if not ratios.size:
        return Calibration(n_faint=n_faint)
    ratio = float(np.average(ratios, weights=own**-2))
    weight = 1.0 / (own**2 + (PREDICTION_ERROR * ratio) ** 2)
    ratio = float(np.sum(weight * ratios) / weight.sum())
    spread = 1.0 / math.sqrt(weight.sum())
    if len(ratios) >= 3:
        chi2 = float(np.sum(weight * (ratios - ratio) ** 2) / (len(ratios) - 1))
        spread *= math.sqrt(max(chi2, 1.0))
    return Calibration.of(ratio, spread, n_bands=len(ratios), n_faint=n_faint)


def position_records(scene: Scene, bands: Sequence[BandConfirmation]) -> list[PositionRecord]:
    """Return the positions of planets, mean of the bands that show them, weighted by their errors along and across.

    Parameters
    ----------
    scene : Scene
    bands : sequence of BandConfirmation
        What was measured in each band.
    """
    records = []
    for planet in scene.planets:
        seen = [band for band in bands if band.planet == planet.name and band.found_separation_arcsec is not None]
        if not seen:
            continue
        truth = place(scene.cstar, planet)
        radial = _mean([(band.found_separation_arcsec, band.found_separation_error_arcsec) for band in seen])
        turned = [((band.found_pa_deg or 0.0) - truth.pa_deg + 180.0) % 360.0 - 180.0 for band in seen]
        angular = _mean([(turn, band.found_pa_error_deg) for turn, band in zip(turned, seen, strict=True)])
        record = PositionRecord(
            planet=planet.name,
            bands=[band.band for band in seen],
            separation_arcsec=radial[0],
            separation_error_arcsec=radial[1],
            pa_deg=(truth.pa_deg + angular[0]) % 360.0,
            pa_error_deg=angular[1],
            true_separation_arcsec=truth.separation_arcsec,
            true_pa_deg=truth.pa_deg % 360.0,
        )
        records.append(record)
    return records


def _mean(values: Sequence[tuple[Any, Any]]) -> tuple[float, float]:
    """Return the mean weighted by inverse variance."""
    value, error = (np.array([pair[i] for pair in values], float) for i in (0, 1))
    weight = error**-2.0
    return float(weight @ value / weight.sum()), float(weight.sum() ** -0.5)


class FittedAlbedo(Record, eq=False):
    """A fit of metallicity and clouds, with what it was made of.

    Attributes
    ----------
    light : LitPlanet
        The planet in the scene.
    model : AlbedoModel
    fit : AlbedoFit
    """

    light: LitPlanet
    model: AlbedoModel
    fit: AlbedoFit


def albedo_fits(scene: Scene, instrument: Instrument, bands: Sequence[BandConfirmation]) -> list[FittedAlbedo]:
    """Return the fits of metallicity and clouds to the mean contrasts, with the errors of one observation a band.

    Parameters
    ----------
    scene : Scene
    instrument : Instrument
    bands : sequence of BandConfirmation
        What was measured in each band.
    """
    passbands = Passbands.from_instrument(instrument)
    found = []
    lights = [row.light for row in spectrum_generator(scene) if isinstance(row.light, LitPlanet)]
    for planet, light in zip(scene.planets, lights, strict=True):
        seen = [b for b in bands if b.planet == planet.name and b.recovered_contrast is not None and b.status == "ok"]
        if not seen or not planet.reflects:
            continue
        chosen = [passbands.bands[passbands.index(band.band)] for band in seen]
        try:
            model = planet_albedo_model(light, chosen)
        except InputError:
            continue  # its insolation is not known: no luminosity, or no distance
        measured = {band.band: (band.recovered_contrast or 0.0, band.contrast_error or 0.0) for band in seen}
        found.append(FittedAlbedo(light, model, fit_albedo(measured, model)))
    return found


def albedo_records(fitted: Sequence[FittedAlbedo]) -> list[AlbedoRecord]:
    """Return the fits of metallicity and clouds for the record."""
    return [
        AlbedoRecord.of(
            item.fit,
            planet=item.light.name,
            log10_mh=item.fit.median("log10_mh"),
            log10_fsed=item.fit.median("log10_fsed"),
            log10_mh_interval=list(item.fit.interval("log10_mh")),
            log10_fsed_interval=list(item.fit.interval("log10_fsed")),
            best_fit=[item.fit.log10_mh, item.fit.log10_fsed],
        )
        for item in fitted
    ]


AT_KNOWN_PLACE = "seen at its known place, not confirmed blind"
_ADVICE = {
    "quick": "take --fidelity standard, or a --tolerance",
    "standard": "take --fidelity reference, or a --tolerance",
    "custom": "take --fidelity reference, or a larger --tolerance",
}


def confirmation_of(
    task: ConfirmTask,
    modelling: Modelling,
    number: int,
    runs: Sequence[Measurement | None],
    star: StarFlux,
    core: float,
    *,
    false_detections: int = 0,
    statistics: FrameStatistics | None = None,
    positions: Sequence[Astrometry | None] = (),
    light: Mapping[str, float] = MappingProxyType({}),
    audit: AuditRecord | None = None,
) -> BandConfirmation:
    """Return the answer for planet ``number`` of a task.

    Parameters
    ----------
    task : ConfirmTask
    modelling : Modelling
        How the images were made.
    number : int
        Of the planet among those of the task.
    runs : sequence of Measurement or None
        One a realisation; None where limits left nothing of the aperture, or of the background around it.
    star : StarFlux
        What contrasts refer to.
    core : float
        Core throughput at the planet's place.
    false_detections : int
        Of all searches.
    statistics : FrameStatistics, optional
        Of frames that were run one by one; none for sums.
    positions : sequence of Astrometry or None
        Fits of the realisations that show the planet; empty where none was made.
    light : mapping, optional
        Fields on the star's light in the band.
    audit : AuditRecord, optional
    """
    lost = 0 if statistics is None else statistics.lost_in
    measured = [run for run in runs if run is not None]
    if len(measured) < len(runs):
        return BandConfirmation(
            **_asked(task, number),
            status="saturated",
            reason=Reason.PIXEL_FULL_WELL.value,
            message="limits cut off the aperture or the background around it",
            modelled=modelling.record(),
            drawn_as="frames",
            saturated_in_hole=statistics and lost,
            detected=False,
            verdict="saturated",
        )
    expected = task.predictions[number]
    n = len(measured)
    n_apertures = measured[0].n_apertures
    contrast, error, sigma = contrasts_of(measured)
    recovered_significance = float(contrast.mean() / np.sqrt((sigma**2).mean()))
    predicted, significance = expected["snr"], expected["significance"]
    likely = recovered_significance if significance is None else significance
    snr, snr_error = mean_snr(contrast, error, significance=likely, n_apertures=n_apertures)
    # A few values do not tell their scatter.
    spread = float(contrast.std(ddof=1)) if n >= MIN_JACKKNIFE else float(np.sqrt((error**2).mean()))
    found = sum(item.found for item in measured)
    at_place = sum(item.found_at_place for item in measured)
    mean = Calibration() if predicted is None else calibration_of(predicted, snr, snr_error)
    compared = "no closed form predicts this reduction" if predicted is None else _etc(mean)
    detected = bool(2 * found >= n and not lost)
    position = next((fit for fit in positions if fit is not None), None)
    return BandConfirmation(
        **_asked(task, number),
        status="saturated" if lost else "ok",
        reason=Reason.PIXEL_FULL_WELL.value if lost else "",
        message=f"{lost} pixels of the hole were cut off by a limit" if lost else "",
        realisations=n,
        drawn_as=modelling.draw,
        modelled=modelling.record(),
        recovered_snr=snr,
        recovered_snr_error=snr_error,
        recovered_significance=recovered_significance,
        etc_ratio=mean.etc_ratio,
        etc_ratio_error=mean.etc_ratio_error,
        recovered_contrast=float(contrast.mean()),
        contrast_error=float(np.sqrt((error**2).mean())),
        contrast_mean_error=spread / math.sqrt(n),
        star_flux=star.method,
        star_flux_error=None if star.method == "known" else star.error_e_s / star.rate_e_s,
        **light,
        rdi_throughput=float(np.mean([item.throughput for item in measured])),
        rdi_modes_used=measured[0].modes,
        core_throughput=core,
        n_background_apertures=n_apertures,
        saturated_in_hole=lost,
        saturated_outside=statistics and statistics.lost_outside / statistics.frames_run,
        n_detected=found,
        search_snr=_mean_of_known([item.search_snr for item in measured]),
        search_threshold=_mean_of_known([item.search_threshold for item in measured]),
        n_significant=at_place,
        false_detections=false_detections,
        detected=detected,
        found_separation_arcsec=position and position.separation_arcsec,
        found_separation_error_arcsec=position and position.separation_error_arcsec,
        found_pa_deg=position and position.pa_deg % 360.0,
        found_pa_error_deg=position and position.pa_error_deg,
        verdict=_verdict(_predicted(task, expected), detected, (found, at_place, n), compared),
        audit=audit,
        observations=[
            _observation(task, at, item, fit, star, lost=bool(lost), threshold=expected["threshold"])
            for at, (item, fit) in enumerate(zip(measured, positions or [None] * n, strict=True))
        ],
    )


def _observation(
    task: ConfirmTask,
    at: int,
    item: Measurement,
    fit: Astrometry | None,
    star: StarFlux,
    *,
    lost: bool,
    threshold: float,
) -> ObservationRow:
    """Return one realisation as a row, with the fitted place where the fit came to rest."""
    place: dict[str, Any] = {}
    if fit is not None and fit.converged and not lost:
        east, north = np.sqrt(np.diag(fit.sky_covariance)).tolist()
        place = {
            "east_error_arcsec": east,
            "north_error_arcsec": north,
            "east_north_covariance": float(fit.sky_covariance[0, 1]),
            "pa_deg": fit.pa_deg % 360.0,
        }
    return ObservationRow.of(
        item,
        *([fit] if place else []),
        **place,
        realisation=at + 1,
        epoch_mjd=task.epoch_mjd,
        detected=item.found and not lost,
        contrast_limit=threshold * item.contrast_sigma,
        star_flux_error=star.error_e_s / star.rate_e_s,
    )


def _asked(task: ConfirmTask, number: int) -> dict[str, Any]:
    """Return what was observed, and what was expected of it."""
    expected = task.predictions[number]
    same = ("band", "exposure_s", "em_gain", "visits", "reference_visits", "time_s", "unused_s", "chosen_for")
    asked = {name: getattr(task, name) for name in same} | {
        "planet": task.planets[number],
        "frames_per_visit": task.n_frames,
        "n_frames": task.n_science_frames,
        "integration_s": task.exposure_s * task.n_science_frames,
        "image": task.key,
    }
    told = {name: expected[name] for name in ("separation_arcsec", "pa_deg", "threshold")}
    told |= {f"predicted_{name}": expected[name] for name in ("snr", "significance", "verdict")}
    return (
        asked
        | told
        | {
            "predicted_detection_probability": expected["chance_blind"],
            "predicted_detection_probability_known_place": expected["chance_known_place"],
            "true_contrast": expected["contrast"],
        }
    )


def contrasts_of(measured: Sequence[Measurement]) -> FloatArray:
    """Return the contrasts, their errors and those without the planet's noise, one a realisation; (3, n)."""
    rows = [(item.contrast, item.contrast_error, item.contrast_sigma) for item in measured]
    return np.ascontiguousarray(np.array(rows).T)


_PREDICTED = (
    *("predicted_snr", "predicted_significance", "predicted_verdict"),
    *("predicted_detection_probability", "predicted_detection_probability_known_place"),
)


def refusals_of(task: ConfirmTask) -> list[BandConfirmation]:
    """Return the answers for planets of a task that need no image.

    All of them where the tier is not good enough for the scene; those that images cannot show; none where all can be
    measured.
    """
    modelling = modelling_of(task)
    if modelling.outcome.value is None:
        why = modelling.outcome.status, modelling.outcome.reason
        text = f"{modelling.outcome.message}: {_ADVICE[modelling.dial.fidelity]}"
        reasons = dict.fromkeys(range(len(task.planets)), (*why, text, "not modelled"))
    else:
        reasons = {}
        strategy = validate(Strategy, task.strategy, where="strategy")
        instrument = validate(Instrument, task.simulator, where="instrument")
        scene = modelling.kept_sources(validate(Scene, task.scene, where="scene"))
        plan = library_plan(strategy, scene, task.n_frames, visits=task.visits, roll_deg=task.roll_deg)
        geometry = BandGeometry.of(instrument, task.band, modelling.knobs.stamp_pixels)
        for number, place in enumerate(planet_places(plan, instrument, task, geometry, strategy)):
            if (hidden := obstacle(place, geometry, strategy)) is not None:
                inside = hidden[0] in (Reason.TOO_FEW_ELEMENTS, Reason.SOURCE_ON_PLACE)
                reasons[number] = (Status.UNREACHABLE if inside else Status.OUTSIDE_FIELD, *hidden, "not observed")
    answers = []
    for number, (status, reason, text, verdict) in reasons.items():
        more = {"image": None, "modelled": modelling.record(), "verdict": verdict}
        if reason is Reason.SOURCE_ON_PLACE:  # predictions know the light of an annulus
            more |= dict.fromkeys(_PREDICTED)
        answers.append(not_observed(status, reason, text, **(_asked(task, number) | more)))
    return answers


def _predicted(task: ConfirmTask, expected: dict[str, Any]) -> tuple[bool | None, str]:
    """Return whether the images' way of deciding predicted a detection, and what was predicted in words.

    None where nothing was predicted.
    """
    if expected["significance"] is None:
        return None, ""
    strategy = validate(Strategy, task.strategy, where="strategy")
    # Two rolls show every planet twice: the threshold at the known place decides there.
    at_place = strategy.search == "known_place" or len(strategy.rolls_deg) > 1
    chance = expected["chance_known_place" if at_place else "chance_blind"]
    if chance is None:
        return expected["significance"] >= expected["threshold"], "a significance below the threshold"
    return chance >= 0.5, f"a probability of {chance:.2f}"


def _verdict(predicted: tuple[bool | None, str], detected: bool, counts: tuple[int, int, int], etc: str) -> str:
    found, at_place, realisations = counts
    likely, expected = predicted
    if detected:
        word = f"detected, though {expected} was predicted" if likely is False else "confirmed"
    elif 2 * at_place >= realisations:
        word = AT_KNOWN_PLACE
    else:
        word = "not detected, as predicted" if likely is False else "not confirmed"
    counted = f" ({found} of {realisations})" if realisations > 1 else ""
    return f"{word}{counted}; {etc}"


def _etc(mean: Calibration) -> str:
    return f"{mean.standing} (predicted over recovered SNR {mean.number})" if mean.number else mean.standing


def _mean_of_known(values: Sequence[float | None]) -> float | None:
    given = [value for value in values if value is not None]
    return float(np.mean(given)) if given else None


def audit_of(
    task: ConfirmTask, number: int, measured: Measurement, statistics: FrameStatistics, false_detections: int
) -> AuditRecord:
    """Return the record of the realisation with every effect on; ``statistics`` are of the frames that were run."""
    expected = task.predictions[number]
    return AuditRecord.of(
        task,
        measured,
        statistics,
        n_frames=task.n_science_frames,
        frames_in_all=round(task.n_all_frames),
        predicted_snr=expected["snr_full"],
        recovered_snr=measured.snr,
        recovered_significance=measured.significance,
        deviation_sigma=(measured.contrast - expected["contrast"]) / measured.contrast_error,
        detected=bool(measured.found and not statistics.lost_in),
        false_detections=false_detections,
        saturated_in_hole=statistics.lost_in,
        saturated_outside=statistics.lost_outside / statistics.frames_run,
    )


def significant_at_place(band: BandConfirmation) -> bool:
    """Return whether at least half of the realisations are significant at the known place, limits aside."""
    return band.status == "ok" and 2 * (band.n_significant or 0) >= (band.realisations or 1)


def target_verdict(bands: Sequence[BandConfirmation]) -> tuple[str, float | None, float | None]:
    """Return a target's bands in words, with predicted over recovered SNR and its error."""
    seen = [band for band in bands if band.detected]
    tried = [band for band in bands if band.recovered_snr is not None]
    if not tried:
        word = "saturated" if any(band.verdict == "saturated" for band in bands) else "not observed"
        return f"{word}: " + ", ".join(sorted({band.reason for band in bands})), None, None
    if seen:
        word = "confirmed in " + ", ".join(band.band for band in seen)
    elif any(band.status == "saturated" for band in tried):
        word = "saturated"
    else:
        word = AT_KNOWN_PLACE if any(significant_at_place(band) for band in tried) else "not confirmed"
    mean = calibrate(tried)
    return f"{word}; {_etc(mean)}", mean.etc_ratio, mean.etc_ratio_error
