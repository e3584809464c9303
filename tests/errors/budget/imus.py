"""IMUs for the tests of the budget."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from insnav.imu import ClockSpec, ImuSpec, InitialSpec, SensorSpec
from insnav.units import DEG, DEG_PER_H, DEG_PER_SQRT_H, UG


def _axes(value: float) -> np.ndarray:
    return value * np.array([1.0, 1.2, 0.8])


def plain() -> ImuSpec:
    """The terms of most datasheets, with an uncertain start: small enough for a linear model."""
    return ImuSpec(
        "plain",
        SensorSpec(
            bias=_axes(2.0 * DEG_PER_H),
            bias_instability=_axes(1.0 * DEG_PER_H),
            correlation_time=40.0,
            random_walk=_axes(0.1 * DEG_PER_SQRT_H),
            scale_factor=_axes(3e-4),
            misalignment=_axes(2e-4),
        ),
        SensorSpec(
            bias=_axes(200.0 * UG),
            bias_instability=_axes(100.0 * UG),
            correlation_time=25.0,
            random_walk=_axes(1e-3),
            scale_factor=_axes(5e-4),
            misalignment=_axes(2e-4),
        ),
        InitialSpec(0.5, 0.03, 0.02 * DEG, 0.2 * DEG),
    )


def whole() -> ImuSpec:
    """Everything that the budget knows, each of about the same weight."""
    spec = plain()
    gyro = replace(
        spec.gyro,
        rate_random_walk=_axes(2e-7),
        quantisation=_axes(2e-5),
        flicker=_axes(0.5 * DEG_PER_H),
        rate_ramp=_axes(1e-7),
        asymmetry=_axes(3e-4),
        quadratic=_axes(1e-3),
        g_sensitivity=_axes(3e-7),
    )
    accel = replace(
        spec.accel,
        rate_random_walk=_axes(2e-4),
        quantisation=_axes(5e-3),
        flicker=_axes(80.0 * UG),
        rate_ramp=_axes(1e-4),
        asymmetry=_axes(4e-4),
        quadratic=_axes(5e-5),
    )
    return replace(spec, gyro=gyro, accel=accel, clock=ClockSpec(offset=2e-3, drift=2e-4))
