"""Folders of Ray clusters: taken away by whoever comes next, unless somebody still works in them."""

import os
import time
from pathlib import Path

import pytest

from workers import ray_nodes
from workers.ray_nodes import RayFolder


@pytest.fixture
def parent(tmp_path, monkeypatch):
    monkeypatch.setattr(ray_nodes.tempfile, "tempdir", str(tmp_path))
    return tmp_path


def aged(folder: Path):
    long_ago = time.time() - 2 * ray_nodes.SETTLED_S
    os.utime(folder, (long_ago, long_ago))
    return folder


def test_a_folder_lasts_until_it_is_closed(parent):
    opened = RayFolder()
    assert opened.path.parent == parent and opened.path.is_dir()
    aged(opened.path)
    RayFolder().close()
    assert opened.path.is_dir()
    opened.close()
    assert list(parent.iterdir()) == []


def test_what_a_killed_process_left_is_taken_away_and_nothing_else(parent):
    left, young, other = (parent / name for name in ("coastarc-ray-1", "coastarc-ray-2", "coastarc-1"))
    for folder in (left, young, other):
        (folder / "logs").mkdir(parents=True)
    aged(left)
    aged(other)
    RayFolder().close()
    assert sorted(path.name for path in parent.iterdir()) == ["coastarc-1", "coastarc-ray-2"]
