"""The page of one search: its hops or its seeds, its laws, and how it is controlled."""

import re

import pytest
from sqlalchemy import update

from service.db.tables import CampaignRow
from service.spec import spec_from
from tests.browser import hopping
from tests.browser.conftest import SCREENS, serving
from tests.service.campaigns import spec_fields

WORST = "<img src=x onerror=alert(1)>"


@pytest.fixture(scope="module")
def hopped(tmp_path_factory):
    """The address of a finished campaign with chains that hop, and with seeds that were mapped."""
    with serving(tmp_path_factory.mktemp("hopped")) as (store, url):
        hopping.submitted(store)
        work = hopping.dispatcher(store)
        while any(item.state != "done" for item in store.campaigns()):
            work.step()
        yield url


@pytest.mark.short
def test_every_hop_of_every_chain_is_a_mark_that_leads_to_its_solution(hopped, visit):
    page = visit(f"{hopped}/campaigns/1/searches/adaptive")
    assert page.locator("[data-solve]").count() == 120
    assert page.locator("#hops svg rect[stroke]").count() > 10  # a fresh start is a square
    first = page.locator("a[data-solve]").first
    first.hover()
    told = page.inner_text("#hops .readout")
    assert re.search(r"Chain \d+, hop \d+, .*Δv [\d.]+\skm/s, violation .*\ss of CPU", told)
    href = first.get_attribute("href")
    first.click()
    page.wait_for_url(f"**{href}")


def test_marks_are_reached_with_the_arrow_keys(hopped, visit):
    page = visit(f"{hopped}/campaigns/1/searches/adaptive")
    page.locator("[data-solve]").first.focus()
    page.keyboard.press("ArrowRight")
    assert page.locator("#hops .readout").inner_text().startswith("Chain 1, hop 2")
    assert page.locator("[data-solve][tabindex='0']").count() == 1


def test_figures_show_violation_delta_v_step_size_and_time(hopped, visit):
    page = visit(f"{hopped}/campaigns/1/searches/adaptive")
    for name in ("violation", "delta-v", "reach", "time"):
        page.wait_for_selector(f"#{name}-plot[data-drawn]")
    assert "not finite" in page.inner_text("#violation figcaption")
    assert re.search(r"Median [\d.]+.s", page.inner_text("#time figcaption"))
    assert page.evaluate("document.getElementById('reach-plot').data.length") == 2
    laws = page.inner_text("#laws")
    assert "pareto" in laws and "yes, from" in laws and "after 4 consecutive rejected hops" in laws


def test_a_mark_of_a_figure_leads_to_its_solution(hopped, visit):
    page = visit(f"{hopped}/campaigns/1/searches/adaptive")
    page.wait_for_selector("#delta-v-plot[data-drawn]")
    marks = "document.getElementById('delta-v-plot').data.find(({ name }) => name.includes('strict'))"
    solution = page.evaluate(f"{marks}.customdata[0]")
    event = f"plot => plot.emit('plotly_click', {{points: [{{customdata: '{solution}'}}]}})"
    page.locator("#delta-v-plot").evaluate(event)
    page.wait_for_url(f"**/solutions/{solution}")


def test_a_law_that_does_not_adapt_shows_how_far_it_reaches(hopped, visit, served, tmp_path):
    with served(tmp_path) as (store, url):
        store.submit(spec_from(spec_fields()))
        page = visit(f"{url}/campaigns/1/searches/s0")
        page.wait_for_selector("#reach-plot[data-drawn]")
        assert "uniform law of this search; its width, 0.1" in page.inner_text("#reach figcaption")
        assert "No solve yet" in page.inner_text("#violation")
        page.close()
    page = visit(f"{hopped}/campaigns/1/searches/fresh")
    assert "does not hop" in page.inner_text("#reach")


def test_seeds_are_rows_with_what_each_gave(hopped, visit):
    page = visit(f"{hopped}/campaigns/1/searches/mapped")
    assert page.inner_text("#hops h2") == "Outcome of each seed"
    n_seeds = page.locator("#rows tbody tr").count()
    assert page.locator("[data-solve]").count() == 6 * n_seeds > 0
    page.wait_for_selector("#reach-plot[data-drawn]")
    assert "reference, continued" in page.inner_text("#laws")
    page.click("#rows tbody tr >> nth=0")
    page.wait_for_url("**/solutions/*")


def test_a_search_that_waits_for_seeds_says_for_which(visit, served, tmp_path):
    with served(tmp_path) as (store, url):
        hopping.submitted(store)
        page = visit(f"{url}/campaigns/1/searches/chosen")
        assert "Waiting for seeds" in page.inner_text("#empty")
        assert page.get_attribute("#empty a", "href") == "/campaigns/1/searches/adaptive"
        page.close()


def test_a_search_that_is_not_there_is_said_so(hopped, visit):
    page = visit(f"{hopped}/campaigns/1/searches/nobody")
    assert "search nobody of campaign 1" in page.inner_text("#empty")
    visit.complaints.clear()  # the browser's own words for a 404


def test_new_hops_appear_by_themselves_and_text_of_users_stays_text(visit, served, tmp_path):
    with served(tmp_path) as (store, url):
        hopping.submitted(store)
        # A specification is refused with such a name; an archive may hold it all the same.
        store._database.write(lambda session: session.execute(update(CampaignRow).values(name=WORST)))
        page = visit(f"{url}/campaigns/1/searches/adaptive")
        page.wait_for_selector("#connection[data-connection=live]")
        assert WORST in page.inner_text("#crumbs") and page.locator("img[src=x]").count() == 0
        (claim,) = store.claim("somebody", 1)
        store.complete(claim.ticket, hopping.run_hopping(claim.job))
        page.wait_for_selector("[data-solve] >> nth=11", state="attached", timeout=10_000)
        assert "12 of 120" in page.inner_text("#facts")
        page.close()


def test_a_search_is_paused_weighed_and_cancelled_after_a_question(visit, served, tmp_path):
    with served(tmp_path) as (store, url):
        hopping.submitted(store)
        page = visit(f"{url}/campaigns/1/searches/adaptive")

        def answered(button, verb):
            page.click(f"#actions >> text={button}")
            page.wait_for_selector("dialog[open]")
            if button.startswith("Weight"):
                page.fill("dialog input[name=weight]", "2.5")
            page.click(f"dialog button >> text={verb}")
            page.wait_for_selector("dialog", state="detached")

        answered("Pause", "Pause the search")
        page.wait_for_selector("#state[data-state=paused]")
        answered("Resume", "Resume the search")
        answered("Weight and priority", "Change the share")
        page.wait_for_selector("#facts >> text=2.5, 0")
        answered("Cancel", "Cancel the search")
        page.wait_for_selector("#state[data-state=cancelled]")
        assert page.locator("#actions button").count() == 0
        assert store.activity.search(1, "adaptive").weight == 2.5
        page.close()


@pytest.mark.parametrize("name", ["adaptive", "mapped"])
@pytest.mark.parametrize("theme", ["light", "dark"])
@pytest.mark.parametrize("width", [1280, 390])
def test_a_search_fits_the_screen(hopped, visit, name, theme, width):
    page = visit(f"{hopped}/campaigns/1/searches/{name}", theme, width)
    for figure in ("violation", "delta-v", "reach", "time"):
        page.wait_for_selector(f"#{figure}-plot[data-drawn]")
    SCREENS.mkdir(parents=True, exist_ok=True)
    page.screenshot(path=SCREENS / f"search-{name}-{theme}-{width}.png", full_page=True)
    assert page.evaluate("document.documentElement.scrollWidth") == width
