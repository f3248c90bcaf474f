"""The blind validator: ``python -m tools.reports blind_validator`` makes this report anew.

Whether the validator can be trusted: flux, errors and positions of injected planets, false alarms of stars without
planets, the exposure-time calculator against the chain of images, and whether the loop names what is wrong with it.
"""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Any

import numpy as np
from cases import in_blocks, nominal
from chain import FULL_CASES as FULL_OF, FULL_RUNS, SEEDS, chain_rows
from loop import ALTERED, ALTERED_REALISATIONS, UNALTERED_REALISATIONS, altered, unaltered
from nulls import BLOCK, LEVELS, SCENES, SEQUENCES, null_block
from pulls import BAND_STARS, PER_PLACE, SNR, pull_block
from scipy.stats import norm, poisson

from cpic_core import write_text
from cpic_planner.report.words import pretty_name
from cpic_planner.results import BandConfirmation
from cpic_planner.validation import calibrate
from tools.report_parts import Cells, columns, verdict

HERE = Path(__file__).resolve().parent
FULL_CASES = len(FULL_OF)
PLACES = 60  # x PER_PLACE draws a band
WORKERS = 2
Row = dict[str, Any]


def pull_part() -> list[Row]:
    """Injected planets in each band."""
    return in_blocks(
        pull_block, [(star, band, 41, n) for band, star in BAND_STARS.items() for n in range(PLACES)], WORKERS
    )


def null_part() -> list[Row]:
    """Sequences without planets, summed by scene."""
    blocks = [(star, band, 51, first, BLOCK) for star, band in SCENES for first in range(0, SEQUENCES, BLOCK)]
    rows = in_blocks(null_block, blocks, WORKERS)
    found = []
    for star, band in SCENES:
        own = [row for row in rows if (row["star"], row["band"]) == (star, band)]
        sums = {key: sum(row[key] for row in own) for key in ("elements", *(f"{level:g}" for level in LEVELS))}
        found.append({"star": star, "band": band, "sequences": len(own)} | sums)
    return found


def unaltered_part() -> list[Row]:
    """Twenty stars as they are."""
    return [{"star": star} | band.model_dump(mode="json") for star, band in unaltered(WORKERS)]


def altered_part() -> list[Row]:
    """Images that differ from what the prediction knows."""
    return [altered(entry, WORKERS) for entry in ALTERED]


def width(values: np.ndarray) -> tuple[float, float]:
    """Standard deviation and its standard error."""
    spread = float(values.std(ddof=1))
    kurtosis = float(np.mean((values - values.mean()) ** 4) / values.var() ** 2)
    return spread, spread * float(np.sqrt(max(kurtosis - 1.0, 0.1) / (4 * len(values))))


def pull_rows(rows: list[Row]) -> list[Row]:
    """Bias and pull widths by band."""
    summary = []
    for band in BAND_STARS:
        own = [row for row in rows if row["band"] == band]
        flux = np.array([row["relative_flux"] for row in own])
        pull = (flux - 1.0) / np.array([row["relative_error"] for row in own])
        radial, tangential = (np.array([row[f"{name}_pull"] for row in own]) for name in ("radial", "tangential"))
        row: Row = {"band": band, "star": pretty_name(BAND_STARS[band]), "draws": len(own)}
        row["snr"] = float(np.median([row["snr"] for row in own]))
        row |= {"bias": float(flux.mean() - 1.0), "bias_error": float(flux.std(ddof=1) / np.sqrt(len(flux)))}
        for name, values in (("width", pull), ("radial", radial), ("tangential", tangential)):
            row[name], row[f"{name}_error"] = width(values)
        summary.append(row)
    return summary


def null_rows(rows: list[Row]) -> list[Row]:
    """False alarms by scene and level."""
    summary = []
    for row in rows:
        for level in LEVELS:
            found, expected = row[f"{level:g}"], row["elements"] * float(norm.sf(level))
            # 3 standard deviations, and the exact law where so few are expected.
            low, high = (float(poisson.ppf(part, expected)) for part in (norm.sf(3.0), norm.cdf(3.0)))
            counted = {"level": level, "found": found, "expected": expected, "low": low, "high": high}
            summary.append(row | counted | {"within": low <= found <= high})
    return summary


def star_of(row: Row) -> str:
    """Name of the star of a row."""
    return pretty_name(row["star"])


