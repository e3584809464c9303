"""Speed and accuracy on the standard job, beside pyins on the same data: ``python -m tests.bench.run``.

CPU times are the smallest of several: whatever else the computer does can only add to them.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from dataclasses import asdict
from pathlib import Path

# nothing heavy is imported before the children have run: their peak memory would include ours (see child.py)
from tests.bench.bars import (
    FILTER_US,
    FIRST_LOOPS,
    GIVEN_LOOPS,
    HELP_WALL_S,
    PEAK_MB,
    PLAIN_LOOPS,
    RATIO,
    SAMPLE_LOOPS,
    TEXT_LOOPS,
    Line,
    accuracy_lines,
    table,
)
from tests.bench.compare import side_by_side
from tests.bench.job import GENERATOR, SCENARIOS, Job, standard_job
from tests.bench.processes import Processes, measure_processes

SLICE_S = 600.0  # pyins needs minutes for it
SETTLED_S = 600.0  # errors count from here on
SLICE_SETTLED_S = 400.0  # the same in the slice


def main() -> int:
    """Run the benchmark; exit code 2 if the generator of the job is missing."""
    options = argparse.ArgumentParser(prog="python -m tests.bench.run", description=__doc__)
    options.add_argument("--scenario", choices=SCENARIOS, default="mems")
    options.add_argument("--seed", type=int, default=1)
    options.add_argument("--hours", type=float, default=1.0, help="length of the drive; the bars are for 1")
    options.add_argument(
        "--work", type=Path, default=Path(tempfile.gettempdir()) / "insnav_bench", help="kept between calls"
    )
    options.add_argument("--repeat", type=int, default=3, help="how often each insnav time is taken")
    options.add_argument("--no-peer", action="store_true", help="without pyins")
    options.add_argument("--json", action="store_true")
    a = options.parse_args()
    if not GENERATOR.exists():
        print(f"{GENERATOR} is missing: it makes the data", file=sys.stderr)
        return 2
    if a.hours * 3600 <= SETTLED_S:
        print(
            f"--hours must be above {SETTLED_S / 3600:.2f}: errors count after {SETTLED_S:g} s",
            file=sys.stderr,
        )
        return 2
    job = standard_job(a.work, a.scenario, a.seed, a.hours)
    out = a.work / f"run-{job.folder.name}"
    processes = measure_processes(job, out, a.repeat)
    lines = [*_filter_lines(job, out, a.repeat, peer=not a.no_peer), *_process_lines(processes)]
    if a.json:
        facts = [{**asdict(line), "reached": line.reached} for line in lines]
        print(json.dumps({"scenario": a.scenario, "seed": a.seed, "hours": a.hours, "figures": facts}, indent=1))
    else:
        print(table(f"standard job: {a.scenario}, seed {a.seed}, {a.hours:g} h at 200 Hz", lines))
    return 0


def _process_lines(p: Processes) -> list[Line]:
    loop = p.loop.cpu_s
    return [
        Line("calibration loop: CPU", loop, "s"),
        Line("program, csv to parquet, noise and arm given", p.aligned.cpu_s / loop, "loops", GIVEN_LOOPS),
        Line("program, nothing given, with page", p.nothing_given.cpu_s / loop, "loops", PLAIN_LOOPS),
        Line("program, nothing given, smoothed, 200 Hz as csv", p.text.cpu_s / loop, "loops", TEXT_LOOPS),
        Line("demo, second run", p.sample.cpu_s / loop, "loops", SAMPLE_LOOPS),
        Line("demo, first run: wall", p.first.wall_s / loop, "loops", FIRST_LOOPS),
        Line("program, csv to parquet, self-aligned: CPU", p.aligned.cpu_s, "s"),
        Line("program, csv to parquet, self-aligned: wall", p.aligned.wall_s, "s"),
        Line("program, csv to parquet, --initial: CPU", p.given_start.cpu_s, "s"),
        Line("of these, imports alone: CPU", p.imports.cpu_s, "s"),
        Line("program without imports, self-aligned: CPU", p.aligned.cpu_s - p.imports.cpu_s, "s"),
        Line("peak memory", max(p.aligned.peak_mb, p.given_start.peak_mb), "MB", PEAK_MB),
        Line("insnav --help: wall", p.help.wall_s, "s", HELP_WALL_S),
    ]


def _filter_lines(job: Job, out: Path, repeat: int, *, peer: bool) -> list[Line]:
    from tests.bench.accuracy import Truth, position_nees, solution_rms
    from tests.bench.filtering import best_cpu, read_recording

    recording = read_recording(job)
    truth = Truth(job.path("ref.csv"), float(recording.imu.time[0]) + SETTLED_S)
    given, given_cpu = best_cpu(recording, given_start=True, repeat=repeat)
    aligned, aligned_cpu = best_cpu(recording, given_start=False, repeat=repeat)
    _, sparse_cpu = best_cpu(recording.at_interval(0.1), given_start=True, repeat=repeat)
    navigated = aligned.run.solution.time.size
    return [
        Line("filter, start given, every sample out: CPU", given_cpu, "s"),
        Line("filter, start given, every sample out: a sample", 1e6 * given_cpu / recording.samples, "us", FILTER_US),
        Line("filter, start given, 10 Hz out: CPU", sparse_cpu, "s"),
        Line("filter, start given, 10 Hz out: a sample", 1e6 * sparse_cpu / recording.samples, "us", FILTER_US),
        Line("filter and alignment, every sample out: CPU", aligned_cpu, "s"),
        Line("filter and alignment, every sample out: a sample", 1e6 * aligned_cpu / navigated, "us", FILTER_US),
        *(_peer_lines(job) if peer else []),
        *accuracy_lines(job.scenario, *solution_rms(out, truth)),
        Line(
            "NEES of position, self-aligned (3 if consistent)",
            position_nees(aligned.run.epochs, truth),
            "",
        ),
        Line("NEES of position, start given", position_nees(given.run.epochs, truth), ""),
    ]


def _peer_lines(job: Job) -> list[Line]:
    pair = side_by_side(job, SLICE_S, SLICE_SETTLED_S)
    axes = ("north", "east", "down")
    both = zip(axes, pair.insnav_rms_m, pair.pyins_rms_m, strict=True)
    return [
        Line(f"insnav on the first {SLICE_S:g} s: a sample", pair.insnav_us, "us"),
        Line(f"pyins on the first {SLICE_S:g} s: a sample", pair.pyins_us, "us"),
        Line("pyins : insnav", pair.ratio, "", RATIO, above=True),
        *(
            Line(f"{who} RMS {axis} in that slice", value, "m")
            for axis, *v in both
            for who, value in zip(("insnav", "pyins"), v, strict=True)
        ),
    ]


if __name__ == "__main__":
    sys.exit(main())
