"""The mission as configuration: when observations begin, where the telescope is, and how products are labelled.

The optics as configuration: coronagraph, near-infrared channel, static wavefront, mirror, dark hole, drift.

One camera of the instrument with what is in front of it: what differs between the channels, said once.
"""

import re
from dataclasses import dataclass
from datetime import date, datetime
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, ValidationInfo

from cpic_core import InputError, check_number, load_quietly
from simulator.config.base import FrozenModel
from simulator.config.detector import AnyDetector, Detector, InfraredDetector

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
    """Whether a leap second was put behind a day: the table names the months that begin behind one."""
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


class Coronagraph(FrozenModel):
    """Apodizer, focal-plane mask and dark-hole geometry (squares, one per quadrant).

    The controlled zone of a band is ``a <= |x|, |y| <= b`` with ``a = inner_lambda_d / sqrt2`` in units of
    lambda/D and ``b = outer_half_side_arcsec``. ``inner_arcsec`` gives the diagonal separation of the inner corner
    of single bands in arcsec instead. ``apodizer_samples`` averages a measured map over a grid that fits the pupil's.
    """

    apodizer: str
    apodizer_kind: Literal["amplitude", "intensity"]
    apodizer_samples: Annotated[int, Field(ge=8, le=2048, multiple_of=2)] | None
    mask_half_width_arcsec: Annotated[float, Field(ge=0, le=2)]
    inner_lambda_d: Annotated[float, Field(ge=1, le=20)]
    inner_arcsec: dict[str, Annotated[float, Field(gt=0, le=4)]]
    outer_half_side_arcsec: Annotated[float, Field(gt=0, le=1)]
    aperture_radius_lambda_d: Annotated[float, Field(ge=0.2, le=5)]


class NearInfrared(FrozenModel):
    """What differs in the near-infrared channel: pixel, cross, outer edge of the hole, and its camera."""

    pixel_scale_arcsec: Annotated[float, Field(gt=0, le=1)]
    mask_half_width_arcsec: Annotated[float, Field(ge=0, le=4)]
    outer_half_side_arcsec: Annotated[float, Field(gt=0, le=3)]
    detector: InfraredDetector


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
    """How the mirror is set.

    ``control`` is ``conjugation`` (a new Jacobian at every step, with perfect knowledge of the field),
    ``single_jacobian`` (one Jacobian of the design: the less ideal state), ``surface`` (maps loaded from
    ``surface_files``, one per band), or ``off`` (the mirror stays flat). Mode ``2q`` darkens the two quadrants on
    ``side`` of the star on the detector. ``hold_star`` keeps tip and tilt out of the search: positions are measured
    from the star, and a search that may point the telescope moves the star away from its hole.
    """

    control: Literal["conjugation", "single_jacobian", "surface", "off"]
    mode: Literal["4q", "2q"]
    side: Literal["right", "left", "top", "bottom"]
    bandwidth: Annotated[float, Field(ge=0, le=0.5)]
    hold_star: bool
    surface_files: dict[str, str]

    def _check_values(self) -> None:
        if bool(self.surface_files) != (self.control == "surface"):
            raise InputError("control", self.control, allowed="surface with surface_files, any other without")


class Drift(FrozenModel):
    """Wavefront drift between and within visits; power spectrum of the phase screens ``f^-psd_slope``."""

    visit_nm: Annotated[float, Field(ge=0, le=100)]
    walk_nm_per_sqrt_hour: Annotated[float, Field(ge=0, le=100)]
    psd_slope: Annotated[float, Field(ge=0, le=6)]


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
