"""Make the examples of the OpenAPI document: `python -m tests.api_examples`, about a minute.

A small campaign is solved and asked about by each route that has a body or an answer in JSON; what went over
the wire is the example.  The name of this machine and the secret of a token are replaced and long lists are
cut, but no value is made up.
"""

import json
import tempfile
import tomllib
from pathlib import Path
from typing import Any
from unittest.mock import patch

from fastapi.testclient import TestClient

from core.problem import load_problem
from service.app import create_app
from service.auth.network import Access
from service.schemas.identity import Role
from service.solutions.verification import VerificationRequest, verify_solutions
from service.spec.missed_thrust import analysis_spec, grid_of
from service.store.store import Store
from tests.workers.jobs import worker_info
from workers.messages import Claim, CompleteRequest, HandInRequest
from workers.run import run_job

ROOT = Path(__file__).parents[1]
EXAMPLES = ROOT / "service" / "api" / "examples.json"
JSON = "application/json"
#: A longer list is cut after its first few.
LONGEST, SHOWN = 8, 3
HOST, WORKER, ADDRESS = "node7", "node7:4711", "10.0.0.9"
SPEC = """\
[campaign]
name = "quick"
rng_seed = 2026

[problem]
preset = "ppe-drm3"
n_segments = 50

[[search]]
id = "s0"
strategy = "S(0)"
guesses = 6
hops = 2

[[search]]
id = "s1-0"
strategy = "S(1|0)"
outages = [{ segment = 24, duration_days = 1.0 }]
seeds = { from = "s0" }
mapping = "continued"
"""


def example_of(model: Any) -> Any:
    """Return the example of a model."""
    return model.model_validate(json.loads(EXAMPLES.read_text(encoding="utf-8"))["schemas"][model.__name__])


class Recorder:
    """Asks an application and keeps what was sent and answered first by each operation."""

    def __init__(self, store: Store) -> None:
        access = Access(is_open=False)
        token = store.identities.create("operator", Role.ADMIN, 90.0).token
        headers = {"Authorization": f"Bearer {token}"}
        app = create_app(store, access=access)
        self.client = TestClient(app, "http://127.0.0.1:8741", headers=headers, client=(ADDRESS, 50000))
        self._paths = app.openapi()["paths"]
        self.schemas: dict[str, Any] = {}
        self.operations: dict[str, dict[str, Any]] = {}

    def ask(self, line: str, body: Any = None, query: dict[str, Any] | None = None, **names: Any) -> Any:
        """Return the answer of an operation, such as "GET /api/v1/jobs/{job_id}"."""
        verb, path = line.split(" ")
        answer = self.client.request(verb, path.format(**names), json=body, params=query)
        assert answer.is_success, (line, answer.text)
        operation = self._paths[path][verb.lower()]
        if body is not None:
            self._keep(operation["requestBody"], line, "request", body)
        if answer.headers["content-type"] == JSON:
            self._keep(operation["responses"][str(answer.status_code)], line, "answer", answer.json())
            return answer.json()
        return None

    def _keep(self, described: dict[str, Any], line: str, side: str, value: Any) -> None:
        reference = described["content"][JSON]["schema"].get("$ref")
        if reference:
            self.schemas.setdefault(reference.rpartition("/")[2], value)
        else:
            self.operations.setdefault(line, {}).setdefault(side, value)


def work(asks: Recorder, n_jobs: int) -> None:
    """Do so many jobs, as far as there are any."""
    for _ in range(n_jobs):
        for claim in claimed(asks):
            complete(asks, claim)


def claimed(asks: Recorder) -> list[Claim]:
    """Return the next job, or none."""
    claims = asks.ask("POST /api/v1/jobs/claim", {"worker": _worker(), "n_jobs": 1})["claims"]
    return [Claim.model_validate(claim) for claim in claims]


def complete(asks: Recorder, claim: Claim) -> None:
    """Do a job, and report it in each of the two ways in turn."""
    asks.ask("POST /api/v1/jobs/heartbeat", {"worker": _worker(), "held": [_held(claim)]})
    report = CompleteRequest(**_held(claim), outcome=_outcome(asks, claim)).model_dump(mode="json")
    if claim.job_id % 2:
        asks.ask("POST /api/v1/jobs/complete-many", {"reports": [report]})
    else:
        asks.ask("POST /api/v1/jobs/complete", report)


def _worker() -> dict[str, Any]:
    return worker_info(WORKER, slots=8, host=HOST, executor="process").model_dump(mode="json")


def _held(claim: Claim) -> dict[str, int]:
    return {"job_id": claim.job_id, "attempt": claim.attempt}


def _outcome(asks: Recorder, claim: Claim) -> Any:
    def hand_in(part: Any) -> None:
        body = HandInRequest(**_held(claim), part=part).model_dump(mode="json")
        asks.ask("POST /api/v1/jobs/hand-in", body)

    # After every hop instead of every ten seconds.
    with patch("workers.run.HAND_IN_S", 0.0):
        return run_job(claim.job, hand_in=hand_in)


