"""The instrument as the ETC knows it: the same passbands, PSF metrics and detector as the images.

Where a planet may stand in the dark hole, the visits of a programme, and the check of plain numbers.
"""

import functools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from cpic_core import ArrayLike, FloatArray, InputError, Keyed, NDArray, Reason, Status, digest_of, file_state
from cpic_planner.etc.camera import FrameCamera
from cpic_planner.etc.searches import CaseArrays
from cpic_planner.queries import Strategy
from cpic_planner.registry import LibraryNoise
from simulator.camera import aperture_loss_per_s
from simulator.config import CONVERTER_ASSUMED, Instrument, Timing, content_hash
from simulator.imaging import PsfMetrics, Zone, metrics_key, psf_metrics, zone_of
from simulator.passbands import Passbands
from simulator.signal import ProgrammeLaw, SpeckleLaw

if TYPE_CHECKING:
    from cpic_planner.queries.shared import ReferenceStar
    from simulator.signal import BandModes

_ONE, _ZERO, _ENDLESS = np.array(1.0), np.array(0.0), np.array(np.inf)
for _constant in (_ONE, _ZERO, _ENDLESS):
    _constant.flags.writeable = False


def _one() -> FloatArray:
    return _ONE


def _zero() -> FloatArray:
    return _ZERO


@dataclass(frozen=True, eq=False)
class Programme(CaseArrays):
    """Visits of one star that are reduced together; arrays that broadcast with the cases.

    Attributes
    ----------
    visits : ndarray
        Science visits.
    reference_visits : ndarray
        Visits that all the reference frames are spread over.
    reference_length : ndarray
        Length of a reference visit over that of as many of them as science visits.
    gap_s : ndarray
        From the start of a visit to that of the next; ``inf`` for visits that know nothing of each other.
    n_modes, speckle, white, throughput : ndarray
        Modes that are projected out, and what they change (`simulator.signal.ModeFactors`): none, and 1, for the mean
        of the references (`cpic_planner.etc.modes`).
    """

    visits: FloatArray = field(default_factory=_one)
    reference_visits: FloatArray = field(default_factory=_one)
    reference_length: FloatArray = field(default_factory=_one)
    gap_s: FloatArray = field(default_factory=lambda: _ENDLESS)
    n_modes: FloatArray = field(default_factory=_zero)
    speckle: FloatArray = field(default_factory=_one)
    white: FloatArray = field(default_factory=_one)
    throughput: FloatArray = field(default_factory=_one)

    @classmethod
    def of(cls, strategy: Strategy, visits: ArrayLike | None = None, visit_time_s: ArrayLike = np.inf) -> Self:
        """Return the programme of a strategy.

        Parameters
        ----------
        strategy : Strategy
        visits : array_like, optional
            Science visits instead of those of the strategy, which has one where it does not say how many.
        visit_time_s : array_like
            Wall time of a visit; without it visits know nothing of each other.

        Raises
        ------
        InputError
            For a reduction of which no closed form is known.
        """
        strategy.check_predicted()
        library, number = strategy.reference_library, (strategy.visits or 1) if visits is None else visits
        many = np.asarray(number, float)
        references = np.asarray(library.reference_visits(strategy.reference_visits, many), float)
        gap_s = np.asarray(visit_time_s, float) + 3600.0 * strategy.visit_gap_h
        return cls(many, references, library.reference_length(many, references), gap_s)

    def law(self, law: ProgrammeLaw) -> SpeckleLaw:
        """Return the variance of a rate's estimate from the whole programme, against the length of one science visit.

        Modes leave a part of it, and what they leave of the planet scales it. What science and reference differ by in
        every visit is one more draw of the same field of speckles, and they leave as much of it.
        """
        left = law.law(self.visits, self.reference_visits, self.gap_s, reference_length=self.reference_length)
        return left if self.by_mean else left.scaled(self.speckle * self.planet_factor2)

    @property
    def by_mean(self) -> bool:
        """Return whether it is known without a look at them that modes change nothing."""
        return self.speckle is _ONE and self.white is _ONE and self.throughput is _ONE

    def of_mean(self) -> "Programme":
        """Return the programme without modes, reduced by the mean of its references."""
        return Programme(self.visits, self.reference_visits, self.reference_length, self.gap_s)

    @property
    def planet_factor2(self) -> FloatArray:
        """Variance of an estimate over that of what is left of it."""
        return np.asarray(1.0 / self.throughput**2)

    @property
    def white_factor(self) -> FloatArray:
        """What modes change of the variance of an estimate where noise is white: as many pixels are left of it."""
        return np.asarray(self.white * self.planet_factor2)

    @property
    def own_factor(self) -> FloatArray:
        """The same of the planet's own noise, which goes where its light goes.

        The projection leaves between ``throughput`` and its square of that variance: 0.80 where they are 0.85 and 0.72
        (12 modes of 64 visits at the inner edge of F520), 0.94 where 0.96 and 0.93 farther out. The larger is taken, as
        the photometry of images does.
        """
        return np.asarray(1.0 / self.throughput)

    def frame_ratio(self, reference_ratio: float) -> FloatArray:
        """Return the reference frames per science frame, for the ratio that a strategy states."""
        return reference_ratio * self.reference_length * self.reference_visits / self.visits


