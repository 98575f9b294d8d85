"""A campaign as a file: taken in elsewhere with the same hashes and seeds, or refused whole."""

import hashlib
import json
import shutil
import zipfile

import pytest

from core.problem import content_hash
from service.db.check import check
from service.db.place import place_of
from service.db.tables import Base
from service.new_file import FileError, write_new
from service.portable import container
from service.portable.container import Unpacked
from service.portable.errors import PortableError
from service.portable.files import packed, pieces, take_in_file
from service.portable.lines import CampaignLine, ProvenanceLine, SearchLine
from service.spec import spec_from
from service.store import Store
from service.store.filter import Filter
from service.store.portable_rows import (
    ATTEMPT_COLUMNS,
    CERTIFICATE_COLUMNS,
    JOB_COLUMNS,
    SOLUTION_COLUMNS,
    SOLVE_COLUMNS,
)
from tests.acceptance import known
from tests.service.campaigns import finish, spec_fields, submitted
from tests.service.databases import needs_postgres, rows
from tests.service.store.test_certificates import EXAMPLE
from tests.service.store.test_seeds_elsewhere import run_in_vain
from workers.inline import Inline

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


def test_another_archive_gets_the_same_hashes_solutions_and_seeds(origin, files, store):
    submitted(store, spec_fields(campaign={"name": "something else", "rng_seed": 1}))
    finish(store)
    taken = take_in_file(store, files[0])
    assert (taken.campaign_id, taken.new_campaigns) == (2, ["known solutions"])
    assert found(store, 2) == found(origin, 1) and len(found(store, 2)) == 4
    assert store.spec_fields(2) == origin.spec_fields(1)
    here, there = (one.campaign(key).model_dump() for one, key in ((store, 2), (origin, 1)))
    for one, other in zip(here["searches"], there["searches"], strict=True):
        assert {**one, "id": 0, "cpu_seconds": 0} == {**other, "id": 0, "cpu_seconds": 0}
        assert one["cpu_seconds"] == pytest.approx(other["cpu_seconds"], rel=1e-12)  # summed in another order


def test_what_was_taken_in_passes_the_check_of_the_archive(files, store):
    take_in_file(store, files[1])
    assert {entry.state for entry in check(place_of(store.folder))} == {"ok"}


def test_campaigns_that_give_the_seeds_come_along(origin, files, store):
    taken = take_in_file(store, files[1])
    assert taken.new_campaigns == ["known solutions", "later"]
    (record, *_), (same, *_) = (one.all_records(Filter(campaign=2)) for one in (store, origin))
    assert store.lineage(record.id) == origin.lineage(same.id)
    assert store.lineage(record.id).edges[0].seed_id == record.seed_id
    assert store.campaign(2).searches[0].seeds_from == "known solutions/s0"


def test_a_second_time_nothing_is_new_and_what_is_there_is_not_touched(files, store):
    take_in_file(store, files[0])
    before = everything(store)
    assert take_in_file(store, files[0])[1:] == ([], 0, 0, 0)
    assert everything(store) == before
    assert take_in_file(store, files[1]).new_campaigns == ["later"]


@pytest.mark.parametrize(
    "store",
    ["sqlite", pytest.param("postgresql", marks=[pytest.mark.postgres, needs_postgres])],
    indirect=True,
)
def test_exported_again_from_another_archive_it_is_the_same_file(origin, files, store, tmp_path):
    take_in_file(store, files[1])
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
    assert take_in_file(store, file).n_certificates == 3
    for solution_id in store.certificates.ids(Filter(campaign=1)):
        here, there = (one.certificates.latest(solution_id) for one in (store, origin))
        assert here == (there and there.model_copy(update={"is_from_elsewhere": True}))
    assert not store.certificates.sound_on("there")  # each installation verifies for itself
    assert written(store, 1, tmp_path / "again.zip").read_bytes() == file.read_bytes()


