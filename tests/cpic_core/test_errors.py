import pickle

from cpic_core import InputError


def test_message_names_key_value_unit_and_range_in_one_line():
    text = str(InputError("exposure_s", -1.0, unit="s", allowed="1e-6 to 1e6", hint="use a positive\n number"))
    assert text == "exposure_s = -1.0 s: not accepted; allowed: 1e-6 to 1e6 (use a positive number)"


def test_survives_the_way_back_from_a_worker_process():
    error = InputError("em_gain", 0.5, allowed="1 to 1000")
    again = pickle.loads(pickle.dumps(error))
    assert str(again) == str(error)
    assert (again.key, again.value) == ("em_gain", 0.5)
