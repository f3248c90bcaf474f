"""The figures of the README are those of the committed reports, whatever its words."""

import pytest
from jinja2 import UndefinedError

from tools import readme

FIGURES = {"plan": {"stars": "12", "ratio": "1.01 ± 0.03"}, "table": {"plan": "| a |\n| b |"}}
TEMPLATE = "# Title\n\nOf {{ plan.stars }} stars\nit is {{ plan.ratio }}.\n\n{{ table.plan }}\n\nThe end.\n"


def test_it_is_made_of_its_template():
    assert readme.main(["--check"]) == 0


def test_every_group_is_quoted_and_says_something():
    pages = [readme.TEMPLATE, *(readme.ROOT / "docs").glob("*/*.md")]
    quoted = "".join(page.read_text(encoding="utf-8") for page in pages)
    for group, of in readme.FIGURES.items():
        for name, text in of().items():
            assert f"{{{{ {group}.{name} }}}}" in quoted, (group, name)
            assert text
    assert all(table.count("\n") >= 5 for table in readme.tables().values())


def test_the_shortcuts_of_the_ledger_hold():
    """Upper 95 % bound of the rate at which a scene moves by more than its tolerance."""
    assert float(readme.dial()["bound"]) <= 1.0


def test_figures_stand_where_their_names_are():
    text = readme.filled(TEMPLATE, FIGURES)
    assert text == "# Title\n\nOf 12 stars\nit is 1.01 ± 0.03.\n\n| a |\n| b |\n\nThe end.\n"
    with pytest.raises(UndefinedError, match="planets"):
        readme.filled("{{ plan.planets }}", FIGURES)


def test_a_report_that_no_longer_says_it_is_named():
    with pytest.raises(ValueError, match="no report says"):
        readme.search(r"(\d+) planets", "5 stars")


@pytest.mark.parametrize(
    ("old", "new", "kept"),
    [
        ("# Title", "# Other title", "{{ plan.stars }}"),
        ("The end.", "More.\n\nThe end.", "{{ table.plan }}"),
        ("it is", "the ratio is", "{{ plan.stars }}"),
        ("| b |", "| c |", "{{ plan.ratio }}"),
        ("\nThe end.\n", "", "{{ table.plan }}"),
    ],
)
def test_changed_words_come_into_the_template(old, new, kept):
    """What it then makes is the README that was changed; figures elsewhere keep their names."""
    changed = readme.filled(TEMPLATE, FIGURES).replace(old, new)
    template = readme.adopted(TEMPLATE, FIGURES, changed)
    assert readme.filled(template, FIGURES) == changed
    assert kept in template
    assert readme.adopted(TEMPLATE, FIGURES, readme.filled(TEMPLATE, FIGURES)) == TEMPLATE


def test_another_readme_fails_the_check(tmp_path, monkeypatch, capsys):
    path = tmp_path / "README.md"
    path.write_text(readme.README.read_text(encoding="utf-8").replace("Predicted over recovered SNR", "This ratio"))
    monkeypatch.setattr(readme, "README", path)
    assert readme.main(["--check"]) == 1
    assert "make readme" in capsys.readouterr().err
    assert readme.main([]) == 0
    assert readme.main(["--check"]) == 0