ONE_VISIT = Programme()
"""A single visit with its references."""


@dataclass(frozen=True)
class EtcModel:
    """Instrument, its one passband quadrature and one set of PSF metrics per band."""

    instrument: Instrument
    passbands: Passbands
    metrics: dict[str, PsfMetrics]
    strategy: Strategy

    @functools.cached_property
    def _cameras(self) -> dict[str, FrameCamera]:
        return {band: FrameCamera.of(self.instrument, band) for band in self.metrics}

    @functools.cached_property
    def _losses(self) -> dict[str, float]:
        return {band: aperture_loss_per_s(self.instrument, band) for band in self.metrics}

    @property
    def of_table(self) -> bool:
        """Say whether the coronagraph is a table, of which no images are known."""
        return self.instrument.coronagraph.table is not None

    def camera(self, band: str) -> FrameCamera:
        """Return one frame of the band's camera."""
        return self._cameras[band]

    def loss_per_s(self, band: str) -> float:
        """Return the rate of particles that void an aperture of the band."""
        return self._losses[band]

    def measured(self) -> "EtcModel":
        """Return the model of the same apertures as they are summed in images (`PsfMetrics.measured`)."""
        return replace(self, metrics={band: figures.measured() for band, figures in self.metrics.items()})

    def modes(self, band: str) -> "BandModes":
        """Return the modes of speckles of the band's references: of visits' offsets, else of the walk in an hour."""
        if band not in self._modes:
            from simulator.signal import BandModes

            drift = self.instrument.drift
            offset_nm = drift.visit_nm or drift.walk_nm_per_sqrt_hour / math.sqrt(3.0)
            self._modes[band] = BandModes.of(self.instrument, band, offset_nm)
        return self._modes[band]

    @functools.cached_property
    def _modes(self) -> "dict[str, BandModes]":
        return {}

    @functools.cached_property
    def timing(self) -> Timing:
        """Return where in the orbit references are taken."""
        return Timing(scheme=self.strategy.reference_scheme)

    @property
    def bands(self) -> tuple[str, ...]:
        """Bands of this model, by wavelength."""
        return tuple(self.metrics)

    def named(self, bands: Sequence[str] | None) -> tuple[str, ...]:
        """Return the bands that are asked for, each once; all of the model without any.

        Raises
        ------
        InputError
            If the model does not have one.
        """
        names = tuple(dict.fromkeys((bands,) if isinstance(bands, str) else bands or self.bands))
        for name in names:
            if name not in self.metrics:
                raise InputError("band", name, allowed=", ".join(self.bands))
        return names

    def content(self) -> dict[str, Any]:
        """Return everything of the model that decides a number, for content hashes; files by what is in them."""
        files = {
            name: digest_of(band.transmission_file)
            for name, band in self.instrument.bands.items()
            if band.transmission_file is not None
        }
        return {
            "instrument": self.instrument.model_dump(mode="json"),
            "strategy": self.strategy.model_dump(mode="json"),
            "optics": {band: metrics_key(self.instrument, band) for band in self.bands},
            "files": files,
        }

    def time_s(self, visit_s: ArrayLike) -> NDArray[np.float64]:
        """Return the wall time of an observation whose science visit takes ``visit_s``; 0 for none."""
        visit = np.asarray(visit_s, float)
        return np.where(visit > 0, self.instrument.overhead_s + self._time_factor * visit, 0.0)

    def visit_s(self, time_s: ArrayLike) -> NDArray[np.float64]:
        """Return the length of the science visit in an observation of ``time_s`` of wall time."""
        return np.maximum(np.asarray(time_s, float) - self.instrument.overhead_s, 0.0) / self._time_factor

    @property
    def _time_factor(self) -> float:
        return self.strategy.reference_library.time_factor(self.strategy)

    @property
    def library_flags(self) -> tuple[str, ...]:
        """Flags of every answer with the strategy's library and, where it has one, its star; and with the detector."""
        library, star = self.strategy.reference_library, self.strategy.reference_star
        gain = self.instrument.provenance.get("detector.gain_e_adu")
        assumed = ("converter_assumed",) if gain is not None and gain.source == CONVERTER_ASSUMED else ()
        if star is None or not np.any(self.passbands.grid_flags(star.teff_k, star.log_g, star.metallicity).any):
            return (*library.flags, *assumed)
        return (*library.flags, "reference_star_clamped", *assumed)

    def library_noise(self, band: str, star_e_s: NDArray[np.float64]) -> LibraryNoise:
        """Return the noise of the library that the strategy names, for science stars of these rates."""
        column = self.passbands.names.index(band)

        def rate_e_s(star: "ReferenceStar") -> NDArray[np.float64]:
            temperature = star.teff_k, star.log_g, star.metallicity
            rates = self.passbands.star_rate_e_s(star.v_mag, *temperature, self.instrument.telescope.area_cm2)
            return np.asarray(rates[..., column], float)

        return self.strategy.reference_library.noise(self.strategy, star_e_s, rate_e_s)


