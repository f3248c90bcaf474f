"""Build ``reference_spectra.npz``: Sun and Vega (CALSPEC) and the Johnson V transmission."""

import io
import warnings
from pathlib import Path

import numpy as np

from cpic_core import byte_planes, write_npz
from tools.build_catalogue.sources import ProvenanceEntry, SourceFile, SourcePackage, SourceStore

DATA_FILE = "reference_spectra.npz"

_SUN_FILE = "pyphot/libs/sun_reference_stis_001.fits"
_VEGA_FILE = "wcc_etc/data/astrophysics/alpha_lyr_stis_011.fits"
_V_FILE = "wcc_etc/data/throughput/other_filters/johnson_v_004_syn.fits"

_PYPHOT = SourcePackage(
    name="pyphot",
    version="2.1.1",
    ecosystem="pypi",
    archive="pyphot-2.1.1-py3-none-any.whl",
    sha256="98937d2ee371a7fd490ce1528474fd3a8da0a033da9e9b236a5a4a93d52a3456",
    licence="MIT",
    files=(
        SourceFile(
            path=_SUN_FILE,
            sha256="50e64211bc8ddca60360eeb351c171d11d3641569274f12c788db0686ac9be14",
            licence="public domain (CALSPEC, STScI)",
            citation=("Colina, Bohlin & Castelli 1996, AJ 112, 307; Bohlin, Dickinson & Calzetti 2001, AJ 122, 2118"),
            vintage="CALSPEC sun_reference_stis_001, 2001",
        ),
    ),
)
_WCC_ETC = SourcePackage(
    name="wcc-etc",
    version="0.1.1",
    ecosystem="pypi",
    archive="wcc_etc-0.1.1-py3-none-any.whl",
    sha256="06037a45b12c869806dc3f6d6ed2c17e73af3ceedca913734875a7f558027ba7",
    licence="BSD-3-Clause",
    files=(
        SourceFile(
            path=_VEGA_FILE,
            sha256="60aebf5c193223f69061cd176d6309730c3210051fffad0dd6ad44475199ceaa",
            licence="public domain (CALSPEC, STScI)",
            citation="Bohlin 2014, AJ 147, 127; Bohlin, Hubeny & Rauch 2020, AJ 160, 21",
            vintage="CALSPEC alpha_lyr_stis_011",
        ),
        SourceFile(
            path=_V_FILE,
            sha256="98748a8f56bc2ff2cd026ff90b85564cb643e2ca3dca972043cf1d030ac2c02c",
            licence="public domain (STScI reference file)",
            citation="Maiz Apellaniz 2006, AJ 131, 1184",
            vintage="2006-03-30",
        ),
    ),
)

SOURCES: tuple[SourcePackage, ...] = (_PYPHOT, _WCC_ETC)

_RANGE_NM = (299.0, 1755.0)


def build(sources: SourceStore, out_dir: Path) -> list[ProvenanceEntry]:
    """Write the reference spectra and report where they come from."""
    sun = _columns(sources.read(_PYPHOT, _SUN_FILE), "FLUX")
    vega = _columns(sources.read(_WCC_ETC, _VEGA_FILE), "FLUX")
    johnson_v = _columns(sources.read(_WCC_ETC, _V_FILE), "THROUGHPUT")
    write_npz(
        out_dir / DATA_FILE,
        {
            "sun_wavelength_nm": sun[0],
            "sun_flam": byte_planes(sun[1]),
            "vega_wavelength_nm": vega[0],
            "vega_flam": byte_planes(vega[1]),
            "johnson_v_wavelength_nm": johnson_v[0],
            "johnson_v_transmission": byte_planes(johnson_v[1]),
        },
        deflated=False,  # the same bytes whatever the version of zlib
    )
    return [
        ProvenanceEntry(
            data_file=DATA_FILE,
            description="Spectra of the Sun at 1 AU and of Vega (erg/s/cm2/A); Johnson V transmission.",
            sources=((_PYPHOT, _SUN_FILE), (_WCC_ETC, _VEGA_FILE), (_WCC_ETC, _V_FILE)),
            derivation="Rows of 299-1755 nm, wavelength in nm; V complete (470-700 nm, photon counting).",
            licence="public domain",
            vintage="CALSPEC sun_reference_stis_001, alpha_lyr_stis_011; johnson_v_004",
            notes=("The Sun redward of 960 nm is a Kurucz model in the source.",),
        )
    ]


def _columns(raw: bytes, column: str) -> tuple[np.ndarray, np.ndarray]:
    """Return wavelength in nm (float64) and `column` in its stored precision, inside the range."""
    from astropy.io import fits

    with warnings.catch_warnings():
        # The STScI files carry floating TNULL and exotic TDISP cards that do not touch the data.
        warnings.simplefilter("ignore")
        with fits.open(io.BytesIO(raw)) as hdus:
            table = hdus[1].data
            wavelength_nm = np.array(table["WAVELENGTH"], dtype="<f8") / 10.0
            values = np.array(table[column], dtype="<f4")
    keep = (wavelength_nm >= _RANGE_NM[0]) & (wavelength_nm <= _RANGE_NM[1])
    return wavelength_nm[keep], values[keep]
