"""Step 11: report inputs that the solution contradicts."""

from __future__ import annotations

from dataclasses import replace

from insnav.filter.delay_and_lever import lever_contradicted, with_hidden_lever
from insnav.filter.noise_identification import understated
from insnav.findings import OF_THE_IMU, Code, Finding, added, by_time, of_code
from insnav.steps import Model, Recording


def check_given(recording: Recording, model: Model) -> tuple[Recording, Model, tuple[Finding, ...]]:
    """Report inputs and assumptions that the solution contradicts."""
    assert model.ready is not None
    assert model.solved is not None
    navigated, ready, solved = model.solved, model.ready, model.solved
    doubts = () if recording.gps is None else understated(model.noise, recording.gps.data, ready.initial.time)
    if ready.receiver.lever_arm.sd:
        run, hidden = with_hidden_lever(solved.ready, solved.run)
        solved, doubts = replace(solved, run=run), (*doubts, *hidden)
    if ready.receiver.lever_arm.sd and not model.receiver.lever_arm.sd:
        doubts = (*doubts, lever_contradicted(model.receiver.lever_arm.value, solved.run))
    if model.mounting_yaw.source == "prior":
        doubts = (*doubt_mounting(solved.run.events), *doubts)
    findings = (*doubts, *added(navigated.findings, solved.findings))
    file_events = [event for reading in recording.given().values() for event in reading.events]
    events = by_time([*file_events, *doubts, *solved.run.events])
    solved = replace(solved, run=replace(solved.run, events=events))
    return recording, replace(model, solved=solved), findings


def doubt_mounting(events: tuple[Finding, ...]) -> tuple[Finding, ...]:
    """Report the assumed mounting as doubtful if the IMU contradicts the fixes, as wrong axes do."""
    doubts = list(of_code(events, *OF_THE_IMU))
    return tuple(Finding.of(Code.MOUNTING_DOUBTED, each.begin, subject="imu", count=len(doubts)) for each in doubts[:1])
