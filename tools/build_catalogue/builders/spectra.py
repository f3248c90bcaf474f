"""Build ``stellar_grid.npz``: PHOENIX line structure on PHOENIX broadband fluxes, with the trends of CK04.

Node flux: ``F(T, g, [M/H]; lambda) = F_line(T, g; lambda) x ratio(T, g, [M/H]; lambda)``. The line structure is that
of BT-NextGen at solar metallicity; below its lowest gravity, that of its lowest gravity. The ratio, linear in log
wavelength between the mean wavelengths of nine bands, is solved so that the node has the band fluxes

    ``B(T, g, [M/H]) = B_ACES(T, max(g, 3.5), 0) x B_CK04(T, g, [M/H]) / B_CK04(T, max(g, 3.5), 0)``

that is, the level of the PHOENIX-ACES models and the CK04 trends with metallicity and with low gravity. ACES itself is
not used below log g 3.5, where its band fluxes are not smooth. Why ACES: measured dwarfs (Pickles 1998, F2V-K7V) and
mean colours of dwarfs (Pecaut & Mamajek 2013) have more light at 400-450 nm than BT-NextGen and CK04. This is neither
the ACES nor the CK04 grid: its lines are those of BT-NextGen.

Dwarfs below 5200 K are too blue in V-R, V-I and V-J in ACES (by 0.05 to 0.1 mag in V-I from 4600 K on), too red in
BT-NextGen. Their bands R, I, z and J relative to y are therefore a weighted mean of the two: the weight of BT-NextGen
is chosen so that V-I and V-J lie between the measured sequences of Casagrande et al. 2010 (A&A 512, A54) and Pecaut &
Mamajek 2013. Giants are left as they were: no such calibration was used for them.

From 5200 K on ACES is too bright in the red: at the Sun's V by up to 4.5 % against the Sun that TSIS-1 has measured to
0.3 % (`_RED_EXCESS`), and by as much against the photometry of 44 dwarfs of 5200 to 6500 K (Casagrande et al. 2006,
MNRAS 373, 13, with the zero points of 2MASS of Maiz Apellaniz & Pantaleoni Gonzalez 2018, A&A 616, L7): by 2.4 % in I,
2.8 in J and 6.0 in H, in the median, without a trend with temperature; 0.7, 0 and 1.3 % are left. Dwarfs of 4600 K
show no such excess: there the level stays, and between the two a part of it is taken out.
"""

import io
from dataclasses import replace
from pathlib import Path

import numpy as np

from cpic_core import InputError, byte_planes, write_npz
from tools.build_catalogue.builders import references
from tools.build_catalogue.sources import ProvenanceEntry, SourceFile, SourcePackage, SourceStore

DATA_FILE = "stellar_grid.npz"

_PHOENIX_FILE = "lazuli_exo/data/tables/star/phoenix_grid.npz"
_CK04_FILE = "astroARIADNE/Datafiles/model_grids/model_grid_CK04.dat"
_ACES_FILE = "astroARIADNE/Datafiles/model_grids/model_grid_Phoenixv2.dat"
_NEXTGEN_FILE = "astroARIADNE/Datafiles/model_grids/model_grid_BT_NextGen.dat"
_FILTER_FOLDER = "pyphot/libs/ascii_sources/"

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
            citation=(
                "Allard et al. 2003, IAU Symp. 211, 325; Allard, Homeier & Freytag 2012, Phil. Trans. R. Soc. A 370, "
                "2765; STScI atlas grid/phoenix/phoenixm00"
            ),
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
        SourceFile(
            path=_ACES_FILE,
            sha256="06c5f5cd986172595c6d3275775ab1565314ada4325834f3f1613f595398e563",
            licence="MIT (package); model atlas public at Goettingen",
            citation="Husser et al. 2013, A&A 553, A6; Vines & Jenkins 2022, MNRAS 513, 2719",
            vintage="package release 1.5.2",
        ),
        SourceFile(
            path=_NEXTGEN_FILE,
            sha256="94554d7cce31f1edeb2dabe4242b6c0ea6d1b092e55358aff4d1142ff6ca06f5",
            licence="MIT (package); model atlas public at Lyon",
            citation=(
                "Allard, Homeier & Freytag 2012, Phil. Trans. R. Soc. A 370, 2765; "
                "Vines & Jenkins 2022, MNRAS 513, 2719"
            ),
            vintage="package release 1.5.2",
        ),
    ),
)

