"""Build ``stellar_grid.npz``: PHOENIX line structure with the broadband metallicity trend of CK04.

Node flux: ``F(T, g, [M/H]; lambda) = F_PHOENIX(T, g; lambda) x ratio_CK04(T, g, [M/H]; lambda)``, with the
ratio ``F([M/H]) / F(0)`` of the CK04 models in eight broad bands, joined by a monotone cubic in log
wavelength. This is not the CK04 grid: its line structure is PHOENIX at solar metallicity.
"""

from __future__ import annotations

import io
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.interpolate import PchipInterpolator

from catalogs.builders._npz import write_npz
from catalogs.sources import ProvenanceEntry, SourceFile, SourcePackage, SourceStore

__all__ = ["SOURCES", "build"]

DATA_FILE = "stellar_grid.npz"

_PHOENIX_FILE = "lazuli_exo/data/tables/star/phoenix_grid.npz"
_CK04_FILE = "astroARIADNE/Datafiles/model_grids/model_grid_CK04.dat"

_LAZULI = SourcePackage(
    name="lazuli-exo",
    version="0.1.2",
    ecosystem="pypi",
    archive="lazuli_exo-0.1.2-py3-none-any.whl",
    sha256="179c88660dd9805541f43d71933773accc25bd3a9b064a077ebe7fcabbfdd0df",
    licence="BSD-3-Clause",
    files=(
        SourceFile(
            path=_PHOENIX_FILE,
            sha256="8d70ff2d232938b4dbf9b35815032e9cb504905a9ae2fd4949c9f49cf33cbaba",
            licence="BSD-3-Clause (package); model atlas public at STScI",
            citation="Allard et al. 2003, IAU Symp. 211, 325 (PHOENIX); STScI atlas grid/phoenix/phoenixm00",
            vintage="binned to R=1000 by the package on 2026-10-10",
        ),
    ),
)
_ARIADNE = SourcePackage(
    name="astroariadne",
    version="1.5.2",
    ecosystem="pypi",
    archive="astroariadne-1.5.2-py3-none-any.whl",
    sha256="d5b526e31511db47acd1023abde1d967d5241cdeae17c3df8b04d1f29b278b3c",
    licence="MIT",
    files=(
        SourceFile(
            path=_CK04_FILE,
            sha256="2e879a95281c02a3ace7f211477bdde235fc7b483fbc540ea76b2cfe3e9bd14d",
            licence="MIT (package); model atlas public at STScI",
            citation="Castelli & Kurucz 2004, arXiv:astro-ph/0405087; Vines & Jenkins 2022, MNRAS 513, 2719",
            vintage="package release 1.5.2",
        ),
    ),
)

SOURCES: tuple[SourcePackage, ...] = (_LAZULI, _ARIADNE)

_TEFF_RANGE_K = (3500.0, 8000.0)
_LOG_G_RANGE = (3.5, 5.0)
_WAVELENGTH_RANGE_UM = (0.2998, 1.7505)

# Pivot wavelengths of UBVRI from Bessell & Murphy 2012 (PASP 124, 140), SDSS z from Fukugita et al. 1996,
# isophotal wavelengths of 2MASS J and H from Cohen et al. 2003 (AJ 126, 1090).
_BANDS_NM = {
    "GROUND_JOHNSON_U": 359.7,
    "GROUND_JOHNSON_B": 437.7,
    "GROUND_JOHNSON_V": 548.8,
    "GROUND_COUSINS_R": 651.5,
    "GROUND_COUSINS_I": 798.1,
    "SDSS_z": 893.1,
    "2MASS_J": 1235.0,
    "2MASS_H": 1662.0,
}
_KNOTS_BETWEEN_BANDS = 2


