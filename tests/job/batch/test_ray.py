"""A batch on a Ray cluster of two nodes on this machine: the same files, nodes and workers die."""

import importlib.util
import os
import signal

import pytest

from lfportrait.job.batch import BatchConfig, batch

from .conftest import digests, of_anna

RAY = BatchConfig(on="ray")
# To start a cluster takes longer than a batch; `test_batch` has the same with our own processes.
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def cluster():
    """Two nodes of one core; skipped where there is no Ray, unless one is required."""
    if importlib.util.find_spec("ray") is None:
        if os.environ.get("LFPORTRAIT_REQUIRE_RAY") == "1":
            pytest.fail("Ray is not installed, and LFPORTRAIT_REQUIRE_RAY=1 asks for it")
        pytest.skip("Ray is not installed (pip install 'lfportrait[ray]')")
    from ray.cluster_utils import Cluster

    # That a node is gone is noticed after seconds instead of a quarter of a minute.
    made = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "_system_config": {
        "health_check_initial_delay_ms": 0, "health_check_period_ms": 500,
        "health_check_failure_threshold": 5}})
    made.add_node(num_cpus=1)
    yield made
    made.shutdown()


@pytest.fixture
def joined(cluster):
    """This process as a part of the cluster, until the batch leaves it."""
    import ray

    ray.init(address=cluster.address, log_to_driver=False, logging_level="ERROR")
    yield cluster
    ray.shutdown()


def test_a_cluster_gives_the_same_files_although_a_node_and_a_worker_die(made, anna, joined,
                                                                         tmp_path):
    node = joined.add_node(num_cpus=1)
    done = []

    def kill(event):
        if event["event"] != "done":
            return
        done.append(event)
        styled = [one for one in done if one["task"].endswith("/styled")]
        # The first of the two that are painted side by side.
        if len(styled) == 1 and styled[0] is event:
            # First the worker: it may be one of the node, and end with it.
            os.kill(int(event["worker"].rpartition(":")[2]), signal.SIGKILL)
            joined.remove_node(node, allow_graceful=False)

    figures = batch(anna, tmp_path / "results", RAY, watchers=[kill])
    assert not figures["failed"]
    assert figures["ran"] == {name: count // 2 for name, count in made[1]["ran"].items()}
    assert digests(tmp_path / "results") == of_anna(digests(made[0]))
    assert len({event["worker"] for event in done}) >= 2


def test_failures_are_the_same(studio, joined, copy):
    (copy / "anna/ken/portrait.html").unlink()
    text = (studio / "jobs.toml").read_text().replace("[defaults]",
                                                      "[defaults]\npage.max_size = 0")
    (studio / "small.toml").write_text(text)
    figures = batch(studio / "small.toml", copy, RAY)
    assert len(figures["failed"]) == 4
    assert all("--max-size" in why for why in figures["failed"].values())


def test_a_folder_that_is_not_shared_is_told(studio, joined, copy, monkeypatch):
    (copy / "anna/ken/portrait.html").unlink()
    monkeypatch.setattr("lfportrait.job.batch.driver._PATIENCE", 0.0)
    monkeypatch.setattr("lfportrait.job.batch.driver.finished", lambda *_: None)
    figures = batch(studio / "jobs.toml", copy, RAY)
    assert "that all machines of the cluster share" in figures["failed"]["anna/ken/page"]
