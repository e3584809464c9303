"""Step 6: estimate the initial attitude, and the clock offset between samples and fixes."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from insnav.exceptions import AlignmentError, ConfigError
from insnav.filter.delay_and_lever import (
    PRETENDED,
    Aligned,
    filtered,
    lever_off,
    on_time,
    pretended,
    with_right_heading,
)
from insnav.filter.receiver import DELAY_SD, Delay
from insnav.findings import Code, Finding
from insnav.input.readers.kinds import files_with
from insnav.steps import Estimate, Model, Recording
from insnav.steps.given import as_given, set_up_filter

LATE, LATE_SURE = 0.03, 10.0  # a specified delay is rejected if its error exceeds both: [s], and sd of the estimate


def align(recording: Recording, model: Model) -> tuple[Recording, Model, tuple[Finding, ...]]:
    """Estimate initial attitude, GPS delay and clock rate, and set the filter up.

    Raises: ConfigError: neither GPS nor a stationary reference gives a position. InputError, AlignmentError: bad data.
    """
    if model.task.states not in (15, 21):
        raise ConfigError("align.bad_states", where="--states", value=model.task.states)
    if recording.fixes is None:
        imu = Path(recording.imu.facts.path)
        gps_files = ", ".join(files_with("gps", imu.parent)) if imu.is_file() else ""
        raise ConfigError("align.no_position", where="--gps", imu=imu.name if gps_files else "", beside=gps_files)
    given = recording.inputs.get("heading")
    aligned = _on_time(recording, model, given)
    if not as_given(recording.inputs):
        if model.receiver.delay.source == "given":
            aligned, model = with_right_delay(aligned, recording, model, given)
        tested, arm = model, model.receiver.lever_arm
        if arm.source == "given" and not arm.sd:  # test a specified arm, unless gyro noise spoils the estimate
            run, difference, limit = lever_off(aligned.ready, arm.value)
            if (difference > limit).any() and pretended(aligned.ready, run) <= PRETENDED:
                tested = replace(model, receiver=model.receiver.forget_lever_arm())
                aligned = _on_time(recording, tested, given)
        if given is not None:
            with suppress(AlignmentError):  # ignore a drive that does not determine the heading
                aligned = with_right_heading(aligned, _on_time(recording, tested, None))
    clock = Estimate(aligned.clock, aligned.ready.receiver.delay.least_sd, "data")
    return recording, replace(model, ready=aligned.ready, clock=clock), aligned.findings


def with_right_delay(
    aligned: Aligned, recording: Recording, model: Model, heading: float | None
) -> tuple[Aligned, Model]:
    """Keep the specified delay, unless the estimate from the drive contradicts it and fits the fixes better."""
    without_delay = replace(model, receiver=replace(model.receiver, delay=Delay(sd=DELAY_SD, source="prior")))
    estimated, given = _on_time(recording, without_delay, heading), model.receiver.delay.value
    sd = estimated.ready.receiver.delay.least_sd or np.inf
    agrees = abs(estimated.clock - given) <= max(LATE, LATE_SURE * sd)
    if agrees or filtered(aligned.ready).misfit <= filtered(estimated.ready).misfit:
        return aligned, model
    values: dict[str, Any] = {"given_s": given, "estimate_s": estimated.clock, "estimate_sd_s": sd}
    rejected = Finding.of(Code.GIVEN_DELAY_REJECTED, estimated.ready.initial.time, subject="gps", **values)
    return replace(estimated, findings=(*estimated.findings, rejected)), without_delay


def _on_time(recording: Recording, model: Model, heading: float | None) -> Aligned:
    if as_given(recording.inputs):
        return set_up_filter(recording, model, heading=heading)
    return on_time(lambda clock, rate: set_up_filter(recording, model, clock, rate, heading), model.receiver)