def ask_identity(asks: Recorder) -> None:
    """Ask what concerns the one who asks."""
    made = asks.ask("POST /api/v1/tokens", {"name": "ada", "role": "submitter", "days": 90.0})
    asks.ask("POST /api/v1/session", {"token": made["token"]})
    asks.client.cookies.clear()
    asks.ask("GET /api/v1/session")
    asks.ask("GET /api/v1/tokens")
    asks.ask("DELETE /api/v1/tokens/{name_or_id}", name_or_id="ada")
    asks.ask("GET /api/v1/audit", query={"limit": 1})


def ask_campaign(asks: Recorder, campaign: int) -> None:
    """Ask about a campaign at work and its searches, jobs and workers."""
    one, search = {"campaign_id": campaign}, {"campaign_id": campaign, "name": "s1-0"}
    for what in ("", "/history", "/spec", "/metrics"):
        asks.ask("GET /api/v1/campaigns/{campaign_id}" + what, **one)
    for what in ("", "/hops"):
        asks.ask("GET /api/v1/campaigns/{campaign_id}/searches/{name}" + what, **search)
    for what in ("campaigns", "workers", "queue", "problems"):
        asks.ask(f"GET /api/v1/{what}")
    for what in ("jobs", "attempts", "events"):
        asks.ask(f"GET /api/v1/{what}", query={"limit": 2})
    asks.ask("GET /api/v1/jobs/{job_id}", job_id=1)
    asks.ask("GET /api/v1/jobs/{job_id}/attempts", job_id=1)
    asks.ask("GET /api/v1/seeds", query=one | {"campaign": campaign, "search": "s1-0", "limit": 1})
    asks.ask("POST /api/v1/campaigns/{campaign_id}/priority", {"priority": -1}, **one)
    asks.ask("POST /api/v1/campaigns/{campaign_id}/searches/{name}/weight", {"weight": 2.0}, **search)
    asks.ask("POST /api/v1/campaigns/{campaign_id}/requeue", **one)


def ask_solutions(asks: Recorder, solution: dict[str, Any]) -> None:
    """Ask about solutions, and the problems that they solve."""
    for what in ("points", "clusters", "choices"):
        asks.ask(f"GET /api/v1/solutions/{what}")
    asks.ask("GET /api/v1/solutions", query={"limit": 1})
    for what in ("", "/lineage", "/reproduction", "/certificate", "/missed-thrust"):
        asks.ask("GET /api/v1/solutions/{solution_id}" + what, solution_id=solution["id"])
    asks.ask("GET /api/v1/solutions/{solution_id}/trajectory", solution_id=solution["id"])
    for what in ("", "/structure", "/family"):
        asks.ask("GET /api/v1/problems/{problem_hash}" + what, problem_hash=solution["problem_hash"])


def analysed(asks: Recorder, store: Store, solution: dict[str, Any]) -> None:
    """Certify a solution, and try what one outage does to it."""
    list(verify_solutions(store, [solution["id"]], VerificationRequest()))
    definition, _ = store.definition_and_vector(solution["id"])
    problem = load_problem("ppe-drm3").model_validate(definition)
    fields = analysis_spec(solution["id"], problem, grid_of(problem, "40", "1"))
    asks.ask("POST /api/v1/campaigns", fields)
    work(asks, 9)


def as_shown(value: Any) -> Any:
    """Return a value with long lists cut."""
    if isinstance(value, dict):
        return {name: as_shown(part) for name, part in value.items()}
    if isinstance(value, list):
        return [as_shown(part) for part in (value if len(value) <= LONGEST else value[:SHOWN])]
    return value


def recorded(folder: str, other_folder: str) -> dict[str, Any]:
    """Return the examples by schema, and by operation where a body or an answer has no schema of its own."""
    with Store(Path(folder)) as store, Store(Path(other_folder)) as other:
        asks = Recorder(store)
        ask_identity(asks)
        asks.ask("POST /api/v1/specs/check", {"text": SPEC})
        asks.ask("GET /api/v1/specs/templates")
        asks.ask(
            "POST /api/v1/problems",
            {"preset": "ppe-drm3", "outages": [{"segment": 24, "duration_days": 1.0}]},
        )
        campaign = asks.ask("POST /api/v1/campaigns", tomllib.loads(SPEC))["id"]
        asks.schemas.pop("CampaignView")
        work(asks, 6)
        running = claimed(asks)
        solution = asks.ask("GET /api/v1/solutions", query={"limit": 1, "k": 1})["items"][0]
        ask_campaign(asks, campaign)
        for claim in running:
            complete(asks, claim)
        analysed(asks, store, solution)
        ask_solutions(asks, solution)
        archive = asks.client.get(f"/api/v1/campaigns/{campaign}/export").content
        taken = Recorder(other).client.post("/api/v1/campaigns/import", content=archive)
        assert taken.is_success, taken.text
        asks.schemas["ImportView"] = taken.json()
        return as_shown({"schemas": asks.schemas, "operations": asks.operations})


def main() -> None:
    with (
        tempfile.TemporaryDirectory() as folder,
        tempfile.TemporaryDirectory() as other_folder,
        patch("platform.node", return_value=HOST),
    ):
        found = recorded(folder, other_folder)
    text, secret = json.dumps(found, indent=1), found["schemas"]["NewToken"]["token"]
    EXAMPLES.write_text(text.replace(secret, secret[:-43] + 43 * "x") + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