def build_model(
    instrument: Instrument, bands: Sequence[str] | None = None, strategy: Strategy | None = None
) -> EtcModel:
    """Assemble the ETC's model of an instrument.

    Parameters
    ----------
    instrument : Instrument
    bands : sequence of str, optional
        Bands to use; all of the visible camera by default.
    strategy : Strategy, optional

    Raises
    ------
    InputError
        If a band is unknown.

    Notes
    -----
    Models are kept: the same instrument, bands and strategy give the same object. The first use of a near-infrared band
    measures its optics, which takes some seconds.
    """
    if isinstance(bands, str):
        bands = (bands,)
    names = tuple(dict.fromkeys(bands)) if bands else instrument.visible_bands()
    chosen = strategy or Strategy()
    for name in names:
        camera = FrameCamera.of(instrument, name)
        if chosen.mode == "photon_counting" and camera.register_stages == 0:
            hint = "only a multiplying register makes single electrons countable"
            raise InputError("mode", chosen.mode, allowed=f"analogue in {name}", hint=hint)
    tree = instrument.model_dump(mode="json")
    tables = [found.sha256 for name in names if (found := instrument.table(name)) is not None]
    digest = content_hash({"instrument": tree, "files": sorted(set(_files(tree))), "tables": tables})
    return _model(Keyed(digest, instrument), names, chosen)


def _files(tree: Any) -> Iterator[tuple[str, int, int]]:
    """Yield the files that a configuration names, with their time and size."""
    if isinstance(tree, dict | list):
        for part in tree.values() if isinstance(tree, dict) else tree:
            yield from _files(part)
    elif isinstance(tree, str) and "." in tree:
        try:
            yield tree, *file_state(tree)
        except (OSError, ValueError):
            return


@functools.lru_cache(maxsize=16)
def _model(keyed: Keyed[Instrument], bands: tuple[str, ...], strategy: Strategy) -> EtcModel:
    instrument = keyed.value
    metrics = {name: psf_metrics(instrument, name) for name in bands}
    return EtcModel(instrument, Passbands.from_instrument(instrument), metrics, strategy)


