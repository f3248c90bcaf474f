"""The table of header keywords: names and their other spellings, types, units, and who needs them."""

import functools
import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from cpic_core import InputError, load_yaml

Value = str | int | float | bool
KEYWORD_FILE = Path(__file__).parent / "data" / "keywords.yaml"
_TYPES: Mapping[str, type] = {"str": str, "int": int, "float": float, "bool": bool}
_LEGAL = re.compile(r"[A-Z0-9_-]{1,8}", re.ASCII)
_STRUCTURE = re.compile(
    r"SIMPLE|XTENSION|BITPIX|NAXIS\d*|PCOUNT|GCOUNT|EXTEND|GROUPS|BSCALE|BZERO|BLANK|EXTNAME|EXTVER|EXTLEVEL|INHERIT"
    r"|CHECKSUM|DATASUM|END|COMMENT|HISTORY|CONTINUE|HIERARCH|T(FIELDS|FORM\d+|TYPE\d+)|Z(IMAGE|CMPTYPE|BITPIX|NAXIS\d*)"
    r"|EFF\d{3}|CALF\d{3}"
)


@dataclass(frozen=True)
class Keyword:
    """One keyword of the table.

    Attributes
    ----------
    name : str
    aliases : tuple of str
        Other spellings.
    hdu : {"primary", "image", "both"}
        Where it stands.
    kind : {"str", "int", "float", "bool"}
        Type of its value.
    unit, comment : str
    required : {"always", "sky", "coordinates", "no"}
        ``sky``: in SCI, DSF and CALS; ``coordinates``: where the target has coordinates.
    confidence : {"P", "I", "A"}
        Read in public code or documents, inferred, or assumed.
    section : str
        Name of the part of the frame that it describes, or empty.
    """

    name: str
    hdu: Literal["primary", "image", "both"]
    kind: str
    comment: str
    required: Literal["always", "sky", "coordinates", "no"]
    confidence: Literal["P", "I", "A"]
    unit: str = ""
    aliases: tuple[str, ...] = ()
    section: str = ""

    @property
    def note(self) -> str:
        """Comment with its unit, as it stands in a header."""
        return f"[{self.unit}] {self.comment}" if self.unit else self.comment

    def fits(self, value: Any) -> bool:
        """Return whether a value is of the keyword's type; a whole number is a real number too."""
        if self.kind == "float":
            return isinstance(value, float | int) and not isinstance(value, bool) and math.isfinite(value)
        if self.kind == "int":
            return isinstance(value, int) and not isinstance(value, bool)
        return isinstance(value, _TYPES[self.kind])


@dataclass(frozen=True)
class Profile:
    """The spelling in which a keyword is written, and those that are written beside it."""

    name: str
    spelled: Mapping[str, str]
    also: Mapping[str, tuple[str, ...]]

    def spellings(self, name: str) -> tuple[str, ...]:
        """Return the spellings under which a keyword is written."""
        return (self.spelled.get(name, name), *self.also.get(name, ()))


@dataclass(frozen=True)
class KeywordTable:
    """The table.

    Attributes
    ----------
    version : int
    keywords : mapping of str to Keyword
        In the order of writing.
    profiles : mapping of str to Profile
    """

    version: int
    keywords: Mapping[str, Keyword]
    profiles: Mapping[str, Profile]

    def __iter__(self) -> Iterator[Keyword]:
        return iter(self.keywords.values())

    @functools.cached_property
    def _canonical(self) -> dict[str, str]:
        return {alias: keyword.name for keyword in self for alias in (keyword.name, *keyword.aliases)}

    def canonical(self, name: str) -> str:
        """Return the name under which a spelling stands in the table; unknown ones unchanged."""
        return self._canonical.get(name, name)

    def find(self, header: Mapping[str, Any], name: str) -> tuple[str, Any] | None:
        """Return the spelling and value of a keyword in a header under any of its spellings; None if it is missing.

        Parameters
        ----------
        header : mapping
            Keywords and values of one unit.
        name : str
            Name of the keyword in the table.
        """
        for spelling in (name, *self.keywords[name].aliases):
            if spelling in header:
                return spelling, header[spelling]
        return None

    def value(self, header: Mapping[str, Any], name: str) -> Any:
        """Return the value of a keyword under any of its spellings, None if it is missing.

        Parameters
        ----------
        header : mapping
            Keywords and values of one unit.
        name : str
            Name of the keyword in the table.
        """
        found = self.find(header, name)
        return None if found is None else found[1]

    def profile(self, name: str) -> Profile:
        """Return the profile of a name.

        Raises
        ------
        InputError
            If there is no such profile.
        """
        if name not in self.profiles:
            raise InputError("mission.keyword_profile", name, allowed=", ".join(self.profiles))
        return self.profiles[name]


@functools.cache
def load_keywords() -> KeywordTable:
    """Read the shipped table."""
    tree = load_yaml(KEYWORD_FILE, shipped=True)
    keywords, profiles = {}, {}
    for name, entry in tree["keywords"].items():
        kind, aliases = entry.pop("type"), tuple(entry.pop("aliases", ()))
        keywords[name] = Keyword(name, kind=kind, aliases=aliases, **entry)
    for name, entry in tree["profiles"].items():
        also = {key: tuple(names) for key, names in entry.get("also", {}).items()}
        profiles[name] = Profile(name, entry.get("spelled", {}), also)
    return KeywordTable(tree["schema_version"], keywords, profiles)


def escaped(text: str) -> str:
    """Return the text with characters outside printable ASCII as escapes: ``u03b1`` behind a backslash for alpha."""
    return "".join(c if " " <= c <= "~" else c.encode("unicode_escape").decode() for c in text)


def checked_value(table: KeywordTable, name: str, value: Any) -> Value:
    """Return a header value in the type of its keyword; text is `escaped`.

    Parameters
    ----------
    table : KeywordTable
    name : str
        Keyword.
    value : object
        What is to be written.

    Raises
    ------
    InputError
        Naming the keyword, if it is no legal keyword, one of the file's structure, or has a value of another type.
    """
    key = f"header.{name}"
    if not isinstance(name, str) or _LEGAL.fullmatch(name) is None:
        raise InputError(key, value, allowed="a keyword of at most 8 capitals, digits, - and _")
    if _STRUCTURE.fullmatch(name):
        raise InputError(key, value, allowed="a keyword that does not describe the structure of the file")
    plain = value.item() if isinstance(value, np.generic) else value
    if isinstance(plain, str):
        plain = escaped(plain)
    keyword = table.keywords.get(table.canonical(name))
    if keyword is None:
        if not isinstance(plain, str | int | float) or (isinstance(plain, float) and not math.isfinite(plain)):
            raise InputError(key, value, allowed="text, a truth value or a finite number")
        return plain
    if not keyword.fits(plain):
        raise InputError(key, value, unit=keyword.unit, allowed=f"a value of type {keyword.kind}")
    # Adding zero turns -0 into 0.
    return float(plain) + 0.0 if keyword.kind == "float" else plain
