"""Build ``pickles.npz``: measured stellar spectra by spectral type, the Pickles 1998 library.

Types A0 to M6 of solar metallicity in classes V, IV, III, II and I; the library's metal-weak and metal-rich variants
are left out. Every file is the library's own spectrum (5 A steps), not a substitute: its header names the template.
"""

import io
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np

from catalogs import parse_spectral_type
from cpic_core import InputError, byte_planes, write_npz
from tools.build_catalogue.builders import references
from tools.build_catalogue.sources import ProvenanceEntry, SourceFile, SourceStore

DATA_FILE = "pickles.npz"

_FOLDER = "wcc_etc/data/astr_obj_models/stars/pickles_models/dat_uvk/"
# Number of the file, its type (ranges such as F0-2IV by their middle) and its digest.
_FILES = {
    9: ("A0V", "5a1c2ba27a4ec837c65de9b25138084e25e03717a92c974ae8846c33b1fec16b"),
    10: ("A2V", "d5c3fda73d4cae4cd0684073cf845ee938ac69f20c1e90d596bc9cf79764a2cf"),
    11: ("A3V", "231dbaec0e317eacad1aa13db52ebb35d7c68342302058be5853e29b4b37f9c3"),
    12: ("A5V", "312eb5953492c8e7726402ce2c5335f83b6b18727722f907124fed4de37688f3"),
    13: ("A7V", "c77a20ed3cab67d5497d5702229a528cf83ce2d64963d69f674ceef333e05d50"),
    14: ("F0V", "a5e96ddf39561081b7be159f3a0191f94ce53f0277d21ce8ec400636c8c061e7"),
    15: ("F2V", "c56386d470272996de8e9c69e9b5a4f51c412830e0e3abd3dd36789b852d5e84"),
    16: ("F5V", "3a53ac62c18e13946e42572f683927b0aa710cda4ad04e0c52680f38ffe74ec5"),
    18: ("F6V", "3c90dba286f3059e74660061b5efcbb73a6f9c8d648c48c334ce824a16572859"),
    20: ("F8V", "df8f1179119991e3cc2fc986f3b74b36202852a46ea72fbd3e3d4600ab6ef9c0"),
    23: ("G0V", "7bc4baa3326ef2a6b22f672512f4a0399a4d0092e4e2a5823c26824ba63b4b1b"),
    26: ("G2V", "a2620fef1f8bba02b3958998f6310cf08f5536eacded0cba1ba75d043d9146e2"),
    27: ("G5V", "8aecc05786d71e811131ab2ed14f71fab2c3d265e5b3a45b686352013bacde73"),
    30: ("G8V", "56c222ad10d411fcd94888a1c203d572e99db9ccb65e6573b7864f70c56d0041"),
    31: ("K0V", "9c6fcf58dd2623b16e34512417cb2d8dbb2e948791119f234daed3019311c52c"),
    33: ("K2V", "2fb8df8061a5bfb4041e8147b7c2375f79df3a49b83a682d52747646cd027771"),
    34: ("K3V", "7c55a411960c282c063e2aa1952cfa80edab62788745b166c186a872b52991d2"),
    35: ("K4V", "5e446b6874622021f44fb8fe81de86382c917188c1c38a60c734c636124d1cb9"),
    36: ("K5V", "68249e9d81195f6fa718f2b7a9c2440c26079d3515a0623782964e88df0adace"),
    37: ("K7V", "46bcb11b5d63c9ef20520bacfe7e3868acac126dfbd1aa3a48b6fad4bab44206"),
    38: ("M0V", "8e6d216d67f2372baef5b8b5ade8054af122826e72a5f78a7877fa04f0650e52"),
    39: ("M1V", "e1ed87f61f7acece016b24f5537c7c3029313010f452762e293a38feef756851"),
    40: ("M2V", "3e45e7e2dbb0733cfadc652b90a6265c9e86ddfe1f5bf81bd133421ad8db8752"),
    41: ("M2.5V", "fdf1f2f4a25138340a7e746a9277ce72ec65a81e93627db4303c3fa2ef52b2b3"),
    42: ("M3V", "6c472661aa757a84e8fd271e3268ecba177b8e9151b21c6199ef4ee969ab7dbd"),
    43: ("M4V", "755d9bb847ed030becc88ad6092290e13f7b3e2647ea0282c8f455abfe209a42"),
    44: ("M5V", "448388da3ae180049c770f9ec33b8fa4058bdf80b9a802cad0d5b015c4799810"),
    45: ("M6V", "ad26ed69b72c462c68241e8fb1501835fb61c81b4b2840f937e9ba61a3b65a57"),
    48: ("A0IV", "9f0f574421aa163106ab40517a33bed1600e0640813aab6b666cd2c0d763f08d"),
    49: ("A5.5IV", "352d001e4f8f6099ec80d57de3fee5c35fc75c7a0c035016144beb16f725c553"),
    50: ("F1IV", "39e971021ee4ffe50f7b86f630bcf0fcfbbf2ed2d61a318da395958c824aca4d"),
    51: ("F5IV", "04a2acbddaae61ac230b94a1dd667bf8a3c97ecdf982ce703aabf43f223856db"),
    52: ("F8IV", "cdaded5c6c533c35fcddce021e5032ef4bc2a92185d95717c219761bcc0e61a2"),
    53: ("G0IV", "bfdde400721b373599f4e6675ee8b027d0e3924de158c79e9797fee018f137f0"),
    54: ("G2IV", "b8f1783cde8bba7fa5cb710d05628233e5d35415bb87ff1adf5ca97d430da3f1"),
    55: ("G5IV", "af25fc3fdc478d1b3a15c3c1939c64f587e379a4fbae5974c9787919a51e1331"),
    56: ("G8IV", "1defecb770125f7e46f93c1bcc82fa7d3e766c67cdade3ec3e9250888a3cbdaf"),
    57: ("K0IV", "7b4484d8064fbbe58519dd7234e34c8ddeda5021c2057550fb6057282978a588"),
    58: ("K1IV", "d02f4cb1ed9c26d31cada3a9551ca0b78edd0e69d747e29e29df7ee3511c5962"),
    59: ("K3IV", "1451def6f5ad6e5257da07daf1027c3fe3b5ed54cb09beeb85ccfc14a102ac9b"),
    65: ("A0III", "9ad12a361f6896ead75f542f00cdbc4c1e9ea04c7a92da13227c847eac3089b2"),
    66: ("A3III", "74975648d12c289699081d71e2ddb1043c2a9a9ab4e517ccf65806a624c4c59a"),
    67: ("A5III", "84af94710ae5211338efc0afa5a05e2bb2f0f83a8e2711b2ada319266ae6e9f3"),
    68: ("A7III", "c641f249dacba8b7a01260731723eb7df8774015b8b5485734f80a18c84b54cd"),
    69: ("F0III", "813a1498939e08249fdc1790172fb00e12c9edb5d2196f3a81244232bf1bf43d"),
    70: ("F2III", "6a150c20ab306869a3043d20eb757f77453c0529d62a2d1305638ddc1d033f56"),
    71: ("F5III", "ac70829cb996bf936a70c143cc693ae6149f646a619c202a6e67d15500ded2e8"),
    72: ("G0III", "c61e483aca205a7f5e0daa7eee6191f1e98ab17cfc3e7ae98a7679e9e589eb24"),
    73: ("G5III", "2fa6ff138fea0e8bd4c77827ce98ea23ae7602b94e200dd47d43e90805bdbf84"),
    76: ("G8III", "0f49a64ded2c4c709b654313d633773df99937c5e6645123b56246125f6835af"),
    78: ("K0III", "2ec76b9dcf5fdfcf78e19d74e57404551225591d0b2af113cc0fbc84975debee"),
    81: ("K1III", "4724da1076050c0c08251c712376fd0fa4073a11d5404a6c286f3ec9aa54250e"),
    84: ("K2III", "7df9abb5dd273487d73ef7fac33f5b385c71c15637fd96f61046cb4406ab00fd"),
    87: ("K3III", "b0f854ab0f307eda6578fd21e6fe13271c85dc304182ce5898b4de2f98face80"),
    90: ("K4III", "c77edf09d9f3693d9039883d6fe7b6519e451a7154e773265585ffe7bfb7cd57"),
    93: ("K5III", "50a565dbdf989b8d3f7b1a3dfbb6f752f36a7e0bc3a561407a21c17d84381d1a"),
    95: ("M0III", "b78e410bfc5cfeebd04910e4bf1ad4c5d276b63efb84e8a73cddb464308d03bd"),
    96: ("M1III", "7e04d38c4f6a9d00c4a8c003a248947a1be14a98f9b49f2bb7edb94bd52b478f"),
    97: ("M2III", "74985a5cc29343e408a0b1ab042985646a0a4c3e2f23ab730bae2013533aeff1"),
    98: ("M3III", "f352c7beff0086fffe1346ab53504040e2c3297c6a38025a83bcd9d0d81fbe81"),
    99: ("M4III", "061a9df671ab579be8f874e3281a13f8013b0fa223d8e2075f2524dbf90edd37"),
    100: ("M5III", "8d1c33193a7f6f7cc0140f1bece9f2f4afeca3654f02fc27801f72648858fae0"),
    101: ("M6III", "07337d0277a50080d8e81ae81c6c51969eb672219c43985a4a8011b663c62df9"),
    108: ("F0II", "13bef5c37d3383a84cdaac35f0c79e2798ab4ba1236cae1c63d2a35f694fb0d2"),
    109: ("F2II", "d97f678c83f6c8c652ff115fd5babd4f13b0358d0c05442704a7a997f7064f25"),
    110: ("G5II", "09673a7f53555216187a7bff1d47e7b9ff52d094176d7ccede45fc31536caee8"),
    111: ("K0.5II", "05ced355c7b303e9d2faa3b5f7f300ca818a84e7ece1529a6c8b8cd66afa995c"),
    112: ("K3.5II", "1668216371198670fd1b28da66482c58d3b17c9d1f024fb8a466145d4b481db9"),
    113: ("M3II", "e9ccc66ab4f4d07db281bb78179a31ded278507708ec5e1cdc3f19bfe22a9ba6"),
    119: ("A0I", "33309d3fc012ae02525a6160ff5581050affbb3553efaf0035c9a7f35e1a7010"),
    120: ("A2I", "63f355d780b0f6f0f3eb0752f64e7af2d64ad287573b5d07421f44edde500bc0"),
    121: ("F0I", "2bc647e2d561fba3ceb568eed9920cda0c4f5c91bc45e32ca3aa3fe40506b93b"),
    122: ("F5I", "dd731933e7f2e73163f8db69345f5fdc742fd3c30eb11086b683bb273d3ffa91"),
    123: ("F8I", "f0dec5086ffc9bb19864a87bdcd6f751c4e1653f8baba1aaa8b83f1a2758bc48"),
    124: ("G0I", "8202a242ced835d603abaeeebe98e082d76bb9d8400fcfd9ee9ee33adcb32dd0"),
    125: ("G2I", "6f41e46436944bb892cf1b9f7e72ebf6b1e53e9f8e770ac03d2d39c1bb05cf6c"),
    126: ("G5I", "0ffe4c706aa18a726e8efc19a3bd4c507cbc727794923b2f43e938343e17318e"),
    127: ("G8I", "6e330b64fee19ef3d4ddc793b36a775bc781bcfbd5d6e34bb993f6d3ae2ddd78"),
    128: ("K2I", "b719663927ccd89bdf1a89c6719606828780f165953bab557f506a6105076e00"),
    129: ("K3I", "57c8429501189989745ca2e9914e307d5d7c0f0e03c21f33d1369269897b1ede"),
    130: ("K4I", "a684fa9fc7cabf5349d47663f6b202005ccb592de0f91c026afaaf2fee310706"),
    131: ("M2I", "b9cb1d9ad910e7ba3b90c08e52542475f3c7202d095dfe7ef2507cab8ae2820e"),
}