def build(sources: SourceStore, out_dir: Path) -> list[ProvenanceEntry]:
    """Write the stellar grid and report where it comes from."""
    teff, log_g, wavelength_nm, log10_flam = _phoenix_cut(sources.read(_LAZULI, _PHOENIX_FILE))
    metallicity, knots_nm, ratio = _metallicity_ratio(sources.read(_ARIADNE, _CK04_FILE), teff, log_g)
    write_npz(
        out_dir / DATA_FILE,
        {
            "teff_k": teff,
            "log_g": log_g,
            "metallicity": metallicity,
            "wavelength_nm": wavelength_nm,
            "log10_flam": log10_flam,
            "ratio_wavelength_nm": knots_nm,
            "ratio": ratio,
        },
    )
    return [
        ProvenanceEntry(
            data_file=DATA_FILE,
            description="Stellar surface fluxes (erg/s/cm2/A): PHOENIX, R=1000, CK04 metallicity trend.",
            sources=((_LAZULI, _PHOENIX_FILE), (_ARIADNE, _CK04_FILE)),
            derivation=(
                "PHOENIX cut to Teff 3500-8000 K, log g 3.5-5.0, 300-1750 nm; ratio F([M/H])/F(0) of CK04 in "
                "U B V R I z J H, interpolated linearly in Teff to the PHOENIX nodes and by a monotone cubic "
                "in log wavelength to knots, constant beyond U and H; linear in log wavelength between knots."
            ),
            licence="BSD-3-Clause and MIT (packages); model atlases public at STScI",
            vintage="lazuli-exo 0.1.2, astroariadne 1.5.2",
            notes=(
                "PHOENIX line structure, CK04 broadband metallicity trend: not the CK04 spectra.",
                "Blueward of 400 nm PHOENIX and Kurucz models differ by about 7 per cent.",
                "log g below 3.5 is not in the source: giants are clamped to 3.5 and flagged by the loaders.",
            ),
        )
    ]


def _phoenix_cut(raw: bytes) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    with np.load(io.BytesIO(raw), allow_pickle=False) as table:
        teff, log_g, wavelength_um = table["teff_K"], table["logg"], table["wavelength_um"]
        keep_t = (teff >= _TEFF_RANGE_K[0]) & (teff <= _TEFF_RANGE_K[1])
        keep_g = (log_g >= _LOG_G_RANGE[0]) & (log_g <= _LOG_G_RANGE[1])
        keep_w = (wavelength_um >= _WAVELENGTH_RANGE_UM[0]) & (wavelength_um <= _WAVELENGTH_RANGE_UM[1])
        cube = table["log_flam"][:, :, 0, :][np.ix_(keep_t, keep_g, keep_w)].astype("<f4")
    return teff[keep_t], log_g[keep_g], wavelength_um[keep_w] * 1e3, cube


def _metallicity_ratio(raw: bytes, teff: np.ndarray, log_g: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return [M/H] nodes, knot wavelengths and the ratio, shape (teff, log g, [M/H], knot)."""
    lines = raw.decode("ascii").splitlines()
    names = lines[0].lstrip("# ").split()
    table = np.loadtxt(lines[1:])
    columns = [names.index(band) for band in _BANDS_NM]
    metallicity = np.unique(table[:, 2])
    model_teff = np.unique(table[(table[:, 0] >= teff[0]) & (table[:, 0] <= teff[-1]), 0])
    lookup = {(row[0], row[1], row[2]): row[columns] for row in table}
    flux = np.array([[[lookup[(t, g, m)] for m in metallicity] for g in log_g] for t in model_teff])
    ratio = flux / flux[:, :, metallicity == 0.0, :]
    at_nodes = np.apply_along_axis(lambda curve: np.interp(teff, model_teff, curve), 0, ratio)
    centres = np.log(np.array(list(_BANDS_NM.values())))
    knots = _knots(centres)
    inside = np.clip(knots, centres[0], centres[-1])
    smooth = PchipInterpolator(centres, at_nodes, axis=-1)(inside)
    # Rounded, so that the last bit of a library's arithmetic does not reach the file.
    return metallicity, np.round(np.exp(knots), 6), np.round(smooth, 6).astype("<f4")


def _knots(centres: np.ndarray) -> np.ndarray:
    """Return log wavelengths: band centres, points between them, ends of the range."""
    parts = [np.linspace(left, right, _KNOTS_BETWEEN_BANDS + 1, endpoint=False) for left, right in pairwise(centres)]
    ends = np.log(np.array(_WAVELENGTH_RANGE_UM) * 1e3)
    return np.concatenate([ends[:1], *parts, centres[-1:], ends[1:]])
