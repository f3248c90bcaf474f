"""The calendar of visibility, targets x dates, with what prevents an observation."""

import functools
import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from cpic_core import ArrayLike, BoolArray, FloatArray, InputError, NDArray, check_number, check_whole, real_array
from cpic_planner.results import PointingRecord, SeasonRecord, VisibilityResult, VisibleDays, VisibleTarget
from cpic_planner.survey.visibility.config import VisibilityConfig, roll_half_range_deg
from cpic_planner.survey.visibility.limb import Geometry, clear_arcs
from cpic_planner.targets import Targets
from simulator.config import LAST_YEAR, OrbitConfig, checked_utc, content_hash
from simulator.effects import ecliptic_deg
from simulator.products import CircularOrbit, body_km, earth_radius_deg, offline_time

BLOCKS = ("", "sun", "moon", "panel", "limb")
"""What keeps a target from being seen, by number. Of several, Sun, panels, Moon and limb count in this order."""

MAX_DAYS = 36525
MAX_CELLS = 20_000_000


@dataclass(frozen=True, eq=False)
class Visibility:
    """Targets x dates; one orbit in the middle of each step stands for the step.

    Attributes
    ----------
    mjd : ndarray, shape (d,)
        Middle of each step, Modified Julian Date of UTC.
    step_days : float
    period_s : float
        Of the orbit.
    allowed : ndarray of bool, shape (n, d)
        Whether Sun, Moon and panels allow it.
    visible_fraction : ndarray, shape (n, d)
        Share of the time that can be used: of the orbit by the limb of the Earth, times what the South Atlantic Anomaly
        leaves on average; 0 where not allowed.
    window_s : ndarray, shape (n, d)
        Longest piece of an orbit by the limb of the Earth, without interruption by the anomaly; a whole period means
        that the target never sets. 0 where not allowed.
    sun_deg, moon_deg : ndarray, shape (n, d)
        Angle from Sun and Moon, from the centre of the Earth.
    roll_half_range_deg : ndarray, shape (n, d)
        Roll allowed either way from the best one; 0 where the panels allow none.
    blocked_by : ndarray of int8, shape (n, d)
        Number in `BLOCKS`.
    """

    mjd: FloatArray
    step_days: float
    period_s: float
    allowed: BoolArray
    visible_fraction: FloatArray
    window_s: FloatArray
    sun_deg: FloatArray
    moon_deg: FloatArray
    roll_half_range_deg: FloatArray
    blocked_by: NDArray[np.int8]

    @property
    def visible_s(self) -> FloatArray:
        """Time per orbit that can be used, shape (n, d)."""
        return self.visible_fraction * self.period_s

    @property
    def observable(self) -> BoolArray:
        """Whether anything of the orbit can be used, shape (n, d)."""
        return np.asarray(self.blocked_by == 0)

    def days(self, target: int) -> dict[str, float]:
        """Return the days by what blocks them; under ``""`` those that can be used."""
        counts = np.bincount(self.blocked_by[target], minlength=len(BLOCKS))
        return {name: float(count * self.step_days) for name, count in zip(BLOCKS, counts, strict=True)}

    def runs(self, target: int, *, through: Iterable[str] = ()) -> list[tuple[int, int]]:
        """Return the first step, and first step behind, of every time without a break in which the target can be seen.

        Parameters
        ----------
        target : int
            Row.
        through : iterable of str
            Blocks that do not end such a time, if it goes on behind them: ``("moon",)`` for seasons.
        """
        passed = [BLOCKS.index(name) for name in through]
        row = self.blocked_by[target]
        seen = np.flatnonzero(row == 0)
        if not len(seen):
            return []
        stopped = np.cumsum(~np.isin(row, [0, *passed]))
        new = np.flatnonzero(stopped[seen[1:]] > stopped[seen[:-1]])
        begins = np.concatenate([seen[:1], seen[new + 1]])
        ends = np.concatenate([seen[new], seen[-1:]]) + 1
        return [(int(begin), int(end)) for begin, end in zip(begins, ends, strict=True)]

    def windows(self, target: int, *, through: Iterable[str] = ()) -> list[tuple[str, str]]:
        """Begin and end in UTC of every time without a break in which the target can be seen; see `runs`.

        Parameters
        ----------
        target : int
            Position of the star.
        through : iterable of str, optional
            Last day that counts.
        """
        runs = self.runs(target, through=through)
        edges = [self.mjd[step] - 0.5 * self.step_days for run in runs for step in (run[0], run[1] - 1)]
        edges[1::2] = [edge + self.step_days for edge in edges[1::2]]
        texts = utc_of(edges)
        return list(zip(texts[::2], texts[1::2], strict=True))


