"""Frozen, strict configuration models: validation with one-line errors, and a content hash.

Keys and values as people write them: other names of a key, near misses, units, numbers of other libraries; and presets
that ship with the package, by kind and name.
"""

import difflib
import hashlib
import json
import math
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Self, TypeAlias, TypeVar, cast, get_args

from pydantic import BaseModel, ConfigDict, Field, PrivateAttr, ValidationError, model_validator
from pydantic.fields import FieldInfo

from cpic_core import (
    InputError,
    Provenance,
    in_unit,
    is_file,
    is_quantity,
    load_mapping,
    number_and_unit,
    split_sourced,
    unit_of,
    units_like,
)

if TYPE_CHECKING:
    from pydantic._internal._model_construction import ModelMetaclass
else:
    ModelMetaclass = type(BaseModel)  # pydantic gives it no public name

M = TypeVar("M", bound=BaseModel)

Real: TypeAlias = Annotated[float, Field(strict=True)]
"""A number; neither text nor a truth value becomes one."""


class _Refusing(ModelMetaclass):
    """Let models that Python makes refuse their values as those that are read from files."""

    def __call__(cls, *args: Any, **values: Any) -> Any:  # noqa: N805 - of a class
        if any(map(is_quantity, values.values())):
            values = plain_numbers(values)
        try:
            return super().__call__(*args, **values)
        except ValidationError as error:
            raise _one_line(error, "", cast("type[BaseModel]", cls)) from None


class FrozenModel(BaseModel, metaclass=_Refusing):
    """Base of every configuration model: immutable, unknown keys refused, NaN and inf refused."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, validate_default=True, defer_build=True)

    @model_validator(mode="after")
    def _whole(self) -> Self:
        self._check_values()
        return self

    def _check_values(self) -> None:
        """Refuse values that do not go together; each model says what must hold."""

    @property
    def content_hash(self) -> str:
        """Hash of the values (16 hex digits): equal content, equal hash, whatever the order of keys."""
        return content_hash(self.model_dump(mode="json"))


class Sourced(BaseModel):
    """A configuration that knows where its values come from."""

    _provenance: dict[str, Provenance] = PrivateAttr(default_factory=dict)

    @property
    def provenance(self) -> dict[str, Provenance]:
        """Source and confidence of each value that was stated with a source, by dotted key."""
        return dict(self._provenance)

    @classmethod
    def read(cls, tree: Any, where: str) -> Self:
        """Return the configuration of plain data whose leaves may say their source; `validate` refuses its faults."""
        values, provenance = split_sourced(tree)
        made = validate(cls, values, where=where)
        made._provenance.update(provenance)
        return made


class SpelledModel(FrozenModel):
    """A configuration whose keys people also write otherwise: `canonical_keys` reads them.

    Attributes
    ----------
    ALIASES : dict
        Keys by their other names.
    HINTS : dict
        What to write instead of keys that are no other names.
    MORE_KEYS : tuple of str
        Keys that `_read` turns into fields.
    """

    ALIASES: ClassVar[dict[str, str]] = {}
    HINTS: ClassVar[dict[str, str]] = {}
    MORE_KEYS: ClassVar[tuple[str, ...]] = ()

    @model_validator(mode="before")
    @classmethod
    def _spelled(cls, tree: Any) -> Any:
        if not isinstance(tree, Mapping):
            return tree
        return cls._read(canonical_keys(tree, (*cls.model_fields, *cls.MORE_KEYS), cls.ALIASES, hints=cls.HINTS))

    @classmethod
    def _read(cls, tree: dict[str, Any]) -> dict[str, Any]:
        """Return the values by the model's own keys."""
        return tree


def canonical_json(tree: Any) -> str:
    """Return one text for one content: sorted keys, shortest round-trip floats, no NaN.

    Integers and equal floats (``2`` and ``2.0``) give the same text.
    """
    return json.dumps(_normal(tree), sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False)


def _normal(item: Any) -> Any:
    if isinstance(item, Mapping):
        return {str(key): _normal(value) for key, value in item.items()}
    if isinstance(item, list | tuple):
        return [_normal(value) for value in item]
    if isinstance(item, float) and math.isfinite(item) and item == int(item) and abs(item) < 2**53:
        return int(item)
    return item


def content_hash(tree: Any) -> str:
    """Return the first 16 hex digits of the SHA-256 of `canonical_json`."""
    return hashlib.sha256(canonical_json(tree).encode("utf-8", "surrogatepass")).hexdigest()[:16]


