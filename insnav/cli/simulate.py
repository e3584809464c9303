"""``insnav simulate``: recordings of a known motion, one or many."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from insnav.cli import options as opt
from insnav.cli import parse
from insnav.cli.console import Stages, note, quiet_figures, result, result_facts
from insnav.cli.data_options import say_reading

if TYPE_CHECKING:
    from insnav.output.folder import RunFolder
    from insnav.report.page import Page
    from insnav.session.simulation import Plan, SimulationOptions

SHORT_HELP = "IMU and GPS files of a motion that is exactly known; or hundreds of runs of it."
HELP = """IMU and GPS files of a motion that is exactly known.

The motion comes from a profile, by name or as a file, or from a recorded track. One IMU and one receiver are sampled
from their specifications; out comes a folder with imu.csv, gps.csv, ref.csv, and the command that navigates them. With
--runs every run samples its own, is navigated at once, and the errors are compared with what the filter states.

\b
Examples:
  insnav simulate --list
  insnav simulate city
  insnav simulate city --imu tactical --gps rtk --seed 7 --out monday
  insnav simulate drive.toml --imu mems.toml --rate 200 --sampling increment
  insnav simulate city --fault gps-jump:60m@120s+8s --fault imu-gap@200s+1s
  insnav simulate --from run --imu automotive --out replica
  insnav simulate city --imu ideal --gps ideal
  insnav simulate city --runs 500 --out ensemble

A fault is VERB[:SIZE][@TIME[+LENGTH]], times since the first sample: gps-spike, gps-jump, gps-drag, gps-outage,
gps-flap, gps-latency, gps-sd, gps-duplicate, gps-shuffle; imu-gap, imu-nan, imu-clip, imu-stuck, imu-spike, imu-units,
imu-axes, imu-reverse, imu-duplicate.

