"""Commands on IMUs and their bench records: acceptance, allan, calibrate, drift, imus, platform, tune."""

from __future__ import annotations

import inspect
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, cast

import typer

from insnav.cli import options as common
from insnav.cli.console import note, note_warnings, result, result_page, summary_text, working, write_result
from insnav.cli.data_options import READING, Data, say_reading, takes_data
from insnav.cli.help import GroupedCommand, LightGroup, help_of
from insnav.exceptions import ConfigError
from insnav.steps.inputs import Inputs
from insnav.units import DEG, DEG_PER_H, UG

if TYPE_CHECKING:
    from insnav.input.readers.reading import Reading
    from insnav.result import Result
    from insnav.types import ImuData


def acceptance(
    rates: list[Path] | None = None,
    positions: list[Path] | None = None,
    static: Path | None = None,
    powerups: list[Path] | None = None,
    columns: str | None = None,
    lengths: str = "1,10,100",
    spike_limit: float | None = None,
    out: Path = Path("acceptance"),
    force: bool = False,
    as_json: bool = False,
) -> None:
    """Compute acceptance figures of gyros and accelerometers from bench records."""
    times = common.positive_numbers(lengths, "--lengths", "1,10,100")
    named = common.columns(columns, "--columns")
    with working(out, force) as (folder, stage):
        stage("reading")
        from insnav.session.bench import acceptance as accepted

        steps = [*(rates or ()), *(positions or ())]
        outcome = accepted(steps, static, powerups or (), lengths=times, columns=named, spike_limit=spike_limit)
        note_warnings(outcome)
        where = write_result(outcome, folder, stage, figures="png")
    result_page(where, outcome.page(), out, as_json=as_json)


@takes_data(files={}, only=("calibration", *READING, "topic"))
def allan(
    data: Data,
    static: str | None = None,
    column: str | None = None,
    rate: float | None = None,
    taus: str = "log",
    workers: int | None = None,
    out: Path = Path("allan"),
    force: bool = False,
    as_json: bool = False,
) -> None:
    """Analyse the noise of a static record by its Allan deviation."""
    wanted: Any = taus if taus in ("log", "octave") else common.positive_numbers(taus, "--taus", "0.1,1,10")
    span = common.span(static, "--static") if static else None
    with working(out, force) as (folder, stage):
        given = replace(data, inputs=cast(Inputs, {**data.inputs, "rate": rate}))
        source: Any = data.imu if column else given.read_imu(stage, "noise")
        stage("noise")
        from insnav.session.bench import allan as analysed

        outcome = analysed(
            source,
            column=column,
            rate=rate if column else None,
            taus=wanted,
            static=span,
            workers=workers,
            progress=lambda fraction: stage("noise", fraction),
        )
        note_warnings(outcome)
        outcome, where = data.save(outcome, folder, stage, figures="png")
    files = ("allan.csv",) if column else ("imu.toml", "imu.yaml", "allan.csv")
    result_page(where, outcome.page(), out, as_json=as_json, more=files)


OUT = Path("calibration")
_KEYWORD = inspect.Parameter.KEYWORD_ONLY
_KINDS: tuple[tuple[str, Any, Any], ...] = (
    *(("columns", str | None, None), ("gravity", float, 9.80665), ("spike_limit", float | None, None)),
    *(("add", Path | None, None), ("name", str, ""), ("out", Path, OUT), ("force", bool, False)),
    ("as_json", bool, False),
)
_SHARED = {name: inspect.Parameter(name, _KEYWORD, default=value, annotation=kind) for name, kind, value in _KINDS}

app = typer.Typer(
    cls=LightGroup,
    name="calibrate",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)


