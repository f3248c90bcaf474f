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
from figures import null_figure, pull_figure
from loop import ALTERED, ALTERED_REALISATIONS, UNALTERED_REALISATIONS, altered, unaltered
from nulls import BLOCK, LEVELS, SCENES, SEQUENCES, null_block
from pulls import BAND_STARS, PER_PLACE, SNR, pull_block
from scipy.stats import norm, poisson

from cpic_core import write_bytes, write_text
from cpic_planner.report import style
from cpic_planner.report.words import pretty_name
from cpic_planner.results import BandConfirmation
from cpic_planner.validation import calibrate
from tools.report_parts import png, table

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


def pull_table(rows: list[Row]) -> tuple[str, list[Row]]:
    """Bias and pull widths by band."""
    lines, summary = [], []
    for band in BAND_STARS:
        own = [row for row in rows if row["band"] == band]
        flux = np.array([row["relative_flux"] for row in own])
        pull = (flux - 1.0) / np.array([row["relative_error"] for row in own])
        error = float(flux.std(ddof=1) / np.sqrt(len(flux)))
        spread = {name: width(np.array([row[f"{name}_pull"] for row in own])) for name in ("radial", "tangential")}
        spread["flux"] = width(pull)
        bias = float(flux.mean() - 1.0)
        summary.append(
            {
                "band": band,
                "draws": len(own),
                "bias": bias,
                "bias_error": error,
                "width": spread["flux"][0],
                "radial": spread["radial"][0],
                "tangential": spread["tangential"][0],
            }
        )
        shown = [f"{spread[name][0]:.3f} ± {spread[name][1]:.3f}" for name in ("flux", "radial", "tangential")]
        snr = float(np.median([row["snr"] for row in own]))
        head = [band, pretty_name(BAND_STARS[band]), str(len(own)), f"{snr:.0f}", f"{bias:+.4f} ± {error:.4f}"]
        lines.append([*head, *shown])
    head = [
        "band",
        "star",
        "draws",
        "median SNR",
        "mean flux / true - 1",
        "pull width: flux",
        "separation",
        "position angle",
    ]
    return table(head, lines), summary


def null_table(rows: list[Row]) -> tuple[str, list[Row]]:
    """False alarms by scene and level."""
    lines, summary = [], []
    for star, band in SCENES:
        own = next(row for row in rows if (row["star"], row["band"]) == (star, band))
        elements, sequences = own["elements"], own["sequences"]
        for level in LEVELS:
            found = own[f"{level:g}"]
            expected = elements * float(norm.sf(level))
            # 3 standard deviations, and the exact law where so few are expected.
            high = float(poisson.ppf(norm.cdf(3.0), expected))
            low = float(poisson.ppf(norm.sf(3.0), expected))
            within = low <= found <= high
            summary.append(
                {
                    "star": star,
                    "band": band,
                    "level": level,
                    "found": found,
                    "expected": expected,
                    "within": within,
                    "sequences": sequences,
                    "elements": elements,
                }
            )
            lines.append(
                [
                    pretty_name(star),
                    band,
                    str(sequences),
                    f"{elements:.0f}",
                    f"{level:g}",
                    str(found),
                    f"{expected:.1f}",
                    f"{low:.0f} to {high:.0f}",
                    f"{found / elements:.3%}",
                    "yes" if within else "**no**",
                ]
            )
    head = [
        "star",
        "band",
        "sequences",
        "resolution elements",
        "level (sigma)",
        "found",
        "expected",
        "3 sigma of Poisson",
        "per element",
        "within",
    ]
    return table(head, lines), summary


