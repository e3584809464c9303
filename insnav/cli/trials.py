"""Commands that need no recorded data: regress, simulate, verify."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import typer

from insnav.cli import options as common
from insnav.cli.console import Stages, note, quiet_figures, result, result_page, working, write_result
from insnav.cli.data_options import say_reading
from insnav.exceptions import ConfigError

if TYPE_CHECKING:
    from insnav.output.folder import RunFolder
    from insnav.report.page import Page
    from insnav.session.simulation import Plan, SimulationOptions


def regress(
    corpus: Path | None = None,
    data: Path | None = None,
    quick: bool = False,
    engine: str = "processes",
    power: bool = False,
    update_baseline: bool = False,
    plot: bool = False,
    out: Path | None = None,
    as_json: bool = False,
) -> None:
    """Compare the accuracy of this version, on the corpus of drives, with the baseline."""
    from insnav.regression.baseline import BASELINE_FILE, renewed, write_baseline
    from insnav.regression.corpus import default_corpus

    if quick and update_baseline:
        raise ConfigError("cli.quick_baseline", where="--quick, --update-baseline")
    file = (corpus or default_corpus()).resolve()
    folder = out or file.parent.parent / "reports"
    if power:
        _power(folder, as_json)
        return
    with Stages() as stage:
        from insnav.messages import sentence
        from insnav.regression.regress import HISTORY_FILE, write_history
        from insnav.regression.regress import regress as compared
        from insnav.report.regression import page as report_page

        outcome = compared(file, data, reports=folder, quick=quick, workers=engine, stage=stage)
        regression = outcome.found
        for skipped in regression.accuracy.skipped.values() if not quick else ():
            note(sentence(skipped))
        if not quick and folder != Path(__file__).parents[1] / "reports":  # an installed package is read-only
            write_history(folder / HISTORY_FILE, regression.history)
        if plot:
            stage("drawing")
            note(f"drawn: {len(report_page.write_pages(folder, outcome))} files in {folder}")
        if update_baseline:
            write_baseline(folder / BASELINE_FILE, renewed(regression.baseline, regression.accuracy, regression.origin))
            note(f"baseline: {folder / BASELINE_FILE}")
    from insnav.report.save import facts_of

    result(json.dumps(facts_of(outcome), indent=1, ensure_ascii=False) if as_json else report_page.text(outcome))
    if regression.comparison is not None and not regression.comparison.passed and not update_baseline:
        raise typer.Exit(1)


def _power(folder: Path, as_json: bool) -> None:
    """Print the smallest changes of the baseline figures that the regression can detect."""
    from insnav.regression.baseline import BASELINE_FILE, read_baseline
    from insnav.report.page import Page
    from insnav.report.regression.page import power_lines, power_section
    from insnav.report.save import page_facts

    baseline = read_baseline(folder / BASELINE_FILE)
    if baseline is None:
        raise ConfigError("cli.no_baseline", where=str(folder))
    facts = page_facts(Page("Power of the regression", (), (power_section(baseline),)))
    result(json.dumps(facts, indent=1, ensure_ascii=False) if as_json else "\n".join(power_lines(baseline)))


def simulate(
    profile: str | None = None,
    source: Path | None = None,
    listed: bool = False,
    imu: str = "consumer",
    rate: float = 100.0,
    sampling: Literal["instant", "mean", "increment"] = "mean",
    temperature: str | None = None,
    gps: str = "single",
    fault: list[str] | None = None,
    gravity: Literal["full", "plumb", "linear"] = "full",
    seed: int = 1,
    out: Path | None = None,
    force: bool = False,
    as_json: bool = False,
    runs: int | None = None,
    run: int | None = None,
    engine: str = "processes",
    resume: bool = False,
) -> None:
    """Simulate IMU and GPS files of an exactly known motion."""
    if listed:
        _list(out, force, as_json)
        return
    source_name = None if source is None else str(source)
    shared: Any = {"imu": imu, "sampling": sampling, "gps": gps, "gravity": gravity, "seed": seed, "run": run}
    configuration = {"profile": profile, "from": source_name, **shared, "rate_hz": rate, "temperature_c": temperature}
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

            recording = plan.measured()
            stage("writing")
            quiet_figures()
            where, page = write_recording(folder, plan, recording)
        else:
            where, page = _many(folder, plan, runs, engine, resume, stage)
    if as_json or runs is not None:
        result_page(where, page, target, as_json=as_json, more=("runs.csv", "ensemble.csv"))
        return
    from insnav.report.simulation.page import shown_lines

    result("\n".join(shown_lines(page, target)))


def _check(
    profile: str | None, source: Path | None, runs: int | None, run: int | None, sensors: tuple[str, str], resume: bool
) -> None:
    """Refuse incompatible options of insnav simulate."""
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
        values = [common.finite(float(part), "--temperature", largest=300.0) for part in text.split(":")]
    except ValueError:
        values = []
    if len(values) not in (1, 2):
        raise ConfigError("cli.not_a_temperature", where="--temperature", text=text)
    return values[0], values[-1]


def _many(folder: RunFolder, plan: Plan, runs: int, engine: str, resume: bool, stage: Stages) -> tuple[Path, Page]:
    from insnav.cli.console import Stopped
    from insnav.errors.ensemble import NavigatedRecording
    from insnav.report.simulation.page import plan_key, write_runs
    from insnav.simulate.montecarlo import Checkpoint, monte_carlo
    from insnav.simulate.recording import perfect_imu, temperature_ramp

    assert plan.imu is not None
    assert plan.gps is not None
    target = folder.target.resolve()
    checkpoint = Checkpoint(target.with_name(f".{target.name}.unfinished"), plan_key(plan))
    if not resume:
        checkpoint.remove()
    perfect = perfect_imu(plan.truth, plan.rate, plan.sampling)
    task = NavigatedRecording(
        plan.truth, plan.imu, plan.gps, perfect, plan.faults, temperature_ramp(perfect, plan.temperature)
    )
    try:
        ensemble = monte_carlo(
            task,
            runs,
            plan.seed,
            workers=engine,
            progress=lambda fraction: stage("navigating", fraction, runs),
            checkpoint=checkpoint,
        )
        stage("writing")
        quiet_figures()
        written = write_runs(folder, plan, ensemble)
    except Stopped:
        if checkpoint.path.exists():
            note("finished runs are kept: the same command with --resume continues")
        raise
    checkpoint.remove()
    return written


def _list(out: Path | None, force: bool, as_json: bool) -> None:
    """List the motion profiles of the library, and draw them into a folder if specified."""
    from insnav.messages import translated
    from insnav.simulate.motion import library, load_profile

    profiles = [load_profile(path) for path in library()]
    shown = [{"name": profile.name, "duration_s": profile.duration, "purpose": profile.purpose} for profile in profiles]
    if out is not None:
        from insnav.report.simulation.page import write_sketches

        with working(out, force) as (folder, stage):
            stage("drawing")
            quiet_figures()
            write_sketches(folder, profiles)
    if as_json:
        result(json.dumps(shown, indent=1, ensure_ascii=False))
        return
    width = max(len(str(entry["name"])) for entry in shown)
    lines = (f"{item.name:<{width}}  {item.duration:6.0f} s  {translated(item.purpose)}" for item in profiles)
    result("\n".join(lines))


def verify(
    peer: bool = False,
    faults: bool = False,
    out: Path = Path("certificate"),
    force: bool = False,
    as_json: bool = False,
    markdown: bool = False,
) -> None:
    """Certify the numerics of this installation against closed forms."""
    if as_json and markdown:
        raise ConfigError("cli.json_or_markdown", where="--json --markdown")
    if faults:
        _print_faults(as_json=as_json)
        return
    with working(out, force) as (folder, stage):
        stage("certifying")
        from insnav.certificate.certify import verify as verified

        outcome = verified(peer=peer, progress=lambda fraction: stage("certifying", fraction))
        where = write_result(outcome, folder, stage, figures="png")
    if markdown:
        from insnav.report.certificate.page import certificate_markdown

        result(certificate_markdown(outcome.found))
    else:
        result_page(where, outcome.page(), out, as_json=as_json)
    if failed := outcome.found.failed:
        note(f"{len(failed)} of {len(outcome.found.checks)} checks failed")
        raise typer.Exit(1)


def _print_faults(*, as_json: bool) -> None:
    from insnav.certificate.faults import fault_matrix, matrix_lines

    rows = fault_matrix()
    result(json.dumps([asdict(row) for row in rows], indent=1) if as_json else "\n".join(matrix_lines(rows)))
