"""Visibility: when a star can be seen from the orbit of the telescope, and at which roll.

**Roll.** The normal of the panels, when they are not turned, stands across the boresight; the panels turn about the
axis across both. With the Sun at the angle ``theta`` from the boresight and the telescope rolled by ``psi`` from where
that normal lies in the plane of boresight and Sun, the Sun stands ``sin(theta) sin(psi)`` along the axis, which no
turning mends, and ``90 deg - theta`` away from the normal at ``psi = 0``, which turning does mend as far as it goes. So

- panels that turn freely allow ``sin(theta) |sin(psi)| <= sin(panel_deg)``, at any angle from the Sun;
- fixed panels allow ``sin(theta) cos(psi) >= cos(panel_deg)``, which is possible within ``panel_deg`` of 90 deg;
- panels that turn by at most ``turn`` follow the first rule until they stand at their limit, and then
  ``cos(turn) sin(theta) cos(psi) + sin(turn) |cos(theta)| >= cos(panel_deg)``.

**Limb of the Earth.** At the place ``u`` of a circular orbit the target stands ``zeta`` from the zenith ``z``, with
``cos(zeta) = cos(beta) cos(u - u0)`` where ``beta`` is its angle from the plane of the orbit, and
``l = 180 deg - rho - zeta`` from the limb of the Earth, whose angular radius is ``rho``. The limb's nearest point lies
in the plane of zenith and target: the line of sight that touches the Earth below the target does so at
``P = R (sin(rho) z + cos(rho) h)``, ``h`` being horizontal towards the target. The Sun ``s`` has risen there if
``P . s > 0``, which with ``h = (t - cos(zeta) z) / sin(zeta)`` is

    ``cos(l) (z . s) + cos(rho) (t . s) > 0``.

A place counts if ``l`` reaches the limit for a dark limb and, where that point is sunlit, the limit for a bright one.
So an orbit has a *core* around ``u0`` that always counts, two *flanks* beside it that count while their limb is dark,
and the rest, which never does. The ends of the dark pieces of a flank are those of parabolas through the expression
above at places not more than `STEP_DEG` apart.
"""

import functools
import hashlib
import math
from collections.abc import Iterable, Mapping
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from cpic_core import (
    ArrayLike,
    BoolArray,
    FloatArray,
    InputError,
    NDArray,
    Record,
    by_line,
    check_number,
    check_whole,
    compute_once,
    real_array,
)
from cpic_planner.results import PointingRecord, SeasonRecord, VisibilityResult, VisibleDays, VisibleTarget
from cpic_planner.targets import Targets
from simulator.config import (
    LAST_YEAR,
    OrbitConfig,
    Sourced,
    at,
    canonical_keys,
    checked_utc,
    content_hash,
    load_instrument,
    tree_over_preset,
)
from simulator.effects import ecliptic_deg
from simulator.products import CircularOrbit, body_km, earth_radius_deg, offline_time

_TINY = 1e-300


def roll_half_range_deg(sun_deg: FloatArray, config: "VisibilityConfig") -> FloatArray:
    """Return how far the telescope may roll either way from the best roll.

    Parameters
    ----------
    sun_deg : ndarray
        Angle between boresight and Sun.
    config : VisibilityConfig

    Returns
    -------
    ndarray
        At most ``roll_deg``; nan where no roll keeps the panels in the Sun.

    Examples
    --------
    >>> import numpy as np
    >>> from cpic_planner.survey.visibility import load_visibility
    >>> free = load_visibility({"panel_turn_deg": 90, "roll_deg": 90})
    >>> roll_half_range_deg(np.array([90.0, 30.0, 150.0, 180.0]), free).round(1)
    array([25. , 57.7, 57.7, 90. ])
    """
    limit, turn = math.radians(config.panel_deg), math.radians(config.turn_deg)
    tilt = np.abs(np.deg2rad(sun_deg) - math.pi / 2)
    cosine, sine = np.cos(tilt), np.sin(tilt)
    along_axis = np.arcsin(np.minimum(1.0, math.sin(limit) / np.maximum(cosine, _TINY)))
    # The roll at which the panels come to the limit of their turn, and what is allowed beyond.
    reached = np.arccos(np.minimum(1.0, sine * math.cos(turn) / np.maximum(cosine * math.sin(turn), _TINY)))
    at_limit = (math.cos(limit) - math.sin(turn) * sine) / np.maximum(math.cos(turn) * cosine, _TINY)
    beyond = np.arccos(np.clip(at_limit, 0.0, 1.0))
    half = np.where(along_axis <= reached, along_axis, np.maximum(reached, beyond))
    # A target exactly at the end of the range counts as seen.
    possible = tilt <= turn + limit + 1e-12
    return np.where(possible, np.minimum(np.rad2deg(half), config.roll_deg), np.nan)


