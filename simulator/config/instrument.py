"""The instrument as configuration: every number of telescope, optics, sky, cameras, bands and mission.

`Channel` is one camera of the instrument with what is in front of it: what differs between the channels, said once.
"""

import functools
import math
import re
from collections.abc import Mapping
from datetime import date, datetime
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias, get_args

import numpy as np
from pydantic import AfterValidator, Field, ValidationInfo

from catalogs import band_from_file, band_provenance, load_bands
from cpic_core import (
    ArrayLike,
    ComplexArray,
    InputError,
    Record,
    by_line,
    check_number,
    check_word,
    is_file,
    load_mapping,
    load_quietly,
    split_sourced,
)
from simulator.config.base import FrozenModel, Sourced, bare_value, deep_merge, preset_names, preset_path, validate
from simulator.config.coronagraph import KEY as TABLE_KEY, CoronagraphTable, coronagraph_table, is_package
from simulator.config.detector import AnyDetector, Detector, InfraredDetector, assume_converter
from simulator.detectors import INFRARED, VISIBLE, chain_preset


class Telescope(FrozenModel):
    """Entrance pupil: a disc, whose diameter is the D of lambda/D.

    ``obstruction_diameter_ratio`` is the diameter of a round obstruction in its middle over its own. ``area_m2`` is the
    collecting area, where it is another than that of this ring: of segments with gaps, or behind struts. Throughputs
    of a coronagraph are over the light on this area.
    """

    diameter_m: Annotated[float, Field(ge=0.1, le=50)]
    obstruction_diameter_ratio: Annotated[float, Field(ge=0, lt=1)] = 0.0
    area_m2: Annotated[float, Field(gt=0, le=2000)] | None = None

    def _check_values(self) -> None:
        disc = math.pi / 4.0 * self.diameter_m**2
        if self.area_m2 is not None and self.area_m2 > disc * (1.0 + 1e-9):
            raise InputError("area_m2", self.area_m2, unit="m2", allowed=f"at most that of the disc, {disc:.4g}")

    @property
    def area_cm2(self) -> float:
        """Collecting area."""
        disc = math.pi / 4.0 * (100.0 * self.diameter_m) ** 2
        if self.area_m2 is not None:
            return 1e4 * self.area_m2
        return disc * (1.0 - self.obstruction_diameter_ratio**2)


class Coronagraph(FrozenModel):
    """Apodizer, focal-plane mask and dark-hole geometry (squares, one per quadrant).

    The controlled zone of a band is ``a <= |x|, |y| <= b`` with ``a = inner_lambda_d / sqrt2`` in units of
    lambda/D and ``b = outer_half_side_arcsec``. ``inner_arcsec`` gives the diagonal separation of the inner corner
    of single bands in arcsec instead. ``apodizer_samples`` averages a measured map over a grid that fits the pupil's.

    ``table`` replaces the optics by a file or folder, or by one for each band, of what the coronagraph does by
    separation (`simulator.config.coronagraph`). Planets are then looked for in a ``ring`` that holds the
    separations of the table, or in the ``quadrants`` above. Where a table has the column ``contrast_stability``, or
    ``stability_fraction`` of the raw contrast is given instead, that is the residual of a visit and no drift of the
    wavefront changes it; ``stability_averages`` says whether it is a new one in every visit, so that V visits leave
    V^(-1/2) of it (``visits``), or the same in all (``never``). Without either, the drift scatters light as the same
    wavefront error does in a clear telescope. ``diameter_m`` is the D of lambda/D in the tables where it is not that
    of the telescope, ``star_diameter_mas`` the diameter of the star behind a table that was made from images. Images
    are made from ``psf``, a file of `simulator.load_psf`, or one for each band, and refused without.
    """

    apodizer: str
    apodizer_kind: Literal["amplitude", "intensity"]
    apodizer_samples: Annotated[int, Field(ge=8, le=2048, multiple_of=2)] | None
    mask_half_width_arcsec: Annotated[float, Field(ge=0, le=2)]
    inner_lambda_d: Annotated[float, Field(ge=1, le=20)]
    inner_arcsec: dict[str, Annotated[float, Field(gt=0, le=4)]]
    outer_half_side_arcsec: Annotated[float, Field(gt=0, le=1)]
    aperture_radius_lambda_d: Annotated[float, Field(ge=0.2, le=5)]
    table: str | dict[str, str] | None = None
    diameter_m: Annotated[float, Field(ge=0.1, le=50)] | None = None
    star_diameter_mas: Annotated[float, Field(ge=0, le=1000)] | None = None
    psf: str | dict[str, str] | None = None
    zone: Literal["quadrants", "ring"] | None = None
    stability_fraction: Annotated[float, Field(ge=0, le=1)] | None = None
    stability_averages: Literal["visits", "never"] = "never"

    def _check_values(self) -> None:
        if self.table is None:
            for key in ("diameter_m", "star_diameter_mas", "psf", "zone", "stability_fraction"):
                if getattr(self, key) is not None:
                    raise InputError(key, getattr(self, key), allowed="not given without coronagraph.table")

    @property
    def is_ring(self) -> bool:
        """Whether planets are looked for in a ring: with a table, unless it is said otherwise."""
        return self.table is not None and self.zone != "quadrants"


class NearInfrared(FrozenModel):
    """The near-infrared channel where it differs: pixel, cross, outer edge of the hole, and its camera."""

    pixel_scale_arcsec: Annotated[float, Field(gt=0, le=1)]
    mask_half_width_arcsec: Annotated[float, Field(ge=0, le=4)]
    outer_half_side_arcsec: Annotated[float, Field(gt=0, le=3)]
    detector: InfraredDetector


