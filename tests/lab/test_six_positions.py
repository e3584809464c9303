"""Six positions and three turns: against simulated truth, and against the package imucal on a recorded session."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from insnav.exceptions import ConfigError, InputError
from insnav.imu import ImuErrors, corrupt
from insnav.input import read_imu
from insnav.lab.multi_position.method import (
    POSITIONS,
    SECTIONS,
    calibrate_six_positions,
    check_sections,
    find_sections,
)
from insnav.types import FloatArray, ImuData
from tests.lab.hand import G, record
from tests.refusals import refused
from tests.shared import recorded

TRUE = ImuErrors(
    gyro_bias=np.array([0.010, -0.006, 0.002]),
    gyro_matrix=np.array([[1.020, 0.004, -0.006], [0.003, 0.985, 0.008], [-0.002, 0.005, 1.010]]),
    accel_bias=np.array([0.15, -0.20, 0.08]),
    accel_matrix=np.array([[1.004, 0.003, -0.005], [0.006, 0.993, 0.002], [-0.004, 0.009, 1.012]]),
)
G_SENSITIVITY = np.array([[2.0, -1.0, 0.5], [0.0, 1.5, -2.0], [1.0, 0.5, -1.0]]) * 1e-4
X, Y, Z = np.eye(3)
HALF, FULL = np.pi / 2.0, 2.0 * np.pi
# from z down: z down and up, x up, turned about it, x down, y up, turned about it, y down, z up, turned about it
MOVES = [
    (X, 2.0 * HALF), (Y, -HALF), (X, -FULL), (Y, 2.0 * HALF), (Z, -HALF), (Y, FULL), (X, 2.0 * HALF), (X, -HALF),
    (Z, FULL),
]  # fmt: skip


def ideal(moves: list[tuple[FloatArray, float]] = MOVES) -> ImuData:
    return record(moves, np.array([0.0, 0.0, -1.0]), rest=4.0, move=2.5)[0]


def measured(noise: float = 0.0, moves: list[tuple[FloatArray, float]] = MOVES) -> ImuData:
    truth = ideal(moves)
    wrong = corrupt(truth, TRUE)
    rng = np.random.default_rng(11)
    return replace(
        wrong,
        gyro=wrong.gyro + truth.accel @ G_SENSITIVITY.T + noise * rng.normal(size=wrong.gyro.shape),
        accel=wrong.accel + noise * rng.normal(size=wrong.accel.shape),
    )


def test_the_moves_of_this_test_show_every_position() -> None:
    ups = record(MOVES, np.array([0.0, 0.0, -1.0]))[1]
    for ideal_up in np.vstack((np.eye(3), -np.eye(3))):
        assert (ups @ ideal_up > 0.999).any(), ideal_up


def test_without_noise_the_truth_is_found() -> None:
    data = measured()
    found = calibrate_six_positions(data, G, find_sections(data))
    np.testing.assert_allclose(found.accel.bias, TRUE.accel_bias, atol=1e-9)
    np.testing.assert_allclose(found.accel.matrix, TRUE.accel_matrix, atol=1e-10)
    np.testing.assert_allclose(found.gyro.bias, TRUE.gyro_bias, atol=1e-9)
    np.testing.assert_allclose(found.gyro.matrix, TRUE.gyro_matrix, atol=1e-9)
    np.testing.assert_allclose(found.g_sensitivity, G_SENSITIVITY, atol=1e-12)
    assert found.tilt < 1e-9


def test_with_noise_and_tilted_positions_the_truth_is_within_the_uncertainty() -> None:
    rng = np.random.default_rng(21)
    scores: list[float] = []
    off = ~np.eye(3, dtype=bool)
    for _ in range(200):
        # six positions off by 5 mrad each, as means: what the method makes of a session without its motions
        data, spans = _positions(rng, tilt=5e-3, noise=0.02)
        found = calibrate_six_positions(data, G, spans)
        z = (found.accel.matrix - TRUE.accel_matrix) / found.accel.matrix_sd
        scores += list(z[off])
    # the tilt is estimated from six disagreements: Student's t with six degrees of freedom
    assert np.sqrt(np.mean(np.square(scores))) == pytest.approx(np.sqrt(6.0 / 4.0), rel=0.1)


def _positions(rng: np.random.Generator, tilt: float, noise: float) -> tuple[ImuData, dict[str, tuple[int, int]]]:
    n = 100
    force = []
    for axis in range(3):
        for way in (1.0, -1.0):
            up = way * np.eye(3)[axis] + tilt * rng.normal(size=3) * (np.eye(3)[axis] == 0.0)
            force.append(np.tile(G * up / np.linalg.norm(up), (n, 1)))
    gyro = np.zeros((6 * n, 3))
    spans = {name: (n * i, n * (i + 1)) for i, name in enumerate(POSITIONS)}
    for axis in range(3):
        rate = np.zeros((n, 3))
        rate[:, axis] = FULL / (n / 50.0)
        gyro = np.concatenate((gyro, rate))
        force.append(np.tile(G * np.eye(3)[axis], (n, 1)))
        spans[f"{'xyz'[axis]}_rot"] = (n * (6 + axis), n * (7 + axis))
    accel = np.concatenate(force)
    truth = ImuData(np.arange(1, len(gyro) + 1) / 50.0, gyro, accel)
    wrong = corrupt(truth, TRUE)
    return replace(
        wrong,
        gyro=wrong.gyro + 0.002 * rng.normal(size=gyro.shape),
        accel=wrong.accel + noise * rng.normal(size=gyro.shape),
    ), spans


def test_counts_give_the_same_as_si() -> None:
    data = measured(0.005)
    spans = find_sections(data)
    raw = replace(data, gyro=data.gyro * 4800.0 + 32700.0, accel=data.accel * 415.0 + 32900.0)
    assert find_sections(raw) == spans
    si, counted = calibrate_six_positions(data, G, spans), calibrate_six_positions(raw, G, spans, counts=True)
    np.testing.assert_allclose(counted.accel.matrix / 415.0, si.accel.matrix, atol=1e-9)
    np.testing.assert_allclose(counted.gyro.matrix / 4800.0, si.gyro.matrix, atol=1e-9)
    np.testing.assert_allclose((counted.gyro.bias - 32700.0) / 4800.0, si.gyro.bias, atol=1e-9)
    np.testing.assert_allclose(counted.accel.matrix_sd / 415.0, si.accel.matrix_sd, rtol=1e-6)


def test_bad_sections_are_refused_all_at_once() -> None:
    with refused(ConfigError, "lab.sections_unusable") as caught:
        check_sections({"x_p": (0, 10), "q_p": (0, 10), "y_a": (5, 5000)}, 100)
    assert "z_rot" in caught.value.values["missing"]
    assert caught.value.values["unknown"] == ("q_p",)
    assert caught.value.values["outside"] == ("y_a",)


@pytest.mark.parametrize(
    ("spoil", "code", "values"),
    [
        (lambda d, s: (d, s | {"x_p": s["y_p"]}), "lab.section_pose", {"section": "x_p", "pose": "x up"}),
        (lambda d, s: (d, s | {"x_p": s["x_a"], "x_a": s["x_p"]}), "lab.section_pose", {"section": "x_p"}),
        (lambda d, s: (d, s | {"x_rot": s["z_rot"]}), "lab.section_axis", {"section": "x_rot", "axis": "x"}),
        (
            lambda d, s: (d, s | {"y_rot": (s["y_rot"][0], s["y_rot"][0] + 60)}),
            "lab.section_angle",
            {"section": "y_rot"},
        ),
        (lambda d, s: (replace(d, gyro=d.gyro * 57.3), s), "lab.section_angle", {"turn_rad": 2.0 * np.pi}),
        (lambda d, s: (replace(d, accel=d.accel / 9.8), s), "lab.force_unit", {}),
        (lambda d, s: (replace(d, accel=d.accel[:, [1, 0, 2]]), s), "lab.section_pose", {"pose": "x up"}),
        (lambda d, s: (replace(d, gyro=d.gyro[:, [1, 0, 2]]), s), "lab.section_axis", {"axis": "x"}),
    ],
)
def test_bad_data_are_refused_with_the_reason(spoil, code: str, values: dict) -> None:
    data = measured(0.005)
    with refused(InputError, code) as caught:
        calibrate_six_positions(*_swapped(spoil(data, find_sections(data))))
    assert values.items() <= caught.value.values.items()


def _swapped(spoiled: tuple[ImuData, dict[str, tuple[int, int]]]) -> tuple[ImuData, float, dict[str, tuple[int, int]]]:
    return spoiled[0], G, spoiled[1]


def test_a_session_without_a_turn_is_refused_and_says_which() -> None:
    with refused(InputError, "lab.section_missing") as caught:
        find_sections(measured(0.005, MOVES[:5] + MOVES[6:]))
    assert caught.value.values["sections"] == ("y_rot",)


def _imucal_oracle(data: ImuData, sections: dict[str, dict[str, int]]):
    pd = pytest.importorskip("pandas")
    imucal = pytest.importorskip("imucal")
    frame = pd.DataFrame(
        np.column_stack((data.accel, np.rad2deg(data.gyro))),
        columns=["acc_x", "acc_y", "acc_z", "gyr_x", "gyr_y", "gyr_z"],
    )
    regions = imucal.ferraris_regions_from_section_list(frame, pd.DataFrame(sections).T)
    return imucal.FerrarisCalibration(grav=9.81, expected_angle=-360).compute(regions, 102.4, "m/s^2", "deg/s")


def test_a_recorded_session_gives_what_imucal_gives() -> None:
    folder = recorded("calib_ferraris_nilspod")
    data = read_imu(folder / "imu.csv").data
    sections = json.loads((folder / "sections.json").read_text())
    oracle = _imucal_oracle(data, sections)
    found = calibrate_six_positions(data, 9.81, {n: (s["start"], s["end"]) for n, s in sections.items()})
    np.testing.assert_allclose(found.accel.bias, oracle.b_a, atol=1e-12)
    np.testing.assert_allclose(found.accel.matrix, oracle.K_a @ oracle.R_a, atol=1e-12)
    # theirs is the mean of all samples, so that long positions leave some of what goes with the specific force in it
    np.testing.assert_allclose(np.rad2deg(found.gyro.bias), oracle.b_g, atol=1e-3)
    np.testing.assert_allclose(np.rad2deg(found.g_sensitivity), oracle.K_ga, atol=1e-12)
    # the bias makes a part in 1e6, the times of the file, rounded to the microsecond, a few
    np.testing.assert_allclose(found.gyro.matrix, oracle.K_g @ oracle.R_g, atol=1e-5)


def test_sections_found_in_the_recorded_session_are_those_marked_by_hand() -> None:
    folder = recorded("calib_ferraris_nilspod")
    data = read_imu(folder / "imu.csv").data
    marked = {n: (s["start"], s["end"]) for n, s in json.loads((folder / "sections.json").read_text()).items()}
    found = find_sections(data)
    assert tuple(found) == SECTIONS
    for name in (name for name in SECTIONS if name.endswith("rot")):  # turns: all of each, and rest around it
        assert found[name][0] <= marked[name][0] + 10
        assert found[name][1] >= marked[name][1] - 10
    by_hand, by_itself = calibrate_six_positions(data, 9.81, marked), calibrate_six_positions(data, 9.81, found)
    scatter = 3.0 * by_hand.accel.matrix_sd + 3.0 * by_itself.accel.matrix_sd + 1e-4
    assert (np.abs(by_hand.accel.matrix - by_itself.accel.matrix) < scatter).all()
    np.testing.assert_allclose(by_hand.gyro.matrix, by_itself.gyro.matrix, atol=1e-3)
    for both in (by_hand, by_itself):
        assert np.abs(both.norm_before).max() > 0.5
        assert np.abs(both.norm_after).max() < 0.002
