"""Checks of strapdown integrators: motion within a few samples, hours without aiding, poles, a day of errors."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from insnav import attitude
from insnav.certificate.integrators import Check, Integrator, attitude_after
from insnav.certificate.motions import Cone, Scull, around_pole, even, over_pole, start_of, swell, uneven
from insnav.earth import earth_from_lla, earth_rate_n, gravity_n, near_pole, ned_offset, radii
from insnav.errors.platform_errors import measured_periods, periods, static_errors
from insnav.gimbal import PlatformErrors
from insnav.simulate import LevelTruth, Truth, circle, imu_from_truth, straight
from insnav.simulate.truth import Harmonic
from insnav.types import FloatArray, ImuData, IntArray, Trajectory
from insnav.units import DEG, DEG_PER_H, G0, UG

RATE = 100.0  # sampling rate [Hz]
_SPAN = 40.0  # length of one record [s]
_EDGE = 1.0  # time excluded at either end, where windows of samples are one-sided [s]
_ARCSEC = DEG / 3600.0
# Largest residual drift under coning of 1 deg [deg/h], by frequency [Hz]. It grows with the square of the angle. At 20
# Hz a cycle has five samples, too few for any algorithm: this limit documents the expected error.
_CONING_LIMITS = {1.0: 1e-4, 5.0: 0.02, 10.0: 0.1, 20.0: 70.0}
_PLACE = np.array([48.0 * DEG, 11.0 * DEG, 500.0])
_HOUR = 3600.0
DAY = 86400.0  # length of a day [s]
PLACE = np.array([45.0 * DEG, 0.2, 0.0])
# errors small enough for the linear closed form, and large enough to be measured
ERRORS = PlatformErrors(
    tilt=np.array([0.0, 0.0, 20.0 / 3600.0]) * DEG,
    drift=np.array([1e-3, 1e-3, 1e-3]) * DEG_PER_H,
    bias=np.array([30.0, 30.0, 0.0]) * UG,
)
_AMPLITUDE, _PERIOD = 0.002, 0.001  # limits of errors and of periods, relative to theory [-]
Record = tuple[str, FloatArray, FloatArray]  # integrator, time since the start [s], position error North, East [m]


def coning(integrators: Sequence[Integrator]) -> list[Check]:
    """Check the attitude drift under coning of three amplitudes at four frequencies, and with uneven samples."""
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
    """Compute the attitude drift rate [rad/s], from intervals with edges ``(n + 1,)`` [s]."""
    gyro = np.diff(motion.angle(time), axis=0)
    steps = integrator.steps(ImuData(time[1:], gyro, np.zeros_like(gyro), "increment"))
    begin, inside = _inner(steps.time, steps.dt, time[-1])
    before, after = motion.quaternion(begin[inside]), motion.quaternion(steps.time[inside])
    # errors of the intervals, rotated from their initial axes to the fixed frame, are small and can be summed
    rotation = attitude.quat_multiply(attitude.quat_conjugate(before), after)
    error = attitude.rotvec_from_quat(
        attitude.quat_multiply(attitude.quat_from_rotvec(steps.rotation[inside]), attitude.quat_conjugate(rotation))
    )
    total = np.einsum("nij,nj->i", attitude.dcm_from_quat(before), error)
    return float(np.linalg.norm(total) / np.sum(steps.dt[inside]))


def sculling(integrators: Sequence[Integrator]) -> list[Check]:
    """Check the mean acceleration error of rotation and vibration in phase."""
    motion = Scull(0.1 * DEG, 2 * np.pi * 10.0, G0)
    return [
        Check("sculling", case, "ug", 0.5, tuple((i.name, abs(sculling_error(i, motion, t)) / UG) for i in integrators))
        for case, t in (
            ("0.1 deg, 1 g, 10 Hz", even(_SPAN, RATE)),
            ("0.1 deg, 1 g, 10 Hz, samples 8 to 11 ms apart", uneven(_SPAN)),
        )
    ]


def sculling_error(integrator: Integrator, motion: Scull, time: FloatArray) -> float:
    """Compute the false mean acceleration along z [m/s^2], from intervals with edges ``(n + 1,)`` [s]."""
    gyro, accel = np.diff(motion.rotation(time), axis=0), np.diff(motion.impulse(time), axis=0)
    steps = integrator.steps(ImuData(time[1:], gyro, accel, "increment"))
    begin, inside = _inner(steps.time, steps.dt, time[-1])
    axes = attitude.dcm_from_quat(attitude.quat_from_rotvec(motion.rotation(begin[inside])))
    gained = np.einsum("nj,nj->n", axes[:, 2], steps.velocity[inside]).sum()
    first, last = float(begin[inside][0]), float(steps.time[inside][-1])
    return (float(gained) - motion.gained(first, last)) / (last - first)


def spin(integrators: Sequence[Integrator]) -> list[Check]:
    """Check a rotation at 1000 deg/s about an oblique axis with constant specific force in the body, in closed form."""
    rate, force = 1000 * DEG * np.array([2.0, -3.0, 6.0]) / 7.0, np.array([3.0, -2.0, -9.8])
    dt, n = 1 / RATE, round(_SPAN * RATE)
    imu = ImuData(even(_SPAN, RATE)[1:], np.tile(rate * dt, (n, 1)), np.tile(force * dt, (n, 1)), "increment")
    # exact velocity of one interval: the mean rotated force, by an exact quadrature
    node, weight = np.polynomial.legendre.leggauss(12)
    rotated = attitude.dcm_from_quat(attitude.quat_from_rotvec(0.5 * dt * (node + 1.0)[:, None] * rate)) @ force
    velocity = 0.5 * dt * (weight @ rotated)
    drift, false_force = [], []
    for integrator in integrators:
        steps = integrator.steps(imu)
        diff = attitude.quat_multiply(
            attitude.quat_conjugate(attitude.quat_from_rotvec(rate * np.sum(steps.dt))), attitude_after(steps.rotation)
        )
        drift.append(
            (integrator.name, float(np.linalg.norm(attitude.rotvec_from_quat(diff)) / np.sum(steps.dt)) / DEG_PER_H)
        )
        error = np.linalg.norm(steps.velocity - velocity, axis=1).max() / dt
        false_force.append((integrator.name, float(error) / UG))
    return [
        Check("spin", "1000 deg/s, attitude", "deg/h", 0.02, tuple(drift)),
        Check("spin", "1000 deg/s, 10.4 m/s² along with it", "ug", 0.5, tuple(false_force)),
    ]


def upright(integrators: Sequence[Integrator]) -> list[Check]:
    """Check the attitude error in two loops through pitch +-90 deg, and at rest with the nose straight up and down."""
    checks, zero = [], np.zeros(3)
    position = Harmonic(zero, np.array([2e-6, 3e-6, 0.0]), zero, zero)
    for case, pitch, rate in (
        ("two loops at 20 deg/s", 0.0, 20.0 * DEG),
        ("rest, nose up", np.pi / 2, 0.0),
        ("rest, nose down", -np.pi / 2, 0.0),
    ):
        turning = Harmonic(np.array([0.0, pitch, 0.7]), np.array([0.0, rate, 0.0]), zero, zero)
        motion = LevelTruth(_PLACE, position, turning, 36.0)
        time = even(motion.duration, RATE)
        imu, start = imu_from_truth(motion, time), start_of(motion, time)
        true = attitude.dcm_from_rph(motion.attitude(time[2:]))
        held = np.full(len(true), _PLACE[2]), np.zeros(len(true))
        values = []
        for integrator in integrators:
            track = integrator.navigate(imu, start, *held, 1)
            difference = np.einsum("nji,njk->nik", true, attitude.dcm_from_rph(track.rph))
            angle = 0.5 * np.linalg.norm(difference - np.swapaxes(difference, 1, 2), axis=(1, 2)) / np.sqrt(2.0)
            values.append((integrator.name, float(np.max(angle)) / _ARCSEC))
        checks.append(Check("pitch +-90 deg", case, "arcsec", 1e-3, tuple(values)))
    return checks


def _inner(end: FloatArray, dt: FloatArray, last: float) -> tuple[FloatArray, IntArray]:
    """Return the start of each interval, and the rows of intervals away from the ends of the record."""
    begin = end - dt
    return begin, np.flatnonzero((begin > _EDGE - 1e-6) & (end < last - _EDGE + 1e-6))


def free_inertial(integrators: Sequence[Integrator]) -> list[Check]:
    """Check the largest horizontal error of an hour on closed-form motions, and five minutes of uneven samples."""
    east = straight(_PLACE, 250.0, np.pi / 2, _HOUR, roll=0.2, pitch=0.05)
    motions = (
        ("1 h of circles at 20 m/s", circle(_PLACE, 20.0, 0.1, _HOUR), even(_HOUR, 50.0)),
        ("1 h at 250 m/s due east, banked", east, even(_HOUR, 50.0)),
        ("5 min on a swell", swell(300.0, _PLACE), even(300.0, RATE)),
        ("5 min on a swell, samples 8 to 11 ms apart", swell(300.0, _PLACE), uneven(300.0)),
    )
    return [
        Check("free inertial, height held", case, "m", 0.03, _apart(_tracks(integrators, truth, time), truth))
        for case, truth, time in motions
    ]


def schuler(integrators: Sequence[Integrator]) -> list[Check]:
    """Check the oscillation period of a tilt about North at the equator, against ``2 pi sqrt((R_N + h) / g)``.

    There the Earth's rotation rotates the level frame about North only, so that tilt and east velocity form a separate
    oscillator (Groves 2013, section 5.7.2).
    """
    place, rate = np.array([0.0, 0.0, 500.0]), 5.0
    period = 2 * np.pi * np.sqrt((float(radii(0.0)[1]) + place[2]) / float(gravity_n(0.0, place[2])[2]))
    imu = _at_rest(place, np.zeros(3), even(2.1 * period, rate))
    values = []
    for integrator in integrators:
        track = _navigated(integrator, imu, place, np.array([1e-4, 0.0, 0.0]), 1)
        v = track.v_n[:, 1]
        sign_changes = np.flatnonzero(np.diff(np.signbit(v[10:]))) + 10
        crossing = track.time[sign_changes] - v[sign_changes] / (v[sign_changes + 1] - v[sign_changes]) / rate
        complete = crossing.size == 4
        values.append((integrator.name, abs(float(crossing[3] - crossing[1]) / period - 1.0) if complete else np.inf))
    return [Check("Schuler period", f"tilt at the equator, {period:.1f} s", "1", 1e-5, tuple(values))]


def rest(integrators: Sequence[Integrator]) -> list[Check]:
    """Check the computed motion of a stationary, height-constrained body in four hours."""
    rph = np.array([0.1, -0.3, 2.2])
    checks = []
    for lat in (0.0, 45.0, 80.0, 89.9):
        place = np.array([lat * DEG, 0.2, 500.0])
        imu = _at_rest(place, rph, even(4 * _HOUR, 20.0))
        values = tuple((i.name, _moved(_navigated(i, imu, place, rph, 200), place)) for i in integrators)
        checks.append(Check("rest for 4 h", f"latitude {lat:g} deg", "m", 1e-3, values))
    return checks


def meridians(integrators: Sequence[Integrator]) -> list[Check]:
    """Compare the same motion across Greenwich or the date line and across longitude 57 deg."""
    checks = []
    for case, lon in (("Greenwich", 0.0), ("date line", np.pi)):
        tracks = []
        for longitude in (1.0, lon):
            truth = circle(np.array([0.8, longitude, 100.0]), 20.0, 0.1, 120.0)
            tracks.append([track for _, track in _tracks(integrators, truth, even(truth.duration, 50.0))])
        values = []
        for integrator, at_57, there in zip(integrators, *tracks, strict=True):
            shifted = np.concatenate([at_57.lla[:, :1], at_57.lla[:, 1:2] + (lon - 1.0), at_57.lla[:, 2:]], axis=1)
            difference = np.abs(ned_offset(there.lla, shifted)).max()
            values.append((integrator.name, np.inf if np.any(np.abs(there.lla[:, 1]) > np.pi) else float(difference)))
        checks.append(Check("longitude", f"crossing {case}", "m", 1e-6, tuple(values)))
    return checks


def poles(integrators: Sequence[Integrator]) -> list[Check]:
    """Check flights across and next to a pole, a small circle around a pole, and rest at a pole."""
    over = over_pole(250.0, 600.0)
    time = even(600.0, RATE)
    tracks = _tracks(integrators, over, time)
    beyond = tuple((name, float(np.maximum(np.abs(t.lla[:, 0]).max() / DEG - 90.0, 0.0))) for name, t in tracks)
    headings = tuple((name, _headings_given(t)) for name, t in tracks)
    checks = [
        Check("poles", "10 min at 250 m/s over the North Pole", "m", 0.01, _apart(tracks, over)),
        Check("poles", "the same: latitude beyond 90 deg", "deg", 0.0, beyond),
        Check("poles", "the same: headings given within 1 km", "1", 0.0, headings),
    ]
    for case, truth in (
        ("10 min at 900 m/s, 30 m past the South Pole", over_pole(900.0, 600.0, miss=30.0, south=True)),
        ("10 min round the pole at 100 m, 5 m/s", around_pole(5.0, 100.0, 600.0)),
    ):
        checks.append(Check("poles", case, "m", 0.01, _apart(_tracks(integrators, truth, time), truth)))
    place, rph = np.array([np.pi / 2, 0.0, 2800.0]), np.array([0.1, -0.3, 2.2])
    imu = _at_rest(place, rph, even(_HOUR, RATE))
    values = tuple((i.name, _moved(_navigated(i, imu, place, rph, 1000), place)) for i in integrators)
    return [*checks, Check("poles", "rest at the North Pole for 1 h", "m", 0.01, values)]


def _headings_given(track: Trajectory) -> float:
    """Count the headings other than NaN within a kilometre of a pole; NaN if a latitude is NaN."""
    lat = track.lla[:, 0]
    return float(np.sum(np.where(np.isnan(lat), np.nan, near_pole(lat) & np.isfinite(track.rph[:, 2]))))


def _at_rest(place: FloatArray, rph: FloatArray, time: FloatArray) -> ImuData:
    """Build increments at rest on the rotating Earth, from constant Earth rate and gravity in body axes."""
    c_bn, dt = attitude.dcm_from_rph(rph).T, np.diff(time)[:, None]
    return ImuData(
        time[1:], dt * (c_bn @ earth_rate_n(place[0])), -dt * (c_bn @ gravity_n(place[0], place[2])), "increment"
    )


def _navigated(integrator: Integrator, imu: ImuData, place: FloatArray, rph: FloatArray, every: int) -> Trajectory:
    n = imu.time.size - 1
    return integrator.navigate(imu, (place, np.zeros(3), rph), np.full(n, place[2]), np.zeros(n), every)


def _moved(found: Trajectory, place: FloatArray) -> float:
    return float(np.linalg.norm(earth_from_lla(found.lla) - earth_from_lla(place[None]), axis=1).max())


def _tracks(integrators: Sequence[Integrator], truth: Truth, time: FloatArray) -> list[tuple[str, Trajectory]]:
    """Navigate a motion with each integrator, from its exact start and with its exact height."""
    imu, true = imu_from_truth(truth, time), truth.evaluate(time[2:])
    constraint = true.lla[:, 2], true.v_n[:, 2]
    return [(i.name, i.navigate(imu, start_of(truth, time), *constraint, 1)) for i in integrators]


def _apart(tracks: Sequence[tuple[str, Trajectory]], truth: Truth) -> tuple[tuple[str, float], ...]:
    """Compute the largest distance from the truth [m]."""
    true = earth_from_lla(truth.evaluate(tracks[0][1].time).lla)
    return tuple((name, float(np.linalg.norm(earth_from_lla(t.lla) - true, axis=1).max())) for name, t in tracks)


def day(integrators: Sequence[Integrator]) -> list[Check]:
    """Check the errors of a level, north-pointing, height-constrained navigator in a day at rest."""
    time = even(DAY + 1.0, 1.0)
    dt = np.diff(time)[:, None]
    # a gyro with positive bias rotates the computed axes opposite to a drifting platform
    gyro, accel = earth_rate_n(PLACE[0]) - ERRORS.drift, ERRORS.bias - gravity_n(PLACE[0], PLACE[2])
    imu = ImuData(time[1:], dt * gyro, dt * accel, "increment")
    zero = np.zeros(imu.time.size - 1)
    records = []
    for integrator in integrators:
        track = integrator.navigate(imu, (PLACE, np.zeros(3), -ERRORS.tilt), zero, zero, 60)
        records.append((integrator.name, track.time - imu.time[0], ned_offset(track.lla, PLACE)[:, :2]))
    return compared("a day at rest with errors", records)


def compared(topic: str, records: Sequence[Record], where: str = "") -> list[Check]:
    """Compare position errors, and their periods, with the closed form for `ERRORS`. `where`: prefix of case names."""
    theory = periods(float(PLACE[0]), float(PLACE[2]))
    found = [(name, _parts(time, position)) for name, time, position in records]
    cases = (
        ("error, in parts of its largest", _AMPLITUDE),
        (f"Schuler period, {theory.schuler / 60.0:.2f} min", _PERIOD),
        (f"Foucault period, {theory.foucault / 3600.0:.2f} h", _PERIOD),
        (f"Earth's period, {(theory.earth or 0.0) / 3600.0:.2f} h", _PERIOD),
    )
    return [
        Check(topic, where + case, "1", limit, tuple((name, parts[k]) for name, parts in found))
        for k, (case, limit) in enumerate(cases)
    ]


def _parts(time: FloatArray, position: FloatArray) -> tuple[float, ...]:
    """Compute relative differences from theory: of the position, and of Schuler, Foucault and Earth periods."""
    if not np.isfinite(position).all():
        return (np.inf,) * 4
    lat, height = float(PLACE[0]), float(PLACE[2])
    theory = static_errors(time, lat, height, ERRORS).position
    difference = float(np.abs(position - theory).max() / np.abs(theory).max())
    measured, true = measured_periods(time, position, lat, height), periods(lat, height)
    pairs = ((measured.schuler, true.schuler), (measured.foucault, true.foucault), (measured.earth, true.earth))
    return difference, *(abs(a / b - 1.0) if a is not None and b is not None else np.inf for a, b in pairs)


# topics of checks, each for a sequence of strapdown integrators
TOPICS = (coning, sculling, spin, upright, free_inertial, schuler, rest, day, meridians, poles)
