import json

from benchmarks.startup import COMMANDS, REFERENCE, main


def test_every_command_that_only_looks_is_measured_beside_what_it_imports(capsys):
    main(repeats=1, outcomes=2)
    told = json.loads(capsys.readouterr().out)
    assert set(told["cpu_seconds"]) == {REFERENCE, *(f"coastarc {words}" for words in COMMANDS)}
    assert all(0.0 < one["least"] <= one["median"] <= one["greatest"] for one in told["cpu_seconds"].values())
