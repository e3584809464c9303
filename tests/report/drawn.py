"""A page with panels of every kind, for tests that look at it."""

from __future__ import annotations

import numpy as np

from insnav.findings import Severity
from insnav.quantity import Quantity
from insnav.report.page import Page, Section, Verdict
from insnav.report.panels import Curve, Panel, Shade, Track
from insnav.report.style import AXIS_COLOURS, BLUE, GREY
from tests.report.conftest import stored

HOSTILE = "</script><script>alert(1)</script>"
SPIKE = 1234  # row of the only outlier


def panels(name: str = "north") -> tuple[Track | Panel, ...]:
    """A map, errors with bands under a switch, a cloud on a logarithmic axis: linked; bars: not."""
    time = np.linspace(0.0, 3600.0, 20001)
    rng = np.random.default_rng(3)
    error = 0.1 * np.sin(time / 40.0)
    spiked = error.copy()
    spiked[SPIKE] = 30.0
    curves = []
    for mode, values in (("smoothed", 0.5 * error), ("filtered", spiked)):
        curves += [
            Curve(name, time, values, AXIS_COLOURS[0], mode=mode),
            Curve(name, time, np.full(time.shape, 0.4), AXIS_COLOURS[0], "band", np.full(time.shape, -0.4), mode),
        ]
    share = time[::20] / 3600.0
    track = Track(
        "map",
        "Track",
        2000.0 * np.sin(6.0 * share),
        1000.0 * np.sin(12.0 * share),
        time[::20],
        (
            Shade("sd [m]", 1.0 + share),
            Shade("fix", np.round(share), ((0.0, "single"), (1.0, "fixed"))),
        ),
        "time",
        fixes=rng.normal(size=(100, 2)),
        spans=((600.0, 700.0),),
    )
    cloud = Curve("NIS", time[::20], rng.chisquare(3, 1001), BLUE, "points")
    bar = Curve("part", np.array([60.0, 100.0]), np.arange(2.0), GREY, "bars", np.array([0.0, 60.0]), text=(name, "b"))
    return (
        track,
        Panel("error", "Position error", "error [m]", "time [s]", tuple(curves), "time", spans=((600.0, 700.0),)),
        Panel("nis", "NIS", "NIS [-]", "time [s]", (cloud,), "time", log="y", levels=((16.3, "gate (16.3)"),)),
        Panel("parts", "Contributions", "", "share [%]", (bar,), rows=("gyro bias", "heading"), height=120),
    )


def page(name: str = "north") -> Page:
    """A page that has everything the frame knows."""
    return Page(
        "Navigation of drive.csv",
        ("Second sentence.",),
        (
            Section("drawn", "Drawn", panels=panels(name)),
            Section("table", "A table", (Quantity("length", 3.0, "m"),), folded=True),
        ),
        (stored("the lever arm was not given", Severity.WARNING), stored("a note")),
        verdict=Verdict("attention", "lever arm not given", "Horizontal error 0.148 m RMS."),
        merits=tuple(Quantity(f"merit_{i}", 0.5 * i, "m") for i in range(6)),
    )
