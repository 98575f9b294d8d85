"""The page of a solution: its flight in time and space, its defects, its lineage, and its files."""

import json

import pytest

from core.problem import load_problem
from service.schemas.solution import Filter
from service.solutions.missed_thrust import views_of
from service.spec import spec_from
from service.spec.missed_thrust import analysis_spec, grid_of
from tests.acceptance import known
from tests.api_examples import example_of
from tests.browser.conftest import SCREENS
from tests.service.campaigns import finish
from workers.certificate import CertificateDocument

PRESET = load_problem("ppe-drm3")

#: Compressed bytes of a page with plots, and when its facts and tables stand [ms].
MOST_BYTES = 1_600_000


@pytest.fixture(scope="module")
def robust(archive):
    store, url = archive
    record = store.all_records(Filter(search="s1-0"))[0]
    return record, f"{url}/solutions/{record.id}"


def flown(page):
    page.wait_for_selector(".player[data-ready]")
    return page


def traces(page, place="trajectory-plot"):
    return dict(
        page.evaluate(f"document.getElementById('{place}').data.map(t => [t.name, t.x.flat().length])")
    )


@pytest.mark.short
def test_it_says_what_was_found_how_well_and_from_which_seed(robust, visit):
    record, address = robust
    page = visit(address)
    assert page.inner_text("#title") == "S(1|0), segment 24, 1.0\u00a0d"
    assert f"{record.delta_v_km_s:.4f}\u00a0km/s" in page.inner_text("#facts")
    assert page.inner_text("#verdict .pill") == "strict"
    assert page.locator("#defect-table td[data-within=strict]").count() == 6
    assert page.get_attribute("#origin a[href*='/solutions/']", "href") == f"/solutions/{record.seed_id}"
    assert page.get_attribute("#origin a[href*='/problems/']", "href") == f"/problems/{record.problem_hash}"
    assert page.locator("#defect-figure circle").count() == 12  # solved and verified, 2 x 3 parts


@pytest.mark.short
def test_it_is_drawn_with_arcs_outage_bodies_and_profiles(robust, visit):
    page = flown(visit(robust[1]))
    drawn = traces(page)
    assert {"Earth", "Moon", "Target orbit", "Spacecraft", "departure"} <= set(drawn)
    assert drawn["reference, thrust"] > 50 and drawn["realization 1, outage"] > 2
    assert sum(drawn.values()) <= 5000
    assert page.evaluate("document.getElementById('controls-plot').data.length") == 6
    assert page.evaluate("document.getElementById('states-plot').layout.shapes.length") == 1
    assert "outage 1" in page.inner_text("#states")


def test_a_frame_has_its_own_address_and_the_way_back(robust, visit):
    page = flown(visit(f"{robust[1]}?frame=inertial"))
    assert page.get_attribute("#trajectory-plot", "data-frame") == "inertial"
    assert "Moon’s path" in traces(page)
    page.focus("[role=tab][aria-selected=true]")
    page.keyboard.press("ArrowRight")
    page.wait_for_selector("#trajectory-plot[data-frame=moon]")
    assert "frame=moon" in page.url and "Moon, to scale" in traces(page)
    page.go_back()
    page.wait_for_selector("#trajectory-plot[data-frame=inertial]")


FRAMES_AS_SENT = """async (id) => {
  const module = document.querySelector('link[rel=modulepreload][href$="/frames.js"]').href;
  const { withAllFrames } = await import(module);
  const ask = async (query) => (await fetch(`/api/v1/solutions/${id}/trajectory${query}`)).json();
  const [full, made] = [await ask(''), withAllFrames(await ask('?tracks=inertial'))];
  const tracks = (flight) => [...flight.trajectories, flight.moon, flight.target];
  const off = (a, b) => Math.max(...a.map((row, i) => Math.hypot(...row.map((value, k) => value - b[i][k]))));
  const pairs = tracks(full).map((track, i) => [track, tracks(made)[i]]);
  return pairs.map(([a, b]) => ['rotating_km', 'moon_km'].map((name) => off(a[name], b[name])));
}"""


