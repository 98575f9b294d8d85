"""The coordinator that `benchmarks.service` measures: a process of its own, without a dispatcher.

`python -m benchmarks.server FOLDER READERS` prints its address, a worker's token and tokens for so many
readers, and ends with its input.
"""

import json
import secrets
import sys
from pathlib import Path

from service import logs
from service.coordinator import Coordinator
from service.schemas.identity import Role


def main() -> None:
    """Serve until nobody holds the other end of the input."""
    logs.configure(level="WARNING")
    with Coordinator(Path(sys.argv[1])) as coordinator:
        # A folder may have been measured before.
        name = f"simulated workers {secrets.token_hex(4)}"
        identities = coordinator.store.identities
        token = identities.create(name, Role.WORKER, 30.0).token
        viewers = [
            identities.create(f"{name}, reader {number}", Role.VIEWER, 30.0).token
            for number in range(int(sys.argv[2]))
        ]
        sys.stdout.write(json.dumps({"url": coordinator.url, "token": token, "readers": viewers}) + "\n")
        sys.stdout.flush()
        sys.stdin.read()


if __name__ == "__main__":
    main()
