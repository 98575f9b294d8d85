"""What all pages share: navigation, signing in and out, the line to the coordinator, the policy."""

import re

import pytest

from service.auth.network import Access
from service.dashboard.assets import VIEWS
from service.schemas.identity import Role
from tests.acceptance import known


@pytest.mark.short
def test_without_a_campaign_the_first_page_says_how_to_start_one(visit, served, tmp_path):
    with served(tmp_path) as (_, url):
        page = visit(url)
        assert "coastarc run examples/quick.toml" in page.inner_text("#empty")
        page.wait_for_selector("#connection[data-connection=live]")
        assert page.get_attribute("nav a[aria-current]", "href") == "/"
        page.close()


def test_a_session_that_ends_leads_to_signing_in_and_back_and_one_can_sign_out(visit, served, tmp_path):
    with served(tmp_path, access=Access(is_open=False)) as (store, url):
        known.submitted(store)
        tokens = [store.identities.create(name, Role.VIEWER, 1.0).token for name in ("first", "second")]
        page = visit(f"{url}/workers?span=900", is_ready=False)
        for token in tokens:
            page.wait_for_url("**/sign-in?next=%2Fworkers%3Fspan%3D900")
            page.fill("#token", token)
            page.click("button[type=submit]")
            page.wait_for_selector("#connection[data-connection=live]")
            if token == tokens[0]:
                store.identities.revoke("first")
                store.control_campaign(1, "pause")  # an event, after which the page reads anew
        page.click("#sign-out")
        page.wait_for_url("**/sign-in")
        page.close()
    assert all("status of 401" in text for text in visit.complaints)
    visit.complaints.clear()


def test_a_stopped_coordinator_is_told_calmly_and_found_again(visit, served, tmp_path):
    with served(tmp_path) as (store, url):
        known.submitted(store)
        page = visit(f"{url}/campaigns/1")
        page.wait_for_selector("#connection[data-connection=live]")
    page.wait_for_selector("#notice:not([hidden])")
    assert "has stopped" in page.inner_text("#notice")
    # A refused connection is an error line of the browser's own; there must be no other.
    assert all("net::ERR_" in text for text in visit.complaints)
    with served(tmp_path, port=int(url.rpartition(":")[2])):
        page.wait_for_selector("#connection[data-connection=live]")
        assert page.is_hidden("#notice")
        page.close()
    visit.complaints.clear()


@pytest.mark.short
def test_the_browser_enforces_the_policy(archive, visit):
    page = visit(archive[1])
    policy = page.request.get(archive[1]).headers["content-security-policy"]
    assert "script-src 'self';" in policy and "unsafe-eval" not in policy
    blocked = page.evaluate(
        "() => { const s = document.createElement('script'); s.textContent = 'window.ran = 1';"
        " document.head.append(s); return window.ran === undefined }"
    )
    assert blocked
    assert all("Content Security Policy" in text for text in visit.complaints)
    visit.complaints.clear()


@pytest.mark.parametrize("theme", ["dark", "light"])
def test_colours_of_words_stand_out_from_what_is_behind_them(archive, visit, theme):
    page = visit(archive[1], theme=theme)
    assert page.evaluate("document.documentElement.dataset.theme") == theme
    for name in ("text", "muted", "accent", "good", "fair", "poor", "outage-text"):
        for behind in ("card", "page", "raised"):
            assert contrast(page, name, behind) >= 4.5, (name, behind)  # WCAG AA for text


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


@pytest.mark.parametrize("view", [view for view in VIEWS if "{" in view.path], ids=lambda view: view.name)
def test_a_page_about_nothing_says_so(visit, archive, view):
    path = re.sub("{[^}]*}", "999", view.path)
    page = visit(archive[1] + path, is_ready=False)
    page.wait_for_selector("#notice:not([hidden]), #empty:not([hidden])")
    page.close()
    visit.complaints.clear()
