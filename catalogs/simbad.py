"""The two questions that a refreshed star table is made of, put to SIMBAD's TAP service with astroquery.

The first asks for every object with a parallax and a V magnitude within the cuts, one row each; the second for all
temperatures, gravities and metallicities of the same objects, many rows each. Spectral types are not part of the cut:
``LIKE 'F%'`` would miss ``sdF8``, ``(G2)V`` or ``dK5``, so types are read here (:mod:`catalogs.simbad_rows`).

An answer counts only if it is whole: a marker of overflow, as many rows as were allowed, a dropped connection, a
status of error or anything that is no VOTable is a :class:`RefreshError`. Failures on the way are tried again.
"""

import math
import os
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from cpic_core import InputError

URL_VARIABLE = "CPIC_SIMBAD_URL"
"""Environment variable with the address of the TAP service to ask, where none is given."""
_PAUSE_FACTOR = 2.0


class RefreshError(RuntimeError):
    """The catalogue could not be refreshed; the text is one line: what failed, and what to do about it."""

    def __init__(self, what: str, remedy: str = "") -> None:
        self.what = what
        self.remedy = remedy
        super().__init__(" ".join((f"{what}; {remedy}" if remedy else what).split()))

    def __reduce__(self) -> tuple[object, ...]:
        """Survive pickling."""
        return (RefreshError, (self.what, self.remedy))


@dataclass(frozen=True)
class Cuts:
    """Which stars are asked for.

    Parameters
    ----------
    v_mag_max : float
        Faintest Johnson V, mag; there is no bright limit.
    parallax_min_mas : float
        Smallest parallax, mas.
    """

    v_mag_max: float = 7.5
    parallax_min_mas: float = 25.0

    def __post_init__(self) -> None:
        _check("v_mag_max", self.v_mag_max, -2.0, 15.0, "mag")
        _check("parallax_min_mas", self.parallax_min_mas, 1.0, 700.0, "mas")


@dataclass(frozen=True)
class TapService:
    """Where and how patiently to ask.

    Parameters
    ----------
    url : str
        Address of the TAP service, with or without its ``/sync``; ``""`` for ``$CPIC_SIMBAD_URL``, and where that is
        not set, for the SIMBAD server of astroquery's configuration.
    timeout_s : float
        Most time for one answer.
    retries : int
        How often a failure on the way is tried again, after pauses of 1, 2, 4 ... times `pause_s`.
    pause_s : float
        First pause.
    maxrec : int
        Most rows of one answer; as many or more count as cut off.
    """

    url: str = ""
    timeout_s: float = 180.0
    retries: int = 3
    pause_s: float = 2.0
    maxrec: int = 200_000

    def __post_init__(self) -> None:
        if self.url:
            _check_url("url", self.url)
        _check("timeout_s", self.timeout_s, 0.1, 86400.0, "s")
        _check("retries", self.retries, 0, 20)
        _check("pause_s", self.pause_s, 0.0, 3600.0, "s")
        _check("maxrec", self.maxrec, 1, 2_000_000)


def _check_url(name: str, url: str) -> None:
    if not url.lower().startswith(("http://", "https://")):
        raise InputError(name, url, allowed="an address that starts with http:// or https://")


def _check(name: str, value: float, low: float, high: float, unit: str = "") -> None:
    if not (math.isfinite(value) and low <= value <= high):
        raise InputError(name, value, unit=unit, allowed=f"{low:g} to {high:g}")


def queries(cuts: Cuts) -> tuple[str, str]:
    """Return the ADQL of the two questions: the stars, and their spectroscopic measurements."""
    where = f"WHERE b.plx_value >= {float(cuts.parallax_min_mas)!r} AND f.V <= {float(cuts.v_mag_max)!r}"
    stars = (
        "SELECT b.oid, b.main_id, b.ra, b.dec, b.plx_value, b.plx_err, b.pmra, b.pmdec, b.rvz_radvel, b.sp_type, "
        "b.otype, f.B, f.V, i.ids "
        "FROM basic AS b JOIN allfluxes AS f ON f.oidref = b.oid LEFT JOIN ids AS i ON i.oidref = b.oid " + where
    )
    measurements = (
        "SELECT m.oidref, m.teff, m.log_g, m.fe_h, m.bibcode, m.mespos "
        "FROM mesFe_h AS m JOIN basic AS b ON b.oid = m.oidref JOIN allfluxes AS f ON f.oidref = b.oid " + where
    )
    return stars, measurements


