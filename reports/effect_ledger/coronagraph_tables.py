"""What each column of a coronagraph's table is worth: ``python reports/effect_ledger/coronagraph_tables.py``.

The default instrument is written as tables; then one optional column after the other is left out, and what that changes
of the SNR is written to ``coronagraph_tables.csv`` (half a minute of one core). ``make.py`` puts it into the report.
"""

from __future__ import annotations

import csv
import io
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from cpic_core import write_text
from cpic_planner import signal_to_noise
from simulator import Instrument, load_instrument, write_coronagraph_table

HERE = Path(__file__).resolve().parent
RESULTS = HERE / "coronagraph_tables.csv"
STARS, SEPARATIONS_ARCSEC, CONTRAST, TIME_S, ZODIS = ("tau Cet", "47 UMa"), (0.5, 0.65, 0.8), 1e-8, 36000.0, 3.0
LEFT_OUT = {
    "occulter_transmission, sky_transmission": "sky and dust as bright as through the clear pupil",
    "sky_transmission": "the sky as dark as the dust around the star",
    "core_area_arcsec2": "apertures of 0.7 lambda/D, which the tables have, too",
    "noise_fraction, source_noise_fraction": "whole pixels instead of a circle on pixels",
    "speckle_variance_per_nm2, speckle_variance_per_nm4": "the drift scatters light as in a clear telescope",
    "star_columns": "smear of the light of the zone alone",
    "star_peak_zone, star_peak_columns, star_peak_frame, star_register_tail": "nothing of the star saturates",
    "source_peak_pixel": "a planet's brightest pixel is that of a clear pupil",
    "two rolls": "the radial table beside the diagonal, and the planet's negative image of a clear pupil",
    "companion": "wings of a companion of a clear pupil (alpha Centauri A beside B)",
}


def instrument(folder: Path, left_out: Sequence[str] = ()) -> Instrument:
    """The default instrument as tables that lack some columns."""
    default, files = load_instrument(), {}
    for band in default.visible_bands():
        path = write_coronagraph_table(default, band, folder / f"{band}.csv")
        lines = [line for line in path.read_text(encoding="utf-8").splitlines() if not line.startswith("#")]
        rows = list(csv.reader(lines))
        kept = [i for i, name in enumerate(rows[0]) if name not in left_out]
        write_text(path, "\n".join(",".join(row[i] for i in kept) for row in rows) + "\n")
        files[band] = str(path)
    own = {"coronagraph": {"table": files, "zone": "quadrants"}, "sky": {"exozodi_zodis": ZODIS}}
    return load_instrument(own)


def changes(name: str, folder: Path) -> np.ndarray:
    """Relative changes of the SNR in all bands, of stars and separations."""
    found = []
    effects = {"two rolls": {"strategy": {"library": "roll", "roll_deg": 30.0}}, "companion": {"companions": "on"}}
    asked = {"companions": "off", "contrast": [CONTRAST], "time_s": TIME_S} | effects.get(name, {})
    modelled = load_instrument({"sky": {"exozodi_zodis": ZODIS}})
    other = instrument(folder, () if name in effects else name.split(", "))
    for star in ("alpha Cen B",) if name == "companion" else STARS:
        for place in SEPARATIONS_ARCSEC:
            pairs = zip(
                *(signal_to_noise(star, instrument=one, separation_arcsec=place, **asked) for one in (modelled, other)),
                strict=True,
            )
            found += [b.value / a.value - 1.0 for a, b in pairs if a.value and b.value]
    return np.array(found)


def measured() -> list[dict[str, str]]:
    """Rows of the file."""
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for name, words in LEFT_OUT.items():
            change = changes(name, Path(folder))
            rows.append(
                {
                    "left_out": name,
                    "then": words,
                    "compared": str(len(change)),
                    "median": f"{np.median(change):.3g}",
                    "least": f"{change.min():.3g}",
                    "most": f"{change.max():.3g}",
                }
            )
    return rows


def text() -> str:
    """Section of the report, of what was measured last."""
    with RESULTS.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    lines = ["| left out | then | answers | change of the SNR, median (least to most) |", "| --- | --- | --- | --- |"]
    for row in rows:
        median, least, most = (f"{100 * float(row[key]):+.2g} %" for key in ("median", "least", "most"))
        lines.append(f"| {row['left_out']} | {row['then']} | {row['compared']} | {median} ({least} to {most}) |")
    return f"""
## Coronagraphs of tables

What the columns of a table are worth (`coronagraph_tables.py`): the default instrument written as tables, which then
lack some; SNR in 10 h of a planet of contrast 1e-8 at {", ".join(map(str, SEPARATIONS_ARCSEC))} arcsec of
{" and ".join(STARS)}, {ZODIS:g} zodis of dust, in the four visible bands, over that of the modelled one. The last
two rows lack no column: they are what a radial table does not say.

{chr(10).join(lines)}
"""


def main() -> None:
    """Measure and write."""
    rows, out = measured(), io.StringIO()
    writer = csv.DictWriter(out, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    write_text(RESULTS, out.getvalue())
    print(text())


if __name__ == "__main__":
    main()
