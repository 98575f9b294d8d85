import json

import numpy as np

from benchmarks.archive import fill
from benchmarks.report import main
from service.spec import spec_from
from service.store.store import Store
from tests.service.campaigns import spec_fields


def test_a_made_up_archive_holds_as_many_solves_as_asked_for(tmp_path):
    campaign_id = fill(tmp_path, spec_from(spec_fields()), 201, np.random.default_rng(1))
    with Store(tmp_path, read_only=True) as store:
        facts = store.campaign_facts(campaign_id)
    assert len(facts.solves) == 201 and {solve.search for solve in facts.solves} == {"s0", "s1-0"}
    seeds = {solve.seed_id for solve in facts.solves if solve.k == 1}
    assert seeds <= {solve.solution_id for solve in facts.solves if solve.k == 0}
    assert 30 < sum(solve.strict for solve in facts.solves) == len(facts.vectors) < 90  # 60 +- 6.5 expected


def test_the_report_of_a_made_up_archive_is_timed(tmp_path, capsys):
    spec = tmp_path / "spec.json"
    spec.write_text(json.dumps(spec_fields()))
    main(outcomes=100, spec=spec, as_json=True)
    told = json.loads(capsys.readouterr().out)
    assert told["settings"]["outcomes"] == 100 and {"cpu_seconds", "wall_seconds"} == set(told["report"])
