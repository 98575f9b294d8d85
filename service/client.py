"""A client of the API: every answer parsed into the models of `service.schemas`.

`ROUTES` lists what it asks, so that a test can hold it against the OpenAPI document.  Methods are named and
called as those of the store, so that a command can read either.

    ClientError(RuntimeError)   a coordinator that cannot be reached, or that refuses; its text is for people
"""

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any, Literal, Self, TypeVar
from urllib.parse import quote

import httpx
from pydantic import BaseModel, ValidationError

from core.errors import UserError
from service.auth.network import MAX_PORTABLE_BYTES
from service.schemas.campaign import CampaignCards, CampaignItem, CampaignView, ImportView
from service.schemas.job import EventPage, EventView, JobPage, JobView, WorkerPage
from service.schemas.problem import ProblemView
from service.schemas.search import PriorityRequest, WeightRequest
from service.schemas.solution import MissedThrustPage, RecordInFull, RecordPage, Reproduction, SeedPage
from service.spec.spec import SeedChoices
from workers.client import TIMEOUT_S, Api, ApiError, RejectedError
from workers.messages import UnreachableError

A = TypeVar("A", bound=BaseModel)
T = TypeVar("T")
Verb = Literal["pause", "resume", "cancel"]

#: The coordinator makes the departure and the target before it answers a submission [s].
SUBMISSION_S = 180.0
#: A campaign is packed before the first byte of its file comes, and judged before a file is answered [s].
PORTABLE_S = 3600.0
_PORTABLE = httpx.Timeout(TIMEOUT_S, read=PORTABLE_S)
#: Longest silence of a stream, which sends a sign of life every 15 s [s].
SILENCE_S = 40.0


class ClientError(UserError, RuntimeError):
    """A coordinator that cannot be reached, or that rejects a request."""

    def __init__(self, detail: str, status: int | None = None, code: str | None = None) -> None:
        super().__init__(detail)
        #: None where nobody answered.
        self.status = status
        self.code = code


@dataclass(frozen=True, slots=True)
class Route:
    """A route of the API as it is asked here."""

    verb: str
    path: str
    answer: type[BaseModel]
    #: Parameters of the query.
    query: tuple[str, ...] = field(default=())


_ONE = "/campaigns/{campaign_id}"
_SEARCH = _ONE + "/searches/{name}"
_SEEDS = ("campaign", "search", "problem", "outage", "k", "order", "limit", "tolerance", "mapping")
ROUTES = {
    "campaigns": Route("GET", "/campaigns", CampaignCards, ("name",)),
    "campaign": Route("GET", _ONE, CampaignView),
    "submit": Route("POST", "/campaigns", CampaignView),
    **{verb: Route("POST", f"{_ONE}/{verb}", CampaignView) for verb in ("pause", "resume", "cancel")},
    **{
        f"{verb}_search": Route("POST", f"{_SEARCH}/{verb}", CampaignView)
        for verb in ("pause", "resume", "cancel")
    },
    "import_campaign": Route("POST", "/campaigns/import", ImportView),
    "set_campaign_priority": Route("POST", f"{_ONE}/priority", CampaignView),
    "set_search_priority": Route("POST", f"{_SEARCH}/priority", CampaignView),
    "set_search_weight": Route("POST", f"{_SEARCH}/weight", CampaignView),
    "solutions": Route("GET", "/solutions", RecordPage, ("campaign", "search", "strict", "limit", "after")),
    "record": Route("GET", "/solutions/{solution_id}", RecordInFull),
    "reproduction": Route("GET", "/solutions/{solution_id}/reproduction", Reproduction),
    "missed_thrust": Route(
        "GET", "/solutions/{solution_id}/missed-thrust", MissedThrustPage, ("campaign", "limit")
    ),
    "problem": Route("GET", "/problems/{problem_hash}", ProblemView),
    "seeds": Route("GET", "/seeds", SeedPage, _SEEDS),
    "jobs": Route("GET", "/jobs", JobPage, ("campaign", "search", "state", "limit", "after")),
    "job": Route("GET", "/jobs/{job_id}", JobView),
    "cancel_job": Route("POST", "/jobs/{job_id}/cancel", JobView),
    "requeue_job": Route("POST", "/jobs/{job_id}/requeue", JobView),
    "workers": Route("GET", "/workers", WorkerPage),
    "events": Route("GET", "/events", EventPage, ("after", "campaign", "limit")),
    "follow": Route("GET", f"{_ONE}/events", EventView),
}


