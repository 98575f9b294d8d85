"""What it costs to take in a portable file: little memory, whatever it unpacks to."""

import json
import subprocess
import sys
import zipfile

import pytest

from core.plain_data import content_hash
from tests.service.archive_format.test_refused import forged

#: What a file may add to the memory of a process [MiB]; the first of those below, of 20 kB, took 1,900.
MOST_MIB = 180
#: Takes in the file it is told, in a process of its own, and prints what that added to its largest memory.
IMPORT = """
import json, sys
from pathlib import Path
from service.archive_format.container import Unpacked
from service.archive_format.container import PortableError
from service.store.archive_files import import_file
from service.archive_format.reading import read_all
from service.store.store import Store

def mib(name):
    lines = dict(line.split(":") for line in Path("/proc/self/status").read_text().splitlines())
    return int(lines[name].split()[0]) / 1024

file, before, during, reason = *map(Path, sys.argv[1:4]), None
with Store(during) as store:
    with Unpacked(before) as small:
        read_all(small, during)
    Path("/proc/self/clear_refs").write_text("5")  # The largest so far counts no more.
    begin = mib("VmRSS")
    try:
        import_file(store, file)
    except PortableError as error:
        reason = str(error)
print(json.dumps({"mib": mib("VmHWM") - begin, "reason": reason}))
"""


def many_faults(lines):
    lines[0]["x"] = 2_000_000 * [[]]


def many_values(lines):
    lines[0]["content"] = {"a": 2_000_000 * [[]]}


def many_large_lines(lines):
    for number in range(60):
        content = {"a": 99_000 * [[]], "b": number}
        lines.append({"hash": content_hash(content), "content": content})


def many_lines(lines):
    job = lines[-1]
    lines.extend(job | {"hop": 10 + number, "attempts": []} for number in range(300_000))


ATTACKS = [
    ("solutions.ndjson", many_faults),
    ("provenance.ndjson", many_values),
    ("provenance.ndjson", many_large_lines),
    ("campaigns/00/jobs.ndjson", many_lines),
]


def cost(file, before, folder):
    folder.mkdir()
    run = [sys.executable, "-c", IMPORT, str(file), str(before), str(folder)]
    return json.loads(subprocess.run(run, check=True, capture_output=True, text=True).stdout)


def packed_small(file):
    with zipfile.ZipFile(file) as packed:
        entries = {info.filename: packed.read(info) for info in packed.infolist()}
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as packed:
        for name, content in entries.items():
            packed.writestr(name, content)
    return file


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="the memory of a process is read from /proc")
@pytest.mark.parametrize(("name", "change"), ATTACKS)
def test_a_small_file_takes_little_memory_whatever_it_unpacks_to(files, tmp_path, name, change):
    file = packed_small(forged(files[0], tmp_path / "large.zip", change, name))
    found = cost(file, files[1], tmp_path / "data")
    assert found["mib"] < MOST_MIB
