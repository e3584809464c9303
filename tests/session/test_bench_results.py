"""Results of the bench show themselves, and are saved and opened again."""

from __future__ import annotations

from collections.abc import Callable
from html import unescape
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure

import insnav
from insnav.certificate import certify, platform_checks, strapdown_checks
from insnav.errors import platform_errors
from insnav.lab.multi_position.method import find_sections
from insnav.output.folder import read_facts
from insnav.result import Result
from insnav.session.platform_run import demonstrate
from insnav.types import ImuData
from tests.lab import modules, sweeps
from tests.lab.published import lab_file
from tests.lab.test_multi_position import measured as poses
from tests.lab.test_six_positions import measured as six_positions
from tests.shared import verify_folder


def of_an_imu() -> Result[Any]:
    rng = np.random.default_rng(3)
    gyro, accel = rng.normal(0.0, 1e-3, (5000, 3)), rng.normal(0.0, 0.01, (5000, 3))
    accel[:, 2] -= 9.8
    return insnav.allan(ImuData(np.linspace(0.01, 50.0, 5000), gyro, accel), taus="octave")


def of_signals() -> Result[Any]:
    signals = np.random.default_rng(1).normal(size=(5000, 3))
    signals[:, 2] = 1.0  # never changes
    return insnav.allan(signals, rate=100.0, taus="octave")


def of_drift() -> Result[Any]:
    time, rng = 0.1 * np.arange(1, 2501), np.random.default_rng(1)
    rate = 60.0 * np.clip((time - 100.0) / 100.0, 0.0, 1.0)
    output = 1.003 * rate + 0.4 + 0.05 * rng.standard_normal(time.size)
    return insnav.drift(pd.DataFrame({"time_s": time, "gyro_z_deg_s": output, "rate_z_deg_s": rate}))


def of_acceptance() -> Result[Any]:
    rates = np.array([0.0, 10.0, 20.0, 40.0, 60.0, 80.0, -10.0, -20.0, -40.0, -60.0, -80.0])
    output = 0.99 * rates + 0.04 + 0.002 * np.random.default_rng(1).standard_normal(11)
    table = pd.DataFrame({"rate_x_deg_s": rates, "gyro_x_deg_s": output})
    biases = pd.DataFrame({"powerup": np.arange(5.0), "accel_z_bias_g": [0.01, 0.012, 0.011, 0.009, 0.01]})
    return insnav.acceptance([table], powerups=[biases])


def of_the_numerics() -> Result[Any]:
    with pytest.MonkeyPatch.context() as patch:  # only what takes no time
        patch.setattr(certify, "TOPICS", (strapdown_checks.coning,))
        patch.setattr(certify, "OTHERS", (platform_checks.gravity,))
        return insnav.verify()


def of_a_platform(**more: Any) -> Result[Any]:
    force = {"time_s": np.arange(0.0, 601.0), "f_east_m_s2": 0.1, "f_north_m_s2": 0.0, "f_up_m_s2": 9.8}
    return insnav.platform(pd.DataFrame(force), 0.8, 0.2, 100.0, **more)


def of_a_platform_with_errors() -> Result[Any]:
    return of_a_platform(errors={"drift": np.array([1e-7, 0.0, 0.0])}, integrator="mean")


def of_the_demonstration() -> Result[Any]:
    with pytest.MonkeyPatch.context() as patch:
        for name, value in (("DAY_RATE", 0.5), ("PATTERN", 120.0), ("FLIGHT", 60.0)):
            patch.setattr(platform_errors, name, value)
        return demonstrate()


def of_gyros() -> Result[Any]:
    rate = np.arange(-80.0, 81.0, 20.0)
    volts = 0.1 + 0.05 * rate + 1e-5 * np.random.default_rng(1).normal(size=rate.size)
    return insnav.calibrate("gyro", pd.DataFrame({"rate_deg_s": rate, "output_v": volts}))


def of_accelerometers() -> Result[Any]:
    return insnav.calibrate("accel", lab_file("accel_tumble_12.csv"))


def of_sweeps() -> Result[Any]:
    rng = np.random.default_rng(1)
    with TemporaryDirectory() as place:
        sweeps.write(Path(place), sweeps.gyros(rng, (sweeps.cubic, sweeps.straight, sweeps.asymmetric)), 0.005, rng)
        return insnav.calibrate("imu", [f"{place}/about_{axis}.csv" for axis in "xyz"])


