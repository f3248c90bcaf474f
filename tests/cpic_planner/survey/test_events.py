"""What a survey finds, event after event."""

import numpy as np

from cpic_planner.survey.simulate import Events


def test_alarms_count_where_the_visit_was_made():
    log = Events(4)
    go = np.array([True, False, True, True])
    log.alarms(go, np.array([1, 5, 0, 2]), np.array([0, 7, 3, 0]))
    log.alarms(~go, np.array([1, 1, 1, 1]), np.zeros(4, np.int64))
    assert log.noise_alarms.tolist() == [1, 1, 0, 2]
    assert log.background_alarms.tolist() == [0, 0, 3, 0]


def test_without_events_columns_are_empty_and_typed(plain):
    columns = Events(3).columns(plain.surveys[0])
    assert all(len(values) == 0 for values in columns.values())
    assert columns["universe"].dtype == columns["known_row"].dtype == np.int64
    assert columns["snr"].dtype == float
    assert columns["star"].dtype == columns["band"].dtype == object
