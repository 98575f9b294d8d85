"""What is kept on disk: used again while it is whole, made anew where it is not, put where there is room."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from core import cache
from core.cache import is_sealed, seal

TWICE = """
from core.jit import compiled

@compiled
def twice(x):
    return 2.0 * x

value = twice(3.0)
assert value == 6.0
print(sum(twice.stats.cache_hits.values()), sum(twice.stats.cache_misses.values()))
"""


def run(folder, code, **environment):
    """Run code in a process of its own whose cache is in a folder; return what it printed and complained."""
    (folder / "twice_of.py").write_text(code)
    given = os.environ | {"XDG_CACHE_HOME": str(folder / "cache"), "PYTHONPATH": str(folder)} | environment
    command = [sys.executable, "-c", "import twice_of"]
    said = subprocess.run(command, env=given, cwd=folder, capture_output=True, text=True, timeout=300)
    assert said.returncode == 0, said.stderr
    return said.stdout.strip()


def flipped(path):
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 0x10
    path.write_bytes(content)


def cut(path):
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


@pytest.mark.parametrize("suffix", ["nbi", "nbc"])
@pytest.mark.parametrize("damage", [flipped, cut])
def test_a_damaged_file_of_compiled_code_is_compiled_anew(damage, suffix, tmp_path):
    assert run(tmp_path, TWICE) == "0 1"
    assert run(tmp_path, TWICE) == "1 0"
    (path,) = tmp_path.rglob(f"twice_of.*.{suffix}")
    damage(path)
    assert run(tmp_path, TWICE) == "0 1"
    assert run(tmp_path, TWICE) == "1 0"


def test_a_file_is_sealed_while_it_is_what_was_sealed(tmp_path):
    path = tmp_path / "orbit.bsp"
    assert not is_sealed(path)
    path.write_bytes(b"first")
    assert not is_sealed(path)
    seal(path)
    assert is_sealed(path) and len(list(tmp_path.iterdir())) == 2
    path.write_bytes(b"other")
    assert not is_sealed(path)


@pytest.fixture
def anew():
    cache._choose_folder.cache_clear()
    yield
    cache._choose_folder.cache_clear()


def with_temporary(monkeypatch, folder):
    monkeypatch.setattr(cache.tempfile, "gettempdir", lambda: str(folder))
    return folder / f"coastarc-{os.getuid()}"


def test_a_cache_that_cannot_be_written_is_replaced_by_a_private_one_with_a_word(anew, monkeypatch, tmp_path):
    (tmp_path / "file").write_text("no folder")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    instead = with_temporary(monkeypatch, tmp_path)
    assert cache.cache_folder() == instead and instead.stat().st_mode & 0o777 == 0o700
    assert "coastarc: expected one that can be written, got Not a directory; using " in cache.cache_note()
    assert "\n" not in cache.cache_note()


@pytest.mark.parametrize("kind", ["open", "link"])
def test_a_folder_that_others_may_have_made_is_not_used(kind, anew, monkeypatch, tmp_path):
    (tmp_path / "file").write_text("no folder")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    instead = with_temporary(monkeypatch, tmp_path)
    if kind == "open":
        instead.mkdir()
        instead.chmod(0o777)
    else:
        (tmp_path / "elsewhere").mkdir(mode=0o700)
        instead.symlink_to(tmp_path / "elsewhere")
    with pytest.raises(
        cache.CacheError, match="a folder that others can write; make it writable, or set XDG"
    ):
        cache.cache_folder()


def test_who_has_no_home_gets_a_folder_too(anew, monkeypatch, tmp_path):
    monkeypatch.setattr(cache, "user_cache_path", lambda name: Path("~/.cache") / name)
    instead = with_temporary(monkeypatch, tmp_path)
    assert cache.cache_folder() == instead
    assert "got no home" in cache.cache_note()


def test_a_command_without_a_cache_folder_warns_in_one_line_and_runs(tmp_path):
    (tmp_path / "file").write_text("no folder")
    program = str(Path(sys.executable).with_name("coastarc"))
    command = [program, "solutions", "list", "--data", str(tmp_path / "none")]
    given = os.environ | {"XDG_CACHE_HOME": str(tmp_path / "file"), "TMPDIR": str(tmp_path)}
    said = subprocess.run(command, env=given, capture_output=True, text=True, timeout=100)
    warning, error = said.stderr.splitlines()
    assert warning.startswith("warning: cache folder ") and error.startswith(
        "error: archive: expected a file"
    )


def test_kernels_of_others_are_kept_where_they_would_be_without_us(tmp_path):
    folder = run(tmp_path, TWICE + "import numba\nprint(repr(numba.config.CACHE_DIR))").splitlines()[-1]
    assert folder == "''"
