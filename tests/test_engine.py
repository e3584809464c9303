"""One engine for many jobs: the same bytes wherever they are worked at, and a worker that dies loses none of them."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from insnav import engine
from insnav.engine import Engine, each, engine_of, every
from insnav.exceptions import ConfigError, InputError, InsnavError
from insnav.simulate.montecarlo import monte_carlo
from tests.refusals import refused
from tests.simulate.test_montecarlo import SEED, TASK, same

distributed = pytest.importorskip("distributed")


@pytest.fixture(scope="module")
def cluster() -> Iterator[str]:
    """Engine of a cluster of two local workers over TCP."""
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0") as made:
        assert made.scheduler_address.startswith("tcp://")
        yield f"dask:{made.scheduler_address}"


@pytest.fixture(params=["1", "processes:2", "cluster"])
def workers(request: pytest.FixtureRequest) -> str:
    return str(request.getfixturevalue("cluster") if request.param == "cluster" else request.param)


def squared(offset: np.ndarray, job: int) -> float:
    if job == 3:
        raise InputError("test.clocks", offset_s=18.0, gives={"time_offset": 18.0})
    if job == 5:
        raise ValueError("five")
    return float(offset[job] + job**2)


def test_results_come_in_order_and_failures_keep_their_reason(workers: str):
    found = list(each(squared, range(8), workers, (np.arange(300_000.0),)))
    assert [found[i] for i in (0, 1, 2, 4, 6, 7)] == [0.0, 2.0, 6.0, 20.0, 42.0, 56.0]
    assert isinstance(found[3], InputError)
    assert (found[3].code, found[3].values["offset_s"], found[3].gives) == ("test.clocks", 18.0, {"time_offset": 18.0})
    assert (type(found[5]), found[5].code) == (InsnavError, "engine.job_defect")
    assert (found[5].values["kind"], found[5].values["reason"]) == ("ValueError", "five")
    assert found[5].values["place"].startswith("test_engine.py:")
    with refused(InputError, "test.clocks"):
        list(every(squared, range(8), workers, (np.arange(300_000.0),)))


def test_monte_carlo_has_the_same_bytes_on_every_engine(workers: str):
    assert same(monte_carlo(TASK, 12, SEED, workers=workers), monte_carlo(TASK, 12, SEED))


def listening() -> set[tuple[str, int]]:
    """Addresses and ports at which this process and those that it started listen."""
    psutil = pytest.importorskip("psutil")
    family = [psutil.Process(), *psutil.Process().children(recursive=True)]
    return {link.laddr for each in family for link in each.net_connections() if link.status == psutil.CONN_LISTEN}


def test_local_workers_listen_on_the_loopback_interface_alone():
    before = listening()
    with engine._client(Engine(2, ""), 2) as client:
        client.wait_for_workers(2)
        opened = listening() - before
    assert len(opened) > 2
    assert {address for address, _ in opened} == {"127.0.0.1"}


def slow(folder: Path, job: int) -> int:
    (folder / str(os.getpid())).touch()
    time.sleep(0.1)
    return job


@pytest.mark.parametrize("workers", ["processes:2", "cluster"])
def test_jobs_of_a_worker_that_is_killed_are_repeated(
    workers: str, tmp_path: Path, request: pytest.FixtureRequest, caplog: pytest.LogCaptureFixture
):
    chosen = request.getfixturevalue("cluster") if workers == "cluster" else workers
    found = []
    for outcome in each(slow, range(16), chosen, (tmp_path,)):
        found.append(outcome)
        if len(found) == 4:
            pids = {int(each.name) for each in tmp_path.iterdir()} - {os.getpid()}
            os.kill(max(pids), signal.SIGKILL)
    assert found == list(range(16))
    assert workers == "cluster" or "a process died; jobs" in caplog.text  # a scheduler has its own log


def deadly(job: int) -> int:
    if job == 2:
        os._exit(3)
    return job


def test_a_job_that_kills_its_process_again_is_named_and_the_others_are_kept():
    found = list(each(deadly, range(6), "dask"))  # of processes see test_montecarlo
    assert [found[i] for i in (0, 1, 3, 4, 5)] == [0, 1, 3, 4, 5]
    assert found[2].code == "engine.process_died"


@pytest.mark.parametrize(
    ("text", "expected"),
    [(3, Engine(3)), ("4", Engine(4)), ("processes:2", Engine(2)), ("processes", Engine(7)), ("dask", Engine(7, ""))],
)
def test_engines_by_name(text: str | int, expected: Engine, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(engine, "_processors", lambda: 7)
    assert engine_of(text) == expected
    assert engine_of("dask:tcp://host:8786").dask == "tcp://host:8786"


@pytest.mark.parametrize("text", ["", "threads", "processes:0", "0", "processes:x", "dask:", "-1"])
def test_what_is_no_engine_is_refused(text: str):
    with pytest.raises(ConfigError) as error:
        engine_of(text)
    assert error.value.where == "--engine"


def test_a_cluster_that_is_not_there_or_not_the_same_is_refused(cluster: str, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(engine, "CONNECT", 0.3)
    with refused(ConfigError, "engine.no_cluster"):
        list(each(slow, range(3), "dask:tcp://127.0.0.1:9"))
    monkeypatch.setattr("insnav.__version__", "9.9")
    with refused(ConfigError, "engine.other_version") as caught:
        list(each(slow, range(3), cluster))
    assert caught.value.values["own"] == "9.9"


@pytest.mark.skipif(os.name == "nt", reason="loky cleans up in another way there")
def test_what_a_stopped_process_leaves_behind_is_removed_without_a_word():
    script = """
import os
from insnav.engine import each
assert list(each(len, ["a", "bb"], 2)) == [1, 2]
from joblib.externals.loky.backend import resource_tracker
resource_tracker.register("/loky-left-behind", "semlock")
os._exit(0)
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=120, check=True)
    assert done.stderr == ""
