"""The kernels are the published ones and carry the constants that `core.constants` states."""

import re
import subprocess
import sys
from pathlib import Path

import pytest
import spiceypy

from core import constants
from core.ephemeris import KernelError, check_kernels, furnish, kernel_hashes, kernels


def test_the_planetary_kernel_is_the_published_one():
    check_kernels()
    assert kernel_hashes()["de440.bsp"] == constants.KERNEL_MD5


def test_a_different_kernel_is_refused(tmp_path, monkeypatch):
    other = tmp_path / "de440.bsp"
    other.write_bytes(b"not a kernel")
    monkeypatch.setattr(kernels, "planetary_kernel", lambda: other)
    with pytest.raises(KernelError, match=f"expected MD5 {constants.KERNEL_MD5}, got "):
        check_kernels()


def test_an_absent_kernel_is_refused():
    with pytest.raises(KernelError, match="expected a file, got nowhere"):
        furnish(Path("nowhere.bsp"))


def test_kernels_are_loaded_once():
    furnish()
    before = spiceypy.ktotal("ALL")
    furnish()
    assert spiceypy.ktotal("ALL") == before


FORKS = """
import multiprocessing
import numpy as np
import spiceypy
from core.ephemeris import furnish

def moons(rng_seed):
    furnish()
    epochs = np.random.default_rng(rng_seed).uniform(0.0, 3e9, 3000)
    return np.array([spiceypy.spkgps(301, et, "J2000", 399)[0] for et in epochs])

expected = moons(1)
with multiprocessing.get_context("fork").Pool(2) as pool:
    found = pool.map_async(moons, [1, 1, 1, 1], chunksize=1)
    own = moons(1)
    print(all(np.array_equal(each, expected) for each in [own, *found.get()]))
"""


def test_forked_processes_read_without_disturbing_each_other():
    # In a process of its own: forks of one with threads, as this may have, can wait for ever.
    said = subprocess.run([sys.executable, "-c", FORKS], capture_output=True, text=True, timeout=200)
    assert said.stdout == "True\n", said.stderr


def test_gravitational_parameters_are_those_in_the_comments_of_the_kernel():
    handle = spiceypy.dafopr(str(kernels.planetary_kernel()))
    _, comments, _ = spiceypy.dafec(handle, 600, 1000)
    spiceypy.dafcls(handle)
    table = dict(re.findall(r"^\s+(GM\w)\s+(\d\S+e[-+]\d\d)\s", "\n".join(comments), re.MULTILINE))
    km3_s2 = 149597870.7**3 / 86400.0**2  # from AU^3/day^2
    ours = {"GM3": constants.GM_EARTH, "GMM": constants.GM_MOON, "GMS": constants.GM_SUN}
    for name, gm in ours.items():
        # The comments carry 17 digits; the conversion rounds a few times.
        assert gm == pytest.approx(float(table[name]) * km3_s2, rel=1e-14), name
    # Jupiter's is stated to nine digits, which moves a transfer by 1e-8 km.
    assert pytest.approx(float(table["GM5"]) * km3_s2, rel=1e-9) == constants.GM_JUPITER
