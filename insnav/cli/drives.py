"""Commands on one drive and on its results: align, check, compare, demo, outage, report, require."""

from __future__ import annotations

import json
import shlex
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import typer

from insnav.cli import console
from insnav.cli import options as common
from insnav.cli.data_options import READING, Data, check_usable, compile_at_first, say_scale, takes_data
from insnav.exceptions import ConfigError

if TYPE_CHECKING:
    from insnav.result import Result


@takes_data(without=("logs", "explain", "faults"))
def align(data: Data, out: Path = Path("alignment"), force: bool = False, as_json: bool = False) -> None:
    """Compute the initial attitude from a record at rest."""
    if data.gps is None and data.inputs.get("lat") is None:
        raise ConfigError("session.no_latitude", where="--lat")
    with console.working(out, force) as (folder, stage):
        from insnav.messages import sentence

        drive = data.load(stage)
        if data.gps is None:
            say_scale(drive.recording.imu.facts)
        outcome = drive.align()
        read = {event for reading in drive.recording.given().values() for event in reading.events}
        for finding in outcome.findings:
            if finding not in read and finding is not drive.imu_chosen:  # the other findings are in the table or by -v
                console.note(sentence(finding))
        outcome, where = data.save(outcome, folder, stage)
    console.result_page(where, outcome.page(), out, as_json=as_json)


@takes_data(None, only=(*READING, "topic", "time_offset", "lever_arm", "gps_height", "gps_columns"))
def check(data: Data, files: list[Path], out: Path | None = None, force: bool = False, as_json: bool = False) -> None:
    """Examine the files of a recording; print problems, and the command that navigates them."""
    with console.Stages() as stage:
        from insnav.session.check import check as checked

        compile_at_first(*files, *filter(None, (data.gps, data.ref)))
        stage("reading")
        outcome = replace(checked(*files, gps=data.gps, ref=data.ref, **data.inputs), options=data.options)
    where = None if out is None else outcome.save(out, force=force, figures="page")
    if not as_json:
        from insnav.report.check.page import text

        console.result(console.coloured(text(outcome, console.terminal_width(), brief=console.level <= 0)))
    elif where is not None:
        console.result_facts(where)
    else:
        from insnav.report.save import facts_of, versions

        console.result(json.dumps({"kind": "check", "versions": versions(), **facts_of(outcome)}, indent=2))
    if not outcome.found.runs_as_given:
        raise typer.Exit(1)


@takes_data(None, files={"ref": True}, only=("ref_lever_arm", "ref_columns"))
def compare(
    data: Data,
    runs: list[Path],
    tum: Path | None = None,
    out: Path | None = None,
    force: bool = False,
    as_json: bool = False,
) -> None:
    """Compare the accuracy of several runs against one reference."""
    from insnav.output.folder import RunFolder
    from insnav.session.comparison import compare as compared

    assert data.ref is not None
    outcome = replace(compared(*runs, ref=data.ref, **data.inputs), options=data.options)
    if out is not None:
        console.quiet_figures()
        outcome.save(out, force=force)
    comparison = outcome.found
    if tum is not None:
        from insnav.output.track_files import tum_files

        errors = {name: (run.position, run.attitude) for name, run in comparison.named().items()}
        with RunFolder(tum, force=force) as folder:
            for name, text in tum_files(comparison.reference, comparison.compared[0].errors.time, errors).items():
                folder.path(name).write_text(text, encoding="utf-8", newline="\n")
            folder.commit({"runs": [str(run) for run in runs]})
    if as_json:
        from insnav.report.save import json_ready

        console.result(json.dumps(json_ready(comparison.rows()), indent=1, ensure_ascii=False))
    else:
        console.result(console.shown_page(outcome.page()))


def demo(context: typer.Context, out: Path = Path("demo"), force: bool = False) -> None:
    """Navigate the sample drive."""
    from insnav.cli import commands
    from insnav.library import sample_drive

    imu, gps, reference = (str(path) for path in sample_drive())
    arguments = [imu, "--gps", gps, "--ref", reference, "--lever-arm", "0.8,-0.3,-1.2", "--out", str(out)]
    typer.echo("$ " + shlex.join(["insnav", "run", *arguments]), err=True)  # without line breaks, to be copied
    run = commands("run").commands["run"]
    with run.make_context("run", arguments, parent=context.find_root()) as inner:
        inner.params["force"] = force
        run.invoke(inner)


