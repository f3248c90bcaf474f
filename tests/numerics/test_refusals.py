"""What is refused, word by word: key, value, unit and what is allowed in one line."""


def test_refusals_say_what_is_wrong(numerics):
    wrong = []
    for refusal in numerics.refusals.REFUSALS:
        line = numerics.refusal.answer(refusal)
        if not line.startswith(refusal.says) or "\n" in line or "not accepted" not in line:
            wrong.append((refusal.name, refusal.says, line))
    assert not wrong


def test_an_answer_is_no_refusal(numerics):
    fine = numerics.refusal.Refusal("abs", abs, (-1,), "")
    assert numerics.refusal.answer(fine) == "answered 1"
