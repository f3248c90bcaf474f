"""Laws of the numbers of an instrument that are inferred or assumed, and draws of instruments by them."""

from collections.abc import Mapping
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field

from cpic_core import FloatArray, InputError, faults_by_line, stream
from cpic_planner.planets import Law, read_law
from cpic_planner.queries.changes import is_optical
from cpic_planner.queries.written_values import with_unit
from simulator.config import FrozenModel, preset_tree, unit_of, validate

CONTRAST, OCCURRENCE = "contrast", "planets_per_star"
"""Keys of numbers that no key of an instrument has: mean raw contrast of the dark hole, and the population's rate."""
_WIDTH = ".width_nm"  # of bands: it changes the light, and optics stay those of the nominal width
PACKAGE, DEFAULT = "cpic_planner", "default"
_READ = BeforeValidator(lambda value: None if value is None else read_law(value))
LawValue = Annotated[Law | None, _READ]


class Doubt(FrozenModel):
    """Law of one number that is not known.

    Attributes
    ----------
    label : str
        What the number is, in words.
    value, factor : Law
        Law of the number itself, or of a factor on the instrument's; one of the two.
    through : {"rates", "contrast", "images"}
        How it enters a ranking: only numbers of ``rates`` are drawn, the others' effect is that of the contrast, or
        on images alone.
    source : str
        Where the law is from.
    """

    label: Annotated[str, Field(min_length=1)]
    value: LawValue = None
    factor: LawValue = None
    through: Literal["rates", "contrast", "images"] = "rates"
    source: Annotated[str, Field(min_length=1)]

    def _check_values(self) -> None:
        if (self.value is None) == (self.factor is None):
            raise InputError("value", "given with factor" if self.value else "missing", allowed="one of value, factor")

    @property
    def law(self) -> Law:
        """Law of the number or of the factor."""
        return self.value or self.factor  # type: ignore[return-value]

    def text(self, key: str, drawn: float) -> str:
        """Return a drawn value of a key in words: a factor with an x, a number with its unit."""
        number = f"{drawn:.0f}" if 1e3 <= drawn < 1e5 else f"{drawn:.3g}"
        return with_unit(number, unit_of(key)) if self.factor is None else f"x{number}"


class Ensemble(FrozenModel):
    """Laws of all numbers of an instrument that are not known.

    Attributes
    ----------
    name, description : str
    numbers : dict of str to Doubt
        By key of the instrument, which may hold ``*`` (all that it means are drawn together), ``drift``, `CONTRAST` or
        `OCCURRENCE`.
    fixed : dict of str to str
        Inferred or assumed choices that are not drawn, with the reason.
    """

    name: str = ""
    description: str = ""
    numbers: dict[str, Doubt]
    fixed: dict[str, str] = Field(default_factory=dict)

    def _check_values(self) -> None:
        for key, doubt in self.drawn.items():
            if is_optical(key) and not key.endswith(_WIDTH):
                hint = "optics are not measured anew for every instrument: their numbers enter by the contrast"
                raise InputError(f"numbers.{key}.through", doubt.through, allowed="contrast, images", hint=hint)
        if not self.drawn:
            raise InputError("numbers", "none", allowed="at least one number that is drawn")

    @property
    def drawn(self) -> dict[str, Doubt]:
        """The numbers that are drawn."""
        return {key: doubt for key, doubt in self.numbers.items() if doubt.through == "rates"}

    def says(self, key: str) -> str:
        """Return what it says of a key of the instrument: the key of its law or of its reason, empty for nothing."""
        keys = (*self.numbers, *self.fixed)
        if key in ("drift.visit_nm", "drift.walk_nm_per_sqrt_hour") and "drift" in self.numbers:
            return "drift"
        return next((item for item in keys if fnmatchcase(key, item)), "")


def load_ensemble(source: Ensemble | Mapping[str, Any] | str | Path | None = None) -> Ensemble:
    """Load an ensemble.

    Parameters
    ----------
    source : Ensemble, mapping, str, Path or None
        Preset name, YAML path or mapping; ``None`` is the preset ``default``. A file or mapping holds what differs
        from its ``base`` (a preset, ``default`` if absent); null takes a number out: it is then known.

    Returns
    -------
    Ensemble

    Raises
    ------
    InputError
        Naming key, value and what is allowed of the first fault.
    """
    if isinstance(source, Ensemble):
        return source
    with faults_by_line(source):
        return _read(source)


def _read(source: Mapping[str, Any] | str | Path | None) -> Ensemble:
    keys = (*Ensemble.model_fields, "base")
    tree, _ = preset_tree("ensemble", DEFAULT if source is None else source, keys=keys, package=PACKAGE)
    base = tree.pop("base", None if source in (None, DEFAULT) else DEFAULT)
    if base is not None:
        under = load_ensemble(str(base)).model_dump(exclude_none=True)
        own = tree.get("numbers") or {}
        if not isinstance(own, Mapping):
            raise InputError("ensemble.numbers", own, allowed="a mapping of keys to laws")
        numbers = {key: item for key, item in {**under["numbers"], **own}.items() if item is not None}
        tree = {**under, **tree, "numbers": numbers}
    return validate(Ensemble, tree, where="ensemble")


@dataclass(frozen=True)
class EnsembleChoice:
    """An ensemble, how many instruments are drawn, and the seed of the draws."""

    ensemble: Ensemble
    n_instruments: int
    seed: int

    def shares(self) -> dict[str, FloatArray]:
        """Return uniform numbers for each number that is drawn, one for each instrument.

        A Latin hypercube (McKay et al. 1979, Technometrics 21, 239): each of n equal parts of every law is drawn from
        once. Each number has a stream of its own, so that a number more or less changes no other.
        """
        n = self.n_instruments
        found = {}
        for key in self.ensemble.drawn:
            random = stream(self.seed, "ensemble", key)
            found[key] = (random.permutation(n) + random.random(n)) / n
        return found

    def draws(self) -> dict[str, FloatArray]:
        """Return the drawn values or factors of each number, one for each instrument."""
        return {key: self.ensemble.numbers[key].law.quantile(share) for key, share in self.shares().items()}
