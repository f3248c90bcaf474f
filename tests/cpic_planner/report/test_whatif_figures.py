import pytest

from cpic_planner.report.whatif_figures import WHATIF_FIGURES, whatif_figures

ALL = ["yields", "differences", "curves", "time", "calendar", "sky", "detections", "convergence"]


@pytest.mark.parametrize(
    ("names", "empty", "keys"),
    [
        (["one", "two"], False, ALL),
        pytest.param(["one"], False, [key for key in ALL if key != "differences"], marks=pytest.mark.long),
        (["one", "two"], True, ["yields", "differences", "curves", "time", "convergence"]),
        (["one drift=x1 (0.05 nm)", "one drift=0.1 nm"], False, ["sweep", *ALL]),
    ],
)
def test_what_there_is_is_drawn_under_titles_of_the_report(compared, names, empty, keys):
    import matplotlib.pyplot as plt

    figures = whatif_figures(compared(names, empty=empty))
    assert list(figures) == keys
    assert [key for key in WHATIF_FIGURES if key in figures] == keys
    for picture in figures.values():
        assert picture.alt
        assert picture.caption.endswith(".")
    assert plt.get_fignums() == []