def drop_bands(own: Mapping[str, Any], merged: dict[str, Any]) -> None:
    """Leave out the bands of the base where a table replaces its optics: those that neither bands nor tables name.

    Parameters
    ----------
    own : mapping
        What a file says of an instrument.
    merged : dict
        The same over its base, which is changed.
    """
    coronagraph = own.get("coronagraph")
    table = coronagraph.get("table") if isinstance(coronagraph, Mapping) else None
    if isinstance(table, Mapping) and "value" in table:
        table = table["value"]
    named = own.get("bands") if isinstance(own.get("bands"), Mapping) else table
    if table is not None and isinstance(named, Mapping) and isinstance(merged.get("bands"), Mapping):
        merged["bands"] = {name: band for name, band in merged["bands"].items() if name in named}


FIRST_YEAR, LAST_YEAR = 1972, 2100
"""Years of every date of the project: from the first of UTC on, both included."""

_J2000 = datetime(2000, 1, 1, 12)
_UTC = re.compile(r"(\d{4})-(\d\d)-(\d\d)(?:[T ](\d\d):(\d\d)(?::(\d\d(?:\.\d{1,9})?))?)?Z?", re.ASCII)


def checked_utc(key: str, value: Any) -> str:
    """Return a time of UTC in one spelling, ``YYYY-MM-DDThh:mm:ss`` with the fraction that was given.

    Parameters
    ----------
    key : str
        What the time is, for the refusal.
    value : str
        ISO 8601: a date, or a date and a time, with or without ``Z``. Second 60 is accepted in the minutes that had
        one, by the table of leap seconds that comes with ERFA; none can be foreseen.

    Raises
    ------
    InputError
        If it is no such time between 1972, when UTC began, and 2100.
    """
    found = _UTC.fullmatch(value.strip()) if isinstance(value, str) else None
    if found is not None:
        year, month, day = (int(part) for part in found.groups()[:3])
        hour, minute, second = int(found[4] or 0), int(found[5] or 0), found[6] or "00"
        longest = 61 if (hour, minute) == (23, 59) and _ends_in_leap_second(year, month, day) else 60
        in_minute = float(second) < longest
        if hour < 24 and minute < 60 and in_minute and _is_day(year, month, day):
            return f"{found[1]}-{found[2]}-{found[3]}T{hour:02d}:{minute:02d}:{second}"
    raise InputError(key, value, unit="UTC", allowed=f"a time as 2028-01-01T00:00:00, {FIRST_YEAR} to {LAST_YEAR}")


def julian_year(utc: str) -> float:
    """Return the Julian epoch of a time as `checked_utc` writes it; the minute between UTC and TT is passed over."""
    day = datetime.fromisoformat(utc[:19].replace(":60", ":59"))
    return 2000.0 + (day - _J2000).total_seconds() / (365.25 * 86400.0)


def _is_day(year: int, month: int, day: int) -> bool:
    try:
        return FIRST_YEAR <= date(year, month, day).year <= LAST_YEAR
    except ValueError:
        return False


def _ends_in_leap_second(year: int, month: int, day: int) -> bool:
    """Return whether a leap second was put behind a day: the table names the months that begin behind one."""
    if (month, day) not in ((6, 30), (12, 31)):
        return False
    behind = (year, 7) if month == 6 else (year + 1, 1)
    # Loading the table takes a fifth of a second, which only such a time costs.
    table = load_quietly("erfa").leap_seconds.get()
    return behind in {(int(row["year"]), int(row["month"])) for row in table if row["year"] >= FIRST_YEAR}


def _utc_field(value: str, info: ValidationInfo) -> str:
    return checked_utc(info.field_name or "utc", value)


Utc = Annotated[str, AfterValidator(_utc_field)]


class OrbitConfig(FrozenModel):
    """A circular orbit about an oblate Earth, given at one epoch.

    ``node_deg`` is the right ascension of the ascending node, ``phase_deg`` the angle from the node along the orbit.
    """

    altitude_km: Annotated[float, Field(ge=200, le=2000)]
    inclination_deg: Annotated[float, Field(ge=0, le=180)]
    node_deg: Annotated[float, Field(ge=-360, le=360)]
    phase_deg: Annotated[float, Field(ge=-360, le=360)]
    epoch_utc: Utc


class MissionConfig(FrozenModel):
    """Start of an observation that names none, orbit, and the labels of Level-0 products.

    ``obsid_prefix`` begins the eleven digits of an observation's number, ``product_version`` is the number behind ``V``
    in a file name, ``keyword_profile`` names the spellings of the keyword table that are written.
    """

    start_utc: Utc
    orbit: OrbitConfig
    obsid_prefix: Annotated[str, Field(pattern=r"^[0-9]{1,6}$")]
    product_version: Annotated[int, Field(ge=1, le=99)]
    keyword_profile: Annotated[str, Field(min_length=1)]


class WavefrontConfig(FrozenModel):
    """Static aberrations, drawn from a seed on a grid of ``samples``, and pointing jitter (rms per axis)."""

    seed: Annotated[int, Field(ge=0, le=2**63 - 1)]
    samples: Annotated[int, Field(ge=64, le=1024, multiple_of=2)]
    opd_rms_nm: Annotated[float, Field(ge=0, le=1000)]
    amplitude_rms: Annotated[float, Field(ge=0, le=0.1)]
    psd_slope: Annotated[float, Field(ge=0, le=6)]
    jitter_mas: Annotated[float, Field(ge=0, le=30)]

    @property
    def perfect(self) -> bool:
        """No static aberration at all."""
        return self.opd_rms_nm == 0 and self.amplitude_rms == 0


