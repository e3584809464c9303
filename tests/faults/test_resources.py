"""What would take memory or time without end is refused early, with a reason."""

from __future__ import annotations

import gzip
import io
import os
import pickle
import subprocess
import sys
import time
import tracemalloc
import zipfile
from pathlib import Path

import numpy as np
import pytest

import insnav
import insnav.input.formats.source as source
from insnav import cli, spill
from insnav.certificate.faults import fault_matrix
from insnav.exceptions import ConfigError, InputError, OutputError
from insnav.filter.navigate import navigate_recording
from insnav.filter.receiver import LeverArm, Receiver
from insnav.findings import Code, of_code
from insnav.imu import load_imu
from insnav.input import read_gps
from insnav.input.formats.registry import open_table
from insnav.output.folder import RunFolder
from tests.filter import drives
from tests.refusals import refused


def test_f8_a_stream_that_does_not_end(monkeypatch):
    monkeypatch.setattr(source, "_MAX_STREAM", 1 << 16)
    with refused(InputError, "format.endless_stream"):
        source.open_source("/dev/zero")

    class Endless(io.RawIOBase):
        taken = 0

        def readable(self) -> bool:
            return True

        def readinto(self, buffer) -> int:
            self.taken += len(buffer)
            buffer[:] = b"1" * len(buffer)
            return len(buffer)

    endless = Endless()
    with refused(InputError, "format.endless_stream"):
        source._stream(io.BufferedReader(endless), "standard input")
    assert endless.taken < 1 << 20


def test_f8_ten_gigabytes_of_nothing(tmp_path: Path):
    with (tmp_path / "imu.csv").open("wb") as file:
        file.truncate(10 << 30)
    begin = time.process_time()
    with refused(InputError, "format.begins_with_zeros"):
        source.open_source(tmp_path / "imu.csv")
    ended = time.process_time()
    with (tmp_path / "imu.csv").open("rb") as file:
        for _ in range(256):
            file.read(1 << 20)
    assert ended - begin < time.process_time() - ended  # less than reading a fortieth of it takes


def test_f9_a_parquet_file_that_is_mostly_nothing(tmp_path: Path):
    pa = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    rows = 4_000_000
    table = pa.table({name: pa.array(np.zeros(rows)) for name in ("time_s", "gyro_x_rad_s", "a", "b", "c")})
    parquet.write_table(table, tmp_path / "bomb.parquet", compression="zstd")
    assert (tmp_path / "bomb.parquet").stat().st_size < 1 << 20
    with refused(InputError, "format.bomb"):
        open_table(tmp_path / "bomb.parquet").cells.read(range(5))


def _skip_without_peaks() -> None:
    """The peak that `resource` gives is also that of the process by which it was begun."""
    if not Path("/proc/self/status").exists():
        pytest.skip("the peak of the memory of a process is told by /proc only")


_PEAK = """
import re, sys
from insnav.exceptions import InputError
from insnav.input import read_imu
try:
    read_imu(sys.argv[1])
except InputError as error:
    print(int(re.search(r"VmHWM:\\s+(\\d+)", open("/proc/self/status").read())[1]) // 1024, error.code)
"""


@pytest.mark.parametrize("name", ["bomb.csv.gz", "bomb.zip"])
def test_f9_a_compressed_file_that_is_mostly_nothing(bars, tmp_path: Path, name: str):
    _skip_without_peaks()
    rows, path = b"0,0,0,0,0,0,0\n" * 300_000, tmp_path / name
    if name.endswith("zip"):
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive, archive.open("imu.csv", "w") as file:
            file.writelines([rows] * 34)
    else:
        with gzip.open(path, "wb", 6) as file:
            file.writelines([rows] * 34)
    assert path.stat().st_size < 2 << 20  # 143 MB in 1 MB
    done = subprocess.run([sys.executable, "-c", _PEAK, str(path)], capture_output=True, text=True, check=True)
    resident, said = done.stdout.split(" ", 1)
    assert said.strip() == "format.bomb"
    assert int(resident) < bars["F9"]["resident_mb"]


def test_f8_a_file_of_holes_behind_its_header(tmp_path: Path):
    path = tmp_path / "imu.csv"
    path.write_text("time_s,gyro_x_rad_s\n")
    os.truncate(path, 10 << 30)
    if path.stat().st_blocks > 1 << 20:
        pytest.skip("this file system has no holes")
    with refused(InputError, "format.bomb"):
        source.open_source(path)


def packed(members: dict[str, bytes]) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return buffer.getvalue()


def test_f9_archives_in_archives_and_of_very_many_files(tmp_path: Path, monkeypatch):
    nested, path = b"1,2,3\n", tmp_path / "drive.zip"
    for level in range(30):
        nested = packed({f"{level}": nested})
    path.write_bytes(nested)
    with refused(InputError, "format.nested_archives"):
        open_table(path)
    monkeypatch.setattr("insnav.input.formats.source.MAX_FILES", 100)
    path.write_bytes(packed({f"{number}": b"" for number in range(101)}))
    with refused(InputError, "format.too_many_files"):
        open_table(path)


