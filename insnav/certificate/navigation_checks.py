"""An hour without aiding, the Schuler period, rest, meridians that are only numbers, and the poles."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from insnav.attitude import dcm_from_rph
from insnav.certificate.check import Check
from insnav.certificate.integrators import Integrator
from insnav.certificate.motions import even, start_of, swell, uneven
from insnav.certificate.polar import around_pole, over_pole
from insnav.earth import earth_rate_n, gravity_n, near_pole, ned_offset, radii
from insnav.earth_fixed import earth_from_lla
from insnav.simulate import Truth, circle, imu_from_truth, straight
from insnav.types import FloatArray, ImuData, Trajectory
from insnav.units import DEG

_PLACE = np.array([48.0 * DEG, 11.0 * DEG, 500.0])
_RATE = 100.0  # [Hz]
_HOUR = 3600.0


def free_inertial(integrators: Sequence[Integrator]) -> list[Check]:
    """Largest horizontal error of an hour on closed-form motions, and five minutes of uneven samples."""
    motions = (
        ("1 h of circles at 20 m/s", circle(_PLACE, 20.0, 0.1, _HOUR), even(_HOUR, 50.0), 0.03),
        (
            "1 h at 250 m/s due east, banked",
            straight(_PLACE, 250.0, np.pi / 2, _HOUR, roll=0.2, pitch=0.05),
            even(_HOUR, 50.0),
            0.03,
        ),
        ("5 min on a swell", swell(300.0, _PLACE), even(300.0, _RATE), 0.03),
        ("5 min on a swell, samples 8 to 11 ms apart", swell(300.0, _PLACE), uneven(300.0), 0.03),
    )
    return [
        Check("free inertial, height held", case, "m", limit, _apart(_tracks(integrators, truth, time), truth))
        for case, truth, time, limit in motions
    ]


def schuler(integrators: Sequence[Integrator]) -> list[Check]:
    """Period of the oscillation that a tilt about North starts at the equator, against ``2 pi sqrt((R_N + h) / g)``.

    There the Earth's rotation turns the level frame about North only, so that tilt and east velocity are an
    oscillator of their own (Groves 2013, section 5.7.2).
    """
    place, rate = np.array([0.0, 0.0, 500.0]), 5.0
    period = 2 * np.pi * np.sqrt((float(radii(0.0)[1]) + place[2]) / float(gravity_n(0.0, place[2])[2]))
    imu = _at_rest(place, np.zeros(3), even(2.1 * period, rate))
    values = []
    for integrator in integrators:
        found = _navigated(integrator, imu, place, np.array([1e-4, 0.0, 0.0]), 1)
        v = found.v_n[:, 1]
        turns = np.flatnonzero(np.diff(np.signbit(v[10:]))) + 10
        crossing = found.time[turns] - v[turns] / (v[turns + 1] - v[turns]) / rate
        four = crossing.size == 4
        values.append((integrator.name, abs(float(crossing[3] - crossing[1]) / period - 1.0) if four else np.inf))
    return [Check("Schuler period", f"tilt at the equator, {period:.1f} s", "1", 1e-5, tuple(values))]


def rest(integrators: Sequence[Integrator]) -> list[Check]:
    """How far a thing at rest moves in four hours, height held."""
    rph = np.array([0.1, -0.3, 2.2])
    checks = []
    for lat in (0.0, 45.0, 80.0, 89.9):
        place = np.array([lat * DEG, 0.2, 500.0])
        imu = _at_rest(place, rph, even(4 * _HOUR, 20.0))
        values = tuple((i.name, _moved(_navigated(i, imu, place, rph, 200), place)) for i in integrators)
        checks.append(Check("rest for 4 h", f"latitude {lat:g} deg", "m", 1e-3, values))
    return checks


def meridians(integrators: Sequence[Integrator]) -> list[Check]:
    """Difference between the same motion across a meridian and across longitude 57 deg."""
    checks = []
    for case, lon in (("Greenwich", 0.0), ("date line", np.pi)):
        tracks = []
        for at in (1.0, lon):
            truth = circle(np.array([0.8, at, 100.0]), 20.0, 0.1, 120.0)
            time = even(truth.duration, 50.0)
            tracks.append([track for _, track in _tracks(integrators, truth, time)])
        values = []
        for integrator, usual, there in zip(integrators, *tracks, strict=True):
            moved = np.concatenate([usual.lla[:, :1], usual.lla[:, 1:2] + (lon - 1.0), usual.lla[:, 2:]], axis=1)
            off = np.abs(ned_offset(there.lla, moved)).max()
            outside = np.any(np.abs(there.lla[:, 1]) > np.pi)
            values.append((integrator.name, np.inf if outside else float(off)))
        checks.append(Check("longitude", f"crossing {case}", "m", 1e-6, tuple(values)))
    return checks


def poles(integrators: Sequence[Integrator]) -> list[Check]:
    """Flights over and next to a pole, a small circle about one, rest at one; latitude and heading on the way."""
    over = over_pole(250.0, 600.0)
    time = even(600.0, _RATE)
    tracks = _tracks(integrators, over, time)
    beyond = tuple((name, float(np.maximum(np.abs(t.lla[:, 0]).max() / DEG - 90.0, 0.0))) for name, t in tracks)
    given = tuple((name, _headings_given(t)) for name, t in tracks)
    checks = [
        Check("poles", "10 min at 250 m/s over the North Pole", "m", 0.01, _apart(tracks, over)),
        Check("poles", "the same: latitude beyond 90 deg", "deg", 0.0, beyond),
        Check("poles", "the same: headings given within 1 km", "1", 0.0, given),
    ]
    for case, truth in (
        ("10 min at 900 m/s, 30 m past the South Pole", over_pole(900.0, 600.0, miss=30.0, south=True)),
        ("10 min round the pole at 100 m, 5 m/s", around_pole(5.0, 100.0, 600.0)),
    ):
        checks.append(Check("poles", case, "m", 0.01, _apart(_tracks(integrators, truth, time), truth)))
    place, rph = np.array([np.pi / 2, 0.0, 2800.0]), np.array([0.1, -0.3, 2.2])
    imu = _at_rest(place, rph, even(_HOUR, _RATE))
    values = tuple((i.name, _moved(_navigated(i, imu, place, rph, 1000), place)) for i in integrators)
    return [*checks, Check("poles", "rest at the North Pole for 1 h", "m", 0.01, values)]


def _headings_given(track: Trajectory) -> float:
    """Number of headings given within a kilometre of a pole; NaN where the latitude is."""
    lat = track.lla[:, 0]
    return float(np.sum(np.where(np.isnan(lat), np.nan, near_pole(lat) & np.isfinite(track.rph[:, 2]))))


def _at_rest(place: FloatArray, rph: FloatArray, time: FloatArray) -> ImuData:
    """Increments at rest on the turning Earth: its rate and gravity in body axes, both constant."""
    c_bn, dt = dcm_from_rph(rph).T, np.diff(time)[:, None]
    return ImuData(
        time[1:], dt * (c_bn @ earth_rate_n(place[0])), -dt * (c_bn @ gravity_n(place[0], place[2])), "increment"
    )


def _navigated(integrator: Integrator, imu: ImuData, place: FloatArray, rph: FloatArray, every: int) -> Trajectory:
    n = imu.time.size - 1
    return integrator.navigate(imu, (place, np.zeros(3), rph), np.full(n, place[2]), np.zeros(n), every)


def _moved(found: Trajectory, place: FloatArray) -> float:
    return float(np.linalg.norm(earth_from_lla(found.lla) - earth_from_lla(place[None]), axis=1).max())


def _tracks(integrators: Sequence[Integrator], truth: Truth, time: FloatArray) -> list[tuple[str, Trajectory]]:
    """What each integrator makes of a motion, from its exact start and with its exact height."""
    imu, true = imu_from_truth(truth, time), truth.evaluate(time[2:])
    held = true.lla[:, 2], true.v_n[:, 2]
    return [(i.name, i.navigate(imu, start_of(truth, time), *held, 1)) for i in integrators]


def _apart(tracks: Sequence[tuple[str, Trajectory]], truth: Truth) -> tuple[tuple[str, float], ...]:
    """Largest distance from the truth [m]."""
    true = earth_from_lla(truth.evaluate(tracks[0][1].time).lla)
    return tuple((name, float(np.linalg.norm(earth_from_lla(t.lla) - true, axis=1).max())) for name, t in tracks)