class Client:
    """A client of one coordinator."""

    def __init__(self, url: str, token: str | None = None) -> None:
        self.url = url.rstrip("/")
        self._api = _named(lambda: Api(url, token))

    def __enter__(self) -> Self:
        """Give the client; its connections are closed at the end of the block."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._api.__exit__(kind, error, trace)

    # What changes something.

    def submit(self, fields: dict[str, Any], key: str | None = None) -> tuple[CampaignView, bool]:
        """Submit a specification; return its campaign, and whether it is new."""
        headers = {"Idempotency-Key": key} if key else {}
        view, status = _named(
            lambda: self._api.ask_for_status(
                "POST", "/campaigns", CampaignView, json=fields, headers=headers, timeout=SUBMISSION_S
            )
        )
        return view, status in (201, 202)

    def import_campaign(self, file: Path) -> ImportView:
        """Upload a portable file, which is imported whole or not at all."""
        more: dict[str, Any] = {"headers": {"Content-Type": "application/zip"}, "timeout": _PORTABLE}
        try:
            n_bytes, content = file.stat().st_size, file.open("rb")
        except OSError as error:
            raise ClientError(f"file {file}: expected a file to send, got {error.strerror}") from error
        with content:
            if n_bytes > MAX_PORTABLE_BYTES:
                raise ClientError(
                    f"file {file}: expected at most {MAX_PORTABLE_BYTES} bytes, got {n_bytes}; stop the "
                    f"coordinator and take it in on its machine, with --data"
                )
            path = ROUTES["import_campaign"].path
            return _named(lambda: self._api.ask("POST", path, ImportView, content=content, **more))

    def control_campaign(self, campaign_id: int, verb: Verb) -> CampaignView:
        """Pause, resume or cancel a campaign."""
        return self._ask(verb, CampaignView, campaign_id=campaign_id)

    def control_search(self, campaign_id: int, search: str, verb: Verb) -> CampaignView:
        """Pause, resume or cancel a search."""
        return self._ask(f"{verb}_search", CampaignView, campaign_id=campaign_id, name=search)

    def set_campaign_priority(self, campaign_id: int, priority: int) -> CampaignView:
        """Set the priority of a campaign; lower goes first."""
        body = PriorityRequest(priority=priority)
        return self._ask("set_campaign_priority", CampaignView, body, campaign_id=campaign_id)

    def set_search_priority(self, campaign_id: int, search: str, priority: int) -> CampaignView:
        """Set the priority of a search; lower goes first."""
        body = PriorityRequest(priority=priority)
        return self._ask("set_search_priority", CampaignView, body, campaign_id=campaign_id, name=search)

    def set_search_weight(self, campaign_id: int, search: str, weight: float) -> CampaignView:
        """Set the share of the workers that a search gets among searches of equal priority."""
        body = WeightRequest(weight=weight)
        return self._ask("set_search_weight", CampaignView, body, campaign_id=campaign_id, name=search)

    def cancel_job(self, job_id: int) -> JobView:
        """Cancel a queued or running job."""
        return self._ask("cancel_job", JobView, job_id=job_id)

    def requeue_job(self, job_id: int) -> JobView:
        """Requeue a dead or cancelled job."""
        return self._ask("requeue_job", JobView, job_id=job_id)

    # What reads.

    def campaigns(self) -> list[CampaignItem]:
        """Return the campaigns, the newest first."""
        cards = self._ask("campaigns", CampaignCards).items
        # Without what only the page shows, as `Store.campaigns` returns them.
        return [CampaignItem.model_validate(card.model_dump()) for card in cards]

    def campaign(self, campaign_id: int) -> CampaignView:
        """Return a campaign with its searches."""
        return self._ask("campaign", CampaignView, campaign_id=campaign_id)

    def export_campaign(self, campaign_id: int) -> Iterator[bytes]:
        """Yield the portable file of a campaign piece by piece."""
        try:
            yield from self._api.pieces(f"{_ONE}/export".format(campaign_id=campaign_id), PORTABLE_S)
        except (ApiError, UnreachableError) as error:
            raise _client_error(error) from error

    def find_campaign(self, name_or_id: str) -> int:
        """Return the newest campaign of a name, or else that of an id."""
        for item in self._ask("campaigns", CampaignCards, name=name_or_id).items:
            # A coordinator of an older version lists all of its campaigns.
            if item.name == name_or_id or (name_or_id.isdecimal() and item.id == int(name_or_id)):
                return item.id
        raise ClientError(
            f"campaign {name_or_id}: expected one that exists, got none with this name or id; see "
            f"`coastarc status --url {self.url}`"
        )

    def solutions(
        self,
        campaign: int | None = None,
        search: str | None = None,
        strict: bool | None = None,
        limit: int = 50,
        after: str | None = None,
    ) -> RecordPage:
        """Return a page of solutions."""
        page = {"campaign": campaign, "search": search, "strict": strict, "limit": limit, "after": after}
        return self._ask("solutions", RecordPage, **page)

    def record(self, solution_id: str) -> RecordInFull:
        """Return a solution with its vector."""
        return self._ask("record", RecordInFull, solution_id=_whole(solution_id))

    def reproduction(self, solution_id: str) -> Reproduction:
        """Return the job that found a solution, and what it gave."""
        return self._ask("reproduction", Reproduction, solution_id=_whole(solution_id))

    def missed_thrust(
        self, solution_id: str, campaign: int | None = None, limit: int = 1
    ) -> MissedThrustPage:
        """Return the newest missed-thrust analyses of a solution, or that of one campaign."""
        asked = {"solution_id": solution_id, "campaign": campaign, "limit": limit}
        return self._ask("missed_thrust", MissedThrustPage, **asked)

    def problem(self, problem_hash: str) -> ProblemView:
        """Return a problem."""
        return self._ask("problem", ProblemView, problem_hash=problem_hash)

    def seeds_of_search(self, campaign_id: int, search: str, wanted: SeedChoices) -> SeedPage:
        """Return what would seed a search, and how."""
        return self._ask("seeds", SeedPage, campaign=campaign_id, search=search, **_choice(wanted))

    def seeds_of_problem(
        self,
        problem_hash: str,
        outages: Sequence[tuple[int, float]] | None,
        seed_k: int | None,
        wanted: SeedChoices,
    ) -> SeedPage:
        """Return which solutions would seed a problem, and how."""
        outage = None if outages is None else [f"{segment}:{days!r}" for segment, days in outages]
        asked = {"problem": problem_hash, "outage": outage, "k": seed_k, **_choice(wanted)}
        return self._ask("seeds", SeedPage, **asked)

    def jobs(
        self, campaign: int | None, search: str | None, state: str | None, limit: int, after: int = 0
    ) -> JobPage:
        """Return a page of jobs."""
        page = {"campaign": campaign, "search": search, "state": state, "limit": limit, "after": after}
        return self._ask("jobs", JobPage, **page)

    def job(self, job_id: int) -> JobView:
        """Return a job."""
        return self._ask("job", JobView, job_id=job_id)

    def workers(self) -> WorkerPage:
        """Return the workers, with what they hold."""
        return self._ask("workers", WorkerPage)

    def events(self, after: int, campaign: int | None = None, limit: int = 200) -> list[EventView]:
        """Return the events that follow an id."""
        return self._ask("events", EventPage, after=after, campaign=campaign, limit=limit).items

    def follow(self, campaign_id: int, after: int | None = None) -> Iterator[EventView]:
        """Return the events of a campaign as they come, until the coordinator ends the stream."""
        headers = {} if after is None else {"Last-Event-ID": str(after)}
        path = ROUTES["follow"].path.format(campaign_id=campaign_id)
        try:
            with self._api.stream(path, headers, SILENCE_S) as lines:
                for line in lines:
                    if line.startswith("data:"):
                        yield EventView.model_validate_json(line.removeprefix("data:"))
        except (UnreachableError, RejectedError) as error:
            raise _client_error(error) from error
        except ValidationError as error:
            raise ClientError(f"events: expected those of this version, got {error}") from error

    def _ask(self, asked: str, answer: type[A], body: BaseModel | None = None, /, **wanted: Any) -> A:
        route = ROUTES[asked]
        query = {key: wanted[key] for key in route.query if wanted.get(key) is not None}
        path = route.path.format(**{key: quote(str(value), safe="") for key, value in wanted.items()})
        return _named(lambda: self._api.ask(route.verb, path, answer, body, params=query, timeout=TIMEOUT_S))


def _whole(solution_id: str) -> str:
    """Return an id, or refuse the beginning of one, which only an archive at hand can complete."""
    if not re.fullmatch("[0-9a-f]{32}", solution_id):
        raise ClientError(
            f"solution {solution_id}: expected all 32 digits of its id with --url, got {len(solution_id)}; "
            f"the page of the solution has them"
        )
    return solution_id


def _choice(wanted: SeedChoices) -> dict[str, Any]:
    mapping = None if wanted.mapping is None else list(wanted.mapping)
    return {"order": wanted.order, "limit": wanted.limit, "tolerance": wanted.tolerance, "mapping": mapping}


def _named(ask: Callable[[], T]) -> T:
    try:
        return ask()
    except (ApiError, UnreachableError) as error:
        raise _client_error(error) from error


def _client_error(error: ApiError | UnreachableError) -> ClientError:
    if isinstance(error, RejectedError):
        advice = "; name a file with one in force by COASTARC_TOKEN_FILE" if error.status == 401 else ""
        return ClientError(f"{error}{advice}", error.status, error.code)
    if isinstance(error, UnreachableError) and error.status is not None:
        return ClientError(str(error), error.status)
    advice = "; start one with `coastarc serve`" if isinstance(error, UnreachableError) else ""
    return ClientError(f"{error}{advice}")