def test_p3_a_name_that_no_file_system_takes(tmp_path: Path):
    with refused(OutputError, "output.long_name"), RunFolder(tmp_path / ("x" * 256), force=False):
        pass
    with RunFolder(tmp_path / ("x" * 230), force=False) as folder:
        folder.commit({})


def test_n30_without_a_compiler_it_is_only_slower(monkeypatch, capsys):
    from insnav.cli import data_options
    from insnav.kernels import errorstate
    from insnav.messages import phrase

    monkeypatch.setattr(errorstate, "propagate", lambda: None)
    data_options.compile_at_first()
    assert phrase("terminal.interpreted").split()[0] in capsys.readouterr().err


def test_f14_entities_of_a_gpx_file_are_not_expanded(tmp_path: Path):
    entity = "lol"
    lines = ['<!ENTITY e0 "lol">']
    for level in range(1, 10):
        lines.append(f'<!ENTITY e{level} "' + f"&e{level - 1};" * 10 + '">')
        entity = f"&e{level};"
    point = '<trkpt lat="1" lon="2"><ele>{}</ele><time>2020-01-01T00:00:0{}Z</time></trkpt>'
    track = "".join(point.format(entity, second) for second in range(5))
    path = tmp_path / "bomb.gpx"
    head = f'<?xml version="1.0"?><!DOCTYPE gpx [{"".join(lines)}]>'
    gpx = f'<gpx version="1.1" xmlns="http://www.topografix.com/GPX/1/1"><trk><trkseg>{track}</trkseg></trk></gpx>'
    path.write_text(head + gpx, encoding="utf-8")
    fixes = read_gps(path).data  # the entities, 3 GB when expanded, are no number and stay what they are
    assert fixes.time.shape == (5,)
    assert not np.any(fixes.lla[:, 2])


def test_f15_nothing_is_unpickled(tmp_path: Path):
    for path in Path(insnav.__file__).parent.rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        assert "pickle.load(" not in text, path
        if path.name != "engine.py":  # which sends its own objects to its own workers
            assert "import pickle" not in text, path
        assert "allow_pickle=True" not in text, path
        assert text.count("np.load(") == text.count("allow_pickle=False"), path
    (tmp_path / "imu.csv").write_bytes(pickle.dumps({"a": 1}, protocol=4))
    with pytest.raises(InputError, match="pickle"):
        open_table(tmp_path / "imu.csv")


def test_the_matrix_names_every_fault_and_tests_that_exist():
    rows = fault_matrix()
    wanted = [f"{kind}{number}" for kind, last in (("N", 30), ("F", 18), ("P", 11)) for number in range(1, last + 1)]
    assert [row.key for row in rows] == wanted
    for row in rows:
        file, _, name = row.test.partition("::")
        assert row.state in {"met", "partly", "open"}
        assert bool(row.test) or row.state == "open"
        if row.test:
            assert not name or f"def {name}(" in (Path(__file__).parents[2] / file).read_text(encoding="utf-8"), row.key


_NAVIGATE = """
import sys
import numpy as np
from insnav.filter.receiver import LeverArm, Receiver
from insnav.filter.navigate import navigate_recording
from tests.filter import drives
imu = drives.noisy_imu(drives.perfect_imu(laps=1), drives.MODEL, np.random.default_rng(1))
gps = drives.noisy_gps(drives.perfect_gps(laps=1), np.random.default_rng(2))
imu, gps = (each.rows(each.time < imu.time[0] + 15.0) for each in (imu, gps))
run = navigate_recording(imu, gps, drives.SPEC, Receiver(LeverArm(drives.LEVER_B))).run
each = run.solution, run.smoothed.solution
np.save(sys.argv[1], np.vstack([np.hstack([one.lla, one.v_n, one.rph, one.sd[:, :9]]) for one in each]))
"""


def test_n30_the_same_numbers_with_and_without_a_compiler(tmp_path: Path):
    for name, off in (("compiled", "0"), ("interpreted", "1")):
        environment = os.environ | {"NUMBA_DISABLE_JIT": off}
        root = Path(__file__).parents[2]
        subprocess.run([sys.executable, "-c", _NAVIGATE, str(tmp_path / name)], env=environment, cwd=root, check=True)
    compiled, interpreted = (np.load(tmp_path / f"{name}.npy") for name in ("compiled", "interpreted"))
    assert len(compiled) > 50
    np.testing.assert_allclose(interpreted, compiled, rtol=1e-12, atol=1e-15)


def test_p4_a_signal_after_the_end_is_ignored():
    text = "import os, signal; from insnav.cli import console; console.listen(); console.over(); "
    text += "os.kill(os.getpid(), signal.SIGINT); print('all done')"
    done = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout.strip(), done.stderr) == (0, "all done", "")