DEFAULT_VISIBILITY = "default"
PACKAGE = "cpic_planner"
_WITH_UNIT = ("sun_deg", "moon_deg", "dark_limb_deg", "bright_limb_deg", "roll_deg", "saa_fraction", "settle_s")
_ALIASES = {key.rpartition("_")[0]: key for key in _WITH_UNIT}


class VisibilityConfig(PointingRecord, Sourced):
    """Limits of pointing, and what a slew costs, as configuration; its fields are those of the result's record."""

    description: str = ""

    @property
    def turn_deg(self) -> float:
        """How far the panels turn, 0 where they are fixed."""
        return self.panel_turn_deg if self.panel == "one_axis" else 0.0

    def content(self) -> dict[str, Any]:
        """Return everything that decides where the telescope points and what a slew costs, for content hashes."""
        return self.model_dump(mode="json", exclude={"name", "description"})


VisibilitySource = VisibilityConfig | Mapping[str, Any] | str | Path | None


@by_line
def load_visibility(source: VisibilitySource = None) -> VisibilityConfig:
    """Load limits of pointing.

    Parameters
    ----------
    source : VisibilityConfig, mapping, str, Path or None
        Preset name, YAML path or mapping; ``None`` is the preset ``default``. A file or mapping needs to hold only what
        differs from its ``base`` (a preset name, ``default`` if absent).

    Returns
    -------
    VisibilityConfig

    Raises
    ------
    InputError
        Naming key, value, unit and allowed range of the first fault.

    Examples
    --------
    >>> from cpic_planner.survey.visibility import load_visibility
    >>> load_visibility({"moon_deg": 40}).moon_deg
    40.0
    """
    if isinstance(source, VisibilityConfig):
        return source
    return VisibilityConfig.read(_tree(source), "visibility")


def _tree(source: Any) -> dict[str, Any]:
    own, _, base = tree_over_preset(
        "visibility", source, default=DEFAULT_VISIBILITY, keys=VisibilityConfig.model_fields, package=PACKAGE
    )
    if base is None:
        return {"sun_deg": _sun_limit()} | own
    try:
        own = canonical_keys(own, VisibilityConfig.model_fields, _ALIASES)
    except InputError as error:
        raise at("visibility", error) from None
    return {**_tree(base), "name": f"{base}+changes" if own else base, "description": ""} | own


def _sun_limit() -> dict[str, Any]:
    """Return the Sun's limit of the default instrument, whose sky needs it too, with its source."""
    instrument = load_instrument()
    origin = instrument.provenance["sky.sun_limit_deg"]
    return {
        "value": instrument.sky.sun_limit_deg,
        **{key: getattr(origin, key) for key in ("unit", "source", "confidence")},
    }


STEP_DEG = 1.5


# Pieces of a flank come in multiples of this many, each with a parabola over two steps.
_WIDTHS = 4
_BLOCK_CELLS = 50_000


