"""What a person does meanwhile, over the API: submits campaigns, looks at what is done, requeues the dead."""

import threading
import time
from collections.abc import Callable
from typing import Any

from service.client import Client, ClientError
from tests.chaos.site import Site

PAUSE_S = 0.25
#: How often all finished jobs are noted, which takes several questions [s].
NOTES_S = 3.0
#: Campaigns that are open at a time, so that there is always something to lose.
N_OPEN = 2


class User:
    """A thread beside a round; what it was told, the archive must hold in the end."""

    def __init__(self, site: Site, fields_of: Callable[[int], dict[str, Any]]) -> None:
        #: Fields of the campaigns that were accepted, by id.
        self.submitted: dict[int, dict[str, Any]] = {}
        #: The attempt of each job that was seen as done.
        self.seen_done: dict[int, int] = {}
        self.n_requeued = 0
        #: Submissions with their repetitions, and those that turned out to be stored already.
        self.n_tries = self.n_known = 0
        self.faults: list[str] = []
        self.is_finished = threading.Event()
        self._wants_more = True
        self._site = site
        self._fields_of = fields_of
        self._pending: dict[str, Any] | None = None
        self._noted_at = 0.0
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="user")

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._stop.set()
        self._thread.join()

    def submit_no_more(self) -> None:
        """Let the campaigns that are open be the last ones."""
        self._wants_more = False

    def _run(self) -> None:
        with Client(self._site.url) as client:
            while not self._stop.wait(PAUSE_S):
                try:
                    self._step(client)
                except ClientError as error:
                    self._judge(error)
                except Exception as error:
                    self.faults.append(f"user: {error!r}")
                    return

    def _judge(self, error: ClientError) -> None:
        # Whether it may be away is the prober's business; whatever it says, it must not fail over a question.
        if error.status is not None or "got 500" in str(error):
            self.faults.append(f"user: {error}")

    def _step(self, client: Client) -> None:
        if self._pending is not None:
            self._submit(client)
        campaigns = client.campaigns()
        n_open = sum(campaign.state == "active" for campaign in campaigns)
        dead = client.jobs(None, None, "dead", 200).items
        for job in dead:
            client.requeue_job(job.id)
            self.n_requeued += 1
        if time.monotonic() > self._noted_at + NOTES_S:
            self._note_done(client)
        if self._wants_more and n_open < N_OPEN and self._pending is None:
            self._pending = self._fields_of(len(self.submitted))
        elif not (self._wants_more or n_open or dead or self._pending):
            self._note_done(client)
            self.is_finished.set()
            self._stop.set()

    def _submit(self, client: Client) -> None:
        fields = self._pending
        name = fields["campaign"]["name"]
        self.n_tries += 1
        campaign, is_new = client.submit(fields, key=name)
        self.n_known += not is_new
        if campaign.id in self.submitted:
            self.faults.append(f"campaign {name}: expected an id of its own, got {campaign.id} again")
        self.submitted[campaign.id] = fields
        self._pending = None

    def _note_done(self, client: Client) -> None:
        after = 0
        while after is not None:
            page = client.jobs(None, None, "done", 200, after)
            self.seen_done |= {job.id: job.attempt for job in page.items}
            after = page.next
        self._noted_at = time.monotonic()
