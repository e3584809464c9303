"""`insnav live` on a pipe that stays open."""

from __future__ import annotations

import csv
import io
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import IO

import numpy as np
import pytest

import insnav
from tests.cli.conftest import Cli
from tests.reversed_messages import as_shown

GIVEN = ("--imu", "automotive", "--lever-arm", "0,0,0", "--gps-delay", "0")
HEADINGS = "time_s,lat_deg,lon_deg,height_m,vn_m_s,ve_m_s,vd_m_s,roll_deg,pitch_deg,heading_deg,sd_n_m"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("live")
    made = insnav.simulate("city", imu="automotive", seed=3)
    assert made.gps is not None
    made.imu.data.beginning(140.0).to_frame().to_csv(folder / "imu.csv", index=False)
    made.gps.data.rows(made.gps.data.time < 140.0).to_frame().drop(columns=["heading_deg"], errors="ignore").to_csv(
        folder / "gps.csv", index=False
    )
    return folder


def mixed(folder: Path) -> list[str]:
    """Lines of both files in order of time, headers first; a fix comes a tenth of a second late."""
    (imu, *samples), (gps, *fixes) = ((folder / name).read_text().splitlines() for name in ("imu.csv", "gps.csv"))
    late = [(float(line.partition(",")[0]) + 0.1, line) for line in fixes]
    return [imu, gps, *(line for _, line in sorted([*((float(x.partition(",")[0]), x) for x in samples), *late]))]


@pytest.fixture
def running() -> Iterator[subprocess.Popen[str]]:
    command = [sys.executable, "-m", "insnav", "live", "-", *GIVEN]
    with subprocess.Popen(command, stdin=-1, stdout=-1, stderr=-1, text=True, bufsize=1) as process:
        yield process
        process.kill()


def written(stream: IO[str] | None, lines: list[str]) -> None:
    assert stream is not None
    stream.write("".join(f"{line}\n" for line in lines))
    stream.flush()


def test_rows_come_while_the_pipe_is_open(folder: Path, running: subprocess.Popen[str]) -> None:
    lines = mixed(folder)
    written(running.stdin, lines[:13000])  # of 128.7 s
    assert running.stdout is not None
    assert running.stdout.readline().startswith(HEADINGS)
    first = running.stdout.readline().split(",")
    assert 110.0 < float(first[0]) < 129.0
    assert running.poll() is None  # it waits for more
    written(running.stdin, lines[13000:])
    assert running.stdin is not None
    running.stdin.close()
    rows = np.array([line.split(",") for line in running.stdout], dtype=float)
    assert running.wait() == 0
    assert rows[-1, 0] > 139.5
    step = np.diff(rows[:, 0])
    assert step.min() > 0.0
    assert step.max() < 0.25
    assert np.mean(step) == pytest.approx(0.1, rel=0.05)


def test_its_rows_are_those_of_a_run_with_all_data(folder: Path, cli: Cli) -> None:
    log = Path("mixed.log")
    log.write_text("\n".join(mixed(folder)) + "\n")
    live = cli("live", log, *GIVEN)
    assert live.code == 0, live.err
    alike = ("--noise", "model", "--explain", "off", "--aiding", "off", "--no-smooth", "--rate", "full")
    run = cli("run", folder / "imu.csv", "--gps", folder / "gps.csv", *GIVEN, *alike, "--figures", "none", "-q")
    assert run.code == 0, run.err
    text = Path("run/solution.csv").read_text()
    solution = {round(float(row["time_s"]), 3): row for row in csv.DictReader(io.StringIO(text))}
    rows = list(csv.DictReader(io.StringIO(live.out)))
    assert len(rows) > 200
    for row in rows:
        same = solution[round(float(row["time_s"]), 3)]
        for name, size in (("lat_deg", 1e-10), ("lon_deg", 1e-10), ("height_m", 1e-5), ("heading_deg", 1e-6)):
            assert float(row[name]) == pytest.approx(float(same[name]), abs=size)


@pytest.mark.parametrize(
    ("lines", "more", "code", "exit_code"),
    [
        ("time_s,lat_deg,lon_deg,height_m\n1,48,11,500\n", GIVEN, "online.no_samples", 3),
        ("1,2,3,4,5,6,7\n", GIVEN, "online.no_header", 3),
        ("", (), "online.no_imu", 2),
        ("", (*GIVEN, "--correlated", "0.5"), "cli.not_numbers", 2),
        ("", (*GIVEN, "--correlated", "2,100"), "input.out_of_range", 2),
    ],
)
def test_a_useless_log_is_refused(lines: str, more: tuple[str, ...], code: str, exit_code: int, cli: Cli) -> None:
    Path("log.csv").write_text(lines)
    refused = cli("live", "log.csv", *more)
    assert refused.code == exit_code
    assert code in refused.err
    assert refused.out == ""


def test_a_log_without_motion_ends_with_the_reason(folder: Path, cli: Cli) -> None:
    Path("log.csv").write_text("\n".join(mixed(folder)[:4000]) + "\n")
    refused = cli("live", "log.csv", *GIVEN)
    assert refused.code == 3
    assert "online.never_aligned" in refused.err
    assert refused.out == ""


def test_time_correlated_errors_are_those_of_the_online_filter(folder: Path, cli: Cli) -> None:
    Path("log.csv").write_text("\n".join(mixed(folder)))
    white, live = (cli("live", "log.csv", *GIVEN, *more) for more in ((), ("--correlated", "0.78,100")))
    nav = insnav.OnlineFilter("automotive", lever_arm=(0, 0, 0), gps_delay=0.0, correlated=(0.78, 100.0))
    imu, gps = (insnav.read_imu(folder / "imu.csv").data, insnav.read_gps(folder / "gps.csv").data)
    for i, time in enumerate(gps.time):
        nav.gps(time, gps.lla[i], gps.v_n[i], [*gps.position_sd[i], *gps.velocity_sd[i]])
    nav.imu(imu.time, imu.gyro, imu.accel)
    last, other = (list(csv.DictReader(io.StringIO(each.out)))[-1] for each in (live, white))
    for i, name in enumerate(("sd_n_m", "sd_e_m", "sd_d_m")):
        assert float(last[name]) == pytest.approx(nav.state.sd[i], rel=0.05)  # of a slightly later epoch
        assert float(last[name]) > 1.5 * float(other[name])


def test_times_that_go_back_are_told_and_left_out(folder: Path, cli: Cli) -> None:
    lines = mixed(folder)
    Path("right.csv").write_text("\n".join(lines))
    Path("log.csv").write_text("\n".join([*lines[:12000], *lines[4000:4003], *lines[12000:]]))
    right, live = (cli("live", name, *GIVEN) for name in ("right.csv", "log.csv"))
    assert live.code == 0
    words = as_shown("does not increase")
    assert (words in live.err, words in right.err) == (True, False)
    assert live.out.splitlines()[-1] == right.out.splitlines()[-1]
