"""Cases of YAML: shipped settings and questions with values, keys, structure or bytes changed."""

import copy
import functools
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import yaml
from hypothesis import strategies as st

from cpic_core import load_yaml
from simulator.config import load_instrument, load_scene, load_simulation
from tests.fuzz.values import NUMBERS, WORDS
from tests.fuzz.watched import Case, of_function

ROOT = Path(__file__).resolve().parents[2]
_SMALL: dict[str, tuple[str, ...]] = {
    "scene": ("paper_background", "paper_bright_source", "paper_example", "paper_science"),
    "simulation": ("calibration_set", "paper_alpha_cen_b", "paper_shifted_star", "paper_table1"),
    "instrument": ("as_published", "cpic_2q", "paper_table1", "cpic_default"),
    "strategies": ("survey_default",),
    "population": ("giants", "jupiters", "solar_system"),
    "visibility": ("default",),
    "ensemble": ("default",),
}
_QUESTION = {
    "kind": "question",
    "target": "tau Cet",
    "bands": ["F520"],
    "snr": 5.0,
    "separation_arcsec": [0.5],
    "planet": {"radius_rjup": 1.0, "phase_deg": 90.0, "albedo": {"model": "jupiter"}},
    "strategy": {"visits": 2, "library": "roll", "roll_deg": 30.0},
    "instrument": {"drift": {"visit_nm": 0.1}, "detector": {"read_noise_e": 100.0}},
}
_QUIET_SECTIONS = ("detector", "sky", "cosmic_rays", "drift", "overhead_s", "mission", "name")
"""Sections of an instrument that leave its optics as they are: others make dark holes anew, which takes a minute."""
VALUES = (
    *(
        None,
        True,
        False,
        0,
        -1,
        1,
        1.5,
        -0.0,
        1e-308,
        5e-324,
        1e308,
        float("inf"),
        float("nan"),
        10**400,
        -(10**30),
        10**19,
    ),
    *(
        [],
        {},
        [[]],
        [None],
        {"a": 1},
        [1, 2, 3],
        {"value": 1},
        {"value": 1, "range": ["a"]},
        {"law": "x"},
        "x2",
        "x1e308",
    ),
)
_TEXTS = (
    *(
        "\t",
        "&a ",
        "*a",
        "!!python/object:os.system ",
        "!!binary ",
        "---\n",
        "...\n",
        "? ",
        "\x00",
        "\x85",
        "\u2028",
        "\ufeff",
    ),
    *(
        "[" * 3000,
        "{a: " * 500,
        "a: {" * 2000,
        "'",
        '"',
        "|",
        ">",
        "%YAML 9.9\n",
        "<<: {a: 1}\n",
        "9" * 10_000,
        "1e",
        ": ",
        "#",
    ),
    *("\ud800", "0o17", "12:30", "1_000", "kind: scene\n", "~", "- " * 300),
)


@functools.cache
def _tree(kind: str, name: str) -> Any:
    folder = "simulator" if kind in ("scene", "simulation", "instrument") else "cpic_planner"
    return load_yaml(ROOT / folder / "presets" / kind / f"{name}.yaml")


def _places(node: Any) -> Iterator[tuple[Any, Any]]:
    """Every container with each of its keys."""
    items = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ()
    for key, item in list(items):
        yield node, key
        yield from _places(item)


def _read(kind: str, path: Path) -> Any:
    """Read a file as its users do, and use what it says as far as that takes milliseconds."""
    from cpic_planner import load_population, load_strategies, signal_to_noise, spectrum_generator
    from cpic_planner.queries import EtcQuestion, load_ensemble
    from cpic_planner.schemas import QUESTIONS
    from cpic_planner.survey.visibility import load_visibility

    del QUESTIONS
    if kind == "scene":
        return spectrum_generator(load_scene(path))
    if kind == "instrument":
        ours, shipped = load_instrument(path), load_instrument()
        if ours.model_copy(update={name: getattr(shipped, name) for name in _QUIET_SECTIONS}) == shipped:
            return signal_to_noise("tau Cet", instrument=ours, bands=["F520"], time_s=36000, separation_arcsec=0.5)
        return ours
    if kind == "question":
        from cpic_planner.api.one_star import answers_of

        question = EtcQuestion.of(EtcQuestion.load(path))
        same = question.instrument.model_copy(
            update={name: getattr(load_instrument(), name) for name in _QUIET_SECTIONS}
        )
        slow = question.fidelity is not None or question.tolerance is not None or same != load_instrument()
        return None if slow else answers_of(question)
    readers: dict[str, Callable[[Any], Any]] = {
        "simulation": load_simulation,
        "strategies": load_strategies,
        "population": load_population,
        "visibility": load_visibility,
        "ensemble": load_ensemble,
    }
    return readers[kind](path)


@st.composite
def cases(draw: Any, folder: Path) -> Case:
    """Draw a file of settings or a question."""
    kind = draw(st.sampled_from([*_SMALL, "question", "question", "scene", "instrument"]))
    tree = copy.deepcopy(_QUESTION if kind == "question" else _tree(kind, draw(st.sampled_from(_SMALL[kind]))))
    words = st.one_of(
        st.sampled_from(VALUES).map(copy.deepcopy),
        st.sampled_from(NUMBERS),
        st.sampled_from(WORDS),
        st.floats(),
        st.text(max_size=9),
    )
    for _ in range(draw(st.sampled_from((0, 1, 1, 1, 2, 3)))):
        places = list(_places(tree))
        if not places:
            break
        holder, key = draw(st.sampled_from(places))
        change = draw(st.sampled_from(("value", "value", "value", "scale", "drop", "rename", "add", "wrap", "twice")))
        item = holder[key]
        if change == "scale" and isinstance(item, int | float) and not isinstance(item, bool):
            holder[key] = item * draw(st.sampled_from((-1, 0, 1e-300, 1e-9, 1e3, 1e9, 1e300)))
        elif change == "drop":
            del holder[key]
        elif change == "rename" and isinstance(holder, dict):
            holder[
                draw(st.one_of(st.sampled_from([f"{key}s", str(key).upper(), 5, None, True, ""]), st.text(max_size=9)))
            ] = holder.pop(key)
        elif change == "add" and isinstance(holder, dict):
            holder[draw(st.text(max_size=9))] = draw(words)
        elif change == "wrap":
            holder[key] = draw(st.sampled_from(([item], [item, item], {"value": item}, {key: item})))
        elif change == "twice" and isinstance(holder, list):
            holder.append(item)
        else:
            holder[key] = draw(words)
    text = yaml.safe_dump(tree, sort_keys=False, allow_unicode=True)
    for _ in range(draw(st.sampled_from((0, 0, 0, 1, 2)))):
        place = draw(st.integers(0, len(text)))
        change = draw(st.sampled_from(("insert", "cut", "line")))
        if change == "insert":
            text = text[:place] + draw(st.one_of(st.sampled_from(_TEXTS), st.text(max_size=5))) + text[place:]
        elif change == "cut":
            text = text[:place] + text[place + draw(st.integers(1, 40)) :]
        else:
            lines = text.splitlines(keepends=True) or [""]
            line = draw(st.sampled_from(lines))
            text = text.replace(line, line * 2, 1)
    path = folder / f"{kind}.yaml"

    def run() -> Any:
        path.write_bytes(text.encode("utf-8", "surrogatepass"))
        return _read(kind, path)

    return kind, text, lambda: of_function(run)
