"""A campaign as a file: taken in elsewhere with the same hashes and seeds, or refused whole."""

import hashlib
import json
import zipfile

import pytest

from core.problem import load_problem
from service.archive_format.container import PortableError, Unpacked
from service.archive_format.lines import CampaignLine, ProvenanceLine, SearchLine
from service.db.engine import place_of
from service.db.tables import Base
from service.integrity.check import check
from service.new_file import FileError
from service.schemas.solution import Filter
from service.spec import spec_from
from service.store.archive_files import import_file
from service.store.archive_io import (
    ATTEMPT_COLUMNS,
    CERTIFICATE_COLUMNS,
    JOB_COLUMNS,
    SOLUTION_COLUMNS,
    SOLVE_COLUMNS,
)
from tests.acceptance import known
from tests.service.archive_format.made import (
    certificate_on,
    elsewhere,
    everything,
    found,
    work_to_the_end,
    written,
)
from tests.service.archive_format.test_refused import CAMPAIGN, forged
from tests.service.campaigns import finish, spec_fields, submitted
from tests.service.databases import needs_postgres, rows
from tests.service.store.test_seeds_elsewhere import run_in_vain
from workers.executor import Inline


def test_another_archive_gets_the_same_hashes_solutions_and_seeds(origin, files, store):
    submitted(store, spec_fields(campaign={"name": "something else", "rng_seed": 1}))
    finish(store)
    taken = import_file(store, files[0])
    assert (taken.campaign_id, taken.new_campaigns) == (2, ["known solutions"])
    assert found(store, 2) == found(origin, 1) and len(found(store, 2)) == 4
    assert store.spec_fields(2) == origin.spec_fields(1)
    here, there = (one.campaign(key).model_dump() for one, key in ((store, 2), (origin, 1)))
    for one, other in zip(here["searches"], there["searches"], strict=True):
        assert {**one, "id": 0, "cpu_seconds": 0} == {**other, "id": 0, "cpu_seconds": 0}
        assert one["cpu_seconds"] == pytest.approx(other["cpu_seconds"], rel=1e-12)  # summed in another order


def test_what_was_taken_in_passes_the_check_of_the_archive(files, store):
    import_file(store, files[1])
    assert {entry.state for entry in check(place_of(store.folder))} == {"ok"}


def test_campaigns_that_give_the_seeds_come_along(origin, files, store):
    taken = import_file(store, files[1])
    assert taken.new_campaigns == ["known solutions", "later"]
    (record, *_), (same, *_) = (one.all_records(Filter(campaign=2)) for one in (store, origin))
    assert store.lineage(record.id) == origin.lineage(same.id)
    assert store.lineage(record.id).edges[0].seed_id == record.seed_id
    assert store.campaign(2).searches[0].seeds_from == "known solutions/s0"


def test_a_second_time_nothing_is_new_and_what_is_there_is_not_touched(files, store):
    import_file(store, files[0])
    before = everything(store)
    assert import_file(store, files[0])[1:] == ([], 0, 0, 0)
    assert everything(store) == before
    assert import_file(store, files[1]).new_campaigns == ["later"]


@pytest.mark.parametrize(
    "store",
    ["sqlite", pytest.param("postgresql", marks=[pytest.mark.postgres, needs_postgres])],
    indirect=True,
)
def test_exported_again_from_another_archive_it_is_the_same_file(origin, files, store, tmp_path):
    import_file(store, files[1])
    assert written(store, 2, tmp_path / "again.zip").read_bytes() == files[1].read_bytes()
    assert written(store, 1, tmp_path / "first.zip").read_bytes() == files[0].read_bytes()
    assert found(store, 2) == found(origin, 2)
    # Its ids go on where those of the file end.
    assert submitted(store) == 3


@pytest.mark.parametrize(
    "store",
    ["sqlite", pytest.param("postgresql", marks=[pytest.mark.postgres, needs_postgres])],
    indirect=True,
)
def test_certificates_come_along_and_go_on_as_the_same_file(certified, store, tmp_path):
    origin, file = certified
    assert import_file(store, file).n_certificates == 3
    for solution_id in store.certificates.ids(Filter(campaign=1)):
        here, there = (one.certificates.latest(solution_id) for one in (store, origin))
        assert here == (there and there.model_copy(update={"is_from_elsewhere": True}))
    assert not store.certificates.sound_on("there")  # each installation verifies for itself
    assert written(store, 1, tmp_path / "again.zip").read_bytes() == file.read_bytes()


