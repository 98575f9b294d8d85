import gzip
import posixpath
import re
from importlib.resources import files
from pathlib import Path

import pytest
from fastapi.testclient import TestClient

from service.app import create_app
from service.auth.network import Access
from service.dashboard import assets
from service.dashboard.assets import VIEWS

STATIC = Path(str(files("service.dashboard") / "static"))
MODULES = sorted(path.relative_to(STATIC).as_posix() for path in STATIC.rglob("*.js"))
PAGES = [re.sub("{[^}]*}", "1", view.path) for view in VIEWS]


@pytest.fixture(scope="module")
def client():
    # Nothing here asks for the archive.
    app = create_app(None, access=Access())
    with TestClient(app, base_url="http://127.0.0.1:8741") as client:
        yield client


def addresses(page):
    return re.findall(r'(?:src|href|data-plotly)="(/[^"]+)"', page)


@pytest.mark.parametrize("page", PAGES)
def test_a_page_names_only_files_that_are_served(client, page):
    found = addresses(client.get(page).text)
    assert len(found) >= 7
    for address in found:
        assert client.get(address).status_code == 200, address


def test_files_may_be_kept_for_ever_and_the_page_may_not(client):
    page = client.get("/")
    assert page.headers["cache-control"] == "no-cache"
    found = [address for address in addresses(page.text) if address.startswith("/static/")]
    assert len(found) >= 4
    for address in found:
        assert client.get(address).headers["cache-control"] == "public, max-age=31536000, immutable"


def test_plotly_is_the_installed_one_with_its_licence_and_travels_compressed(client):
    address = f"/static/{assets.plotly_name()}"
    answer = client.get(address, headers={"accept-encoding": "gzip"})
    assert answer.headers["content-encoding"] == "gzip"
    head = answer.text[:300]
    assert re.search(r"plotly\.js v4\.\d+\.\d+", head) and "Licensed under the MIT license" in head
    assert len(assets.plotly().zipped) < 1.6e6  # the budget of a page with plots


def test_a_client_without_gzip_gets_the_same_bytes_plain(client):
    address = f"/static/{assets.static_digest()}/views/campaign.js"
    plain = client.get(address, headers={"accept-encoding": "identity"})
    assert "content-encoding" not in plain.headers
    assert plain.content == gzip.decompress(assets.find(address.removeprefix("/static/")).zipped)


@pytest.mark.parametrize("path", ["page.js", "0000/page.js", "../pages.py", "plotly-0.min.js"])
def test_a_file_of_another_version_or_folder_is_not_found(client, path):
    assert client.get(f"/static/{path}").status_code == 404


@pytest.mark.parametrize("page", PAGES)
def test_a_page_carries_no_inline_script_and_no_foreign_address(client, page):
    page = client.get(page).text
    assert not re.search(r"<script(?![^>]*\bsrc=)", page) and not re.search(r"\son\w+=", page)
    assert "http://" not in page and "https://" not in page


@pytest.mark.parametrize("name", MODULES)
def test_modules_are_checked_by_type_and_make_no_markup_from_text(name):
    text = (STATIC / name).read_text(encoding="utf-8")
    # `make lint` checks all of them.
    assert not re.search("@ts-(ignore|nocheck|expect-error)", text)
    assert not re.search(
        r"innerHTML|outerHTML|insertAdjacentHTML|document\.write|\beval\b|new Function", text
    )
    assert "https://" not in text


def test_all_parts_but_plotly_stay_small():
    files = [path.read_bytes() for path in STATIC.rglob("*") if path.is_file()]
    weight = sum(len(gzip.compress(content)) for content in files)
    assert weight < 200_000  # the budget of a page without plots


@pytest.mark.parametrize("view", VIEWS, ids=lambda view: view.name)
def test_a_page_names_every_module_that_its_own_leads_to(view):
    """Those that the browser would find one behind the other, by the same imports."""
    found, pending = set(), [f"views/{view.name}.js"]
    while pending:
        module = pending.pop()
        found.add(module)
        text = assets.find(f"{assets.static_digest()}/{module}").plain.decode()
        lines = " ".join(line for line in text.splitlines() if not line.lstrip().startswith(("*", "/")))
        for path in re.findall(r'import [^"]*? from "([^"]+)"', lines):
            pending.append(posixpath.normpath(posixpath.join(posixpath.dirname(module), path)))
    assert set(assets.modules_of(f"views/{view.name}.js")) == found - {f"views/{view.name}.js"}


def test_a_page_with_plots_asks_for_them_at_once_and_one_without_never(client):
    preload = f'<link rel="preload" as="script" href="/static/{assets.plotly_name()}"'
    assert preload in client.get("/campaigns/1").text
    assert preload not in client.get("/campaigns/new").text
