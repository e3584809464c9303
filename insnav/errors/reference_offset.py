"""Constant difference to a reference: another point of the vehicle, another datum, another height."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from insnav.attitude import dcm_from_rph
from insnav.errors.metrics import TrajectoryErrors
from insnav.findings import Code, Finding
from insnav.sample_statistics import rms
from insnav.types import BoolArray, FloatArray, IntArray, Trajectory

FEWEST = 100  # least number of epochs
BLOCKS = 10  # of the jackknife: errors of neighbouring epochs are correlated
TURNED = 0.3  # least direction change, as the RMS distance of unit vectors from their mean [-]
CLEAR = 5.0  # significance of another point in standard deviations ...
LEAST = 0.05  # ... its least distance [m] ...
WORTH = 0.8  # ... and the largest remaining share of the difference: an inaccurate run has offsets, too
HORIZONTAL, VERTICAL = slice(2), slice(2, 3)  # axes of a position
GEOID = 10.0  # mean height difference that navigation errors cannot cause [m]
LARGEST_UNDULATION = 110.0  # of EGM2008 -107 to 86 m [m]


@dataclass(frozen=True, slots=True)
class ReferenceOffset:
    """Constant parts of the difference between a run and its reference."""

    body: FloatArray  # (2,) forward, right: point of the reference seen from the compared point [m]
    body_sd: FloatArray  # (2,)
    horizontal_rms: float  # of the uncorrected difference [m]
    horizontal_rms_without: float  # with that point moved [m]
    down: float  # mean height difference, positive if the reference is higher [m]
    surest_down: float  # weighted by stated variances: heights drift without fixes [m]

    @property
    def clear(self) -> bool:
        """True if the point differs significantly."""
        explained = self.horizontal_rms_without < WORTH * self.horizontal_rms
        return explained and bool((np.abs(self.body) > np.maximum(LEAST, CLEAR * self.body_sd)).any())

    @property
    def geoid(self) -> bool:
        """True if heights differ like ellipsoid and mean sea level."""
        return abs(self.surest_down) > GEOID


def reference_offset(
    errors: TrajectoryErrors, track: Trajectory, lever_sd: FloatArray | None = None
) -> ReferenceOffset | None:
    """Fit a body-fixed and a local offset to the horizontal errors.

    Error = estimate - reference, so that another point on the vehicle adds ``-C b``, whereas a datum offset is fixed to
    the ground. A lever-arm error of the run also rotates with the vehicle: `lever_sd` (3,) [m].

    Returns: None with few epochs, or without turns.
    """
    known: BoolArray = np.asarray(np.isfinite(errors.position).all(axis=1))
    position = errors.position[known]
    if position.shape[0] < FEWEST:
        return None
    row = rows_at(track, errors.time[known])
    c = dcm_from_rph(track.rph[row])[:, :2, :2]
    if np.sqrt(np.sum(np.var(c[:, :, 0], axis=0))) < TURNED:
        return None
    terms = np.concatenate([-c, np.broadcast_to(np.eye(2), c.shape)], axis=2)  # body forward, right; north, east
    weight = stated_weights(errors, HORIZONTAL)[known, None]
    value, value_sd = jackknifed(terms * weight[..., None], position[:, :2] * weight)
    body, sd = value[:2], value_sd[:2] if lever_sd is None else np.hypot(value_sd[:2], lever_sd[:2])
    moved = position[:, :2] + c @ body
    return ReferenceOffset(
        body,
        sd,
        rms(np.hypot(position[:, 0], position[:, 1])),
        rms(np.hypot(moved[:, 0], moved[:, 1])),
        float(position[:, 2].mean()),
        float(np.average(position[:, 2], weights=stated_weights(errors, VERTICAL)[known] ** 2)),
    )


def stated_weights(errors: TrajectoryErrors, axes: slice) -> FloatArray:
    """Weight epochs by stated position standard deviation, 1 for the smallest, (m,).

    Epochs after minutes without fixes get small weight. Without standard deviations all weights are 1.
    """
    sd = np.zeros(1) if errors.sd is None else np.linalg.norm(errors.sd[:, axes], axis=1)
    return np.asarray(sd.min() / sd) if (sd > 0.0).all() else np.ones(len(errors.time))


def rows_at(track: Trajectory, time: FloatArray) -> IntArray:
    """Return the row of a track at each time, or the next row."""
    return np.searchsorted(track.time, time).clip(max=len(track.time) - 1)


def jackknifed(terms: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Fit k unknowns to pairs of values ``(n, 2)`` by their `terms` ``(n, 2, k)``, with standard deviations.

    The jackknife uses ten parts of the drive, as errors are correlated (Efron and Tibshirani, "An Introduction to the
    Bootstrap", 1993, chapter 11).
    """
    normal, right = np.swapaxes(terms, 1, 2) @ terms, np.einsum("nij,ni->nj", terms, values)
    parts = np.array_split(np.arange(len(values)), BLOCKS)
    sums = [(normal[part].sum(axis=0), right[part].sum(axis=0)) for part in parts]
    whole = sum(each[0] for each in sums), sum(each[1] for each in sums)
    found = np.linalg.lstsq(*whole, rcond=None)[0]
    left_out = np.array([np.linalg.lstsq(whole[0] - a, whole[1] - b, rcond=None)[0] for a, b in sums])
    return found, np.sqrt((BLOCKS - 1) / BLOCKS * np.sum((left_out - left_out.mean(axis=0)) ** 2, axis=0))


def offset_findings(found: ReferenceOffset, taken: FloatArray) -> list[Finding]:
    """Report offsets and advice. `taken` (3,): compared point, from the IMU [m]."""
    findings = []
    if found.clear:
        x, y = taken[:2] + found.body
        findings.append(
            Finding.of(
                Code.REF_POINT,
                subject="ref",
                forward_m=found.body[0],
                right_m=found.body[1],
                forward_sd_m=found.body_sd[0],
                right_sd_m=found.body_sd[1],
                rms_m=found.horizontal_rms,
                corrected_m=found.horizontal_rms_without,
                x_m=x,
                y_m=y,
                z_m=taken[2],
            )
        )
    if found.geoid:
        code, limit = Code.REF_GEOID, GEOID
        if abs(found.surest_down) > LARGEST_UNDULATION:
            code, limit = Code.REF_HEIGHT, LARGEST_UNDULATION
        findings.append(Finding.of(code, subject="ref", height_m=found.surest_down, limit_m=limit))
    return findings
