"""The command `coastarc` with workers that answer without a solver, for tests that start real processes."""

import sys

from service import cli, cli_run
from workers.process_pool import ProcessPool


def main():
    runner = sys.argv.pop(1)
    cli_run.ProcessPool = lambda n_workers: ProcessPool(n_workers, f"tests.workers.fake:{runner}")
    cli.main()


if __name__ == "__main__":
    main()
