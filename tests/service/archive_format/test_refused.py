"""What is not taken in: forged, damaged, foreign and too large files, each refused whole."""

import hashlib
import json
import zipfile

import pytest

from core.plain_data import content_hash
from service.archive_format import container
from service.archive_format.container import PortableError, Unpacked
from service.store.archive_files import import_file
from tests.acceptance import known
from tests.service.archive_format.made import everything


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
        import_file(store, file)
    assert everything(store) == before


@pytest.mark.parametrize(("name", "change", "reason"), FORGERIES)
def test_what_somebody_has_written_into_it_is_refused(files, store, tmp_path, name, change, reason):
    file = forged(files[0], tmp_path / "forged.zip", change, name)
    before = everything(store)
    with pytest.raises(PortableError, match=reason):
        import_file(store, file)
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
            import_file(store, tmp_path / name)


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
        import_file(store, file)
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
        import_file(store, files[0])


@pytest.mark.parametrize(
    ("limit", "reason"),
    [
        ("MOST_LIST_BYTES", "expected a portable file of a campaign, got a list of more than 1 bytes"),
        ("MOST_LINES", r"expected at most 1 lines in .*\.ndjson, got more"),
        ("MOST_VALUES", "expected at most 1 values in line 1 of .*, got more"),
    ],
)
def test_long_lists_are_refused_before_they_are_in_memory(files, monkeypatch, store, limit, reason):
    monkeypatch.setattr(container, limit, 1)
    with pytest.raises(PortableError, match=reason):
        import_file(store, files[0])


def test_of_thousands_of_faults_only_the_number_is_told(files, store, tmp_path):
    file = forged(files[0], tmp_path / "forged.zip", on_first(x=2000 * [[]]), "solutions.ndjson")
    with pytest.raises(PortableError, match="expected SolutionLine, got 2000 faults"):
        import_file(store, file)


def test_a_failure_on_the_way_leaves_nothing(files, store):
    before = everything(store)

    def fail(moment):
        raise RuntimeError("no more room")

    store._database.hook = fail
    with pytest.raises(RuntimeError, match="no more room"):
        import_file(store, files[0])
    store._database.hook = lambda moment: None
    assert everything(store) == before


def test_the_same_campaign_with_other_work_is_refused(files, store):
    known.submitted(store)
    store.control_campaign(1, "cancel")
    before = everything(store)
    with pytest.raises(PortableError, match="expected none here, or the same as in the file, got campaign 1"):
        import_file(store, files[1])
    assert everything(store) == before
