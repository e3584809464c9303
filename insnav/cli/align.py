"""``insnav align``: initial attitude of a static record."""

from __future__ import annotations

from pathlib import Path

from insnav.cli.console import brief_text, note, result, result_facts, working
from insnav.cli.data_options import Data, takes_data
from insnav.cli.options import Force, Json, Out
from insnav.exceptions import ConfigError


@takes_data(without=("logs", "explain", "faults"))
def align(data: Data, out: Out = Path("alignment"), force: Force = False, as_json: Json = False) -> None:
    """Align a static record."""
    if data.gps is None and data.inputs.get("lat") is None:
        raise ConfigError("session.no_latitude", where="--lat")
    with working(out, force) as (folder, stage):
        from insnav.messages import sentence

        drive = data.load(stage)
        outcome = drive.align()
        read = {event for reading in drive.recording.given().values() for event in reading.events}
        for finding in outcome.findings:
            if finding not in read and finding is not drive.imu_chosen:  # the table and -v already contain these
                note(sentence(finding))
        outcome, where = data.save(outcome, folder, stage)
    if as_json:
        result_facts(where)
    else:
        from insnav.report.terminal import entry

        result(f"{brief_text(outcome)}\n{entry('files', '')}{out}: report.html, run.json")
