"""``insnav regress``: accuracy of this version compared with the last."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from insnav.cli.console import Stages, note, result
from insnav.cli.options import FILES, RESULT, START, Engine, Json, flag, option
from insnav.exceptions import ConfigError


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
        bool, flag(RESULT, "--published", "Also simulate published GNSS outage tests; writes published.md; minutes.")
    ] = False,
    out: Annotated[
        Path | None, option(RESULT, "FOLDER", "Folder of baseline and reports. [reports next to the corpus' folder]")
    ] = None,
    as_json: Json = False,
) -> None:
    """Compare with the baseline."""
    from insnav.regression.baseline import BASELINE_FILE, renewed, write_baseline
    from insnav.regression.corpus import default_corpus, load_corpus

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
        from insnav.report.regression import page as room

        outcome = compared(file, data, reports=folder, quick=quick, peers=peers, workers=engine, stage=stage)
        found = outcome.found
        for skipped in found.accuracy.skipped.values() if not quick else ():
            note(sentence(skipped))
        if not quick and folder != Path(__file__).parents[1] / "reports":  # an installed package is read-only
            write_history(folder / HISTORY_FILE, found.history)
        if published:
            stage("published")
            names = {each.name for each in load_corpus(file).recorded}
            written = room.write_published(folder, found, names, lambda fraction: stage("published", fraction))
            note(f"written: {written}")
        if plot:
            stage("drawing")
            note(f"drawn: {len(room.write_pages(folder, outcome))} files in {folder}")
        if update_baseline:
            write_baseline(folder / BASELINE_FILE, renewed(found.baseline, found.accuracy, found.origin))
            note(f"baseline: {folder / BASELINE_FILE}")
    from insnav.report.save import facts_of

    result(json.dumps(facts_of(outcome), indent=1, ensure_ascii=False) if as_json else room.text(outcome))
    if found.comparison is not None and not found.comparison.passed and not update_baseline:
        raise typer.Exit(1)


def _power(folder: Path, as_json: bool) -> None:
    """Print the changes that the baseline figures can detect."""
    from insnav.regression.baseline import BASELINE_FILE, read_baseline
    from insnav.report.page import Page
    from insnav.report.regression.page import power_lines, power_section
    from insnav.report.save import page_facts

    baseline = read_baseline(folder / BASELINE_FILE)
    if baseline is None:
        raise ConfigError("cli.no_baseline", where=str(folder))
    facts = page_facts(Page("Power of the regression", (), (power_section(baseline),)))
    result(json.dumps(facts, indent=1, ensure_ascii=False) if as_json else "\n".join(power_lines(baseline)))
