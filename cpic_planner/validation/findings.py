"""Comparison of predictions and measurements over bands, targets and plans; positions and albedos of planets."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cpic_core import ArrayLike, InputError
from cpic_planner.results import AlbedoRecord, BandConfirmation, PositionRecord
from cpic_planner.validation.albedo_fit import AlbedoFit, AlbedoModel, fit_albedo, planet_albedo_model
from simulator.config import Instrument, Scene, place
from simulator.passbands import Passbands
from simulator.target import LitPlanet, spectrum_generator

PREDICTION_ERROR = 0.05
"""Relative accuracy of a predicted SNR at one place: the residual speckles of one instrument are a few per cent
brighter or fainter around a planet than the mean of the hole at its separation. The 20 cases of reports/blind_validator
differ by 2.7 % rms and by 5 % at most."""
MIN_JACKKNIFE = 8
MIN_SNR = 3.0
"""A recovered SNR below this many of its errors says that the planet is missed, not by which factor."""
MOST_ERROR = 1.0 / (MIN_SNR + 2.0)
"""Largest error, in units of the predicted SNR, of a recovered SNR that tells about the ETC. Measurements are chosen by
their errors, since a choice by what was recovered would keep lucky ones; below this error a planet that is missed is
also one whose SNR was predicted too high by more than two errors."""


@dataclass(frozen=True)
class Calibration:
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


@dataclass(frozen=True, eq=False)
class FittedAlbedo:
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
