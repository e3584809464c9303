"""A request to stop reaches the program once, and nothing it leaves half made says a word."""

from __future__ import annotations

import subprocess
import sys

import pytest

from tests.cli.conftest import ROOT

HALF_MADE = """
import os, signal, sys
from insnav.cli import console

class Half:
    def __init__(self):
        os.kill(os.getpid(), signal.SIGTERM)
        self.whole = True

    def __del__(self):
        self.whole  # what the request interrupted has no such attribute

console.listen()
try:
    Half()
except console.Stopped as stopped:
    del stopped
    print("stopped")
"""
LATE = """
import os, signal, time
from insnav.cli import console

console.listen()
try:
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(1.0)
except console.Stopped:
    console.arrived()
    os.kill(os.getpid(), signal.SIGTERM)  # the repetition that was on its way
    print("tidied up")
"""
BEFORE = """
import os, signal
from insnav.cli import console

class Broken:
    def __del__(self):
        raise ValueError("a defect")

console.listen()
console.arrived()  # nobody has asked for anything yet
Broken()
try:
    os.kill(os.getpid(), signal.SIGINT)
except console.Stopped as stopped:
    print(stopped.number == signal.SIGINT)
"""
LIMITED = """
import resource
from insnav.cli import console

console.listen()
resource.setrlimit(resource.RLIMIT_CPU, (1, 60))
try:
    while True:
        pass
except console.Stopped as stopped:
    print(stopped)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="signals are different there")
@pytest.mark.parametrize(
    ("program", "out", "word"),
    [(HALF_MADE, "stopped", ""), (LATE, "tidied up", ""), (BEFORE, "True", "a defect"), (LIMITED, "SIGXCPU", "")],
)
def test_a_request_is_heard_once_and_leaves_no_message(program: str, out: str, word: str):
    done = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == out
    assert word in done.stderr
    assert bool(word) == bool(done.stderr)
