"""``insnav budget``: error budget of an IMU over a minute, by sources."""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path
from typing import Any, Literal

from insnav.cli import options as common
from insnav.cli.console import note, result_page, working
from insnav.cli.data_options import Data, check_usable, takes_data
from insnav.exceptions import ConfigError
from insnav.units import UNITS


@takes_data("DRIVE", optional=True, without=("height",))
def budget(
    data: Data,
    uncalibrated: bool = False,
    start: Literal["forward", "smoothed"] = "forward",
    first: float | None = None,
    spacing: float | None = None,
    replicas: int = 20,
    engine: str = "processes",
    deflection: float = 0.0,
    profile: str | None = None,
    gravity: float | None = None,
    begin: float | None = None,
    times: str = "10,20,30,40,50,60",
    height: Literal["free", "held"] | None = None,
    end: str | None = None,
    total: Literal["rss", "worst"] = "rss",
    runs: int = 0,
    seed: int = 1,
    out: Path = Path("budget"),
    force: bool = False,
    as_json: bool = False,
) -> None:
    """Compute the error of an IMU after a time without aiding, by error source."""
    imu = data.inputs.get("imu_model")
    if data.imu is not None and (profile is not None or begin is not None):
        raise ConfigError("cli.drive_and_profile", where="--profile")
    if data.imu is None and (data.gps is not None or data.ref is not None or uncalibrated):
        raise ConfigError("cli.fixes_without_drive", where="DRIVE")
    place = {"lat": data.inputs.get("lat"), "heading": data.inputs.get("heading"), "gravity": gravity}
    known_place = {name: common.finite(value, f"--{name}") for name, value in place.items() if value is not None}
    if data.imu is not None and {"lat", "gravity"} & known_place.keys():
        raise ConfigError("cli.drive_has_place", where="--lat, --gravity")
    if abs(known_place.get("lat", 0.0)) > 0.5 * math.pi:
        raise ConfigError("cli.bad_latitude", where="--lat")
    if end is not None:
        _explain(data, end, max(common.positive_numbers(times, "--times")), known_place, (out, force, as_json))
        return
    if data.imu is None and imu is None:
        raise ConfigError("cli.no_imu", where="--imu")
    if runs == 1:
        raise ConfigError("cli.few_runs", where="--runs")
    for value, name in ((first, "--first"), (spacing, "--spacing"), (begin, "--begin")):
        if value is not None:
            common.finite(value, name, largest=1e6)
    instants = common.positive_numbers(times, "--times")
    height_held = None if height is None else height == "held"
    deflection_rad = common.not_negative(deflection, "--deflection", largest=3600.0) * UNITS["arcsec"][1]
    with working(out, force) as (folder, stage):
        from insnav.session.budget import BudgetSettings, budget_of_motion, motion_of

        settings = BudgetSettings(instants, runs, seed, deflection_rad, height_held)
        if data.imu is not None:
            from insnav.errors.budget.from_windows import WindowSettings

            windows = WindowSettings(
                first=first, spacing=spacing, start=start, uncalibrated=uncalibrated, replicas=replicas, workers=engine
            )
            outcome = data.load(stage).budget(settings, windows=windows, progress=stage.advance)
        else:
            from insnav.imu import load_imu

            stage("motion")
            motion = motion_of(profile, begin, settings, known_place)
            outcome = budget_of_motion(load_imu(str(imu)), motion, settings, partial(stage, "simulating"))
        if absent := outcome.found.budget.absent:
            note(f"IMU model: {outcome.found.budget.imu}")
            note(f"not given, taken as zero: {', '.join(absent)}")
        outcome, where = data.save(outcome, folder, stage)
    result_page(where, outcome.page(), out, as_json=as_json, more=("budget.pdf",))
    check_usable(outcome)


def _explain(data: Data, end: str, time: float, rest: dict[str, float], how: tuple[Path, bool, bool]) -> None:
    """Explain the position and velocity error at the end of a run by error sources; `end`: ``run`` or numbers."""
    if (end == "run") != (data.imu is not None):
        raise ConfigError("cli.end_of_run", where="--end")
    given = None if end == "run" else common.numbers(end, "--end", 4, "-2.668,-8.231,-0.0803,-0.2754")
    given_sd: Any = data.inputs.get("ref_sd")
    sd = (0.1, 0.005) if given_sd is None else tuple(given_sd)
    if len(sd) != 2:
        raise ConfigError("cli.two_ref_sds", where="--ref-sd")
    out, force, as_json = how
    with working(out, force) as (folder, stage):
        stage("fitting")
        from insnav.errors.budget.predicted import gravity_of
        from insnav.errors.budget.sources import at_rest
        from insnav.errors.diagnosis.causes import end_of_run, explain_end
        from insnav.imu import load_imu
        from insnav.report.budget.page import end_page
        from insnav.report.save import write_page

        imu = data.inputs.get("imu_model")
        spec = None if imu is None else load_imu(str(imu))
        if given is None:
            from insnav.result import open_result

            saved = open_result(str(data.imu))
            time, position, velocity = end_of_run(saved.found)
            rest["lat"] = float(saved.found.run.solution.lla[-1, 0])
            spec = spec or (None if saved.imu_model is None else saved.imu_model[0])
        else:
            position, velocity = given[:2], given[2:]
        gravity = rest.get("gravity") or gravity_of(at_rest(1.0, **rest))
        axes = explain_end(time, position, velocity, *sd)
        page = end_page(axes, time, gravity, sd, spec)
        where = write_page(folder, page, {"configuration": data.options})
    result_page(where, page, out, as_json=as_json, more=())
