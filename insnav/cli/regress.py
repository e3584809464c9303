"""``insnav regress``: is this version better or worse than the last, and where."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from insnav.cli.console import Stages, note, result
from insnav.cli.options import FILES, RESULT, START, Engine, Json, flag, option
from insnav.exceptions import ConfigError

if TYPE_CHECKING:
    from insnav.regression.baseline import Baseline


def regress(
    corpus: Annotated[Path | None, option(FILES, "FILE", "The drives. [trajectories/corpus.toml of insnav]")] = None,
    data: Annotated[Path | None, option(FILES, "FOLDER", "Recorded drives. [shared/data next to the project]")] = None,
    quick: Annotated[bool, flag(START, "--quick", "Only some cases.")] = False,
    engine: Engine = "processes",
    power: Annotated[
        bool,
        flag(
            RESULT,
            "--power",
            "Run nothing: the smallest change that each figure of the baseline can show with 80 % power.",
        ),
    ] = False,
    update_baseline: Annotated[bool, flag(RESULT, "--update-baseline", "Make this version the baseline.")] = False,
    plot: Annotated[bool, flag(RESULT, "--plot", "Draw plots, accuracy.html and accuracy.md.")] = False,
    peers: Annotated[bool, flag(RESULT, "--peers", "Also run pyins and GTSAM, where installed; minutes.")] = False,
    published: Annotated[
        bool,
        flag(RESULT, "--published", "Also simulate published GNSS outage tests; writes published.md; minutes."),
    ] = False,
    out: Annotated[
        Path | None, option(RESULT, "FOLDER", "Folder of baseline and reports. [reports next to the corpus' folder]")
    ] = None,
    as_json: Json = False,
) -> None:
    """Compare with the baseline."""
    from insnav.regression.baseline import BASELINE_FILE, read_baseline, renewed, write_baseline
    from insnav.regression.corpus import default_corpus, load_corpus

    if quick and update_baseline:
        raise ConfigError(
            "a quick run is no baseline",
            where="--quick, --update-baseline",
            why="it leaves out cases and seeds that later runs are compared by",
            fix="leave --quick out",
        )
    file = (corpus or default_corpus()).resolve()
    drives = load_corpus(file)
    project = file.parent.parent
    folder = out or project / "reports"
    baseline = read_baseline(folder / BASELINE_FILE)
    if power:
        _power(baseline, folder, as_json)
        return
    with Stages() as stage:
        stage("navigating")
        from insnav.regression.run_corpus import run_corpus

        recorded = data or project.parent / "shared" / "data"
        found = run_corpus(
            drives,
            recorded,
            quick=quick,
            workers=engine,
            progress=lambda fraction: stage("navigating", fraction),
        )
        stage("comparing")
        from insnav.messages import sentence
        from insnav.regression.history import HISTORY_FILE, entry, read_history, with_entry, write_history
        from insnav.regression.provenance import origin
        from insnav.regression.verdict import compare
        from insnav.report.regression.tables import regression_lines

        for skipped in found.skipped.values() if not quick else ():
            note(sentence(skipped))
        now = origin(file.parent)
        comparison = None if baseline is None else compare(found, baseline)
        if not quick and folder != Path(__file__).parents[1] / "reports":  # an installed package is not written to
            history = with_entry(read_history(folder / HISTORY_FILE), entry(found, comparison, now))
            write_history(folder / HISTORY_FILE, history)
        rows = []
        if peers:
            stage("peers")
            from insnav.regression.peers.run_peers import run_peers

            rows = run_peers(drives, recorded, workers=engine, progress=lambda fraction: stage("peers", fraction))
        if published:
            stage("published")
            from insnav.regression.published import replicas
            from insnav.report.regression.page import write_published

            compared = replicas.compare_published(
                replicas.read_cases(), progress=lambda fraction: stage("published", fraction)
            )
            real = {each.name for each in drives.recorded}
            growth = {} if baseline is None else {name: case.measured.growth for name, case in baseline.cases.items()}
            growth |= {name: case.measured.growth for name, case in found.cases.items() if case.measured.values}
            growth = {name: rows for name, rows in growth.items() if name in real}
            factor = replicas.field_factor(compared, replicas.recorded_ratios(growth))
            note(f"written: {write_published(folder, compared, factor, now)}")
        if plot:
            stage("drawing")
            from insnav.report.regression.page import write_pages

            shown = read_history(folder / HISTORY_FILE)
            files = write_pages(folder, found, shown, baseline, comparison, now, rows)
            note(f"drawn: {len(files)} files in {folder}")
        if update_baseline:
            write_baseline(folder / BASELINE_FILE, renewed(baseline, found, now))
            note(f"baseline: {folder / BASELINE_FILE}")
    if as_json:
        from insnav.report.regression.page import regression_page
        from insnav.report.run_json import json_ready, page_facts

        metadata = {"origin": asdict(now), "baseline": None if baseline is None else asdict(baseline.origin)}
        page = regression_page(found, baseline, comparison, now, rows)
        result(json.dumps({**json_ready(metadata), **page_facts(page)}, indent=1, ensure_ascii=False))
    else:
        result("\n".join(regression_lines(found, comparison, baseline, rows)))
    if comparison is not None and not comparison.passed and not update_baseline:
        raise typer.Exit(1)


def _power(baseline: Baseline | None, folder: Path, as_json: bool) -> None:
    """Print what changes the figures of the baseline can show."""
    if baseline is None:
        raise ConfigError("there is no baseline", where=str(folder), fix="make one: insnav regress --update-baseline")
    from insnav.report.page import Page
    from insnav.report.regression.tables import power_lines, power_section
    from insnav.report.run_json import page_facts

    if as_json:
        facts = page_facts(Page("Power of the regression", (), (power_section(baseline),)))
        result(json.dumps(facts, indent=1, ensure_ascii=False))
    else:
        result("\n".join(power_lines(baseline)))
