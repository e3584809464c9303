"""The fast tier: `-m "not slow"` leaves out the tests that take most of the time; and no network for any test.

Linear algebra has one thread, as on the command line: threads of small matrices wait for each other, a third of the CPU
time of tests that navigate with nothing configured.
"""

from __future__ import annotations

import os
import socket
from typing import Any

import pytest

for threads in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(threads, "1")  # before NumPy is loaded, and for the processes that tests start

SLOW = (
    "tests/alignment/test_robust_start.py",
    "tests/bench/",
    "tests/certificate/test_certify.py",
    "tests/cli/test_batch.py::test_a_batch_that_was_stopped",
    "tests/cli/test_demo.py",
    "tests/cli/test_process.py::test_work_of_more_than_a_second",
    "tests/cli/test_readme.py",
    "tests/cli/test_simulate.py::test_a_stopped_series",
    "tests/cli/test_simulate.py::test_many_runs",
    "tests/errors/budget/test_analytic.py::test_noise_is",
    "tests/errors/budget/test_covariance.py::test_the_sum_of_the_parts",
    "tests/errors/budget/test_from_windows.py",
    "tests/errors/requirement/test_aided.py::test_the_filter_itself",
    "tests/faults/test_navigation.py::test_n5_outages",
    "tests/filter/test_changes.py::test_a_jump_of_metres",
    "tests/filter/test_truth_of_sd.py",
    "tests/filter/test_whole_record.py",
    "tests/lab/test_multi_position.py::test_the_truth_lies_within",
    "tests/lab/test_nine_position.py::test_everything_is_recovered",
    "tests/lab/test_noise_model.py",
    "tests/lab/test_sinusoids.py::test_other_coefficients",
    "tests/physics/test_free_inertial.py",
    "tests/physics/test_platform_errors.py",
    "tests/recorded/",
    "tests/cli/test_laboratory_figures.py::test_every_recorded_figure_comes_out_of_its_command",
    "tests/regression/test_peers.py",
    "tests/regression/test_published.py::test_a_replica",
    "tests/regression/test_verdicts.py",
    "tests/report/test_simulation.py",
    "tests/simulate/test_montecarlo.py",
    "tests/test_engine.py",
)


if os.environ.get("INSNAV_REVERSED"):  # the nightly proof that nothing depends on what a message says
    from tests.reversed_messages import reverse_messages

    reverse_messages()


def _own() -> set[str]:
    try:
        return {socket.gethostname(), *socket.gethostbyname_ex(socket.gethostname())[2]}
    except OSError:  # it has no address
        return set()


OWN = _own()


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line("markers", 'slow: takes seconds; left out by -m "not slow"')


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if item.nodeid.startswith(SLOW):
            item.add_marker(pytest.mark.slow)


@pytest.fixture(autouse=True)
def no_network(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing asks for the network; clusters on this machine, and browsers, talk to themselves."""

    def guarded(connect: Any) -> Any:
        def only_here(self: socket.socket, address: Any) -> Any:
            host = address[0] if isinstance(address, tuple) else ""
            if host and host != "localhost" and not host.startswith(("127.", "::1")) and host not in OWN:
                raise AssertionError(f"a test connects to {host}")
            return connect(self, address)

        return only_here

    for name in ("connect", "connect_ex"):
        monkeypatch.setattr(socket.socket, name, guarded(getattr(socket.socket, name)))
