"""Coning, sculling, spin and a loop: what an integrator makes of motion within a few samples."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from insnav import attitude
from insnav.certificate.check import Check
from insnav.certificate.integrators import Integrator, attitude_after
from insnav.certificate.motions import Cone, Scull, even, start_of, uneven
from insnav.simulate import LevelTruth, imu_from_truth
from insnav.simulate.curves import Harmonic
from insnav.types import FloatArray, ImuData, IntArray
from insnav.units import DEG, DEG_PER_H, G0, UG

RATE = 100.0  # [Hz]
_SPAN = 40.0  # of one record [s]
_EDGE = 1.0  # left out at either end, where windows of samples are one-sided [s]
_ARCSEC = DEG / 3600.0
# what is left of coning of 1 deg [deg/h]; it grows with the square of the angle. 20 Hz are five samples a cycle: no
# algorithm on so few knows the motion, and the limit only says what to expect.
_CONING_LIMITS = {1.0: 1e-4, 5.0: 0.02, 10.0: 0.1, 20.0: 70.0}


def coning(integrators: Sequence[Integrator]) -> list[Check]:
    """Drift under coning of three amplitudes at four frequencies, and from uneven samples."""
    checks = []
    for angle in (0.1, 1.0, 3.0):
        for frequency, limit in _CONING_LIMITS.items():
            motion = Cone(angle * DEG, 2 * np.pi * frequency)
            values = tuple((i.name, coning_drift(i, motion, even(_SPAN, RATE)) / DEG_PER_H) for i in integrators)
            checks.append(
                Check("coning", f"{angle:g} deg, {frequency:g} Hz", "deg/h", float(f"{limit * angle**2:.3g}"), values)
            )
    motion = Cone(DEG, 2 * np.pi * 5.0)
    values = tuple((i.name, coning_drift(i, motion, uneven(_SPAN)) / DEG_PER_H) for i in integrators)
    checks.append(Check("coning", "1 deg, 5 Hz, samples 8 to 11 ms apart", "deg/h", 0.02, values))
    return checks


def coning_drift(integrator: Integrator, motion: Cone, time: FloatArray) -> float:
    """Rate at which the attitude leaves the true one [rad/s], from intervals with edges ``(n + 1,)`` [s]."""
    gyro = np.diff(motion.angle(time), axis=0)
    steps = integrator.steps(ImuData(time[1:], gyro, np.zeros_like(gyro), "increment"))
    begin, inside = _inner(steps.time, steps.dt, time[-1])
    before, after = motion.quaternion(begin[inside]), motion.quaternion(steps.time[inside])
    # error of every interval in the axes of its start, brought to the fixed frame: small, so that they add up
    turned = attitude.quat_multiply(attitude.quat_conjugate(before), after)
    error = attitude.rotvec_from_quat(
        attitude.quat_multiply(attitude.quat_from_rotvec(steps.rotation[inside]), attitude.quat_conjugate(turned))
    )
    total = np.einsum("nij,nj->i", attitude.dcm_from_quat(before), error)
    return float(np.linalg.norm(total) / np.sum(steps.dt[inside]))


def sculling(integrators: Sequence[Integrator]) -> list[Check]:
    """Mean acceleration error of rotation and vibration in phase."""
    motion = Scull(0.1 * DEG, 2 * np.pi * 10.0, G0)
    return [
        Check("sculling", case, "ug", 0.5, tuple((i.name, abs(sculling_error(i, motion, t)) / UG) for i in integrators))
        for case, t in (
            ("0.1 deg, 1 g, 10 Hz", even(_SPAN, RATE)),
            ("0.1 deg, 1 g, 10 Hz, samples 8 to 11 ms apart", uneven(_SPAN)),
        )
    ]


def sculling_error(integrator: Integrator, motion: Scull, time: FloatArray) -> float:
    """Mean acceleration along z that is not there [m/s^2], from intervals with edges ``(n + 1,)`` [s]."""
    gyro, accel = np.diff(motion.rotation(time), axis=0), np.diff(motion.impulse(time), axis=0)
    steps = integrator.steps(ImuData(time[1:], gyro, accel, "increment"))
    begin, inside = _inner(steps.time, steps.dt, time[-1])
    axes = attitude.dcm_from_quat(attitude.quat_from_rotvec(motion.rotation(begin[inside])))
    gained = np.einsum("nj,nj->n", axes[:, 2], steps.velocity[inside]).sum()
    first, last = float(begin[inside][0]), float(steps.time[inside][-1])
    return (float(gained) - motion.gained(first, last)) / (last - first)


def spin(integrators: Sequence[Integrator]) -> list[Check]:
    """1000 deg/s about a slanting axis with constant specific force in the body: everything is known."""
    rate, force = 1000 * DEG * np.array([2.0, -3.0, 6.0]) / 7.0, np.array([3.0, -2.0, -9.8])
    dt, n = 1 / RATE, round(_SPAN * RATE)
    imu = ImuData(even(_SPAN, RATE)[1:], np.tile(rate * dt, (n, 1)), np.tile(force * dt, (n, 1)), "increment")
    # exact velocity of one interval: the mean of the turned force, by quadrature fine enough to be exact
    node, weight = np.polynomial.legendre.leggauss(12)
    turned = attitude.dcm_from_quat(attitude.quat_from_rotvec(0.5 * dt * (node + 1.0)[:, None] * rate)) @ force
    velocity = 0.5 * dt * (weight @ turned)
    drift, false_force = [], []
    for integrator in integrators:
        steps = integrator.steps(imu)
        off = attitude.quat_multiply(
            attitude.quat_conjugate(attitude.quat_from_rotvec(rate * np.sum(steps.dt))), attitude_after(steps.rotation)
        )
        drift.append(
            (integrator.name, float(np.linalg.norm(attitude.rotvec_from_quat(off)) / np.sum(steps.dt)) / DEG_PER_H)
        )
        error = np.linalg.norm(steps.velocity - velocity, axis=1).max() / dt
        false_force.append((integrator.name, float(error) / UG))
    return [
        Check("spin", "1000 deg/s, attitude", "deg/h", 0.02, tuple(drift)),
        Check("spin", "1000 deg/s, 10.4 m/s² along with it", "ug", 0.5, tuple(false_force)),
    ]


def upright(integrators: Sequence[Integrator]) -> list[Check]:
    """Two loops through pitch +-90 deg, and rest with the nose straight up and down: attitude error."""
    place = np.array([48.0 * DEG, 11.0 * DEG, 500.0])
    checks = []
    for case, pitch, rate in (
        ("two loops at 20 deg/s", 0.0, 20.0 * DEG),
        ("rest, nose up", np.pi / 2, 0.0),
        ("rest, nose down", -np.pi / 2, 0.0),
    ):
        motion = LevelTruth(
            place,
            Harmonic(np.zeros(3), np.array([2e-6, 3e-6, 0.0]), np.zeros(3), np.zeros(3)),
            Harmonic(np.array([0.0, pitch, 0.7]), np.array([0.0, rate, 0.0]), np.zeros(3), np.zeros(3)),
            36.0,
        )
        time = even(motion.duration, RATE)
        imu, start = imu_from_truth(motion, time), start_of(motion, time)
        true = attitude.dcm_from_rph(motion.attitude(time[2:]))
        held = np.full(len(true), place[2]), np.zeros(len(true))
        values = []
        for integrator in integrators:
            found = integrator.navigate(imu, start, *held, 1)
            off = np.einsum("nji,njk->nik", true, attitude.dcm_from_rph(found.rph))
            angle = 0.5 * np.linalg.norm(off - np.swapaxes(off, 1, 2), axis=(1, 2)) / np.sqrt(2.0)
            values.append((integrator.name, float(np.max(angle)) / _ARCSEC))
        checks.append(Check("pitch +-90 deg", case, "arcsec", 1e-3, tuple(values)))
    return checks


def _inner(end: FloatArray, dt: FloatArray, last: float) -> tuple[FloatArray, IntArray]:
    """Start of each interval, and which of them are away from the ends of the record."""
    begin = end - dt
    return begin, np.flatnonzero((begin > _EDGE - 1e-6) & (end < last - _EDGE + 1e-6))