# Bands of the broadband tables, from blue to red, with the curves that made the tables.
_BANDS = {
    "GROUND_JOHNSON_U": ("ground_johnson_u.csv", "d63e7952396b194aa00edc071f50dfadea4acee0912d152f033f67f1736ce2ca"),
    "STROMGREN_v": ("stromgren_v.csv", "fe84440e397878d92b404ecb2b939918e256fb66a357a776d7ab67d5ba37275f"),
    "STROMGREN_b": ("stromgren_b.csv", "04ff43cacd5d8ab9628090684f6447f7c171f02faf937a743c76fbef6c4f1f7d"),
    "STROMGREN_y": ("stromgren_y.csv", "513356b0e4da9e1bbef3ea99c831cf83443a03f90d79421a66bf5a9ddc557011"),
    "GROUND_COUSINS_R": ("ground_cousins_r.csv", "963ad1e418e6f500ca8108485bf6f8815f7e9d90157fd459a641e9dafe682874"),
    "GROUND_COUSINS_I": ("ground_cousins_i.csv", "eca8cf3e7ba96f51363c347d53281be9d4fd43e2ad58d4321a78f41f9f6c7182"),
    "SDSS_z": ("sdss_z.csv", "235f1dcdf0586e60f57e906c72abe48b3c9ccd17d65c3b30fe621d8311ef3598"),
    "2MASS_J": ("2mass_j.csv", "ede3f4bd09d42d728be0bfd078c8fff14910e191f9a07e97cf52ffa861509f7f"),
    "2MASS_H": ("2mass_h.csv", "1e4f788e0d2e360dd519b99d8c13ee724cc03e26e5e11efea53c92b7d3f1836c"),
}
_PYPHOT = replace(
    next(package for package in references.SOURCES if package.name == "pyphot"),
    files=tuple(
        SourceFile(
            path=_FILTER_FOLDER + name,
            sha256=digest,
            licence="MIT (package)",
            citation="Fouesneau, pyphot 2.1.1, filter library",
            vintage="package release 2.1.1",
        )
        for name, digest in _BANDS.values()
    ),
)

SOURCES: tuple[SourcePackage, ...] = (_LAZULI, _ARIADNE, _PYPHOT)

_LEVEL_FILES = (_ACES_FILE, _NEXTGEN_FILE)
_REFERENCE_BAND = "STROMGREN_y"
_COOL_BANDS = ("GROUND_COUSINS_R", "GROUND_COUSINS_I", "SDSS_z", "2MASS_J")
_COOL_SHARE = 0.45  # of BT-NextGen in these bands of cool dwarfs
_COOL_TEFF_K = (4600.0, 5200.0)  # whole share below, none above
_DWARF_LOG_G = 4.0
# What ACES has more of than the Sun, at its V: from the bins of the TSIS-1 HSRS (Coddington et al. 2021) that
# `reports/external` records.
_RED_EXCESS = {
    "GROUND_COUSINS_R": 0.003,
    "GROUND_COUSINS_I": 0.016,
    "SDSS_z": 0.014,
    "2MASS_J": 0.027,
    "2MASS_H": 0.045,
}

_TEFF_RANGE_K = (3500.0, 8000.0)
_LOG_G_RANGE = (3.5, 5.0)
_WAVELENGTH_RANGE_NM = (299.8, 1750.5)
# The tables are per um, the line structure per A.
_PER_A = 1e-4


