"""Errors and filter covariance of an ensemble of simulated, navigated recordings of one motion.

Every recording has its own IMU, fixes and noise. At each second, squared errors and filter variances are summed over
the recordings, for a comparison at every time.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from insnav.attitude import dcm_from_quat, quat_conjugate, quat_from_rph, quat_multiply
from insnav.earth import ned_offset
from insnav.errors.metrics import position_errors
from insnav.exceptions import InputError
from insnav.filter.error_model import error_model
from insnav.filter.filter_input import Output
from insnav.filter.navigate import navigate_recording
from insnav.filter.receiver import DELAY_SD, Delay, LeverArm, Receiver
from insnav.findings import Code
from insnav.imu import ImuSpec
from insnav.sample_statistics import chi_square
from insnav.simulate.montecarlo import Runs, Sample
from insnav.simulate.recording import Fault, simulate_recording
from insnav.simulate.sensor_errors import GpsSpec
from insnav.simulate.truth import Truth, reference
from insnav.types import BoolArray, Epochs, FloatArray, ImuData, IntArray, Run

STEP = 1.0  # interval between the epochs of an ensemble [s]
_STATES = 21  # number of filter states
COMPONENTS = ("north", "east", "down", "v_north", "v_east", "v_down", "roll", "pitch", "heading")
GROUPS = ("position", "velocity", "attitude")
BAND = 0.95  # probability that the mean normalised error of a consistent filter is inside its band [-]
FIGURES = (
    *(f"rms_{name}" for name in COMPONENTS),
    "rms_horizontal",
    "largest_horizontal",
    *(f"nees_{name}" for name in GROUPS),
    "positions",
    "rejected",
    "resets",
)
# columns of `Sample.series`: run present, squared errors, variances, number of fixes, normalised squared errors
_EPOCH, _SQUARE, _VARIANCE, _FIX, _NEES = 0, slice(1, 10), slice(10, 19), 19, slice(20, 23)
_WIDTH = 23


@dataclass(frozen=True, slots=True)
class NavigatedRecording:
    """Monte Carlo task: simulate a recording and navigate it as ``insnav run`` does, with known lever arm."""

    truth: Truth  # simulated motion
    imu_spec: ImuSpec  # IMU errors, simulated and specified to the filter
    gps_spec: GpsSpec  # GPS errors, simulated and specified to the filter
    perfect: ImuData  # samples of an error-free IMU on this motion
    faults: tuple[Fault, ...] = ()  # faults added to every recording
    temperature: FloatArray | None = None  # (n,) temperature of the IMU [deg C]

    def __call__(self, seed: int) -> Sample:
        """Simulate and navigate one run; return its `FIGURES`, and squared errors and variances at each second."""
        recording = simulate_recording(
            self.truth,
            self.imu_spec,
            self.gps_spec,
            seed,
            faults=self.faults,
            temperature=self.temperature,
            perfect=self.perfect,
        )
        receiver = Receiver(LeverArm(np.asarray(self.gps_spec.lever_b)), Delay(sd=DELAY_SD))
        run = navigate_recording(recording.imu, recording.gps, self.imu_spec, receiver, output=Output(smooth=False)).run
        return reduced(run, self.truth, error_model(self.imu_spec, _STATES).axes_sd)


def reduced(run: Run, truth: Truth, axes_sd: FloatArray) -> Sample:
    """Reduce the errors of a run to summary figures, and to squared errors and variances at each second.

    `axes_sd` (3,): misalignment sd of the sensor axes in the body [rad]; see `insnav.filter.error_model.ErrorModel`.
    Returns: `figures` in the order of `FIGURES`, SI units and radians. `series` for `ensemble`.
    Raises: InputError: no row of the solution lies within the motion.
    """
    time = run.solution.time[_within(truth, run.solution.time)]
    if len(time) == 0:
        raise InputError("diagnosis.no_row_in_motion")
    errors = position_errors(run.solution, reference(truth, time))
    value = np.column_stack((errors.position, errors.velocity, errors.attitude))
    sd = np.zeros_like(value) if errors.sd is None else errors.sd
    series = np.zeros((epochs(truth), _WIDTH))
    # the first row of the solution in each second, at any solution rate
    second, first = np.unique(_row(truth, errors.time), return_index=True)
    series[second, _EPOCH] = 1.0
    series[second, _SQUARE], series[second, _VARIANCE] = value[first] ** 2, sd[first] ** 2
    fixes = _within(truth, run.epochs.time)
    nees = normalised(run.epochs.rows(fixes), truth, axes_sd)
    np.add.at(series[:, _FIX], _row(truth, run.epochs.time[fixes]), 1.0)
    np.add.at(series[:, _NEES], _row(truth, run.epochs.time[fixes]), nees)
    processed = np.isfinite(run.innovations.innovation[:, :3]).any(axis=1)
    figures = [
        *np.sqrt(np.mean(value**2, axis=0)),
        np.sqrt(np.mean(errors.horizontal**2)),
        np.max(errors.horizontal),
        *(nees.mean(axis=0) / 3.0 if len(nees) else np.zeros(3)),
        np.count_nonzero(processed),
        np.count_nonzero(processed & ~run.innovations.used_position),
        sum(event.code is Code.FILTER_RESET for event in run.events),
    ]
    return Sample(np.array(figures, dtype=np.float64), series)


def normalised(state: Epochs, truth: Truth, axes_sd: FloatArray) -> FloatArray:
    """Compute normalised squared errors of position, velocity and attitude, each with its full covariance.

    `axes_sd` (3,): misalignment sd of the sensor axes in the body [rad]. The covariance describes the attitude of the
    sensor axes, so these variances are added.
    Returns: (m, 3): ``e' P^-1 e``, three degrees of freedom each (Bar-Shalom, Li and Kirubarajan, Estimation with
    Applications to Tracking and Navigation, 2001, section 5.4.2).
    """
    true = reference(truth, state.time)
    q_true = quat_from_rph(true.rph)
    turn = quat_multiply(state.q_nb, quat_conjugate(q_true))
    # the attitude error phi is defined by C_hat = (I - [phi x]) C, a rotation by -phi
    phi = -2.0 * turn[:, 1:] * np.sign(turn[:, :1])
    C_nb = dcm_from_quat(q_true)
    C_bn = np.swapaxes(C_nb, 1, 2)
    attitude = C_bn @ state.covariance[:, 6:9, 6:9] @ C_nb
    axis = np.arange(3)
    attitude[:, axis, axis] += axes_sd**2
    parts = (
        (ned_offset(state.lla, true.lla), state.covariance[:, 0:3, 0:3]),
        (state.v_n - true.v_n, state.covariance[:, 3:6, 3:6]),
        ((C_bn @ phi[:, :, None])[:, :, 0], attitude),
    )
    return np.column_stack([(e * np.linalg.solve(p, e[:, :, None])[:, :, 0]).sum(axis=1) for e, p in parts])


@dataclass(frozen=True, slots=True)
class Ensemble:
    """Errors of many runs at each second, and the stated uncertainty of the filter."""

    time: FloatArray  # (m,) times of the ensemble epochs [s]
    count: IntArray  # (m,) number of runs with a solution at this second
    # (m, 9) root mean square of the errors (`rms`) and of the stated standard deviations (`sd`), in the order of
    # `COMPONENTS` [m], [m/s], [rad]
    rms: FloatArray
    sd: FloatArray
    nees_time: FloatArray  # (k,) times of the ensemble epochs with fixes [s]
    nees_count: IntArray  # (k,) number of fixes averaged in `nees`
    # (k, 3) mean normalised squared error of position, velocity and attitude, divided by its three degrees of freedom:
    # one if the stated covariance is true
    nees: FloatArray


def ensemble(runs: Runs, truth: Truth) -> Ensemble:
    """Compute errors and uncertainty at each second from the sums of all runs. Raises: InputError: every run failed."""
    if len(runs.number) == 0:
        first = runs.failures[0]
        where, count = f"run {first.number}, seed {first.seed}", len(runs.failures)
        raise InputError("diagnosis.all_runs_failed", where=where, count=count, cause=first.error, number=first.number)
    time: FloatArray = truth.start + STEP * np.arange(epochs(truth), dtype=np.float64)
    total = runs.total
    active, with_fix = total[:, _EPOCH] > 0.0, total[:, _FIX] > 0.0
    count, fixes = total[active, _EPOCH], total[with_fix, _FIX]
    return Ensemble(
        time[active],
        count.astype(np.int64),
        np.asarray(np.sqrt(total[active, _SQUARE] / count[:, None]), dtype=np.float64),
        np.asarray(np.sqrt(total[active, _VARIANCE] / count[:, None]), dtype=np.float64),
        time[with_fix],
        fixes.astype(np.int64),
        np.asarray(total[with_fix, _NEES] / fixes[:, None] / 3.0, dtype=np.float64),
    )


def band(degrees: FloatArray | IntArray) -> tuple[FloatArray, FloatArray]:
    """Compute the interval that contains the mean of n squared standard normal errors with probability `BAND`.

    `degrees` (m,): n, the number of independent errors. The sum, n times the mean, is chi-square distributed
    (Bar-Shalom, Li and Kirubarajan 2001, section 5.4.2).
    Returns: lower and upper limit, `low` and `high` (m,).
    """
    tail = 0.5 * (1.0 - BAND)
    return chi_square(degrees, tail) / degrees, chi_square(degrees, 1.0 - tail) / degrees


def inside(found: Ensemble) -> BoolArray:
    """Return whether the mean normalised error of each group is inside its band, (k, 3)."""
    low, high = band(3 * found.nees_count)
    return np.asarray((found.nees >= low[:, None]) & (found.nees <= high[:, None]))


def epochs(truth: Truth) -> int:
    """Return the number of ensemble epochs of a motion, one per `STEP`, including its start."""
    return int(truth.duration / STEP + 0.5) + 1


def _row(truth: Truth, time: FloatArray) -> IntArray:
    """Return the index of the ensemble epoch nearest to each time."""
    return np.floor((time - truth.start) / STEP + 0.5).astype(np.int64)


def _within(truth: Truth, time: FloatArray) -> BoolArray:
    """Return whether each time is within the motion: an estimated GPS delay may have moved a few outside."""
    return np.asarray((time >= truth.start) & (time <= truth.start + truth.duration))
