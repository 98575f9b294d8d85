"""The rounds of `make chaos`, one after the other, and what they add up to."""

import shutil
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from random import Random
from typing import Any

from tests.chaos.fire import AtRandom, OneOfEach, UntilItIsBack
from tests.chaos.round import Round, RoundError, RoundOrder
from tests.chaos.site import (
    COORDINATOR,
    DISPATCHER,
    GCS,
    POOL_WORKER,
    RAY_AGENT,
    RAY_WORKER,
    RAYLET,
    SiteOrder,
)

RAY = SiteOrder(executor="ray", has_remote=False)
ROUNDS = (
    RoundOrder("coordinator", SiteOrder(), AtRandom({COORDINATOR: 45}, (0.3, 6.0))),
    RoundOrder("dispatcher", SiteOrder(), AtRandom({DISPATCHER: 45}, (0.2, 3.0), n_freezes=2)),
    RoundOrder("pool worker", SiteOrder(), AtRandom({POOL_WORKER: 50}, (0.1, 1.5))),
    RoundOrder("ray worker", RAY, AtRandom({RAY_WORKER: 35}, (0.3, 2.5))),
    RoundOrder("raylet", RAY, UntilItIsBack(RAYLET, 2, (1.0, 5.0))),
    RoundOrder("gcs_server", RAY, UntilItIsBack(GCS, 2, (1.0, 5.0))),
    RoundOrder(
        "anything",
        SiteOrder(executor="ray", n_workers=1, n_failures=1000),
        AtRandom(
            {COORDINATOR: 6, DISPATCHER: 8, POOL_WORKER: 10, RAY_WORKER: 8, RAY_AGENT: 1, RAYLET: 1, GCS: 1},
            (0.3, 5.0),
            n_freezes=1,
        ),
        is_choosing=True,
    ),
    RoundOrder("usual leases", SiteOrder(n_workers=1, lease_s=None), OneOfEach()),
)


def run(orders: Sequence[RoundOrder], rng_seed: int) -> dict[str, Any]:
    """Run rounds, tell how each went, and return the summary of all."""
    begin = time.monotonic()
    folder = Path(tempfile.mkdtemp(prefix="chaos-"))
    done = []
    try:
        for number, order in enumerate(orders):
            # Of its own, so that a round can be repeated without those before it.
            random = Random(f"{rng_seed} {order.name}")
            tell(f"round {order.name} ...")
            done.append(run_one(Round(order, folder / str(number), random)))
            tell(f"round {order.name}: {line_of(done[-1])}")
    except (KeyboardInterrupt, SystemExit):
        done.append({"round": order.name, "kills": {}, "faults": ["interrupted"]})
    summary = {"rng_seed": rng_seed, "seconds": round(time.monotonic() - begin, 1)} | added_up(done)
    if summary["faults"]:
        tell(f"archives and logs are in {folder}")
    else:
        shutil.rmtree(folder, ignore_errors=True)
    return summary | {"rounds": done}


def run_one(one: Round) -> dict[str, Any]:
    """Run a round; one that does not come to its end is a fault."""
    try:
        return one.run()
    except RoundError as error:
        return {
            "round": one.order.name,
            "kills": dict(Counter(kill.kind for kill in one.site.kills)),
            "faults": list(error.args[0]),
        }


def added_up(rounds: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Return the sums over rounds, and the worst of what was measured."""
    kills, attempts = Counter(), Counter()
    for one in rounds:
        kills.update(one["kills"])
        attempts.update(one.get("attempts", {}))
    ended = [one for one in rounds if "probes" in one]
    return {
        "n_kills": kills.total(),
        "kills": dict(kills),
        "freezes": sum(one["freezes"] for one in ended),
        "requeues": sum(one["requeues"] for one in ended),
        "stale_reports_refused": sum(one["stale_reports_refused"] for one in ended),
        "campaigns": sum(one["submissions"]["campaigns"] for one in ended),
        "attempts": dict(attempts),
        "executor_back_worst_s": max((s for one in ended for s in one["executor_back_s"]), default=None),
        "next_attempt_usual_lease_s": next(
            (one["next_attempt_s"] for one in ended if one["round"] == "usual leases"), None
        ),
        "probes": {
            "n": sum(one["probes"]["n"] for one in ended),
            "excused": sum(one["probes"]["excused"] for one in ended),
            "failed": sum(one["probes"]["failed"] for one in ended),
            "worst_s": max((one["probes"].get("worst", 0.0) for one in ended), default=None),
        },
        "rounds_as_undisturbed": sum(not one["faults"] for one in rounds),
        "faults": [f"{one['round']}: {fault}" for one in rounds for fault in one["faults"]],
    }


def line_of(one: dict[str, Any]) -> str:
    """Return how a round went, in one line."""
    killed = ", ".join(f"{n} {kind}" for kind, n in one["kills"].items())
    ended = ", ".join(f"{n} {ending}" for ending, n in one.get("attempts", {}).items())
    verdict = "as undisturbed" if not one["faults"] else f"{len(one['faults'])} FAULTS, {one['faults'][0]}"
    return f"killed {killed}; attempts {ended}; {one.get('requeues', 0)} requeued; {verdict}"


def tell(line: str) -> None:
    """Show how far it is."""
    sys.stderr.write(f"{time.strftime('%H:%M:%S')} {line}\n")
    sys.stderr.flush()