class MirrorConfig(FrozenModel):
    """The deformable mirror and what its electronics do to a command.

    Attributes
    ----------
    n_actuators : int
        Actuators a side.
    span_diameters : float
        Side of the square that they fill, in pupil diameters (A: 0.875, the open part of the apodizer).
    coupling : float
        Influence of an actuator one pitch away (A: 0.15, usual for micro-machined mirrors).
    stroke_nm : float
        Range of the surface command, from ``-stroke/2`` to ``+stroke/2``.
    bits : int or None
        Resolution of the digital-analogue converter over the stroke; None does not quantise.
    noise_nm : float
        Rms noise of each actuator, nm of surface.
    dead : tuple of (int, int)
        Row and column of actuators that stay at zero.
    """

    n_actuators: Annotated[int, Field(ge=4, le=128)] = 32
    span_diameters: Annotated[float, Field(ge=0.5, le=1.5)] = 0.875
    coupling: Annotated[float, Field(ge=0.01, le=0.5)] = 0.15
    stroke_nm: Annotated[float, Field(gt=0, le=1e5)] = 1000.0
    bits: Annotated[int, Field(ge=8, le=32)] | None = None
    noise_nm: Annotated[float, Field(ge=0, le=100)] = 0.0
    dead: tuple[tuple[int, int], ...] = ()

    def _check_values(self) -> None:
        for place in self.dead:
            if not all(0 <= index < self.n_actuators for index in place):
                raise InputError("dead", place, allowed=f"row and column from 0 to {self.n_actuators - 1}")


class DarkHoleConfig(FrozenModel):
    """The settings of the mirror.

    ``control`` is ``conjugation`` (a new Jacobian at every step, with perfect knowledge of the field),
    ``single_jacobian`` (one Jacobian of the design: the less ideal state), ``surface`` (maps loaded from
    ``surface_files``, one per band), or ``off`` (the mirror stays flat). Mode ``2q`` darkens the two quadrants on
    ``side`` of the star on the detector. ``hold_star`` keeps tip and tilt out of the search: positions are measured
    from the star, and a search that may point the telescope moves the star away from its hole.

    ``sensing`` is ``perfect``, or ``probes``: each step of a search knows the field with an error of mean square
    ``sensing_contrast``, relative to the peak, over one square lambda/D and the controlled bandwidth.
    ``sensing_contrast_by_band`` gives it for single bands instead; both are 0 where sensing is perfect.
    """

    control: Literal["conjugation", "single_jacobian", "surface", "off"]
    mode: Literal["4q", "2q"]
    side: Literal["right", "left", "top", "bottom"]
    bandwidth: Annotated[float, Field(ge=0, le=0.5)]
    hold_star: bool
    sensing: Literal["perfect", "probes"]
    sensing_contrast: Annotated[float, Field(ge=0, le=1e-3)]
    sensing_contrast_by_band: dict[str, Annotated[float, Field(ge=0, le=1e-3)]]
    surface_files: dict[str, str]

    def _check_values(self) -> None:
        if bool(self.surface_files) != (self.control == "surface"):
            raise InputError("control", self.control, allowed="surface with surface_files, any other without")
        if self.sensing == "probes" and self.control in ("off", "surface"):
            raise InputError("sensing", self.sensing, allowed=f"perfect where control is {self.control}")
        if self.sensing == "perfect" and any((self.sensing_contrast, *self.sensing_contrast_by_band.values())):
            raise InputError("sensing", self.sensing, allowed="probes with a sensing_contrast above 0")

    def sensing_contrast_of(self, band: str) -> float:
        """Return the mean square error of sensing in a band, 0 where the field is known perfectly."""
        return self.sensing_contrast_by_band.get(band, self.sensing_contrast)


class Drift(FrozenModel):
    """Wavefront drift within a visit, between the visits of a programme, and around the orbit.

    What is not given is not there.

    Attributes
    ----------
    visit_nm : float
        Offset of each visit, frozen within it, nm rms.
    walk_nm_per_sqrt_hour : float
        Random walk within a visit, nm rms per square root of an hour.
    psd_slope : float
        Exponent of the power spectrum ``f^-psd_slope`` of the phase screens.
    common_fraction : float
        Rms of the screen by which science visits differ from reference visits, the same in every visit, in units of
        ``visit_nm``; 0 to 1.
    correlation_time_h : float
        Time in which the correlation of the offsets of two visits falls to 1/e, hours from start to start; 0 means
        independent offsets.
    orbital_nm : float
        Rms over disc and orbit of what the orbit does to the wavefront: one map times a sine of the orbital period, nm.
    orbital_orders : {"low", "all"}
        What the map is made of: defocus, two astigmatisms, two comas and spherical aberration in equal parts, or a
        screen of the spectrum above.
    orbital_period_s : float
        Period of the orbit, s; above 0 where ``orbital_nm`` is.
    pointing_mas : float
        Error of the pointing of each visit, mas rms per axis: images leave it out, the effect ledger says what it would
        change.
    """

    visit_nm: Annotated[float, Field(ge=0, le=100)]
    walk_nm_per_sqrt_hour: Annotated[float, Field(ge=0, le=100)]
    psd_slope: Annotated[float, Field(ge=0, le=6)]
    common_fraction: Annotated[float, Field(ge=0, le=1)] = 0.0
    correlation_time_h: Annotated[float, Field(ge=0, le=1e6)] = 0.0
    orbital_nm: Annotated[float, Field(ge=0, le=100)] = 0.0
    orbital_orders: Literal["low", "all"] = "low"
    orbital_period_s: Annotated[float, Field(ge=0, le=1e6)] = 0.0
    pointing_mas: Annotated[float, Field(ge=0, le=100)] = 0.0

    def _check_values(self) -> None:
        if self.orbital_nm > 0 and self.orbital_period_s == 0:
            raise InputError("orbital_period_s", self.orbital_period_s, unit="s", allowed="above 0 with orbital_nm")

    @property
    def common_nm(self) -> float:
        """Rms of the screen by which science visits differ from references, the same in every visit."""
        return self.common_fraction * self.visit_nm

    def rms_nm(self, visit_s: float) -> float:
        """Return the rms of all terms together at the end of a visit of so many seconds, nm."""
        walk_nm = self.walk_nm_per_sqrt_hour * math.sqrt(visit_s / 3600.0)
        return math.hypot(self.visit_nm, self.common_nm, self.orbital_nm, walk_nm)

    def correlation(self, gap_s: float) -> float:
        """Return the correlation of the offsets of two visits whose starts are so many seconds apart, 0 to 1."""
        hours = self.correlation_time_h
        return math.exp(-gap_s / (3600.0 * hours)) if hours > 0 else 0.0


