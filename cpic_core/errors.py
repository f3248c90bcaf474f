"""The error class for bad input, which names key, value, unit and allowed range in one line, and that of clusters."""

from collections.abc import Sequence
from unicodedata import category

_LONGEST = 200
_LONGEST_HINT = 1000


def one_line(text: str) -> str:
    """Return a text as one line that any terminal and log may get: what prints nothing is spelled by its escape.

    Parameters
    ----------
    text : str
        It may quote what a user or a file said.
    """
    return visible(" ".join(text.split()))


def visible(text: str, keep: str = "") -> str:
    r"""Return a text with what prints nothing, or steers a terminal or the order of signs, spelled by its escape.

    Parameters
    ----------
    text : str
        It may quote what a user or a file said.
    keep : str, optional
        Characters that stay, such as ends of lines. Blanks of every width do.

    Examples
    --------
    >>> from cpic_core import visible
    >>> visible("\x1b[31mα Cen é")
    '\\x1b[31mα Cen é'
    """
    if text.isprintable():
        return text
    return "".join(
        sign if sign.isprintable() or sign in keep or category(sign) == "Zs" else ascii(sign)[1:-1] for sign in text
    )


def listed(words: Sequence[str], most: int = 12) -> str:
    """Return the first words with commas, and how many more there are.

    Parameters
    ----------
    words : sequence of str
    most : int, optional
        How many are named.
    """
    return ", ".join(words[:most]) + (f" and {len(words) - most} more" if len(words) > most else "")


def _said(value: object) -> str:
    try:
        return str(value) if hasattr(value, "to_value") else repr(value)  # a quantity has its unit with it
    except ValueError:  # whole numbers of more digits than Python converts to text
        return f"a {type(value).__name__} of too many digits"


def shortened(text: str, most: int = _LONGEST) -> str:
    """Return the beginning of a text, the rest as dots.

    Parameters
    ----------
    text : str
    most : int, optional
        Characters that are kept, 200 by default.
    """
    return text if len(text) <= most else f"{text[:most]}..."


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
        text = f"{shortened(key)} = {shortened(value if isinstance(value, str) else _said(value))}"
        if unit and not hasattr(value, "to_value"):
            text += f" {unit}"
        text += ": not accepted"
        if allowed:
            text += f"; allowed: {allowed}"
        if hint:
            text += f" ({shortened(' '.join(map(shortened, hint.split())), _LONGEST_HINT)})"  # it may quote names
        super().__init__(one_line(text))

    def __reduce__(self) -> tuple[object, ...]:
        """Survive pickling between worker processes (keyword-only arguments defeat the default)."""
        return (_rebuild, (self.key, self.value, self.unit, self.allowed, self.hint))


def _rebuild(key: str, value: object, unit: str, allowed: str, hint: str) -> InputError:
    return InputError(key, value, unit=unit, allowed=allowed, hint=hint)


class ClusterError(RuntimeError):
    """The cluster, not a task, ended the run; what was handed over until then is good."""
