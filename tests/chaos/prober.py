"""Asks the coordinator twice a second whether it answers, and knows when it could not."""

import threading
import time
from dataclasses import dataclass, field

import httpx

from tests.chaos.site import Site

PATHS = ("/healthz", "/api/v1/campaigns")
PERIOD_S, TIMEOUT_S = 0.5, 15.0


@dataclass
class Probes:
    """What was asked and answered."""

    seconds: list[float] = field(default_factory=list)
    #: While the coordinator was killed or starting.
    n_excused: int = 0
    failures: list[str] = field(default_factory=list)
    #: From a kill of the coordinator to its first answer [s].
    absences: list[float] = field(default_factory=list)


class Prober:
    """A thread beside a round; its probes that fail while the coordinator lives are faults."""

    def __init__(self, site: Site) -> None:
        self.probes = Probes()
        self._site = site
        #: The last kill after which an answer has come.
        self._answered = float("-inf")
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="prober")
        self._http = httpx.Client(
            timeout=TIMEOUT_S, trust_env=False, limits=httpx.Limits(max_keepalive_connections=0)
        )

    def __enter__(self):
        # The coordinator is only starting.
        self._site.last_kill = time.monotonic()
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._stop.set()
        self._thread.join()
        self._http.close()

    def is_answered(self) -> bool:
        """Return whether the coordinator that was started last has answered."""
        return self._answered == self._site.last_kill

    def stop(self) -> None:
        """Ask no more, since the coordinator is about to be stopped."""
        self._stop.set()
        self._thread.join()

    def _run(self) -> None:
        while not self._stop.wait(PERIOD_S if self.is_answered() else PERIOD_S / 2):
            for path in PATHS:
                self._probe(path)

    def _probe(self, path: str) -> None:
        was_up, last_kill, asked = self.is_answered(), self._site.last_kill, time.monotonic()
        try:
            status = self._http.get(self._site.url + path).status_code
            fault = None if status == 200 else f"status {status}"
        except httpx.TransportError as error:
            fault = type(error).__name__
        now = time.monotonic()
        if fault is None:
            self.probes.seconds.append(now - asked)
            if not was_up and self._site.last_kill == last_kill and last_kill <= asked:
                self._answered = last_kill
                self.probes.absences.append(now - last_kill)
        elif was_up and self._site.last_kill == last_kill:
            self.probes.failures.append(f"{path}: {fault} after {now - asked:.2f} s")
        else:
            self.probes.n_excused += 1
