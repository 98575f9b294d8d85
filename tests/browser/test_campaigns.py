"""The pages of campaigns: the list, a new one, and one that is watched and controlled."""

import re

import pytest

from service.spec import spec_from
from tests.acceptance import known
from tests.browser.conftest import PATIENCE, SCREENS
from tests.service.campaigns import finish, spec_fields
from tests.workers.fake import run_broken
from workers.executor import Inline

NAME = "<img src=x onerror=alert(1)>"
FIGURES = ("best-so-far", "outcome-mix", "feasibility", "delta-v")


def drawn(page):
    for name in FIGURES:
        page.wait_for_selector(f"#{name}-plot[data-drawn]")


def traces(page, name):
    return page.evaluate(f"document.getElementById('{name}-plot').data.map(t => t.name)")


def renamed(route, change):
    answer = route.fetch()
    route.fulfill(response=answer, json=change(answer.json()))


# The list.


def test_the_list_says_how_far_a_campaign_is_and_what_it_found(archive, visit):
    page = visit(archive[1])
    row = page.inner_text("[data-campaign='1']")
    assert "known solutions" in row and "done" in row and "S(0), S(1|0)" in row
    assert "7 of 7 guesses" in row and "4 feasible, strict" in row and "3 infeasible" in row
    assert re.search(r"Best Δv 0\.\d{4}\u00a0km/s", row) and page.locator(".sparkline path").count() == 2
    page.keyboard.press("Tab")
    page.click("[data-campaign='1'] h2 a")
    page.wait_for_selector("[data-search=s0]")


@pytest.mark.short
def test_the_list_follows_a_campaign_that_begins_and_goes_on(visit, served, tmp_path):
    with served(tmp_path) as (store, url):
        page = visit(url)
        page.wait_for_selector("#connection[data-connection=live]")
        known.submitted(store)
        page.wait_for_selector("[data-campaign='1'][data-solves='0']")
        work = known.dispatcher(store)
        for _ in range(4):
            work.step()
        page.wait_for_selector("[data-campaign='1']:not([data-solves='0'])")
        page.close()


@pytest.mark.short
def test_markup_in_a_name_is_shown_as_text_in_the_list(archive, visit):
    page = visit(archive[1])
    page.route(
        "**/api/v1/campaigns", lambda r: renamed(r, lambda a: {"items": [a["items"][0] | {"name": NAME}]})
    )
    page.reload()
    page.wait_for_selector("h2:has-text('onerror')")
    assert page.locator(".campaigns img").count() == 0


# One campaign.


def test_searches_say_how_far_they_are_and_what_they_found(archive, visit):
    page = visit(f"{archive[1]}/campaigns/1")
    assert page.inner_text("#title") == "known solutions" and page.inner_text("#state") == "done"
    assert page.title() == "known solutions · coastarc"
    row = page.inner_text("[data-search=s0]")
    assert "5 of 5 guesses" in row and "no outage" in row
    assert "40\u202f%" in row and "12\u202f% to 77\u202f%" in row  # Wilson's interval of 2 in 5
    assert re.search(r"0\.\d{4}\u00a0km/s", row)
    assert "segment 24, 1.0\u00a0d" in page.inner_text("[data-search='s1-0']")
    assert page.get_attribute("[data-search='s1-0'] th a", "href") == "/campaigns/1/searches/s1-0"
    # What has ended cannot be controlled.
    assert page.locator("#actions button").count() == 0


def test_figures_show_each_strategy_and_outcome(archive, visit):
    page = visit(f"{archive[1]}/campaigns/1")
    drawn(page)
    assert traces(page, "best-so-far") == traces(page, "delta-v") == ["S(0)", "S(1|0)"]
    assert traces(page, "outcome-mix") == ["feasible, strict", "infeasible"]
    assert page.evaluate("document.getElementById('best-so-far-plot').data[0].line.shape") == "hv"
    assert page.evaluate("document.getElementById('feasibility-plot').data[0].error_x.array.length") == 2


def test_the_matrix_says_what_seeds_gave_and_cost(archive, visit):
    page = visit(f"{archive[1]}/campaigns/1")
    cell = page.inner_text("[data-chain='0-1']")
    assert "100\u202f%" in cell and "2 seeds, 2 solves" in cell and "21.5\u00a0core-s per solution" in cell
    assert page.locator(".chains th[scope=row]").all_inner_texts() == ["drawn", "seeds of k′ = 0"]


def test_a_new_result_appears_by_itself(visit, served, tmp_path):
    with served(tmp_path) as (store, url):
        known.submitted(store)
        page = visit(f"{url}/campaigns/1")
        assert "waiting for seeds from s0" in page.inner_text("[data-search='s1-0']")
        assert "No guess has been solved yet" in page.inner_text("#outcome-mix")
        page.wait_for_selector("#connection[data-connection=live]")
        work = known.dispatcher(store)
        work.step()
        page.wait_for_selector("[data-search=s0]:not([data-solves='0'])")
        page.close()


