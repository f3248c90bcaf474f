"""Terms that reports explain, how intervals of surveys are read, and what to cite: the prose of `prose.yaml`."""

from __future__ import annotations

import functools
from importlib import resources
from typing import Any

from catalogs.strict_yaml import parse_yaml


@functools.cache
def _prose() -> dict[str, Any]:
    text = resources.files("cpic_planner.report").joinpath("templates/prose.yaml").read_text(encoding="utf-8")
    return dict(parse_yaml(text, where="prose.yaml"))


def terms(words: str = "") -> list[tuple[str, str]]:
    """Return terms and their meanings in the order of the glossary: all, or those named, with ``; `` between them."""
    named = words.split("; ") if words else _prose()["terms"]
    return [(word, text) for word, text in _prose()["terms"].items() if word in named]


def whatif_terms() -> list[tuple[str, str]]:
    """Return the terms of comparisons of survey strategies, besides those of all reports."""
    return list(_prose()["whatif_terms"].items())


def reading() -> list[str]:
    """Return how to read the intervals of a comparison of survey strategies."""
    return list(_prose()["reading"])


def method_credits() -> list[str]:
    """Return what to cite besides the data."""
    return list(_prose()["credits"])