WINDOW_TURNS = 0.46  # of an orbit in which a star is seen: 43 of 93 minutes, between Earth's limb and its shadow's edge
ReferenceScheme = Literal["interleaved", "half", "swapped", "other_star"]


class Timing(Record):
    """The dates of the visits of a programme: how far apart, and where in the orbit their light is taken.

    A star is seen for a window of every orbit. A visit begins with a window and goes on in those of the next orbits.

    Attributes
    ----------
    scheme : {"interleaved", "half", "swapped", "other_star"}
        Where references are taken: ``interleaved`` in the same part of other orbits; ``half`` in the second half of
        each window, behind the science; ``swapped`` likewise, the order turned in every second visit; ``other_star``
        in the windows of a star that is seen a quarter of an orbit later.
    gap_s : float or None
        From the start of a visit to that of the next of its kind, s; None for visits that follow at once.
    start_turns : float or None
        Phase of the orbital term where a window opens, in turns; None where nobody knows it: drawn for every
        realisation.
    window_turns : float
        Length of a window in orbits, above 0, to 1.

    Raises
    ------
    InputError
        For a value out of range.
    """

    scheme: ReferenceScheme = "interleaved"
    gap_s: float | None = None
    start_turns: float | None = None
    window_turns: float = WINDOW_TURNS

    def __post_init__(self) -> None:
        """Refuse what no programme can have."""
        check_word("scheme", self.scheme, get_args(ReferenceScheme))
        if self.gap_s is not None and not (math.isfinite(self.gap_s) and self.gap_s >= 0):
            raise InputError("gap_s", self.gap_s, unit="s", allowed="0 or more")
        if self.start_turns is not None and not math.isfinite(self.start_turns):
            raise InputError("start_turns", self.start_turns, allowed="a number of turns")
        if not 0 < self.window_turns <= 1:
            raise InputError("window_turns", self.window_turns, allowed="above 0, to 1")

    def phasors(
        self, on_source_turns: ArrayLike, *, reference: bool = False, visit: int = 0, harmonic: int = 1
    ) -> ComplexArray:
        """Return the mean of ``exp(2 pi i h t)`` between successive times on source, t in orbits after a window opens.

        Parameters
        ----------
        on_source_turns : array_like, shape (n + 1,)
            Times on source, ascending, in orbits: what of a window is over goes on in the next.
        reference : bool
            Of a reference visit, or of a science visit.
        visit : int
            Number of the visit: the order of ``swapped`` turns on it.
        harmonic : int
            h, from 1.

        Returns
        -------
        ndarray of complex, shape (n,)
        """
        first, length = 0.0, self.window_turns
        if self.scheme == "other_star" and reference:
            first = 0.25
        elif self.scheme in ("half", "swapped"):
            length /= 2.0
            turned = self.scheme == "swapped" and visit % 2 == 1
            first = length if reference != turned else 0.0
        rate = 2j * math.pi * harmonic
        times = np.asarray(on_source_turns, float)
        windows = np.floor(times / length)
        areas = (windows * np.expm1(rate * length) + np.expm1(rate * (times - windows * length))) / rate
        return np.asarray(np.exp(rate * first) * np.diff(areas) / np.diff(times))


CameraName = Literal["VIS", "NIR"]


class Channel(Record):
    """One camera and its optics.

    Attributes
    ----------
    name : {"VIS", "NIR"}
    words : str
        Name for people.
    section : str
        Dotted key of the configuration that holds its optics.
    detector : Detector or InfraredDetector
    optics : Coronagraph or NearInfrared
        Edges of cross mask and dark hole.
    pixel_scale_arcsec : float
    exposure_max_s : float
        Longest exposure of a frame.
    """

    name: CameraName
    words: str
    section: str
    detector: AnyDetector
    optics: Coronagraph | NearInfrared
    pixel_scale_arcsec: float
    exposure_max_s: float

    @property
    def multiplies(self) -> bool:
        """Whether the camera has a multiplication register, and all that comes with charge transfer."""
        return isinstance(self.detector, Detector)

    @property
    def switches(self) -> tuple[str, ...]:
        """Names of the switches of the effects of the camera."""
        return tuple(type(self.detector.switches).model_fields)

    def check_gain(self, em_gain: float) -> None:
        """Refuse a gain that the camera does not have.

        Raises
        ------
        InputError
            Unless it is a number from 1 to the largest gain of the detector.
        """
        if not 1 <= check_number("em_gain", em_gain) <= self.detector.em_gain_max:
            allowed = f"1 to {self.detector.em_gain_max:g}" if self.multiplies else "1 in the near infrared"
            raise InputError("em_gain", em_gain, allowed=allowed)


Depth = Annotated[float, Field(ge=1, le=2000)]
Width = Annotated[float, Field(ge=0.1, le=100)]
Length = Annotated[float, Field(ge=10, le=100_000)]
Brightness = Annotated[float, Field(ge=0, le=40)]
LOSS_WIDTHS = 10  # the lower end of the truncated Landau law lies at most so many widths below its mean


class PhysicalTracks(FrozenModel):
    """Straight tracks of fast charged particles through a silicon layer.

    Isotropic particles cross a layer of ``depth_um``; chords longer than ``max_length_um`` are left out. A chord L
    leaves ``mean_loss_e_um`` L on average, with Landau fluctuations of width ``loss_width_e_um`` L cut off at
    ``loss_cut`` (Landau's lambda). ``diffusion_um`` is the Gaussian sigma of the collected charge.
    """

    depth_um: Depth
    max_length_um: Length
    mean_loss_e_um: Annotated[float, Field(gt=0, le=1e5)]
    loss_width_e_um: Annotated[float, Field(ge=0, le=1e4)]
    loss_cut: Annotated[float, Field(ge=1, le=200)]
    diffusion_um: Width

    def _check_values(self) -> None:
        _check_lengths(self.depth_um, self.max_length_um)
        if self.mean_loss_e_um < LOSS_WIDTHS * self.loss_width_e_um:
            allowed = f"at most mean_loss_e_um / {LOSS_WIDTHS} = {self.mean_loss_e_um / LOSS_WIDTHS:g}"
            raise InputError("loss_width_e_um", self.loss_width_e_um, unit="e-/um", allowed=allowed)


