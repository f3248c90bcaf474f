"""The calendar of a survey: when each star can be seen, and what a visit costs of the telescope's time."""

import math
from dataclasses import replace

import numpy as np

from cpic_core import FloatArray, IntArray, Record
from cpic_planner.etc import EtcModel
from cpic_planner.survey.detection import Setting
from cpic_planner.survey.strategy import Revisits, UniverseConfig
from cpic_planner.survey.visibility import Visibility, VisibilityConfig, bodies_km, slew_s, visibility
from cpic_planner.targets import Targets
from simulator.config import Instrument
from simulator.products import mjd_of

_SAMPLES = 6
_MEAN_SLEW_DEG = 60.0
_HOUR_S = 3600.0


class Sight(Record, eq=False):
    """A star as the telescope sees it in some times, arrays of any shape: what telescope time is counted by.

    Attributes
    ----------
    fraction : ndarray
        Part of an orbit in which the star is seen, mean over the days on which it may be pointed at.
    allowed_h : ndarray
        Hours of those days.
    window_s : ndarray
        Longest time without interruption, mean over those days.
    settle_h : float
        A mean slew with all that follows it.
    """

    fraction: FloatArray
    allowed_h: FloatArray
    window_s: FloatArray
    settle_h: float

    @classmethod
    def of(cls, seen: Visibility, star: int, pointing: VisibilityConfig) -> "Sight":
        """Return how a star is seen over the whole of a calendar of visibility.

        Parameters
        ----------
        seen : Visibility
        star : int
            Position of the star.
        pointing : VisibilityConfig
        """
        days = seen.allowed[star] & (seen.visible_fraction[star] > 0.0)
        fraction, window = (
            np.where(days, values[star], 0.0).sum() / max(np.count_nonzero(days), 1)
            for values in (seen.visible_fraction, seen.window_s)
        )
        allowed_h = np.asarray(24.0 * seen.step_days * np.count_nonzero(days))
        return cls(np.asarray(fraction), allowed_h, np.asarray(window), settle_h(pointing, seen.period_s))

    def telescope_h(self, time_s: float, frame_s: float, settlings: int) -> FloatArray:
        """Return the telescope time of an observation, hours; infinite where it is not possible.

        As many orbits as the wall time needs, each counting for the whole frames that fit its longest window, and the
        slews with their settling.

        Parameters
        ----------
        time_s : float
            Wall time of all its visits.
        frame_s : float
            Exposure and readout of a frame.
        settlings : int
            Slews of all its visits.
        """
        window = self.window_s
        with np.errstate(divide="ignore", invalid="ignore"):
            filled = np.where(window >= frame_s, np.floor(window / frame_s) * frame_s / window, 0.0)
            elapsed = time_s / (self.fraction * filled) / _HOUR_S + settlings * self.settle_h
        good = (filled > 0) & (self.fraction > 0) & (elapsed <= self.allowed_h)
        return np.where(good, elapsed, np.inf)


def settle_h(pointing: VisibilityConfig, period_s: float) -> float:
    """Return the time of a mean slew with all that follows it, hours.

    Parameters
    ----------
    pointing : VisibilityConfig
    period_s : float
        Of the orbit.
    """
    return (float(slew_s(_MEAN_SLEW_DEG, pointing)) + pointing.thermal_settle_orbits * period_s) / _HOUR_S


class Calendar(Record, eq=False):
    """Slots of a survey, and what ``n`` stars are like in each.

    Attributes
    ----------
    start_mjd : float
    slot_h : ndarray, shape (b,)
        Length of each slot in hours.
    fraction : ndarray, shape (n, b)
        Part of an orbit in which a star is seen, mean over the days of the slot on which it may be pointed at; 0 where
        there is none.
    allowed_h : ndarray, shape (n, b)
        Hours of those days.
    window_s : ndarray, shape (n, b)
        Longest time without interruption.
    day : ndarray, shape (n, b)
        Middle of those days, after the start.
    sun_pa_deg : ndarray, shape (n, b)
        Position angle of the Sun on that day, which sets the roll.
    period_s, settle_h : float
        Of the orbit; and of a mean slew with all that follows it.
    opens_day, closes_day : ndarray, shape (n, b)
        Begin of the first and end of the last of those days, after the start; the Moon may forbid some between.
    """

    start_mjd: float
    slot_h: FloatArray
    fraction: FloatArray
    allowed_h: FloatArray
    window_s: FloatArray
    day: FloatArray
    sun_pa_deg: FloatArray
    period_s: float
    settle_h: float
    opens_day: FloatArray
    closes_day: FloatArray

    @property
    def n_slots(self) -> int:
        """Slots."""
        return len(self.slot_h)

    def select(self, rows: IntArray) -> "Calendar":
        """Return the calendar of some of the stars."""
        names = ("fraction", "allowed_h", "window_s", "day", "opens_day", "closes_day", "sun_pa_deg")
        return replace(self, **{name: getattr(self, name)[rows] for name in names})

    def closed_before(self, mjd: float) -> "Calendar":
        """Return the calendar without the slots that began before a time."""
        begins = np.concatenate([[0.0], np.cumsum(self.slot_h)[:-1]]) / 24.0
        open_slots = self.start_mjd + begins >= mjd
        return replace(self, fraction=self.fraction * open_slots, allowed_h=self.allowed_h * open_slots)

    def cost_h(self, model: EtcModel, star: int, setting: Setting, settlings: int = 1) -> FloatArray:
        """Return the telescope time of one observation in every slot, hours; infinite where it is not possible.

        Each of its visits begins with slews and settling (`Sight.telescope_h`). All visits are in one slot.

        Parameters
        ----------
        model : EtcModel
        star : int
            Position of the star.
        setting : Setting
        settlings : int, optional
            Settlings of the telescope in one visit.
        """
        if not setting.possible:
            return np.full(self.n_slots, np.inf)
        frame_s = setting.exposure_s + model.camera(setting.band).readout_s
        sight = Sight(self.fraction[star], self.allowed_h[star], self.window_s[star], self.settle_h)
        return sight.telescope_h(setting.time_s, frame_s, (model.strategy.visits or 1) * settlings)

    def roll_deg(self, revisits: Revisits, star: int, slots: IntArray, ordinals: IntArray) -> FloatArray:
        """Return the roll of visits, given their numbers among those of their star.

        Parameters
        ----------
        revisits : Revisits
        star : int
            Position of the star.
        slots : ndarray of int
            Slots of the visits, shape (k,).
        ordinals : ndarray of int
            Number of each visit among those of the star, shape (k,).
        """
        base = self.sun_pa_deg[star, slots] if revisits.roll == "sun" else np.zeros(len(slots))
        sign = np.where(np.asarray(ordinals) % 2 == 1, 1.0, -1.0)
        return np.asarray(base + sign * revisits.roll_dither_deg)


