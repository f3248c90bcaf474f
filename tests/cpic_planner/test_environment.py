import json

import numpy

from cpic_planner.environment import host, versions


def test_record_is_plain_and_names_what_results_rest_on():
    record = {"host": host(), "versions": versions()}
    assert json.loads(json.dumps(record)) == record
    assert record["versions"]["numpy"] == numpy.__version__
    assert record["versions"]["numba"] != "not installed"
