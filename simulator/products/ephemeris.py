"""The times of frames, the orbit of the telescope, and its angles from Sun, Moon and the limb of the Earth.

Where the telescope is: a circular orbit about an oblate Earth. A model; it follows no ephemeris.

Where the telescope is and what it sees: state vectors, angles from Sun, Moon and the limb of the Earth.
"""

import contextlib
import math
import re
import warnings
from collections.abc import Iterator
from typing import Any

import numpy as np

from cpic_core import ArrayLike, FloatArray, Record, load_quietly
from simulator.config import OrbitConfig, checked_utc


class SequenceTimes(Record, eq=False):
    """Begin and end of every exposure of a sequence.

    Attributes
    ----------
    begin_utc, end_utc : tuple of str
        ISO 8601 to the microsecond.
    begin_mjd, end_mjd : ndarray
        Modified Julian Date, UTC.
    """

    begin_utc: tuple[str, ...]
    end_utc: tuple[str, ...]
    begin_mjd: FloatArray
    end_mjd: FloatArray

    def each(self) -> Iterator["SequenceTimes"]:
        """Yield each exposure as a sequence of its own."""
        for one in (slice(row, row + 1) for row in range(len(self.begin_utc))):
            yield SequenceTimes(self.begin_utc[one], self.end_utc[one], self.begin_mjd[one], self.end_mjd[one])

    @property
    def start_utc(self) -> str:
        """Begin of the first exposure."""
        return self.begin_utc[0]

    @property
    def stop_utc(self) -> str:
        """End of the last exposure; the readout that follows is not part of it."""
        return self.end_utc[-1]

    @property
    def day(self) -> int:
        """Modified Julian Date of the begin, whole days."""
        return math.floor(float(self.begin_mjd[0]))


@contextlib.contextmanager
def offline_time() -> Iterator[None]:
    """Use astropy's clocks and ephemerides without network and without its warnings about the far future.

    Leap seconds that nobody has announced yet cannot be in any table.
    """
    from astropy.utils import iers

    with iers.conf.set_temp("auto_download", False), warnings.catch_warnings():
        warnings.simplefilter("ignore", load_quietly("erfa").ErfaWarning)
        warnings.filterwarnings("ignore", message="leap-second")
        warnings.simplefilter("ignore", iers.IERSStaleWarning)
        yield


def sequence_times(start_utc: str, exposure_s: float, readout_s: float, n_frames: int) -> SequenceTimes:
    """Begin and end of every exposure.

    Parameters
    ----------
    start_utc : str
        Begin of the first exposure.
    exposure_s, readout_s : float
        Frame ``i`` begins ``i * (exposure_s + readout_s)`` later.
    n_frames : int
        Frames.

    Raises
    ------
    InputError
        If ``start_utc`` is no time, or the last frame ends after the last year that a time may have.
    """
    begin_s = np.arange(n_frames, dtype=np.float64) * (exposure_s + readout_s)
    return times_after(start_utc, begin_s, begin_s + exposure_s)


def times_after(start_utc: str, begin_s: FloatArray, end_s: FloatArray) -> SequenceTimes:
    """Return the begins and ends that are given in seconds after a time.

    Parameters
    ----------
    start_utc : str
    begin_s, end_s : ndarray, shape (n,)
        Seconds after it, the last one last.

    Raises
    ------
    InputError
        As `sequence_times`.
    """
    from astropy.time import Time, TimeDelta

    with offline_time():
        first = Time(checked_utc("start_utc", start_utc), format="isot", scale="utc", precision=6)

        def after(seconds: FloatArray) -> Any:
            return first + TimeDelta(seconds, format="sec", scale="tai")

        begins, ends = after(begin_s), after(end_s)
        checked_utc("end of the last frame", str(ends[-1].isot))
        begin_utc, end_utc = (tuple(times.isot.tolist()) for times in (begins, ends))
        return SequenceTimes(begin_utc, end_utc, np.asarray(begins.mjd), np.asarray(ends.mjd))


def mjd_of(utc: str) -> float:
    """Return the Modified Julian Date of a time of UTC."""
    from astropy.time import Time

    with offline_time():
        return float(Time(utc, format="isot", scale="utc").mjd)


def elapsed_s(begin_mjd: float, end_mjd: float) -> float:
    """Return the seconds between two Modified Julian Dates of UTC, leap seconds counted.

    Parameters
    ----------
    begin_mjd : float
        Begin, MJD (UTC).
    end_mjd : float
        End, MJD (UTC).
    """
    from astropy.time import Time

    with offline_time():
        begin, end = (Time(mjd, format="mjd", scale="utc") for mjd in (begin_mjd, end_mjd))
        return float((end - begin).to_value("s"))


def stamp(utc: str) -> str:
    """Return the fourteen digits ``YYYYMMDDhhmmss`` of an ISO time; the fraction is cut off."""
    return re.sub(r"\D", "", utc[:19])


# WGS 84: equatorial radius (km), gravity (km3/s2) and oblateness of the Earth.
EARTH_RADIUS_KM = 6378.137
_GM_KM3_S2 = 398600.4418
_J2 = 1.08262668e-3