def test_p9_a_library_that_finds_no_room_is_a_lack_of_memory(capsys):
    error = ImportError("_minpack.so: failed to map segment from shared object")
    assert cli._explain(error) == 3
    assert "cli.no_memory" in capsys.readouterr().err


def test_p9_a_run_needs_no_more_memory_than_stated(bars, tmp_path: Path):
    _skip_without_peaks()
    sample = Path(__file__).parents[2] / "trajectories" / "sample"
    words = ["run", sample / "imu.csv.gz", "--gps", sample / "gps.csv", "--out", tmp_path / "run"]
    text = "import re, sys; from insnav.cli import main; sys.argv[0] = 'insnav'\ntry:\n main()\nfinally:\n "
    text += "print(re.search(r'VmHWM:\\s+(\\d+)', open('/proc/self/status').read())[1])"
    done = subprocess.run([sys.executable, "-c", text, *words], capture_output=True, text=True, check=True)
    assert int(done.stdout.split()[-1]) / 1e3 < bars["P9"]["resident_mb"]


def test_an_imu_with_impossible_errors_is_refused(tmp_path: Path):
    (tmp_path / "imu.toml").write_text(
        '[gyro]\nbias_instability = "1e300 deg/h"\ncorrelation_time = "1 h"\n[accel]\nbias = "1 mg"\n'
    )
    with refused(ConfigError, "imu.impossible_value"):
        load_imu(str(tmp_path / "imu.toml"))


@pytest.mark.parametrize("cell", ["inf", "-inf"])
def test_an_infinite_velocity_is_refused_with_its_place(tmp_path: Path, cell):
    rows = [f"{second},48.0,{11.0 + 1e-4 * second},500,0,{cell if second == 7 else 7.4},0" for second in range(20)]
    (tmp_path / "gps.csv").write_text("time_s,lat_deg,lon_deg,height_m,vn_m_s,ve_m_s,vd_m_s\n" + "\n".join(rows))
    with refused(InputError, "input.infinite_velocity") as caught:
        read_gps(tmp_path / "gps.csv")
    assert caught.value.where.endswith("gps.csv:9:ve_m_s")


def test_a_damaged_kernel_file_says_what_to_delete(capsys):
    assert cli._explain(pickle.UnpicklingError("invalid load key, 'x'.")) == 3
    assert "cli.damaged_kernel" in capsys.readouterr().err


_FAR = """
purpose = "as fast, high and low as the models go"
vehicle = "aircraft"
[start]
lat = "47 deg"
lon = "9 deg"
height = "{height} m"
heading = "40 deg"
speed = "{speed} m/s"
[[segment]]
kind = "turn"
angle = "60 deg"
rate = "1.5 deg/s"
[[segment]]
kind = "climb"
height = "30 m"
angle = "3 deg"
[[segment]]
kind = "turn"
angle = "-90 deg"
rate = "1.5 deg/s"
"""


@pytest.mark.parametrize(("height", "speed"), [(12e3, 300.0), (50e3, 300.0), (-430.0, 20.0), (12e3, 600.0)])
def test_n24_fast_high_and_below_the_sea(bars, tmp_path: Path, height: float, speed: float):
    (tmp_path / "far.toml").write_text(_FAR.format(height=height, speed=speed))
    done = insnav.simulate(tmp_path / "far.toml", imu="tactical", seed=2).navigate()
    error = done.found.smoothed_errors
    assert error is not None
    assert np.mean(np.abs(error.position) < 3.0 * error.sd[:, :3]) >= bars["N24"]["inside_3_sd"]
    shares = [each.get("velocity_share", 0.0) for each in of_code(done.findings, Code.RUN_MANY_REJECTED)]
    assert any(share > 0.995 for share in shares) == (speed > bars["N24"]["fastest_m_s"])


def test_n26_memory_of_the_filter_does_not_grow_with_the_drive(bars, monkeypatch):
    monkeypatch.setattr(spill, "LARGE", 1 << 20)  # as if the drive were 16 times as long
    peaks = {}
    for laps in (2, 8, 24):  # imports count the first time; a lap is 75 s
        imu = drives.noisy_imu(drives.perfect_imu(laps=laps), drives.MODEL, np.random.default_rng(1))
        gps = drives.noisy_gps(drives.perfect_gps(laps=laps), np.random.default_rng(2))
        tracemalloc.start()
        navigate_recording(imu, gps, drives.SPEC, Receiver(LeverArm(drives.LEVER_B)))
        peaks[laps] = tracemalloc.get_traced_memory()[1] / 1e6
        tracemalloc.stop()
    growth = (peaks[24] - peaks[8]) / (16 * 75.0 / 3600.0)
    print(f"{growth:.1f} MB an hour")
    assert growth < bars["N26"]["growth_mb_h"]
