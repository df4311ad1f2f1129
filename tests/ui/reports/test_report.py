from __future__ import annotations

import itertools
import re
from dataclasses import replace
from html.parser import HTMLParser

import pytest

from companion.assurance.encounters import total_duration_s
from companion.ui.reports.report import write_report
from companion.ui.reports.style import number_text
from tests.ui.reports.flights import empty_record, mission, record, snapshot_of

VOID = {"meta", "img", "br", "path", "use", "rect", "image"}


class Page(HTMLParser):
    """Elements, texts of cells, and whether every element is closed in turn."""

    def __init__(self, text):
        super().__init__()
        self.open, self.attributes, self.cells, self.titles = [], [], [], []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.attributes.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        if tag not in VOID:
            assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open and self.open[-1] in ("td", "th"):
            self.cells.append(data)
        if self.open and self.open[-1] in ("title", "h1", "h2"):
            self.titles.append(data)


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    config = mission()
    page, picture = write_report(
        tmp_path_factory.mktemp("flights") / "one", config, snapshot_of(config), record()
    )
    return page.read_text(encoding="utf-8"), picture


def test_the_page_is_whole(written):
    page = Page(written[0])
    assert page.open == []
    assert page.titles[0] == "Flight report: made-up"
    assert {"Summary", "Map", "Over the flight", "Decisions"} <= set(page.titles)
    assert written[1].read_bytes().startswith(b"\x89PNG")


def test_the_page_needs_nothing_from_elsewhere(written):
    for tag, attributes in Page(written[0]).attributes:
        assert tag not in ("link", "script", "iframe", "object")
        for key in ("src", "href", "xlink:href"):
            assert attributes.get(key, "#").startswith(("#", "data:image/png;base64,"))
    assert not re.search(r"@import|url\((?!#)", written[0])


def test_every_picture_says_what_it_shows(written):
    elements = Page(written[0]).attributes
    pictures = [attributes.get("alt") for tag, attributes in elements if tag == "img"]
    pictures += [attributes.get("aria-label") for tag, attributes in elements if tag == "svg"]
    assert len(pictures) == 6
    assert all(len(text) > 20 for text in pictures)


def test_names_inside_the_page_are_unique_and_every_reference_is_met(written):
    names = [attributes["id"] for _, attributes in Page(written[0]).attributes if "id" in attributes]
    assert len(names) == len(set(names))
    references = set(re.findall(r'(?:href="#|url\(#)([^")]+)', written[0]))
    assert references
    assert references <= set(names)


def test_texts_are_escaped_and_told_in_the_table(written):
    cells = Page(written[0]).cells
    assert "heard <script>alert('x')</script> & more" in "".join(cells)
    assert "<script" not in written[0]
    assert "<b>" not in written[0]
    assert {"−00:05", "02:05", "210", "903"} <= set(cells)


def test_the_summary_has_words_and_units(written):
    cells = Page(written[0]).cells
    pairs = dict(itertools.pairwise(cells))
    assert pairs["reached goal"] == "yes"
    assert pairs["closest"] == "123 m"
    assert pairs["seed"] == "1"
    assert pairs["autopilot"] == "<b>"
    assert pairs["gap"] == "–"


def test_the_table_of_threats_tells_of_each_and_by_whose_paths(written, tmp_path):
    cells = Page(written[0]).cells
    first = cells.index("vehicle")
    assert cells[first + 1] == "250"
    vehicle = record().encounters[0]
    seconds = [total_duration_s(stretches) for stretches in (vehicle.in_reach_s, vehicle.in_sight_s)]
    assert cells[first + 2 : first + 4] == [number_text(value) for value in seconds]
    assert "By the true paths." in written[0]
    config, known = mission(), replace(record(), dt_paths=())
    page, _ = write_report(tmp_path, config, snapshot_of(config), known)
    assert "As known on board." in page.read_text(encoding="utf-8")


def test_equal_records_give_equal_pages(written, tmp_path):
    config = mission()
    again, _ = write_report(tmp_path, config, snapshot_of(config), record())
    assert again.read_text(encoding="utf-8") == written[0]


def test_an_empty_record_is_reported_as_such(tmp_path):
    config = mission(2, radars=False)
    page, _ = write_report(tmp_path, config, snapshot_of(config), empty_record())
    text = page.read_text(encoding="utf-8")
    assert "No decision was recorded." in text
    assert "Nothing was summed up." in text
    assert "No threat was met." in text
