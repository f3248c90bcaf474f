"""Tags and words of a page."""

import re
from html.parser import HTMLParser

VOID_TAGS = {"meta", "img", "br", "link", "input", "hr"}


class Reader(HTMLParser):
    """Collects attributes and visible text, and checks that tags are balanced."""

    def __init__(self):
        super().__init__()
        self.tags, self.open, self.text = [], [], []

    def handle_starttag(self, tag, attributes):
        self.tags.append((tag, dict(attributes)))
        if tag not in VOID_TAGS:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if not {"style", "script"} & set(self.open):
            self.text.append(data)

    @property
    def words(self):
        """All visible text, blanks made one."""
        return " ".join(" ".join(self.text).split())

    def check_alone(self):
        """Nothing is loaded from outside, no script but the one of reports runs, and no value is missing in words."""
        for tag, attributes in self.tags:
            assert tag not in {"link", "iframe", "object", "embed", "base"}
            assert tag != "script" or attributes == {}
            for key in ("src", "href", "srcset", "action", "data", "poster"):
                value = attributes.get(key)
                assert value is None or value.startswith(("data:image/", "#")), (tag, value)
        assert sum(tag == "script" for tag, _ in self.tags) == 1
        assert not re.search(r"\b(?:nan|None|undefined)\b", self.words)

    def check_anchors(self):
        """Every anchor is there once and every link leads to one; every table says what it is."""
        ids = [attributes["id"] for _, attributes in self.tags if "id" in attributes]
        assert len(ids) == len(set(ids))
        for _, attributes in self.tags:
            if attributes.get("href", "").startswith("#"):
                assert attributes["href"][1:] in ids
        assert sum(tag == "caption" for tag, _ in self.tags) == sum(tag == "table" for tag, _ in self.tags)


def read(page: str) -> Reader:
    """Tags and visible text of a page whose tags are balanced."""
    reader = Reader()
    reader.feed(page)
    reader.close()
    assert reader.open == []
    return reader
