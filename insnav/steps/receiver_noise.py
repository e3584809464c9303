"""Step 3: give each fix a standard deviation."""

from __future__ import annotations

from dataclasses import replace

from insnav.errors.outage.free_inertial import is_stationary, stationary_fixes
from insnav.exceptions import InputError
from insnav.filter.gps_noise import with_sd
from insnav.findings import Code, Finding
from insnav.input import Reading
from insnav.input.interpret.velocities import fit_velocities, scales
from insnav.steps import Model, Recording
from insnav.types import GpsData, Trajectory

BENCH_SD = (0.01, 0.005)  # sd of position [m] and velocity [m/s] of a stationary bench


def receiver_noise(recording: Recording, model: Model) -> tuple[Recording, Model, tuple[Finding, ...]]:
    """Give each fix a standard deviation. Without GPS, a stationary reference (test bench) serves as fixes.

    Raises: InputError: positions and velocities contradict each other in a known way.
    """
    gps, reference = recording.gps, recording.reference
    if reference is not None:
        refuse_confused(reference, "--ref-columns", velocities=False)
    if gps is not None:
        refuse_confused(gps)
        fixes, findings = with_sd(gps.data, scatter_alone=False)
        return replace(recording, fixes=fixes, gps=with_scales_checked(gps)), model, findings
    begin, end = float(recording.imu.data.time[0]), float(recording.imu.data.time[-1])
    if reference is None or not is_stationary(reference.data, begin, end):
        return recording, model, ()
    finding = Finding.of(Code.GPS_FROM_REFERENCE, subject="reference")
    fixes = stationary_fixes(reference.data.lla[0], begin, end, *BENCH_SD)
    return replace(recording, fixes=fixes), model, (finding,)


def with_scales_checked(gps: Reading[GpsData]) -> Reading[GpsData]:
    """Add a finding for each axis along which positions move less or more than velocities imply."""
    begin = float(gps.data.time[0])
    wrong = scales(gps.data.time, gps.data.lla, gps.data.v_n)
    found = (Finding.of(Code.GPS_SCALE, begin, subject="gps", ratio=size, sd=sd, axis=axis) for axis, size, sd in wrong)
    return replace(gps, events=(*gps.events, *found))


def refuse_confused(
    read: Reading[GpsData] | Reading[Trajectory], option: str = "--gps-columns", *, velocities: bool = True
) -> None:
    """Refuse positions and velocities that contradict each other in a known way.

    `velocities`: refuse wrong velocities, too, not only wrong positions.
    """
    fit = fit_velocities(read.data.time, read.data.lla, read.data.v_n)
    if fit is not None and fit.confusion and (velocities or fit.misplaced):
        raise InputError(
            "gps.confused_columns" if velocities else "ref.confused_columns",
            where=read.facts.path,
            confusion=fit.confusion,
            columns=() if fit.as_named else fit.columns,
            unit=fit.unit if fit.confusion == "velocity_unit" else "",
            option=option,
        )