@takes_data(without=("lat", "height"))
def outage(
    data: Data,
    aiding: Literal["auto", "on", "off"] = "auto",
    lengths: str = "5,10,15,30,60,120",
    first: float | None = None,
    spacing: float | None = None,
    engine: str = "processes",
    out: Path = Path("outage"),
    force: bool = False,
    as_json: bool = False,
) -> None:
    """Simulate GNSS outages all over a recorded drive."""
    wanted = common.positive_numbers(lengths, "--lengths")
    for value, name in ((first, "--first"), (spacing, "--spacing")):
        if value is not None:
            common.finite(value, name, largest=1e5)
    with console.working(out, force) as (folder, stage):
        outcome = data.load(stage).outage(
            lengths=wanted, first=first, spacing=spacing, aiding=aiding, workers=engine, progress=stage.advance
        )
        outcome, where = data.save(outcome, folder, stage)
    console.result_page(where, outcome.page(), out, as_json=as_json)
    check_usable(outcome)


def report(
    run: Path,
    figures: Literal["png", "svg"] = "png",
    backdrop: Path | None = None,
    out: Path | None = None,
    force: bool = False,
    pdf: bool = False,
    as_json: bool = False,
) -> None:
    """Write page and figures of a saved result again."""
    from insnav.result import open_result

    saved, folder = open_result(run), run.resolve()
    console.quiet_figures()
    saved = with_backdrop(saved, backdrop)
    if pdf:
        from insnav.report.save import write_result_pdf

        file = folder.with_name(f"{folder.name}.pdf")
        write_result_pdf(saved, file)
        console.result(f"files: {file}")
        return
    out = out or folder.with_name(f"{folder.name}_report")
    where = saved.save(out, force=force, figures=figures)
    if as_json:
        console.result_facts(where)
    else:
        console.result(f"{console.summary_text(saved)}\n{console.files_line(where, out)}")


def with_backdrop(opened: Result[Any], file: Path | None) -> Result[Any]:
    """Add the lines of a file to the background of a run's map; without a file, return the run unchanged."""
    if file is None:
        return opened
    from insnav.report.run.page import read_backdrop

    if opened.kind != "run":
        raise ConfigError("cli.no_map", where="--backdrop", kind=opened.kind)
    return replace(opened, found=replace(opened.found, backdrop=read_backdrop(file)))


@takes_data("DRIVE", optional=True, without=("lat", "height"))
def require(
    data: Data,
    error: str,
    after: str,
    probability: float = 0.95,
    component: Literal["horizontal", "vertical", "3d"] = "horizontal",
    cost: str | None = None,
    profile: str | None = None,
    begin: float | None = None,
    runs: int = 500,
    seed: int = 1,
    engine: str = "processes",
    out: Path = Path("require"),
    force: bool = False,
    as_json: bool = False,
) -> None:
    """Compute the largest sensor errors that meet a limit on the position error after a time without GPS."""
    if data.imu is not None and profile is not None:
        raise ConfigError("cli.drive_and_profile", where="--profile")
    if data.imu is None and (data.gps is not None or data.ref is not None):
        raise ConfigError("cli.fixes_without_drive", where="DRIVE")
    if begin is not None:
        common.finite(begin, "--begin", largest=1e6)
    options: dict[str, Any] = {"workers": engine, "probability": probability, "component": component, "begin": begin}
    options |= {"runs": runs, "seed": seed, "cost": common.weights(cost, "--cost")}
    with console.working(out, force) as (folder, stage):
        from insnav.session.requirement import require as required

        if data.imu is not None:
            outcome = data.load(stage).require(error, after, progress=stage.advance, **options)
        else:
            stage("motion")
            model = data.inputs.get("imu_model")
            options |= {"profile": profile, "imu": None if model is None else str(model)}
            outcome = required(error, after, progress=partial(stage, "simulating"), **options)
        outcome, where = data.save(outcome, folder, stage, figures="png")
    console.result_page(where, outcome.page(), out, as_json=as_json)
