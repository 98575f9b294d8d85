"""Samples as text: columns that agree with each other and with an independent clock."""

import csv
import json

import numpy as np
from astropy.time import Time

from core.export import csv_lines, ndjson_lines
from core.export.states import columns_of
from core.world import BODIES
from tests.core.export.solution import PROBLEM, trajectories


def rows_of_csv():
    lines = "".join(csv_lines(trajectories(), ["about", "it"])).splitlines()
    assert lines[:2] == ["# about", "# it"]
    return list(csv.DictReader(lines[2:]))


def test_csv_and_ndjson_tell_the_same():
    objects = [json.loads(line) for line in "".join(ndjson_lines(trajectories())).splitlines()]
    rows = rows_of_csv()
    assert len(rows) == len(objects) == sum(len(arc.et) for own in trajectories() for arc in own.arcs)
    for row, one in zip(rows[::50], objects[::50], strict=True):
        assert tuple(row) == tuple(one) == columns_of(BODIES["MOON"])
        shown = {key: "" if value is None else value for key, value in one.items()}
        assert row == {k: str(v).lower() if isinstance(v, bool) else str(v) for k, v in shown.items()}


def test_epochs_agree_with_an_independent_clock():
    rows = rows_of_csv()[::200]
    tdb = Time([row["epoch_tdb"] for row in rows], scale="tdb")
    utc = Time([row["epoch_utc"] for row in rows], scale="utc")
    # SPICE's formula for TDB - TT leaves out terms of 30 microseconds, ERFA's does not.
    assert np.abs((tdb - utc.tdb).sec).max() < 5e-5
    days = np.array([float(row["days_past_departure"]) for row in rows])
    assert np.abs((tdb - tdb[0]).jd - days).max() < 1e-10


def test_thrust_is_throttle_times_what_the_engine_gives_and_nothing_in_an_outage():
    for row in rows_of_csv()[::20]:
        thrust = np.linalg.norm([float(row[f"thrust_{axis}_n"]) for axis in "xyz"])
        np.testing.assert_allclose(
            thrust, float(row["throttle"]) * PROBLEM.spacecraft.max_thrust_n, rtol=1e-14
        )
        assert (row["is_outage"] == "true") == (row["arc"] == "outage")
        assert row["arc"] == "thrust" or thrust == 0.0


def test_an_outage_lasts_as_long_as_it_says():
    (own,) = ([row for row in rows_of_csv() if row["is_outage"] == "true"],)
    assert {(row["trajectory"], row["outage_segment"]) for row in own} == {("realization 1", "24")}
    days = [float(row["days_past_departure"]) for row in own]
    # Epochs are spaced by 1.2e-7 s.
    assert abs(days[-1] - days[0] - 1.0) < 1e-11
