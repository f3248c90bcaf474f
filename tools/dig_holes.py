"""Dig the shipped dark holes and measure the shipped metrics anew: ``python -m tools.dig_holes``.

The files lie in ``simulator/imaging/data``; :mod:`simulator.imaging.store` says when one is valid.
"""

import argparse
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cpic_core import NDArray, byte_planes, write_npz
from simulator.config import Instrument, load_instrument, preset_names
from simulator.imaging import metrics_key, psf_metrics
from simulator.imaging.build import dig, hole_arrays
from simulator.imaging.pupil import shipped_file
from simulator.imaging.store import DIGITS, EXACT_DIGITS, LEVELS, SHARED, measure, sensed_with

STATE_DIGITS = {"raw_contrast": 12, "core_table": 14, "column_light": 14, "filter_gain": 13, "filter_linear": 13}
"""Binary digits that a file of a state keeps of each value."""


def _packed(arrays: Mapping[str, NDArray[Any]], rounded: Mapping[str, int]) -> dict[str, NDArray[Any]]:
    """Return the arrays as a file holds them: maps and profiles, rounded or exact, as planes of bytes, which compress.

    No file has the halo map, which follows from the others, nor the steps of the pupil, which the instrument says.
    """
    packed = {name: array for name, array in arrays.items() if name not in ("halo_map", "pupil_steps")}
    for name in DIGITS:
        kept = arrays[name]
        if digits := rounded.get(name):
            fraction, exponent = np.frexp(kept)
            kept = np.ldexp(np.round(np.ldexp(fraction, digits)), exponent - digits).astype("<f4")
        packed[name] = byte_planes(kept)
    return packed


def _shipped_bands() -> Iterator[tuple[Instrument, str]]:
    """Yield every band of every instrument preset, optics that are the same once, the default instrument first."""
    seen = set()
    for preset in ("cpic_default", *preset_names("instrument")):
        instrument = load_instrument(preset)
        for band in instrument.bands if instrument.coronagraph.table is None else ():
            if (key := metrics_key(instrument, band)) not in seen:
                seen.add(key)
                yield instrument, band


def rebuild(folder: str | Path, *, holes: bool = True) -> list[Path]:
    """Dig and write the dark holes of the instrument presets, and measure and write their metrics.

    Parameters
    ----------
    folder : str or Path
        Where to write.
    holes : bool
        Dig the holes anew; False keeps the shipped ones.
    """
    written = []
    for instrument, band in _shipped_bands():
        if holes:
            state, hole = dig(instrument, band)
            written.append(Path(folder) / shipped_file("hole", hole, band).name)
            write_npz(written[-1], hole_arrays(state) | {"key": np.asarray(hole)})
        key, arrays = metrics_key(instrument, band), measure(instrument, band)
        exact = instrument.name == "cpic_default" and band in instrument.visible_bands()
        written.append(Path(folder) / shipped_file("metrics", key, band).name)
        packed = _packed(arrays, EXACT_DIGITS if exact else DIGITS) | {"key": np.asarray(key)}
        write_npz(written[-1], packed, deflated=not exact)  # those that most questions wait for
    return written


def rebuild_states(folder: str | Path) -> list[Path]:
    """Dig the states of the mirror of the default instrument that no preset has, and write their metrics.

    Parameters
    ----------
    folder : str or Path
        Where to write.
    """
    default, written = load_instrument(), []
    for band in default.visible_bands():
        for level in LEVELS:
            instrument = sensed_with(default, band, level)
            key = metrics_key(instrument, band)
            if not shipped_file("metrics", key, band).is_file():
                arrays = psf_metrics(instrument, band).to_arrays()
                own = {name: array for name, array in _packed(arrays, STATE_DIGITS).items() if name not in SHARED}
                written.append(Path(folder) / shipped_file("state", key, band).name)
                write_npz(written[-1], own | {"key": np.asarray(key)})
    return written


def main(argv: Sequence[str] | None = None) -> int:
    """Rebuild the shipped files."""
    parser = argparse.ArgumentParser(prog="python -m tools.dig_holes", description=__doc__)
    parser.add_argument("--keep-holes", action="store_true", help="measure the metrics only")
    parser.add_argument("--states-only", action="store_true", help="only the states of the mirror between the presets")
    data = shipped_file("metrics", "", "").parent
    parser.add_argument("--out", type=Path, default=data, help="folder (the package's data)")
    options = parser.parse_args(argv)
    began = time.perf_counter()
    paths = [] if options.states_only else rebuild(options.out, holes=not options.keep_holes)
    for path in [*paths, *rebuild_states(options.out)]:
        print(f"{path.name}: {path.stat().st_size / 1e3:.0f} kB, {time.perf_counter() - began:.1f} s")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
