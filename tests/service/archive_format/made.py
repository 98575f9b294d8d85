"""Archives and files that tests of portable campaigns share."""

import shutil

import pytest

from core.plain_data import content_hash
from service.new_file import write_new
from service.schemas.solution import Filter
from service.spec import spec_from
from service.store.archive_files import packed, pieces
from service.store.store import Store
from tests.acceptance import known
from tests.service.databases import rows
from tests.service.store.test_certificates import EXAMPLE

LATER = {
    "campaign": {"name": "later", "rng_seed": 8},
    "problem": {"preset": "ppe-drm3"},
    "search": [
        {
            "id": "s1-0",
            "strategy": "S(1|0)",
            "outages": [known.OUTAGE],
            "seeds": {"campaign": known.SPEC["campaign"]["name"], "from": "s0"},
        }
    ],
}
#: What is called otherwise in another archive.
LOCAL = {"campaign_id", "search_id"}


def elsewhere(folder):
    (folder / "elsewhere").mkdir()
    return Store(folder / "elsewhere")


def work_to_the_end(store):
    work = known.dispatcher(store)
    while any(item.state == "active" for item in store.campaigns()):
        work.step()


def written(store, campaign, path):
    with packed(store, campaign) as draft:
        write_new(path, pieces(draft))
    return path


@pytest.fixture(scope="module")
def origin(tmp_path_factory):
    """An archive with a campaign of known solutions, and one that lives on its seeds."""
    with Store(tmp_path_factory.mktemp("origin")) as store:
        known.submitted(store)
        work_to_the_end(store)
        store.submit(spec_from(LATER))
        work_to_the_end(store)
        yield store


@pytest.fixture(scope="module")
def certified(origin, tmp_path_factory):
    """The same file after one of its solutions got two certificates, and another got one."""
    folder = tmp_path_factory.mktemp("certified")
    with Store(shutil.copytree(origin.folder, folder / "origin")) as store:
        first, second, *_ = store.certificates.ids(Filter(campaign=1, strict=True))
        for solution_id, at in ((first, 0.0), (first, 1.0), (second, 0.0)):
            store.certificates.add(certificate_on(store, solution_id, at), "there")
        yield store, written(store, 1, folder / "1.zip")


def certificate_on(store, solution_id, min_altitude_km):
    """Return a certificate of a solution that flies without defects."""
    record, example = store.record(solution_id), EXAMPLE.content
    flown = example.trajectories[0].model_copy(update={"defect": 7 * (0.0,)})
    content = example.model_copy(
        update={
            "solution_id": solution_id,
            "problem_hash": record.problem_hash,
            "k": record.k,
            "min_altitude_km": min_altitude_km,
            "trajectories": (1 + record.k) * (flown,),
        }
    )
    return EXAMPLE.model_copy(
        update={"content": content, "hash": content_hash(content.model_dump(mode="json"))}
    )


@pytest.fixture(scope="module")
def files(origin, tmp_path_factory):
    folder = tmp_path_factory.mktemp("files")
    return [written(origin, campaign, folder / f"{campaign}.zip") for campaign in (1, 2)]


def found(store, campaign):
    """Return all records of a campaign and the seeds behind each."""
    records = store.all_records(Filter(campaign=campaign))
    seeds = [store.lineage(record.id) for record in records]
    return [(r.model_dump(exclude=LOCAL), s.nodes, s.edges) for r, s in zip(records, seeds, strict=True)]


def everything(store):
    """Return all rows that a refused file might have changed."""
    tables = ("campaign", "search", "search_case", "problem", "job", "attempt", "provenance", "solve")
    tables += ("solution", "certificate", "seed_link", "tally", "event")
    return {table: sorted(map(str, rows(store, f"SELECT * FROM {table}"))) for table in tables}
