"""Every page over an archive that holds each kind of campaign; `visit` refuses complaints of any."""

import pytest

from service.dashboard.assets import VIEWS
from service.schemas.solution import Filter
from service.solutions.verification import VerificationRequest, verify_solutions
from service.spec import spec_from
from tests.service.campaigns import dispatcher_on
from tests.service.databases import rows
from tests.service.kinds import every_kind
from workers.executor import Inline
from workers.run import run_job

slow = pytest.mark.slow


@pytest.fixture(scope="module")
def kinds(tmp_path_factory):
    from tests.browser.conftest import serving

    with serving(tmp_path_factory.mktemp("kinds")) as (store, url):
        every_kind(store)
        yield store, url


def addresses(view, store):
    """Return the page of each row that there is."""
    rows_of = {
        "campaign": "SELECT id FROM campaign",
        "search": "SELECT campaign_id, name FROM search",
        "solution": "SELECT id FROM solution",
        "problem": "SELECT hash FROM problem",
    }
    names = [part[1:-1] for part in view.path.split("/") if part.startswith("{")]
    if not names:
        return [view.path]
    return [view.path.format(**dict(zip(names, row, strict=True))) for row in rows(store, rows_of[view.name])]


@slow
@pytest.mark.parametrize(
    "view", [view for view in VIEWS if view.name != "compare"], ids=lambda view: view.name
)
def test_every_page_opens_without_a_complaint(kinds, visit, view):
    store, url = kinds
    for address in addresses(view, store):
        page = visit(url + address)
        assert not page.is_visible("#notice"), address
        page.context.close()


@slow
def test_solutions_of_every_campaign_can_be_compared(kinds, visit):
    store, url = kinds
    found = rows(store, "SELECT min(solution_id) FROM solve WHERE strict GROUP BY search_id")
    assert len(found) > 4
    visit(f"{url}/compare?ids={','.join(row[0] for row in found[:4])}")


@slow
@pytest.mark.parametrize("kind", ["missed_thrust", "refined"])
def test_a_search_that_maps_one_solution_leads_to_it(kinds, visit, kind):
    store, url = kinds
    campaign, name, seed = rows(
        store,
        "SELECT s.campaign_id, s.name, j.seed_id FROM search s JOIN job j ON j.search_id = s.id "
        "JOIN campaign c ON c.id = s.campaign_id "
        f"WHERE s.source_id IS NULL AND c.name LIKE '{kind.replace('_', '-').removesuffix('d')}%'",
    )[0]
    page = visit(f"{url}/campaigns/{campaign}/searches/{name}")
    assert page.get_attribute("#laws a", "href") == f"/solutions/{seed}"


MARS = {
    "campaign": {"name": "mars", "rng_seed": 1},
    "problem": {"preset": "earth-mars"},
    "search": [
        {"id": "s0", "strategy": "S(0)", "guesses": 2},
        {
            "id": "s1-0",
            "strategy": "S(1|0)",
            "outages": [{"segment": 8, "duration_days": 28.0}],
            "seeds": {"from": "s0"},
            "mapping": "continued",
        },
    ],
}
#: All that a page says, what it says to those who hover or listen, and what its figures say.
SAID = """() => [document.title, document.body.innerText,
  ...[...document.querySelectorAll("[title], [aria-label]")].flatMap((e) => [e.title, e.ariaLabel]),
  ...[...document.querySelectorAll("text, option, caption")].map((e) => e.textContent),
  ...[...document.querySelectorAll(".js-plotly-plot")].flatMap((e) => e.data.flatMap(
    (t) => [t.name, t.text, t.hovertemplate].flat())),
].join("\\n")"""


@pytest.fixture(scope="module")
def mars(tmp_path_factory):
    """The store and the address of a campaign about the Sun, solved here."""
    from tests.browser.conftest import serving

    with serving(tmp_path_factory.mktemp("mars")) as (store, url):
        store.submit(spec_from(MARS))
        work = dispatcher_on(store, Inline(run_job))
        while any(item.state != "done" for item in store.campaigns()):
            work.step()
        for record in store.all_records(Filter(search="s1-0"), None)[:1]:
            list(verify_solutions(store, [record.id], VerificationRequest()))
        yield store, url


@pytest.mark.short
def test_no_page_of_a_campaign_about_the_sun_says_moon(mars, visit):
    store, url = mars
    ids = [row[0] for row in rows(store, "SELECT id FROM solution ORDER BY id")]
    assert len(ids) == 4
    frames = [f"/solutions/{ids[0]}?frame={frame}" for frame in ("rotating", "inertial", "moon")]
    plain = [address for view in VIEWS if view.name != "compare" for address in addresses(view, store)]
    for address in [*plain, *frames, f"/compare?ids={','.join(ids)}"]:
        page = visit(url + address)
        if address.startswith("/solutions"):
            page.wait_for_selector(".player[data-ready]")
            assert "Sun" in page.inner_text("#facts") and "≤ 10" in page.inner_text("#defect-table")
        if address.startswith("/compare"):
            page.wait_for_selector("#overlay-plot[data-frame]")
        said = page.evaluate(SAID)
        for word in ("Moon", "lunar", "geocentric", "NRHO", "0.1\u00a0km"):
            assert word not in said, (address, word)
        page.context.close()