def deep_merge(base: Mapping[str, Any], override: Mapping[str, Any]) -> dict[str, Any]:
    """Return a copy of ``base`` with ``override`` laid over it; mappings merge, anything else replaces.

    Parameters
    ----------
    base : mapping
        Tree below.
    override : mapping
        Tree on top.
    """
    merged = dict(base)
    for key, value in override.items():
        old = merged.get(key)
        if isinstance(old, Mapping) and isinstance(value, Mapping):
            merged[key] = deep_merge(old, value)
        else:
            merged[key] = value
    return merged


def bare_value(item: Any) -> Any:
    """Return a value that is given alone, or with its source in a mapping."""
    return item.get("value") if isinstance(item, Mapping) else item


def validate(model: type[M], tree: Any, *, where: str = "") -> M:
    """Validate ``tree`` as ``model``.

    Parameters
    ----------
    model : type
    tree : object
        Plain data.
    where : str, optional
        What keys of a refusal begin with.

    Raises
    ------
    InputError
        For the first fault, naming the dotted key, the value, its unit (from the key's suffix) and
        the allowed range.
    """
    if not isinstance(tree, Mapping):
        raise InputError(where or model.__name__, tree, allowed="a mapping of keys to values")
    try:
        return model.model_validate(dict(tree))
    except ValidationError as error:
        raise _one_line(error, where, model) from None


def _one_line(error: ValidationError, where: str, model: type[BaseModel]) -> InputError:
    first = error.errors(include_url=False)[0]
    parts = [str(part) for part in first["loc"]]
    path = ".".join([*([where] if where else []), *parts])
    key = path or model.__name__
    kind, context = first["type"], first.get("ctx", {})
    value = first.get("input")
    if kind == "extra_forbidden":
        names = getattr(_field(model, first["loc"][:-1]), "model_fields", None)
        known = ", ".join(sorted(names)) if names else "see the documentation"
        with_unit = names if isinstance(value, str) and number_and_unit(value) else ()
        meant = [name for name in with_unit or () if name.startswith(f"{parts[-1]}_") and unit_of(name)]
        hint = f"did you mean {meant[0]}: {value}?" if meant else f"known keys: {known}"
        return InputError(key, value, allowed="no such key", hint=hint)
    limits = _limits(_field(model, first["loc"]), math.inf if kind.startswith("less_than") else 2.0**53)
    if kind == "missing":
        needed = f", {limits} {unit_of(key)}" if limits else ""
        return InputError(key, "missing", allowed=f"a value is required{needed}")
    if kind == "value_error" and isinstance(context.get("error"), InputError):
        inner: InputError = context["error"]
        named = path.split(".")[-1] == inner.key
        whole = path if named else f"{path}.{inner.key}" if path else inner.key
        return InputError(whole, inner.value, unit=inner.unit, allowed=inner.allowed, hint=inner.hint)
    message = first["msg"].removeprefix("Input should be ").removeprefix("Value error, ")
    if kind in _RANGE_KINDS and limits:
        message = limits
    elif limits:
        message += f", {limits}"
    unit = unit_of(key)
    if unit and isinstance(value, str) and number_and_unit(value):
        return InputError(key, value, allowed=f"{message}, or with a unit: {', '.join(units_like(unit))}")
    return InputError(key, value, unit=unit, allowed=message)


_RANGE_KINDS = ("greater_than", "greater_than_equal", "less_than", "less_than_equal")


def _field(model: Any, loc: Iterable[int | str]) -> Any:
    """Return what a place in a tree is annotated with: the class where it is a model. Keys of a dict are skipped."""
    found: Any = model
    for part in loc:
        info = getattr(found, "model_fields", {}).get(part)
        if info is not None:
            found = next(_models(info.annotation), _annotation_of(info))
    return found


def _models(annotation: Any) -> Iterator[Any]:
    """Yield the classes of models inside an annotation such as ``tuple[Planet, ...]``."""
    if hasattr(annotation, "model_fields"):
        yield annotation
    for item in get_args(annotation):
        yield from _models(item)


def limits_of(field: FieldInfo) -> str:
    """Return the range that a field of a model states, in words, empty if it states none."""
    return _limits(_annotation_of(field))


def bounds_of(field: FieldInfo) -> dict[str, float]:
    """Return the numbers of that range, by ``ge``, ``gt``, ``le`` and ``lt``."""
    return _bounds(_annotation_of(field))


def _annotation_of(field: FieldInfo) -> Any:
    return Annotated[(field.annotation, *field.metadata)] if field.metadata else field.annotation


def _bounds(annotation: Any, most: float = 2.0**53) -> dict[str, float]:
    """Return the range that an annotation states; what hardly a number reaches, ``most``, is left out."""
    return {
        name: getattr(item, name)
        for item in _metadata(annotation)
        for name in ("ge", "gt", "le", "lt")
        if getattr(item, name, None) is not None and abs(getattr(item, name)) < most
    }