def test_a_certificate_that_is_found_again_here_is_of_here(certified, store):
    origin, file = certified
    take_in_file(store, file)
    solution_id = next(one for one in store.certificates.ids(Filter()) if store.certificates.latest(one))
    assert store.certificates.latest(solution_id).is_from_elsewhere
    assert not store.certificates.add(certificate_on(origin, solution_id, 0.0), "here")
    assert store.certificates.sound_on("here") == {solution_id}


def test_certificates_made_later_reach_a_campaign_that_is_there(files, certified, store, tmp_path):
    take_in_file(store, files[0])
    assert take_in_file(store, certified[1])[1:] == ([], 0, 0, 3)
    assert take_in_file(store, certified[1])[1:] == ([], 0, 0, 0)
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


# Refusals.


def forged(file, target, change, name):
    """Write the file again with one entry changed, and a manifest that agrees with it."""
    with zipfile.ZipFile(file) as packed:
        entries = {info.filename: packed.read(info) for info in packed.infolist()}
    manifest = json.loads(entries.pop("manifest.json"))
    lines = [json.loads(line) for line in entries[name].splitlines()]
    change(lines)
    entries[name] = b"".join(json.dumps(line).encode() + b"\n" for line in lines)
    member = {
        "n_bytes": len(entries[name]),
        "blake2b": hashlib.blake2b(entries[name], digest_size=16).hexdigest(),
    }
    manifest["members"][name] = member
    entries["manifest.json"] = json.dumps(manifest).encode()
    with zipfile.ZipFile(target, "w") as packed:
        for key, content in entries.items():
            packed.writestr(key, content)
    return target


def on_first(**fields):
    return lambda lines: lines[0].update(fields)


def seeded(lines):
    return next(line for line in lines if line["seed"])


def solved(lines):
    return next(line for line in lines if line["solution"])


CAMPAIGN, JOBS, SOLVES = (
    f"campaigns/00/{name}" for name in ("campaign.json", "jobs.ndjson", "solves.ndjson")
)
FORGERIES = [
    ("solutions.ndjson", lambda lines: lines[0]["x"].__setitem__(7, 0.5), "expected the hash of its problem"),
    ("solutions.ndjson", lambda lines: lines[0]["x"].pop(), r"decision vector: expected shape"),
    (
        "solutions.ndjson",
        on_first(propellant_kg=100.0),
        "expected propellant_kg .* vector, got 100.0",
    ),
    ("solutions.ndjson", on_first(arrival_epoch="2026-01-01T00:00:00"), "expected arrival_epoch from its"),
    (
        "solutions.ndjson",
        lambda lines: lines[0]["defects"].__setitem__(0, 50.0),
        "expected defects within its level",
    ),
    ("solutions.ndjson", on_first(problem=32 * "0"), "expected a problem of the campaign"),
    ("solutions.ndjson", on_first(surprise=1), "line 1 of .*: expected one of .*unknown key .surprise"),
    ("solutions.ndjson", on_first(insertion_epoch="\0"), "expected a text without zero bytes"),
    (
        "solutions.ndjson",
        lambda lines: lines.pop(),
        "expected a (seed in the same file|solution of)",
    ),
    (CAMPAIGN, lambda lines: lines[0]["spec"]["campaign"].update(rng_seed=9), "expected the hash .* changed"),
    (CAMPAIGN, on_first(state="active"), "expected one of paused, done, cancelled"),
    (CAMPAIGN, lambda lines: lines[0]["searches"].reverse(), "expected searches s0, s1-0, got s1-0, s0"),
    (JOBS, on_first(search=7), "job 0: expected a search of the campaign"),
    (JOBS, on_first(state="running"), "expected one of queued"),
    (JOBS, lambda lines: lines.append(lines[0]), "expected each address once"),
    (JOBS, lambda lines: seeded(lines).update(seed=32 * "0"), "expected a seed in the same file"),
    (JOBS, lambda lines: lines[0]["attempts"].clear(), "expected an attempt of its job"),
    (SOLVES, lambda lines: lines.append(lines[0]), "expected each hop of a job once"),
    (SOLVES, on_first(job=10**6), "expected a job of the campaign"),
    (SOLVES, lambda lines: solved(lines).update(solution=32 * "0"), "expected a solution of its problem"),
    (SOLVES, lambda lines: solved(lines).update(strict=False), "expected the levels of its solution"),
    (SOLVES, lambda lines: lines.remove(solved(lines)), "expected a solve that found it"),
    (
        "provenance.ndjson",
        lambda lines: lines[0]["content"].update(host="x"),
        "expected the hash of its",
    ),
]


