"""Times of frames: UTC by way of atomic time, so that a leap second is a second like any other."""

from __future__ import annotations

import contextlib
import math
import re
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simulator.config.mission import checked_utc
from simulator.lazy import load_quietly

__all__ = ["SequenceTimes", "elapsed_s", "mjd_of", "offline_time", "sequence_times", "stamp"]

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SequenceTimes:
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
    from astropy.time import Time, TimeDelta

    with offline_time():
        begin = np.arange(n_frames, dtype=np.float64) * (exposure_s + readout_s)
        first = Time(checked_utc("start_utc", start_utc), format="isot", scale="utc", precision=6)

        def after(seconds: FloatArray) -> Any:
            return first + TimeDelta(seconds, format="sec", scale="tai")

        begins, ends = after(begin), after(begin + exposure_s)
        checked_utc("end of the last frame", str(ends[-1].isot))
        return SequenceTimes(
            tuple(begins.isot.tolist()), tuple(ends.isot.tolist()), np.asarray(begins.mjd), np.asarray(ends.mjd)
        )


def mjd_of(utc: str) -> float:
    """Modified Julian Date of a time of UTC."""
    from astropy.time import Time

    with offline_time():
        return float(Time(utc, format="isot", scale="utc").mjd)


def elapsed_s(begin_mjd: float, end_mjd: float) -> float:
    """Seconds between two Modified Julian Dates of UTC, leap seconds counted.

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
    """Fourteen digits ``YYYYMMDDhhmmss`` of an ISO time; the fraction is cut off."""
    return re.sub(r"\D", "", utc[:19])
