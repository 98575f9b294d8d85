"""A data folder and what is written into it are for their owner alone."""

import pytest

from service.coordinator import Coordinator
from service.coordinator.lock import openness
from service.doctor import check_all


@pytest.mark.parametrize(("mode", "is_told"), [(0o755, True), (0o700, False)])
def test_a_folder_that_others_may_look_into_is_told_of(tmp_path, caplog, mode, is_told):
    folder = tmp_path / "data"
    folder.mkdir()
    folder.chmod(mode)
    with Coordinator(folder):
        pass
    assert ("expected mode 0700, got 0755; chmod 700 it" in caplog.text) == is_told
    assert (openness(folder) is not None) == is_told
    disk = next(check for check in check_all(folder, 1) if check.name == "disk")
    assert (disk.advice == "chmod 700 it") == is_told


def test_every_file_of_a_run_is_for_its_owner_alone(tmp_path):
    with Coordinator(tmp_path / "data") as coordinator:
        files = [path for path in coordinator.store.folder.rglob("*") if path.is_file()]
        assert files and all(path.stat().st_mode & 0o077 == 0 for path in files)
