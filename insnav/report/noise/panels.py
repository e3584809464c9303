"""Allan deviations on double logarithmic axes, with the lines their slopes are read from."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from insnav.lab.noise.allan import AllanDeviation
from insnav.lab.noise.noise_model import NoiseModel
from insnav.report.colours import AXIS_COLOURS, GREY
from insnav.report.panels import Curve, Panel
from insnav.types import FloatArray
from insnav.units import DEG_PER_H, UG

NOTE = "points: overlapping Allan deviation; band: 95 %; lines: fitted model; grey: slopes of Q, N, B, K, R"
_GUIDES = ((-1.0, "Q −1"), (-0.5, "N −½"), (0.0, "B 0"), (0.5, "K +½"), (1.0, "R +1"))
_TALL = 2.4  # the lines reach up and down by this factor at most
_SENSORS = (("gyros", "deg/h", DEG_PER_H), ("accelerometers", "ug", UG))


def allan_panels(allan: AllanDeviation, models: Sequence[NoiseModel | None]) -> Iterator[Panel]:
    """Draw the deviations of six axes with 95 % intervals, their models, and guides of every slope.

    `models`: one for each; None is not drawn.
    """
    tau, note = allan.tau, NOTE
    for first, (name, unit, size) in zip((0, 3), _SENSORS, strict=True):
        curves, seen = [], []
        for axis, colour in enumerate(AXIS_COLOURS):
            model, deviation = models[first + axis], allan.deviation[:, first + axis] / size
            if model is not None:
                seen.append(deviation[deviation > 0.0])
                curves += [
                    Curve("xyz"[axis], tau, model.high / size, colour, "band", model.low / size),
                    Curve("xyz"[axis], tau, deviation, colour, "points"),
                    Curve("xyz"[axis], tau, np.sqrt(model.variance) / size, colour),
                ]
        if not seen:
            continue
        low, high = (float(limit(np.concatenate(seen))) for limit in (np.min, np.max))
        yield Panel(
            f"allan_{name}",
            f"Allan deviation of the {name}",
            f"Allan deviation [{unit}]",
            "averaging time [s]",
            (*curves, *_guides(tau, high)),
            "tau",
            note,
            log_x=True,
            log_y=True,
            limits=(0.4 * low, 5.0 * high),
            height=400,
        )
        note = ""


def _guides(tau: FloatArray, high: float) -> list[Curve]:
    """Short lines of every slope through one point, in the corner that the curves leave free."""
    half = (float(tau[-1]) / float(tau[0])) ** 0.1
    x, y, curves = float(tau[-1]) / half, 1.8 * high, []
    for slope, text in _GUIDES:
        reach = half if slope == 0.0 else min(half, _TALL ** (1.0 / abs(slope)))
        ends = np.array([1.0 / reach, reach])
        curves.append(Curve("", x * ends, y * ends**slope, GREY, "thin", text=(text, text)))
    return curves