def chain_table(rows: list[Row]) -> str:
    """Predicted and recovered SNR."""
    lines = [
        [
            pretty_name(row["star"]),
            row["band"],
            row["chain"],
            str(row["runs"]),
            f"{row['predicted_snr']:.2f}",
            f"{row['recovered_snr']:.2f}",
            f"{row['ratio']:.3f} ({row['low']:.3f} to {row['high']:.3f})",
            f"{row['mean_flux']:.4f} ± {row['flux_error']:.4f}",
            f"{row['ratio_from_scatter']:.2f}",
        ]
        for row in rows
    ]
    head = [
        "star",
        "band",
        "chain",
        "runs",
        "SNR, ETC",
        "SNR, images",
        "predicted over recovered SNR (95 %)",
        "flux / true",
        "predicted over recovered SNR, from the scatter of the fluxes",
    ]
    return table(head, lines)


def unaltered_table(rows: list[Row]) -> str:
    """One line a star."""
    lines = [
        [
            pretty_name(row["star"]),
            row["band"],
            f"{row['predicted_snr']:.2f}",
            f"{row['recovered_snr']:.2f} ± {row['recovered_snr_error']:.2f}",
            "" if row["etc_ratio"] is None else f"{row['etc_ratio']:.2f} ± {row['etc_ratio_error']:.2f}",
            "" if row["search_snr"] is None else f"{row['search_snr']:.1f} of {row['search_threshold']:.1f}",
            f"{row['n_significant']}, {row['n_detected']} of {row['realisations']}",
            row["verdict"].split(";")[0],
        ]
        for row in rows
    ]
    head = [
        "star",
        "band",
        "SNR, ETC",
        "SNR, images",
        "predicted over recovered SNR",
        "matched filter, of what the search asks for",
        "significant at the known place, found blind",
        "verdict",
    ]
    return table(head, lines)


def altered_table(rows: list[Row]) -> str:
    """What the report said of each override."""
    lines = [
        [
            f"`{row['override']}`",
            f"{row['stars']} x {row['bands'] // row['stars']}",
            f"{row['known']:.3f}",
            f"{row['found']:.3f} ± {row['error']:.3f}",
            f"{row['deviation']:+.1f}",
            row["text"],
        ]
        for row in rows
    ]
    return table(
        ["override", "stars x bands", "known factor", "found", "standard errors apart", "the report says"], lines
    )


def verdict_table(pulls: list[Row], nulls: list[Row], chain: list[Row], mean: Any, altered_rows: list[Row]) -> str:
    """What was asked, and what was found."""

    def met(fine: bool) -> str:
        return "yes" if fine else "**no**"

    worst = max(pulls, key=lambda row: abs(row["bias"]))
    widths = [row["width"] for row in pulls]
    places = [row[name] for row in pulls for name in ("radial", "tangential")]
    three = [row for row in nulls if row["level"] == 3.0]
    five = [row for row in nulls if row["level"] == 5.0]
    off = max(chain[:-FULL_CASES], key=lambda row: abs(row["ratio"] - 1.0))
    whole = float(np.mean([row["ratio"] for row in chain[-FULL_CASES:]]))
    apart = max(abs(row["deviation"]) for row in altered_rows)
    sizes = ", ".join(f"{row['found'] / row['elements']:.3%}" for row in three)
    return table(
        ["", "asked", "found", "met"],
        [
            [
                f"mean flux of injected planets, {sum(row['draws'] for row in pulls)} draws",
                "within 0.01 and 4 standard errors",
                f"{worst['bias']:+.4f} ± {worst['bias_error']:.4f} at most",
                met(all(abs(row["bias"]) < min(0.01, 4 * row["bias_error"]) for row in pulls)),
            ],
            [
                "pull width of fluxes, by band",
                "1.00 ± 0.08",
                f"{min(widths):.2f} to {max(widths):.2f}",
                met(all(abs(w - 1) <= 0.08 for w in widths)),
            ],
            [
                "pull width of positions, along and across",
                "1.0 ± 0.1",
                f"{min(places):.2f} to {max(places):.2f}",
                met(all(abs(w - 1) <= 0.1 for w in places)),
            ],
            [
                "false alarms at 3 sigma-equivalent, per resolution element",
                "0.135 %, 3 sigma of Poisson",
                sizes,
                met(all(row["within"] for row in three)),
            ],
            [
                "confirmations at 5 sigma-equivalent without a planet",
                "none",
                str(sum(row["found"] for row in five)),
                met(not any(row["found"] for row in five)),
            ],
            [
                f"ETC against the chain of images, {len(chain) - FULL_CASES} cases as sums of frames",
                "10 %",
                f"{off['ratio'] - 1:+.1%} at most ({pretty_name(off['star'])}, {off['band']})",
                met(abs(off["ratio"] - 1) <= 0.1),
            ],
            [
                f"ETC against every frame with every effect, mean of {FULL_CASES} cases",
                "10 %",
                f"{whole - 1:+.1%}",
                met(abs(whole - 1) <= 0.1),
            ],
            [
                f"predicted over recovered SNR of {mean.n_bands} stars, nothing altered",
                "1.00 ± 0.03",
                f"{mean.etc_ratio:.3f} ± {mean.etc_ratio_error:.3f}",
                met(abs(mean.etc_ratio - 1) <= 0.03),
            ],
            [
                "known factor of an altered simulator",
                "within 2 standard errors",
                f"{apart:.1f} standard errors at most",
                met(apart <= 2),
            ],
        ],
    )


