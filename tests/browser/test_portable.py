"""A campaign taken away from its page as a file, and brought to the list of another installation."""

from service.auth.network import Access
from service.schemas.identity import Role
from service.store.archive_files import portable
from tests.acceptance import known

MARKUP = "<img src=x onerror=alert(1)>"


def choose(page, file):
    page.click("[data-does=import]")
    page.set_input_files("#portable", file)
    page.click("dialog button[type=submit]")


def test_a_campaign_is_taken_away_and_brought_to_another_installation(visit, served, tmp_path):
    (tmp_path / "one").mkdir()
    # An archive of its own: that of the session may hold a made-up certificate, which no import takes.
    with served(tmp_path / "one") as (store, url):
        known.submitted(store)
        work = known.dispatcher(store)
        while any(item.state != "done" for item in store.campaigns()):
            work.step()
        page = visit(f"{url}/campaigns/1")
        with page.expect_download() as started:
            page.click("#actions >> text=Export campaign")
        file = tmp_path / started.value.suggested_filename
        started.value.save_as(file)
        assert file.name == "campaign-known-solutions.zip"
        assert file.read_bytes() == b"".join(portable(store, 1))
        page.close()
    (tmp_path / "other").mkdir()
    with served(tmp_path / "other") as (store, url):
        page = visit(url)
        choose(page, file)
        page.wait_for_url("**/campaigns/1")
        page.wait_for_selector("[data-search=s0]")
        assert store.campaign(1).n_solutions == 4
        page.close()


def test_what_is_wrong_with_a_file_is_said_beside_it_as_text(visit, served, tmp_path):
    (tmp_path / "text.zip").write_text("no campaign")
    with served(tmp_path) as (_, url):
        page = visit(url)
        choose(page, tmp_path / "text.zip")
        page.wait_for_selector("dialog [role=alert]:has-text('expected a portable file of a campaign')")
        page.route(
            "**/campaigns/import", lambda route: route.fulfill(status=422, json={"detail": f"file {MARKUP}"})
        )
        page.click("dialog button[type=submit]")
        page.wait_for_selector("dialog [role=alert]:has-text('onerror')")
        assert page.locator("dialog img").count() == 0
        page.close()
    # A refusal is an error line of the browser's own.
    assert all("status of 422" in text for text in visit.complaints)
    visit.complaints.clear()


def test_a_campaign_at_work_says_why_it_cannot_be_taken_away(visit, served, tmp_path):
    with served(tmp_path) as (store, url):
        known.submitted(store)
        page = visit(f"{url}/campaigns/1")
        button = page.locator("#actions >> text=Export campaign")
        assert button.is_disabled() and "Pause it first" in button.get_attribute("title")
        store.control_campaign(1, "pause")
        page.wait_for_selector("#actions a:has-text('Export campaign')")
        page.close()


def test_who_may_only_read_is_offered_no_import(visit, served, tmp_path):
    with served(tmp_path, access=Access(is_open=False)) as (store, url):
        token = store.identities.create("ada", Role.VIEWER, 1.0).token
        page = visit(f"{url}/sign-in", is_ready=False)
        page.fill("input[type=password]", token)
        page.keyboard.press("Enter")
        page.wait_for_selector("#actions >> text=New campaign")
        assert page.locator("[data-does=import]").count() == 0
        page.close()
