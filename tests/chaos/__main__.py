"""`make chaos`: kill everything that can be killed, and see whether anything was lost."""

import argparse
import json
import secrets
import signal
import sys

from tests.chaos.suite import ROUNDS, run, tell


def main() -> int:
    """Run the rounds that are asked for; return whether something was wrong."""
    names = [order.name for order in ROUNDS]
    parser = argparse.ArgumentParser(prog="python -m tests.chaos", description=__doc__)
    parser.add_argument("--rng-seed", type=int, default=secrets.randbelow(10**6), help="of an earlier run")
    parser.add_argument("--round", action="append", choices=names, help="only this one; may be repeated")
    wanted = parser.parse_args()
    # As after Ctrl-C: what was started is ended.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
    orders = [order for order in ROUNDS if not wanted.round or order.name in wanted.round]
    tell(f"chaos with rng_seed {wanted.rng_seed}")
    summary = run(orders, wanted.rng_seed)
    sys.stdout.write(json.dumps(summary, indent=2) + "\n")
    return 1 if summary["faults"] else 0


if __name__ == "__main__":
    sys.exit(main())
