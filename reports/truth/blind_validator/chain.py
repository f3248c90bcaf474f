"""The calculator against images of one visit: sums of frames in bulk, and every frame with everything on."""

from __future__ import annotations

from typing import Any

import numpy as np
from cases import FIVE_STARS, in_blocks, nominal, task_for

from cpic_planner.validation import mean_snr, modelling_of, planet_templates, realise_frames, visit_pair
from cpic_planner.validation.measure import forced_photometry

SEEDS, BLOCK = 200, 50
FULL_RUNS, FULL_CASES = 20, (("eps Eri", "F520"), ("tau Cet", "F520"))


def sums_block(star: str, band: str, first: int, count: int) -> list[dict[str, Any]]:
    """Realisations of one case as sums of frames."""
    visits = visit_pair(task_for(star, band, seed=21, visits=1))
    planet, numbers = planet_templates(visits)[0], range(first, first + count)
    return [_row(visits, planet, visits.draw(number), star, band) for number in numbers]


def frames_block(star: str, band: str, number: int) -> list[dict[str, Any]]:
    """One realisation frame by frame, with all effects of the camera, calibration and rejection."""
    task = task_for(star, band, seed=22, visits=1)
    visits = visit_pair(task, realisation=number, modelling=modelling_of(task).whole())
    realised, story = realise_frames(visits)
    return [_row(visits, planet_templates(visits)[0], realised, star, band) | {"rejected": story.rejected_fraction}]


def _row(visits: Any, subject: Any, realised: Any, star: str, band: str) -> dict[str, Any]:
    measured = forced_photometry(realised, subject, visits.geometry)
    truth = visits.science.truth.sources[1].rate_e_s * subject.core * realised.reduced.integration_s
    return {
        "star": star,
        "band": band,
        "flux": measured.flux / truth,
        "error": measured.error / truth,
        "n_apertures": measured.n_background_apertures,
    }


def summary(rows: list[dict[str, Any]], *, full: bool) -> dict[str, Any]:
    """Predicted over recovered SNR of one case, with its 95 % interval."""
    star, band = rows[0]["star"], rows[0]["band"]
    expected = task_for(star, band, seed=0, visits=1).predictions[0]
    suffix = "_full" if full else ""
    flux = np.array([row["flux"] for row in rows])
    snr, error = mean_snr(
        flux,
        [row["error"] for row in rows],
        significance=expected["significance" + suffix],
        n_apertures=rows[0]["n_apertures"],
    )
    predicted = expected["snr" + suffix]
    return {
        "star": star,
        "band": band,
        "chain": "every frame, every effect" if full else "sums of frames",
        "runs": len(rows),
        "predicted_snr": predicted,
        "recovered_snr": snr,
        "ratio": predicted / snr,
        "low": predicted / (snr + 1.96 * error),
        "high": predicted / (snr - 1.96 * error),
        "mean_flux": float(flux.mean()),
        "flux_error": float(flux.std(ddof=1) / np.sqrt(len(flux))),
        "ratio_from_scatter": float(predicted * flux.std(ddof=1)),
        "rejected": float(np.mean([row.get("rejected", 0.0) for row in rows])),
    }


def chain_rows(workers: int) -> list[dict[str, Any]]:
    """All cases."""
    cases = [(star, band) for star in FIVE_STARS for band in nominal().bands]
    blocks = [(star, band, first, BLOCK) for star, band in cases for first in range(0, SEEDS, BLOCK)]
    sums = in_blocks(sums_block, blocks, workers)
    # Other numbers for each star: one seed moves the wavefront alike in both.
    runs = [(*case, FULL_RUNS * k + number) for k, case in enumerate(FULL_CASES) for number in range(FULL_RUNS)]
    frames = in_blocks(frames_block, runs, workers)
    found = []
    for rows, full in ((sums, False), (frames, True)):
        for case in dict.fromkeys((row["star"], row["band"]) for row in rows):
            found.append(summary([row for row in rows if (row["star"], row["band"]) == case], full=full))
    return found