The same options give the same bytes, for any engine. A stopped series of runs goes on with --resume.
"""
MOTION, RUNS = "Motion", "Many runs"


def simulate(
    profile: Annotated[
        str | None,
        typer.Argument(
            metavar="PROFILE", help="Name of a motion profile (see --list), or a .toml.", rich_help_panel=MOTION
        ),
    ] = None,
    source: Annotated[
        Path | None,
        typer.Option(
            "--from",
            metavar="TRACK",
            help="Run folder or reference file to make a simulated replica of.",
            rich_help_panel=MOTION,
        ),
    ] = None,
    listed: Annotated[
        bool,
        typer.Option("--list", help="Show the profiles there are; with --out, draw them.", rich_help_panel=MOTION),
    ] = False,
    imu: Annotated[
        str,
        typer.Option(
            metavar="MODEL",
            help="IMU error specification: consumer, automotive, industrial, tactical, navigation, ideal, or an "
            "imu.toml.",
            rich_help_panel=opt.IMU,
        ),
    ] = "consumer",
    rate: Annotated[float, typer.Option(metavar="HZ", help="Samples per second.", rich_help_panel=opt.IMU)] = 100.0,
    sampling: Annotated[
        opt.SamplingChoice,
        typer.Option(metavar="HOW", help="What a sample is: mean, instant, increment.", rich_help_panel=opt.IMU),
    ] = opt.SamplingChoice.mean,
    temperature: Annotated[
        str | None,
        typer.Option(
            metavar="FROM:TO", help="Temperature of the IMU, from start to end, deg C.", rich_help_panel=opt.IMU
        ),
    ] = None,
    gps: Annotated[
        str,
        typer.Option(
            metavar="MODEL",
            help="Receiver error specification: a preset such as single or rtk, ideal, or a gps.toml.",
            rich_help_panel="GPS",
        ),
    ] = "single",
    fault: Annotated[
        list[str] | None,
        typer.Option(metavar="FAULT", help="Something that goes wrong; repeatable.", rich_help_panel="Faults"),
    ] = None,
    gravity: Annotated[
        opt.GravityChoice,
        typer.Option(
            metavar="HOW",
            help="full; plumb: without its north component; linear: as in packages to compare with.",
            rich_help_panel=MOTION,
        ),
    ] = opt.GravityChoice.full,
    seed: Annotated[int, typer.Option(metavar="N", min=0, help="Random seed.", rich_help_panel=opt.RESULT)] = 1,
    out: Annotated[
        Path | None, typer.Option(metavar="FOLDER", help="Folder to make. [sim]", rich_help_panel=opt.RESULT)
    ] = None,
    force: opt.Force = False,
    as_json: opt.Json = False,
    runs: Annotated[
        int | None,
        typer.Option(metavar="N", min=1, help="Simulate and navigate so many.", rich_help_panel=RUNS),
    ] = None,
    run: Annotated[
        int | None,
        typer.Option(metavar="N", min=1, help="Write the files of run N of --runs.", rich_help_panel=RUNS),
    ] = None,
    engine: opt.Engine = "processes",
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on with a series that was stopped.", rich_help_panel=RUNS)
    ] = False,
) -> None:
    """Simulate."""
    if listed:
        _list(out, force, as_json)
        return
    configuration = {
        "profile": profile,
        "from": None if source is None else str(source),
        "imu": imu,
        "rate_hz": rate,
        "sampling": sampling.value,
        "temperature_c": temperature,
        "gps": gps,
        "fault": fault or [],
        "gravity": gravity.value,
        "seed": seed,
        "runs": runs,
        "run": run,
    }
    _check(profile, source, runs, run, (imu, gps), resume)
    target = out or Path("sim")
    options: SimulationOptions = {
        "imu": imu,
        "gps": gps,
        "seed": seed,
        "run": run,
        "rate": rate,
        "sampling": sampling.value,
        "faults": fault or [],
        "temperature": _temperatures(temperature) if temperature else None,
        "gravity": gravity.value,
    }
    from insnav.output.folder import RunFolder

    with RunFolder(target, force=force) as folder, Stages() as stage:
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
    from insnav.report.simulation.ensemble import ensemble_lines
    from insnav.report.simulation.page import shown_lines

    result("\n".join((shown_lines if runs is None else ensemble_lines)(page, target)))


def _check(
    profile: str | None, source: Path | None, runs: int | None, run: int | None, sensors: tuple[str, str], resume: bool
) -> None:
    """Refuse options that do not go together."""
    from insnav.exceptions import ConfigError

    if (profile is None) == (source is None):
        raise ConfigError(
            "a motion is needed: a profile, or a track with --from" if profile is None else "two motions were given",
            where="PROFILE, --from",
            fix="insnav simulate --list shows the profiles there are",
        )
    if runs is not None and run is not None:
        raise ConfigError("either all runs or one of them", where="--runs, --run", fix="leave one of them out")
    if runs is None and resume:
        raise ConfigError("there is nothing to go on with", where="--resume", fix="it goes with --runs")
    if runs is not None and "ideal" in sensors:
        raise ConfigError(
            "runs of ideal sensors are all the same", where="--imu, --gps", fix="give models that have errors"
        )


def _temperatures(text: str) -> tuple[float, float]:
    """Temperature at the start and at the end [deg C], from ``FROM:TO`` or one number."""
    from insnav.exceptions import ConfigError

    try:
        values = [parse.finite(float(part), "--temperature", largest=300.0) for part in text.split(":")]
    except ValueError:
        values = []
    if len(values) not in (1, 2):
        raise ConfigError(f"{text!r} is not a temperature", where="--temperature", fix="write it like 25 or -20:45")
    return values[0], values[-1]


def _many(folder: RunFolder, plan: Plan, runs: int, engine: str, resume: bool, stage: Stages) -> tuple[Path, Page]:
    from insnav.cli.signals import Stopped
    from insnav.errors.ensemble import navigated_recording
    from insnav.report.simulation.ensemble import write_runs
    from insnav.report.simulation.page import plan_key
    from insnav.simulate.checkpoint import Checkpoint
    from insnav.simulate.montecarlo import monte_carlo
    from insnav.simulate.recording import perfect_imu, temperature_ramp

    assert plan.imu is not None
    assert plan.gps is not None
    place = folder.target.resolve()
    checkpoint = Checkpoint(place.with_name(f".{place.name}.unfinished"), plan_key(plan))
    if not resume:
        checkpoint.remove()
    perfect = perfect_imu(plan.truth, plan.rate, plan.sampling)
    task = navigated_recording(
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
    """Show the library, and draw it into a folder if one is given."""
    from insnav.simulate.motion import library, load_profile

    profiles = [load_profile(path) for path in library()]
    shown = [{"name": each.name, "duration_s": each.duration, "purpose": each.purpose} for each in profiles]
    if out is not None:
        from insnav.output.folder import RunFolder
        from insnav.report.simulation.page import write_sketches

        with RunFolder(out, force=force) as folder, Stages() as stage:
            stage("drawing")
            quiet_figures()
            write_sketches(folder, profiles)
    if as_json:
        result(json.dumps(shown, indent=1, ensure_ascii=False))
        return
    width = max(len(str(each["name"])) for each in shown)
    result("\n".join(f"{each['name']:<{width}}  {each['duration_s']:6.0f} s  {each['purpose']}" for each in shown))