def of_nine_positions() -> Result[Any]:
    rng = np.random.default_rng(1)
    values = modules.make(rng, 0.004, 0.003).measure(modules.NINE, 0.003, rng)
    columns = ("roll_deg", "pitch_deg", *(f"{name}_m_s2" for name in ("x_ay", "x_az", "y_az", "y_ax", "z_ax", "z_ay")))
    table = pd.DataFrame(np.column_stack((np.degrees(modules.NINE), values)), columns=list(columns))
    return insnav.calibrate("nine", table, gravity=9.81)


def of_poses() -> Result[Any]:
    return insnav.calibrate("poses", poses(np.random.default_rng(1)), gravity=9.81)


def of_six_positions() -> Result[Any]:
    data = six_positions(0.003)
    with TemporaryDirectory() as place:
        file = Path(place) / "sections.toml"
        file.write_text("".join(f"{name} = [{a}, {b}]\n" for name, (a, b) in find_sections(data).items()))
        return insnav.calibrate("poses", data, gravity=9.81, six=True, sections=file)


def of_a_rotor() -> Result[Any]:
    rng, g = np.random.default_rng(1), 9.80665
    height, rate = np.arange(0.3, 1.05, 0.1), np.arange(30.0, 70.0, 6.0)
    squared = 2.0 * height * (8e-3 + 0.06 * 0.0225**2) / (0.06 * g * 0.0225**2) + 0.05 * rng.normal(size=height.size)
    period = 2.0 * np.pi * 8e-3 * rate / (0.05 * g * 0.25) * (1.0 + 0.003 * rng.normal(size=rate.size))
    fall = pd.DataFrame({"height_m": height, "fall_time_s": np.sqrt(squared)})
    turns = pd.DataFrame({"precession_period_s": period, "rotor_rate_rad_s": rate})
    return insnav.calibrate("rotor", [fall, turns], fall_mass=0.06, radius=0.0225, mass=0.05, arm=0.25)


# what makes each, its kind, its files, a figure and a column of its table
RESULTS: dict[str, tuple[Callable[[], Result[Any]], str, tuple[str, ...], str, str]] = {
    "allan": (of_an_imu, "allan", ("allan.csv", "imu.toml"), "allan", "gyro_x_deg_h"),
    "allan of signals": (of_signals, "allan", ("allan.csv",), "allan", "signal_1"),
    "gyro": (of_gyros, "calibration", ("calibration.toml",), "residuals", "sd"),
    "accel": (of_accelerometers, "calibration", ("calibration.toml",), "residuals", "sd"),
    "imu": (of_sweeps, "calibration", ("calibration.toml",), "rate_errors", "sd"),
    "nine": (of_nine_positions, "calibration", ("calibration.toml",), "residuals", "sd"),
    "poses": (of_poses, "calibration", ("calibration.toml",), "poses", "sd"),
    "six positions": (of_six_positions, "calibration", ("calibration.toml",), "positions", "sd"),
    "rotor": (of_a_rotor, "calibration", (), "lines", "sd"),
    "acceptance": (of_acceptance, "acceptance", (), "residuals_gyro", "repeatability_ug"),
    "certificate": (of_the_numerics, "certificate", (), "certificate", "errors_polynomial"),
    "platform": (of_a_platform, "platform", ("solution.csv", "torquing.csv"), "track", "lat_deg"),
    "platform with errors": (of_a_platform_with_errors, "platform", ("solution.csv",), "errors", "lat_deg"),
    "demonstration": (of_the_demonstration, "platform", (), "sine", "order_on_sine"),
    "drift": (of_drift, "drift", ("calibration.toml", "rates.csv"), "drift", "smoothed_deg_h"),
}


@pytest.mark.parametrize("name", RESULTS)
def test_a_result_of_the_bench_is_saved_opened_and_shown(name: str, tmp_path: Path) -> None:
    make, kind, files, figure, column = RESULTS[name]
    result = make()
    assert result.kind == kind
    where = result.save(tmp_path / "out")
    verify_folder(where)
    assert {*files, "found.npz", "report.html", "run.json"} <= {path.name for path in where.iterdir()}
    assert read_facts(where)["kind"] == kind
    again = insnav.open_result(where)
    assert again.kind == kind
    assert again.findings == result.findings
    assert again.summary() == result.summary()
    assert again.inputs == result.inputs
    assert again.imu_model is None
    for each in (result, again):
        assert column in each.to_frame()
        assert len(each.to_frame()) > 0
        assert isinstance(each.plot(figure), Figure)
        assert each.page().title in unescape(each._repr_html_())
