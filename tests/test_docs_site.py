"""The site that `make docs` built: whole, and loading nothing from elsewhere.  CI builds it before."""

import os
import re

import pytest

from tests.pages import DOCS, ROOT

SITE = ROOT / "build" / "docs"
pytestmark = pytest.mark.skipif(
    not (SITE / "index.html").is_file() and "COASTARC_REQUIRE_SITE" not in os.environ,
    reason="no site; `make docs` builds it",
)
#: What makes a browser load something: not the links that a reader follows.
_LOADS = re.compile(
    r'<(?:script|img|iframe|link(?=[^>]*rel="(?:stylesheet|preload|icon)"))[^>]*(?:src|href)="([^"]+)"'
)


def html_of(page):
    return SITE / page.relative_to(ROOT / "docs").with_suffix(".html")


@pytest.mark.parametrize("page", DOCS, ids=lambda page: page.stem)
def test_a_page_is_on_the_site_and_loads_nothing_from_elsewhere(page):
    loaded = _LOADS.findall(html_of(page).read_text(encoding="utf-8"))
    assert loaded and not [address for address in loaded if re.match(r"(\w+:)?//", address)]


def test_styles_of_the_site_load_nothing_from_elsewhere():
    for path in SITE.rglob("*.css"):
        assert not re.findall(r"url\(['\"]?(?:\w+:)?//", path.read_text(encoding="utf-8")), path


def test_public_names_of_core_are_in_the_reference():
    import core

    text = (SITE / "reference.html").read_text(encoding="utf-8")
    assert all(f'id="core.{name}"' in text for name in core.__all__)