class CircularOrbit(Record):
    """A circular orbit whose node drifts.

    Position in the equatorial inertial frame, ``R_z(node) R_x(inclination) (a cos u, a sin u, 0)`` with the angle ``u``
    from the node at Kepler's rate and the node at the secular rate of the Earth's oblateness,
    ``-3/2 n J2 (R/a)^2 cos i``.
    """

    config: OrbitConfig

    @property
    def radius_km(self) -> float:
        """Distance from the centre of the Earth."""
        return EARTH_RADIUS_KM + self.config.altitude_km

    @property
    def period_s(self) -> float:
        """Period of revolution."""
        return 2.0 * math.pi / self._motion_rad_s

    @property
    def _motion_rad_s(self) -> float:
        return math.sqrt(_GM_KM3_S2 / self.radius_km**3)

    @property
    def node_rate_deg_day(self) -> float:
        """Drift of the node."""
        return math.degrees(self._node_rate_rad_s) * 86400.0

    @property
    def _node_rate_rad_s(self) -> float:
        flattening = _J2 * (EARTH_RADIUS_KM / self.radius_km) ** 2
        return -1.5 * self._motion_rad_s * flattening * math.cos(math.radians(self.config.inclination_deg))

    def plane(self, elapsed_s: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return the axes of the plane of the orbit.

        Parameters
        ----------
        elapsed_s : array_like, shape (n,)
            Seconds since the epoch of the orbit.

        Returns
        -------
        towards_node, ahead : ndarray, shape (n, 3)
            Unit vectors to the ascending node, and a quarter of a revolution ahead of it.
        """
        node = math.radians(self.config.node_deg) + self._node_rate_rad_s * np.asarray(elapsed_s, dtype=np.float64)
        tilt = math.radians(self.config.inclination_deg)
        towards_node = np.stack([np.cos(node), np.sin(node), np.zeros_like(node)], axis=-1)
        up, flat = np.full_like(node, math.sin(tilt)), math.cos(tilt)
        ahead = np.stack([-np.sin(node) * flat, np.cos(node) * flat, up], axis=-1)
        return towards_node, ahead

    def state(self, elapsed_s: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return the position and velocity.

        Parameters
        ----------
        elapsed_s : array_like, shape (n,)
            Seconds since the epoch of the orbit.

        Returns
        -------
        position_km, velocity_km_s : ndarray, shape (n, 3)
        """
        elapsed = np.asarray(elapsed_s, dtype=np.float64)
        along = math.radians(self.config.phase_deg) + self._motion_rad_s * elapsed
        towards_node, ahead = self.plane(elapsed)
        cosine, sine = np.cos(along)[..., None], np.sin(along)[..., None]
        position = self.radius_km * (cosine * towards_node + sine * ahead)
        velocity = self.radius_km * self._motion_rad_s * (cosine * ahead - sine * towards_node)
        # The drift of the node turns the whole orbit about the axis of the Earth.
        turn = self._node_rate_rad_s * np.stack([-position[..., 1], position[..., 0], np.zeros_like(along)], axis=-1)
        return position, velocity + turn


def earth_radius_deg(distance_km: ArrayLike) -> FloatArray:
    """Return the angular radius of the solid Earth from a distance of its centre."""
    return np.rad2deg(np.arcsin(EARTH_RADIUS_KM / np.asarray(distance_km, dtype=np.float64)))


class Ephemeris(Record, eq=False):
    """State of the telescope and angles of the target at several times, all from a modelled orbit.

    Attributes
    ----------
    position_km, velocity_km_s : ndarray, shape (n, 3)
        Geocentric, axes of the GCRS.
    sun_deg, moon_deg : ndarray, shape (n,), or None
        Angle of the target from Sun and Moon as seen from the telescope; None without a target.
    limb_deg : ndarray, shape (n,), or None
        Height of the target over the limb of the solid Earth; negative: behind it.
    """

    position_km: FloatArray
    velocity_km_s: FloatArray
    sun_deg: FloatArray | None = None
    moon_deg: FloatArray | None = None
    limb_deg: FloatArray | None = None


def ephemeris(orbit: OrbitConfig, utc: tuple[str, ...], target_deg: tuple[float, float] | None) -> Ephemeris:
    """Return the telescope and target at some times.

    Parameters
    ----------
    orbit : OrbitConfig
    utc : tuple of str
        Times, ISO 8601.
    target_deg : tuple of float or None
        Right ascension and declination.

    Notes
    -----
    Sun and Moon are those of astropy's built-in ephemeris (ERFA); nothing is fetched. The aberration of the target's
    light (0.01 deg) is neglected.
    """
    from astropy.time import Time

    with offline_time():
        times = Time(list(utc), format="isot", scale="utc")
        elapsed = (times - Time(orbit.epoch_utc, format="isot", scale="utc")).to_value("s")
        position, velocity = CircularOrbit(orbit).state(elapsed)
        if target_deg is None:
            return Ephemeris(position, velocity)
        ra, dec = np.deg2rad(target_deg)
        target = np.array([np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)])

        def angle_from(body: str) -> FloatArray:
            return _angle_deg(body_km(body, times) - position, target)

        distance = np.linalg.norm(position, axis=-1)
        limb = _angle_deg(-position, target) - earth_radius_deg(distance)
        return Ephemeris(position, velocity, angle_from("sun"), angle_from("moon"), limb)


def body_km(body: str, times: Any) -> FloatArray:
    """Return the geocentric place of a body of the solar system, axes of the GCRS, by astropy's built-in ephemeris.

    Parameters
    ----------
    body : str
        ``"sun"`` or ``"moon"``.
    times : astropy.time.Time, shape (n,)
        Made, like this call, inside of `simulator.products.ephemeris.offline_time`.

    Returns
    -------
    ndarray, shape (n, 3)
    """
    from astropy.coordinates import get_body

    place: Any = get_body(body, times, ephemeris="builtin").cartesian.xyz.to_value("km")
    return np.asarray(place.T, dtype=np.float64)


def _angle_deg(vectors: FloatArray, direction: FloatArray) -> FloatArray:
    """Return the angle between vectors and a unit vector, exact near 0 and 180 degrees too."""
    across = np.linalg.norm(np.cross(vectors, direction), axis=-1)
    result: FloatArray = np.rad2deg(np.arctan2(across, vectors @ direction))
    return result