def build(sources: SourceStore, out_dir: Path) -> list[ProvenanceEntry]:
    """Write the stellar grid and report where it comes from."""
    teff, line_log_g, wavelength_nm, log10_flam = _line_structure(sources.read(_LAZULI, _PHOENIX_FILE))
    trend = _Broadband(sources.read(_ARIADNE, _CK04_FILE))
    base = np.maximum(trend.log_g, line_log_g[0])
    aces, next_gen = (_solar(_Broadband(sources.read(_ARIADNE, path)), teff, base, path) for path in _LEVEL_FILES)
    target = _targets(teff, trend, base, _as_the_sun(teff, _cool_dwarfs(teff, trend.log_g, aces, next_gen)))
    filters = [_filter(sources.read(_PYPHOT, _FILTER_FOLDER + name)) for name, _ in _BANDS.values()]
    knots_nm = np.round([_mean_wavelength(*curve[:2]) for curve in filters], 2)
    line = np.searchsorted(line_log_g, np.maximum(trend.log_g, line_log_g[0]))
    ratio = _solve(wavelength_nm, log10_flam, knots_nm, filters, target, line)
    keep = (wavelength_nm >= _WAVELENGTH_RANGE_NM[0]) & (wavelength_nm <= _WAVELENGTH_RANGE_NM[1])
    write_npz(
        out_dir / DATA_FILE,
        {
            "teff_k": teff,
            "log_g": trend.log_g,
            "metallicity": trend.metallicity,
            "wavelength_nm": wavelength_nm[keep],
            "line_log_g": line_log_g,
            "log10_flam": byte_planes(log10_flam[:, :, keep]),
            "ratio_wavelength_nm": knots_nm,
            "ratio": byte_planes(ratio),
        },
        deflated=False,  # the same bytes whatever the version of zlib
    )
    return [_provenance()]


def _provenance() -> ProvenanceEntry:
    filters = tuple((_PYPHOT, _FILTER_FOLDER + name) for name, _ in _BANDS.values())
    return ProvenanceEntry(
        data_file=DATA_FILE,
        description="Stellar surface fluxes (erg/s/cm2/A): PHOENIX lines, R=1000; PHOENIX-ACES level; CK04 trends.",
        sources=((_LAZULI, _PHOENIX_FILE), *((_ARIADNE, path) for path in (*_LEVEL_FILES, _CK04_FILE)), *filters),
        derivation=(
            "Line structure: BT-NextGen, Teff 3500-8000 K, log g 3.5-5.0, 300-1750 nm, solar. Band fluxes in U, v b y, "
            "R I, z, J H: PHOENIX-ACES at the same node (log g 3.5 for lower gravities) times the CK04 ratio to solar "
            "metallicity and log g 3.5 or above, interpolated linearly in Teff. R, I, z and J relative to y of dwarfs "
            "(log g 4 or above) are drawn towards BT-NextGen: by 45 % up to 4600 K, falling to 0 at 5200 K. From there "
            "R, I, z, J and H are divided by what ACES has more of than the Sun of TSIS-1 (0.3, 1.6, 1.4, 2.7 and "
            "4.5 %), below 4600 K by nothing, between the two by a part. The "
            "factor on the line structure, linear in log wavelength between the bands and constant beyond, gives each "
            "node these band fluxes exactly."
        ),
        licence="BSD-3-Clause and MIT (packages); model atlases public at STScI, Goettingen and Lyon",
        vintage="lazuli-exo 0.1.2, astroariadne 1.5.2, pyphot 2.1.1",
        notes=(
            "PHOENIX lines, PHOENIX-ACES level, CK04 broadband trends: not the CK04 spectra.",
            "The source of the lines does not name its version: above 5000 K its bands are those of BT-NextGen to 1 %.",
            "Gravities below 3.5 have the lines of log g 3.5; nodes without a CK04 model (log g 0 above 6000 K, "
            "0.5 above 7400 K) are zero and refused.",
            "V-I and V-J of dwarfs of 4400-6600 K lie within 5 % in flux of Casagrande et al. 2010 and of Pecaut & "
            "Mamajek 2013.",
            "Blueward of 400 nm models of different authors differ by about 10 per cent.",
        ),
    )


