"""``insnav tune``: noise of an IMU from drives with it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from insnav.cli.console import note, result_page, working
from insnav.cli.data_options import Data, takes_data
from insnav.cli.options import Force, Json, Out, argument


@takes_data(
    None,
    files={"gps": False},
    only=("imu_model", "axes", "units", "lever_arm", "lever_arm_sd", "gps_delay", "gps_height"),
)
def tune(
    data: Data,
    drives: Annotated[list[Path], argument("DRIVE", "Folders of recordings, or one IMU file.")],
    out: Out = Path("tune"),
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Estimate the noise of an IMU."""
    with working(out, force) as (folder, stage):
        stage("reading")
        from insnav.fleet.tuning import tune as tuned
        from insnav.messages import sentence

        inputs: Any = {"imu" if key == "imu_model" else key: value for key, value in data.inputs.items()}
        outcome = tuned(*drives, gps=data.gps, **inputs)
        note(f"prior: {outcome.found.prior.name}: {sentence(outcome.found.prior_chosen)}")
        outcome, where = data.save(outcome, folder, stage, figures="png")
    result_page(where, outcome.page(), out, as_json=as_json, more=("imu.toml",))