def test_frames_made_in_the_page_are_those_of_the_service(robust, visit):
    record, address = robust
    for rotating, moon in visit(address).evaluate(FRAMES_AS_SENT, record.id):
        # [km]: places are sent to a kilometre, and the Moon's velocity comes from such places.
        assert rotating < 30.0 and moon < 3.0


def craft(page):
    return page.evaluate(
        "(() => { const d = document.getElementById('trajectory-plot').data.at(-1); return [d.x, d.y] })()"
    )


def test_arrow_keys_move_the_spacecraft_the_date_and_the_mark_in_the_profiles(robust, visit):
    page = flown(visit(f"{robust[1]}?day=10"))
    assert page.inner_text("#moment-text").startswith(
        "day 10.0 · 2026-05-06 14:4"
    )  # departs 2026-04-26 14:47
    before, marked = craft(page), page.evaluate("document.querySelector('#states .now').style.left")
    page.focus("#moment")
    for _ in range(5):
        page.keyboard.press("ArrowRight")
    page.wait_for_selector("#trajectory-plot[data-day='10.50']")
    after = craft(page)
    assert after[0][0] != before[0][0] and after[0][1] is None  # the realization begins with its outage
    assert page.evaluate("document.querySelector('#states .now').style.left") != marked
    assert "day=10.5" in page.url


def test_it_plays_to_the_end_and_rests(robust, visit):
    page = flown(visit(robust[1]))
    last = float(page.get_attribute("#moment", "max"))
    page.focus("#moment")
    page.keyboard.press("End")
    for _ in range(3):
        page.keyboard.press("PageDown")  # a tenth of all
    page.select_option("#speed", "20")
    page.click("#play")
    page.wait_for_selector("#play[aria-pressed=false]")
    page.wait_for_selector(f"#trajectory-plot[data-day='{last:.2f}']")
    assert page.inner_text("#play") == "▶ Play"


def test_a_realization_is_switched_off_in_space_and_in_time(robust, visit):
    page = flown(visit(robust[1]))
    drawn = page.get_attribute("#states-plot", "data-drawn")
    page.uncheck("#shows-1")
    page.wait_for_selector(f"#states-plot:not([data-drawn='{drawn}'])")
    assert not [name for name in traces(page) if name.startswith("realization")]
    assert page.evaluate("document.getElementById('controls-plot').data.length") == 3
    assert page.evaluate("document.activeElement.id") == "shows-1"


def test_the_lineage_leads_to_the_seed_and_from_there_to_its_children(robust, archive, visit):
    record, address = robust
    page = visit(address)
    page.focus(f"#lineage a[data-node='{record.seed_id}']")
    page.keyboard.press("Enter")
    page.wait_for_url(f"**/solutions/{record.seed_id}")
    page.wait_for_selector("#lineage-plot[data-children]")
    assert page.get_attribute("#lineage [aria-current=page]", "data-node") == record.seed_id
    assert page.locator(f"#lineage a[data-node='{record.id}']").count() == 1
    assert f"{record.mapping} → S(1|0)" in page.locator("#lineage svg").text_content()


def test_the_command_is_copied_and_the_files_are_there(robust, visit):
    record, address = robust
    page = visit(address)
    page.context.grant_permissions(["clipboard-read", "clipboard-write"])
    page.click(".command button")
    page.wait_for_selector(".command button:has-text('Copied')")
    copied = page.evaluate("navigator.clipboard.readText()")
    assert copied == f"coastarc solutions reproduce {record.id} --url {address.partition('/solutions')[0]}"
    with page.expect_download() as started:
        page.click("#downloads a:has-text('Record')")
    content = json.loads(started.value.path().read_text())
    assert content["x"] == record.x and started.value.suggested_filename == f"coastarc-{record.id[:8]}.json"
    assert page.locator("#downloads a").count() == 6


