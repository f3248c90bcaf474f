"""Floors and arrows: who may import whom (also inside functions)."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]

FLOORS = ["catalogs", "simulator", "cpic_planner"]
# Inside a floor data flows left to right; a module imports its own room or rooms to its left.
SIMULATOR = [
    {"files", "work", "quantities"},
    {"lazy"},
    {"config", "rng", "outcome", "cache", "arrays"},
    {"knobs", "band_integrals", "albedo_family"},
    {"passbands"},
    {"target"},
    {"imaging"},
    {"effects"},
    {"camera"},
    {"products"},
    {"scene_light"},
    {"ledger"},
    {"sequence"},
    {"observation", "calibration"},
    {"hole_stack"},
]
PLANNER = [
    {"version"},
    {"models", "engine", "cluster", "environment", "runfolder"},
    {"schemas"},
    {"targets", "refresh"},
    {"etc"},
    {"optimiser"},
    {"orbits", "distributions"},
    {"population_config"},
    {"population", "mass_radius"},
    {"completeness", "known_planets", "known_rows"},
    {"known_completeness"},
    {"known_answer", "known_scene"},
    {"ranking"},
    {"sensitivity"},
    {"explain"},
    {"overrides", "override_keys"},
    {"validation"},
    {"etc_images", "etc_check"},
    {"report"},
    {"survey"},
    {"confirmed"},
    {"plan", "scene_confirmation", "confirm_run", "simulation"},
    {"tradeoff"},
    {"api"},
    {"cli"},
]


def rank_of(order, room):
    for position, rooms in enumerate(order):
        if room in rooms:
            return position
    return None


def imports(path):
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from ((alias.name, node.lineno) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            yield node.module, node.lineno
            yield from ((f"{node.module}.{alias.name}", node.lineno) for alias in node.names)


def modules():
    return sorted(path for floor in FLOORS for path in (ROOT / floor).rglob("*.py"))


@pytest.mark.parametrize("path", modules(), ids=lambda path: str(path.relative_to(ROOT)))
def test_imports_follow_the_arrows(path):
    parts = path.relative_to(ROOT).with_suffix("").parts
    floor = FLOORS.index(parts[0])
    order = {"simulator": SIMULATOR, "cpic_planner": PLANNER}.get(parts[0])
    room = parts[1]
    if order is not None and room != "__init__":
        assert rank_of(order, room) is not None, f"{room} has no place in the order"
    for name, line in imports(path):
        target = name.split(".")
        if target[0] not in FLOORS:
            continue
        assert FLOORS.index(target[0]) <= floor, f"{path.name}:{line} imports {name} from a floor above"
        if order is None or target[0] != parts[0] or len(target) < 2 or room == "__init__":
            continue
        rank = rank_of(order, target[1])
        if rank is not None and target[1] != room:
            assert rank < rank_of(order, room) or {target[1], room} <= order[rank], (
                f"{path.name}:{line} imports {name} from its right"
            )


def test_rooms_are_small():
    # One concept a module.
    large = {str(p.relative_to(ROOT)): n for p in modules() if (n := len(p.read_text().splitlines())) > 400}
    assert large == {}
