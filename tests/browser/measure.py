"""What the pages cost on an archive of any size, printed as JSON: `make pages`.

`python -m tests.browser.measure --solves 1000000 --minutes 60` fills an archive with made-up solves, serves
it from another process, and opens each page three times in browsers that know nothing and three times in one
that was there before.  Then it leaves one campaign's page open while simulated workers hand in outcomes, and
measures its heap after a collection of garbage.
"""

import argparse
import json
import multiprocessing
import platform
import statistics
import subprocess
import sys
import tempfile
import time
import urllib.request
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from playwright.sync_api import sync_playwright

from benchmarks.archive import fill
from benchmarks.load import Load, run_workers
from benchmarks.probe import campaign
from service.spec import spec_from
from tests.browser.conftest import CHROMIUM, FLAGS
from workers.messages import WorkerInfo
from workers.provenance import code_version, machine

PAGES = {
    "campaigns": "/",
    "campaign": "/campaigns/1",
    "search": "/campaigns/1/searches/s0",
    "archive": "/archive?campaign=1",
    "workers": "/workers",
}
VISITS = 3
#: Visits after which a browser keeps what it made of a page's scripts.
VISITS_BEFORE = 3
SIZE = {"width": 1280, "height": 900}
#: A page or a simulated worker that is later than this has stopped [s].
LONGEST_S = 30.0
SENT = (
    "performance.getEntriesByType('navigation').concat(performance.getEntriesByType('resource'))"
    ".reduce((sum, entry) => sum + entry.transferSize, 0)"
)
#: Solves that a campaign's page tells of, over its searches.
SOLVES = "[...document.querySelectorAll('[data-search]')].reduce((n, row) => n + +row.dataset.solves, 0)"
#: What a page says first of its campaign, archive or workers.
WORDS = "#facts .fact, #campaigns .campaign, #solutions tr[data-id]"
PAINT = "performance.getEntriesByName('first-contentful-paint')[0].startTime"


