"""What a change adds to the house: lines, nearly equal classes, repeated names, circles."""

import textwrap

from tools.house import circles, code_lines, near_equal, repeated_names, sizes

FIELDS = ["a_s", "b_s", "c_s", "d_s", "e_s", "f_s"]


def row(name, fields, base=""):
    return f"class {name}{base}:\n" + "".join(f"    {field}: float\n" for field in fields)


def test_code_is_what_is_no_docstring_comment_or_blank():
    text = textwrap.dedent('''
        """Module
        of two lines."""

        # why
        def one(
            a,
        ):
            """Return a."""
            return a  # beside
        ''')
    assert code_lines(text) == 4


def test_rooms_are_two_levels_deep():
    found = sizes(
        {"simulator/imaging/psf.py": "a = 1\n", "simulator/imaging/deep/x.py": "b = 1\nc = 1\n", "tools/z.py": ""}
    )
    assert found == {"simulator/imaging": (3, 2), "tools": (0, 1)}


def test_classes_that_share_six_fields_are_nearly_equal_and_heirs_are_not():
    texts = {
        "x/one.py": row("One", FIELDS),
        "y/two.py": row("Two", [*FIELDS, "g_s"]),
        "y/three.py": row("Three", FIELDS[:5]),
        "y/heir.py": row("Heir", ["g_s", "h_s", "i_s", "j_s", "k_s"], "(One)"),
    }
    assert near_equal(texts) == [(6, "x/one.py:One", "y/two.py:Two")]


def test_a_large_class_that_shares_a_small_part_of_another_is_not_nearly_equal():
    texts = {name: row(name, [*FIELDS, *(f"{name}_{index}" for index in range(7))]) for name in ("Left", "Right")}
    assert near_equal(texts) == []


def test_names_that_stand_in_two_rooms():
    assert repeated_names(dict.fromkeys(["a/x.py", "b/x.py", "a/y.py", "a/__init__.py", "b/__init__.py"], "")) == {
        "x.py": 2
    }


def test_circles_are_found_through_lazy_names(tmp_path):
    texts = {
        "p/__init__.py": "",
        "p/one.py": "def f():\n    from q import g\n",
        "q/__init__.py": "",
        "q/two.py": "from p.one import f\ng = 1\n",
        "q/three.py": "from p import one\n",
    }
    for path, text in texts.items():
        (tmp_path / path).parent.mkdir(exist_ok=True)
        (tmp_path / path).write_text(text)
    (tmp_path / "q/__init__.pyi").write_text("from q.two import g as g\n")
    assert circles(tmp_path, texts) == [["p.one", "q.two"]]
