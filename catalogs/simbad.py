"""The two questions that a refreshed star table is made of, put to SIMBAD's TAP service.

The first asks for every object with a parallax and a V magnitude within the cuts, one row each; the second for all
temperatures, gravities and metallicities of the same objects, many rows each. Spectral types are not part of the cut:
``LIKE 'F%'`` would miss ``sdF8``, ``(G2)V`` or ``dK5``, so types are read here (:mod:`catalogs.simbad_rows`).
"""

import warnings
from dataclasses import dataclass

from catalogs.tap_client import TapService
from cpic_core import checked_scalar

NARROWER = "ask for less with --v-mag-max or --parallax-min-mas"
"""Advice of messages on an answer with too many rows."""
URL_VARIABLE = "CPIC_SIMBAD_URL"
"""Environment variable with the address of the TAP service to ask, where none is given."""


@dataclass(frozen=True)
class Cuts:
    """The cuts that say which stars are asked for.

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
        checked_scalar("v_mag_max", self.v_mag_max, low=-2.0, high=15.0, unit="mag")
        checked_scalar("parallax_min_mas", self.parallax_min_mas, low=1.0, high=700.0, unit="mas")


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
    if given := service.address(URL_VARIABLE):
        return given
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        from astroquery.simbad import conf

    return f"https://{conf.server}/simbad/sim-tap"