class Geometry(Record, eq=False):
    """Targets, orbits and Suns, arrays of one length.

    Attributes
    ----------
    in_plane : ndarray
        Cosine of the target's angle from the plane of the orbit.
    sun_ahead, sun_aside : ndarray
        Cosines between the Sun and the direction in that plane nearest to the target, and a quarter of a revolution on.
    sun_target : ndarray
        Cosine between Sun and target.
    """

    in_plane: FloatArray
    sun_ahead: FloatArray
    sun_aside: FloatArray
    sun_target: FloatArray

    def take(self, rows: NDArray[np.intp]) -> "Geometry":
        """Return some of them."""
        return Geometry(self.in_plane[rows], self.sun_ahead[rows], self.sun_aside[rows], self.sun_target[rows])


def _joined(piece: FloatArray, behind: FloatArray) -> FloatArray:
    """Return one piece of orbit of two that follow each other.

    Of each its lengths in radians, shape (5, n): of all that counts, at its begin, at its end, the longest run, and of
    the piece.
    """
    total, begin, end, longest, length = piece
    begins = np.where(begin >= length, length + behind[1], begin)
    ends = np.where(behind[2] >= behind[4], behind[4] + end, behind[2])
    longest = np.maximum(np.maximum(longest, behind[3]), end + behind[1])
    return np.array([total + behind[0], begins, ends, longest, length + behind[4]])


def clear_arcs(
    geometry: Geometry, radius_deg: float, dark_limb_deg: float, bright_limb_deg: float
) -> tuple[FloatArray, FloatArray]:
    """Return the part of the orbit on which each target stands clear of the Earth.

    Parameters
    ----------
    geometry : Geometry
    radius_deg : float
        Angular radius of the Earth.
    dark_limb_deg, bright_limb_deg : float
        Least angle from the limb.

    Returns
    -------
    fraction : ndarray
        Of the orbit, 0 to 1.
    longest : ndarray
        Its longest piece, fraction of the orbit; a piece does not end where the revolution does.

    Examples
    --------
    A target in the plane of the orbit, with the Sun behind it and in front of it:

    >>> new, full = (np.array([side]) for side in (1.0, -1.0))
    >>> for sun in (new, full):
    ...     fraction, longest = clear_arcs(Geometry(np.ones(1), sun, np.zeros(1), sun), 70.2, 10.0, 30.0)
    ...     print(fraction.round(3), longest.round(3))
    [0.443] [0.443]
    [0.554] [0.554]
    """
    rho = math.radians(radius_deg)

    def reach(limb_deg: float) -> FloatArray:
        least = -math.cos(min(rho + math.radians(limb_deg), math.pi))
        return np.arccos(np.clip(least / np.maximum(geometry.in_plane, _TINY), -1.0, 1.0))

    outer = reach(dark_limb_deg)
    core = np.minimum(outer, reach(bright_limb_deg))
    fraction, longest = core / math.pi, core / math.pi
    # Flanks of about one width go together, so that each is divided only as often as it has to be.
    pieces = _WIDTHS * np.ceil(np.rad2deg(outer - core) / (2 * STEP_DEG * _WIDTHS)).astype(int)
    for count in np.unique(pieces[pieces != 0]).tolist():
        flanks, block = np.flatnonzero(pieces == count), _BLOCK_CELLS // count
        for part in range(0, len(flanks), block):
            rows = flanks[part : part + block]
            runs = _whole_orbit(geometry.take(rows), core[rows], outer[rows], rho, count)
            fraction[rows] = runs[0] / (2 * math.pi)
            # The end of a revolution is its begin; one that counts as a whole is cut to one revolution below.
            longest[rows] = np.maximum(runs[3], runs[1] + runs[2]) / (2 * math.pi)
    return np.minimum(fraction, 1.0), np.minimum(longest, 1.0)