class PaperTracks(FrozenModel):
    """Streaks as Zhu et al. 2025 describe them.

    Chords of a layer of ``depth_um``. Charge does not depend on length: exponential up to ``tail_start`` e-foldings, a
    power law of index ``tail_index`` beyond, mean ``mean_charge_e``. The Gaussian sigma across is ``width_um`` with a
    relative scatter ``width_rms``; along the streak the charge varies by ``texture_rms`` in ``texture_waves`` Fourier
    components.
    """

    depth_um: Depth
    max_length_um: Length
    mean_charge_e: Annotated[float, Field(ge=1, le=1e7)]
    tail_start: Annotated[float, Field(gt=0, le=30)]
    tail_index: Annotated[float, Field(ge=2.5, le=100)]
    width_um: Width
    width_rms: Annotated[float, Field(ge=0, le=1)]
    texture_rms: Annotated[float, Field(ge=0, le=1)]
    texture_waves: Annotated[int, Field(ge=1, le=64)]

    def _check_values(self) -> None:
        _check_lengths(self.depth_um, self.max_length_um)


class TemplateTracks(FrozenModel):
    """Tracks taken from a set of small images, turned and placed at random, scaled to a charge of the law of ``paper``.

    ``template_file`` is a FITS cube or npz file (`simulator.effects.cosmic_rays`). Without one, ``generated_tracks``
    tracks of the physical model, sampled at ``sample_um``, are made from ``generated_seed``.
    """

    template_file: str | None
    generated_tracks: Annotated[int, Field(ge=1, le=5000)]
    generated_seed: Annotated[int, Field(ge=0)]
    sample_um: Annotated[float, Field(ge=0.5, le=100)]


class CosmicRayConfig(FrozenModel):
    """Cosmic rays: how many, and what they leave.

    The rate falls from ``peak_rate_per_s_cm2`` at solar minimum by the fraction ``cycle_depth`` at maximum;
    ``orbit_factor`` scales it to the orbit.
    """

    model: Literal["physical", "paper", "template"]
    peak_rate_per_s_cm2: Annotated[float, Field(ge=0, le=1e6)]
    cycle_depth: Annotated[float, Field(ge=0, le=1)]
    cycle_minimum_year: Annotated[float, Field(ge=1700, le=2300)]
    cycle_years: Annotated[float, Field(ge=1, le=100)]
    orbit_factor: Annotated[float, Field(ge=0, le=1000)]
    physical: PhysicalTracks
    paper: PaperTracks
    template: TemplateTracks


class ExtraLight(FrozenModel):
    """Light besides the sky: at most one of three.

    ``brightness_v_mag_arcsec2`` is a surface brightness of solar colour in front of the telescope; ``rate_e_s`` a
    uniform rate per pixel on the detector; ``map_file`` a FITS map of that rate over the whole frame (BUNIT
    electron/s), one for all bands or one by band.
    """

    brightness_v_mag_arcsec2: Brightness | None = None
    rate_e_s: Annotated[float, Field(ge=0, le=1e9)] | None = None
    map_file: str | dict[str, str] | None = None

    def _check_values(self) -> None:
        given = [name for name, value in self if value is not None]
        if len(given) > 1:
            raise InputError(given[1], f"given with {given[0]}", allowed="one of the two")

    def map_of(self, band: str) -> str | None:
        """Return the name of the map of a band, None if none is set.

        Raises
        ------
        InputError
            If there are maps by band and none for this one.
        """
        if not isinstance(self.map_file, dict):
            return self.map_file
        if band not in self.map_file:
            allowed = f"a map of each band, or of {band} at least"
            hint = f"there are maps of {', '.join(self.map_file) or 'no band'}"
            raise InputError("map_file", f"no map of {band}", allowed=allowed, hint=hint)
        return self.map_file[band]


class SkyConfig(FrozenModel):
    """Light of the sky, and what earthshine and stray light add.

    ``model`` is ``zodiacal``, by place, or ``uniform`` of solar colour and ``brightness_v_mag_arcsec2`` everywhere.
    ``season`` of the zodiacal light is ``median``, over the days of a year on which the target is at least
    ``sun_limit_deg`` from the Sun, or ``date``, that of the observation.

    ``exozodi_zodis`` is the dust assumed around every target, in units of the solar system's, in a disc seen face-on:
    22 mag/arcsec2 in V at 1 au of a solar twin, in proportion to the star's V light and ``r^-2``. Predictions count it
    and confirmations show it; a scene of one's own has the discs that it names.
    """

    model: Literal["zodiacal", "uniform"]
    season: Literal["median", "date"]
    sun_limit_deg: Annotated[float, Field(ge=0, le=90)]
    brightness_v_mag_arcsec2: Brightness
    exozodi_zodis: Annotated[float, Field(ge=0, le=1e5)]
    earthshine: ExtraLight
    stray_light: ExtraLight


_ONLY_WITH = {"brightness_v_mag_arcsec2": "uniform", "season": "zodiacal"}
_NO_LIGHT: dict[str, Any] = dict.fromkeys(ExtraLight.model_fields)


