"""Every page over an archive that holds each kind of campaign; `visit` refuses complaints of any."""

import pytest

from service.dashboard.assets import VIEWS
from tests.service.databases import rows
from tests.service.kinds import every_kind

pytestmark = pytest.mark.slow


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


@pytest.mark.parametrize(
    "view", [view for view in VIEWS if view.name != "compare"], ids=lambda view: view.name
)
def test_every_page_opens_without_a_complaint(kinds, visit, view):
    store, url = kinds
    for address in addresses(view, store):
        page = visit(url + address)
        assert not page.is_visible("#notice"), address
        page.context.close()


def test_solutions_of_every_campaign_can_be_compared(kinds, visit):
    store, url = kinds
    found = rows(store, "SELECT min(solution_id) FROM solve WHERE strict GROUP BY search_id")
    assert len(found) > 4
    visit(f"{url}/compare?ids={','.join(row[0] for row in found[:4])}")


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
