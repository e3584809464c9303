"""Noise of IMU and fixes by maximum likelihood from the drive: estimated, applied and reported.

`insnav.filter.innovation_likelihood` evaluates the innovations of a run. `insnav.filter.noise_search` finds the most
likely noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np

from insnav.exceptions import DivergenceError
from insnav.filter.error_model import error_model
from insnav.filter.gates import Gates
from insnav.filter.gps_correlation import CorrelatedNoise
from insnav.filter.gps_noise import CARRIER
from insnav.filter.innovation_likelihood import (
    ALL,
    CORRELATION_TIME,
    HUBER,
    LONGEST,
    SHARE,
    InnovationLikelihood,
    thinned,
)
from insnav.filter.noise_estimate import NoiseEstimate, NoiseFigure, after_rest
from insnav.filter.noise_search import AVERAGED, FEWEST, NEAR, STARTS, DriveNoise, Posterior, identify, misalignments
from insnav.filter.prepare import Prepared
from insnav.filter.sensor_axes import Misalignment
from insnav.findings import CORRELATED_POSITIONS, Code, Finding
from insnav.imu.specification import ImuSpec
from insnav.types import FloatArray, GpsData

NOT_LOST = 0.95  # least share of accepted fixes, compared with a run with resets; otherwise the run is lost
MOST_REJECTED = 0.3  # least share of accepted fixes; otherwise the gates are wrong
TOO_SMALL = 1.5  # mean normalised squared innovation with specified noise: correct noise gives up to 1.1 [-]
ENOUGH_FOR_AXES = 900.0  # of the record, if only misalignments are estimated [s]
WORTH_TURNING = 0.5  # of the attitude uncertainty: larger known effects of misalignment correct the samples
UNDERSTATED = 2.0  # factor on reported standard deviations from which they are reported as too small [-]
NO_NOISE = 10.0  # factor from which this is more than a note on the receiver [-]
FEET, ALIKE_IN_METRES = (2.7, 4.0), 2.0  # range of the height factor for feet (3.28), least ratio to horizontal
FACTOR_WORTH = 0.1  # a smaller change of a standard deviation is not reported
# suffix of SI names, by display unit
SUFFIXES = {
    "deg/sqrt(h)": "_rad_sqrt_s",
    "m/s/sqrt(h)": "_m_s_sqrt_s",
    "deg/h": "_rad_s",
    "ug": "_m_s2",
    "mrad": "_rad",
    "ppm": "",
}


def identify_noise(ready: Prepared, spec: ImuSpec) -> DriveNoise | None:
    """Estimate the noise of IMU and fixes from the innovations of one drive; None if not observable.

    `spec`: IMU error specification of the preparation: the prior.
    """
    drive = _likelihood(ready, spec)
    with suppress(DivergenceError):
        return None if drive is None else identify([drive], ready.kinds)
    return None


def known_likelihood(ready: Prepared, spec: ImuSpec) -> tuple[InnovationLikelihood, FloatArray] | None:
    """Return innovations of a drive and its specified noise parameters; None as in `_likelihood`."""
    drive = _likelihood(ready, spec)
    if drive is None:
        return None
    at, correlated = np.array([p.middle for p in drive.parameters]), ready.settings.correlated
    at[-2] = -np.inf
    if correlated is not None:
        part = min(correlated.share / drive.parameters[-2].most, ALL)
        at[-2:] = np.log([part / (1.0 - part), correlated.time])
    return drive, at


def _likelihood(ready: Prepared, spec: ImuSpec) -> InnovationLikelihood | None:
    """Compute the innovations of a drive; None if it is too short, or the filter diverges."""
    if thinned(ready.gps).time.shape[0] < FEWEST:
        return None
    # where gates reject most fixes by their reported sd, accept all
    for gates in (ready.settings.gates, ready.settings.gates.believing()):
        with suppress(DivergenceError):
            drive = _with_gates(ready, spec, gates)
            if drive.fixes >= max(FEWEST, MOST_REJECTED * drive.offered):
                return drive
    return None


def _with_gates(ready: Prepared, spec: ImuSpec, gates: Gates) -> InnovationLikelihood:
    """Run with given gates, without resets unless it is lost: a reset discards the effect of sensor errors."""
    drive = InnovationLikelihood(replace(ready, settings=replace(ready.settings, gates=gates)), spec)
    if drive.reset:
        with suppress(DivergenceError):
            without = _with_gates(ready, spec, replace(gates, reset_after=np.inf))
            if without.fixes > NOT_LOST * drive.fixes:
                return without
    return drive


def with_noise(ready: Prepared, noise: NoiseEstimate) -> Prepared:
    """Apply the estimated noise to a prepared recording."""
    notes = (*_without_correlated(ready.notes), *_report(noise))
    return _with_axes(replace(ready.apply_noise(noise), notes=notes), noise.axes)


def with_careful_biases(ready: Prepared, assumed: ImuSpec) -> Prepared:
    """Apply plausible upper values of biases for navigation, instead of the most likely biases.

    `assumed`: the IMU of the alignment.
    """
    found = ready.noise
    if found is None:
        return ready
    parts = tuple(replace(part, alignment=after_rest(part.alignment, assumed, found.spec)) for part in ready.parts)
    ready = replace(ready, alignment=after_rest(ready.alignment, assumed, found.spec), parts=parts)
    accel = np.minimum(found.careful_accel_bias, np.maximum(found.filter_spec.accel.bias, assumed.accel.bias))
    spec = replace(found.filter_spec, accel=replace(found.filter_spec.accel, bias=accel))
    model = replace(error_model(spec, ready.model.states), axes_sd=ready.model.axes_sd)
    return replace(ready.scale_sds(model, np.ones(3), np.ones(3)), model=model)


def usual_time() -> float:
    """Return the usual correlation time of positions, for drives that do not determine it [s]."""
    middle, sd = CORRELATION_TIME
    return float(np.exp(middle + AVERAGED["gps.correlation_time"] * sd**2))


def with_usual_noise(ready: Prepared) -> Prepared:
    """Apply the usual time-correlated position errors, for a drive that does not determine them."""
    if ready.settings.correlated is not None:
        return ready
    time, share = usual_time(), 1.0 / (1.0 + np.exp(-SHARE[0]))
    usual = CorrelatedNoise(share, time, np.sqrt(share) * np.median(ready.gps.position_sd, axis=0))
    note = Finding.of(Code.ESTIMATE_CORRELATED_USUAL, share=share, time_s=time)
    return replace(ready, settings=replace(ready.settings, correlated=usual), notes=(*ready.notes, note))


def with_known_noise(ready: Prepared, spec: ImuSpec, *, lasting: bool, sizes: bool) -> Prepared:
    """Apply the misalignments that the drive determines; keep the specified noise.

    `lasting`: also estimate the time-correlated errors of positions. `sizes`: also all their standard deviations, where
    these are assumed.
    """
    lasting &= sizes or ready.settings.correlated is None
    needed = lasting or ready.model.axes_sd.any()
    known = known_likelihood(ready.beginning(ENOUGH_FOR_AXES), spec) if needed else None
    if known is None:
        return ready
    drive, at = known
    if ready.model.axes_sd.any():
        with suppress(DivergenceError):
            ready = _with_axes(ready, misalignments([drive], at, 0.0)[0])
    if not lasting:
        return replace(ready, faults=(*ready.faults, *_too_small(ready, *drive.normalised(at)[:2])))
    posterior = Posterior([drive.of_positions(sizes=sizes)])
    starts = [np.concatenate([posterior.middle[:-2], each]) for each in STARTS]
    top, covariance, (e, s, _) = posterior.climb(min(starts, key=lambda each: posterior.innovations(each)[2]), NEAR)
    faults = _too_small(ready, e, s)
    if faults:  # time-correlated errors would absorb other noise
        return replace(ready, faults=(*ready.faults, *faults))
    plausible = posterior.plausible(top, covariance)
    position, _, correlated = posterior.drives[0].fixes_of(plausible[0])
    if sizes:
        ready = ready.scale_sds(ready.model, position, np.ones(3))
    estimates = posterior.figures(plausible, spec)
    more = *_report_factor(Code.ESTIMATE_POSITION_SD, position), _report_correlated(correlated, estimates)
    settings, notes = replace(ready.settings, correlated=correlated), (*_without_correlated(ready.notes), *more)
    return replace(ready, settings=settings, notes=notes)


def _too_small(ready: Prepared, innovation: FloatArray, variance: FloatArray) -> tuple[Finding, ...]:
    """Report innovations larger than the specified noise allows, robust against false fixes."""
    size = float(np.mean(np.minimum(innovation**2 / variance, HUBER**2)))
    given = Finding.of(Code.GIVEN_NOISE, ready.initial.time, mean_square=size, limit_mean_square=TOO_SMALL)
    return (given,) * bool(size > TOO_SMALL)


def _with_axes(ready: Prepared, found: Misalignment) -> Prepared:
    """Correct samples by the estimated misalignments, with the remaining attitude uncertainty.

    This applies only if misalignments are more likely than none. Only the bias prior separates roll and pitch from
    biases: the uncertainty of a correction is its own size.
    """
    imu, notes = ready.imu, ready.notes
    if found.evidence > 0.0 and (np.abs(found.attitude) > WORTH_TURNING * found.attitude_sd).any():
        imu = found.corrected(imu)
        largest = np.abs(found.terms).max()
        notes = (*notes, Finding.of(Code.ESTIMATE_MISALIGNMENT, angle_rad=largest))
    model = replace(ready.model, axes_sd=np.hypot(found.attitude_sd, found.attitude))
    return replace(ready, imu=imu, model=model, notes=notes)


def _without_correlated(notes: tuple[Finding, ...]) -> list[Finding]:
    return [note for note in notes if note.code not in CORRELATED_POSITIONS]


def understated(ready: Prepared, read: GpsData) -> tuple[Finding, ...]:
    """Report innovations far larger than the reported standard deviations of the fixes `read`."""
    found = ready.noise
    if found is None or not np.isfinite(read.position_sd).all():
        return ()
    known = bool(np.isfinite(read.velocity_sd).all())
    level, height = float(found.position_factor[:2].max()), float(found.position_factor[2])
    factors: dict[str, Any] = {
        "position_factor": level,
        "height_factor": height,
        "velocity_factor": float(found.velocity_factor.max()) * known,
    }
    large = {name: factor for name, factor in factors.items() if factor >= UNDERSTATED}
    if not large:
        return ()
    most = max(large.values())
    code = Code.NOISE_SD_IMPLAUSIBLE if most > NO_NOISE else Code.NOISE_SD_UNDERSTATED
    begin = ready.initial.time
    findings = [Finding.of(code, begin, **large, limit_factor=UNDERSTATED)]
    noisy = np.median(read.position_sd[:, 2]) > CARRIER  # otherwise motion, not noise, has this factor in feet
    if noisy and FEET[0] < height < FEET[1] and height > ALIKE_IN_METRES * level:
        findings.append(Finding.of(Code.NOISE_HEIGHTS_IN_FEET, begin, height_factor=height, position_factor=level))
    return tuple(findings)


def _report(found: NoiseEstimate) -> list[Finding]:
    """Report the noise of IMU and fixes."""
    imu = [figure for figure in found.figures if figure.observable and not figure.key.startswith("gps.")]
    figures: dict[str, Any] = {f"{each.key.replace('.', '_')}{SUFFIXES[each.unit]}": each.value for each in imu}
    findings = [Finding.of(Code.ESTIMATE_NOISE if figures else Code.ESTIMATE_NOISE_PRESET, **figures)]
    findings += _report_factor(Code.ESTIMATE_POSITION_SD, found.position_factor)
    findings += _report_factor(Code.ESTIMATE_VELOCITY_SD, found.velocity_factor)
    if found.correlated.velocity_sd is not None:
        size, time = np.max(found.correlated.velocity_sd), found.correlated.velocity_time
        findings.append(Finding.of(Code.ESTIMATE_CORRELATED_VELOCITY, sd_m_s=size, time_s=time))
    return [*findings, _report_correlated(found.correlated, found.figures)]


def _report_factor(code: Code, factor: FloatArray) -> list[Finding]:
    level, _, down = factor
    changed = bool(max(abs(level - 1.0), abs(down - 1.0)) > FACTOR_WORTH)
    return [Finding.of(code, horizontal_factor=level, vertical_factor=down)] * bool(changed)


def _report_correlated(found: CorrelatedNoise, figures: Sequence[NoiseFigure]) -> Finding:
    hardly = {"gps.share", "gps.correlation_time"} & {figure.key for figure in figures if not figure.observable}
    code = Code.ESTIMATE_CORRELATED_PLAUSIBLE if hardly else Code.ESTIMATE_CORRELATED
    if found.time < LONGEST:
        return Finding.of(code, share=found.share, time_s=found.time)
    return Finding.of(code, share=found.share, longer_than_s=LONGEST)
