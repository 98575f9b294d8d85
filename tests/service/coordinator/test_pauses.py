"""Machines that sleep, processes that are stopped, clocks that are set, with real processes."""

import os
import signal
import subprocess
import sys
import time

import psutil
import pytest

from service.client import Client
from service.store.store import Store
from tests.service.campaigns import content, spec_fields
from tests.service.coordinator.test_dispatch import undisturbed, wait_for
from tests.service.databases import rows
from tests.service.fake_coastarc import CLOCK, LEASE

LEASE_S = 6.0
#: So many that work is left after the last disturbance: two workers need some 25 s for them.
GUESSES = 300
pytestmark = pytest.mark.slow


class Service:
    """A coordinator with two workers, whose clock and whose processes a test may stop."""

    def __init__(self, folder):
        self.folder = folder
        self._offset = folder / "offset"
        self._log = folder / "log"
        folder.mkdir()

    def start(self):
        self.set_clock(0)
        environment = dict(os.environ) | {LEASE: str(LEASE_S), CLOCK: str(self._offset)}
        command = [sys.executable, "-m", "tests.service.fake_coastarc", "run_slowly"]
        command += ["serve", "--data", str(self.folder / "data"), "--port", "0", "--workers", "2"]
        with self._log.open("w") as log:
            self.process = subprocess.Popen(command, stdout=log, stderr=log, env=environment)
        self.url = wait_for(lambda: self._log.read_text().partition("Live page: ")[2].partition("\n")[0])

    def set_clock(self, hours):
        self._offset.write_text(str(3600 * hours))

    def pause(self, seconds):
        """Stop every process, as the end of a laptop's battery or a batch system does."""
        service = psutil.Process(self.process.pid)
        every = [service, *service.children(recursive=True)]
        for process in every:
            process.send_signal(signal.SIGSTOP)
        time.sleep(seconds)
        for process in every:
            process.send_signal(signal.SIGCONT)

    def stop(self):
        self.process.terminate()
        assert self.process.wait(timeout=60) == 0
        return self._log.read_text()


@pytest.fixture
def service(tmp_path):
    opened = Service(tmp_path / "service")
    yield opened
    opened.process.kill()
    opened.process.wait()


def disturbed(service, disturb, n_times):
    """Run a campaign that is disturbed so often; return what the log says."""
    with Client(service.url) as client:
        campaign_id = client.submit(spec_fields(GUESSES))[0].id

        def n_done():
            return sum(search.jobs.done for search in client.campaign(campaign_id).searches)

        for number in range(n_times):
            before = n_done()
            wait_for(lambda: n_done() > before)  # noqa: B023 - waited for at once
            disturb(number)
        wait_for(lambda: client.campaign(campaign_id).state == "done")
    return service.stop()


def require_no_loss(tmp_path):
    expected = undisturbed(tmp_path / "undisturbed", GUESSES)
    with Store(tmp_path / "service" / "data", read_only=True) as store:
        assert rows(store, "SELECT count(*) FROM attempt WHERE ending NOT IN ('feasible', 'infeasible')") == [
            (0,)
        ]
        assert rows(store, "SELECT count(*) FROM job WHERE attempt > 1 OR n_failures > 0") == [(0,)]
        assert content(store) == expected


def test_processes_that_are_stopped_for_longer_than_a_lease_lose_no_job(tmp_path, service):
    service.start()
    log = disturbed(service, lambda _: service.pause(1.5 * LEASE_S), n_times=3)
    require_no_loss(tmp_path)
    assert "as after a pause" in log


@pytest.mark.parametrize("hours", [1, -5])
def test_a_clock_that_is_set_again_and_again_loses_no_job_and_keeps_none_waiting(tmp_path, service, hours):
    service.start()

    def step(number):
        service.set_clock(hours * (number + 1))
        # Until the reaper has looked.
        time.sleep(LEASE_S / 2)

    log = disturbed(service, step, n_times=4)
    require_no_loss(tmp_path)
    assert "as after a sleep" in log
