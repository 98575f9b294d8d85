"""The server's threads share one SPICE: what they get must not depend on who else asks."""

import subprocess
import sys

ASK = """
from concurrent.futures import ThreadPoolExecutor
import numpy as np
from core.ephemeris import body_table
with ThreadPoolExecutor(12) as pool:
    tables = list(pool.map(lambda start: body_table(8.3e8, float(start), 12.0).coefficients[-1], range(12)))
assert all(np.array_equal(tables[0], other) for other in tables)
"""


def test_twelve_threads_that_load_the_kernels_at_once_agree():
    # A new process, since the kernels of this one are loaded already.
    done = subprocess.run([sys.executable, "-c", ASK], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
