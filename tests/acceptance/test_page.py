"""The live page in a real browser, on a real archive served by the real application.

Screenshots of every theme and width go to the test's temporary folder; `pytest -s` says where.
"""

import os
import re
import shutil
import time
from contextlib import contextmanager

import pytest
from playwright import sync_api

from service.coordinator import WebServer, open_port
from service.rights import Role
from service.security import Access, access_on
from service.settings import Settings
from service.store import Store
from tests.acceptance import known

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
pytestmark = [
    pytest.mark.browser,
    pytest.mark.skipif(
        CHROMIUM is None and "COASTARC_REQUIRE_BROWSER" not in os.environ,
        reason="no Chromium on this machine",
    ),
]
FLAGS = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]
THEMES, WIDTHS = ("dark", "light"), (1280, 390)
#: A drawing in software takes seconds on a busy machine [ms].
PATIENCE = 60_000


@pytest.fixture(scope="module")
def browser():
    with sync_api.sync_playwright() as playwright:
        opened = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield opened
        opened.close()


@contextmanager
def served(folder, port=0, access=None):
    store = Store(folder)
    access = access or access_on("127.0.0.1", Settings(), store.identities.has_token)
    server = WebServer(store, open_port("127.0.0.1", port), "127.0.0.1", access)
    server.start()
    try:
        yield store, server.url
    finally:
        server.stop()
        store.close()


@pytest.fixture(scope="module")
def archive(tmp_path_factory):
    """The address of a finished campaign."""
    with served(tmp_path_factory.mktemp("archive")) as (store, url):
        known.submitted(store)
        work = known.dispatcher(store)
        while any(item.state != "done" for item in store.campaigns()):
            work.step()
        yield url


@pytest.fixture(scope="module")
def page(browser, archive):
    """The page of the finished campaign, for tests that only read it."""
    complaints = []
    yield opened(browser, archive, complaints)
    assert complaints == []


@pytest.fixture
def visit(browser):
    """Open an address; at the end nothing may have been complained about, nor asked of another origin."""
    complaints, contexts = [], []

    def visited(url, **how):
        page = opened(browser, url, complaints, **how)
        contexts.append(page.context)
        return page

    visited.complaints = complaints
    yield visited
    for context in contexts:
        context.close()
    assert complaints == []


def opened(browser, url, complaints, theme="dark", width=1280, drawn=True):
    page = browser.new_context(viewport={"width": width, "height": 900}, color_scheme=theme).new_page()
    origin = re.match(r"http://[^/]+", url).group()
    page.on("console", lambda message: message.type == "error" and complaints.append(message.text))
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.on("request", lambda r: r.url.startswith((origin, "data:", "blob:")) or complaints.append(r.url))
    page.goto(url)
    if drawn:
        page.wait_for_selector("#profile[data-drawn]", timeout=PATIENCE)
    return page


def traces(page, place):
    return page.evaluate(f"document.getElementById('{place}').data.map(t => [t.name, t.x.length])")


def chosen(page):
    return page.get_attribute("tr[aria-selected=true]", "data-id")


def test_searches_say_how_far_they_are_and_what_they_found(page):
    assert page.inner_text("#campaign-name") == "known solutions"
    assert page.inner_text("#campaign-state") == "done"
    card = page.inner_text("[data-search=s0]")
    assert "5 of 5 guesses" in card and "2 feasible, strict" in card and "3 infeasible" in card
    assert "40\u202f%" in card and "12\u202f% to 77\u202f%" in card  # Wilson's interval of 2 in 5
    assert re.search(r"Best Δv\s+0\.\d{4}\u00a0km/s", card)
    assert "segment 24, 1.0\u00a0d" in page.inner_text("[data-search=s1-0]")
    # Chains of one solve do not hop.
    assert "Guesses drawn at random; no outage to survive." in card


def test_the_best_robust_solution_is_drawn_unasked(page):
    assert "S(1|0)" in page.inner_text("#chosen-what")
    drawn = dict(traces(page, "trajectory"))
    assert {"Earth", "Moon", "Target orbit", "reference, thrust", "realization 1, outage"} <= set(drawn)
    assert drawn["reference, thrust"] > 50 and drawn["realization 1, outage"] > 2
    assert [name for name, _ in traces(page, "profile")] == ["reference"] * 2 + ["realization 1"] * 2
    assert page.evaluate("document.getElementById('profile').layout.shapes.length") == 1
    assert page.locator(".defects td[data-within=strict]").count() == 6
    assert "0.1" in page.inner_text(".defects") and "km/s" in page.inner_text(".defects")


def test_a_frame_has_its_own_address(archive, visit):
    page = visit(f"{archive}/?frame=inertial")
    assert page.get_attribute("#trajectory", "data-frame") == "inertial"
    assert page.get_attribute("[data-frame=inertial][role=tab]", "aria-selected") == "true"
    page.click("[data-frame=moon][role=tab]")
    page.wait_for_selector("#trajectory[data-frame=moon]")
    assert "frame=moon" in page.url


def test_arrow_keys_choose_a_solution_and_the_address_keeps_it(archive, visit):
    page = visit(archive)
    first = chosen(page)
    page.focus("tr[aria-selected=true]")
    page.keyboard.press("ArrowDown")
    page.wait_for_selector(f"#chosen:not([data-solution='{first}'])", timeout=PATIENCE)
    second = chosen(page)
    assert second != first and f"solution={second}" in page.url
    page.reload()
    page.wait_for_selector(f"#chosen[data-solution='{second}']", timeout=PATIENCE)
    assert chosen(page) == second