def slew_s(angle_deg: ArrayLike, config: VisibilityConfig) -> FloatArray:
    """Return the time of a slew by an angle until the telescope has settled; not the dark hole's thermal settling.

    Parameters
    ----------
    angle_deg : array_like
        Angle between the two directions, degrees.
    config : VisibilityConfig

    Examples
    --------
    >>> from cpic_planner.survey.visibility import load_visibility
    >>> float(slew_s(70.0, load_visibility()))
    380.0
    """
    angle = real_array("angle_deg", angle_deg, "deg")
    if not np.all((angle >= 0.0) & (angle <= 180.0)):
        raise InputError("angle_deg", angle.tolist(), unit="deg", allowed="0 to 180")
    return np.where(angle > 0.0, angle / config.slew_deg_s + config.settle_s, 0.0)


def utc_of(mjd: ArrayLike) -> list[str]:
    """Return the times of UTC, ISO 8601 to the second."""
    from astropy.time import Time

    with offline_time():
        times = Time(np.atleast_1d(np.asarray(mjd, dtype=np.float64)), format="mjd", scale="utc", precision=0)
        return [str(text) for text in times.isot]


def visibility(
    ra_deg: ArrayLike,
    dec_deg: ArrayLike,
    config: VisibilityConfig,
    orbit: OrbitConfig,
    *,
    start_utc: str,
    n_days: int,
    step_days: float = 1.0,
) -> Visibility:
    """Return when targets can be seen.

    Parameters
    ----------
    ra_deg, dec_deg : array_like, shape (n,)
        ICRS.
    config : VisibilityConfig
    orbit : OrbitConfig
    start_utc : str
        Begin of the first step.
    n_days : int
        All steps that begin before this many days are over.
    step_days : float
        One orbit in the middle stands for the step. Where the Moon matters, steps should not exceed a day: it moves by
        13 deg a day.

    Returns
    -------
    Visibility

    Raises
    ------
    InputError
        For a coordinate that is none, by its row, or a time out of range.

    Notes
    -----
    Sun and Moon stand where astropy's built-in ephemeris has them from the centre of the Earth. From the telescope the
    Moon moves by up to its parallax, 1 deg: that is added to the limit, so that the limit holds all around the orbit
    (that of the Sun is 0.003 deg). Within a day the node of the orbit drifts by 6 deg: the fraction of the middle orbit
    is within 0.005 of the mean over the day for 99 of 100 pairs, and off by up to 0.07 where a target only grazes a
    limit. Neglected: proper motion and aberration of the targets (below 0.1 and 0.01 deg), height and refraction of the
    atmosphere, the size of Sun and Moon.

    Examples
    --------
    >>> from cpic_planner.survey.visibility import load_visibility
    >>> from simulator import load_instrument
    >>> orbit = load_instrument().mission.orbit
    >>> pole = visibility([270.0], [66.56], load_visibility(), orbit, start_utc="2028-01-01", n_days=366)
    >>> float(pole.sun_deg.min().round()), pole.days(0)["sun"]
    (90.0, 0.0)
    """
    from astropy.time import Time

    targets = _directions(ra_deg, dec_deg)
    begin = checked_utc("start_utc", start_utc)
    n_days = check_whole("n_days", n_days, 1, MAX_DAYS)
    step_days = check_number("step_days", step_days, "d")
    if not 1e-3 <= step_days <= 366.0:
        raise InputError("step_days", step_days, unit="d", allowed="0.001 to 366")
    n_steps = math.ceil(n_days / step_days - 1e-9)
    if len(targets) * n_steps > MAX_CELLS:
        allowed = f"targets x steps up to {MAX_CELLS:.0e}, not {len(targets)} x {n_steps}"
        raise InputError("n_days", n_days, unit="d", allowed=allowed)
    with offline_time():
        first = Time(begin, format="isot", scale="utc").mjd
        middle = first + step_days * (np.arange(n_steps) + 0.5)
        times = Time(middle, format="mjd", scale="utc")
        if int(times[-1].ymdhms.year) > LAST_YEAR:
            raise InputError("n_days", n_days, unit="d", allowed=f"an end before {LAST_YEAR + 1}")
        elapsed = (times - Time(orbit.epoch_utc, format="isot", scale="utc")).to_value("s")
    sun, moon = _sun_and_moon_km(begin, n_steps, step_days)
    circle = CircularOrbit(orbit)
    cosine_sun = _cosines(targets, _unit(sun))
    sun_deg, moon_deg = _angles_deg(cosine_sun), _angles_deg(_cosines(targets, _unit(moon)))
    parallax_deg = np.rad2deg(np.arcsin(circle.radius_km / np.linalg.norm(moon, axis=1)))
    roll = roll_half_range_deg(sun_deg, config)
    blocked = np.zeros(sun_deg.shape, dtype=np.int8)
    # The last that is written counts.
    blocked[np.maximum(moon_deg - parallax_deg, 0.0) < config.moon_deg] = BLOCKS.index("moon")
    blocked[np.isnan(roll)] = BLOCKS.index("panel")
    blocked[sun_deg < config.sun_deg] = BLOCKS.index("sun")
    allowed = blocked == 0
    fraction, longest = np.zeros(sun_deg.shape), np.zeros(sun_deg.shape)
    geometry = _geometry(targets, _unit(sun), cosine_sun, circle.plane(elapsed), allowed)
    limbs = float(earth_radius_deg(circle.radius_km)), config.dark_limb_deg, config.bright_limb_deg
    fraction[allowed], longest[allowed] = clear_arcs(geometry, *limbs)
    blocked[allowed & (fraction <= 0.0)] = BLOCKS.index("limb")
    return Visibility(
        mjd=middle,
        step_days=step_days,
        period_s=circle.period_s,
        allowed=allowed,
        visible_fraction=fraction * (1.0 - config.saa_fraction),
        window_s=longest * circle.period_s,
        sun_deg=sun_deg,
        moon_deg=moon_deg,
        roll_half_range_deg=np.nan_to_num(roll, nan=0.0),
        blocked_by=blocked,
    )


