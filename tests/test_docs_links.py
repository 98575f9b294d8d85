"""Links and anchors of all pages, and the navigation of the site, without building it."""

import fnmatch
import re

import pytest

from tests.pages import DOCS, PAGES, README, ROOT, anchors_of, links_of, name_of, text_of

every_page = pytest.mark.parametrize("page", PAGES, ids=name_of)


@every_page
def test_links_of_a_page_lead_to_a_file_and_to_a_heading(page):
    for link in links_of(page):
        path, _, anchor = link.partition("#")
        target = (page.parent / path).resolve() if path else page
        assert target.exists(), link
        if anchor:
            assert anchor in anchors_of(target), f"{link}: expected one of {sorted(anchors_of(target))}"


@every_page
def test_pictures_of_a_page_are_there_small_and_described(page):
    for words, path in re.findall(r"!\[([^\]]*)\]\(([^)]+)\)", text_of(page)):
        assert len(words.split()) > 2, path
        assert (page.parent / path).stat().st_size < 300_000, path


def test_anchors_are_those_that_readers_know():
    method = anchors_of(ROOT / "docs" / "method.md")
    assert {"verification", "7-solving-and-basin-hopping", "8-seeds"} <= method
    assert len(links_of(README)) > 10


def test_every_page_is_in_the_navigation_of_the_site():
    trees = re.findall(r"```\{toctree\}\n(.*?)```", text_of(ROOT / "docs" / "index.md"), re.DOTALL)
    entries = [line for tree in trees for line in tree.splitlines() if line and not line.startswith(":")]
    pages = {page.relative_to(ROOT / "docs").with_suffix("").as_posix() for page in DOCS} - {"index"}
    assert {page for page in pages if not any(fnmatch.fnmatch(page, entry) for entry in entries)} == set()
    # An entry without a star has to be a page; with one it waits for pages to come.
    assert {entry for entry in entries if "*" not in entry} <= pages


def test_every_picture_is_on_a_page():
    shown = {path for page in PAGES for path in re.findall(r"images/([\w-]+\.(?:png|svg))", text_of(page))}
    assert {path.name for path in (ROOT / "docs" / "images").iterdir()} == shown
