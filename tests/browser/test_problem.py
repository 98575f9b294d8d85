"""The page of a problem: what is solved, its outages, its matrix, its chances, and what was found."""

import re

import pytest

from service.schemas.solution import Filter
from tests.acceptance import known
from tests.browser.conftest import SCREENS


@pytest.fixture(scope="module")
def problems(archive):
    """The hashes of P_0 and of P_1, and the address of the service."""
    store, url = archive
    return *(store.all_records(Filter(search=name))[0].problem_hash for name in ("s0", "s1-0")), url


def drawn(page):
    page.wait_for_selector("#durations-plot[data-drawn]")
    return page


@pytest.mark.short
def test_it_says_in_words_and_numbers_what_is_solved(problems, visit):
    page = visit(f"{problems[2]}/problems/{problems[1]}")
    assert page.inner_text("#title") == "Problem with 1 outage"
    assert "segment 24, 1.0\u00a0d" in page.inner_text("#facts")
    assert re.search(r"Variables\s+23\d\s+Defects\s+14", page.inner_text("#facts"))
    assert "3.000\u00a0N" in page.inner_text("#spacecraft") and "2026-04-26 14:47" in page.inner_text(
        "#departure"
    )
    assert "0.0 to 30.0\u00a0d" in page.inner_text("#bounds") and "NRHO" in page.inner_text("#target")


def test_outages_stand_over_the_segments_and_in_the_matrix(problems, visit):
    page = visit(f"{problems[2]}/problems/{problems[1]}")
    assert page.locator("#outages g[data-trajectory]").count() == 2
    told = page.locator("#outages g[data-trajectory='1'] title").text_content()
    assert "start of segment 24" in told and "branches off the forward leg" in told and "26 segments" in told
    assert page.locator("#sparsity path").count() == 2
    assert int(page.get_attribute("#sparsity-plot", "data-runs")) > 50
    assert "14 rows" in page.inner_text("#sparsity figcaption")


def test_chances_are_read_at_the_best_solution_with_their_assumptions(problems, visit):
    page = drawn(visit(f"{problems[2]}/problems/{problems[1]}"))
    words = page.inner_text("#counts figcaption")
    assert "Weibull" in words and re.search(r"probability of an outage until then is \d+\u202f%", words)
    # method.md, section 13: F(1 d) = 1 - exp(-(1/2.459)^1.144) = 0.30.
    assert "30\u202f% of outages last at most 1.0\u00a0d" in page.inner_text("#durations figcaption")
    assert page.evaluate("document.getElementById('counts-plot').data.length") == 3


def test_best_solutions_and_relatives_are_one_press_away(problems, archive, visit):
    page = visit(f"{problems[2]}/problems/{problems[0]}")
    page.wait_for_selector("#best tr[data-id]")
    best = archive[0].all_records(Filter(search="s0"))[0].id
    assert page.locator("#best tr[data-id]").first.get_attribute("data-id") == best
    assert page.get_attribute("#all", "href") == f"/archive?problem={problems[0]}"
    assert "no outage to survive" in page.inner_text("#goal")
    page.click("#more tr[data-id] a")
    page.wait_for_url(f"**/problems/{problems[1]}")
    page.wait_for_selector("#fewer tr[data-id]")


def test_without_a_solution_it_says_what_to_do_and_shows_the_first_by_itself(visit, served, tmp_path):
    with served(tmp_path) as (store, url):
        known.submitted(store)
        first = next(item for item in store.problems().items if item.k == 0)
        page = drawn(visit(f"{url}/problems/{first.hash}"))
        assert "No solution of this problem yet" in page.inner_text("#best-none")
        assert "no solution yet" in page.inner_text("#counts figcaption")
        page.wait_for_selector("#connection[data-connection=live]")
        work = known.dispatcher(store)
        while not store.all_records(Filter(search="s0")):
            work.step()
        page.wait_for_selector("#best tr[data-id]", timeout=10_000)
        assert page.is_hidden("#best-none")
        page.close()


def test_an_unknown_problem_is_told_and_its_name_is_only_text(archive, visit):
    name = "<img src=x onerror=alert(1)>"
    page = visit(f"{archive[1]}/problems/{name}")
    assert "No such problem" in page.inner_text("#empty") and name in page.inner_text("#empty")
    assert page.locator("#empty img").count() == 0
    visit.complaints[:] = [text for text in visit.complaints if "status of 4" not in text]


@pytest.mark.parametrize("theme", ["dark", "light"])
@pytest.mark.parametrize("width", [1280, 390])
def test_the_page_fits(problems, visit, theme, width):
    page = drawn(visit(f"{problems[2]}/problems/{problems[1]}", theme=theme, width=width))
    assert page.evaluate("document.documentElement.scrollWidth") == width
    SCREENS.mkdir(parents=True, exist_ok=True)
    page.screenshot(path=SCREENS / f"problem-{theme}-{width}.png", full_page=True)
