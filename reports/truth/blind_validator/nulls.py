"""Stars without planets: how often does the blind search find one?"""

from __future__ import annotations

from typing import Any

from cases import star_alone

from cpic_planner.etc import search_threshold
from cpic_planner.validation.search import search, speckle_maps

SCENES = (("61 Cyg A", "F850"), ("tau Cet", "F662"), ("alf Cen A", "F520"), ("alf CMi", "F850"))
SEQUENCES, BLOCK = 500, 50
LEVELS = (3.0, 3.5, 4.0, 5.0)


def null_block(star: str, band: str, seed: int, first: int, count: int) -> list[dict[str, Any]]:
    """Peaks of planet-free sequences above each level."""
    visits = star_alone(star, band, seed)
    maps = speckle_maps(visits.optics, visits.instrument.drift)
    rate = visits.science.truth.sources[0].rate_e_s
    rows = []
    for number in range(first, first + count):
        stack = visits.draw(number).reduced
        found = search(stack, visits.optics, maps, star_rate_e_s=rate, sigma=LEVELS[0])
        row: dict[str, Any] = {"star": star, "band": band, "elements": found.region.n_elements}
        for level in LEVELS:
            asked = search_threshold(found.region, found.roughness, sigma=level).unwrap()
            row[f"{level:g}"] = sum(item.significance >= asked for item in found.candidates)
        rows.append(row)
    return rows
