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

PIECE = 1 << 16  # bytes read at a time, at most
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
    to_body, offset = axes_matrix(inputs["axes"] or "FRD").T, inputs["time_offset"] or 0.0
    log, rows, reported, fixes, samples = Stream(), _Rows(common.interval(rate)), set[object](), 0, 0
    for content in _pieces(data):
        for record in log.take(content):
            try:
                if isinstance(record, GpsData):
                    fixes += 1
                    fix = None if record.fix is None else int(record.fix[0])
                    sd = [*record.position_sd[0], *record.velocity_sd[0]]
                    nav.gps(record.time[0], record.lla[0], record.v_n[0], sd, fix)
                else:
                    samples += len(record)
                    rows.write(nav, record[:, 0] + offset, record[:, 1:4] @ to_body, record[:, 4:] @ to_body)
            except InputError as error:
                if error.code not in reported:
                    console.note(error.reason)
                reported.add(error.code)
            for finding in nav.state.findings:
                if finding.code not in reported:
                    console.note(sentence(finding))
                reported.add(finding.code)
    if not samples:
        raise InputError("online.no_samples", where=str(data.imu), count=fixes, skipped=log.skipped)
    if not rows.header:
        raise InputError("online.never_aligned", where=str(data.imu), cause=nav.state.findings[-1].get("cause", ""))


class _Rows:
    """Writer of the rows of the solution, at most one every `interval` [s]."""

    def __init__(self, interval: float) -> None:
        self._interval, self._next, self._last, self.header = interval, -float("inf"), -float("inf"), ""

    def write(self, nav: OnlineFilter, time: FloatArray, gyro: FloatArray, accel: FloatArray) -> None:
        """Pass samples to the filter, and write one row of the solution for each interval.

        Raises: InputError: some samples go back in time; the filter uses the other samples.
        """
        import numpy as np

        from insnav.types import Trajectory

        # remove samples that are not later than all earlier samples
        latest = np.maximum.accumulate(np.concatenate([[self._last], time]))
        backward = np.flatnonzero(time <= latest[:-1])
        self._last, given = float(latest[-1]), time
        time, gyro, accel = (np.delete(array, backward, axis=0) for array in (time, gyro, accel))
        # pass the samples of each output interval together
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
            values = (np.atleast_1d(state.time), *(part[None] for part in (state.lla, state.v_n, state.rph, state.sd)))
            columns = Trajectory(*values).columns()
            if not self.header:
                self.header = ",".join(columns)
                console.result(self.header, always=True)
            console.result(",".join(f"{column[0]:.13g}" for column in columns.values()), always=True)
        if backward.size:
            raise InputError("online.time_back", where="imu", time_s=given[backward[0]], before_s=latest[backward[0]])


def _pieces(data: Data) -> Iterator[bytes]:
    """Yield the content of a file in pieces, or of a pipe as it arrives."""
    name = str(data.imu)
    try:
        with nullcontext(sys.stdin.buffer) if name == "-" else Path(name).open("rb") as file:
            while piece := os.read(file.fileno(), PIECE):
                yield piece
    except OSError as error:
        raise InputError("format.unreadable", where=name, reason=reason_of(error)) from error
