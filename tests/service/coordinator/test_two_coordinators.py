"""Two coordinators on one PostgreSQL, as processes: neither ends the other, whoever is killed."""

import os
import subprocess
import sys

import pytest

from service.client import Client
from service.store.store import Store
from tests.service.campaigns import content, spec_fields
from tests.service.coordinator.test_dispatch import answer, undisturbed, wait_for
from tests.service.databases import needs_postgres, rows
from tests.service.fake_coastarc import LEASE

pytestmark = [needs_postgres, pytest.mark.slow]


class Served:
    """One coordinator with a data folder and a worker of its own, started as often as a test wants."""

    def __init__(self, folder, database):
        self.folder = folder
        # Longer than a start takes: what was running then goes on by the coordinator that is back.
        self._environment = dict(os.environ) | {LEASE: "60", "COASTARC_DATABASE_URL": database}
        self.start()

    def start(self):
        self.folder.mkdir(exist_ok=True)
        self._log = self.folder / "log"
        command = [sys.executable, "-m", "tests.service.fake_coastarc", "run_slowly"]
        command += ["serve", "--data", str(self.folder), "--port", "0", "--workers", "1"]
        with self._log.open("w") as log:
            self.process = subprocess.Popen(command, stdout=log, stderr=log, env=self._environment)

    def kill(self):
        self.process.kill()
        self.process.wait()

    @property
    def url(self):
        return wait_for(lambda: self._log.read_text().partition("Live page: ")[2].partition("\n")[0])

    def stop(self):
        self.process.terminate()
        assert self.process.wait(timeout=60) == 0, self._log.read_text()


@pytest.fixture
def two(tmp_path, new_database, monkeypatch):
    """Give two coordinators that found an empty database in the same moment, and its address."""
    database = new_database().render_as_string(hide_password=False)
    # Of one name, as the folders of two machines may be.
    folders = [tmp_path / side / "data" for side in ("left", "right")]
    for folder in folders:
        folder.parent.mkdir()
    served = [Served(folder, database) for folder in folders]
    monkeypatch.setenv("COASTARC_DATABASE_URL", database)
    yield served
    for one in served:
        one.kill()


def n_done(client, campaign_id):
    return answer(lambda: len(client.jobs(campaign_id, None, "done", 200).items)) or 0


def dispatchers(store):
    return {name.rsplit(":", 3)[0] for (name,) in rows(store, "SELECT DISTINCT worker FROM attempt")}


def test_two_coordinators_on_one_database_that_are_killed_in_turn_finish_every_campaign(tmp_path, two):
    left, right = two
    with pytest.MonkeyPatch.context() as patch:
        patch.delenv("COASTARC_DATABASE_URL")
        expected = undisturbed(tmp_path / "undisturbed", guesses=48)
    for one in two:
        assert one.url
    with Client(left.url) as client:
        campaign_id = client.submit(spec_fields(48))[0].id
    for killed, other in ((left, right), (right, left)):
        with Client(other.url) as client:
            before = n_done(client, campaign_id)
            wait_for(lambda: n_done(client, campaign_id) >= before + 4)  # noqa: B023 - waited for at once
            killed.kill()
            killed.start()
            assert killed.url and other.process.poll() is None
    with Client(left.url) as client:
        wait_for(lambda: answer(lambda: client.campaign(campaign_id).state) == "done")
    for one in two:
        one.stop()
    with Store(tmp_path / "reader", read_only=True) as store:
        assert content(store) == expected
        assert len(dispatchers(store)) == 2
        # Nobody's token was ever refused, and nobody's work was taken away by the start of the other.
        assert rows(store, "SELECT count(*) FROM audit WHERE status = 401") == [(0,)]
        assert rows(store, "SELECT count(*) FROM job WHERE state = 'dead' OR n_failures > 0") == [(0,)]
