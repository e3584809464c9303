"""JSON of openpilot, BDD100K and Sensor Logger, and records of any logger, one a line."""

from __future__ import annotations

import json

import numpy as np
import pytest

from insnav.exceptions import InputError
from insnav.findings import Code, of_code
from insnav.input import read_gps, read_imu
from tests.input import written_logs as logs
from tests.input.recordings import FIXES, SAMPLES, UNIX, Motion, same_places
from tests.refusals import refused

START = logs.BOOT


def _lines(*records: object) -> bytes:
    return "".join(json.dumps(each) + "\n" for each in records).encode()


def test_openpilot_has_one_clock_for_samples_and_fixes(save):
    path = save(logs.openpilot())
    imu, gps = read_imu(path, use="drive"), read_gps(path)
    assert np.allclose(imu.data.gyro, SAMPLES.gyro)
    assert np.allclose(imu.data.accel, SAMPLES.accel)
    assert np.allclose(imu.data.time, START + SAMPLES.t, atol=1e-6)
    assert np.allclose(gps.data.time, START + FIXES.t, atol=1e-6)
    assert same_places(gps.data)
    assert np.allclose(gps.data.v_n[:, :2], FIXES.v_n[:, :2], atol=1e-6)


def test_older_openpilot_has_lists_of_events(save):
    records = []
    for t, w, f in zip(SAMPLES.t, SAMPLES.gyro, SAMPLES.accel, strict=True):
        now = round((START + t) * 1e9)
        events = [{"sensor": 1, "timestamp": now - 5, "acceleration": {"v": [*f], "status": 3}}]
        events += [{"sensor": 4, "timestamp": now - 5, "gyro": {"v": [*w], "status": 3}}]
        records.append({"logMonoTime": now, "valid": True, "sensorEvents": events})
    imu = read_imu(save(_lines(*records, {"logMonoTime": 1, "valid": True, "carState": {"vEgo": 3.0}})), use="drive")
    assert np.allclose(imu.data.gyro, SAMPLES.gyro)
    assert np.allclose(imu.data.time, START + SAMPLES.t, atol=1e-6)


def test_bdd100k_is_one_document_in_milliseconds_and_g(save):
    path = save(logs.bdd100k())
    imu, gps = read_imu(path, use="drive", units="accel=g"), read_gps(path)
    assert np.allclose(imu.data.accel, SAMPLES.accel, atol=1e-6)
    assert np.allclose(imu.data.gyro, SAMPLES.gyro)
    assert np.allclose(gps.data.time, UNIX + FIXES.t, atol=1e-3)
    place = Motion(FIXES.t)
    gps.data.lla[:, 2] = place.lla[:, 2]  # the locations have no heights
    assert same_places(gps.data)


def test_sensor_logger_writes_numbers_as_text(save):
    records = []
    for t, w, f in zip(SAMPLES.t, SAMPLES.gyro, SAMPLES.accel, strict=True):
        for sensor, values in (
            ("TotalAcceleration", f[[1, 0, 2]] * [1, 1, -1]),
            ("Gyroscope", w[[1, 0, 2]] * [1, 1, -1]),
        ):
            own = {axis: str(value) for axis, value in zip("xyz", values, strict=True)}
            records.append(
                {"sensor": sensor, "time": str(round((UNIX + t) * 1e9)), "seconds_elapsed": f"{t:.3f}", **own}
            )
    path = save(json.dumps(records).encode())
    imu = read_imu(path)
    assert imu.facts.axes == "RFU"
    assert np.allclose(imu.data.gyro, SAMPLES.gyro)
    assert np.allclose(imu.data.accel, SAMPLES.accel)


@pytest.mark.parametrize("kind", ["flat", "nested", "vectors"])
def test_records_of_one_kind_are_a_table(save, kind):
    records = []
    for t, w, f in zip(SAMPLES.t, SAMPLES.gyro, SAMPLES.accel, strict=True):
        parts = [
            {f"{name}_{axis}": value for axis, value in zip("xyz", each, strict=True)}
            for name, each in (("gyro", w), ("accel", f))
        ]
        nested = {name: dict(zip("xyz", each, strict=True)) for name, each in (("gyro", w), ("accel", f))}
        own = {"flat": {**parts[0], **parts[1]}, "nested": nested, "vectors": {"gyro": [*w], "accel": [*f]}}[kind]
        records.append({"timestamp": UNIX + t, "frame": 'a "name", with comma', **own})
    imu = read_imu(save(_lines(*records)))
    assert np.allclose(imu.data.gyro, SAMPLES.gyro)
    assert np.allclose(imu.data.accel, SAMPLES.accel)


def test_kinds_named_in_the_records_are_parts_of_the_recording(save):
    samples = [
        {"type": "imu", "t": UNIX + t, **dict(zip(("gx", "gy", "gz", "ax", "ay", "az"), [*w, *f], strict=True))}
        for t, w, f in zip(SAMPLES.t, SAMPLES.gyro, SAMPLES.accel, strict=True)
    ]
    places = [
        {"type": "gps", "t": UNIX + t, "lat": a, "lon": b, "alt": c}
        for t, (a, b, c) in zip(FIXES.t, FIXES.lla, strict=True)
    ]
    path = save(_lines(*samples, *places))
    assert np.allclose(read_imu(path).data.accel, SAMPLES.accel)
    assert same_places(read_gps(path).data)


def test_a_cut_last_line_is_told_and_damage_inside_is_refused(save):
    whole = logs.openpilot()
    imu = read_imu(save(whole[: len(whole) // 2]), use="drive")
    assert 0 < len(imu.data.time) < len(SAMPLES.t)
    assert [*of_code((*imu.events, *imu.facts.evidence), Code.ROWS_CUT)]
    lines = whole.splitlines()
    lines[7] = lines[7][:20]
    with refused(InputError, "format.json_damaged") as caught:
        read_imu(save(b"\n".join(lines)))
    assert caught.value.where.endswith(":8")


@pytest.mark.parametrize("text", [b'{"a": 1}', b'[{"a": 1}]', b'{"a": {}}'])
def test_json_without_records_is_refused(save, text):
    with refused(InputError, "format.json_no_records"):
        read_gps(save(text))


def test_nesting_without_end_is_refused_in_words(save):
    with refused(InputError, "format.json_damaged"):
        read_gps(save(b'{"a":' * 100_000))