PULLS = {"band": "{band}", "star": "{star}", "draws": "{draws}", "median SNR": "{snr:.0f}"}
PULLS |= {"mean flux / true - 1": "{bias:+.4f} ± {bias_error:.4f}"}
PULLS |= {
    heading: f"{{{name}:.3f}} ± {{{name}_error:.3f}}"
    for heading, name in (("pull width: flux", "width"), ("separation", "radial"), ("position angle", "tangential"))
}
NULLS: Cells = {
    "star": star_of,
    "band": "{band}",
    "sequences": "{sequences}",
    "resolution elements": "{elements:.0f}",
    "level (sigma)": "{level:g}",
    "found": "{found}",
    "expected": "{expected:.1f}",
    "3 sigma of Poisson": "{low:.0f} to {high:.0f}",
    "per element": lambda row: f"{row['found'] / row['elements']:.3%}",
    "within": lambda row: "yes" if row["within"] else "**no**",
}
CHAIN: Cells = {
    "star": star_of,
    "band": "{band}",
    "chain": "{chain}",
    "runs": "{runs}",
    "SNR, ETC": "{predicted_snr:.2f}",
    "SNR, images": "{recovered_snr:.2f}",
    "predicted over recovered SNR (95 %)": "{ratio:.3f} ({low:.3f} to {high:.3f})",
    "flux / true": "{mean_flux:.4f} ± {flux_error:.4f}",
    "predicted over recovered SNR, from the scatter of the fluxes": "{ratio_from_scatter:.2f}",
}
UNALTERED: Cells = {
    "star": star_of,
    "band": "{band}",
    "SNR, ETC": "{predicted_snr:.2f}",
    "SNR, images": "{recovered_snr:.2f} ± {recovered_snr_error:.2f}",
    "predicted over recovered SNR": lambda row: (
        "" if row["etc_ratio"] is None else f"{row['etc_ratio']:.2f} ± {row['etc_ratio_error']:.2f}"
    ),
    "matched filter, of what the search asks for": lambda row: (
        "" if row["search_snr"] is None else f"{row['search_snr']:.1f} of {row['search_threshold']:.1f}"
    ),
    "significant at the known place, found blind": "{n_significant}, {n_detected} of {realisations}",
    "verdict": lambda row: row["verdict"].split(";")[0],
}
ALTERED_CELLS: Cells = {
    "override": "`{override}`",
    "stars x bands": lambda row: f"{row['stars']} x {row['bands'] // row['stars']}",
    "known factor": "{known:.3f}",
    "found": "{found:.3f} ± {error:.3f}",
    "standard errors apart": "{deviation:+.1f}",
    "the report says": "{text}",
}


def verdict_table(pulls: list[Row], nulls: list[Row], chain: list[Row], mean: Any, altered_rows: list[Row]) -> str:
    """What was asked, and what was found."""
    worst = max(pulls, key=lambda row: abs(row["bias"]))
    widths = [row["width"] for row in pulls]
    places = [row[name] for row in pulls for name in ("radial", "tangential")]
    three, five = ([row for row in nulls if row["level"] == level] for level in (3.0, 5.0))
    off = max(chain[:-FULL_CASES], key=lambda row: abs(row["ratio"] - 1.0))
    whole = float(np.mean([row["ratio"] for row in chain[-FULL_CASES:]]))
    apart = max(abs(row["deviation"]) for row in altered_rows)
    return verdict(
        [
            (
                f"mean flux of injected planets, {sum(row['draws'] for row in pulls)} draws",
                "within 0.01 and 4 standard errors",
                f"{worst['bias']:+.4f} ± {worst['bias_error']:.4f} at most",
                all(abs(row["bias"]) < min(0.01, 4 * row["bias_error"]) for row in pulls),
            ),
            (
                "pull width of fluxes, by band",
                "1.00 ± 0.08",
                f"{min(widths):.2f} to {max(widths):.2f}",
                all(abs(w - 1) <= 0.08 for w in widths),
            ),
            (
                "pull width of positions, along and across",
                "1.0 ± 0.1",
                f"{min(places):.2f} to {max(places):.2f}",
                all(abs(w - 1) <= 0.1 for w in places),
            ),
            (
                "false alarms at 3 sigma-equivalent, per resolution element",
                "0.135 %, 3 sigma of Poisson",
                ", ".join(f"{row['found'] / row['elements']:.3%}" for row in three),
                all(row["within"] for row in three),
            ),
            (
                "confirmations at 5 sigma-equivalent without a planet",
                "none",
                str(sum(row["found"] for row in five)),
                not any(row["found"] for row in five),
            ),
            (
                f"ETC against the chain of images, {len(chain) - FULL_CASES} cases as sums of frames",
                "10 %",
                f"{off['ratio'] - 1:+.1%} at most ({pretty_name(off['star'])}, {off['band']})",
                abs(off["ratio"] - 1) <= 0.1,
            ),
            (
                f"ETC against every frame with every effect, mean of {FULL_CASES} cases",
                "10 %",
                f"{whole - 1:+.1%}",
                abs(whole - 1) <= 0.1,
            ),
            (
                f"predicted over recovered SNR of {mean.n_bands} stars, nothing altered",
                "1.00 ± 0.03",
                f"{mean.etc_ratio:.3f} ± {mean.etc_ratio_error:.3f}",
                abs(mean.etc_ratio - 1) <= 0.03,
            ),
            (
                "known factor of an altered simulator",
                "within 2 standard errors",
                f"{apart:.1f} standard errors at most",
                apart <= 2,
            ),
        ]
    )