_WCC_ETC = replace(
    next(package for package in references.SOURCES if package.name == "wcc-etc"),
    files=tuple(
        SourceFile(
            path=f"{_FOLDER}pickles_uk_{number}.fits",
            sha256=digest,
            licence="BSD-3-Clause (package); library public at STScI and CDS (J/PASP/110/863)",
            citation="Pickles 1998, PASP 110, 863",
            vintage="STScI Pickles atlas, 2007-01-11",
        )
        for number, (_, digest) in _FILES.items()
    ),
)

SOURCES = (_WCC_ETC,)

_WAVELENGTH_NM = np.arange(300.0, 1751.0)
_STEP_NM = 0.5


def build(sources: SourceStore, out_dir: Path) -> list[ProvenanceEntry]:
    """Write the library and report where it comes from."""
    types = [parse_spectral_type(name) for name, _ in _FILES.values()]
    flam = np.array([_spectrum(sources.read(_WCC_ETC, item.path), item.path) for item in _WCC_ETC.files])
    write_npz(
        out_dir / DATA_FILE,
        {
            "position": np.array([item.position for item in types]),
            "luminosity_rank": np.array([item.luminosity_rank for item in types]),
            "wavelength_nm": _WAVELENGTH_NM,
            "flam": byte_planes(flam),
        },
        deflated=False,  # the same bytes whatever the version of zlib
    )
    return [
        ProvenanceEntry(
            data_file=DATA_FILE,
            description="Measured stellar spectra of types A0-M6, classes V to I (erg/s/cm2/A, V = 0).",
            sources=tuple((_WCC_ETC, item.path) for item in _WCC_ETC.files),
            derivation="Rows of 300-1750 nm, smoothed with a triangle of 1 nm and sampled every 1 nm.",
            licence="BSD-3-Clause (package); library public",
            vintage="Pickles 1998, STScI atlas of 2007",
            notes=(
                "Position on the temperature sequence: 10 x letter number (O = 0 ... M = 6) + subclass.",
                "Wavelengths as in the atlas, which does not say air or vacuum: within 0.3 nm.",
                "Beyond about 1 um many types are joined from stars of the same type, or smooth energy distributions.",
                "The library's K dwarfs are 0.1 mag redder in V-I than the mean dwarfs of the same type.",
            ),
        )
    ]