def test_a_certificate_that_is_found_again_here_is_of_here(certified, store):
    origin, file = certified
    import_file(store, file)
    solution_id = next(one for one in store.certificates.ids(Filter()) if store.certificates.latest(one))
    assert store.certificates.latest(solution_id).is_from_elsewhere
    assert not store.certificates.add(certificate_on(origin, solution_id, 0.0), "here")
    assert store.certificates.sound_on("here") == {solution_id}


def test_certificates_made_later_reach_a_campaign_that_is_there(files, certified, store, tmp_path):
    import_file(store, files[0])
    assert import_file(store, certified[1])[1:] == ([], 0, 0, 3)
    assert import_file(store, certified[1])[1:] == ([], 0, 0, 0)
    assert written(store, 1, tmp_path / "again.zip").read_bytes() == certified[1].read_bytes()


def test_only_a_file_with_certificates_asks_for_a_newer_reader(files, certified):
    for file, version in ((files[0], 1), (certified[1], 2)):
        with Unpacked(file) as unpacked:
            assert unpacked.manifest.version == version


def test_the_file_is_readable_without_coastarc(origin, files):
    record = origin.all_records(Filter(search="s1-0"))[0]
    with zipfile.ZipFile(files[0]) as packed:
        assert packed.testzip() is None
        assert {info.date_time for info in packed.infolist()} == {(1980, 1, 1, 0, 0, 0)}
        solutions = [json.loads(line) for line in packed.read("solutions.ndjson").splitlines()]
        manifest = json.loads(packed.read("manifest.json"))
        for name, member in manifest["members"].items():
            content = packed.read(name)
            digest = hashlib.blake2b(content, digest_size=16).hexdigest()
            assert member == {"n_bytes": len(content), "blake2b": digest}
    assert record.x in [one["x"] for one in solutions]


# What is exported.

#: Columns that lines have under their own names, and those that follow from others or are of one archive.
TAKEN = {
    "campaign": CampaignLine.model_fields,
    "search": SearchLine.model_fields,
    "job": JOB_COLUMNS,
    "attempt": ATTEMPT_COLUMNS,
    "solve": SOLVE_COLUMNS,
    "solution": SOLUTION_COLUMNS,
    "provenance": ProvenanceLine.model_fields,
    "certificate": CERTIFICATE_COLUMNS,
}
OTHERWISE = {
    "campaign": {"id", "name", "rng_seed"},
    "search": {"id", "campaign_id", "position", "strategy", "source_id", "served_s"}
    | {"n_planned", "n_solves", "cpu_seconds"},
    "job": {"id", "search_id", "case_index", "seed_id", "not_before", "lease_until", "is_cancelling"}
    # Without it a chain begins anew; the hops that it has are known, and not stored twice.
    | {"place"},
    "attempt": {"job_id", "provenance_hash", "claimed_by"},
    "solve": {"id", "job_id", "search_id", "defects", "solution_id", "final_mass_kg"},
    "solution": {"problem_hash", "x", "defects", "created_at"},
    "provenance": set(),
    "certificate": {"solution_id", "basis", "level", "is_sound", "content"},
}
#: Tables that follow from these, or that stay behind.
FOLLOW = {"problem", "search_case", "seed_link", "tally"}
STAY = {"event", "worker", "submission", "token", "session", "audit"}


def test_no_table_and_no_column_is_forgotten():
    tables = {name: {column.name for column in t.columns} for name, t in Base.metadata.tables.items()}
    assert set(tables) - FOLLOW - STAY == set(TAKEN)
    for name, columns in OTHERWISE.items():
        assert tables[name] == columns | (set(TAKEN[name]) & tables[name]), name


def test_a_campaign_at_work_is_paused_first_and_goes_on_elsewhere(origin, store, tmp_path):
    known.submitted(store)
    known.dispatcher(store).step()
    with pytest.raises(
        PortableError, match=r"expected state paused, done or cancelled, got active; .* pause"
    ):
        written(store, 1, tmp_path / "busy.zip")
    store.control_campaign(1, "pause")
    work = known.dispatcher(store)
    while store.jobs(1, None, "running", 1).items:
        work.step()
    file = written(store, 1, tmp_path / "paused.zip")
    with elsewhere(tmp_path) as other:
        import_file(other, file)
        other.control_campaign(1, "resume")
        work_to_the_end(other)
        assert {record.id for record in other.all_records(Filter())} == {
            record.id for record in origin.all_records(Filter(campaign=1))
        }


