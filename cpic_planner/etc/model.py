"""The instrument as the ETC knows it: the same passbands, PSF metrics and detector as the images.

One frame of a camera: what it adds, holds and costs, and its best gain. Where a planet may stand in the dark hole, the
visits of a programme, and the check of plain numbers.

A frame has the variance ``F^2(g) A + B / g^2``, so that the best gain depends on ``u = B / A`` and on the largest gain
alone. ``F^2`` rises from 1 to a broad top (1.98 near gain 300 of 604 stages) and falls a little beyond it, so there can
be two minima: one where reading is beaten, one at the largest gain.
"""

import functools
import math
from collections.abc import Iterator, Sequence
from dataclasses import field, replace
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from cpic_core import (
    ArrayLike,
    FloatArray,
    InputError,
    IntArray,
    Keyed,
    NDArray,
    Reason,
    Record,
    Status,
    digest_of,
    file_state,
)
from cpic_planner.etc.searches import CaseArrays, last_true
from cpic_planner.queries import LibraryNoise, Strategy
from simulator.camera import aperture_loss_per_s
from simulator.config import CONVERTER_ASSUMED, Instrument, Timing, content_hash
from simulator.detectors import FrameTerm, added_variance, frame_variance_e2, noise_factor2
from simulator.imaging import BandGeometry, PsfMetrics, Zone, metrics_key, psf_metrics, zone_of
from simulator.passbands import Passbands
from simulator.signal import ProgrammeLaw, SpeckleLaw, Wells

if TYPE_CHECKING:
    from cpic_planner.queries.shared import ReferenceStar
    from simulator.signal import BandModes

_N_RATIOS, _N_GAINS, _N_PARTS = 3000, 300, 30
_STEP = 1e-4
_BISECTIONS = 45


class FrameCamera(Wells, kw_only=True):
    """Noise, limits and times of one frame; electrons at the register input unless said.

    Attributes
    ----------
    full_well_e, register_full_well_e, converter_e, em_gain_max, blooms
        As of `simulator.signal.saturation.Wells`.
    register_stages : int
        Stages of the register, 0 without one: then ``F^2`` is 1.
    read_noise_e, rounding_e : float
        Rms of read noise and of the converter's rounding, per pixel and frame, at the register output.
    light_factor : float
        Variance over mean of the light in a frame: 1, or what a fitted ramp makes of it.
    cic_e : float
        Clock-induced electrons per pixel and frame.
    dark_e_s : float
        Dark current per pixel.
    line_shift_s : float
        Time that a line of the frame stands in the light of each other during the transfer; 0 without smear.
    readout_s, exposure_min_s, exposure_max_s : float
        Dead time after a frame, shortest and longest exposure.
    added : tuple of (str, FrameTerm)
        Variance of a pixel and frame that further effects of the detector add, by term of the budget of noise.
    """

    register_stages: int
    read_noise_e: float
    rounding_e: float
    cic_e: float
    dark_e_s: float
    readout_s: float
    exposure_min_s: float
    exposure_max_s: float
    light_factor: float = 1.0
    line_shift_s: float = 0.0
    added: tuple[tuple[str, FrameTerm], ...] = ()

    @functools.cached_property
    def _rest(self) -> FrameTerm:
        return FrameTerm.total([FrameTerm(), *(term for _, term in self.added)])

    @property
    def read_variance_e2(self) -> float:
        """Variance of a pixel and frame at the register output: read noise, rounding and what other effects add."""
        return self.read_noise_e**2 + self.rounding_e**2 + float(self._rest.output_e2)

    @property
    def charge_e(self) -> float:
        """Electrons of a pixel and frame that come without light, before the register: clock-induced and other."""
        return self.cic_e + float(self._rest.charge_e)

    @property
    def rate_e_s(self) -> float:
        """Electrons of a pixel that come with time besides light and dark current."""
        return float(self._rest.rate_e_s)

    @property
    def of_past(self) -> float:
        """Electrons that come back for each that the frames before collected, all of the same light."""
        return self._rest.of_past

    @property
    def amplifier_e(self) -> float:
        """Rms of read noise and of what else comes behind the register but the rounding, at the register output."""
        return math.hypot(self.read_noise_e, math.sqrt(float(self._rest.output_e2)))

    @classmethod
    def of(cls, instrument: Instrument, band: str) -> Self:
        """Return the camera of a band; effects that are switched off count nothing.

        Parameters
        ----------
        instrument : Instrument
        band : str
            Name of a band of the instrument, such as ``F520``.
        """
        channel = instrument.channel_of(band)
        detector, terms = channel.detector, added_variance(channel.detector)
        read, rounding, cic, dark = (terms.pop(name, FrameTerm()) for name in ("read_noise", "rounding", "cic", "dark"))
        rest = FrameTerm.total([FrameTerm(), *terms.values()])
        one_read_e = detector.read_noise_e if detector.switches.read_noise else 0.0
        swing_e = math.hypot(one_read_e, math.sqrt(float(rest.output_e2)))
        same = ("full_well_e", "register_full_well_e", "readout_s", "exposure_min_s", "line_shift_s")
        return cls(
            **{name: getattr(detector, name) for name in same},
            converter_e=max(detector.converter_e - 5.0 * swing_e, 0.0),
            em_gain_max=detector.em_gain_max if detector.multiplies else 1.0,
            register_stages=detector.register_stages if detector.multiplies else 0,
            read_noise_e=math.sqrt(float(read.output_e2)),
            rounding_e=math.sqrt(float(rounding.output_e2)),
            cic_e=float(cic.charge_e),
            dark_e_s=float(dark.rate_e_s),
            exposure_max_s=channel.exposure_max_s,
            light_factor=detector.ramp()[1],
            blooms=channel.multiplies,
            added=tuple(terms.items()),
        )