def own_sky(own: Mapping[str, Any], base: Mapping[str, Any]) -> dict[str, Any]:
    """Return a section ``sky`` as it is laid over that of another instrument.

    A number or map of earthshine or stray light replaces whatever the other instrument has for it. A uniform sky in
    place of a zodiacal one is all the light there is: earthshine comes with it only where it is given.

    Parameters
    ----------
    own, base : mapping
        The section as it was given, and that of the other instrument; values may have their sources.

    Raises
    ------
    InputError
        For a new value of a key that the model does not read, which would change nothing.
    """
    model = bare_value(own.get("model", base["model"]))
    for key, reader in _ONLY_WITH.items():
        if (
            key in own
            and model != reader
            and model in _ONLY_WITH.values()
            and bare_value(own[key]) != bare_value(base[key])
        ):
            value = bare_value(own[key])
            raise InputError(f"sky.{key}", value, allowed=f"only with sky.model: {reader}", hint=f"it is {model}")
    lights = {key: own[key] for key in ("earthshine", "stray_light") if isinstance(own.get(key), Mapping)}
    alone = {"earthshine": _NO_LIGHT} if model == "uniform" != bare_value(base["model"]) else {}
    return {**alone, **own, **{key: {**_NO_LIGHT, **light} if light else light for key, light in lights.items()}}


def _check_lengths(depth_um: float, max_length_um: float) -> None:
    if max_length_um <= depth_um:
        raise InputError("max_length_um", max_length_um, unit="um", allowed=f"above depth_um = {depth_um:g}")


_ORIGIN = ("unit", "source", "confidence", "range", "note")
_MAPS = ("map_file", "template_file", "transmission_file", "surface_files", "calibration_files")
_FILE_KEYS = ("apodizer", "table", "psf", *_MAPS)
ARCSEC_PER_RAD = 180.0 * 3600.0 / math.pi

Fraction = Annotated[float, Field(ge=0, le=1)]


class BandConfig(FrozenModel):
    """One band: top-hat of ``width_nm`` around ``center_nm``, or a file of transmissions, from which both follow."""

    camera: CameraName = "VIS"
    center_nm: Annotated[float, Field(ge=300, le=1750)]
    width_nm: Annotated[float, Field(gt=0, le=1000)]
    t_opt: Annotated[float, Field(gt=0, le=1)]
    qe: Annotated[float, Field(gt=0, le=1)]
    transmission_file: str | None = None