def report(found: dict[str, list[Row]]) -> str:
    """Text of the report."""
    pulls, nulls = pull_rows(found["pulls"]), null_rows(found["nulls"])
    bands = [
        BandConfirmation.model_validate({k: v for k, v in row.items() if k != "star"}) for row in found["unaltered"]
    ]
    mean = calibrate(bands)
    return f"""# The blind validator

Regenerate with `python -m tools.reports blind_validator`; everything below is written by it.

{verdict_table(pulls, nulls, found["chain"], mean, found["altered"])}

The first three parts look at one visit with its reference, where speckles are most of the noise: stacks of visits have
reports of their own, `detection_law` and `programmes`. Nothing altered, and altered, are the programmes of visits that
plans have.

## Injected planets: flux, error, position

Planets at random places of the hole, {PLACES} a band with {PER_PLACE} draws of drift and noise each, as bright as SNR
{SNR:g} asks for; forced photometry over the throughput of the forward model, errors from apertures at the same
separation; positions fitted, their deviation over their error along and across the separation.

{columns(pulls, PULLS)}

## Stars without planets: false alarms

{SEQUENCES} sequences a scene through the blind search. A level of so many sigma means that noise passes for a planet
with the probability of a normal law in each resolution element, (lambda/D)^2 of searched area.

{columns(nulls, NULLS)}

## The exposure-time calculator against images

{SEEDS} realisations a case as sums of frames; {FULL_CASES} cases {FULL_RUNS} times frame by frame, with every effect
of the camera, calibrated, particles taken out. SNR of the images: mean flux over the quadratic mean of the measured
errors. The last column takes the scatter of the fluxes instead, of one place: residual speckles around one planet are
brighter or fainter than the mean of the hole at its separation, which is what both the calculator and an observer know.

{columns(found["chain"], CHAIN)}

## Nothing altered

The {len(bands)} stars of largest predicted margin, best band each, {UNALTERED_REALISATIONS} realisations: {mean.text}.

{columns(found["unaltered"], UNALTERED)}

## The simulator altered

The prediction knows the nominal instrument; the images have the override. The known factor is what the calculator says
of the altered instrument in the same frames, with the weights of the bands. {ALTERED_REALISATIONS} realisations each.

{columns(found["altered"], ALTERED_CELLS)}
"""


def main() -> None:
    """Run the parts and write text, numbers and pictures."""
    nominal()
    parts = {"pulls": pull_part, "nulls": null_part, "chain": lambda: chain_rows(WORKERS)}
    parts |= {"unaltered": unaltered_part, "altered": altered_part}
    found: dict[str, list[Row]] = {}
    for name, part in parts.items():
        began = time.perf_counter()
        found[name] = part()
        print(name, f"{time.perf_counter() - began:.0f} s", flush=True)
    quoted = ("star", "band", "search_snr", "search_threshold")
    rows = [{name: row[name] for name in quoted} for row in found["unaltered"]]
    kept = {"unaltered": {"rows": rows}, "chain": {"rows": found["chain"]}}
    write_text(HERE / "results.json", json.dumps(kept, indent=1) + "\n")
    write_text(HERE / "report.md", report(found))


if __name__ == "__main__":
    main()
