"""Data in rows: every field survives a choice of rows, and a table gives back what was put in."""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from insnav import types
from insnav.errors.metrics import TrajectoryErrors
from insnav.exceptions import InputError
from insnav.input import read_gps, read_imu, read_reference
from insnav.tabular import FromTable, Tabular

N = 7
_WORDS = {"sampling": "instant", "stamp": "mid"}  # what is no array
_WIDE = {("Epochs", "q_nb"): (4,), ("Epochs", "covariance"): (9, 9)}
KINDS = [kind for kind in vars(types).values() if isinstance(kind, type) and issubclass(kind, Tabular)]
KINDS = [kind for kind in KINDS if kind not in (Tabular, FromTable)] + [TrajectoryErrors]


def _filled(kind: type[Tabular], seed: int = 0) -> Any:
    """An object of the type with another value in every cell of every field, also of those that may be absent."""
    rng = np.random.default_rng(seed)
    values: dict[str, Any] = {}
    for field in fields(kind):
        if field.name not in kind.COLUMNS:
            values[field.name] = _WORDS[field.name]
            continue
        width = len(kind.COLUMNS[field.name])
        shape = _WIDE.get((kind.__name__, field.name), (width,) if width > 1 else ())
        array: Any = rng.uniform(0.1, 1.0, (N, *shape))
        if field.name == "covariance":
            array = array @ np.swapaxes(array, 1, 2)
        values[field.name] = rng.integers(0, 6, N) if field.name == "fix" else array
    return kind(**values)


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
@pytest.mark.parametrize(
    "chosen",
    [slice(2, 5), slice(None, None, 3), np.arange(N) % 2 == 0, np.array([4, 1, 1])],
    ids=["slice", "stride", "mask", "index"],
)
def test_every_field_survives_a_choice_of_rows(kind: type[Tabular], chosen: Any) -> None:
    data = _filled(kind)
    part = data.rows(chosen)
    assert type(part) is kind
    for field in fields(kind):
        whole, left = getattr(data, field.name), getattr(part, field.name)
        if isinstance(whole, str):
            assert left == whole
        else:
            np.testing.assert_array_equal(left, whole[chosen], err_msg=field.name)


def test_all_kinds_of_rows_are_looked_at() -> None:
    assert {kind.__name__ for kind in KINDS} == {
        "ImuData", "GpsData", "Trajectory", "Increments", "Innovations", "SensorErrors", "Epochs",
        "TrajectoryErrors",
    }  # fmt: skip


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
def test_rows_keep_what_is_absent_absent(kind: type[Tabular]) -> None:
    optional = {field.name: None for field in fields(kind) if field.default is None}
    part = replace(_filled(kind), **optional).rows(slice(3))
    assert all(getattr(part, name) is None for name in optional)


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
def test_no_rows_are_columns_without_rows(kind: type[Tabular]) -> None:
    """A solution whose every fix was rejected has none: its table ended as a defect."""
    columns = _filled(kind).rows(slice(0)).columns()
    assert list(columns) == list(_filled(kind).columns())
    assert {len(column) for column in columns.values()} == {0}


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
def test_rows_cut_in_two_and_joined_are_the_same(kind: type[Tabular]) -> None:
    data = _filled(kind)
    again = data.rows(slice(3)).joined(data.rows(slice(3, None)))
    for field in fields(kind):
        np.testing.assert_array_equal(getattr(again, field.name), getattr(data, field.name), err_msg=field.name)


def test_joined_rows_have_only_what_both_have() -> None:
    data = _filled(types.GpsData)
    joined = data.joined(replace(data, heading=None))
    assert joined.heading is None
    assert joined.fix.shape == (2 * N,)


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
def test_every_field_has_its_columns_in_the_table(kind: type[Tabular]) -> None:
    frame = _filled(kind).to_frame()
    names = [name for names in kind.COLUMNS.values() for name in names]
    assert len(set(names)) == len(names)
    assert list(frame.columns) == names
    assert len(frame) == N
    assert set(kind.COLUMNS) | set(frame.attrs) == {field.name for field in fields(kind)}


@pytest.mark.parametrize("kind", [kind for kind in KINDS if issubclass(kind, FromTable)], ids=lambda k: k.__name__)
@pytest.mark.parametrize("optional", [True, False])
def test_a_table_gives_back_what_was_put_in(kind: type[FromTable], optional: bool) -> None:
    data = _filled(kind)
    if not optional:
        data = replace(data, **{field.name: None for field in fields(kind) if field.default is None})
    again = kind.from_frame(data.to_frame())
    for field in fields(kind):
        before, after = getattr(data, field.name), getattr(again, field.name)
        if isinstance(before, np.ndarray):
            assert after.dtype == before.dtype
            assert after.flags.writeable
            np.testing.assert_allclose(after, before, rtol=4e-16, err_msg=field.name)
        else:
            assert after == before


