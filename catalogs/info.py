"""What the embedded data are: vintage, counts per cut, sources, licences and credits."""

from __future__ import annotations

import csv
import functools
import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

from catalogs.known_planet_columns import STATUSES
from catalogs.stars import companion_updates, updates_vintage

_DATA = Path(__file__).resolve().parent / "data"

STAR_CREDITS = (
    "This research has made use of the SIMBAD database, operated at CDS, Strasbourg, France (Wenger et al. 2000). "
    "The star table is a database derived from it, under the Open Database License 1.0.",
    "Stellar data from ExoCat-1 (Turnbull 2015) and Hipparcos-2 (van Leeuwen 2007); names from the d3-celestial index "
    "(Kostjuk 2002; Gliese & Jahreiss 1991).",
    "Places of companions that have moved: orbits of Akeson et al. 2021 and Bond et al. 2015, and of the Sixth Catalog "
    "of Orbits of Visual Binary Stars (ORB6, US Naval Observatory).",
)
"""Of the embedded and refreshed star tables."""

PLANET_CREDITS = (
    "Known planets: the NASA Exoplanet Archive (Akeson et al. 2013), operated by the California Institute of "
    "Technology under contract with NASA's Exoplanet Exploration Program; orbits as in the reference of each.",
)
"""Of the table of known planets."""

MODEL_CREDITS = (
    "Stellar spectra: PHOENIX (Allard et al. 2012; Husser et al. 2013) with the trends of Castelli & Kurucz 2004; "
    "Pickles 1998; Sun and Vega: CALSPEC.",
    "Giant-planet albedos: Karkoschka 1998. Zodiacal light: Leinert et al. 1998.",
)
"""Of the other data, which every result rests on."""


@functools.cache
def _provenance() -> list[dict[str, Any]]:
    entries: list[dict[str, Any]] = json.loads((_DATA / "PROVENANCE.json").read_text(encoding="utf-8"))["files"]
    return entries


def snapshot_vintage(*, updates: bool = True) -> str:
    """Return in one line what the star table is and how old, with the first digits of its checksum.

    Parameters
    ----------
    updates : bool
        Whether companions are those of `catalogs.stars`.
    """
    entry = next(item for item in _provenance() if item["data_file"] == "stars.csv")
    laid_over = f"; {updates_vintage()}" if updates else ""
    return f"{entry['vintage']} (stars.csv {entry['sha256'][:12]}{laid_over})"


def _updates() -> dict[str, Any]:
    """Return the date and file of the updates of known planets, and the planets that are not simply confirmed."""
    from catalogs.known_planets import UPDATES_FILE, load_known_planets, planets_updated

    table = load_known_planets()
    pairs = list(zip(table.text("status"), table.text("planet"), strict=True))
    return {"date": planets_updated(), "file": UPDATES_FILE, "n_rows": sum(map(bool, table.text("updated")))} | {
        status: [planet for own, planet in pairs if own == status] for status in STATUSES if status != "confirmed"
    }


def catalogue_info() -> dict[str, Any]:
    """Everything that ``cpic catalog info`` shows.

    Returns
    -------
    dict
        ``vintage``, ``counts`` (cut, count, reference count and remark), ``notes``, ``companion_updates`` (pairs whose
        place is not that of ``stars.csv``), ``known_planets`` (vintage, notes, ``updates``: date, file, and the planets
        of each status that is not ``confirmed``), ``files`` (name, source packages, licence, description) and
        ``credits``.
    """
    with (_DATA / "stars_counts.csv").open(encoding="utf-8", newline="") as stream:
        counts = [
            {
                "cut": f"{row['group']}: {row['what']}",
                "count": int(row["count"]),
                "reference": row["reference"],
                "note": row["note"],
            }
            for row in csv.DictReader(stream)
        ]
    files = [
        {
            "file": entry["data_file"],
            "packages": ", ".join(sorted({f"{source['package']} {source['version']}" for source in entry["sources"]})),
            "licence": entry["licence"],
            "description": entry["description"],
        }
        for entry in _provenance()
    ]
    stars = next(item for item in _provenance() if item["data_file"] == "stars.csv")
    planets = next(item for item in _provenance() if item["data_file"] == "known_planets.csv")
    return {
        "vintage": snapshot_vintage(),
        "counts": counts,
        "notes": stars["notes"],
        "companion_updates": [
            {name: value for name, value in asdict(item).items() if value == value} for item in companion_updates()
        ],
        "known_planets": {"vintage": planets["vintage"], "notes": planets["notes"], "updates": _updates()},
        "files": files,
        "credits": [*STAR_CREDITS, *PLANET_CREDITS, *MODEL_CREDITS],
    }
