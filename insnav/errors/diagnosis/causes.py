"""Causes of window errors: velocity, tilt or bias, drift, compared with filter and specification."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np

from insnav.attitude import dcm_from_quat
from insnav.earth import gravity_n
from insnav.errors.diagnosis.growth_curves import AXES, TERMS, Curve, about_the_curve, fit_curve, position_terms
from insnav.errors.outage.free_inertial import Windows
from insnav.errors.outage.windows import growth_by_start_error
from insnav.filter.error_model import ErrorModel
from insnav.sample_statistics import CONFIDENCE, FEWEST, chi_square, effective_count, rms
from insnav.types import FloatArray

CAUSES = ("velocity", "acceleration", "drift")
ROUGH = 10.0  # residuals above this multiple of the noise follow no curve [-]


@dataclass(frozen=True, slots=True)
class Cause:
    """One term of the growth on one axis, over all windows."""

    # root mean square over the windows, noise variance subtracted: velocity [m/s], effective horizontal acceleration
    # [m/s^2], drift [rad/s]
    rms: float
    # mean over the windows, and its standard deviation from their scatter and effective sample size
    mean: float
    mean_sd: float
    fit_sd: float  # RMS standard deviation of the fit of one window
    # RMS standard deviation at the starts, of the filter, or for uncalibrated sensors of the specification
    filter_sd: float
    spec_sd: float  # by the specification alone: accelerometer bias, gyro bias; ``NaN`` for a velocity
    share: float  # share of the mean square error at the end [-]; contributions may cancel
    ratio: float  # mean square over summed variances of `filter_sd` and `fit_sd`: one if the prediction is right [-]
    limit: float  # upper 97.5 % limit of that ratio [-]

    @property
    def explained(self) -> bool:
        """True if not larger than predicted."""
        return self.ratio <= self.limit


@dataclass(frozen=True, slots=True)
class AxisDiagnosis:
    """Diagnosis of one axis."""

    axis: str  # ``north`` or ``east``
    causes: tuple[Cause, ...]  # velocity, acceleration, drift
    curves: tuple[Curve, ...]  # one per window
    terms: dict[str, int]  # number of windows by their required terms
    leading: int  # index of the largest contribution in `CAUSES`


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """Diagnosis of both axes."""

    axes: tuple[AxisDiagnosis, ...]  # North, then East
    gravity: float  # converts acceleration to tilt and jerk to drift [m/s^2]
    windows: Windows  # the windows used, in the order of the curves
    rough: int  # number of windows whose error is no cubic: reference or sensors jump
    # all windows are stationary or straight, where tilt and bias are not separable. If false, there were too few and
    # all windows were used, although sensor errors follow no curve in turns
    steady: bool


def diagnose(windows: Windows, model: ErrorModel) -> Diagnosis:
    """Fit every window without turns, or all if these are too few, and summarise."""
    calm = windows.motion != "turning"
    steady = effective_count(windows.start[calm], windows.length) >= FEWEST
    windows = windows.only(calm) if steady else windows
    gravity = float(np.mean([gravity_n(lla[0], lla[2])[2] for lla in windows.lla]))
    curves = [[_fitted(windows, i, axis, model, gravity) for i in range(windows.count)] for axis in (0, 1)]
    smooth = np.array([not (a.roughness > ROUGH or b.roughness > ROUGH) for a, b in zip(*curves, strict=True)])
    if not steady or effective_count(windows.start[smooth], windows.length) < FEWEST:
        smooth[:] = True
    windows = windows.only(smooth)
    # covariance of velocity, acceleration and jerk (n, 2, 3, 3) from the filter's covariance at each start
    shown = map(growth_by_start_error, windows.q_nb[:, 0], windows.lla)
    starts = zip(shown, windows.start_covariance, strict=True)
    predicted = np.array([shows @ start @ np.swapaxes(shows, 1, 2) for shows, start in starts])
    C_nb = dcm_from_quat(windows.q_nb[:, 0])
    found = []
    for axis, name in enumerate(AXES):
        # North tilts about East, and East about North
        accel, gyro = C_nb[:, axis] * model.sd[3:6], C_nb[:, 1 - axis] * model.sd[:3]
        spec = np.array([np.nan, rms(np.linalg.norm(accel, axis=-1)), rms(np.linalg.norm(gyro, axis=-1))])
        kept = [curve for curve, keep in zip(curves[axis], smooth, strict=True) if keep]
        found.append(_axis(name, kept, predicted[:, axis], spec, windows, gravity))
    return Diagnosis(tuple(found), gravity, windows, int((~smooth).sum()), steady)


def _fitted(windows: Windows, i: int, axis: int, model: ErrorModel, gravity: float) -> Curve:
    """Fit the curve of one window on one axis."""
    reference = np.concatenate([windows.reference_sd[i, :, axis], windows.reference_sd[i, :, 3 + axis]]) ** 2
    at_start = float(windows.start_covariance[i, axis, axis])
    accel_noise, gyro_noise = float(model.noise[3:6].mean()), float(model.noise[:3].mean())
    noise = about_the_curve(windows.elapsed[i], reference, at_start, accel_noise, gyro_noise, gravity)
    return fit_curve(windows.elapsed[i], windows.error[i, :, axis], windows.error[i, :, 3 + axis], noise)


def _axis(
    name: str, curves: list[Curve], predicted: FloatArray, spec_sd: FloatArray, windows: Windows, gravity: float
) -> AxisDiagnosis:
    value = np.array([curve.value for curve in curves])
    fit = np.array([curve.sd for curve in curves])
    stated = np.sqrt(np.einsum("nii->ni", predicted))
    count = effective_count(windows.start, windows.length)
    grown = value * position_terms(windows.elapsed[:, -1])
    part = np.mean(grown**2, axis=0)
    units = np.array([1.0, 1.0, 1.0 / gravity])  # from jerk to drift
    draws = 1.0 if windows.uncalibrated else max(count, 1.0)  # turn-on errors are common to all windows
    limit = float(chi_square(draws, 0.5 + 0.5 * CONFIDENCE) / draws)
    causes = []
    for k in range(3):
        square, noise = float(np.mean(value[:, k] ** 2)), float(np.mean(fit[:, k] ** 2))
        causes.append(
            Cause(
                float(np.sqrt(max(square - noise, 0.0))) * units[k],
                float(np.mean(value[:, k])) * units[k],
                float(np.std(value[:, k]) / np.sqrt(max(count - 1.0, 1.0))) * units[k],
                float(np.sqrt(noise)) * units[k],
                rms(stated[:, k]) * units[k],
                float(spec_sd[k]),
                float(part[k] / part.sum()) if part.sum() > 0.0 else np.nan,
                float(np.mean(value[:, k] ** 2 / (fit[:, k] ** 2 + stated[:, k] ** 2))),
                limit,
            )
        )
    terms = dict(Counter(" + ".join(curve.terms) for curve in curves))
    assert len(TERMS) == len(causes)
    return AxisDiagnosis(name, tuple(causes), tuple(curves), terms, int(np.argmax(part)))
