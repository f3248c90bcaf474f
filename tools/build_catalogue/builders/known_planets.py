"""Build the table of known planets of catalogue stars, ``known_planets.csv``.

Two extracts of the NASA Exoplanet Archive are distributed with EXOSIMS: the confirmed planets of 2019-05-31, and the
planets found by radial velocities of 2016-05-15. Rows and values are those of 2019. Where that default solution gives
no time of periastron or conjunction and the one of 2016 does, the orbit (period, time, eccentricity, argument of
periastron, with errors and reference) is the whole one of 2016, so that elements of two fits are never mixed; the row
is flagged. Masses, limits and assumed inclinations are read as `catalogs.known_planets` says. Errors are half
the width of the published interval; the archive's 0 for an error means that none is given.
"""

import csv
import io
import math
import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from pathlib import Path

from catalogs.exoplanet_archive import believe, host_among, settled
from catalogs.known_planets import COLUMNS, DATA_FILE, INPUT_ONLY, UPDATES_ONLY, flags_of, reference_text
from cpic_core import InputError
from tools.build_catalogue.builders import _star_sources as src
from tools.build_catalogue.builders._star_aliases import alias_rows
from tools.build_catalogue.builders._star_identity import Identity
from tools.build_catalogue.builders.stars import catalogue_people
from tools.build_catalogue.sources import ProvenanceEntry, SourceFile, SourceStore

PLANETS_FILE = "EXOSIMS/PlanetPopulation/planets_2019.05.31_11.18.02.votable"
EARLIER_FILE = "EXOSIMS/PlanetPopulation/RVplanets_ipac_2016-05-15.votable"
_CITATION = "Akeson et al. 2013, PASP 125, 989 (NASA Exoplanet Archive); extract distributed with EXOSIMS"
_LICENCE = "public (NASA Exoplanet Archive)"
PLANETS = replace(
    src.EXOSIMS,
    files=(
        SourceFile(
            path=PLANETS_FILE,
            sha256="3db8ada01e64aa9e6f728893ffeb8c7665ad9627c313dedf5b9c355b35cafde2",
            licence=_LICENCE,
            citation=_CITATION,
            vintage="confirmed planets, 2019-05-31",
        ),
        SourceFile(
            path=EARLIER_FILE,
            sha256="88e436bccbeb8836024f036708dd30f4c1eaea6dc27281a0c9e9e4a9a55cbde0",
            licence=_LICENCE,
            citation=_CITATION,
            vintage="planets found by radial velocities, 2016-05-15",
        ),
    ),
)
SOURCES = (*src.SOURCES, PLANETS)

_VOTABLE = "{http://www.ivoa.net/xml/VOTable/v1.3}"
_NEAR_DEG = 10.0 / 3600.0
_SAME_DISTANCE = 0.2

Row = dict[str, str]


def build(sources: SourceStore, out_dir: Path) -> list[ProvenanceEntry]:
    """Write the table into `out_dir` and return its provenance."""
    people = catalogue_people(sources).people
    later, earlier = _read(sources, PLANETS_FILE), {row["pl_name"]: row for row in _read(sources, EARLIER_FILE)}
    stars = _Stars(people)
    order = {person.name: number for number, person in enumerate(people)}
    found = [(star, row) for row in later if (star := stars.find(row)) is not None]
    found.sort(key=lambda item: (order[item[0]], item[1]["pl_letter"]))
    header = [name for name in COLUMNS if name not in (*INPUT_ONLY, *UPDATES_ONLY)]
    text = io.StringIO()
    writer = csv.DictWriter(text, header, lineterminator="\n", restval="")
    writer.writeheader()
    rows = [_planet(star, row, earlier.get(row["pl_name"])) for star, row in found]
    writer.writerows(rows)
    (out_dir / DATA_FILE).write_bytes(text.getvalue().encode("utf-8"))
    return [_provenance(rows)]


