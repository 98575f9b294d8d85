"""The page of workers and jobs: who is there, what each did, what waits, and what went wrong."""

import re

import pytest

from service.auth.network import access_on
from service.coordinator import WebServer, open_port
from service.schemas.identity import Role
from service.settings import Settings
from service.store.store import Store
from tests.browser import hopping
from tests.browser.conftest import SCREENS, serving
from tests.service.by_hand import worker_info
from workers.messages import Ending, JobOutcome

WORST = "<img src=x onerror=alert(1)>"
ERROR = JobOutcome(ending=Ending.ERROR, error=f"Traceback ...\n  in solve\nZeroDivisionError: {WORST}")
NEED = {"cpu_cores": 1.5, "memory_bytes": 3 * 2**29, "host_memory_bytes": 16 * 2**30}
INFO = worker_info("node7:4711", slots=2).model_copy(update=NEED)


def report(store, claim, outcome=None):
    store.complete(claim.ticket, outcome or hopping.run_hopping(claim.job))


@pytest.fixture
def busy(served, tmp_path):
    """A store and its address: one job done, one dead, two running on a worker, others waiting."""
    with served(tmp_path) as (store, url):
        hopping.submitted(store)
        first, second = store.claim(INFO, 2)
        report(store, first)
        report(store, second, ERROR)
        store.claim(INFO, 2)
        yield store, url


def job_in(store, state):
    return store.jobs(None, None, state, 1).items[0].id


def answered(page, verb):
    page.wait_for_selector("dialog[open]")
    page.click(f"dialog button >> text={verb}")
    page.wait_for_selector("dialog", state="detached")


def test_without_a_worker_the_page_says_how_to_start_one(visit, served, tmp_path):
    with served(tmp_path) as (store, url):
        page = visit(f"{url}/workers")
        assert f"coastarc dispatch --url {url} --workers 2" in page.inner_text("#no-worker")
        assert "token" not in page.inner_text("#no-worker")
        assert "No job ran in this period" in page.inner_text("#gantt")
        hopping.submitted(store)
        page.wait_for_selector("#no-worker >> text=jobs are waiting")
        page.close()


def test_where_sign_in_is_required_the_command_names_a_token(visit, browser, tmp_path):
    with Store(tmp_path) as store:
        written = store.identities.create("ada", Role.VIEWER, 1.0).token
        access = access_on("127.0.0.1", Settings(auth="required"), store.identities.has_token)
        server = WebServer(store, open_port("127.0.0.1", 0), "127.0.0.1", access)
        server.start()
        try:
            with browser.new_context(extra_http_headers={"Authorization": f"Bearer {written}"}) as context:
                page = context.new_page()
                page.goto(f"{server.url}/workers")
                page.wait_for_selector("#no-worker >> text=--token-file worker.token")
                assert "--role worker" in page.inner_text("#no-worker")
        finally:
            server.stop()


@pytest.mark.short
def test_a_worker_is_shown_with_what_it_does_and_needs(busy, visit):
    page = visit(f"{busy[1]}/workers")
    row = page.inner_text("#workers tbody tr")
    for words in ("node7:4711", "connected", "2 of 2 slots", "1.50\xa0cores", "1.50\xa0GiB of 16\xa0GiB"):
        assert words in row
    assert "2 of 2" in page.inner_text("#facts")
    assert page.locator("[role=meter][aria-label='CPU cores in use']").get_attribute("aria-valuenow") == "1.5"


def test_attempts_are_bars_coloured_by_how_they_ended(busy, visit):
    page = visit(f"{busy[1]}/workers")
    endings = page.locator("[data-attempt]").evaluate_all("bars => bars.map(b => b.dataset.ending).sort()")
    assert len(endings) == 4 and {"error", "running"} < set(endings) and endings.count("running") == 2
    page.locator("[data-ending=running]").first.focus()
    assert re.search(r"S\(0\) · \w+, a chain, running, for \d+", page.inner_text("#gantt .readout"))
    page.click("#windows >> text=6 h")
    page.wait_for_url("**window=21600")
    assert page.locator("[data-attempt]").count() == 4


def test_a_running_job_is_stopped_after_a_question(busy, visit):
    store, url = busy
    page = visit(f"{url}/workers")
    assert page.locator("#jobs tbody tr").count() == 2
    assert "Lease age" in page.inner_text("#jobs thead")
    job = job_in(store, "running")
    page.click(f"[data-key='cancel-{job}']")
    answered(page, "Cancel the job")
    page.wait_for_selector("#jobs >> text=stopping")
    assert store.job(job).is_cancelling


def test_a_dead_job_tells_its_error_in_full_and_is_tried_again(busy, visit):
    store, url = busy
    job = job_in(store, "dead")
    page = visit(f"{url}/workers?state=dead&campaign=1")
    page.click(f"[data-key='error-{job}']")
    page.wait_for_selector("#jobs pre")
    assert page.inner_text("#jobs pre") == ERROR.error and page.locator("img[src=x]").count() == 0
    assert page.get_attribute(f"[data-key='error-{job}']", "aria-expanded") == "true"
    page.click(f"[data-key='requeue-{job}']")
    answered(page, "Requeue the job")
    page.wait_for_selector("#jobs-note >> text=No job is dead")
    assert store.job(job).state == "queued"


def test_all_dead_jobs_of_a_campaign_are_tried_again_at_once(busy, visit):
    store, url = busy
    page = visit(f"{url}/workers")
    page.click("[data-does=requeue-1]")
    answered(page, "Requeue them")
    page.wait_for_selector("[data-does=requeue-1]", state="detached")
    assert store.activity.queue().jobs.dead == 0


def test_what_a_worker_does_appears_by_itself(busy, visit):
    store, url = busy
    page = visit(f"{url}/workers")
    page.wait_for_selector("#connection[data-connection=live]")
    (claim,) = store.claim(INFO, 1)
    report(store, claim)
    page.wait_for_selector("[data-attempt] >> nth=4", state="attached", timeout=10_000)


@pytest.mark.parametrize("theme", ["light", "dark"])
@pytest.mark.parametrize("width", [1280, 390])
def test_workers_and_jobs_fit_the_screen(busy, visit, theme, width):
    page = visit(f"{busy[1]}/workers", theme, width)
    page.wait_for_selector("[data-attempt]")
    SCREENS.mkdir(parents=True, exist_ok=True)
    page.screenshot(path=SCREENS / f"workers-{theme}-{width}.png", full_page=True)
    assert page.evaluate("document.documentElement.scrollWidth") == width


@pytest.mark.parametrize("width", [1280, 390])
def test_an_idle_coordinator_fits_the_screen(visit, tmp_path, width):
    with serving(tmp_path) as (_, url):
        page = visit(f"{url}/workers", "light", width)
        SCREENS.mkdir(parents=True, exist_ok=True)
        page.screenshot(path=SCREENS / f"workers-idle-light-{width}.png", full_page=True)
        assert page.evaluate("document.documentElement.scrollWidth") == width
        page.close()