class GainTable(Record, eq=False):
    """Logarithms of the best gains for logarithms of ``B / A``.

    ``near`` is the first minimum of the variance, ``far`` the largest gain where that has less, else ``near``;
    ``two_minima`` says where they differ there or at the next point. The logarithms are evenly spaced.
    """

    log_ratio: FloatArray
    near: FloatArray
    far: FloatArray
    two_minima: NDArray[np.bool_]
    stages: int


@functools.lru_cache(maxsize=16)
def gain_table(gain_max: float, stages: int) -> GainTable:
    """Return a table of the best gains of a register.

    Parameters
    ----------
    gain_max : float
        Largest gain, above 1.
    stages : int
        Of the register.
    """
    log_ratio = np.linspace(np.log(0.1), np.log(1e8), _N_RATIOS)
    ratio, top = np.exp(log_ratio), np.log(gain_max)

    def variance(log_gain: FloatArray) -> FloatArray:
        result: FloatArray = noise_factor2(np.exp(log_gain), stages) + ratio * np.exp(-2.0 * log_gain)
        return result

    def rises(log_gain: FloatArray) -> NDArray[np.bool_]:
        return variance(log_gain + _STEP) > variance(log_gain - _STEP)

    grid = np.linspace(0.0, top, _N_GAINS)
    factor2, falls = noise_factor2(np.exp(grid), stages)[:, None], np.exp(-2.0 * grid)[:, None]

    def first_rise(some: FloatArray) -> IntArray:
        rising = np.diff(factor2 + some * falls, axis=0) > 0
        return np.where(rising.any(axis=0), rising.argmax(axis=0), _N_GAINS - 1)

    # First minimum: where the variance first rises, the largest gain where it never does; parts fit the cache.
    k = np.concatenate([first_rise(some) for some in np.array_split(ratio, _N_PARTS)])
    low, high = grid[np.maximum(k - 1, 0)], grid[np.minimum(k + 1, _N_GAINS - 1)]
    share = last_true(lambda part: ~rises(low + part * (high - low)), k.shape, _BISECTIONS)
    first = np.where(k == 0, 0.0, np.where(k == _N_GAINS - 1, top, low + share * (high - low)))
    far = np.where(variance(np.full(_N_RATIOS, top)) < variance(first), top, first)
    two = far > first
    return GainTable(log_ratio, first, far, two | np.append(two[1:], False), stages)