def on_content(**fields):
    return lambda lines: lines[0]["content"].update(fields)


def again_hashed(**fields):
    def change(lines):
        lines[0]["content"].update(fields)
        lines[0]["hash"] = content_hash(lines[0]["content"])

    return change


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (on_content(code_version="9"), "expected the hash of its content"),
        (on_content(k="one"), "k: expected an integer"),
        (on_content(machine="\0"), "expected texts without zero bytes"),
        (on_first(solution=32 * "0"), "expected one of a solution in the same file"),
        (again_hashed(problem_hash=32 * "0"), "expected the problem of its solution"),
        (again_hashed(is_sound=False), "expected a verdict from its defects and marks"),
        (again_hashed(trajectories=[]), "expected a verdict from its defects and marks"),
    ],
)
def test_a_certificate_that_cannot_be_so_is_refused(certified, store, tmp_path, change, reason):
    file = forged(certified[1], tmp_path / "forged.zip", change, "certificates.ndjson")
    before = everything(store)
    with pytest.raises(PortableError, match=reason):
        take_in_file(store, file)
    assert everything(store) == before


@pytest.mark.parametrize(("name", "change", "reason"), FORGERIES)
def test_what_somebody_has_written_into_it_is_refused(files, store, tmp_path, name, change, reason):
    file = forged(files[0], tmp_path / "forged.zip", change, name)
    before = everything(store)
    with pytest.raises(PortableError, match=reason):
        take_in_file(store, file)
    assert everything(store) == before


