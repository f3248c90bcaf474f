"""One row of the effect ledger."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Literal


@dataclass(frozen=True)
class EffectRow:
    """One effect: kept or skipped, and why.

    Attributes
    ----------
    effect : str
        Name for people.
    decision : {"kept", "skipped"}
    reason : str
    key : str
        Name for programs: the switch of the camera, or that of the effect; ``star:NAME`` and ``planet:NAME`` for
        sources.
    size : float or None
        Predicted size on the quantity asked for, the largest if several; 0 for what does not exist. None where no size
        was asked for or can be given.
    """

    effect: str
    decision: Literal["kept", "skipped"]
    reason: str
    key: str = ""
    size: float | None = None

    def to_dict(self) -> dict[str, Any]:
        """Plain dict for JSON and FITS headers."""
        return asdict(self)