def diagonal(zone: Zone, separation_arcsec: Any) -> tuple[Any, Any]:
    """Return offsets x and y of a point on the diagonal of one dark quadrant: the upper right one if it is dark.

    Parameters
    ----------
    zone : HoleZone or RingZone
    separation_arcsec : object
        Projected separation from the star, arcsec, above 0.
    """
    offset = np.asarray(separation_arcsec, float) / math.sqrt(2.0)
    sign_x, sign_y = zone.diagonal
    return sign_x * offset, sign_y * offset


def usable_range_arcsec(instrument: Instrument, band: str) -> tuple[float, float]:
    """Return the closest and the farthest separation, on the diagonal, whose aperture lies in a band's dark hole.

    Parameters
    ----------
    instrument : Instrument
    band : str
        Name of a band of the instrument, such as ``F520``.
    """
    return zone_of(instrument, band).usable_range_arcsec(instrument.aperture_radius_arcsec(band))


def hole_notes(model: EtcModel, band: str) -> tuple[str, ...]:
    """Return the flag of a band whose dark hole is not as dark as asked.

    Parameters
    ----------
    model : EtcModel
    band : str
        Name of a band of the instrument, such as ``F520``.
    """
    return ("hole_not_reached",) if model.metrics[band].hole_state == "not_reached" else ()


def place_status(model: EtcModel, band: str, separation_arcsec: float) -> tuple[Status, Reason, str]:
    """Return whether the aperture of a planet on the diagonal lies in the controlled zone of a band, at both rolls.

    Parameters
    ----------
    model : EtcModel
    band : str
        Name of a band of the instrument, such as ``F520``.
    separation_arcsec : float
        Projected separation from the star, arcsec, above 0.
    """
    instrument, rolls = model.instrument, model.strategy.rolls_deg
    # With two rolls the planet stands half the roll beside the diagonal, before and after.
    zone, turn_deg = zone_of(instrument, band), rolls[1] if len(rolls) > 1 else 0.0
    inner, outer = zone.usable_range_arcsec(instrument.aperture_radius_arcsec(band), turn_deg)
    beside = f"{turn_deg:g} deg beside the diagonal" if turn_deg else "diagonal"
    where = "ring" if zone.mode == "ring" else beside
    place = f"{separation_arcsec:.3f} arcsec"
    if separation_arcsec < inner * (1.0 - 1e-10):
        text = f"{place}: the aperture leaves the dark hole of {band}; closest separation {inner:.3f} arcsec ({where})"
        return Status.OUTSIDE_FIELD, Reason.INSIDE_INNER_EDGE, text
    if separation_arcsec > outer * (1.0 + 1e-10):
        text = f"{place}: the aperture leaves the dark hole of {band}; farthest separation {outer:.3f} arcsec ({where})"
        return Status.OUTSIDE_FIELD, Reason.OUTSIDE_OUTER_EDGE, text
    if len(rolls) > 1:
        least = 2.0 * instrument.aperture_radius_arcsec(band)
        moved = 2.0 * separation_arcsec * math.sin(math.radians(rolls[1]))
        if moved < least:
            moves = f"a roll of {rolls[1] - rolls[0]:g} deg moves the planet by {moved:.3f} arcsec"
            text = f"{place}: {moves}, less than its aperture of {least:.3f}"
            return Status.UNREACHABLE, Reason.SMALL_ROLL, text
    return Status.OK, Reason.NONE, ""


def check_range(key: str, value: float, low: float, high: float, unit: str) -> float:
    """Refuse a number that is not finite or not in [low, high]."""
    number = isinstance(value, int | float | np.floating | np.integer) and not isinstance(value, bool)
    if not number or not math.isfinite(value):
        raise InputError(key, value, unit=unit, allowed=f"a finite number from {low:g} to {high:g}")
    if not low <= value <= high:
        raise InputError(key, value, unit=unit, allowed=f"{low:g} to {high:g}")
    return float(value)
