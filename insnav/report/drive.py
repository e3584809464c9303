"""Figure of the data of a drive before navigation."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from insnav.earth import ned_offset
from insnav.findings import Code, of_code
from insnav.imu.model import per_sample
from insnav.report.figures import draw_drawings, drawing
from insnav.report.panels import Clock, Curve, Kind, Panel
from insnav.report.style import AXIS_COLOURS, NED, duration_text
from insnav.steps import Recording
from insnav.types import FloatArray
from insnav.units import DEG


def drive_figure(recording: Recording) -> Figure:
    """Draw angular rates, specific forces, fixes and their velocities over one time axis; gaps are shaded."""
    imu, gps = recording.imu.data, recording.gps
    clock, step = Clock.of(imu.time), per_sample(imu)
    rows: list[tuple[str, str, FloatArray, FloatArray, tuple[str, ...], Kind]] = [
        ("Angular rate", "rate [deg/s]", imu.time, imu.gyro / step / DEG, ("x", "y", "z"), "line"),
        ("Specific force", "force [m/s²]", imu.time, imu.accel / step, ("x", "y", "z"), "line"),
    ]
    if gps is not None:
        time, offset = gps.data.time, ned_offset(gps.data.lla, gps.data.lla[0])
        rows.append(("Fixes, seen from the first", "distance [m]", time, offset, NED, "points"))
        rows.append(("Velocity of the fixes", "velocity [m/s]", time, gps.data.v_n, NED, "points"))
    given = recording.given().values()
    gaps = [(each.begin, each.begin + each["gap_s"]) for one in given for each in of_code(one.events, Code.ROWS_GAP)]
    spans = tuple((float(begin), float(end)) for begin, end in clock(np.reshape(gaps, (-1, 2))))
    panels = [
        Panel(title, title, label, clock.label, tuple(curves), "time", spans=spans)
        for title, label, at, values, names, kind in rows
        if np.isfinite(values).any()
        for curves in [[Curve(n, clock(at), v, c, kind) for n, v, c in zip(names, values.T, AXIS_COLOURS, strict=True)]]
    ]
    title = f"{duration_text(np.ptp(imu.time))} of data, {len(gaps)} gap{'s' * (len(gaps) != 1)}"
    with drawing():
        return draw_drawings(panels, title, "body axes as read; shaded: gaps in any of the files")
