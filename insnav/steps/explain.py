"""Step 10: explain by a change of the delay what is left, and compare what was given with the solution."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from insnav.filter.delay_step import Solved, with_one_delay
from insnav.filter.lever_check import delay_contradicted, lever_contradicted, with_hidden_lever
from insnav.filter.noise_identification import understated
from insnav.filter.prepare import DELAY_SD
from insnav.findings import OF_THE_IMU, Code, Finding, added, by_time, of_code
from insnav.steps import SOLVE, Model, Recording, run_steps
from insnav.types import GpsData


def explain(recording: Recording, model: Model) -> tuple[Recording, Model, tuple[Finding, ...]]:
    """Navigate again with the fixes on one delay where that explains the drive better, and doubt what was given."""
    assert recording.fixes is not None
    first = _solved(model)

    def navigated(fixes: GpsData, clock: tuple[float, float] | None = None) -> Solved:
        other = model if clock is None else replace(model, clock=clock, gps_delay=replace(model.gps_delay, sd=DELAY_SD))
        return _solved(run_steps(SOLVE, replace(recording, fixes=fixes), other)[1])

    ready, solved = with_one_delay(first, recording.fixes, navigated)
    doubts = () if recording.gps is None else understated(ready, recording.gps.data)
    if model.gps_delay.source == "given":
        doubts = (*doubts, *delay_contradicted(ready))
    if ready.settings.lever_sd:
        run, hidden = with_hidden_lever(solved.ready or ready, solved.run)
        solved, doubts = replace(solved, run=run), (*doubts, *hidden)
    if ready.settings.lever_sd and not model.lever_arm.sd:
        doubts = (*doubts, lever_contradicted(model.lever_arm.value, solved.run))
    if model.mounting_yaw.source == "prior":
        doubts = (*doubt_mounting(solved.run.events), *doubts)
    found = (*doubts, *added(first[1].findings, solved.findings))
    of_files = [event for reading in recording.given().values() for event in reading.events]
    events = by_time([*of_files, *doubts, *solved.run.events])
    solved = replace(solved, run=replace(solved.run, events=events))
    return recording, replace(model, ready=ready, solved=solved), found


def _solved(model: Model) -> Solved:
    assert model.ready is not None
    assert model.solved is not None
    return model.ready, model.solved


def doubt_mounting(events: Iterable[Finding]) -> tuple[Finding, ...]:
    """Doubt an assumed mounting if the IMU contradicts the fixes, as it does in wrong axes."""
    found = list(of_code(events, *OF_THE_IMU))
    return tuple(Finding.of(Code.MOUNTING_DOUBTED, each.begin, subject="imu", count=len(found)) for each in found[:1])
