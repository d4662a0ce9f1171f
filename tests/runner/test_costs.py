"""What work takes, learnt from what it took."""

from lfportrait.runner import Costs, Need

USUAL = {"field": Need(68.0, 1200, 54)}


def test_estimates_follow_what_was_measured():
    costs = Costs(USUAL)
    assert costs.need("field") == USUAL["field"] and costs.need("page") == Need(0.0)
    for seconds, memory in ((2.0, 100), (4.0, 300)):
        costs.learn("field", Need.of({"cpu_seconds": seconds, "bytes": 10,
                                      "peak_memory_bytes": memory}))
    assert costs.need("field") == Need(3.0, 360, 10)
    assert costs.need("page").seconds == 3.0


def test_the_newest_counts_a_quarter_at_least():
    costs = Costs()
    for _ in range(100):
        costs.learn("field", Need(4.0))
    costs.learn("field", Need(8.0))
    assert costs.need("field").seconds == 5.0


def test_what_was_learnt_is_kept_and_a_damaged_file_is_not_taken(tmp_path):
    file = tmp_path / "costs.json"
    Costs(USUAL, file).learn("field", Need(2.0, 10, 5))
    assert Costs(USUAL, file).need("field") == Need(2.0, 12, 5)
    for text in ("[]", '{"field": 3}', '{"field": [1, "x", 0, 0]}', "nothing"):
        file.write_text(text)
        assert Costs(USUAL, file).need("field") == USUAL["field"]
