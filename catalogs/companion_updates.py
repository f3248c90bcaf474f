"""Positions of close companions that have moved since the snapshot's sources saw them.

The base table (``data/stars.csv``) is what its builder makes of pinned packages: there alpha Cen B stands where
Hipparcos saw it in 1991. ``data/companion_updates.csv`` is kept by hand: for a few pairs it gives the place at one
epoch, computed from a published orbit (its elements are in the note). It is laid over the base table, and over
refreshed tables, whose companions are the snapshot's. A table of one's own is never touched. Both stars of a pair get
each other, the second with the position angle turned by 180 deg.

``close_companion`` stays SIMBAD's flag, by which the paper counts its sample.
"""

from __future__ import annotations

import csv
import functools
import hashlib
import math
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from catalogs.stars import StarTable

__all__ = ["CompanionUpdate", "companion_updates", "updates_vintage", "with_companion_updates"]

_FILE = Path(__file__).resolve().parent / "data" / "companion_updates.csv"


@dataclass(frozen=True)
class CompanionUpdate:
    """The place of a companion at one epoch.

    Parameters
    ----------
    star, companion : str
        Names as in the star table; the companion need not have a row there.
    separation_arcsec, pa_deg : float
        Of the companion from the star; position angle east of north.
    epoch_yr : float
        Julian year of this place.
    delta_v_mag : float
        Companion's V minus the star's; nan where the base table's value stays.
    reference : str
        Publication of the orbit.
    note : str
        Elements of the orbit and remarks.
    """

    star: str
    companion: str
    separation_arcsec: float
    pa_deg: float
    epoch_yr: float
    delta_v_mag: float
    reference: str
    note: str

    @property
    def reversed(self) -> CompanionUpdate:
        """Return the pair as seen from the companion."""
        return replace(
            self,
            star=self.companion,
            companion=self.star,
            pa_deg=round((self.pa_deg + 180.0) % 360.0, 6),
            delta_v_mag=-self.delta_v_mag,
        )


@functools.cache
def companion_updates() -> tuple[CompanionUpdate, ...]:
    """Return the rows of ``companion_updates.csv``, one for each pair. It is read once per process."""
    with _FILE.open(encoding="utf-8", newline="") as stream:
        return tuple(
            CompanionUpdate(
                star=row["star"],
                companion=row["companion"],
                separation_arcsec=float(row["separation_arcsec"]),
                pa_deg=float(row["pa_deg"]),
                epoch_yr=float(row["epoch_yr"]),
                delta_v_mag=float(row["delta_v_mag"] or math.nan),
                reference=row["reference"],
                note=row["note"],
            )
            for row in csv.DictReader(stream)
        )


@functools.cache
def updates_vintage() -> str:
    """Return in one line what the updates are: epochs, file, and the first digits of its checksum."""
    epochs = ", ".join(f"{epoch:g}" for epoch in sorted({item.epoch_yr for item in companion_updates()}))
    return f"companions of {epochs} from {_FILE.name} {hashlib.sha256(_FILE.read_bytes()).hexdigest()[:12]}"


def with_companion_updates(table: StarTable) -> StarTable:
    """Return the table with the companions of its stars where the updates have them; absent stars are passed over."""
    rows = {name: index for index, name in enumerate(table.column("name").tolist())}
    changed = {name: table.column(name).tolist() for name in table.columns if name.startswith("companion_")}
    for pair in companion_updates():
        for item in (pair, pair.reversed):
            row = rows.get(item.star)
            if row is None:
                continue
            place = f"derived:orbit of {item.reference}"
            values: dict[str, object] = {
                "companion_name": item.companion,
                "companion_sep_arcsec": item.separation_arcsec,
                "companion_pa_deg": item.pa_deg,
                "companion_epoch_yr": item.epoch_yr,
                "companion_src": place,
                "companion_pa_src": place,
            }
            if math.isfinite(item.delta_v_mag):
                values["companion_delta_v_mag"] = item.delta_v_mag
                values["companion_delta_v_src"] = f"derived:V of the companion in {item.reference}"
            for name, value in values.items():
                changed[name][row] = value
    columns = dict(table.columns)
    for name, cells in changed.items():
        columns[name] = np.array(cells)
        columns[name].flags.writeable = False
    return replace(table, columns=MappingProxyType(columns))