@contextmanager
def served(folder):
    """Serve a folder from another process; give what it says of itself."""
    command = [sys.executable, "-m", "benchmarks.server", str(folder)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as server:
        told = json.loads(server.stdout.readline())
        # After a start an archive is read for a while.
        while not is_read(told["url"]):
            time.sleep(0.5)
        yield told
        server.stdin.close()


def is_read(url):
    """Return whether the service has read the whole campaign."""
    with urllib.request.urlopen(f"{url}/api/v1/campaigns/1/history") as answer:
        history = json.load(answer)
    return history["n_read"] >= history["n_solves"]


def visit(context, url):
    """Return what one visit took."""
    page = context.new_page()
    began = time.monotonic()
    page.goto(url)
    page.wait_for_selector(WORDS, timeout=300_000)
    words = time.monotonic() - began
    page.wait_for_selector("body[data-refreshed]", timeout=300_000)
    found = {
        "first_paint_ms": page.evaluate(PAINT),
        "words_s": words,
        "shown_s": time.monotonic() - began,
        "sent_bytes": page.evaluate(SENT),
    }
    page.close()
    return found


def first_visits(browser, url):
    """Return the medians of some visits, each by a browser without a cache of files."""
    every = []
    for _ in range(VISITS):
        with browser.new_context(viewport=SIZE) as context:
            every.append(visit(context, url))
    return medians(every)


def later_visits(context, url):
    """Return the medians of some visits by a browser that was there before."""
    every = [visit(context, url) for _ in range(VISITS_BEFORE + VISITS)]
    return medians(every[VISITS_BEFORE:])


def medians(every):
    return {name: statistics.median(one[name] for one in every) for name in every[0]}


@contextmanager
def load(told, rate_per_s):
    """Have simulated workers hand in so many outcomes a second."""
    info = WorkerInfo(
        name="simulated", host="localhost", executor="inline", slots=1,
        code_version=code_version(), python_version=platform.python_version(),
    )  # fmt: skip
    context = multiprocessing.get_context("spawn")
    n_done, stop, results = context.Value("q", 0), context.Event(), context.Queue()
    told = Load(told["url"], told["token"], info, 4, 4, rate_per_s, 0.3)
    workers = context.Process(target=run_workers, args=(told, n_done, stop, results), daemon=True)
    workers.start()
    yield n_done
    stop.set()
    results.get(timeout=60)
    workers.join(60)


def lateness(page, n_solves):
    """Return how long it takes until the page tells of as many solves as are stored now [s]."""
    began = time.monotonic()
    # The page's policy lets nothing be evaluated in it, so it is asked from outside.
    while page.evaluate(SOLVES) < n_solves and time.monotonic() < began + LONGEST_S:
        page.wait_for_timeout(20)
    return time.monotonic() - began


def growth(browser, told, minutes, rate_per_s):
    """Return heap, elements and delay of a campaign's page, by time, while outcomes come in."""
    page = browser.new_context(viewport=SIZE).new_page()
    page.goto(told["url"] + "/campaigns/1")
    page.wait_for_selector("body[data-refreshed]", timeout=300_000)
    tools = page.context.new_cdp_session(page)
    samples, before = [], page.evaluate(SOLVES)
    with load(told, rate_per_s) as n_done:
        began = time.monotonic()
        while not n_done.value:
            if time.monotonic() > began + LONGEST_S:
                raise SystemExit(
                    f"expected an outcome of the simulated workers within {LONGEST_S:.0f} s, got none"
                )
            page.wait_for_timeout(100)
        began = time.monotonic()
        for share in np.linspace(0.0, 1.0, 13):
            page.wait_for_timeout(max(0.0, 1e3 * (began + 60.0 * minutes * share - time.monotonic())))
            late_s = lateness(page, before + n_done.value)
            tools.send("HeapProfiler.collectGarbage")
            samples.append({
                "minutes": (time.monotonic() - began) / 60.0,
                "n_outcomes": n_done.value,
                "result_shown_s": late_s,
                "heap_mb": tools.send("Runtime.getHeapUsage")["usedSize"] / 1e6,
                "n_nodes": tools.send("Memory.getDOMCounters")["nodes"],
            })  # fmt: skip
    page.context.close()
    return samples


def main():
    """Measure, and print."""
    wanted = argparse.ArgumentParser(description=__doc__)
    wanted.add_argument("--solves", type=int, default=10_000, help="in the archive; 0.3 of them solutions")
    wanted.add_argument("--minutes", type=float, default=0.0, help="how long outcomes come in; 0: not at all")
    wanted.add_argument("--rate", type=float, default=2.0, help="outcomes a second")
    wanted.add_argument("--folder", type=Path, help="where the archive is made, or lies from an earlier run")
    asked = wanted.parse_args()
    with tempfile.TemporaryDirectory() as temporary, sync_playwright() as playwright:
        folder = asked.folder or Path(temporary) / "archive"
        if not (folder / "coastarc.db").exists():
            spec = spec_from(campaign("bench", 10_000_000, 1))
            fill(folder, spec, asked.solves, np.random.default_rng(1), is_done=False)
        chromium = playwright.chromium
        browser = chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        with served(folder) as told:
            urls = {name: told["url"] + path for name, path in PAGES.items()}
            found = {"machine": machine(), "n_solves": asked.solves}
            found["first_visits"] = {name: first_visits(browser, url) for name, url in urls.items()}
            with chromium.launch_persistent_context(
                Path(temporary) / "browser", executable_path=CHROMIUM, args=FLAGS, viewport=SIZE
            ) as context:
                found["later_visits"] = {name: later_visits(context, url) for name, url in urls.items()}
            if asked.minutes:
                found["growth"] = growth(browser, told, asked.minutes, asked.rate)
        browser.close()
    sys.stdout.write(json.dumps(found, indent=2) + "\n")


if __name__ == "__main__":
    main()
