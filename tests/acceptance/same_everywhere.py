"""Does a campaign find the same solutions wherever its jobs run?  With the real solver, and real processes.

Run as `python -m tests.acceptance.same_everywhere [--guesses N] [--on PLACE ...] [SPEC]`, or `make same`.
One coordinator after the other works on the specification: inline, with two processes, with Ray and two
workers, and by `coastarc dispatch --address` on a simulated cluster of four nodes.  Prints a summary in JSON;
the exit code is 0 if all archives hold the same bits, and 1 if not.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from hashlib import blake2b
from pathlib import Path

from service.coordinator import Coordinator, WorkerSetup
from service.spec import load_spec, spec_from
from tests.ray_clusters import nodes
from tests.service.campaigns import content
from workers.dispatch import RUNNER, ExecutorKind
from workers.process_tree import single_threaded

QUICK = Path(__file__).parents[2] / "examples" / "quick.toml"
COASTARC = Path(sys.executable).with_name("coastarc")
CREWS = {
    "inline": WorkerSetup(1, ExecutorKind.INLINE),
    "process pool, 2 processes": WorkerSetup(2, ExecutorKind.PROCESS),
    "ray, 2 workers": WorkerSetup(2, ExecutorKind.RAY),
}
CLUSTER = "ray, cluster of 4 nodes"
PLACES = (*CREWS, CLUSTER)
#: Longer than a campaign may take anywhere [s].
PATIENCE_S = 7200.0


class CampaignStuckError(RuntimeError):
    """A campaign that did not end."""


def specification(path: Path, guesses: int | None):
    """Return a specification, with another number of guesses where it has one."""
    fields = load_spec(path).as_fields()
    for search in fields["search"]:
        if guesses is not None and "guesses" in search:
            search["guesses"] = guesses
    return spec_from(fields)


@contextmanager
def dispatch_on_cluster(url: str, runner: str, cluster: tuple[str, Path]) -> Iterator[subprocess.Popen]:
    """Have the command `coastarc dispatch` work on a cluster that was there before it."""
    address, token = cluster
    command = [str(COASTARC), "dispatch", "--url", url, "--runner", runner]
    command += ["--executor", "ray", "--address", address, "--cluster-token", str(token)]
    # Its words would stand in the summary.
    with subprocess.Popen(command, stdout=sys.stderr, env=single_threaded(os.environ)) as process:
        try:
            yield process
        finally:
            process.terminate()
    if process.returncode != 0:
        raise CampaignStuckError(f"coastarc dispatch: expected exit code 0, got {process.returncode}")


def wait_for_end(coordinator: Coordinator, campaign_id: int, worker: subprocess.Popen | None) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while coordinator.store.campaign_state(campaign_id) != "done":
        coordinator.raise_fault()
        if time.monotonic() > deadline or (worker and worker.poll() is not None):
            raise CampaignStuckError(f"campaign: expected state done, got {coordinator.store.campaigns()}")
        time.sleep(0.2)


def run_at(place: str, spec, runner: str, cluster: tuple[str, Path] | None) -> dict:
    """Run a campaign in one place, and return what it found there."""
    with tempfile.TemporaryDirectory(prefix="same-") as folder, Coordinator(Path(folder)) as coordinator:
        begin = time.monotonic()
        campaign_id, _ = coordinator.store.submit(spec)
        if place == CLUSTER:
            with dispatch_on_cluster(coordinator.url, runner, cluster) as worker:
                wait_for_end(coordinator, campaign_id, worker)
        else:
            crew = CREWS[place]
            coordinator.work(WorkerSetup(crew.n_workers, crew.executor, runner), campaign_id)
            wait_for_end(coordinator, campaign_id, None)
        wall_seconds = time.monotonic() - begin
        return told(coordinator.store, campaign_id) | {"wall_seconds": round(wall_seconds, 1)}


def told(store, campaign_id: int) -> dict:
    """Return the numbers of an archive, and a digest of all that was found, to the last bit."""
    found = json.dumps(content(store), sort_keys=True, default=str)
    searches = store.campaign(campaign_id).searches
    return {
        "solutions": sum(search.n_solutions for search in searches),
        "solves": sum(search.n_solves for search in searches),
        "endings": {search.name: search.endings for search in searches},
        "workers": sorted({job.worker for job in store.jobs(campaign_id, None, "done", 200).items}),
        "digest": blake2b(found.encode(), digest_size=16).hexdigest(),
    }


def summary(spec, places=PLACES, runner: str = RUNNER, cluster: tuple[str, Path] | None = None) -> dict:
    """Run a campaign in all places, one after the other; `cluster` is there already or is started for it."""
    found = {}
    for place in places:
        if place == CLUSTER and cluster is None:
            with nodes() as started:
                found[place] = run_at(place, spec, runner, started)
        else:
            found[place] = run_at(place, spec, runner, cluster)
        sys.stderr.write(f"{place}: {found[place]}\n")
    results = {json.dumps([at["digest"], at["endings"]], sort_keys=True) for at in found.values()}
    return {"campaign": spec.campaign.name, "places": found, "equal": len(results) == 1}


def main() -> int:
    parser = argparse.ArgumentParser(prog="same_everywhere", description=__doc__.split("\n")[0])
    parser.add_argument("spec", nargs="?", type=Path, default=QUICK)
    parser.add_argument("--guesses", type=int, help="in place of those of the specification")
    parser.add_argument("--on", nargs="+", choices=PLACES, default=PLACES, metavar="PLACE", help=f"{PLACES}")
    wanted = parser.parse_args()
    compared = summary(specification(wanted.spec, wanted.guesses), wanted.on)
    sys.stdout.write(json.dumps(compared, indent=2) + "\n")
    return 0 if compared["equal"] else 1


if __name__ == "__main__":
    sys.exit(main())