def _directions(ra_deg: ArrayLike, dec_deg: ArrayLike) -> FloatArray:
    """Return the unit vectors, shape (n, 3)."""
    given = {"ra_deg": ra_deg, "dec_deg": dec_deg}
    ra, dec = (np.atleast_1d(real_array(name, value, "deg")) for name, value in given.items())
    if ra.ndim != 1 or ra.shape != dec.shape or not len(ra):
        raise InputError("ra_deg", f"{ra.shape} beside dec_deg {dec.shape}", allowed="two rows of one length")
    for name, values, low, high in (("ra_deg", ra, -360.0, 360.0), ("dec_deg", dec, -90.0, 90.0)):
        if len(bad := np.flatnonzero(~((values >= low) & (values <= high)))):
            first, allowed = float(values[bad[0]]), f"{low:g} to {high:g}"
            raise InputError(name, first, unit="deg", allowed=allowed, hint=f"row {bad[0]}")
    ra, dec = np.deg2rad(ra), np.deg2rad(dec)
    return np.stack([np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)], axis=1)


def _unit(vectors: FloatArray) -> FloatArray:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True))


def _angles_deg(cosine: FloatArray) -> FloatArray:
    return np.asarray(np.rad2deg(np.arccos(np.clip(cosine, -1.0, 1.0))))


@functools.lru_cache(maxsize=4)
def _sun_and_moon_km(begin_utc: str, n_steps: int, step_days: float) -> tuple[FloatArray, FloatArray]:
    """Return where Sun and Moon stand in the middle of each step: most of a calendar's work, once for all targets."""
    from astropy.time import Time

    with offline_time():
        first = Time(begin_utc, format="isot", scale="utc").mjd
        times = Time(first + step_days * (np.arange(n_steps) + 0.5), format="mjd", scale="utc")
        return body_km("sun", times), body_km("moon", times)


def _cosines(targets: FloatArray, others: FloatArray) -> FloatArray:
    """Return products of unit vectors, ``(n, 3)`` and ``(d, 3)``: the same bytes whatever other targets there are."""
    return np.asarray(np.einsum("ni,di->nd", targets, others, optimize=False))


