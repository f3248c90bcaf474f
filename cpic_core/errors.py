"""The one error class for bad input: it names key, value, unit and allowed range in one line."""

_LONGEST = 200


class InputError(ValueError):
    """Refusal of an input value.

    Parameters
    ----------
    key : str
        Name of the offending parameter, column or YAML path (``detector.read_noise_e``).
    value : object
        What was given.
    unit : str, optional
        Unit of the value, ``""`` for a pure number or a word.
    allowed : str, optional
        The allowed range or set, in words.
    hint : str, optional
        What to do about it.
    """

    def __init__(self, key: str, value: object, *, unit: str = "", allowed: str = "", hint: str = "") -> None:
        self.key = key
        self.value = value
        self.unit = unit
        self.allowed = allowed
        self.hint = hint
        shown = value if isinstance(value, str) else repr(value)
        if len(shown) > _LONGEST:
            shown = f"{shown[:_LONGEST]}..."
        text = f"{key} = {shown}"
        if unit:
            text += f" {unit}"
        text += ": not accepted"
        if allowed:
            text += f"; allowed: {allowed}"
        if hint:
            text += f" ({hint})"
        super().__init__(" ".join(text.split()))

    def __reduce__(self) -> tuple[object, ...]:
        """Survive pickling between worker processes (keyword-only arguments defeat the default)."""
        return (_rebuild, (self.key, self.value, self.unit, self.allowed, self.hint))


def _rebuild(key: str, value: object, unit: str, allowed: str, hint: str) -> InputError:
    return InputError(key, value, unit=unit, allowed=allowed, hint=hint)
