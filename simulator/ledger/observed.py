"""The ledger of one observation: which quantities its tolerance holds for, and what it leaves out."""

from collections.abc import Sequence
from typing import Any, get_args

from cpic_core import InputError, check_number
from simulator.config import Instrument, Scene
from simulator.knobs import MAX_TOLERANCE, Dial, Knobs, Quantity
from simulator.ledger.choice import Choice, choose
from simulator.ledger.prediction import forecast


def checked_tolerance(tolerance: Any) -> float:
    """A tolerance from 0 to 0.5.

    Raises
    ------
    InputError
        If it is none.
    """
    value = check_number("tolerance", tolerance)
    if not 0.0 <= value <= MAX_TOLERANCE:
        raise InputError("tolerance", tolerance, allowed=f"0 to {MAX_TOLERANCE:g}")
    return value


def checked_quantities(quantity: Quantity | Sequence[Quantity] | None, *, planets: bool) -> tuple[Quantity, ...]:
    """Quantities that a tolerance holds for; by default the pixel map, and with planets all three.

    Raises
    ------
    InputError
        For a name that is no quantity, or that of a planet where there is none.
    """
    known: tuple[Quantity, ...] = get_args(Quantity)
    possible = known if planets else tuple(name for name in known if name == "pixel_map")
    if quantity is None:
        return possible
    names = (quantity,) if isinstance(quantity, str) else tuple(quantity)
    for name in names:
        if name not in possible:
            hint = "" if planets or name not in known else "the scene has no planet"
            raise InputError("quantity", name, allowed=", ".join(possible), hint=hint)
    if not names:
        raise InputError("quantity", quantity, allowed=f"at least one of {', '.join(possible)}")
    return tuple(name for name in known if name in names)


def observation_choice(
    scene: Scene,
    instrument: Instrument,
    *,
    tolerance: float,
    quantity: Quantity | Sequence[Quantity] | None,
    finest: Knobs,
    full: bool,
    **settings: Any,
) -> Choice:
    """What an observation leaves out; drawn frame by frame, on the window that was asked for.

    Parameters
    ----------
    scene, instrument, full, **settings
        As `simulator.ledger.forecast`.
    tolerance, quantity
        As `simulator.observing.observation.observe`.
    finest : Knobs
        Settings of the optics without a tolerance.
    """
    asked = checked_quantities(quantity, planets=bool(scene.planets))
    dial = Dial(fidelity="custom", tolerance=dict.fromkeys(asked, tolerance), knobs=None)
    predicted = forecast(scene, instrument, full=full, **settings)
    return choose(predicted, dial, fixed=("summed_frames", "hole_region"), finest=finest)