def _geometry(
    targets: FloatArray, sun: FloatArray, cosine_sun: FloatArray, plane: tuple[Any, Any], allowed: BoolArray
) -> Geometry:
    """Return the targets and Suns in the planes of the orbits, for the allowed pairs of target and date."""
    along = [_cosines(targets, axis)[allowed] for axis in plane]
    of_sun = [np.broadcast_to(np.einsum("ij,ij->i", sun, axis), allowed.shape)[allowed] for axis in plane]
    in_plane = np.hypot(*along)
    # At a pole of the orbit no direction in the plane is nearest: any will do.
    nearest = np.where(in_plane > 0.0, in_plane, 1.0)
    one, other = np.where(in_plane > 0.0, along[0], 1.0) / nearest, along[1] / nearest
    return Geometry(
        in_plane=np.minimum(in_plane, 1.0),
        sun_ahead=one * of_sun[0] + other * of_sun[1],
        sun_aside=one * of_sun[1] - other * of_sun[0],
        sun_target=cosine_sun[allowed],
    )


def visibility_result(
    targets: Targets,
    config: VisibilityConfig,
    orbit: OrbitConfig,
    *,
    start_utc: str,
    n_days: int,
    step_days: float = 1.0,
    catalogue: str = "",
) -> VisibilityResult:
    """Return when stars can be seen.

    Parameters
    ----------
    targets : Targets
    config, orbit, start_utc, n_days, step_days
        As of `cpic_planner.survey.visibility.visibility`.
    catalogue : str
        What the stars come from, in words.

    Returns
    -------
    VisibilityResult

    Raises
    ------
    InputError
        For a star without coordinates, by name, and as `visibility` does.
    """
    for name, ra, dec in zip(targets.name, targets.ra_deg, targets.dec_deg, strict=True):
        if not (math.isfinite(ra) and math.isfinite(dec)):
            hint = f"the star table has none of {name}"
            raise InputError("ra_deg, dec_deg", "missing", unit="deg", allowed="coordinates", hint=hint)
    seen = visibility(
        targets.ra_deg, targets.dec_deg, config, orbit, start_utc=start_utc, n_days=n_days, step_days=step_days
    )
    when: dict[str, Any] = {"start_utc": checked_utc("start_utc", start_utc), "n_days": n_days, "step_days": step_days}
    stars, orbit_content = targets.content(), orbit.model_dump(mode="json")
    digest = content_hash({"pointing": config.content(), "orbit": orbit_content, "stars": stars, **when})
    rows = [_target(targets, seen, row) for row in range(len(targets))]
    about = {"config_hash": digest, "catalogue": catalogue, "pointing": PointingRecord.of(config), **when}
    return VisibilityResult.of(seen, orbit, **about, targets=rows)


def seasons_of(seen: Visibility, row: int) -> list[SeasonRecord]:
    """Return the times in which a target can be seen, but for passages of the Moon.

    Parameters
    ----------
    seen : Visibility
    row : int
        Index of the target.
    """
    runs, times = seen.runs(row, through=("moon",)), seen.windows(row, through=("moon",))
    lengths = [float(np.count_nonzero(seen.observable[row, begin:behind]) * seen.step_days) for begin, behind in runs]
    return [
        SeasonRecord(start_utc=start, end_utc=end, days=length)
        for (start, end), length in zip(times, lengths, strict=True)
    ]


def _target(targets: Targets, seen: Visibility, row: int) -> VisibleTarget:
    usable = np.flatnonzero(seen.observable[row])
    visible = seen.visible_s[row]
    best = int(usable[np.argmax(visible[usable])]) if len(usable) else None
    days = seen.days(row)
    return VisibleTarget.of(
        targets,
        at=row,
        hip=int(targets.hip[row]) or None,
        ecliptic_latitude_deg=float(ecliptic_deg(targets.ra_deg[row], targets.dec_deg[row])[1]),
        seasons=seasons_of(seen, row),
        observable_days=days[""],
        blocked_days={name: days[name] for name in BLOCKS if name},
        visible_s=None if best is None else float(np.median(visible[usable])),
        best_visible_s=None if best is None else float(visible[best]),
        best_utc=None if best is None else utc_of(seen.mjd[best])[0],
        longest_window_s=None if best is None else float(seen.window_s[row].max()),
        roll_half_range_deg=None if best is None else float(np.median(seen.roll_half_range_deg[row, usable])),
        days=VisibleDays.of(seen, at=row, blocked_by=[BLOCKS[number] for number in seen.blocked_by[row]]),
    )
