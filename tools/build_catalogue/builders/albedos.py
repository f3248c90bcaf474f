"""Build ``albedo.npz``: measured geometric albedos of the four giant planets."""

from pathlib import Path

import numpy as np

from cpic_core import InputError, byte_planes, write_npz
from tools.build_catalogue.sources import ProvenanceEntry, SourceFile, SourcePackage, SourceStore

DATA_FILE = "albedo.npz"

_DIGESTS = {
    "Jupiter": "a6f92dcf237d690369dfe4e1a9dea003cd38782dc1079715e7b3d0c756e142e8",
    "Saturn": "c2d807380da8f2d04d93dfb257cab7e89f7dc01385b3910958e53470059234b0",
    "Uranus": "754189fd3892aeb08d98a0c13ddcc492a0079783f9f77abdf0f119f852a252ed",
    "Neptune": "30d715bf0fbfebcd6b8ca02cfcdb6f0a7da2e0d45a2c0c977121ca7d09ff2e69",
}


def _path(planet: str) -> str:
    return f"coronagraph/planets/{planet}_geo_albedo.txt"


_CORONAGRAPH = SourcePackage(
    name="coronagraph",
    version="1.1",
    ecosystem="pypi",
    archive="coronagraph-1.1-py2.py3-none-any.whl",
    sha256="6941fa9fae50e5297b92d74a79b36c8af5bbbdcf8dfd653957e7c73310fe1791",
    licence="MIT",
    files=tuple(
        SourceFile(
            path=_path(planet),
            sha256=digest,
            licence="MIT (package); up to 1.05 um public domain (PDS data set GBAT_0001)",
            citation="Karkoschka 1998, Icarus 133, 134; Lustig-Yaeger et al. 2019, JOSS 4, 1387",
            vintage="observed 1995; origin beyond 1.05 um undocumented",
        )
        for planet, digest in _DIGESTS.items()
    ),
)

SOURCES: tuple[SourcePackage, ...] = (_CORONAGRAPH,)

# The source writes wavelengths with single-precision noise in the eighth digit: rounded to 0.001 nm.
_RANGE_NM = (300.0, 1755.0)
_DOCUMENTED_TO_NM = 1050.0


def build(sources: SourceStore, out_dir: Path) -> list[ProvenanceEntry]:
    """Write the albedo table and report where it comes from."""
    arrays: dict[str, np.ndarray] = {}
    for planet in _DIGESTS:
        table = np.loadtxt(sources.read(_CORONAGRAPH, _path(planet)).decode("ascii").splitlines())
        wavelength_nm = np.round(table[:, 0] * 1e3, 3)
        keep = (wavelength_nm >= _RANGE_NM[0]) & (wavelength_nm <= _RANGE_NM[1])
        known = arrays.setdefault("wavelength_nm", wavelength_nm[keep])
        if not np.array_equal(known, wavelength_nm[keep]):
            raise InputError(_path(planet), "another wavelength column", allowed="the sampling of the first planet")
        arrays[planet.lower()] = byte_planes(table[keep, 1].astype("<f4"))
    arrays["documented_to_nm"] = np.array(_DOCUMENTED_TO_NM)
    write_npz(out_dir / DATA_FILE, arrays, deflated=False)
    return [
        ProvenanceEntry(
            data_file=DATA_FILE,
            description="Geometric albedo of Jupiter, Saturn, Uranus and Neptune, 300-1755 nm by 0.4 nm.",
            sources=tuple((_CORONAGRAPH, _path(planet)) for planet in _DIGESTS),
            derivation="Rows up to 1755 nm, wavelength in nm, no smoothing.",
            licence="MIT; up to 1050 nm public domain",
            vintage="observed 1995 (up to 1050 nm)",
            notes=(
                "Up to 1050 nm: Karkoschka 1998 low-resolution table. "
                "Beyond: origin undocumented in the source, flagged as extrapolated by the loaders.",
                "Jupiter, Saturn: full-disk albedo at about 6 degrees phase; Uranus, Neptune: geometric.",
            ),
        )
    ]
