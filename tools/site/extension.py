"""The project's Sphinx extension: formulas as MathML, names of docstrings as links, figures of reports."""

import inspect
import pkgutil
import re
from collections.abc import Iterator
from typing import Any

from tools.site import columns, pages, python_api


def setup(app: Any) -> dict[str, Any]:
    """Register the extension.

    Parameters
    ----------
    app : sphinx.application.Sphinx
    """
    app.add_html_math_renderer("mathml", (_inline, None), (_block, None))
    app.connect("source-read", _figures)
    app.connect("missing-reference", _resolved)
    app.connect("html-page-context", _reachable, priority=900)
    app.connect("autodoc-process-docstring", _plain_fields)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _figures(_app: Any, _name: str, source: list[str]) -> None:
    source[0] = pages.prepared(source[0])


def _reachable(_app: Any, _name: str, _template: str, context: dict[str, Any], _tree: Any) -> None:
    """Give headings of the table of contents their level, and let the keyboard reach what scrolls inside a page."""
    tree = context.get("furo_navigation_tree", "")
    context["furo_navigation_tree"] = tree.replace('role="heading"', 'role="heading" aria-level="2"')
    body = context.get("body", "")
    for scrolls in ('<div class="math"', "<pre", '<div class="table-wrapper'):
        body = body.replace(
            scrolls, f'{scrolls.partition(" ")[0]} tabindex="0"{scrolls.removeprefix(scrolls.split()[0])}'
        )
    context["body"] = body


def mathml(formula: str, display: str) -> str:
    """Return a formula of LaTeX as MathML, which browsers draw without a script.

    Parameters
    ----------
    formula : str
    display : {"inline", "block"}
    """
    from latex2mathml.converter import convert

    return str(convert(formula, display=display))


def _inline(writer: Any, node: Any) -> None:
    from docutils.nodes import SkipNode

    writer.body.append(mathml(node.astext(), "inline"))
    raise SkipNode


def _block(writer: Any, node: Any) -> None:
    from docutils.nodes import SkipNode

    number = f'<span class="eqno">({node["number"]})</span>' if node.get("number") else ""
    identifier = f' id="{node["ids"][0]}"' if node.get("ids") else ""
    writer.body.append(f'<div class="math"{identifier}>{mathml(node.astext(), "block")}{number}</div>\n')
    raise SkipNode


def _plain_fields(_app: Any, what: str, _name: str, item: Any, _options: Any, lines: list[str]) -> None:
    """Keep models from showing what pydantic says of itself."""
    if what == "class" and lines and lines[0].startswith("!!! abstract"):
        lines[:] = []


def _resolved(app: Any, env: Any, node: Any, content: Any) -> Any:
    """Link a name of a docstring to the place where the object is documented.

    What exists in the code, in a package that the project uses or in Python and has no place is shown as code. A name
    that is nowhere stays unresolved, which Sphinx reports.
    """
    if node.get("refdomain") != "py":
        return None
    found = _place(str(node["reftarget"]), node)
    if found is None:
        return None
    document, py = node.get("refdoc", ""), env.get_domain("py")
    if found in py.objects:
        return py.resolve_xref(env, document, app.builder, "obj", found, node, content)
    if found in env.get_domain("std").anonlabels:
        return env.get_domain("std").resolve_xref(env, document, app.builder, "ref", found, _explicit(node), content)
    return content


def _explicit(node: Any) -> Any:
    made = node.deepcopy()
    made["refexplicit"] = True
    return made


def _place(target: str, node: Any) -> str | None:
    """Return the name or label that documents an object; empty if it has none, None if it does not exist."""
    exists = False
    for name in _readings(target, node):
        found, item = _named(name)
        if found:
            exists = True
            for place, own in _public().items():
                if own is item:
                    return place
    return "" if exists else None


def _named(name: str) -> tuple[bool, Any]:
    """Return whether there is an object of a dotted name, and the object; None for a field that has no value."""
    try:
        return True, pkgutil.resolve_name(name)
    except (ImportError, AttributeError, ValueError):
        pass
    above, _, field = name.rpartition(".")
    try:
        owner = pkgutil.resolve_name(above)
    except (ImportError, AttributeError, ValueError):
        return False, None
    bases = getattr(owner, "__mro__", ())
    return any(field in inspect.get_annotations(base) for base in bases), None


def _readings(target: str, node: Any) -> Iterator[str]:
    """Yield what a name may mean where it stands: in its class, its module, the packages above, the language."""
    yield target
    home = re.search(r"docstring of ([\w.]+)", str(node.source or getattr(node.parent, "source", "") or ""))
    if home:
        path = home[1]
        owner: Any = None
        while path and owner is None:
            yield f"{path}.{target}"
            owner = _named(path)[1]
            if not hasattr(owner, "__qualname__"):  # a property, or a value
                owner, path = None, path.rpartition(".")[0]
        module = getattr(owner, "__module__", None)
        qualified = getattr(owner, "__qualname__", "")
        while module and qualified:
            yield f"{module}.{qualified}.{target}"
            qualified = qualified.rpartition(".")[0]
        if module:
            yield f"{module}.{target}"
        while path := path.rpartition(".")[0]:
            yield f"{path}.{target}"
    module, holder = node.get("py:module") or "", node.get("py:class") or ""
    yield from (f"{place}.{target}" for place in (f"{module}.{holder}", module, *_ANYWHERE) if place.strip("."))


_ANYWHERE = ("cpic_planner.results", "builtins")
_KEPT: dict[str, Any] = {}


def _public() -> dict[str, Any]:
    """Return the objects by their documented name, and models of results by the label of their table."""
    if not _KEPT:
        named = python_api.public()
        named |= python_api.returned(named)
        _KEPT.update({f"result-{model.__name__.lower()}": model for model in columns.models()} | named)
    return _KEPT