def best_gain(
    light_variance_e2: FloatArray, read_variance_e2: FloatArray, gain_cap: FloatArray, gain_max: float, stages: int
) -> tuple[FloatArray, FloatArray]:
    """Return the gain of least variance up to a cap, and that variance.

    Parameters
    ----------
    light_variance_e2 : ndarray
        ``A``: variance of a frame that the register multiplies, at ``F^2 = 1``.
    read_variance_e2 : ndarray
        ``B``: variance added at the output.
    gain_cap : ndarray
        Largest gain that saturates nothing; below 1 there is none, and gain 1 is returned for the caller to refuse.
    gain_max : float
        Largest gain of the register.
    stages : int
        Stages of the register; 0 for none.

    Returns
    -------
    gain, variance : ndarray
        Exact but for the table between its points.
    """
    if stages == 0 or gain_max <= 1.0:
        return np.ones(np.broadcast(light_variance_e2, gain_cap).shape), light_variance_e2 + read_variance_e2
    table = gain_table(gain_max, stages)
    with np.errstate(divide="ignore"):
        first, last = table.log_ratio[0], table.log_ratio[-1]
        where = np.fmin(np.fmax(np.log(read_variance_e2) - np.log(light_variance_e2), first), last)
    # The logarithms are evenly spaced.
    steps = (where - first) * ((_N_RATIOS - 1) / (last - first))
    below = np.minimum(steps.astype(np.intp), _N_RATIOS - 2)
    above = steps - below
    cap = np.maximum(gain_cap, 1.0)

    def of_table(logs: FloatArray) -> FloatArray:
        low = logs[below]
        return np.asarray(np.minimum(np.exp(low + above * (logs[below + 1] - low)), cap))

    gain = of_table(table.near)
    variance = frame_variance_e2(light_variance_e2, noise_factor2(gain, stages), read_variance_e2, gain)
    if not table.two_minima[below].any():
        return gain, variance
    other = of_table(table.far)
    if np.any(other > gain):
        there = frame_variance_e2(light_variance_e2, noise_factor2(other, stages), read_variance_e2, other)
        better = there < variance
        gain, variance = np.where(better, other, gain), np.where(better, there, variance)
    return gain, variance


def _always(value: float) -> FloatArray:
    """Return a number that nobody changes."""
    array = np.array(value)
    array.flags.writeable = False
    return array


_ONE, _ZERO, _ENDLESS = (_always(value) for value in (1.0, 0.0, np.inf))


