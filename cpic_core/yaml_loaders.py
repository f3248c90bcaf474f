"""Loaders of strict YAML, beside `cpic_core.yaml_files`: PyYAML takes longer to load than a question to answer."""

import re
import sys
from typing import Any

import yaml


class _Strict(yaml.constructor.SafeConstructor, yaml.resolver.BaseResolver):
    """The YAML 1.2 core scalars; duplicate keys are errors."""

    def construct_mapping(self, node: Any, deep: bool = False) -> dict[Any, Any]:
        seen: set[Any] = set()
        for key_node, _ in node.value:
            key = self.construct_object(key_node, deep=True)
            if not isinstance(key, str | int | float | bool):
                raise yaml.constructor.ConstructorError(None, None, "a key must be a plain word", key_node.start_mark)
            if key in seen:
                raise yaml.constructor.ConstructorError(None, None, f"duplicate key {key!r}", key_node.start_mark)
            seen.add(key)
        return super().construct_mapping(node, deep=deep)


_Strict.yaml_implicit_resolvers = {}
for _tag, _pattern, _first in (
    ("bool", r"^(?:true|True|TRUE|false|False|FALSE)$", "tTfF"),
    ("null", r"^(?:~|null|Null|NULL|)$", ["~", "n", "N", ""]),
    ("int", r"^[-+]?[0-9]+$", "-+0123456789"),
    (
        "float",
        r"^(?:[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN))$",
        "-+.0123456789",
    ),
):
    _Strict.add_implicit_resolver(f"tag:yaml.org,2002:{_tag}", re.compile(_pattern), list(_first))


def _construct_int(loader: _Strict, node: Any) -> int:
    try:
        return int(loader.construct_scalar(node))
    except ValueError:
        problem = f"a whole number of more than {sys.get_int_max_str_digits()} digits"
        raise yaml.constructor.ConstructorError(None, None, problem, node.start_mark) from None


def _construct_float(loader: _Strict, node: Any) -> float:
    text = str(loader.construct_scalar(node)).lower().replace(".inf", "inf").replace(".nan", "nan")
    return float(text)


_Strict.add_constructor("tag:yaml.org,2002:int", _construct_int)  # type: ignore[type-var]
_Strict.add_constructor("tag:yaml.org,2002:float", _construct_float)  # type: ignore[type-var]


class StrictLoader(_Strict, yaml.SafeLoader):
    """The loader of users' files: aliases are errors too."""

    def compose_node(self, parent: Any, index: Any) -> Any:
        """Return a node; refuse an alias."""
        if self.check_event(yaml.AliasEvent):
            event: Any = self.peek_event()  # type: ignore[no-untyped-call]
            problem = "aliases (*name) are not accepted: write the value out"
            raise yaml.constructor.ConstructorError(None, None, problem, event.start_mark)
        return super().compose_node(parent, index)
