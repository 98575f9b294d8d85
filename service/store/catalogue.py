"""Problems and jobs, as lists."""

from sqlalchemy import ColumnElement, Select, literal, literal_column, select, true, union_all
from sqlalchemy.orm import Session, aliased

from service.db.tables import JOB_STATES, AttemptRow, JobRow, ProblemRow, SearchRow
from service.schemas.job import JobPage, JobView
from service.schemas.problem import OutageView, ProblemItem, ProblemPage, ProblemView
from service.store.errors import StoreError, UnknownRow

#: What a job's view takes from other rows.
ELSEWHERE = ("campaign_id", "search", "error")

_Next, _Each = aliased(JobRow), aliased(JobRow)


def list_problems(session: Session, limit: int = 200) -> ProblemPage:
    """Return the problems, those with few outages first."""
    rows = session.scalars(select(ProblemRow).order_by(ProblemRow.k, ProblemRow.hash).limit(limit))
    return ProblemPage(items=[_item(row) for row in rows])


def get_problem(session: Session, problem_hash: str) -> ProblemView:
    """Return a problem with every field written out."""
    row = session.get(ProblemRow, problem_hash)
    if row is None:
        raise UnknownRow("problem", problem_hash)
    return ProblemView(**_item(row).model_dump(), definition=row.definition)


def _item(row: ProblemRow) -> ProblemItem:
    outages = [OutageView(**outage) for outage in row.definition["outages"]]
    return ProblemItem(hash=row.hash, k=row.k, outages=outages, n_segments=row.n_segments)


def list_jobs(
    session: Session, campaign: int | None, search: str | None, state: str | None, limit: int, after: int
) -> JobPage:
    """Return a page of jobs in order of id."""
    query = _jobs().where(JobRow.id > after).order_by(JobRow.id).limit(limit + 1)
    if state is not None:
        is_in(state)
    if campaign is not None or search is not None or state is not None:
        query = query.where(JobRow.id.in_(_next_of_each(campaign, search, state, limit + 1, after)))
    jobs = [_job(*row) for row in session.execute(query)]
    return JobPage(items=jobs[:limit], next=jobs[limit - 1].id if len(jobs) > limit else None)


def _next_of_each(
    campaign: int | None, search: str | None, state: str | None, number: int, after: int
) -> Select[int]:
    """Return the next jobs of each search in each state, among which are the next of all of them.

    A search has its jobs by state in an index; without it one page might take a walk over all jobs.
    """
    names = JOB_STATES if state is None else (state,)
    states = union_all(*(select(literal(name).label("state")) for name in names)).subquery("wanted")
    following = (
        select(_Next.id)
        .where(_Next.search_id == SearchRow.id, _Next.state == states.c.state, _Next.id > after)
        .order_by(_Next.id)
        .limit(number)
        .correlate(SearchRow, states)
    )
    found = select(_Each.id).select_from(SearchRow).join(states, true()).join(_Each, _Each.id.in_(following))
    if campaign is not None:
        found = found.where(SearchRow.campaign_id == campaign)
    return found if search is None else found.where(SearchRow.name == search)


def is_in(state: str) -> ColumnElement[bool]:
    """Return the condition that a job is in a state, as text: only then is the index of that state used."""
    if state not in JOB_STATES:
        raise StoreError(f"state: expected one of {', '.join(JOB_STATES)}, got {state!r}")
    return JobRow.state == literal_column(f"'{state}'")


def get_job(session: Session, job_id: int) -> JobView:
    """Return a job."""
    found = session.execute(_jobs().where(JobRow.id == job_id)).first()
    if found is None:
        raise UnknownRow("job", job_id)
    return _job(*found)


def _jobs() -> Select[JobRow, int, str, str | None]:
    is_last = (AttemptRow.job_id == JobRow.id) & (AttemptRow.attempt == JobRow.attempt)
    return (
        select(JobRow, SearchRow.campaign_id, SearchRow.name, AttemptRow.error)
        .join(SearchRow, SearchRow.id == JobRow.search_id)
        .outerjoin(AttemptRow, is_last)
    )


def _job(row: JobRow, campaign_id: int, search: str, error: str | None) -> JobView:
    # The last line of a traceback names the exception, what comes before it only where.
    shown = error.strip().splitlines()[-1] if error else None
    columns = {name: getattr(row, name) for name in JobView.model_fields if name not in ELSEWHERE}
    columns["not_before"] = row.not_before or None
    return JobView(**columns, campaign_id=campaign_id, search=search, error=shown)