def test_damage_anywhere_is_seen_or_says_nothing(files, tmp_path):
    content, n_refused = files[0].read_bytes(), 0
    with Unpacked(files[0]) as whole:
        manifest = whole.manifest
    for place in range(0, len(content), len(content) // 100):
        damaged = bytearray(content)
        damaged[place] ^= 0x41
        file = tmp_path / "damaged.zip"
        file.write_bytes(damaged)
        try:
            with Unpacked(file) as unpacked:
                # The date of an entry, perhaps: what is read is what was written.
                assert unpacked.manifest == manifest
        except PortableError as error:
            n_refused += 1
            assert str(error).startswith(f"file {file}: ")
    assert n_refused > 90


def test_half_a_file_and_other_files_are_refused(files, store, tmp_path):
    (tmp_path / "half.zip").write_bytes(files[0].read_bytes()[:-1000])
    (tmp_path / "text").write_text("campaign")
    with zipfile.ZipFile(tmp_path / "empty.zip", "w") as packed:
        packed.writestr("readme", "hello")
    for name in ("half.zip", "text", "empty.zip", "none"):
        with pytest.raises(PortableError, match="expected a portable file of a campaign, got"):
            take_in_file(store, tmp_path / name)


def changed_manifest(file, target, change, more=()):
    with zipfile.ZipFile(file) as packed:
        entries = {info.filename: packed.read(info) for info in packed.infolist()}
    manifest = json.loads(entries["manifest.json"])
    change(manifest)
    entries["manifest.json"] = json.dumps(manifest).encode()
    with zipfile.ZipFile(target, "w") as packed:
        for name, content in [*entries.items(), *more]:
            packed.writestr(name, content)
    return target


@pytest.mark.parametrize(
    ("change", "more", "reason"),
    [
        (lambda m: m.update(version=3), (), "expected version 1 or 2, got 3; install a newer coastarc"),
        (lambda m: m.update(format="other"), (), "expected 'coastarc campaign'"),
        (lambda m: None, [("../../evil", b"x")], "expected the entries of its manifest"),
        (
            lambda m: m["members"].update({"../evil": {"n_bytes": 1, "blake2b": 32 * "0"}}),
            [("../evil", b"x")],
            "expected entries of a campaign",
        ),
        (lambda m: m.update(campaign=32 * "0"), (), "expected the campaign of its manifest last"),
    ],
)
def test_other_versions_and_strange_entries_are_refused(files, store, tmp_path, change, more, reason):
    file = changed_manifest(files[0], tmp_path / "strange.zip", change, more)
    with pytest.raises(PortableError, match=reason):
        take_in_file(store, file)
    assert sorted(entry.name for entry in tmp_path.iterdir() if not entry.name.startswith("coastarc")) == [
        "strange.zip"
    ]


def test_more_than_the_limit_is_refused_before_it_is_unpacked(files, monkeypatch):
    monkeypatch.setattr(container, "MOST_BYTES", 1000)
    monkeypatch.setattr(container, "digest_of", None)
    with pytest.raises(PortableError, match="expected at most 0 GiB, got more"):
        Unpacked(files[0])


def test_lines_without_end_are_refused(files, monkeypatch, store):
    monkeypatch.setattr(container, "MOST_LINE_BYTES", 100)
    monkeypatch.setattr(container, "_CHUNK", 50)
    with pytest.raises(PortableError, match="expected lines of at most 100 bytes"):
        take_in_file(store, files[0])


def test_a_failure_on_the_way_leaves_nothing(files, store):
    before = everything(store)

    def fail(moment):
        raise RuntimeError("no more room")

    store._database.hook = fail
    with pytest.raises(RuntimeError, match="no more room"):
        take_in_file(store, files[0])
    store._database.hook = lambda moment: None
    assert everything(store) == before


def test_the_same_campaign_with_other_work_is_refused(files, store):
    known.submitted(store)
    store.control_campaign(1, "cancel")
    before = everything(store)
    with pytest.raises(PortableError, match="expected none here, or the same as in the file, got campaign 1"):
        take_in_file(store, files[1])
    assert everything(store) == before


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
    "job": {"id", "search_id", "case_index", "seed_id", "not_before", "lease_until", "is_cancelling"},
    "attempt": {"job_id", "provenance_hash"},
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
        take_in_file(other, file)
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
        take_in_file(other, file)
        (stored,) = rows(other, "SELECT spec FROM campaign")
        target = json.loads(stored[0])["problem"]["target"]
        digest = hashlib.blake2b(kernel.read_bytes(), digest_size=16).hexdigest()
        assert target["path"] == str(tmp_path / "elsewhere" / "targets" / f"{digest}.bsp")
        assert (tmp_path / "elsewhere" / "targets" / f"{digest}.bsp").read_bytes() == kernel.read_bytes()
        assert written(other, 1, tmp_path / "again.zip").read_bytes() == file.read_bytes()
    assert str(tmp_path).encode() not in file.read_bytes()


def test_a_file_of_this_machine_is_not_read_for_somebody_elses_campaign(store, tmp_path):
    kernel = tmp_path / "mine.bsp"
    kernel.write_bytes(b"orbit")
    fields = spec_fields(campaign={"name": "own target", "rng_seed": 3})
    fields["problem"] |= {"target": {"kind": "spk", "path": str(kernel), "naif_id": -7}}
    store.submit(spec_from(fields, allow_files=True))
    finish(store, Inline(run_in_vain))
    file = written(store, 1, tmp_path / "own.zip")

    def change(lines):
        lines[0]["spec"]["problem"]["target"]["path"] = "/etc/passwd"

    with elsewhere(tmp_path) as other:
        with pytest.raises(PortableError, match="expected a kernel in the same file, got '/etc/passwd'"):
            take_in_file(other, forged(file, tmp_path / "forged.zip", change, CAMPAIGN))
        assert not list((tmp_path / "elsewhere").glob("targets/*"))
