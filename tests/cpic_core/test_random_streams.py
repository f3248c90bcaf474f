import subprocess
import sys

import numpy as np

from cpic_core import stream


def test_same_path_same_numbers_in_another_process():
    here = stream(7, "HIP 71681", "science", 3, "photons").integers(2**62, size=4).tolist()
    draw = "stream(7,'HIP 71681','science',3,'photons').integers(2**62,size=4).tolist()"
    code = f"from cpic_core.runtime import stream; print({draw})"
    there = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert there.strip() == str(here)


def test_paths_that_look_alike_are_different():
    paths = [("a", "bc"), ("ab", "c"), ("abc",), ("a", "b", "c"), (1,), ("1",), (1, 1), (11,), ("a|s1:b",), ("a", "b")]
    first = [stream(0, *path).integers(2**62) for path in paths]
    assert len(set(first)) == len(paths)
    assert stream(0, "a").integers(2**62) != stream(1, "a").integers(2**62)


def test_streams_are_uncorrelated():
    draws = np.array([stream(1, "frame", index).standard_normal(4000) for index in range(40)])
    correlation = np.corrcoef(draws)[np.triu_indices(40, 1)]
    # 780 pairs of variance 1/4000: four standard errors of the mean square.
    assert abs(np.mean(correlation**2) * 4000 - 1) < 4 * np.sqrt(2 / correlation.size)
    assert abs(draws.mean()) < 4 / np.sqrt(draws.size)


def test_bad_path_parts_are_refused(refused):
    refused("stream path", stream, 1, 2.5)
