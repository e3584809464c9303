"""``insnav align``: initial attitude of a static record."""

from __future__ import annotations

from pathlib import Path

from insnav.cli.console import note, result, result_facts, working
from insnav.cli.data_options import Data, takes_data
from insnav.cli.options import Force, Json, Out
from insnav.exceptions import ConfigError

HELP = """Initial attitude from a record at rest, with its uncertainty.

Roll and pitch come from gravity, heading from the Earth's rotation if the gyros are good enough (gyrocompass), else as
given. Where the heading is known the filter refines all with zero-velocity updates.

\b
Examples:
  insnav align static.csv --lat 48.1
  insnav align static.csv --lat 34.246 --height 380 --imu navigation
  insnav align static.csv --lat 48.1 --static 0:300 --heading 92 --out bench1
  insnav align static.csv --lat 48.1 --json | jq .coarse.roll_deg
"""


@takes_data(without=("logs",))
def align(
    data: Data,
    out: Out = Path("alignment"),
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Align a static record."""
    if data.gps is None and data.inputs.get("lat") is None:
        raise ConfigError("nothing tells the latitude", where="--lat", fix="give it, or fixes with --gps")
    with working(out, force) as (folder, stage):
        outcome = data.load(stage).align()
        for text in outcome.notes:
            note(text)
        outcome, where = data.save(outcome, folder, stage)
    if as_json:
        result_facts(where)
    else:
        result("\n".join([*outcome.page().summary, f"{'files':<12}{out}: report.html, run.json"]))
