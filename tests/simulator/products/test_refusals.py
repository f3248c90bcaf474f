"""What no header of Level-0 data holds."""

from simulator.products.keywords import checked_value, load_keywords

READERS = {"header": lambda card: checked_value(load_keywords(), *card)}


def test_bad_input_is_refused_in_one_line(refusal):
    refusal.by(READERS)
