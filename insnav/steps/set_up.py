"""A recording and its estimates as the filter needs them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from insnav import spill
from insnav.filter.prepare import Prepared, Start, prepare
from insnav.filter.settings import FilterSettings
from insnav.steps import Model, Recording


def filter_settings(recording: Recording, model: Model) -> FilterSettings:
    """Return the settings of the filter."""
    inputs = recording.inputs
    return FilterSettings(
        lever_b=model.lever_arm.value,
        lever_sd=model.lever_arm.sd,
        delay=model.gps_delay.value,
        delay_sd=model.gps_delay.sd,
        mounting_yaw=model.mounting_yaw.value,
        heading_sd=inputs.get("gps_heading_sd") or 0.0,
        fixed_height_sd=inputs.get("fixed_height_sd") or 0.0,
        logs=tuple(log.data for log in recording.logs.values()),
    )


def set_up_filter(
    recording: Recording, model: Model, clock: float = 0.0, rate: float = 0.0, heading: float | None = None
) -> Prepared:
    """Align a recording and set the filter up.

    `clock`, `rate`: by which all that has the time of the samples is moved at the start [s], and made faster [s/s];
    `heading`: at the start [rad].
    """
    inputs, imu = recording.inputs, recording.imu.data
    assert recording.fixes is not None
    assert model.imu is not None
    initial, span = inputs.get("initial"), inputs.get("static")
    begin, end = float(imu.time[0]), float(imu.time[-1])

    def moved(time: Any) -> Any:
        return time + clock + rate * (time - begin)

    settings = filter_settings(recording, model)
    ready = prepare(
        replace(imu, time=spill.by_blocks(moved, imu.time)),
        recording.fixes,
        model.imu[0],
        replace(settings, logs=tuple(replace(log, time=moved(log.time)) for log in settings.logs)),
        states=model.task.states,
        start=replace(initial, time=moved(initial.time)) if isinstance(initial, Start) else None,
        static_span=None if span is None else (moved(span[0]), moved(span[1])),
        heading=heading,
    )
    return replace(ready, clock=clock + 0.5 * rate * (end - begin), rate=rate)