def report(found: dict[str, list[Row]]) -> str:
    """Text of the report."""
    pulls, pull_rows = pull_table(found["pulls"])
    nulls, null_rows = null_table(found["nulls"])
    bands = [
        BandConfirmation.model_validate({k: v for k, v in row.items() if k != "star"}) for row in found["unaltered"]
    ]
    mean = calibrate(bands)
    return f"""# The blind validator

Regenerate with `python -m tools.reports blind_validator`; everything below is written by it.

{verdict_table(pull_rows, null_rows, found["chain"], mean, found["altered"])}

The first three parts look at one visit with its reference, where speckles are most of the noise: stacks of visits have
reports of their own, `detection_law` and `programmes`. Nothing altered, and altered, are the programmes of visits that
plans have.

## Injected planets: flux, error, position

Planets at random places of the hole, {PLACES} a band with {PER_PLACE} draws of drift and noise each, as bright as SNR
{SNR:g} asks for; forced photometry over the throughput of the forward model, errors from apertures at the same
separation; positions fitted, their deviation over their error along and across the separation.

{pulls}

![Deviations over errors](pulls.png)

## Stars without planets: false alarms

{SEQUENCES} sequences a scene through the blind search. A level of so many sigma means that noise passes for a planet
with the probability of a normal law in each resolution element, (lambda/D)^2 of searched area.

{nulls}

![False alarms against the level](nulls.png)

## The exposure-time calculator against images

{SEEDS} realisations a case as sums of frames; {FULL_CASES} cases {FULL_RUNS} times frame by frame, with every effect
of the camera, calibrated, particles taken out. SNR of the images: mean flux over the quadratic mean of the measured
errors. The last column takes the scatter of the fluxes instead, of one place: residual speckles around one planet are
brighter or fainter than the mean of the hole at its separation, which is what both the calculator and an observer know.

{chain_table(found["chain"])}

## Nothing altered

The {len(bands)} stars of largest predicted margin, best band each, {UNALTERED_REALISATIONS} realisations: {mean.text}.

{unaltered_table(found["unaltered"])}

## The simulator altered

The prediction knows the nominal instrument; the images have the override. The known factor is what the calculator says
of the altered instrument in the same frames, with the weights of the bands. {ALTERED_REALISATIONS} realisations each.

{altered_table(found["altered"])}
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
    with style():
        write_bytes(HERE / "pulls.png", png(pull_figure(found["pulls"], tuple(BAND_STARS))))
        write_bytes(HERE / "nulls.png", png(null_figure(null_table(found["nulls"])[1])))
    write_text(HERE / "report.md", report(found))


if __name__ == "__main__":
    main()