def test_the_table_sorts_by_the_column_pressed(archive, visit):
    page = visit(archive, drawn=False)
    page.click("th:has-text('Propellant') button")
    page.click("th:has-text('Propellant') button")
    texts = page.locator("tbody tr[data-id] td:nth-child(3)").all_inner_texts()
    values = [float(text) for text in texts]
    assert len(values) >= 3 and values == sorted(values, reverse=True)
    assert page.get_attribute("th:has-text('Propellant')", "aria-sort") == "descending"


def test_a_seed_is_one_press_away(archive, visit):
    page = visit(archive)
    page.click("#record button.link")
    page.wait_for_selector("#legend:not(:has-text('outage'))", timeout=PATIENCE)
    assert page.inner_text("#chosen-what") == "S(0), no outage"


@pytest.mark.parametrize("theme", THEMES)
@pytest.mark.parametrize("width", WIDTHS)
def test_the_page_fits_and_is_readable(archive, visit, tmp_path, theme, width):
    page = visit(archive, theme=theme, width=width)
    assert page.evaluate("document.documentElement.scrollWidth") == width
    assert page.evaluate("document.documentElement.dataset.theme") == theme
    for name in ("text", "muted", "accent", "good", "fair", "poor", "outage-text"):
        assert contrast(page, name, "card") >= 4.5, name  # WCAG AA for text
    page.screenshot(path=tmp_path / f"{theme}-{width}.png", full_page=True)


def contrast(page, name, behind):
    """Return the WCAG contrast ratio of two colours of the style sheet."""
    style = "getComputedStyle(document.documentElement)"
    found = [page.evaluate(f"{style}.getPropertyValue('--{each}')").strip() for each in (name, behind)]
    light = sorted(luminance(colour) for colour in found)
    return (light[1] + 0.05) / (light[0] + 0.05)


def luminance(colour):
    levels = [int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    linear = [level / 12.92 if level <= 0.04045 else ((level + 0.055) / 1.055) ** 2.4 for level in levels]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def test_results_appear_while_the_page_is_open(visit, tmp_path):
    with served(tmp_path) as (store, url):
        known.submitted(store)
        page = visit(url, drawn=False)
        page.wait_for_selector("[data-search=s0][data-solves='0']")
        page.wait_for_selector("#solutions:has-text('No solution yet')")
        work = known.dispatcher(store)
        for _ in range(4):
            work.step()
        began = time.monotonic()
        page.wait_for_selector("tr[data-id]", timeout=PATIENCE)
        assert time.monotonic() - began < 2.0  # a poll of 0.5 s, at most a redraw a second, and the requests
        page.wait_for_selector("#profile[data-drawn]", timeout=PATIENCE)
        page.close()


def test_a_stopped_coordinator_is_told_calmly_and_found_again(visit, tmp_path):
    with served(tmp_path) as (store, url):
        known.submitted(store)
        page = visit(url, drawn=False)
        page.wait_for_selector("#connection[data-connection=live]")
    page.wait_for_selector("#notice:not([hidden])", timeout=PATIENCE)
    assert "has stopped" in page.inner_text("#notice")
    # A refused connection is an error line of the browser's own; there must be no other.
    assert all("net::ERR_" in text for text in visit.complaints)
    with served(tmp_path, port=int(url.rpartition(":")[2])):
        page.wait_for_selector("#connection[data-connection=live]", timeout=PATIENCE)
        assert page.is_hidden("#notice")
        page.close()
    visit.complaints.clear()


def test_without_a_campaign_the_page_says_how_to_start_one(visit, tmp_path):
    with served(tmp_path) as (_, url):
        page = visit(url, drawn=False)
        page.wait_for_selector("#welcome:not([hidden])")
        assert "coastarc run examples/quick.toml" in page.inner_text("#welcome")
        page.close()


def test_a_session_that_ends_leads_to_signing_in_and_back_and_one_can_sign_out(visit, tmp_path):
    with served(tmp_path, access=Access(is_open=False)) as (store, url):
        known.submitted(store)
        tokens = [store.identities.create(name, Role.VIEWER, 1.0).token for name in ("first", "second")]
        page = visit(f"{url}/?campaign=1", drawn=False)
        for token in tokens:
            page.wait_for_url("**/sign-in?next=%2F%3Fcampaign%3D1", timeout=PATIENCE)
            page.fill("#token", token)
            page.click("button[type=submit]")
            page.wait_for_selector("#connection[data-connection=live]", timeout=PATIENCE)
            assert page.url == f"{url}/?campaign=1"
            if token == tokens[0]:
                store.identities.revoke("first")
                store.control_campaign(1, "pause")  # an event, after which the page reads anew
        page.click("#sign-out")
        page.wait_for_url("**/sign-in", timeout=PATIENCE)
        page.close()
    assert all("status of 401" in text for text in visit.complaints)
    visit.complaints.clear()


def test_markup_in_a_name_is_shown_as_text(archive, visit):
    page = visit(archive, drawn=False)
    name = "<img src=x onerror=alert(1)>"
    page.route("**/api/v1/campaigns/1", lambda route: renamed(route, name))
    page.reload()
    page.wait_for_selector("#campaign-name:has-text('onerror')")
    assert page.inner_text("#campaign-name") == name
    assert page.locator("#campaign-name img").count() == 0


def renamed(route, name):
    answer = route.fetch()
    route.fulfill(response=answer, json=answer.json() | {"name": name})


def test_the_browser_enforces_the_policy(archive, visit):
    page = visit(archive, drawn=False)
    answer = page.request.get(archive)
    policy = answer.headers["content-security-policy"]
    assert "script-src 'self';" in policy and "unsafe-eval" not in policy
    blocked = page.evaluate(
        "() => { const s = document.createElement('script'); s.textContent = 'window.ran = 1';"
        " document.head.append(s); return window.ran === undefined }"
    )
    assert blocked
    assert all("Content Security Policy" in text for text in visit.complaints)
    visit.complaints.clear()
