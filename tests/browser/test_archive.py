"""The archive: its filters in the address, its pictures, its table and what is chosen for comparison."""

import pytest

from service.schemas.solution import Filter
from service.store.filters import Order
from tests.acceptance import known
from tests.browser.conftest import SCREENS


def drawn(page):
    page.wait_for_selector("#scatter-plot[data-points]")
    return page


def ids(page):
    return page.locator("#solutions tr[data-id]").evaluate_all("rows => rows.map(row => row.dataset.id)")


@pytest.mark.short
def test_it_shows_all_solutions_the_least_delta_v_first(archive, visit):
    store, url = archive
    found = store.all_records(Filter(), order=Order("delta_v_km_s"))
    page = drawn(visit(f"{url}/archive"))
    assert ids(page) == [record.id for record in found]
    assert page.inner_text("#count") == f"{len(found)} solutions"
    assert page.get_attribute("#scatter-plot", "data-points") == str(len(found))
    names = page.evaluate("document.getElementById('scatter-plot').data.map(t => t.name)")
    assert names == ["S(0)", "S(1|0)", "Pareto front"]
    assert page.locator("#parallel-plot path[data-strategy]").count() == 2
    assert page.locator("#parallel-plot [data-axis]").count() == 8
    assert f"{found[0].delta_v_km_s:.4f}\u00a0km/s" in page.inner_text("#facts")


def test_a_filter_stands_in_the_address_and_holds_for_all(archive, visit):
    store, url = archive
    page = drawn(visit(f"{url}/archive"))
    page.select_option("select[name=strategy]", "S(1|0)")
    page.wait_for_selector("#clear:not([hidden])")
    assert "strategy=S%281%7C0%29" in page.url
    wanted = {record.id for record in store.all_records(Filter(strategy="S(1|0)"))}
    page.wait_for_selector(f"#scatter-plot[data-points='{len(wanted)}']")
    assert set(ids(page)) == wanted
    for kind in ("csv", "ndjson"):
        text = page.request.get(url + page.get_attribute(f"#export-{kind}", "href")).text()
        assert all(key in text for key in wanted) and text.count("S(0)") == 0
    page.go_back()
    page.wait_for_selector("#clear", state="hidden")
    assert len(ids(page)) > len(wanted)


def test_a_brush_restricts_table_and_pictures_and_a_field_does_the_same(archive, visit):
    store, url = archive
    page = drawn(visit(f"{url}/archive"))
    n = len(ids(page))
    axis = page.locator("#parallel-plot [data-axis=delta_v_km_s] .reach")
    axis.scroll_into_view_if_needed()
    box = axis.bounding_box()
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] - 1)
    page.mouse.down()
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] * 0.95, steps=3)
    page.mouse.up()
    page.wait_for_selector("#clear:not([hidden])")
    bounds = [page.input_value(f"input[name={end}_delta_v_km_s]") for end in ("min", "max")]
    wanted = Filter(min_delta_v_km_s=bounds[0], max_delta_v_km_s=bounds[1])
    left = {record.id for record in store.all_records(wanted)}
    assert set(ids(page)) == left and 0 < len(left) < n
    assert page.get_attribute("#parallel-plot", "data-chosen") == str(len(left))
    page.fill("input[name=max_delta_v_km_s]", "99")
    page.fill("input[name=min_delta_v_km_s]", "")
    page.press("input[name=min_delta_v_km_s]", "Tab")
    page.wait_for_selector(f"#parallel-plot[data-chosen='{n}']")


@pytest.mark.parametrize("filtered", ["", "min_time_of_flight_days=104"])
def test_the_front_is_that_of_the_service(archive, visit, filtered):
    _, url = archive
    page = drawn(visit(f"{url}/archive?{filtered}"))
    points = page.request.get(f"{url}/api/v1/solutions/points?{filtered}").json()
    line = page.evaluate("document.getElementById('scatter-plot').data.at(-1)")
    assert line["name"] == "Pareto front" and points["front"]
    assert line["y"] == [points["delta_v_km_s"][i] for i in points["front"]]
    assert line["x"] == [points["time_of_flight_days"][i] for i in points["front"]]


def test_columns_sort_and_a_value_begins_a_page(archive, visit):
    store, url = archive
    page = drawn(visit(f"{url}/archive"))
    page.click("#solutions th:has-text('Flight') button")
    page.wait_for_selector("#solutions th[aria-sort=ascending]:has-text('Flight')")
    found = store.all_records(Filter(), order=Order("time_of_flight_days"))
    assert ids(page) == [record.id for record in found] and "sort=time_of_flight_days" in page.url
    page.fill("#begin", f"{found[1].time_of_flight_days + 1e-6}")
    page.press("#begin", "Enter")
    page.wait_for_selector("#table-card[data-page=further]")
    assert ids(page) == [record.id for record in found[2:]]
    page.click("#first")
    page.wait_for_selector("#table-card[data-page=first]")
    assert len(ids(page)) == len(found)