class Instrument(FrozenModel, Sourced):
    """The whole instrument; frozen, hashed by content.

    ``provenance`` tells, per dotted key, where the number comes from and how sure it is.
    """

    name: str
    telescope: Telescope
    coronagraph: Coronagraph
    near_infrared: NearInfrared
    wavefront: WavefrontConfig
    mirror: MirrorConfig
    dark_hole: DarkHoleConfig
    drift: Drift
    detector: Detector
    cosmic_rays: CosmicRayConfig
    sky: SkyConfig
    bands: dict[str, BandConfig]
    overhead_s: Annotated[float, Field(ge=0, le=1e6)]
    mission: MissionConfig

    def _check_values(self) -> None:
        for key in ("coronagraph.inner_arcsec", "dark_hole.surface_files", "dark_hole.sensing_contrast_by_band"):
            section, _, field = key.partition(".")
            for name in getattr(getattr(self, section), field):
                if name not in self.bands:
                    raise InputError(key, name, allowed=f"names of bands: {', '.join(self.bands)}")
        self._check_table()
        least = 1.0 if self.coronagraph.table is None else 0.5
        for name, band in self.bands.items():
            section = self.channel(band.camera).section
            aperture, pixel = self.aperture_radius_arcsec(name), self.pixel_scale_arcsec(name)
            if not least <= aperture / pixel <= 20.0:
                allowed = f"{least:g} to 20 pixels in the aperture radius of {name}, not {aperture / pixel:.3g}"
                raise InputError("pixel_scale_arcsec", pixel, unit="arcsec", allowed=allowed)
            if self.coronagraph.is_ring:
                continue
            inner = self.hole_inner_arcsec(name) + 2 * aperture
            if inner >= self.hole_outer_arcsec(name):
                key, outer = f"{section}.outer_half_side_arcsec", self.hole_outer_arcsec(name)
                allowed = f"room for an aperture in the hole of {name}: above {inner:.3g}"
                raise InputError(key, outer, unit="arcsec", allowed=allowed)

    def _check_table(self) -> None:
        """Refuse what an optical model without a table does not know, and tables of bands that are not there."""
        named, telescope = self.coronagraph.table, self.telescope
        if named is None:
            for key in ("obstruction_diameter_ratio", "area_m2"):
                if getattr(telescope, key):
                    hint = "the optical model has a clear disc; give the coronagraph as coronagraph.table"
                    raise InputError(f"telescope.{key}", getattr(telescope, key), allowed="not given", hint=hint)
            return
        for band in () if isinstance(named, str) else named:
            if band not in self.bands:
                raise InputError(TABLE_KEY, band, allowed=f"names of bands: {', '.join(self.bands)}")
        for band in self.bands:
            self.table(band)

    def table(self, band: str) -> CoronagraphTable | None:
        """Return the table of the coronagraph in a band; None where the optics are modelled.

        Raises
        ------
        InputError
            As `simulator.config.coronagraph.coronagraph_table`; if the tables lack the band.
        """
        named = self.coronagraph.table
        if named is None:
            return None
        if not isinstance(named, str) and band not in named:
            raise InputError(TABLE_KEY, ", ".join(named), allowed=f"a table for every band, {band} has none")
        own, unit = self.coronagraph, self.lambda_d_arcsec(band)
        diameter = own.diameter_m or self.telescope.diameter_m
        return coronagraph_table(
            named if isinstance(named, str) else named[band],
            unit * self.telescope.diameter_m / diameter,
            diameter_m=diameter,
            is_stated=own.diameter_m is not None,
            aperture_arcsec=own.aperture_radius_lambda_d * unit,
            star_diameter_mas=own.star_diameter_mas,
        )

    def band(self, name: str) -> BandConfig:
        """Return the configuration of one band.

        Raises
        ------
        InputError
            If the instrument has no such band.
        """
        if not isinstance(name, str) or name not in self.bands:
            raise InputError("band", name, allowed=", ".join(self.bands))
        return self.bands[name]

    def channel(self, camera: str) -> Channel:
        """Return one camera, ``VIS`` or ``NIR``, with its optics."""
        own, optics, longest = self.detector, self.near_infrared, self.detector.exposure_max_s
        if camera == "VIS":
            return Channel("VIS", "visible", "coronagraph", own, self.coronagraph, own.pixel_scale_arcsec, longest)
        scale = optics.pixel_scale_arcsec
        return Channel("NIR", "near-infrared", "near_infrared", optics.detector, optics, scale, longest)

    def channel_of(self, band: str) -> Channel:
        """Return the camera of a band with its optics."""
        return self.channel(self.band(band).camera)

    def switched(self, switches: Mapping[str, bool] | None, *, camera: str | None = None) -> "Instrument":
        """Return this instrument with effects of its cameras switched on or off, by name, in each camera that has them.

        Parameters
        ----------
        switches : mapping of str to bool, optional
            Effects by the name of their switch.
        camera : {"VIS", "NIR"}, optional
            Camera that has to have them; either if not given.

        Raises
        ------
        InputError
            For a name that is no switch, or a value that is neither true nor false.
        """
        if switches is None:
            return self
        if not isinstance(switches, Mapping):
            raise InputError("switches", switches, allowed="a mapping of effects to true or false")
        if not switches:
            return self
        wanted = [self.channel("VIS"), self.channel("NIR")] if camera is None else [self.channel(camera)]
        known = sorted({name for channel in wanted for name in channel.switches})
        for name in switches:
            if name not in known:
                hint = "" if camera is None else f"the switches of the {wanted[0].words} camera"
                raise InputError("switches", name, allowed=", ".join(known), hint=hint)
        if not all(isinstance(value, bool) for value in switches.values()):
            raise InputError("switches", switches, allowed="a mapping of effects to true or false")
        infrared = self.near_infrared.detector.with_switches(switches)
        optics = self.near_infrared.model_copy(update={"detector": infrared})
        return self.model_copy(update={"detector": self.detector.with_switches(switches), "near_infrared": optics})

    def changed(self, own: Mapping[str, Any]) -> "Instrument":
        """Return the instrument with a mapping of what differs, as in an instrument's file, laid over it.

        Raises
        ------
        InputError
            Naming key, value, unit and allowed range of the first fault.
        """
        plain, provenance = split_sourced(dict(own))
        plain = _with_own_sky(_with_curves(plain), self.sky.model_dump())
        values = deep_merge(self.model_dump() | {"name": f"{self.name}+changes"}, plain)
        new = validate(Instrument, values, where="instrument")
        kept = {key: item for key, item in self._provenance.items() if not _within(plain, key)}
        new._provenance.update(kept | provenance)
        return new

    def visible_bands(self) -> tuple[str, ...]:
        """Return the names of the bands of the visible camera, by wavelength."""
        names = [name for name, band in self.bands.items() if band.camera == "VIS"]
        return tuple(sorted(names, key=lambda name: self.bands[name].center_nm))

    def lambda_d_arcsec(self, band: str) -> float:
        """Return the lambda/D at band centre."""
        return self.band(band).center_nm * 1e-9 / self.telescope.diameter_m * ARCSEC_PER_RAD

    def hole_inner_arcsec(self, band: str) -> float:
        """Return the inner edge ``a`` of the square zone, per axis; inner radius of a ring."""
        if (table := self._ring_table(band)) is not None:
            # A planet may stand at every separation of the table: its aperture reaches beyond.
            return float(table.separation_arcsec[0]) - self.aperture_radius_arcsec(band)
        corner = self.coronagraph.inner_arcsec.get(band)
        if corner is None:
            corner = self.coronagraph.inner_lambda_d * self.lambda_d_arcsec(band)
        return corner / math.sqrt(2.0)

    def hole_outer_arcsec(self, band: str) -> float:
        """Return the outer edge ``b`` of the square zone, per axis; outer radius of a ring."""
        if (table := self._ring_table(band)) is not None:
            return float(table.separation_arcsec[-1]) + self.aperture_radius_arcsec(band)
        return self.channel_of(band).optics.outer_half_side_arcsec

    def psf_file(self, band: str) -> str | None:
        """Return the file of the point-spread functions of a table's band; None where there is none."""
        named = self.coronagraph.psf
        return named.get(band) if isinstance(named, dict) else named

    def _ring_table(self, band: str) -> CoronagraphTable | None:
        return self.table(band) if self.coronagraph.is_ring else None

    def mask_half_width_arcsec(self, band: str) -> float:
        """Return half of the width of the bars of the cross; 0 where a table has a ring."""
        return 0.0 if self.coronagraph.is_ring else self.channel_of(band).optics.mask_half_width_arcsec

    def pixel_scale_arcsec(self, band: str) -> float:
        """Return the pixel of the band's camera."""
        return self.channel_of(band).pixel_scale_arcsec

    def detector_of(self, band: str) -> AnyDetector:
        """Return the detector of the band's camera."""
        return self.channel_of(band).detector

    def aperture_radius_arcsec(self, band: str) -> float:
        """Return the radius of the photometric aperture: that of the core of a table that has its area."""
        table = self.table(band)
        if table is not None and table.core_radius_arcsec is not None:
            return table.core_radius_arcsec
        return self.coronagraph.aperture_radius_lambda_d * self.lambda_d_arcsec(band)

    def aperture_pixels(self, band: str) -> float:
        """Return the area of the photometric aperture in pixels."""
        return math.pi * (self.aperture_radius_arcsec(band) / self.pixel_scale_arcsec(band)) ** 2


InstrumentLike: TypeAlias = Instrument | Mapping[str, Any] | str | Path | None
"""What the functions of the package take for an instrument; None is the default preset."""


