"""The tiers of tests; and no network for any test.

Linear algebra has one thread, as on the command line: threads of small matrices wait for each other, a third of the CPU
time of tests that navigate with nothing configured.
"""

from __future__ import annotations

import os
import socket
from typing import Any

import pytest

from tests.durations import FILE, TIERS, Recorder, read_durations, tier_of

for threads in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(threads, "1")  # before NumPy is loaded, and for the processes that tests start

if os.environ.get("INSNAV_REVERSED"):  # the nightly proof that nothing depends on what a message says
    from tests.reversed_messages import reverse_messages

    reverse_messages()


def _own() -> set[str]:
    try:
        return {socket.gethostname(), *socket.gethostbyname_ex(socket.gethostname())[2]}
    except OSError:  # it has no address
        return set()


OWN = _own()


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--record-durations", action="store_true", help="write tests/durations.json")


def pytest_configure(config: pytest.Config) -> None:
    for name, longest in TIERS.items():
        config.addinivalue_line("markers", f"{name}: takes up to {longest} s, as tests/durations.json tells")
    if config.getoption("record_durations"):
        config.pluginmanager.register(Recorder(FILE))


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    durations = read_durations()
    for item in items:
        item.add_marker(tier_of(item.nodeid, durations))


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