def test_pause_weight_and_cancel_are_asked_about_and_done(visit, served, tmp_path):
    with served(tmp_path) as (store, url):
        known.submitted(store)
        page = visit(f"{url}/campaigns/1")
        page.click("[data-does=pause]")
        page.keyboard.press("Escape")
        page.wait_for_selector("dialog", state="detached")
        assert store.campaign_state(1) == "active"
        for does, state in (("pause", "paused"), ("resume", "active")):
            page.click(f"[data-does={does}]")
            page.click("dialog button[type=submit]")
            page.wait_for_selector(f"#state[data-state={state}]")
            assert store.campaign_state(1) == state
        page.click("[data-weight-of=s0]")
        page.fill("#new-weight", "2.5")
        page.keyboard.press("Enter")
        page.wait_for_selector("[data-weight-of=s0]:has-text('2.5')")
        assert store.campaign(1).searches[0].weight == 2.5
        page.click("[data-does=cancel]")
        page.click("dialog button.danger")
        page.wait_for_selector("#state[data-state=cancelled]")
        page.close()


def test_dead_jobs_are_listed_with_their_errors_and_requeued(visit, served, tmp_path):
    with served(tmp_path) as (store, url):
        store.submit(spec_from(spec_fields(guesses=2)))
        finish(store, Inline(run_broken))
        page = visit(f"{url}/campaigns/1")
        assert "ZeroDivisionError: oh" in page.inner_text("#dead")
        page.click("#dead button")
        page.click("dialog button[type=submit]")
        page.wait_for_selector("#jobs a[href*='state=queued']:has-text('1')")
        page.close()


def test_a_campaign_that_does_not_exist_is_said_to_be_none(archive, visit):
    page = visit(f"{archive[1]}/campaigns/99")
    assert "got none" in page.inner_text("#empty") and page.locator("#empty a").count() == 1
    visit.complaints.clear()  # the browser's own line about the 404


def test_markup_in_the_name_of_a_campaign_is_shown_as_text(archive, visit):
    page = visit(f"{archive[1]}/campaigns/1")
    page.route("**/api/v1/campaigns/1", lambda r: renamed(r, lambda a: a | {"name": NAME}))
    page.reload()
    page.wait_for_selector("#title:has-text('onerror')")
    assert page.inner_text("#title") == NAME and page.locator("#main img").count() == 0


# A new one.


@pytest.mark.short
def test_a_template_is_checked_planned_and_submitted(visit, served, tmp_path):
    with served(tmp_path) as (store, url):
        page = visit(f"{url}/campaigns/new")
        page.wait_for_selector("#form[data-faults='0']")
        assert "90" in page.inner_text("#said") and "S(3|0)" in page.inner_text("#said")
        page.click("#submit")
        page.wait_for_selector("[data-search='s3-0']")
        assert page.url.endswith("/campaigns/1") and store.campaign(1).name == "quick"
        page.close()


def test_what_is_wrong_is_said_beside_its_line_while_one_types(archive, visit):
    page = visit(f"{archive[1]}/campaigns/new")
    page.wait_for_selector("#form[data-faults='0']")
    text = page.input_value("#spec")
    line = next(n for n, one in enumerate(text.splitlines(), start=1) if one == "guesses = 30")
    page.fill("#spec", text.replace("guesses = 30", f"guesses = -3 # {NAME}"))
    page.wait_for_selector(f"#marks [data-line='{line}']:has-text('at least 1, got -3')")
    assert page.is_disabled("#submit") and "search.0.guesses" in page.inner_text(".faults")
    page.click(f".faults button:has-text('line {line}')")
    assert page.evaluate("document.activeElement.id") == "spec"
    assert page.inner_text("#gutter .wrong") == str(line) and page.locator("#main img").count() == 0


def test_an_uploaded_file_takes_the_place_of_the_text(archive, visit):
    page = visit(f"{archive[1]}/campaigns/new")
    page.wait_for_selector("#form[data-faults='0']")
    file = {"name": "own.toml", "mimeType": "application/toml", "buffer": b'[campaign]\nname = "own"\n'}
    page.set_input_files("#file", [file])
    page.wait_for_selector("#form[data-faults='3']")
    assert page.input_value("#spec").startswith("[campaign]") and "rng_seed" in page.inner_text(".faults")


def test_a_clone_begins_with_the_specification_of_a_campaign(archive, visit):
    page = visit(f"{archive[1]}/campaigns/new?clone=1")
    page.wait_for_selector("#form[data-faults='0']")
    text = page.input_value("#spec")
    assert 'name = "known solutions 2"' in text and 'preset = "ppe-drm3"' in text
    assert page.inner_text("#template option:checked") == "campaign 1"


def test_the_editor_is_left_by_the_keyboard(archive, visit):
    page = visit(f"{archive[1]}/campaigns/new")
    page.focus("#spec")
    page.keyboard.press("Escape")
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.id") != "spec"


@pytest.mark.parametrize("theme", ["dark", "light"])
@pytest.mark.parametrize("width", [1280, 390])
@pytest.mark.parametrize("name", ["campaigns", "campaign", "submit"])
def test_the_pages_of_campaigns_fit(archive, visit, name, width, theme):
    path = {"campaigns": "/", "campaign": "/campaigns/1", "submit": "/campaigns/new"}[name]
    page = visit(archive[1] + path, theme=theme, width=width)
    if name == "campaign":
        drawn(page)
    if name == "submit":
        page.wait_for_selector("#form[data-faults='0']", timeout=PATIENCE)
    assert page.evaluate("document.documentElement.scrollWidth") == width
    SCREENS.mkdir(parents=True, exist_ok=True)
    page.screenshot(path=SCREENS / f"{name}-{theme}-{width}.png", full_page=True)