@by_line
def load_instrument(source: str | Path | Mapping[str, Any] | None = None) -> Instrument:
    """Load an instrument.

    Parameters
    ----------
    source : str, Path, mapping or None
        Preset name, YAML path, or mapping; ``None`` is the default preset ``cpic_default``. A file or mapping
        needs to hold only what differs from its ``base`` (a preset name, ``cpic_default`` if absent). Files that it
        names (apodizer, mirror surfaces, band curves) are looked for beside it first.

    Returns
    -------
    Instrument

    Raises
    ------
    InputError
        Naming key, value, unit and allowed range of the first fault.

    Examples
    --------
    >>> from simulator import load_instrument
    >>> load_instrument({"detector": {"read_noise_e": 160}}).detector.read_noise_e
    160.0
    """
    if source is None or (isinstance(source, str | Path) and preset_path("instrument", str(source)) is not None):
        return _preset("cpic_default" if source is None else str(source))
    return Instrument.read(_tree(source), "instrument")


@functools.lru_cache(maxsize=16)
def _preset(name: str) -> Instrument:
    """Return a preset, read once: nobody can change it."""
    return Instrument.read(_preset_tree(name), "instrument")


def _tree(source: str | Path | Mapping[str, Any]) -> dict[str, Any]:
    if isinstance(source, Mapping):
        own = dict(source)
    elif not isinstance(source, str | Path):
        raise InputError("instrument", source, allowed="a mapping, a YAML file or a preset")
    else:
        known = preset_path("instrument", str(source))
        if known is None and not is_file(source):
            hint = f"presets: {', '.join(preset_names('instrument'))}"
            raise InputError("instrument", str(source), allowed="a YAML file or a preset", hint=hint)
        path = Path(known or source)
        own = paths_beside(load_mapping(path, "instrument", Instrument.model_fields), path.parent)
        if known is not None and not {"bands", "base"} & set(own):
            own["bands"] = _shipped_bands()
    if own.pop("kind", "instrument") != "instrument":
        raise InputError("instrument", str(source), allowed="a file of kind: instrument")
    if "base" in own or isinstance(source, Mapping) or preset_path("instrument", str(source)) is None:
        base = own.pop("base", "cpic_default")
        if preset_path("instrument", str(base)) is None:
            raise InputError("base", base, allowed=", ".join(preset_names("instrument")))
        shipped = _preset_tree(str(base))
        own = _with_own_sky(_with_curves(own), shipped["sky"])
        merged = deep_merge(shipped, _plain_over_sourced(shipped, own))
        merged["name"] = own.get("name", f"{base}+changes" if own else base)
        drop_bands(own, merged)
        if isinstance(own.get("detector"), Mapping):
            assume_converter(own["detector"], shipped["detector"], merged["detector"])
        return merged
    # Effects may bring defaults of their own.
    brought = {"detector": chain_preset(VISIBLE), "near_infrared": {"detector": chain_preset(INFRARED)}}
    return deep_merge(brought, own)


_preset_tree = functools.lru_cache(maxsize=16)(_tree)  # of names; nobody changes what it returns


def _with_own_sky(own: dict[str, Any], base: Mapping[str, Any]) -> dict[str, Any]:
    """Return what is laid over an instrument, with its section ``sky`` made ready for that."""
    return own | {"sky": own_sky(own["sky"], base)} if isinstance(own.get("sky"), Mapping) else own


def _with_curves(own: Mapping[str, Any]) -> dict[str, Any]:
    """Return what is laid over an instrument; bands with a file have its curve's centre and width if they name none."""
    bands = dict(own["bands"]) if isinstance(own.get("bands"), Mapping) else {}
    for name, band in bands.items():
        file = band.get("transmission_file") if isinstance(band, Mapping) else None
        if isinstance(file, str) and not {"center_nm", "width_nm"} <= band.keys():
            curve = band_from_file(file, name, t_opt=1.0, qe=1.0)
            bands[name] = {"center_nm": round(curve.center_nm, 6), "width_nm": round(curve.width_nm, 6), **band}
    return {**own, "bands": bands} if bands else dict(own)


def _within(tree: Any, key: str) -> bool:
    """Return whether a tree holds a value for a dotted key."""
    for part in key.split("."):
        if not isinstance(tree, Mapping):
            return True
        if part not in tree:
            return False
        tree = tree[part]
    return True


def paths_beside(tree: Any, folder: Path, key: str = "") -> Any:
    """Return the names of maps and curves that exist beside the instrument's file, made whole.

    Parameters
    ----------
    tree : object
        Plain data of a configuration.
    folder : Path
    key : str, optional
        Name that a refusal gives.
    """
    if isinstance(tree, dict):
        inherits = key in _FILE_KEYS
        return {name: paths_beside(item, folder, key if inherits else name) for name, item in tree.items()}
    if key in _FILE_KEYS and isinstance(tree, str) and (is_file(folder / tree) or is_package(str(folder / tree))):
        return str(folder / tree)
    return tree


def _shipped_bands() -> dict[str, Any]:
    """Return the catalogue's bands as a sourced tree: the numbers live there and nowhere else."""
    provenance = band_provenance()
    tree: dict[str, Any] = {}
    for name, band in load_bands().items():
        entry: dict[str, Any] = {"camera": band.camera}
        for key in ("center_nm", "width_nm", "t_opt", "qe"):
            entry[key] = {"value": getattr(band, key)}
            standing = provenance.get(f"{name}.{key}")
            if standing is not None:
                entry[key] |= {origin: getattr(standing, origin) for origin in _ORIGIN}
        tree[name] = entry
    return tree


def _plain_over_sourced(base: Any, own: Any) -> Any:
    """Mark a user's plain number over a sourced default as replaced, so that no stale source clings to it."""
    if isinstance(base, Mapping) and "value" in base and not isinstance(own, Mapping):
        unit = base.get("unit", "")
        return {"value": own, "unit": unit, "source": "user", "confidence": "A", "range": None, "note": ""}
    if isinstance(base, Mapping) and isinstance(own, Mapping):
        return {key: _plain_over_sourced(base.get(key), item) for key, item in own.items()}
    return own
