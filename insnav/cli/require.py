"""``insnav require``: inverse error budget: the IMU that a limit requires."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

from insnav.cli import parse
from insnav.cli.console import result_page, working
from insnav.cli.data_options import Data, takes_data
from insnav.cli.options import MOTION, RESULT, Engine, Force, Json, Out, Profile, Seed, option
from insnav.exceptions import ConfigError

REQUIREMENT = "Requirement"


@takes_data("DRIVE", optional=True, without=("lat", "height"))
def require(
    data: Data,
    error: Annotated[str, option(REQUIREMENT, "LIMIT", 'Limit of the error, such as "5 m".')],
    after: Annotated[str, option(REQUIREMENT, "TIME", 'Time without GPS, such as "30 s".')],
    probability: Annotated[float, option(REQUIREMENT, "P", "Of being within the limit.")] = 0.95,
    component: Annotated[
        Literal["horizontal", "vertical", "3d"], option(REQUIREMENT, "WHICH", "Error: horizontal, vertical, 3d.")
    ] = "horizontal",
    cost: Annotated[
        str | None,
        option(REQUIREMENT, "ERROR=W,…", "Weights of errors in the set: with 8 one gets four times the share. [all 1]"),
    ] = None,
    profile: Profile = None,
    begin: Annotated[float | None, option(MOTION, "S", "When GPS ends, s after the start. [300]")] = None,
    runs: Annotated[int, option(RESULT, "N", "Simulated runs that verify the set.", min=0)] = 500,
    seed: Seed = 1,
    engine: Engine = "processes",
    out: Out = Path("require"),
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Compute a requirement."""
    if data.imu is not None and profile is not None:
        raise ConfigError("cli.drive_and_profile", where="--profile")
    if data.imu is None and (data.gps is not None or data.ref is not None):
        raise ConfigError("cli.fixes_without_drive", where="DRIVE")
    if begin is not None:
        parse.finite(begin, "--begin", largest=1e6)
    options: dict[str, Any] = {
        "workers": engine,
        "probability": probability,
        "component": component,
        "begin": begin,
        "runs": runs,
        "seed": seed,
    }
    options |= {"cost": parse.weights(cost, "--cost")}
    with working(out, force) as (folder, stage):
        from insnav.session.requirement import require as required

        if data.imu is not None:
            outcome = data.load(stage).require(error, after, progress=stage.advance, **options)
        else:
            stage("motion")
            model = data.inputs.get("imu_model")
            outcome = required(
                error,
                after,
                profile=profile,
                imu=None if model is None else str(model),
                progress=partial(stage, "simulating"),
                **options,
            )
        outcome, where = data.save(outcome, folder, stage, figures="png")
    result_page(where, outcome.page(), out, as_json=as_json)