def _limits(annotation: Any, most: float = 2.0**53) -> str:
    """Return the range that an annotation states, in words, empty if it states none."""
    bounds = _bounds(annotation, most)
    said = {name: str(bound) if isinstance(bound, int) else f"{bound:g}" for name, bound in bounds.items()}
    if "ge" in said and "le" in said:
        return f"{said['ge']} to {said['le']}"
    words = {"ge": "at least", "gt": "above", "le": "at most", "lt": "below"}
    return ", ".join(f"{word} {said[name]}" for name, word in words.items() if name in said)


def _metadata(annotation: Any) -> Iterator[Any]:
    for item in getattr(annotation, "__metadata__", ()):
        yield from getattr(item, "metadata", (item,))
    for item in get_args(annotation):
        yield from _metadata(item)


def canonical_keys(
    tree: Mapping[Any, Any], fields: Iterable[str], aliases: Mapping[str, str], hints: Mapping[str, str] | None = None
) -> dict[str, Any]:
    """Return a mapping with its keys spelled as the model's fields and its numbers as plain numbers.

    Parameters
    ----------
    tree : mapping
        What the user wrote. Values that carry a unit (`astropy.units`) are converted to that of the key.
    fields : iterable of str
        Names that the model knows.
    aliases : mapping of str to str
        Other spellings and the field that each means.
    hints : mapping of str to str, optional
        What to say of a key that is not accepted.

    Raises
    ------
    InputError
        For an unknown key, naming the nearest known ones, and for one thing given under two names.
    """
    known = tuple(fields)
    result: dict[str, Any] = {}
    origin: dict[str, str] = {}
    for given, value in tree.items():
        key = _spelled(given, known, aliases)
        if key not in known:
            hint = (hints or {}).get(given) or nearest(given, (*known, *aliases)) or f"known keys: {', '.join(known)}"
            raise InputError(str(given), _plain(value), allowed="no such key", hint=hint)
        if key in result:
            first, second = sorted((given, origin[key]), key=lambda name: name == key)
            raise InputError(first, f"given with {second}", allowed="one of the two")
        result[key], origin[key] = to_unit(key, value), given
    return result


def _spelled(given: Any, known: tuple[str, ...], aliases: Mapping[str, str]) -> Any:
    """Return the field that a key means; capitals do not matter: RA, Dec."""
    for key in (given, given.lower() if isinstance(given, str) else given):
        if key in aliases or key in known:
            return aliases.get(key, key)
    return given


def nearest(word: Any, known: Iterable[str]) -> str:
    """Return ``did you mean ...?`` with the nearest known words, empty if none is near.

    Parameters
    ----------
    word : object
        What was written.
    known : iterable of str
        Words that are known.
    """
    close = difflib.get_close_matches(str(word), dict.fromkeys(known), n=3, cutoff=0.6)
    return f"did you mean {' or '.join(close)}?" if close else ""


def required(key: str, allowed: str) -> InputError:
    """Return the refusal of a mapping that lacks a key.

    Parameters
    ----------
    key : str
        Name that a refusal gives.
    allowed : str
        Values that are allowed, in words.
    """
    return InputError(key, "missing", allowed=allowed)


def at(path: str, error: InputError) -> InputError:
    """Return the same refusal with its key under a dotted path; the path alone where it names no key."""
    key = f"{path}.{error.key}" if error.key else path
    return InputError(key, error.value, unit=error.unit, allowed=error.allowed, hint=error.hint)


@contextmanager
def inside(path: str) -> Iterator[None]:
    """Yield the refusals under the path of the body or sequence that they concern.

    Parameters
    ----------
    path : str
        Path of the key, such as ``planets.0``.
    """
    try:
        yield
    except InputError as error:
        raise at(path, error) from None


def other_names(**names: str) -> dict[str, str]:
    """Return the keys by their other names.

    Parameters
    ----------
    **names : str
        Other names of each key, with spaces between.
    """
    return {name: key for key, words in names.items() for name in words.split()}


def _plain(value: Any) -> Any:
    """Return scalars and arrays of numpy as Python's own."""
    return value.tolist() if hasattr(value, "dtype") and hasattr(value, "tolist") else value


def plain_numbers(value: Any, key: str = "") -> Any:
    """Return values as people write them in Python with plain numbers in place of quantities, in the units of the keys.

    Parameters
    ----------
    value : object
        Values by key, or one of them; sequences and mappings may hold further ones.
    key : str
        Name that a refusal gives.

    Raises
    ------
    InputError
        Naming the key and its unit, for a quantity that does not convert to that.
    """
    if is_quantity(value):
        return to_unit(key, value)
    if type(value) is dict:
        return {name: plain_numbers(item, f"{key}.{name}" if key else str(name)) for name, item in value.items()}
    return type(value)(plain_numbers(item, key) for item in value) if type(value) in (list, tuple) else value


