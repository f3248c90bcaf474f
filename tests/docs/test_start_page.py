"""The questions of a newcomer are answered within two clicks from the start page, and every page is linked."""

import re
from pathlib import Path

import pytest
import yaml

DOCS = Path(__file__).resolve().parents[2] / "docs"
MADE = {"_made", "_build", "reports", "notebooks"}
START = (DOCS / "index.md").read_text(encoding="utf-8")
ANSWERS = dict(re.findall(r"^\| (.+\?) \| \[[^\]]+\]\(([^)]+)\) \|$", START, re.MULTILINE))
# Words that the answer has to hold, at the place that the start page leads to.
QUESTIONS = {
    "How long does SNR 10 take": r'cpic etc "tau Cet" --snr 10',
    "What limits": r"noise budget.*limited_by",
    "spectrum": r"--albedo my_spectrum\.txt",
    "five stars first": r"cpic rank --limit 5.*--explain",
    "drift is 0.1 nm": r"--set drift=0\.1nm",
    "How sure is the order": r"--instruments 200",
    "my star not there": r"parallax.*V <= 7",
    "one year at 5 %": r"--share-of-time 0\.05",
    "orbit or atmosphere": r"astrometry\.csv.*orbitize!",
    "What is a visit": r"one stay of the telescope",
    "Blind or at a known place": r"--search known_place",
    "noise model checked": r"equations.*evaluated",
    "assumed about the instrument": r"source and its confidence",
    "Level-0 keywords": r"keywords\.yaml.*public code or documents",
    "Can my table be read": r"cpic catalog columns FILE",
    "coronagraph is a table": r"separation_lambda_d,core_throughput,raw_contrast",
    "add a band": r"bands:\n  F606",
    "new detector effect": r"simulator\.detectors\.effect\.Effect",
    "cite it": r"CITATION\.cff",
}


def target(link):
    """Return the text that a link of the start page leads to: a page, or the section of a label or heading."""
    if not link.startswith("#"):
        return (DOCS / link).read_text(encoding="utf-8")
    for path in DOCS.rglob("*.md"):
        if not MADE & set(path.relative_to(DOCS).parts):
            text = path.read_text(encoding="utf-8")
            section = re.search(
                rf"^\({re.escape(link[1:])}\)=\n(.*?)(?=^\([\w-]+\)=$|\Z)", text, re.MULTILINE | re.DOTALL
            )
            if section:
                return section[1]
    raise AssertionError(f"{link} leads nowhere")


@pytest.mark.parametrize("question", QUESTIONS)
def test_a_question_is_answered_one_click_from_the_start(question):
    link = next(link for asked, link in ANSWERS.items() if question in asked)
    assert re.search(QUESTIONS[question], target(link), re.DOTALL), link


def test_each_question_of_the_start_page_is_checked():
    assert len(ANSWERS) == len(QUESTIONS)


def test_every_page_is_in_the_table_of_contents():
    listed = set(re.findall(r"^([\w/]+)$", START, re.MULTILINE))
    pages = {
        path.relative_to(DOCS).with_suffix("").as_posix()
        for path in DOCS.rglob("*.md")
        if not MADE & set(path.relative_to(DOCS).parts[:-1])
    }
    assert pages - {"index"} <= listed
    assert len(pages) > 35


@pytest.mark.parametrize("page", ["README.md", "docs/cite.md"])
def test_the_line_to_cite_is_that_of_the_citation_file(page):
    cited = yaml.safe_load((DOCS.parent / "CITATION.cff").read_text(encoding="utf-8"))
    text = re.sub(r"[\s>]+", " ", (DOCS.parent / page).read_text(encoding="utf-8"))
    assert f"{cited['authors'][0]['name']}, *{cited['title']}*," in text
    assert "CITATION.cff" in text