def test_a_file_that_exists_is_not_replaced(origin, files):
    before = files[0].read_bytes()
    with pytest.raises(FileError, match="expected a new file, got one that exists"):
        written(origin, 1, files[0])
    assert files[0].read_bytes() == before


def test_the_kernel_of_a_target_travels_with_its_campaign(store, tmp_path):
    kernel = tmp_path / "mine.bsp"
    kernel.write_bytes(b"orbit" * 1000)
    fields = spec_fields(campaign={"name": "own target", "rng_seed": 3})
    fields["problem"] |= {"target": {"kind": "spk", "path": str(kernel), "naif_id": -7}}
    store.submit(spec_from(fields, allow_files=True))
    finish(store, Inline(run_in_vain))
    file = written(store, 1, tmp_path / "own.zip")
    with elsewhere(tmp_path) as other:
        import_file(other, file)
        (stored,) = rows(other, "SELECT spec FROM campaign")
        target = json.loads(stored[0])["problem"]["target"]
        digest = hashlib.blake2b(kernel.read_bytes(), digest_size=16).hexdigest()
        assert target["path"] == str(tmp_path / "elsewhere" / "targets" / f"{digest}.bsp")
        assert (tmp_path / "elsewhere" / "targets" / f"{digest}.bsp").read_bytes() == kernel.read_bytes()
        assert written(other, 1, tmp_path / "again.zip").read_bytes() == file.read_bytes()
    assert str(tmp_path).encode() not in file.read_bytes()


def with_a_world_of_its_own(folder):
    """Return the fields of a campaign whose world and whose target have kernels."""
    (folder / "moon.bsp").write_bytes(b"moon" * 1000)
    (folder / "mine.bsp").write_bytes(b"orbit" * 1000)
    fields = spec_fields(campaign={"name": "own world", "rng_seed": 3})
    departure = load_problem("ppe-drm3").departure.model_dump(mode="json")
    return fields | {
        "problem": fields["problem"]
        | {"world": {"bodies": ["MOON"], "kernel": str(folder / "moon.bsp")}, "departure": departure}
        | {"target": {"kind": "spk", "path": str(folder / "mine.bsp"), "naif_id": -7}}
    }


def test_the_kernel_of_a_world_travels_with_its_campaign(store, tmp_path):
    spec = spec_from(with_a_world_of_its_own(tmp_path), allow_files=True)
    store.submit(spec)
    finish(store, Inline(run_in_vain))
    file = written(store, 1, tmp_path / "own.zip")
    with elsewhere(tmp_path) as other:
        import_file(other, file)
        (stored,) = rows(other, "SELECT spec FROM campaign")
        fields = json.loads(stored[0])
        digest = hashlib.blake2b(b"moon" * 1000, digest_size=16).hexdigest()
        kernel = tmp_path / "elsewhere" / "targets" / f"{digest}.bsp"
        assert fields["problem"]["world"]["kernel"] == str(kernel)
        assert kernel.read_bytes() == b"moon" * 1000
        assert spec_from(fields, allow_files=True).hash == spec.hash
        assert written(other, 1, tmp_path / "again.zip").read_bytes() == file.read_bytes()
    assert str(tmp_path).encode() not in file.read_bytes()


@pytest.mark.parametrize(("table", "key"), [("target", "path"), ("world", "kernel")])
def test_a_file_of_this_machine_is_not_read_for_somebody_elses_campaign(store, tmp_path, table, key):
    store.submit(spec_from(with_a_world_of_its_own(tmp_path), allow_files=True))
    finish(store, Inline(run_in_vain))
    file = written(store, 1, tmp_path / "own.zip")

    def change(lines):
        lines[0]["spec"]["problem"][table][key] = "/etc/passwd"

    with elsewhere(tmp_path) as other:
        with pytest.raises(PortableError, match=f"^{table}: expected a kernel in the same file, got '/etc"):
            import_file(other, forged(file, tmp_path / "forged.zip", change, CAMPAIGN))
        assert not list((tmp_path / "elsewhere").glob("targets/*"))
