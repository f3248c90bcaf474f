"""An option that a command does not have is answered with the one that was meant, by meaning before spelling."""

import pytest


@pytest.mark.parametrize(
    ("arguments", "meant"),
    [
        (("rank", "--top", "5"), "did you mean --limit?"),
        (("rank", "--rows=5"), "did you mean --limit?"),
        (("plan", "--limit", "5"), "did you mean --top?"),
        (("rank", "--drift", "x2"), "did you mean --set drift=x2 or --drift-nm?"),
        (("etc", "tau Cet", "--drift=0.1nm"), "did you mean --set drift=0.1nm or --drift-nm?"),
        (("etc", "tau Cet", "--throughput", "--json"), "did you mean --set throughput=x2?"),
        (("rank", "--visit-drift", "x3"), "did you mean --set visit_drift=x3?"),
        (("rank", "--output", "x.csv"), "did you mean --out?"),
        (("rank", "-o", "x.csv"), "did you mean --out?"),
        (("rank", "--sort", "distance"), "did you mean --score?"),
        (("etc", "tau Cet", "--filters", "F520"), "did you mean --band?"),
        (("simulate", "paper_example", "--exptime", "3"), "did you mean --exposure-s?"),
        (("rank", "--limt", "5"), "did you mean --limit?"),
        (("rank", "--zzzz"), "No such option: --zzzz (see"),
        (("check", "x", "--top"), "No such option: --top (see"),
    ],
)
def test_the_option_that_was_meant(refuses, arguments, meant):
    refuses(arguments, ["No such option: ", meant, f"(see cpic {arguments[0]} --help)"])


@pytest.mark.parametrize("form", ["csv", "ecsv", "latex", "markdown", "json"])
def test_brief_and_a_form_are_one_of_two(refuses, form):
    refuses(("rank", "--brief", "--format", form), [f"--brief = given with --format {form}", "allowed: one of the two"])


def test_words_of_libraries_are_left_out(refuses):
    refuses(("rank", "--filter", "F520"), ["Invalid value for '--filter': 'F520' is not one of 'aperture'"])