class Programme(CaseArrays, Record, eq=False):
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
        of the references (`cpic_planner.etc.noise`).
    """

    visits: FloatArray = field(default_factory=lambda: _ONE)
    reference_visits: FloatArray = field(default_factory=lambda: _ONE)
    reference_length: FloatArray = field(default_factory=lambda: _ONE)
    gap_s: FloatArray = field(default_factory=lambda: _ENDLESS)
    n_modes: FloatArray = field(default_factory=lambda: _ZERO)
    speckle: FloatArray = field(default_factory=lambda: _ONE)
    white: FloatArray = field(default_factory=lambda: _ONE)
    throughput: FloatArray = field(default_factory=lambda: _ONE)

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

    def effective(self, law: ProgrammeLaw) -> FloatArray:
        """Return the number of independent wavefronts behind the noise of the programme.

        Parameters
        ----------
        law : ProgrammeLaw
            Which says how long wavefronts remember each other.
        """
        own = law.independent(self.visits, self.gap_s)
        if self.reference_visits is self.visits:
            return own
        return effective_visits(own, law.independent(self.reference_visits, self.gap_s))


ONE_VISIT = Programme()
"""A single visit with its references."""


def effective_visits(visits: ArrayLike, reference_visits: ArrayLike) -> FloatArray:
    """Return the number of pairs of visits whose mean difference has tails like that of science and reference visits.

    Parameters
    ----------
    visits, reference_visits : array_like
        Independent wavefronts of the science frames and of the reference frames, at least 1.

    Returns
    -------
    ndarray
        ``(1/V + 1/R)^2 / [2 (1/V^3 + 1/R^3)]``: V for R = V, and V/2 for a library of many reference visits.

    Notes
    -----
    The light of the wavefront's errors is exponential in a visit. Means of V and of R such variates differ by one of
    excess kurtosis ``6 (1/V^3 + 1/R^3) / (1/V + 1/R)^2``; that of n pairs of visits, each a Laplace variate, has 3/n.
    """
    science, reference = 1.0 / np.asarray(visits, float), 1.0 / np.asarray(reference_visits, float)
    return np.asarray((science + reference) ** 2 / (2.0 * (science**3 + reference**3)))


class EtcModel(Record, eq=False):
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
        return self._content

    @functools.cached_property
    def _content(self) -> dict[str, Any]:
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

    @functools.cached_property
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
    return place_statuses(model, band, [separation_arcsec])[0]


def place_statuses(
    model: EtcModel, band: str, separation_arcsec: Sequence[float]
) -> tuple[tuple[Status, Reason, str], ...]:
    """Return the same of several separations; parameters as of `place_status`."""
    instrument, rolls = model.instrument, model.strategy.rolls_deg
    aperture = instrument.aperture_radius_arcsec(band)
    # With two rolls the planet stands half the roll beside the diagonal, before and after.
    zone, turn_deg = zone_of(instrument, band), rolls[1] if len(rolls) > 1 else 0.0
    inner, outer = zone.usable_range_arcsec(aperture, turn_deg)
    beside = f"{turn_deg:g} deg beside the diagonal" if turn_deg else "diagonal"
    where = "ring" if zone.mode == "ring" else beside
    leaves = f"the aperture leaves the dark hole of {band}"

    def status(separation: float) -> tuple[Status, Reason, str]:
        place = f"{separation:.3f} arcsec"
        if separation < inner * (1.0 - 1e-10):
            text = f"{place}: {leaves}; closest separation {inner:.3f} arcsec ({where})"
            return Status.OUTSIDE_FIELD, Reason.INSIDE_INNER_EDGE, text
        if separation > outer * (1.0 + 1e-10):
            text = f"{place}: {leaves}; farthest separation {outer:.3f} arcsec ({where})"
            return Status.OUTSIDE_FIELD, Reason.OUTSIDE_OUTER_EDGE, text
        if len(rolls) > 1:
            moved = 2.0 * separation * math.sin(math.radians(rolls[1]))
            if moved < 2.0 * aperture:
                moves = f"a roll of {rolls[1] - rolls[0]:g} deg moves the planet by {moved:.3f} arcsec"
                text = f"{place}: {moves}, less than its aperture of {2.0 * aperture:.3f}"
                return Status.UNREACHABLE, Reason.SMALL_ROLL, text
        return Status.OK, Reason.NONE, ""

    return tuple(status(float(separation)) for separation in separation_arcsec)


N_SEPARATIONS = 41
MIN_BACKGROUND_APERTURES = 25.0
"""Aperture areas that the background annulus must hold: about a third of them fit without overlap."""


def separation_grid(model: EtcModel, band: str) -> FloatArray:
    """Return diagonal separations with the aperture in a band's zone, a defined threshold and room for noise."""
    inner, outer = usable_range_arcsec(model.instrument, band)
    grid = _roomy(model.metrics[band].geometry, inner, outer, model.strategy.annulus_lambda_d)
    if len(model.strategy.rolls_deg) > 1:  # a planet that is seen at two rolls stands beside the diagonal
        grid = grid[[status is Status.OK for status, _, _ in place_statuses(model, band, grid.tolist())]]
    if grid.size == 0:
        allowed = "a zone with room for aperture, background and three elements"
        raise InputError("band", band, allowed=allowed, hint="see annulus_lambda_d, roll_deg and the hole's edges")
    return grid


@functools.lru_cache(maxsize=64)
def _roomy(band: BandGeometry, inner_arcsec: float, outer_arcsec: float, annulus_lambda_d: float) -> FloatArray:
    grid = np.geomspace(inner_arcsec, outer_arcsec, N_SEPARATIONS)
    room = band.annulus_pixels(grid, annulus_lambda_d) >= MIN_BACKGROUND_APERTURES * band.aperture_pixels
    usable: FloatArray = grid[(band.resolution_elements(grid) >= 3.0) & room]
    usable.flags.writeable = False
    return usable


def check_range(key: str, value: float, low: float, high: float, unit: str) -> float:
    """Refuse a number that is not finite or not in [low, high]."""
    number = isinstance(value, int | float | np.floating | np.integer) and not isinstance(value, bool)
    if not number or not math.isfinite(value):
        raise InputError(key, value, unit=unit, allowed=f"a finite number from {low:g} to {high:g}")
    if not low <= value <= high:
        raise InputError(key, value, unit=unit, allowed=f"{low:g} to {high:g}")
    return float(value)
