"""Build ``zodiacal_light.npz``: tables 17 and 19 of Leinert et al. 1998."""

import ast
from pathlib import Path

import numpy as np

from cpic_core import InputError, write_npz
from tools.build_catalogue.sources import ProvenanceEntry, SourceFile, SourcePackage, SourceStore

DATA_FILE = "zodiacal_light.npz"

_FILE = "zodi/tables.py"
_ZODI = SourcePackage(
    name="zodi",
    version="1.0.0",
    ecosystem="pypi",
    archive="zodi-1.0.0-py3-none-any.whl",
    sha256="20a6f971ce31be6f48342eb0b640ea1f307ca0cf60a64417647ad927c0080a13",
    licence="MIT",
    files=(
        SourceFile(
            path=_FILE,
            sha256="229fcb9472a36959e2f44a2984b8428dc584fc220fb2b3ae4a6aff44eb0889c4",
            licence="MIT (package); published tables",
            citation="Leinert et al. 1998, A&AS 127, 1 (tables 17 and 19)",
            vintage="1998",
        ),
    ),
)

SOURCES: tuple[SourcePackage, ...] = (_ZODI,)

# Names in the source -> names shipped; the near-Sun cells are the name _X there and NaN here.
_TABLES = {
    "LON_GRID_DEG": "helioecliptic_longitude_deg",
    "BETA_GRID_DEG": "ecliptic_latitude_deg",
    "TABLE17_RAW": "radiance_500nm_1e8",
    "TABLE19_WAVELENGTH_UM": "spectrum_wavelength_um",
    "TABLE19_RADIANCE_W_M2_SR_UM": "spectrum_radiance_w_m2_sr_um",
}


def build(sources: SourceStore, out_dir: Path) -> list[ProvenanceEntry]:
    """Write the zodiacal light tables and report where they come from."""
    tree = ast.parse(sources.read(_ZODI, _FILE).decode("utf-8"))
    literals = {
        statement.targets[0].id: statement.value.args[0]
        for statement in tree.body
        if isinstance(statement, ast.Assign)
        and isinstance(statement.targets[0], ast.Name)
        and isinstance(statement.value, ast.Call)
        and statement.value.args
    }
    missing = sorted(set(_TABLES) - set(literals))
    if missing:
        raise InputError(_FILE, missing, allowed="all the tables named in the builder")
    write_npz(
        out_dir / DATA_FILE, {ours: _numbers(literals[theirs]) for theirs, ours in _TABLES.items()}, deflated=False
    )
    return [
        ProvenanceEntry(
            data_file=DATA_FILE,
            description="Zodiacal light at 500 nm over longitude from the Sun and latitude; its spectrum.",
            sources=((_ZODI, _FILE),),
            derivation="The published numbers; cells too close to the Sun, not tabulated there, are NaN.",
            licence="MIT; published tables",
            vintage="1998",
            notes=("Map unit 1e-8 W m-2 sr-1 um-1 at 500 nm; spectrum at longitude 90 deg in the ecliptic.",),
        )
    ]


def _numbers(node: ast.expr) -> np.ndarray:
    """Return the nested list literal as floats; a name stands for a cell that is not tabulated."""
    return np.array(_value(node), dtype="<f8")


def _value(node: ast.expr) -> float | list[object]:
    if isinstance(node, ast.List):
        return [_value(item) for item in node.elts]
    if isinstance(node, ast.Name):
        return float("nan")
    return float(ast.literal_eval(node))
