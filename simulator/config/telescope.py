"""Mission, wavefront and channels as configuration: dates, orbit, labels, mirror, dark hole, drift and cameras.

One camera of the instrument with what is in front of it: what differs between the channels, said once.
"""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import date, datetime
from typing import Annotated, Any, Literal, get_args

import numpy as np
from pydantic import AfterValidator, Field, ValidationInfo

from cpic_core import ArrayLike, ComplexArray, InputError, check_number, check_word, load_quietly
from simulator.config.base import FrozenModel
from simulator.config.detector import AnyDetector, Detector, InfraredDetector


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
    separation (`simulator.config.coronagraph_table`). Planets are then looked for in a ``ring`` that holds the
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
    """The deformable mirror; see `simulator.imaging.deformable_mirror.DeformableMirror`."""

    n_actuators: Annotated[int, Field(ge=4, le=128)]
    span_diameters: Annotated[float, Field(ge=0.5, le=1.5)]
    coupling: Annotated[float, Field(ge=0.01, le=0.5)]
    stroke_nm: Annotated[float, Field(gt=0, le=1e5)]
    bits: Annotated[int, Field(ge=8, le=32)] | None
    noise_nm: Annotated[float, Field(ge=0, le=100)]
    dead: tuple[tuple[int, int], ...]


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


@dataclass(frozen=True)
class Timing:
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


@dataclass(frozen=True)
class Channel:
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