class _Stars:
    """Catalogue stars by the names, and checked by the places, that the archive gives."""

    def __init__(self, people: list[Identity]) -> None:
        self.aliases = {key: (name, int(kind)) for key, name, kind in alias_rows(people)}
        self.people = {person.name: person for person in people}

    def find(self, row: Row) -> str | None:
        """Return the catalogue's name of a planet's star; None if it is not in there.

        Raises
        ------
        InputError
            If names mean different stars, or the star stands elsewhere.
        """
        names = [row[key] for key in ("pl_hostname", "hd_name", "hip_name")]
        name = host_among(f"star of {row['pl_name']}", names, self.aliases)
        if name is None:
            return None
        star = self.people[name].row
        away = math.hypot(
            (float(row["ra"]) - star.star.ra_deg) * math.cos(math.radians(star.star.dec_deg)),
            float(row["dec"]) - star.star.dec_deg,
        )
        distance = float(row["st_dist"] or "nan") * star.parallax_mas / 1000.0
        if away > _NEAR_DEG or (math.isfinite(distance) and abs(distance - 1.0) > _SAME_DISTANCE):
            raise InputError(f"star of {row['pl_name']}", name, allowed="a star at the place that the archive gives")
        return name


def _read(sources: SourceStore, path: str) -> list[Row]:
    """Return the rows of a table of the archive as texts."""
    tree = ElementTree.fromstring(sources.read(PLANETS, path))  # noqa: S314 - digest verified
    fields = [node.attrib["name"] for node in tree.iter(f"{_VOTABLE}FIELD")]
    return [
        dict(zip(fields, ((cell.text or "").strip() for cell in row), strict=True))
        for row in tree.iter(f"{_VOTABLE}TR")
    ]


def _planet(star: str, row: Row, earlier: Row | None) -> dict[str, str]:
    """Return one row of the table."""
    given: tuple[str, ...] = ()
    orbit, reference = row, row["pl_def_reflink"]
    if not (row["pl_orbtper"] or row["pl_tranmid"]) and earlier is not None and earlier["pl_orbtper"]:
        orbit, reference, given = earlier, earlier["pl_def_refname"], ("earlier_orbit",)
    numbers, found = settled(row | {"pl_controv_flag": row["pl_controvflag"]}, orbit, row["pl_name"])
    for name, value in numbers.items():
        believe(row["pl_name"], name, value)
    words = {
        "star": star,
        "planet": f"{star} {row['pl_letter']}",
        "discovery_method": row["pl_discmethod"],
        "reference": reference_text(reference),
        "flags": ";".join(flags_of(numbers, given + found)),
    }
    return words | {name: repr(value) for name, value in numbers.items()}


def _provenance(rows: list[dict[str, str]]) -> ProvenanceEntry:
    dated = sum("phase_unknown" not in row["flags"].split(";") for row in rows)
    earlier = sum("earlier_orbit" in row["flags"].split(";") for row in rows)
    return ProvenanceEntry(
        data_file=DATA_FILE,
        description="published orbits of known planets of catalogue stars",
        sources=(
            (PLANETS, PLANETS_FILE),
            (PLANETS, EARLIER_FILE),
            *((src.EXOSIMS, path) for path in (src.SIMBAD_FILE, src.EXOCAT_FILE, src.SYSTEMS_FILE)),
            (src.CELESTIAL, src.CELESTIAL_FILE),
        ),
        derivation="planets of catalogue stars by name, place and distance; no value filled in, see the flags column",
        licence="public facts (NASA Exoplanet Archive); star names as in stars.csv, see STARS_LICENCE.md",
        vintage="confirmed planets of 2019-05-31; orbits flagged earlier_orbit of 2016-05-15",
        notes=(
            f"{len(rows)} planets of {len({row['star'] for row in rows})} stars",
            f"{dated} have a dated orbit with errors, {earlier} of them from the earlier table; the others' phase is "
            "unknown",
            "arguments of periastron are those of the star's orbit",
            "times are JD, HJD or BJD as published: they differ by less than 0.01 d",
        ),
    )
