"""A real browser, real archives served by the real application, and what must never happen in a page.

`make browser` runs everything here, and writes screenshots of every page in both themes and both widths to
`build/screens`; `make test` runs what is marked `short`: each page once, and what must never happen.
"""

import os
import re
import shutil
from contextlib import contextmanager
from pathlib import Path

import pytest
from playwright import sync_api

from service.auth.network import access_on
from service.coordinator import WebServer, open_port
from service.settings import Settings
from service.store.store import Store
from tests.acceptance import known

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
FLAGS = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]
#: A drawing in software takes seconds on a busy machine, the first flight of all a compilation [ms].
PATIENCE = 180_000
SCREENS = Path(__file__).parents[2] / "build" / "screens"


def pytest_collection_modifyitems(items):
    """Mark all tests here, and skip them where there is no browser, unless there must be one."""
    for item in items:
        if Path(item.fspath).parent == Path(__file__).parent:
            item.add_marker("browser")
            if CHROMIUM is None and "COASTARC_REQUIRE_BROWSER" not in os.environ:
                item.add_marker(pytest.mark.skip(reason="no Chromium on this machine"))


@pytest.fixture(scope="module")
def browser():
    # Not for longer: its event loop counts as running, and no other can be started in this thread.
    with sync_api.sync_playwright() as playwright:
        opened = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield opened
        opened.close()


@contextmanager
def serving(folder, port=0, access=None):
    store = Store(folder)
    access = access or access_on("127.0.0.1", Settings(), store.identities.has_token)
    server = WebServer(store, open_port("127.0.0.1", port), "127.0.0.1", access)
    server.start()
    try:
        yield store, server.url
    finally:
        server.stop()
        store.close()


@pytest.fixture
def served():
    """Return a context that serves a folder: its store and its address."""
    return serving


@pytest.fixture(scope="session")
def archive(tmp_path_factory):
    """The store and the address of a finished campaign, whose solutions are real ones of the preset."""
    with serving(tmp_path_factory.mktemp("archive")) as (store, url):
        known.submitted(store)
        work = known.dispatcher(store)
        while any(item.state != "done" for item in store.campaigns()):
            work.step()
        yield store, url


@pytest.fixture
def visit(browser):
    """Open an address; at the end nothing may have been complained about, nor asked of another origin."""
    complaints, contexts = [], []

    def visited(url, theme="dark", width=1280, is_ready=True):
        page = browser.new_context(viewport={"width": width, "height": 900}, color_scheme=theme).new_page()
        contexts.append(page.context)
        page.set_default_timeout(PATIENCE)
        origin = re.match(r"http://[^/]+", url).group()
        page.on("console", lambda message: message.type == "error" and complaints.append(message.text))
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.on("request", lambda r: r.url.startswith((origin, "data:", "blob:")) or complaints.append(r.url))
        page.goto(url)
        if is_ready:
            page.wait_for_selector("body[data-refreshed]")
        return page

    visited.complaints = complaints
    yield visited
    for context in contexts:
        context.close()
    assert complaints == []