def _command(method: str, *shared: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Register the command of a calibration method. Options `shared` and result options replace its ``**how``."""

    def decorate(function: Callable[..., None]) -> Callable[..., None]:
        parameters = dict(inspect.signature(function, eval_str=True).parameters)
        if parameters.pop("how", None):
            first, *others = (parameter.replace(kind=_KEYWORD) for parameter in parameters.values())
            before, after = ([_SHARED[name] for name in names] for names in (shared, ("out", "force", "as_json")))
            function.__dict__["__signature__"] = inspect.Signature([first, *before, *others, *after])
        name = f"calibrate/{method}"
        return app.command(method, cls=GroupedCommand, **help_of(name))(common.declared(function, name))

    return decorate


@_command("gyro", "columns", "spike_limit", "add", "name")
def gyro(files: list[Path], keep: str | None = None, **how: Any) -> None:
    """Calibrate zero and scale factor of gyros on a rate table."""
    _calibrate("gyro", {"files": files, "keep": common.span(keep, "--range") if keep else None, **how})


@_command("accel", "columns", "gravity", "spike_limit", "add", "name")
def accel(files: list[Path], **how: Any) -> None:
    """Calibrate accelerometers by a tumble test."""
    _calibrate("accel", {"files": files, **how})


@_command("imu", "columns", "spike_limit", "add", "name")
def imu(files: list[Path], intercepts: str | None = None, **how: Any) -> None:
    """Calibrate matrix and bias of three gyros by rate sweeps."""
    pieces = common.named_numbers(intercepts, "--intercept", "-0.01")
    _calibrate("imu", {"files": files, "intercepts": pieces, **how})


@_command("nine", "columns", "gravity", "name")
def nine(files: Path, **how: Any) -> None:
    """Calibrate three dual-axis modules in nine positions."""
    _calibrate("nine", {"files": files, **how})


@_command("poses")
@takes_data(files={}, only=READING)
def poses(
    data: Data,
    method: Literal["poses", "six"] = "poses",
    counts: bool = False,
    gravity: float | None = None,
    lat: float | None = None,
    height: float = 0.0,
    sections: Path | None = None,
    turn: float = 360.0,
    out: Path = OUT,
    force: bool = False,
    as_json: bool = False,
) -> None:
    """Calibrate an IMU in many positions, or in six positions and three turns."""
    from math import radians

    from insnav.session.bench import bench_gravity

    assert data.imu is not None
    common.finite(height, "--height", largest=1e5)
    g, source = bench_gravity(gravity, lat, height)

    def opened(reading: Reading[ImuData]) -> None:
        say_reading(reading.facts)
        note(f"gravity {g:.5f} m/s^2, {source}")

    how: dict[str, Any] = {"files": data.imu, **{key: data.inputs.get(key) for key in READING}}
    how |= {"counts": counts, "six": method == "six", "gravity": g, "gravity_source": source}
    how |= {"sections": sections, "turn": radians(turn), "opened": opened}
    _calibrate("poses", how | {"out": out, "force": force, "as_json": as_json})


@_command("rotor", "gravity")
def rotor(
    fall: Path, precession: Path, fall_mass: float, radius: float, arm: float, mass: float = 0.0, **how: Any
) -> None:
    """Measure the moment of inertia of a gyroscope's rotor."""
    how |= {"fall_mass": fall_mass, "radius": radius, "arm": arm, "mass": mass}
    _calibrate("rotor", {"files": [fall, precession], **how})


def _calibrate(method: str, how: dict[str, Any]) -> None:
    """Calibrate sensors, write calibration file and report into a folder, and print the result.

    `how`: ``files``, options of `insnav.session.bench.calibrate`, and result options.
    """
    files, out, as_json = (how.pop(name) for name in ("files", "out", "as_json"))
    if isinstance(how.get("columns"), str):
        how["columns"] = common.columns(how["columns"], "--columns")
    with working(out, how.pop("force")) as (folder, stage):
        stage("loading")
        from insnav.session.bench import calibrate

        outcome = calibrate(method, files, stage=stage, **how)
        where = write_result(outcome, folder, stage, figures="png")
    if as_json:
        for line in outcome.page().warnings:
            note(f"warning: {line}")
    result_page(where, outcome.page(), out, as_json=as_json, more=("calibration.toml",))


def drift(
    file: Path, columns: str | None = None, out: Path = Path("drift"), force: bool = False, as_json: bool = False
) -> None:
    """Model the drift of MEMS gyros, and smooth the residuals."""
    with working(out, force) as (folder, stage):
        stage("reading")
        from insnav.session.bench import drift as studied

        outcome = studied(file, columns=common.columns(columns, "--columns"))
        note_warnings(outcome)
        where = write_result(outcome, folder, stage, figures="png")
    result_page(where, outcome.page(), out, as_json=as_json, more=("calibration.toml", "rates.csv"))


def imus(name: str | None = None, as_json: bool = False) -> None:
    """List real IMUs, or show all figures of one IMU."""
    from insnav.report.save import facts_of
    from insnav.session.bench import imus as listed

    outcome = listed(name)
    result(json.dumps(facts_of(outcome), indent=2, ensure_ascii=False) if as_json else summary_text(outcome))


def platform(
    force_file: Path | None = None,
    columns: str | None = None,
    axes: Literal["ENU", "NED"] | None = None,
    sample_rate: float | None = None,
    height_input: Path | None = None,
    ref: Path | None = None,
    lat: float | None = None,
    lon: float | None = None,
    height: float = 0.0,
    v_east: float = 0.0,
    v_north: float = 0.0,
    v_up: float = 0.0,
    vertical: Literal["off", "free", "damped"] = "off",
    gravity: float | None = None,
    integrator: Literal["forward", "backward", "mean", "fourth"] = "fourth",
    misalignment: str = "0,0,0",
    gyro_drift: str = "0,0,0",
    accel_bias: str = "0,0,0",
    demo: bool = False,
    rate: str = "10",
    out: Path = Path("platform"),
    force: bool = False,
    as_json: bool = False,
) -> None:
    """Integrate the specific force measured on a north-pointing platform."""
    configuration = common.configuration(locals())

    if demo:
        defaults = inspect.signature(platform).parameters
        stray = [name for name, value in configuration.items() if name != "demo" and value != defaults[name].default]
        if stray:
            names = ("FORCE_FILE" if name == "force_file" else f"--{name.replace('_', '-')}" for name in stray)
            raise ConfigError("cli.demonstration_alone", where=", ".join(names))
    elif force_file is None or lat is None or lon is None:
        missing = [
            name for name, value in (("FORCE_FILE", force_file), ("--lat", lat), ("--lon", lon)) if value is None
        ]
        raise ConfigError("cli.missing", missing=tuple(missing))
    else:
        start = lat * DEG, lon * DEG, height, (v_north, v_east, -v_up + 0.0)
    tilt = DEG * common.numbers(misalignment, "--misalignment", 3, "0.01,0,0.1")
    drift = DEG_PER_H * common.numbers(gyro_drift, "--gyro-drift", 3, "0.01,0.01,0.01")
    bias = UG * common.numbers(accel_bias, "--accel-bias", 3, "50,50,0")
    interval = common.interval(rate)
    if (vertical == "damped") != (height_input is not None):
        raise ConfigError("cli.damped_needs_heights", where="--vertical")
    with working(out, force) as (folder, stage):
        from insnav.session import platform_run

        outcome: Result[Any]
        if demo:
            note("a day at rest, two hours of a holding pattern: some seconds")
            stage("navigating")
            outcome = platform_run.demonstrate()
        else:
            assert force_file is not None
            stage("navigating")
            errors = {"tilt": tilt, "drift": drift, "bias": bias}
            how: dict[str, Any] = {"errors": errors, "integrator": integrator, "vertical": vertical}
            how |= {"gravity": gravity, "interval": interval, "heights": height_input, "ref": ref, "axes": axes}
            how |= {"columns": common.columns(columns, "--columns"), "sample_rate": sample_rate, "opened": say_reading}
            outcome = replace(platform_run.platform(force_file, *start, **how), options=configuration)
        where = write_result(outcome, folder, stage, figures="png")
    result_page(where, outcome.page(), out, as_json=as_json, more=("solution.csv", "torquing.csv"))


@takes_data(
    None,
    files={"gps": False},
    only=("imu_model", "axes", "units", "lever_arm", "lever_arm_sd", "gps_delay", "gps_height"),
)
def tune(data: Data, drives: list[Path], out: Path = Path("tune"), force: bool = False, as_json: bool = False) -> None:
    """Estimate the noise of an IMU from drives."""
    with working(out, force) as (folder, stage):
        stage("reading")
        from insnav.fleet.tuning import tune as tuned
        from insnav.messages import sentence

        inputs: Any = {"imu" if key == "imu_model" else key: value for key, value in data.inputs.items()}
        outcome = tuned(*drives, gps=data.gps, **inputs)
        note(f"prior: {outcome.found.prior.name}: {sentence(outcome.found.prior_chosen)}")
        outcome, where = data.save(outcome, folder, stage)
    result_page(where, outcome.page(), out, as_json=as_json, more=("imu.toml",))
