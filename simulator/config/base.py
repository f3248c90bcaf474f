"""Frozen, strict configuration models: validation with one-line errors, and a content hash."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterable, Mapping
from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError

from catalogs.errors import InputError

__all__ = ["FrozenModel", "canonical_json", "content_hash", "deep_merge", "validate"]

M = TypeVar("M", bound=BaseModel)


class FrozenModel(BaseModel):
    """Base of every configuration model: immutable, unknown keys refused, NaN and inf refused."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, validate_default=True)

    @property
    def content_hash(self) -> str:
        """Hash of the values (16 hex digits): equal content, equal hash, whatever the order of keys."""
        return content_hash(self.model_dump(mode="json"))


def canonical_json(tree: Any) -> str:
    """One text for one content: sorted keys, shortest round-trip floats, no NaN.

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
    """First 16 hex digits of the SHA-256 of `canonical_json`."""
    return hashlib.sha256(canonical_json(tree).encode()).hexdigest()[:16]


def deep_merge(base: Mapping[str, Any], override: Mapping[str, Any]) -> dict[str, Any]:
    """Copy of ``base`` with ``override`` laid over it; mappings merge, anything else replaces."""
    merged = dict(base)
    for key, value in override.items():
        old = merged.get(key)
        if isinstance(old, Mapping) and isinstance(value, Mapping):
            merged[key] = deep_merge(old, value)
        else:
            merged[key] = value
    return merged


def validate(model: type[M], tree: Any, *, where: str = "") -> M:
    """Validate ``tree`` as ``model``.

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
    parts: Iterable[str] = (str(part) for part in first["loc"])
    path = ".".join([*([where] if where else []), *parts])
    key = path or model.__name__
    kind, context = first["type"], first.get("ctx", {})
    value = first.get("input")
    if kind == "extra_forbidden":
        return InputError(key, value, allowed="no such key", hint=f"known keys: {_siblings(model, first['loc'])}")
    if kind == "missing":
        return InputError(key, "missing", allowed="a value is required")
    if kind == "value_error" and isinstance(context.get("error"), InputError):
        inner: InputError = context["error"]
        return InputError(path if inner.key in path else f"{path}.{inner.key}" if path else inner.key, inner.value,
                          unit=inner.unit, allowed=inner.allowed, hint=inner.hint)  # fmt: skip
    message = first["msg"].removeprefix("Input should be ").removeprefix("Value error, ")
    return InputError(key, value, unit=unit_of(key), allowed=message)


def _siblings(model: type[BaseModel], loc: tuple[int | str, ...]) -> str:
    fields: Any = model
    for part in loc[:-1]:
        info = getattr(fields, "model_fields", {}).get(part)
        fields = getattr(info, "annotation", None)
    names = getattr(fields, "model_fields", None)
    return ", ".join(sorted(names)) if names else "see the documentation"


_UNITS = (
    ("_e_s", "e-/s"), ("_e_adu", "e-/ADU"), ("_mag_arcsec2", "mag/arcsec2"), ("_mas_yr", "mas/yr"),
    ("_lambda_d", "lambda/D"), ("_arcsec", "arcsec"), ("_rjup", "R_Jup"), ("_deg", "deg"), ("_nm", "nm"),
    ("_adu", "ADU"), ("_au", "au"), ("_pc", "pc"), ("_mag", "mag"), ("_k", "K"), ("_e", "e-"), ("_s", "s"),
    ("_m", "m"), ("_pixel", "px"), ("_pixels", "px"),
)  # fmt: skip


def unit_of(key: str) -> str:
    """Unit named by the suffix of a key, ``""`` if none."""
    for suffix, unit in _UNITS:
        if key.endswith(suffix):
            return unit
    return ""