def _line_structure(raw: bytes) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return Teff, log g, all wavelengths (nm; the bands reach beyond the shipped range) and log10 fluxes."""
    with np.load(io.BytesIO(raw), allow_pickle=False) as table:
        teff, log_g, wavelength_um = table["teff_K"], table["logg"], table["wavelength_um"]
        keep_t = (teff >= _TEFF_RANGE_K[0]) & (teff <= _TEFF_RANGE_K[1])
        keep_g = (log_g >= _LOG_G_RANGE[0]) & (log_g <= _LOG_G_RANGE[1])
        cube = table["log_flam"][:, :, 0, :][np.ix_(keep_t, keep_g)].astype("<f4")
    return teff[keep_t], log_g[keep_g], wavelength_um * 1e3, cube


class _Broadband:
    """A table of band fluxes (erg/s/cm2/um), one row a model; zero where there is none."""

    def __init__(self, raw: bytes) -> None:
        lines = raw.decode("ascii").splitlines()
        names = lines[0].lstrip("# ").split()
        table = np.loadtxt(lines[1:], ndmin=2)
        columns = [names.index(band) for band in _BANDS]
        self._rows = {(row[0], row[1], row[2]): row[columns] for row in table}
        self.teff_k, self.log_g, self.metallicity = (np.unique(table[:, i]) for i in range(3))

    def flux(self, teff_k: float, log_g: float, metallicity: float) -> np.ndarray:
        """Return the band fluxes of one model; zeros if it is missing."""
        return np.asarray(self._rows.get((teff_k, log_g, metallicity), np.zeros(len(_BANDS))))


def _solar(table: _Broadband, teff: np.ndarray, base: np.ndarray, path: str) -> np.ndarray:
    """Return the band fluxes at solar metallicity, shape (teff, log g, band), erg/s/cm2/A."""
    fluxes = np.array([[table.flux(t, g, 0.0) for g in base] for t in teff]) * _PER_A
    if not fluxes.all():
        raise InputError(path, "a model is missing", allowed="all nodes at solar metallicity")
    return fluxes


def _cool_dwarfs(teff: np.ndarray, log_g: np.ndarray, aces: np.ndarray, next_gen: np.ndarray) -> np.ndarray:
    """Return the fluxes of ACES, with the red bands of cool dwarfs drawn towards those of BT-NextGen."""
    names = list(_BANDS)
    red, reference = [names.index(band) for band in _COOL_BANDS], names.index(_REFERENCE_BAND)
    own, other = (flux[..., red] / flux[..., [reference]] for flux in (aces, next_gen))
    share = np.interp(teff, _COOL_TEFF_K, (_COOL_SHARE, 0.0))[:, None] * (log_g >= _DWARF_LOG_G)
    level = aces.copy()
    level[..., red] *= 1.0 + share[..., None] * (other / own - 1.0)
    return level


def _as_the_sun(teff: np.ndarray, level: np.ndarray) -> np.ndarray:
    """Return the fluxes with the excess of the red bands taken out: whole above the cool dwarfs, none below."""
    excess = np.array([_RED_EXCESS.get(band, 0.0) for band in _BANDS])
    share = np.interp(teff, _COOL_TEFF_K, (0.0, 1.0))
    return np.asarray(level / (1.0 + share[:, None, None] * excess))


def _targets(teff: np.ndarray, trend: _Broadband, base: np.ndarray, levels: np.ndarray) -> np.ndarray:
    """Return the band fluxes of all nodes, shape (teff, log g, [M/H], band), erg/s/cm2/A; 0 where CK04 ends."""
    at = trend.teff_k[(trend.teff_k >= teff[0]) & (trend.teff_k <= teff[-1])]
    solar = np.array([[trend.flux(t, g, 0.0) for g in base] for t in at])
    ratio = np.array([[[trend.flux(t, g, m) for m in trend.metallicity] for g in trend.log_g] for t in at])
    ratio /= solar[:, :, None, :]
    left = np.clip(np.searchsorted(at, teff, side="right") - 1, 0, at.size - 2)
    share = ((teff - at[left]) / (at[left + 1] - at[left]))[:, None, None, None]
    mixed = (1.0 - share) * ratio[left] + share * ratio[left + 1]
    # A node needs every model that it leans on.
    exists = ((ratio[left] > 0.0) | (share == 1.0)) & ((ratio[left + 1] > 0.0) | (share == 0.0))
    return levels[:, :, None, :] * np.where(exists.all(axis=-1, keepdims=True), mixed, 0.0)


def _solve(
    wavelength_nm: np.ndarray,
    log10_flam: np.ndarray,
    knots_nm: np.ndarray,
    filters: list[tuple[np.ndarray, np.ndarray, bool]],
    target: np.ndarray,
    line: np.ndarray,
) -> np.ndarray:
    """Return the factors at the knots that give the line structure the target band fluxes."""
    means = np.array([_mean_flux_weights(wavelength_nm, *curve) for curve in filters])
    log_knots, log_wavelength = np.log(knots_nm), np.log(wavelength_nm)
    hats = np.array([np.interp(log_wavelength, log_knots, unit) for unit in np.eye(knots_nm.size)])
    matrix = np.einsum("bs,tgs,ks->tgbk", means, 10.0 ** log10_flam.astype(np.float64), hats, optimize=True)
    ratio: np.ndarray = np.linalg.solve(matrix[:, line], target.swapaxes(-1, -2)).swapaxes(-1, -2)
    missing = target.sum(axis=-1) == 0.0
    if not np.all(ratio[~missing] > 0.0):
        raise InputError("ratio", float(ratio[~missing].min()), allowed="above 0 at every node that exists")
    # Rounded, so that the last bit of a library's arithmetic does not reach the file.
    return np.where(missing[..., None], 0.0, np.round(ratio, 6)).astype("<f4")


def _filter(raw: bytes) -> tuple[np.ndarray, np.ndarray, bool]:
    """Return wavelengths (nm), transmission, and whether the band counts photons (else energy)."""
    lines = raw.decode("ascii").splitlines()
    detector = next(line.split()[-1] for line in lines if line.startswith("# DETECTOR"))
    start = lines.index("WAVELENGTH,THROUGHPUT") + 1
    table = np.array([[float(field) for field in line.split(",")] for line in lines[start:]])
    return table[:, 0] / 10.0, table[:, 1], detector == "photon"


def _mean_wavelength(wavelength_nm: np.ndarray, transmission: np.ndarray) -> float:
    weight = np.trapezoid(transmission, wavelength_nm)
    return float(np.trapezoid(transmission * wavelength_nm, wavelength_nm) / weight)


def _mean_flux_weights(
    samples_nm: np.ndarray, wavelength_nm: np.ndarray, transmission: np.ndarray, photons: bool
) -> np.ndarray:
    """Return weights with ``w @ flam`` = mean flux in the band, by the trapezoid on all samples."""
    inside = samples_nm[(samples_nm > wavelength_nm[0]) & (samples_nm < wavelength_nm[-1])]
    x = np.unique(np.concatenate([inside, wavelength_nm]))
    weight = np.interp(x, wavelength_nm, transmission) * (x if photons else 1.0)
    weight[1:-1] *= 0.5 * (x[2:] - x[:-2])
    weight[[0, -1]] *= 0.5 * (x[[1, -1]] - x[[0, -2]])
    right = np.clip(np.searchsorted(samples_nm, x), 1, samples_nm.size - 1)
    share = (x - samples_nm[right - 1]) / (samples_nm[right] - samples_nm[right - 1])
    size = samples_nm.size
    upper = np.bincount(right, weights=weight * share, minlength=size)
    total: np.ndarray = upper + np.bincount(right - 1, weights=weight * (1.0 - share), minlength=size)
    return np.asarray(total / weight.sum())
