"""Car among high buildings; fixes of mixed and unstated quality, false Doppler velocities, an RTK reference."""

from __future__ import annotations

import numpy as np
import pytest

from insnav.earth import lla_offset, ned_offset
from insnav.errors.metrics import position_errors
from insnav.filter.navigate import Navigated
from insnav.findings import Code, of_code
from insnav.imu import ImuSpec
from insnav.input import read_reference
from insnav.types import FloatArray, GpsData, ImuData, Trajectory
from tests.recorded.recording import imu_model, navigated, recording, rms
from tests.shared import recorded

NAME = "ixr_tsukishima_20210412"
LEVER_ARM = np.array([0.0, 0.3, 0.0])
FALSE_VELOCITY = 3.0  # off the change of position by more than this [m/s]
NOISE_SD, NOISE_TIME = 2.0, 10.0  # added to the fixes [m], [s]


@pytest.fixture(scope="module")
def data() -> tuple[ImuData, GpsData, ImuSpec]:
    imu, gps = recording(NAME)
    return imu, gps, imu_model(imu, gps)


@pytest.fixture(scope="module")
def done(data: tuple[ImuData, GpsData, ImuSpec]) -> Navigated:
    return navigated(*data, LEVER_ARM)


@pytest.fixture(scope="module")
def reference() -> Trajectory:
    """Only the epochs with fixed ambiguities: the others are metres off."""
    read = read_reference(recorded(NAME) / "ref.csv")
    assert read.fix is not None
    rows = read.fix == 1
    data = read.data
    return Trajectory(data.time[rows], data.lla[rows], data.v_n[rows], data.rph[rows])


def test_false_doppler_velocities_are_rejected_by_name(done: Navigated, data: tuple[ImuData, GpsData, ImuSpec]) -> None:
    imu, gps, _ = data
    error = velocity_error(gps)
    error[gps.time < imu.time[0]] = np.nan
    false, true = gps.time[error > FALSE_VELOCITY], gps.time[error < 0.5]
    named = np.array([event.begin for event in of_code(done.run.events, Code.GATE_VELOCITY)])
    offered = done.run.innovations
    refused = offered.time[~offered.used_velocity & np.isfinite(offered.nis_velocity)]
    caught, spared = np.isin(false, named), ~np.isin(true, named)
    print(f"{len(named)} velocities rejected by name; largest error {np.nanmax(error):.1f} m/s", end="; ")
    print(f"of {len(false)} false ones {caught.sum()} are rejected, of {len(true)} good ones {(~spared).sum()}")
    np.testing.assert_array_equal(named, refused)
    assert len(false) > 30
    assert caught.mean() >= 0.97
    assert spared.mean() > 0.999


def test_position_is_within_decimetres_of_the_fixed_reference(
    done: Navigated, reference: Trajectory, data: tuple[ImuData, GpsData, ImuSpec]
) -> None:
    distance = from_constant_offset(horizontal_error(done, reference))
    p95, p99 = np.percentile(distance, [95.0, 99.0])
    # the fixes are as good where the reference is fixed, and the filter can only keep that
    fixes = data[1]
    _, mine, theirs = np.intersect1d(fixes.time.round(3), reference.time.round(3), return_indices=True)
    passed = from_constant_offset(ned_offset(fixes.lla[mine], reference.lla[theirs])[:, :2])
    through = np.percentile(passed, [95.0, 99.0])
    print(f"horizontal error at {len(distance)} epochs: 95 % {p95:.3f} m, 99 % {p99:.3f} m, ", end="")
    print(f"largest {distance.max():.2f} m; of the fixes themselves {through[0]:.3f} and {through[1]:.3f} m")
    assert len(distance) > 6000
    assert p95 <= 0.03
    assert p99 <= 0.07


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_time_correlated_noise_of_the_fixes_is_reduced(
    seed: int, data: tuple[ImuData, GpsData, ImuSpec], reference: Trajectory
) -> None:
    imu, gps, spec = data
    rows = np.flatnonzero(np.abs(gps.time - np.round(gps.time)) < 1e-3)
    assert np.median(np.diff(gps.time[rows])) == pytest.approx(1.0)
    noise = gauss_markov(len(rows), seed)
    sd = np.full((len(rows), 3), NOISE_SD)
    lla, velocity_sd = lla_offset(gps.lla[rows], noise), gps.velocity_sd[rows]
    worse = GpsData(gps.time[rows], lla, gps.v_n[rows], sd, velocity_sd)
    put_in = rms(np.hypot(noise[:, 0], noise[:, 1]))
    left = rms(from_constant_offset(horizontal_error(navigated(imu, worse, spec, LEVER_ARM), reference)))
    alone = GpsData(worse.time, lla, np.full_like(sd, np.nan), sd, velocity_sd)
    unaided = rms(from_constant_offset(horizontal_error(navigated(imu, alone, spec, LEVER_ARM), reference)))
    print(f"seed {seed}: horizontal RMS of the noise {put_in:.2f} m, of the error {left:.2f} m, ", end="")
    print(f"ratio {left / put_in:.2f}; without velocities {unaided / put_in:.2f}")
    assert left / put_in < 0.75


def test_standard_deviations_that_are_missing_come_from_a_stated_rule(done: Navigated) -> None:
    for code, unit in ((Code.GPS_POSITION_SD_SCATTER, "m"), (Code.GPS_VELOCITY_SD_SCATTER, "m_s")):
        (note,) = of_code(done.notes, code)
        print(note)
        assert min(note[f"sd_{unit}"]) >= note[f"floor_{unit}"] > 0.0
    assert np.isfinite(done.ready.gps.position_sd).all()
    assert np.isfinite(done.ready.gps.velocity_sd[np.isfinite(done.ready.gps.v_n).all(axis=1)]).all()


def velocity_error(gps: GpsData) -> FloatArray:
    """Length of velocity minus central difference of positions; NaN next to a missing fix."""
    path = ned_offset(gps.lla, gps.lla[0])
    span = gps.time[2:] - gps.time[:-2]
    error = np.full(len(gps.time), np.nan)
    error[1:-1] = np.linalg.norm(gps.v_n[1:-1] - (path[2:] - path[:-2]) / span[:, None], axis=1)
    error[1:-1][span > 2.5 * np.median(np.diff(gps.time))] = np.nan
    return error


def horizontal_error(done: Navigated, reference: Trajectory) -> FloatArray:
    return position_errors(done.run.solution, reference, lever_b=LEVER_ARM).position[:, :2]


def from_constant_offset(error: FloatArray) -> FloatArray:
    """Distance from the median: the base stations of fixes and reference are a constant apart."""
    apart = error - np.median(error, axis=0)
    return np.hypot(apart[:, 0], apart[:, 1])


def gauss_markov(n: int, seed: int) -> FloatArray:
    """First-order Gauss-Markov noise once a second, (n, 3) [m]."""
    white = NOISE_SD * np.random.default_rng(seed).standard_normal((n, 3))
    keep = np.exp(-1.0 / NOISE_TIME)
    noise = white.copy()
    for k in range(1, n):
        noise[k] = keep * noise[k - 1] + np.sqrt(1.0 - keep**2) * white[k]
    return noise
