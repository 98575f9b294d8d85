"""Specifications and campaigns to test with; their solves are those of `tests.workers.fake`."""

from service.schemas.solution import Filter
from service.spec import spec_from
from service.store.errors import StoreError
from service.store.store import Store
from tests.workers.fake import run_fake
from tests.workers.jobs import worker_info
from workers.dispatcher import Dispatcher
from workers.executor import Inline
from workers.messages import (
    ClaimAnswer,
    CompleteManyAnswer,
    CompleteRequest,
    HandInRequest,
    UnacceptableError,
)

OUTAGE = {"segment": 24, "duration_days": 1.0}
#: Nine days of spiral, for which there may be propellant.
SPIRAL = {
    "kind": "spiral",
    "epoch": "2025-11-01T00:00:00",
    "perigee_radius_km": 6578.0,
    "apogee_radius_km": 33907.0,
    "inclination_deg": 28.446,
    "raan_deg": -2.476,
    "argument_of_perigee_deg": 255.0,
    "duration_days": 9.0,
}


def spec_fields(guesses=8, **more):
    """Return S(0) and S(1|0), which seeds itself from the former."""
    return {
        "campaign": {"name": "test", "rng_seed": 7},
        "problem": {"preset": "ppe-drm3"},
        "search": [
            {"id": "s0", "strategy": "S(0)", "guesses": guesses, "hops": 2},
            {"id": "s1-0", "strategy": "S(1|0)", "outages": [OUTAGE], "seeds": {"from": "s0"}},
        ],
    } | more


def submitted(store: Store, fields=None) -> int:
    return store.submit(spec_from(fields or spec_fields()))[0]


class StoreSource:
    """A store as a source of jobs, without the network between."""

    def __init__(self, store):
        self._store = store

    def claim(self, request):
        self._store.register(request.worker)
        claims = self._store.claim(request.worker.name, request.n_jobs, request.campaign_id)
        leases = self._store.leases
        return ClaimAnswer(claims=tuple(claims), lease_s=leases.lease_s, heartbeat_s=leases.heartbeat_s)

    def heartbeat(self, request):
        return self._store.heartbeat(request.worker.name, [job.ticket for job in request.held])

    def hand_in(self, part):
        return self._store.hand_in(HandInRequest.model_validate_json(part.to_json()))

    def complete(self, report):
        return self.complete_many([report]).answers[0]

    def complete_many(self, reports):
        requests = [CompleteRequest.model_validate_json(report.to_json()) for report in reports]
        try:
            return CompleteManyAnswer(answers=tuple(self._store.complete_many(requests)))
        except StoreError as error:
            raise UnacceptableError(str(error)) from error


def dispatcher_on(store: Store, executor) -> Dispatcher:
    return Dispatcher(StoreSource(store), executor, worker_info("test", slots=1))


def finish(store: Store, executor=None, n_steps=10_000, before_step=lambda n: None) -> None:
    """Work on everything until nothing is left, or for so many steps."""
    dispatcher = dispatcher_on(store, executor or Inline(run_fake))
    for n in range(n_steps):
        before_step(n)
        if not dispatcher.step() and all(item.state == "done" for item in store.campaigns()):
            return


def content(store: Store):
    """Return all that a campaign found, without what may differ between two runs of it."""
    volatile = {"created_at", "cpu_seconds", "wall_seconds", "host", "campaign_id", "search_id"}
    return [record.model_dump(exclude=volatile) for record in store.all_records(Filter())]


def dispatcher_pid(coordinator):
    """Return the process id of the dispatcher that a coordinator runs."""
    return coordinator._supervisor.pid