def test_units_are_those_in_the_names() -> None:
    lla = np.deg2rad([[48.0, 11.0, 0.0]])
    place = types.Trajectory(np.zeros(1), lla, np.ones((1, 3)), np.deg2rad([[1.0, 2.0, 359.0]]))
    row = place.to_frame().iloc[0]
    assert row["lat_deg"] == pytest.approx(48.0)
    assert row["heading_deg"] == pytest.approx(359.0)
    assert row["vd_m_s"] == 1.0
    bias = np.array([[np.deg2rad(1.0) / 3600.0] * 3 + [9.80665e-3] * 3 + [1e-6] * 6])
    errors = types.SensorErrors(np.zeros(1), bias, 2.0 * bias).to_frame().iloc[0]
    assert errors["gyro_bias_x_deg_h"] == pytest.approx(1.0)
    assert errors["accel_bias_y_mg"] == pytest.approx(1.0)
    assert errors["sd_accel_scale_z_ppm"] == pytest.approx(2.0)


def test_covariance_is_shown_as_standard_deviations() -> None:
    epochs = _filled(types.Epochs)
    np.testing.assert_allclose(epochs.to_frame()["sd_vd_m_s"], np.sqrt(epochs.covariance[:, 5, 5]))


def test_increments_have_columns_of_their_own() -> None:
    data = replace(_filled(types.ImuData), sampling="increment")
    frame = data.to_frame()
    assert "dtheta_x_rad" in frame
    assert "gyro_x_rad_s" not in frame
    frame.attrs = {}
    again = types.ImuData.from_frame(frame, stamp="start")
    assert (again.sampling, again.stamp) == ("increment", "start")
    np.testing.assert_array_equal(again.accel, data.accel)


def test_what_a_table_does_not_tell_is_unknown() -> None:
    frame = _filled(types.GpsData).to_frame()[["time_s", "lat_deg", "lon_deg", "height_m", "vn_m_s", "ve_m_s"]]
    gps = types.GpsData.from_frame(frame)
    assert gps.fix is None
    assert gps.heading is None
    assert np.isnan(gps.position_sd).all()
    assert np.isfinite(gps.v_n[:, :2]).all()
    assert np.isnan(gps.v_n[:, 2]).all()


def test_other_columns_are_an_error_that_names_them() -> None:
    frame = _filled(types.GpsData).to_frame().rename(columns={"lat_deg": "latitude"})
    with pytest.raises(InputError) as raised:
        types.GpsData.from_frame(frame)
    assert raised.value.code == "data.columns"
    assert (raised.value.values["unknown"], raised.value.values["missing"]) == (("latitude",), ("lat_deg",))


def _car(n: int = 400) -> tuple[types.ImuData, types.GpsData, types.Trajectory]:
    """Plausible samples at 50 Hz, fixes and a reference at 5 Hz of a car that drives a curve."""
    rng = np.random.default_rng(1)
    time = 100.0 + np.arange(n) / 50.0
    gyro = 0.01 * rng.standard_normal((n, 3)) + [0.0, 0.0, 0.1]
    accel = 0.1 * rng.standard_normal((n, 3)) + [0.0, 1.0, -9.81]
    imu = types.ImuData(time, gyro, accel, temperature=20.0 + rng.random(n), odometer=10.0 + rng.random(n))
    at, m = time[::10], n // 10
    lla = np.deg2rad([48.0, 11.0, 0.0]) + np.column_stack([1e-6 * at, 1e-6 * at, 500.0 + rng.random(m)])
    v_n = [6.4, 4.3, 0.0] + 0.1 * rng.random((m, 3))  # as the positions move
    sd = 0.5 + rng.random((m, 3))
    gps = types.GpsData(at, lla, v_n, sd, 0.1 * sd, np.full(m, 4), *np.linspace([0.1, 7.0, 1.0], [0.2, 9.0, 2.0], m).T)
    rph = np.column_stack([0.01 * rng.random((m, 2)), np.linspace(0.1, 0.2, m)])
    return imu, gps, types.Trajectory(at, lla, v_n, rph)


def test_tables_written_as_csv_are_read_as_what_they_were(tmp_path: Path):
    made = _car()
    for data, read, fields_read in zip(
        made,
        (read_imu, read_gps, read_reference),
        (("gyro", "accel", "temperature", "odometer"), tuple(types.GpsData.COLUMNS), ("lla", "v_n", "rph")),
        strict=True,
    ):
        path = tmp_path / f"{type(data).__name__}.csv"
        data.to_frame().to_csv(path, index=False)
        again = read(path).data
        for name in ("time", *fields_read):
            np.testing.assert_allclose(getattr(again, name), getattr(data, name), rtol=1e-14, err_msg=name)
