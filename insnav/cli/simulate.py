"""``insnav simulate``: simulated recordings of a known motion, one or many."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from insnav.cli import parse
from insnav.cli.console import Stages, note, quiet_figures, result, result_facts, working
from insnav.cli.data_options import say_reading
from insnav.cli.options import IMU, MOTION, RESULT, Engine, Force, Json, Seed, argument, flag, option
from insnav.exceptions import ConfigError

if TYPE_CHECKING:
    from insnav.output.folder import RunFolder
    from insnav.report.page import Page
    from insnav.session.simulation import Plan, SimulationOptions

RUNS = "Many runs"


def simulate(
    profile: Annotated[
        str | None, argument("PROFILE", "Name of a motion profile (see --list), or a .toml.", MOTION)
    ] = None,
    source: Annotated[
        Path | None, option(MOTION, "TRACK", "Run folder or reference file to make a simulated replica of.", "--from")
    ] = None,
    listed: Annotated[bool, flag(MOTION, "--list", "Show the profiles there are; with --out, draw them.")] = False,
    imu: Annotated[
        str,
        option(
            IMU,
            "MODEL",
            "IMU error specification: consumer, automotive, industrial, tactical, navigation, ideal, or an imu.toml.",
        ),
    ] = "consumer",
    rate: Annotated[float, option(IMU, "HZ", "Samples per second.")] = 100.0,
    sampling: Annotated[
        Literal["instant", "mean", "increment"], option(IMU, "HOW", "Meaning of a sample: mean, instant, increment.")
    ] = "mean",
    temperature: Annotated[
        str | None, option(IMU, "FROM:TO", "Temperature of the IMU, from start to end, deg C.")
    ] = None,
    gps: Annotated[
        str,
        option("GPS", "MODEL", "Receiver error specification: a preset such as single or rtk, ideal, or a gps.toml."),
    ] = "single",
    fault: Annotated[list[str] | None, option("Faults", "FAULT", "Something that goes wrong; repeatable.")] = None,
    gravity: Annotated[
        Literal["full", "plumb", "linear"],
        option(MOTION, "HOW", "full; plumb: without its north component; linear: as in packages to compare with."),
    ] = "full",
    seed: Seed = 1,
    out: Annotated[Path | None, option(RESULT, "FOLDER", "Folder to make. [sim]")] = None,
    force: Force = False,
    as_json: Json = False,
    runs: Annotated[int | None, option(RUNS, "N", "Simulate and navigate so many.", min=1)] = None,
    run: Annotated[int | None, option(RUNS, "N", "Write the files of run N of --runs.", min=1)] = None,
    engine: Engine = "processes",
    resume: Annotated[bool, flag(RUNS, "--resume", "Go on with a series that was stopped.")] = False,
) -> None:
    """Simulate."""
    if listed:
        _list(out, force, as_json)
        return
    place = None if source is None else str(source)
    shared: Any = {"imu": imu, "sampling": sampling, "gps": gps, "gravity": gravity, "seed": seed, "run": run}
    configuration = {"profile": profile, "from": place, **shared, "rate_hz": rate, "temperature_c": temperature}
    configuration |= {"fault": fault or [], "runs": runs}
    _check(profile, source, runs, run, (imu, gps), resume)
    target = out or Path("sim")
    span = _temperatures(temperature) if temperature else None
    options: SimulationOptions = shared | {"rate": rate, "faults": fault or [], "temperature": span}
    with working(target, force or (False if out else "keep")) as (folder, stage):
        stage("motion")
        from insnav.session.simulation import plan_of, profiled, replica

        motion = profiled(str(profile), seed) if source is None else replica(source)
        if motion.track is not None:
            say_reading(motion.track.facts)
        plan = plan_of(motion, options, configuration)
        stage("simulating")
        if runs is None:
            from insnav.report.simulation.page import write_recording

            made = plan.measured()
            stage("writing")
            quiet_figures()
            where, page = write_recording(folder, plan, made)
        else:
            where, page = _many(folder, plan, runs, engine, resume, stage)
    if as_json:
        result_facts(where)
        return
    from insnav.report.simulation.page import ensemble_lines, shown_lines

    result("\n".join((shown_lines if runs is None else ensemble_lines)(page, target)))


def _check(
    profile: str | None, source: Path | None, runs: int | None, run: int | None, sensors: tuple[str, str], resume: bool
) -> None:
    """Refuse incompatible options."""
    if (profile is None) == (source is None):
        raise ConfigError("cli.no_motion" if profile is None else "cli.two_motions", where="PROFILE, --from")
    if runs is not None and run is not None:
        raise ConfigError("cli.runs_or_run", where="--runs, --run")
    if runs is None and resume:
        raise ConfigError("cli.resume_without_runs", where="--resume")
    if runs is not None and "ideal" in sensors:
        raise ConfigError("cli.ideal_runs", where="--imu, --gps")


def _temperatures(text: str) -> tuple[float, float]:
    """Parse temperature at the start and at the end [deg C], from ``FROM:TO`` or one number."""
    try:
        values = [parse.finite(float(part), "--temperature", largest=300.0) for part in text.split(":")]
    except ValueError:
        values = []
    if len(values) not in (1, 2):
        raise ConfigError("cli.not_a_temperature", where="--temperature", text=text)
    return values[0], values[-1]


def _many(folder: RunFolder, plan: Plan, runs: int, engine: str, resume: bool, stage: Stages) -> tuple[Path, Page]:
    from insnav.cli.signals import Stopped
    from insnav.errors.ensemble import NavigatedRecording
    from insnav.report.simulation.page import plan_key, write_runs
    from insnav.simulate.montecarlo import Checkpoint, monte_carlo
    from insnav.simulate.recording import perfect_imu, temperature_ramp

    assert plan.imu is not None
    assert plan.gps is not None
    place = folder.target.resolve()
    checkpoint = Checkpoint(place.with_name(f".{place.name}.unfinished"), plan_key(plan))
    if not resume:
        checkpoint.remove()
    perfect = perfect_imu(plan.truth, plan.rate, plan.sampling)
    task = NavigatedRecording(
        plan.truth, plan.imu, plan.gps, perfect, plan.faults, temperature_ramp(perfect, plan.temperature)
    )
    try:
        done = monte_carlo(
            task,
            runs,
            plan.seed,
            workers=engine,
            progress=lambda fraction: stage("navigating", fraction, runs),
            checkpoint=checkpoint,
        )
        stage("writing")
        quiet_figures()
        written = write_runs(folder, plan, done)
    except Stopped:
        if checkpoint.path.exists():
            note("the runs that have ended are kept: the same command with --resume goes on")
        raise
    checkpoint.remove()
    return written


def _list(out: Path | None, force: bool, as_json: bool) -> None:
    """List the library, and draw it into a folder if specified."""
    from insnav.messages import translated
    from insnav.simulate.motion import library, load_profile

    profiles = [load_profile(path) for path in library()]
    shown = [{"name": each.name, "duration_s": each.duration, "purpose": each.purpose} for each in profiles]
    if out is not None:
        from insnav.report.simulation.page import write_sketches

        with working(out, force) as (folder, stage):
            stage("drawing")
            quiet_figures()
            write_sketches(folder, profiles)
    if as_json:
        result(json.dumps(shown, indent=1, ensure_ascii=False))
        return
    width = max(len(str(each["name"])) for each in shown)
    lines = (f"{each.name:<{width}}  {each.duration:6.0f} s  {translated(each.purpose)}" for each in profiles)
    result("\n".join(lines))
