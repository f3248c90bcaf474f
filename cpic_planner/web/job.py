"""The process of one job: ``python -m cpic_planner.web.job PARENT FOLDER``."""

from __future__ import annotations

import functools
import os
import sys
from collections.abc import Mapping
from pathlib import Path

from cpic_core import dump_json, exclusive_lock, numeric_context, write_text
from cpic_planner.api import model_of
from cpic_planner.api.functions import stars_named
from cpic_planner.confirm import star_images_job
from cpic_planner.jobs import Job, estimate, run
from cpic_planner.jobs.worker import end_with
from cpic_planner.queries import called_as
from cpic_planner.results import StarImagesResult
from cpic_planner.targets import as_catalogue
from cpic_planner.web.asking import IMAGES, Pairs
from cpic_planner.web.job_queue import read_pairs

_NICE = 10


def job_of(pairs: Pairs) -> Job[StarImagesResult]:
    """Return the job that an address asks for.

    Raises
    ------
    InputError
        For the first fault, naming the parameter.
    """
    with called_as(IMAGES.names | {"star": "target"}):
        question = IMAGES.question(pairs)
        (star,) = stars_named(question)
        return star_images_job(question, model_of(question), star, as_catalogue(question.catalog).provenance)


@functools.lru_cache(maxsize=256)
def expected(pairs: Pairs) -> tuple[str, Mapping[str, float]]:
    """Return the hash of the job that an address asks for, and its expected cost; errors as of `job_of`."""
    job = job_of(pairs)
    with called_as(IMAGES.names):
        return job.digest, estimate(job)


def main(parent: str, folder: str) -> None:
    """Do the job of a folder, and end when the server has gone."""
    end_with(int(parent))
    os.nice(_NICE)
    place, done = Path(folder), 0

    def advance(text: str, steps: int = 1, /) -> None:
        nonlocal done
        done += steps
        write_text(place / "progress.json", dump_json({"done": done, "text": text}))

    # One that a killed server left behind may still be ending.
    with exclusive_lock(place / "job.lock"), numeric_context():
        # Forced: what a server of other code left there is begun anew.
        run(job_of(read_pairs(place)), place / "run", advance=advance, force=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
