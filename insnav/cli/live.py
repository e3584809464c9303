"""``insnav live``: run the filter on a log while it is written."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import nullcontext
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

from insnav.cli import console
from insnav.cli import options as common
from insnav.cli.data_options import Data, takes_data
from insnav.exceptions import ConfigError, InputError, reason_of

if TYPE_CHECKING:
    from insnav.session.online import OnlineFilter
    from insnav.types import FloatArray

PIECE = 1 << 16  # most bytes taken at a time
INPUTS = ["lever_arm", "lever_arm_sd", "gps_delay", "heading", "static", "initial", "sampling", "stamp"]


@takes_data("LOG", files={}, only=("imu_model", "axes", "time_offset", *INPUTS))
def live(data: Data, rate: str = "10", correlated: str | None = None) -> None:
    """Run the filter on a log while it is written."""
    from insnav.input.interpret.physics import axes_matrix
    from insnav.input.stream import Stream
    from insnav.messages import sentence
    from insnav.session.online import OnlineFilter
    from insnav.types import GpsData

    inputs: dict[str, Any] = {**data.inputs}
    if inputs.get("imu_model") is None:
        raise ConfigError("online.no_imu", where="--imu")
    given = {key: inputs[key] for key in INPUTS if inputs[key] is not None}
    noise: Any = correlated and tuple(common.numbers(correlated, "--correlated", 2, "0.78,100"))
    nav = OnlineFilter(inputs["imu_model"], correlated=noise, **given)
    turn, offset = axes_matrix(inputs["axes"] or "FRD").T, inputs["time_offset"] or 0.0
    log, rows, told, fixes, samples = Stream(), _Rows(common.interval(rate)), set[object](), 0, 0
    for piece in _pieces(data):
        for each in log.take(piece):
            try:
                if isinstance(each, GpsData):
                    fixes += 1
                    fix = None if each.fix is None else int(each.fix[0])
                    sd = [*each.position_sd[0], *each.velocity_sd[0]]
                    nav.gps(each.time[0], each.lla[0], each.v_n[0], sd, fix)
                else:
                    samples += len(each)
                    rows.write(nav, each[:, 0] + offset, each[:, 1:4] @ turn, each[:, 4:] @ turn)
            except InputError as error:
                if error.code not in told:
                    console.note(error.reason)
                told.add(error.code)
            for finding in nav.state.findings:
                if finding.code not in told:
                    console.note(sentence(finding))
                told.add(finding.code)
    if not samples:
        raise InputError("online.no_samples", where=str(data.imu), count=fixes, skipped=log.skipped)
    if not rows.header:
        raise InputError("online.never_aligned", where=str(data.imu), cause=nav.state.findings[-1].get("cause", ""))


class _Rows:
    """Rows of the solution at most every `interval` [s]."""

    def __init__(self, interval: float) -> None:
        self._interval, self._next, self._last, self.header = interval, -float("inf"), -float("inf"), ""

    def write(self, nav: OnlineFilter, time: FloatArray, gyro: FloatArray, accel: FloatArray) -> None:
        """Feed the filter, and write a row for each interval that it has navigated.

        Raises: InputError: samples went back in time; the others are used.
        """
        import numpy as np

        from insnav.types import Trajectory

        before = np.maximum.accumulate(np.concatenate([[self._last], time]))
        back = np.flatnonzero(time <= before[:-1])
        self._last, given = float(before[-1]), time
        time, gyro, accel = (np.delete(each, back, axis=0) for each in (time, gyro, accel))
        number = np.floor(time / self._interval + 1e-6) if self._interval else time
        edges = np.flatnonzero(np.diff(number, prepend=-np.inf))
        for first, last in pairwise([*edges, time.size]):
            nav.imu(time[first:last], gyro[first:last], accel[first:last])
            state = nav.state
            if not state.aligned or not state.time >= self._next - 1e-6:
                continue
            self._next = (
                (np.floor(state.time / self._interval + 1e-6) + 1.0) * self._interval if self._interval else 0.0
            )
            values = (np.atleast_1d(state.time), *(each[None] for each in (state.lla, state.v_n, state.rph, state.sd)))
            columns = Trajectory(*values).columns()
            if not self.header:
                self.header = ",".join(columns)
                console.result(self.header, always=True)
            console.result(",".join(f"{column[0]:.13g}" for column in columns.values()), always=True)
        if back.size:
            raise InputError("online.time_back", where="imu", time_s=given[back[0]], before_s=before[back[0]])


def _pieces(data: Data) -> Iterator[bytes]:
    """Yield the content of a file, or of a pipe as it comes."""
    name = str(data.imu)
    try:
        with nullcontext(sys.stdin.buffer) if name == "-" else Path(name).open("rb") as file:
            while piece := os.read(file.fileno(), PIECE):
                yield piece
    except OSError as error:
        raise InputError("format.unreadable", where=name, reason=reason_of(error)) from error