def _spectrum(raw: bytes, path: str) -> np.ndarray:
    """Return the flux at the shipped wavelengths, weights 1/4 1/2 1/4 over three rows."""
    from astropy.io import fits

    with warnings.catch_warnings():
        # The atlas carries unit names that FITS does not know; they do not touch the data.
        warnings.simplefilter("ignore")
        with fits.open(io.BytesIO(raw)) as hdus:
            if "UVKLIB" not in str(hdus[0].header.get("HISTORY", "")):
                raise InputError("spectrum", path, allowed="a file of the Pickles UVKLIB library")
            table = hdus[1].data
            wavelength_nm = np.array(table["WAVELENGTH"], dtype=np.float64) / 10.0
            flux = np.maximum(np.array(table["FLUX"], dtype=np.float64), 0.0)
    rows = np.searchsorted(wavelength_nm, _WAVELENGTH_NM - 0.25 * _STEP_NM)
    if not np.allclose(wavelength_nm[rows], _WAVELENGTH_NM, atol=1e-3):
        raise InputError("wavelength", path, unit="nm", allowed="steps of 0.5 nm")
    smooth: np.ndarray = 0.25 * flux[rows - 1] + 0.5 * flux[rows] + 0.25 * flux[rows + 1]
    return smooth.astype("<f4")
