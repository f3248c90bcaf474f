"""Floors and arrows: who may import whom (also inside functions)."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]

FLOORS = ["catalogs", "simulator", "cpic_planner"]
# Inside a floor data flows left to right; a module imports its own room or rooms to its left.
SIMULATOR = [
    {"files", "numeric", "work", "quantities"},
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
    {"version", "registry"},
    {"models", "engine", "cluster", "environment", "runfolder", "written_files"},
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
    {"overrides", "override_keys", "written_values"},
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


@pytest.mark.parametrize("floor", FLOORS)
def test_imports_follow_the_arrows(floor):
    paths = [path for path in modules() if path.relative_to(ROOT).parts[0] == floor]
    assert len(paths) > 20
    assert [wrong for path in paths for wrong in against(path)] == []


def against(path):
    """Imports of a module that go against the arrows."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    here, room = "/".join(parts), parts[1]
    floor, order = FLOORS.index(parts[0]), {"simulator": SIMULATOR, "cpic_planner": PLANNER}.get(parts[0])
    if order is not None and room != "__init__" and rank_of(order, room) is None:
        yield f"{here}: {room} has no place in the order"
        return
    for name, line in imports(path):
        target = name.split(".")
        if target[0] not in FLOORS:
            continue
        if FLOORS.index(target[0]) > floor:
            yield f"{here}:{line} imports {name} from a floor above"
        if order is None or target[0] != parts[0] or len(target) < 2 or room == "__init__":
            continue
        rank = rank_of(order, target[1])
        if rank is None or target[1] == room or {target[1], room} <= order[rank]:
            continue
        if rank >= rank_of(order, room):
            yield f"{here}:{line} imports {name} from its right"


def test_what_goes_against_them_is_listed(monkeypatch, tmp_path):
    """One list holds every offence: a floor above, a room to the right, a room without a place."""
    monkeypatch.setitem(globals(), "ROOT", tmp_path)
    (tmp_path / "simulator" / "camera").mkdir(parents=True)
    first, second = tmp_path / "simulator" / "camera" / "gain.py", tmp_path / "simulator" / "new.py"
    first.write_text(
        "import cpic_planner.etc\n\ndef late():\n    from simulator import ledger\n    import simulator.rng\n"
    )
    second.write_text("")
    assert [*against(first), *against(second)] == [
        "simulator/camera/gain:1 imports cpic_planner.etc from a floor above",
        "simulator/camera/gain:4 imports simulator.ledger from its right",
        "simulator/new: new has no place in the order",
    ]


def test_rooms_are_small():
    # One concept a module.
    large = {str(p.relative_to(ROOT)): n for p in modules() if (n := len(p.read_text().splitlines())) > 400}
    assert large == {}