def _whole_orbit(geometry: Geometry, core: FloatArray, outer: FloatArray, rho: float, pieces: int) -> FloatArray:
    """Return one revolution, from where the target comes up to where it comes up again."""
    share = np.linspace(0.0, 1.0, 2 * pieces + 1)[:, None]
    place = core + (outer - core) * share
    cosine, sine = np.cos(place), np.sin(place)
    over = geometry.in_plane * cosine
    from_limb = math.sin(rho) * np.sqrt(np.maximum(1.0 - over**2, 0.0)) - math.cos(rho) * over
    constant = math.cos(rho) * geometry.sun_target
    ahead, aside = geometry.sun_ahead * cosine, geometry.sun_aside * sine
    step = (outer - core) / (2 * pieces)
    before = _flank(from_limb * (ahead - aside) + constant, step)[::-1, [0, 2, 1, 3, 4]]  # from the other side
    behind = _flank(from_limb * (ahead + aside) + constant, step)
    middle, hidden = np.tile(2.0 * core, (5, 1)), np.zeros((5, core.size))
    hidden[4] = 2 * (math.pi - outer)
    return functools.reduce(_joined, (*before, middle, *behind, hidden))


def _flank(sunlit: FloatArray, step: FloatArray) -> FloatArray:
    """Return the dark runs of the pieces of a flank, from the core outwards, shape (pieces, 5, n): see `_joined`.

    Parameters
    ----------
    sunlit : ndarray, shape (2 pieces + 1, n)
        Above 0 where the limb is sunlit, at even steps.
    step : ndarray, shape (n,)
    """
    first, middle, last = sunlit[:-2:2], sunlit[1::2], sunlit[2::2]
    bend, slope = 0.5 * (first + last) - middle, 0.5 * (last - first)
    # Roots of bend x^2 + slope x + middle, x from -1 to 1 over a piece, by the form that loses no digits.
    inside = slope**2 - 4.0 * bend * middle
    half = -0.5 * (slope + np.copysign(np.sqrt(np.maximum(inside, 0.0)), slope))
    with np.errstate(divide="ignore", invalid="ignore"):
        one, other = half / bend, middle / half
        low = np.maximum(np.minimum(one, other), -1.0)
        high = np.minimum(np.maximum(one, other), 1.0)
        crossed = (inside > 0.0) & (high > low)
    # Between the roots the sign is that of -bend, outside that of bend; without a piece between, that of the ends (the
    # middle may touch 0 from above).
    dark_between = crossed & (bend >= 0.0)
    whole = ~crossed & (first + last <= 0.0)
    between = high - low
    begin = np.where(dark_between, np.where(low <= -1.0, between, 0.0), np.where(crossed, low + 1.0, 0.0))
    end = np.where(dark_between, np.where(high >= 1.0, between, 0.0), np.where(crossed, 1.0 - high, 0.0))
    total = np.where(dark_between, between, begin + end)
    longest = np.where(dark_between, between, np.maximum(begin, end))
    length = np.broadcast_to(2.0 * step, whole.shape)
    parts = (np.where(whole, length, part * step) for part in (total, begin, end, longest))
    return np.stack([*parts, length], axis=1)


BLOCKS = ("", "sun", "moon", "panel", "limb")
"""What keeps a target from being seen, by number. Of several, Sun, panels, Moon and limb count in this order."""
MAX_DAYS = 36525
MAX_CELLS = 20_000_000


class Visibility(Record, eq=False):
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
    sun, moon = bodies_km(middle, "sun", "moon")
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


def bodies_km(mjd: FloatArray, *bodies: str) -> tuple[FloatArray, ...]:
    """Return where bodies of the solar system stand at times of UTC, ``(n, 3)`` each: worked out once on a machine.

    Parameters
    ----------
    mjd : ndarray, shape (n,)
    *bodies : {"sun", "moon"}
        As of `simulator.products.body_km`.
    """
    decided = {"mjd": hashlib.sha256(mjd.tobytes()).hexdigest(), "bodies": bodies}
    decided |= {name: metadata.version(name) for name in ("astropy", "pyerfa")}

    def computed() -> dict[str, FloatArray]:
        from astropy.time import Time

        with offline_time():
            times = Time(mjd, format="mjd", scale="utc")
            return {body: body_km(body, times) for body in bodies}

    def read(found: Mapping[str, FloatArray]) -> tuple[FloatArray, ...]:
        return tuple(found[body].reshape(mjd.size, 3) for body in bodies)

    return compute_once(f"bodies-{content_hash(decided)[:16]}", computed, read)


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
