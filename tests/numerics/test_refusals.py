"""What is refused, word by word: key, value, unit and what is allowed in one line."""


def test_refusals_say_what_is_wrong(numerics):
    wrong = []
    for line in numerics.refusals.REFUSED.strip().splitlines():
        call, _, said = line.partition(" -> ")
        key, _, allowed = said.partition(" |")
        told = numerics.refusals.answer(call)
        if not told.startswith(f"{key}: not accepted; allowed: {allowed.strip()}") or "\n" in told:
            wrong.append((line, told))
    assert not wrong


def test_an_answer_is_no_refusal(numerics):
    assert numerics.refusals.answer("abs(-1)") == "answered 1"