def to_unit(key: str, value: Any) -> Any:
    """Return a value that carries a unit (`astropy.units`) as a plain number in that of the key; others unchanged.

    Parameters
    ----------
    key : str
        Name that a refusal gives.
    value : object
        Number, with or without a unit.
    """
    return _plain(in_unit(key, value, unit_of(key)))


def _folder(kind: str, package: str) -> Path:
    return Path(str(resources.files(package) / "presets" / kind))


def preset_names(kind: str, *, package: str = "simulator") -> tuple[str, ...]:
    """Return the names of the presets of one kind (``instrument``, ``scene``, ``plan``) that ship with a package.

    Parameters
    ----------
    kind : str
        Kind of the preset or of the record.
    package : str, optional
        Package that ships the presets.
    """
    return tuple(sorted(path.stem for path in _folder(kind, package).glob("*.yaml")))


def preset_path(kind: str, name: str, *, package: str = "simulator") -> Path | None:
    """Return the path of a preset, ``None`` if there is none of that name.

    Parameters
    ----------
    kind : str
        Kind of the preset or of the record.
    name : str
        Name of the preset.
    package : str, optional
        Package that ships the presets.
    """
    return _folder(kind, package) / f"{name}.yaml" if name in preset_names(kind, package=package) else None


def preset_or_file(kind: str, source: str | Path, *, package: str = "simulator") -> Path:
    """Return the path of a preset, or of a file that exists.

    Parameters
    ----------
    kind : str
        Kind of the preset or of the record.
    source : str or Path
        Name of a preset, or a file.
    package : str, optional
        Package that ships the presets.

    Raises
    ------
    InputError
        If ``source`` is neither; with the nearest presets.
    """
    path = preset_path(kind, str(source), package=package) or Path(source)
    if not is_file(path):
        names = preset_names(kind, package=package)
        hint = nearest(source, names) or f"presets: {', '.join(names) or 'none'}"
        raise InputError(kind, str(source), allowed="a YAML file or a preset", hint=hint)
    return path


def preset_tree(
    kind: str, source: Any, *, keys: Iterable[str], package: str = "simulator", kinds: tuple[str, ...] = ()
) -> tuple[dict[str, Any], Path | None]:
    """Return what a source holds: a preset, a YAML file, or the mapping itself, without its ``kind``.

    Parameters
    ----------
    kind : str
        What the presets are, and what the source is expected to say that it is, if it says so.
    source : str, Path or mapping
    keys : iterable of str
        Keys that such a file has, see `cpic_core.yaml_files.load_mapping`.
    package : str
        Whose presets.
    kinds : tuple of str
        Other kinds that are accepted, and stay in the tree.

    Returns
    -------
    tree : dict
        With the name of the file as ``name`` where it has none.
    folder : Path or None
        Folder of the file, beside which files that it names are looked for.

    Raises
    ------
    InputError
        If the source is nothing of this, or of another kind.
    """
    folder = None
    if isinstance(source, Mapping):
        tree: Any = dict(source)
    elif isinstance(source, str | Path):
        path = preset_or_file(kind, source, package=package)
        tree, folder = load_mapping(path, kind, keys), path.parent
        tree.setdefault("name", path.stem)
    else:
        raise InputError(kind, source, allowed="a mapping, a YAML file or a preset")
    said = tree.get("kind", kind)
    if said not in (kind, *kinds):
        raise InputError(f"{kind}.kind", said, allowed=", ".join((kind, *kinds)))
    if said == kind:
        tree.pop("kind", None)
    return tree, folder


def tree_over_preset(
    kind: str, source: Any, *, default: str, keys: Iterable[str], package: str = "simulator"
) -> tuple[dict[str, Any], Path | None, str | None]:
    """Return what a source holds, and the preset that it is laid over.

    Parameters
    ----------
    kind, source, keys, package
        As of `preset_tree`; ``None`` is the preset ``default``.
    default : str
        Preset that a file or mapping is laid over where it names no ``base``.

    Returns
    -------
    tree : dict
        Without its ``base``.
    folder : Path or None
        As of `preset_tree`.
    base : str or None
        None for a preset that is whole.

    Raises
    ------
    InputError
        As `preset_tree`, or if the base is no preset.
    """
    source = default if source is None else source
    tree, folder = preset_tree(kind, source, keys=keys, package=package)
    names = preset_names(kind, package=package)
    if "base" not in tree and not isinstance(source, Mapping) and str(source) in names:
        return tree, folder, None
    base = tree.pop("base", default)
    if base not in names:
        raise InputError(f"{kind}.base", base, allowed=", ".join(names))
    return tree, folder, str(base)