def test_a_point_and_a_row_lead_to_the_solution(archive, visit):
    _, url = archive
    page = drawn(visit(f"{url}/archive"))
    first = ids(page)[0]
    page.focus("#solutions tr[data-id]")
    page.keyboard.press("Enter")
    page.wait_for_url(f"{url}/solutions/{first}")
    page.go_back()
    drawn(page)
    event = "plot => plot.emit('plotly_click', {points: [{customdata: plot.data[0].customdata[0]}]})"
    pressed = page.evaluate("document.getElementById('scatter-plot').data[0].customdata[0]")
    page.locator("#scatter-plot").evaluate(event)
    page.wait_for_url(f"{url}/solutions/{pressed}")


def test_boxes_choose_four_at_most_for_comparison(archive, visit):
    _, url = archive
    page = drawn(visit(f"{url}/archive"))
    chosen = ids(page)[:4]
    for key in chosen:
        page.check(f"tr[data-id='{key}'] input[type=checkbox]")
    assert page.get_attribute("#compare", "href") == f"/compare?ids={','.join(chosen)}"
    page.reload()
    page.wait_for_selector("#choice:has-text('4 of 4 chosen')")
    page.click("#choice .chip button >> nth=0")
    assert page.get_attribute("#compare", "href") == f"/compare?ids={','.join(chosen[1:])}"


def test_distinct_solutions_are_listed_with_how_often_they_were_found(archive, visit):
    store, url = archive
    page = drawn(visit(f"{url}/archive"))
    n = store.clusters(Filter(), 0.05, 50).n_clusters
    assert page.get_attribute("#clusters-card", "data-clusters") == str(n)
    assert page.locator("#clusters tr[data-id]").count() == n
    page.select_option("#distance", "0.2")
    page.wait_for_selector(f"#clusters-card[data-clusters='{store.clusters(Filter(), 0.2, 50).n_clusters}']")


def test_a_filter_without_solutions_says_so_and_an_empty_archive_what_to_do(archive, visit, served, tmp_path):
    _, url = archive
    page = visit(f"{url}/archive?min_delta_v_km_s=90")
    assert "No solution matches" in page.inner_text("#nothing")
    page.click("#nothing button")
    drawn(page)
    with served(tmp_path) as (_, empty):
        page = visit(f"{empty}/archive")
        assert "coastarc run examples/quick.toml" in page.inner_text("#empty")
        page.close()


def test_a_new_solution_appears_by_itself(visit, served, tmp_path):
    with served(tmp_path) as (store, url):
        known.submitted(store)
        page = visit(f"{url}/archive")
        page.wait_for_selector("#connection[data-connection=live]")
        work = known.dispatcher(store)
        while not store.all_records(Filter()):
            work.step()
        page.wait_for_selector("#solutions tr[data-id]")
        drawn(page)
        page.close()


@pytest.mark.short
def test_names_from_users_are_shown_as_text(archive, visit):
    name = "<img src=x onerror=alert(1)>"

    def renamed(route):
        answer = route.fetch()
        route.fulfill(response=answer, json=answer.json() | {"campaigns": [{"id": 1, "name": name}]})

    page = drawn(visit(f"{archive[1]}/archive"))
    page.route("**/solutions/choices*", renamed)
    page.reload()
    page.wait_for_selector("select[name=campaign] option:has-text('onerror')", state="attached")
    assert page.locator("select[name=campaign] option").all_inner_texts() == ["all", f"1 {name}"]
    assert page.locator("main img").count() == 0


@pytest.mark.parametrize("theme", ["dark", "light"])
@pytest.mark.parametrize("width", [1280, 390])
def test_it_fits_and_every_control_has_a_name(archive, visit, theme, width):
    store, url = archive
    chosen = ",".join(record.id for record in store.all_records(Filter())[:2])
    page = drawn(visit(f"{url}/archive?chosen={chosen}&max_shooting_days=89", theme, width))
    assert page.evaluate("document.documentElement.scrollWidth") == width
    nameless = page.locator("main :is(input, select, button)").evaluate_all(
        "all => all.filter(e => !e.ariaLabel && !e.labels?.length && !e.textContent.trim()).map(e => e.id)"
    )
    assert nameless == []
    SCREENS.mkdir(parents=True, exist_ok=True)
    page.screenshot(path=SCREENS / f"archive-{theme}-{width}.png", full_page=True)
