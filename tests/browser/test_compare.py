"""The comparison of solutions: numbers, pictures over each other, and an address that names all of it."""

import pytest

from service.schemas.solution import Filter
from service.store.filters import Order
from tests.browser.conftest import SCREENS


@pytest.fixture(scope="module")
def sides(archive):
    """The address of a comparison of two solutions, which have no and one outage, and their records."""
    store, url = archive
    found = [
        store.all_records(Filter(search=name), order=Order("delta_v_km_s"))[0] for name in ("s0", "s1-0")
    ]
    return f"{url}/compare?ids={','.join(record.id for record in found)}", found


def flown(page):
    page.wait_for_selector("#profiles-plot[data-sides]")
    return page


def columns(page):
    return page.locator("#numbers th[data-side]").evaluate_all("all => all.map(one => one.dataset.side)")


def names(page, plot):
    return page.evaluate(f"[...new Set(document.getElementById('{plot}').data.map(t => t.name))]")


@pytest.mark.short
def test_numbers_stand_side_by_side_and_the_best_is_marked(sides, visit):
    address, found = sides
    page = visit(address)
    assert columns(page) == [record.id for record in found]
    row = page.locator("#numbers tr:has(th:has-text('Δv of the transfer'))")
    best = min(found, key=lambda record: record.delta_v_km_s)
    assert row.locator("td.best").inner_text() == f"{best.delta_v_km_s:.4f} ★"
    assert "segment 24, 1.0\u00a0d" in page.inner_text("#numbers tr:has(th:text-is('Outages'))")


def test_trajectories_and_profiles_lie_over_each_other(sides, visit):
    address, found = sides
    page = flown(visit(address))
    titles = [f"{letter} {r.strategy} {r.id[:8]}" for letter, r in zip("AB", found, strict=True)]
    assert {"Earth", "Moon", "Target orbit", *titles} <= set(names(page, "overlay-plot"))
    assert names(page, "profiles-plot") == titles
    assert page.evaluate("document.getElementById('profiles-plot').layout.shapes.length") == 1
    n = page.evaluate(
        "document.getElementById('overlay-plot').data.reduce((n, t) => n + t.x.flat().length, 0)"
    )
    assert n <= 6000  # 5,000 of trajectories, and the bodies


def test_frame_and_realizations_stand_in_the_address(sides, visit):
    page = flown(visit(f"{sides[0]}&frame=inertial"))
    assert page.get_attribute("#overlay-plot", "data-frame") == "inertial"
    page.focus("[role=tab][aria-selected=true]")
    page.keyboard.press("ArrowRight")
    page.wait_for_selector("#overlay-plot[data-frame=moon]")
    page.check("#realizations")
    page.wait_for_selector("#overlay-plot[data-realizations=true]")
    assert "frame=moon" in page.url and "realizations=true" in page.url
    assert any("realization 1" in name for name in names(page, "overlay-plot"))


def test_solutions_are_removed_and_added(sides, visit):
    address, found = sides
    page = visit(address)
    page.click("#numbers th[data-side] button >> nth=0")
    page.wait_for_selector("#title:has-text('Comparison of 1')")
    assert columns(page) == [found[1].id]
    page.fill("#another", "nonsense")
    page.press("#another", "Enter")
    page.wait_for_selector("#refused:has-text('expected its id of 32 digits')")
    page.fill("#another", f"http://elsewhere/solutions/{found[0].id}")
    page.press("#another", "Enter")
    page.wait_for_selector("#title:has-text('Comparison of 2')")
    assert columns(page) == [found[1].id, found[0].id] and page.is_hidden("#refused")
    flown(page)


def test_without_solutions_it_says_where_to_choose(archive, visit):
    page = visit(f"{archive[1]}/compare")
    assert "Choose two to four solutions" in page.inner_text("#empty")
    assert page.get_attribute("#empty a", "href") == "/archive"


def test_an_unknown_solution_is_told(sides, visit):
    page = visit(f"{sides[0]},{'0' * 32}")
    assert "1 of the solutions in the address" in page.inner_text("#refused")
    assert len(columns(page)) == 2
    # The browser itself complains about the answer 404.
    assert all("404" in text for text in visit.complaints)
    visit.complaints.clear()


@pytest.mark.parametrize("theme", ["dark", "light"])
@pytest.mark.parametrize("width", [1280, 390])
def test_it_fits(sides, visit, theme, width):
    page = flown(visit(f"{sides[0]}&realizations=true", theme, width))
    assert page.evaluate("document.documentElement.scrollWidth") == width
    SCREENS.mkdir(parents=True, exist_ok=True)
    page.screenshot(path=SCREENS / f"compare-{theme}-{width}.png", full_page=True)