def test_its_children_appear_while_the_page_is_open(visit, served, tmp_path):
    with served(tmp_path) as (store, url):
        known.submitted(store)
        work = known.dispatcher(store)
        while not store.all_records(Filter(search="s0")):
            work.step()
        page = visit(f"{url}/solutions/{store.all_records(Filter(search='s0'))[0].id}")
        page.wait_for_selector("#connection[data-connection=live]")
        assert page.get_attribute("#lineage-plot", "data-children") == "0"
        while not store.all_records(Filter(search="s1-0")):
            work.step()
        page.wait_for_selector("#lineage-plot[data-children='1']", timeout=10_000)
        page.close()


def test_an_unknown_solution_is_told_and_not_an_error_page(archive, visit):
    for name in (32 * "0", "<img src=x onerror=alert(1)>"):
        page = visit(f"{archive[1]}/solutions/{name}")
        assert "No such solution" in page.inner_text("#empty") and name in page.inner_text("#empty")
        assert page.locator("#empty img").count() == 0
        visit.complaints[:] = [text for text in visit.complaints if "status of 4" not in text]


@pytest.mark.parametrize("theme", ["dark", "light"])
@pytest.mark.parametrize("width", [1280, 390])
def test_the_page_fits(robust, visit, theme, width):
    page = flown(visit(f"{robust[1]}?day=30", theme=theme, width=width))
    assert page.evaluate("document.documentElement.scrollWidth") == width
    SCREENS.mkdir(parents=True, exist_ok=True)
    page.screenshot(path=SCREENS / f"solution-{theme}-{width}.png", full_page=True)


def test_the_page_is_small_with_all_it_draws(robust, visit):
    page = flown(visit(robust[1]))
    sent = page.evaluate(
        "performance.getEntriesByType('navigation').concat(performance.getEntriesByType('resource'))"
        ".reduce((sum, entry) => sum + entry.encodedBodySize, 0)"
    )
    assert 500_000 < sent < MOST_BYTES


def test_a_certificate_is_shown_when_there_is_one_and_else_how_to_make_it(archive, visit):
    store, url = archive
    solution_id = store.certificates.ids(Filter(search="s0"))[0]
    page = visit(f"{url}/solutions/{solution_id}")
    assert f"coastarc solutions verify {solution_id[:8]}" in page.inner_text("#certificate")
    example = example_of(CertificateDocument)
    first, *others = example.content.trajectories
    missed = first.through.model_copy(update={"arrival_miss": (0.1391, 6.38e-7)})
    flown = (first.model_copy(update={"through": missed}), *others)
    changes = {"solution_id": solution_id, "marks": ("too low",), "trajectories": flown}
    content = example.content.model_copy(update=changes)
    store.certificates.add(example.model_copy(update={"content": content}), "here")
    page = visit(f"{url}/solutions/{solution_id}")
    assert example.hash == page.inner_text("#certificate-hash") and "too low" in page.inner_text(
        "#certificate"
    )
    rows = page.locator("#certificate tbody tr")
    assert rows.count() == 2 and "0.14\u00a0km" in rows.nth(0).inner_text()
    assert page.locator("#downloads a[href$='/certificate']").count() == 1


def test_a_missed_thrust_analysis_is_shown_as_a_map(served, tmp_path, visit):
    with served(tmp_path) as (store, url):
        known.submitted(store)
        work = known.dispatcher(store)
        while work.step() or store.campaign_state(1) != "done":
            pass
        record = store.all_records(Filter(k=0))[0]
        grid = grid_of(PRESET, "8,24,40", "1,2")
        store.submit(spec_from(analysis_spec(record.id, PRESET, grid)))
        finish(store)
        page = visit(f"{url}/solutions/{record.id}")
        page.wait_for_selector("#missed-thrust-plot[data-drawn]")
        lost, costs = page.evaluate(
            "document.getElementById('missed-thrust-plot').data.map(t => [t.x, t.y, t.z])"
        )
        assert costs[:2] == lost[:2] == [[8, 24, 40], [1, 2]]
        (view,) = views_of(store, record.id)
        assert costs[2] == [list(row) for row in zip(*view.propellant_kg, strict=True)]
        assert "single safe modes have a recovery" in page.inner_text("#missed-thrust figcaption")
        # Before its server goes.
        page.close()
