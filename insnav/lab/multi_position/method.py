"""What a calibration by hand comes to: errors of an IMU for the calibration file, and how sure they are."""

from __future__ import annotations

import numpy as np

from insnav.imu.higher_order import ErrorTerms
from insnav.imu.model import ImuErrors
from insnav.imu.raw_outputs import RawScale
from insnav.lab.multi_position.many_positions import PosesCalibration
from insnav.lab.multi_position.six_positions import SixPositions
from insnav.lab.multi_position.triad import Triad
from insnav.lab.navigation_impact import Calibrated
from insnav.types import FloatArray

Found = PosesCalibration | SixPositions
RAW_UNIT = "LSB"  # of a record whose headers state none


def hand_errors(
    found: Found, *, axes: FloatArray | None = None, name: str = "", temperature: float | None = None
) -> ImuErrors:
    """Make the calibration: bias, matrix and g-sensitivity, of raw units also zero and scale of each sensor.

    Parameters
    ----------
    found : PosesCalibration or SixPositions
    axes : (3, 3) array, optional
        From the axes of the file to those of the body, as it was read; zero and scale are for the sensors of the file.
    name : str
        What was calibrated.
    temperature : float or None
        At which mean temperature [deg C].
    """
    if not found.counts:
        return ImuErrors(
            found.gyro.bias,
            found.gyro.matrix,
            found.accel.bias,
            found.accel.matrix,
            name=name,
            temperature=temperature,
            gyro_terms=ErrorTerms(g_sensitivity=found.g_sensitivity),
        )
    turn = np.eye(3) if axes is None else axes
    gyro, accel = np.diag(found.gyro.matrix)[:, None], np.diag(found.accel.matrix)[:, None]
    return ImuErrors(
        gyro_matrix=found.gyro.matrix / gyro,
        accel_matrix=found.accel.matrix / accel,
        name=name,
        temperature=temperature,
        gyro_raw=_raw(found.gyro, turn),
        accel_raw=_raw(found.accel, turn),
        gyro_terms=ErrorTerms(g_sensitivity=found.g_sensitivity / gyro),
    )


def _raw(triad: Triad, axes: FloatArray) -> RawScale:
    return RawScale(RAW_UNIT, axes.T @ triad.bias, np.abs(axes).T @ np.diag(triad.matrix))


def hand_uncertainty(found: Found) -> Calibrated:
    """Errors and their uncertainty in SI units; of raw units against one zero and one scale for three sensors.

    Parameters
    ----------
    found : PosesCalibration or SixPositions
    """
    gyro, gyro_scale = _in_si(found.gyro, found.counts)
    accel, _ = _in_si(found.accel, found.counts)
    terms = ErrorTerms(g_sensitivity=found.g_sensitivity / gyro_scale)
    return Calibrated(
        ImuErrors(gyro.bias, gyro.matrix, accel.bias, accel.matrix, gyro_terms=terms),
        gyro_bias_sd=gyro.bias_sd,
        gyro_matrix_sd=gyro.matrix_sd,
        accel_bias_sd=accel.bias_sd,
        accel_matrix_sd=accel.matrix_sd,
        g_sensitivity_sd=found.g_sensitivity_sd / abs(gyro_scale),
    )


def _in_si(triad: Triad, counts: bool) -> tuple[Triad, float]:
    if not counts:
        return triad, 1.0
    scale = float(np.mean(np.diag(triad.matrix)))
    size = abs(scale)
    bias = (triad.bias - triad.bias.mean()) / scale
    return Triad(bias, triad.matrix / scale, triad.bias_sd / size, triad.matrix_sd / size, triad.condition), scale
