"""Where a solution came from, what came of it, and all that a second run of its job needs."""

from pydantic import Field

from service.api.schemas import Answer, Lineage, LineageNode
from workers.job import Job


class Child(LineageNode):
    """A solution that was found from this one as its seed."""

    mapping: str


class LineageGraph(Lineage):
    """All seeds behind a solution, and the solutions that it seeded itself."""

    #: The ones of most final mass, at most as many as were asked for.
    children: list[Child]
    #: All of them; one found by two mappings counts twice.
    n_children: int
    #: Solves that started from it, whatever came of them.
    n_mapped: int
    #: What runs its job again on this machine and compares every bit.
    command: str


class Reproduction(Answer):
    """The job that found a solution, as it was handed out, and what it gave."""

    id: str
    problem_hash: str
    job: Job
    #: The hop of the job that found it.
    hop: int
    x: list[float] = Field(description="Paper layout: days, throttle [-], angles [rad], kg")
    #: Name of the `core.nlp.ExitStatus` with which the solve ended.
    status: str
    cpu_seconds: float
    code_version: str
    python_version: str
    package_versions: dict[str, str]
    kernel_hashes: dict[str, str]
    host: str