def service_url(service: TapService) -> str:
    """Return the base address that is asked (its ``/sync`` is).

    Raises
    ------
    InputError
        If ``$CPIC_SIMBAD_URL`` is no address.
    """
    url = service.url or os.environ.get(URL_VARIABLE, "")
    if url:
        _check_url(URL_VARIABLE, url)
        return url.rstrip("/").removesuffix("/sync")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        from astroquery.simbad import conf

    return f"https://{conf.server}/simbad/sim-tap"


def ask(service: TapService, query: str, *, tell: Callable[[str], None] = lambda text: None) -> Any:
    """Put one question and return the whole answer.

    Parameters
    ----------
    service : TapService
        Where to ask.
    query : str
        ADQL.
    tell : callable
        Called with a sentence when a failure is tried again.

    Returns
    -------
    astropy.table.Table

    Raises
    ------
    RefreshError
        If the service cannot be reached, refuses the query, or its answer is not whole.
    """
    pause_s = service.pause_s
    for attempt in range(service.retries + 1):
        try:
            return _ask_once(service, query)
        except _TryAgain as failure:
            if attempt == service.retries:
                tries = "" if attempt == 0 else f" ({attempt + 1} attempts)"
                raise RefreshError(f"{failure}{tries}", failure.remedy) from None
            tell(f"{failure}; trying again in {pause_s:g} s")
        time.sleep(pause_s)
        pause_s *= _PAUSE_FACTOR
    raise AssertionError("unreachable: the last attempt returns or raises")


class _TryAgain(Exception):
    """A failure that may be gone next time."""

    def __init__(self, text: str, remedy: str) -> None:
        self.remedy = remedy
        super().__init__(text)


def _ask_once(service: TapService, query: str) -> Any:
    with warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always")  # astropy and pyvo say in warnings what they forgive, overflow included
        from pyvo.dal.exceptions import DALOverflowWarning, DALQueryError

        from catalogs.tap_session import PatientSession, Problem

        session = PatientSession(service.timeout_s)
        where = service_url(service)
        try:
            table = _client(where, session).query_tap(query, maxrec=service.maxrec)
            problem = session.problem
        except DALQueryError as error:
            text = (" ".join(str(error).split()) or "no reason given")[:300]
            if session.problem is None or not session.problem.again:
                remedy = "the service may have changed; --dry-run shows the query"
                raise RefreshError(f"{where} refused the query: {text}", remedy) from None
            problem = Problem(f"{session.problem.text}: {text}")
        except Exception as error:
            problem = session.problem or Problem(_misfit(session.start, error))
        finally:
            session.close()
    if problem is not None:
        remedy = "check the network or the address, or try later; catalogues already here stay as they are"
        if problem.again:
            raise _TryAgain(f"{where}: {problem.text}", remedy)
        raise RefreshError(f"{where}: {problem.text}", remedy)
    if any(issubclass(item.category, DALOverflowWarning) for item in heard) or len(table) >= service.maxrec:
        raise RefreshError(
            f"{where}: the answer was cut off at {len(table)} rows (allowed: {service.maxrec})",
            f"{'raise --maxrec, or ' * (len(table) >= service.maxrec)}ask for less with --v-mag-max or "
            "--parallax-min-mas",
        )
    return table


def _misfit(start: bytes | None, error: Exception) -> str:
    """Say what an answer is that cannot be read, by its first bytes."""
    if start is None:
        return f"no answer ({type(error).__name__}: {error})"
    head = start.lstrip().lower()
    if not head:
        return "the answer is empty"
    if head.startswith((b"<?xml", b"<votable")):
        return "the answer is a VOTable that breaks off or is damaged"
    if head.startswith((b"<!doctype html", b"<html")):
        return "the answer is a web page, no VOTable (does the network want a login?)"
    text = start.decode("ascii", "replace").strip()
    return f"the answer is no VOTable (it starts {text[:40]!r})" if text.isprintable() else "the answer is no VOTable"


def _client(url: str, session: Any) -> Any:
    """Return astroquery's SIMBAD client, pointed at any TAP service."""
    from astroquery.simbad import SimbadClass
    from pyvo.dal import TAPService

    service = TAPService(baseurl=url, session=session)

    class Client(SimbadClass):  # type: ignore[misc]
        tap = service
        hardlimit = math.inf  # the service marks what it cuts off; asking it beforehand is one more request

    return Client()