def make_calendar(
    universe: UniverseConfig, instrument: Instrument, pointing: VisibilityConfig, targets: Targets
) -> Calendar:
    """Return the visibility of stars over the slots of a survey, sampled six times a slot.

    Raises
    ------
    InputError
        If a star has no coordinates.
    """
    step = universe.slot_days / _SAMPLES
    orbit, n_days = instrument.mission.orbit, math.ceil(universe.n_slots * universe.slot_days)
    found = visibility(
        targets.ra_deg, targets.dec_deg, pointing, orbit, start_utc=universe.start_utc, n_days=n_days, step_days=step
    )
    n, b = len(targets), universe.n_slots
    start = mjd_of(universe.start_utc)
    # Slots that are no whole number of days end in the middle of one: more steps were asked for than they have.
    mjd, whole = found.mjd[: b * _SAMPLES], slice(0, b * _SAMPLES)
    inside = (mjd - start < universe.duration_days).reshape(b, _SAMPLES)
    seeable = found.allowed & (found.visible_fraction > 0.0)
    allowed = seeable[:, whole].reshape(n, b, _SAMPLES) & inside

    def mean(values: FloatArray) -> FloatArray:
        parts = np.where(allowed, np.broadcast_to(values[..., whole], (n, mjd.size)).reshape(n, b, _SAMPLES), 0.0)
        count = allowed.sum(axis=2)
        return np.where(count > 0, parts.sum(axis=2) / np.maximum(count, 1), 0.0)

    day = mean(found.mjd - start)
    slot_day = universe.slot_days * np.arange(b)
    opens = slot_day + step * np.argmax(allowed, axis=2)
    closes = np.minimum(slot_day + step * (_SAMPLES - np.argmax(allowed[..., ::-1], axis=2)), universe.duration_days)
    lengths = np.minimum(universe.slot_days, universe.duration_days - np.arange(b) * universe.slot_days)
    return Calendar(
        start_mjd=start,
        slot_h=lengths * 24.0,
        fraction=mean(found.visible_fraction),
        allowed_h=allowed.sum(axis=2) * step * 24.0,
        window_s=mean(found.window_s),
        day=day,
        sun_pa_deg=sun_position_angle_deg(targets, start + day),
        period_s=found.period_s,
        settle_h=settle_h(pointing, found.period_s),
        opens_day=opens,
        closes_day=closes,
    )


def sun_position_angle_deg(targets: Targets, mjd: FloatArray) -> FloatArray:
    """Return the direction from each star towards the Sun, east of north.

    Parameters
    ----------
    targets : Targets
        ``n`` stars.
    mjd : ndarray, shape (n, b)
        Modified Julian Dates of UTC.

    Returns
    -------
    ndarray, shape (n, b)
        -180 to 180.

    Notes
    -----
    Components of the Sun's direction along east and north at the star, ``atan2(s . e, s . n)``. Interpolated in the
    Cartesian place of the Sun over a grid of days, to 0.01 deg.
    """
    grid = np.arange(math.floor(mjd.min()), math.ceil(mjd.max()) + 2, dtype=np.float64)
    (sun,) = bodies_km(grid, "sun")
    ra, dec = np.deg2rad(targets.ra_deg)[:, None], np.deg2rad(targets.dec_deg)[:, None]
    x, y, z = (np.interp(mjd, grid, sun[:, axis]) for axis in range(3))
    east = -x * np.sin(ra) + y * np.cos(ra)
    north = -x * np.cos(ra) * np.sin(dec) - y * np.sin(ra) * np.sin(dec) + z * np.cos(dec)
    return np.rad2deg(np.arctan2(east, north))
