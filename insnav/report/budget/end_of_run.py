"""The report on the error at the end of a run: which tilt, bias or drift explains it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from insnav.errors.diagnosis.end_of_run import EndAxis
from insnav.findings import Code, Finding
from insnav.imu import ImuSpec
from insnav.quantity import Quantity
from insnav.report.numbers import number
from insnav.report.page import Page, Section, only_json
from insnav.units import DEG, DEG_PER_H, G0


def end_page(
    axes: Sequence[EndAxis], time: float, gravity: float, sd: tuple[float, float], spec: ImuSpec | None
) -> Page:
    """Lay out the explanations of each axis, beside what the specification of the IMU says, if there is one.

    `gravity` [m/s^2]; `sd`: of the reference [m], [m/s].
    """
    given = _specified(spec)
    rows = []
    for axis in axes:
        # a velocity, a tilt, a bias, a drift: the second and third are one acceleration
        for term, name, value, spread, unit, k in (
            ("t", "velocity at the start", axis.alone[0], axis.sd[0], "m/s", 0),
            ("t²", "tilt", axis.alone[1] / gravity, axis.sd[1] / gravity, "mrad", 1),
            ("t²", "accelerometer bias", axis.alone[1], axis.sd[1], "mg", 1),
            ("t³", "gyro drift", axis.alone[2] / gravity, axis.sd[2] / gravity, "deg/h", 2),
        ):
            assumed = given.get(name, 0.0)
            rows.append(
                (
                    Quantity("axis", axis.axis),
                    Quantity("cause", name),
                    Quantity("grows_with", term),
                    Quantity("value", f"{number(value / _FACTOR[unit])} ± {number(spread / _FACTOR[unit], 2)} {unit}"),
                    Quantity("value_si", float(value)),
                    Quantity("left_sd", float(axis.left[k]), meaning="left unexplained [sd]"),
                    Quantity("explains", axis.fits[k]),
                    Quantity("by_specification", abs(value) / assumed if assumed > 0.0 else None, digits=2),
                )
            )
    powers = {axis.axis: axis.power for axis in axes}
    return Page(
        f"Error at the end of {time:g} s of free-inertial navigation",
        tuple(_sentence(axis, gravity, given) for axis in axes),
        (
            Section("causes", "Each cause alone", rows=tuple(rows), note="by specification: in 1 sd of the IMU file"),
            only_json("", Quantity("power_of_time", powers), Quantity("gravity", gravity, "m/s^2")),
        ),
        findings=_assumptions(sd),
    )


_FACTOR = {"m/s": 1.0, "mrad": 1e-3, "mg": 1e-3 * G0, "deg/h": DEG_PER_H}


def _assumptions(sd: tuple[float, float]) -> tuple[Finding, ...]:
    reference = Finding.of(Code.END_OF_RUN_REFERENCE_SD, position_m=sd[0], velocity_m_s=sd[1])
    return Finding.of(Code.END_OF_RUN_LEVEL), reference, Finding.of(Code.END_OF_RUN_TILT_OR_BIAS)


def _specified(spec: ImuSpec | None) -> dict[str, float]:
    """One standard deviation of each cause by the specification, the largest axis."""
    if spec is None:
        return {}
    found = {"accelerometer bias": float(np.max(spec.accel.bias)), "gyro drift": float(np.max(spec.gyro.bias))}
    if spec.initial is not None:
        found |= {"tilt": spec.initial.tilt, "velocity at the start": spec.initial.velocity}
    return found


def _sentence(axis: EndAxis, gravity: float, given: dict[str, float]) -> str:
    head = f"{axis.axis.capitalize()}, {number(axis.position)} m and {number(axis.velocity)} m/s"
    if len(axis.terms) > 1:
        return f"{head}: no single cause explains both; any two of t, t² and t³ do."
    head += f", growing with t to the power of {axis.power:.2f}" if np.isfinite(axis.power) else ""
    (term,) = axis.terms
    if term == "t":
        return f"{head}: a velocity error of {number(axis.alone[0])} m/s at the start."
    if term == "t³":
        return f"{head}: a gyro drift of {number(axis.alone[2] / gravity / DEG_PER_H)} deg/h."
    tilt = axis.alone[1] / gravity
    text = (
        f"{head}: {number(abs(tilt) * 1e3)} mrad ({number(abs(tilt) / DEG)} deg) of tilt, or "
        f"{number(abs(axis.alone[1]) / G0 * 1e3)} mg of accelerometer bias"
    )
    assumed = given.get("tilt", 0.0)
    return text + (f"; {number(abs(tilt) / assumed, 2)} times the tilt specified." if assumed > 0.0 else ".")
