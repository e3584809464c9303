"""Files damaged at random: every one is either read, with finite numbers, or refused in words."""

from __future__ import annotations

import json
import random

import numpy as np
import pytest

from insnav.exceptions import InputError
from insnav.input import read_gps, read_imu, read_reference
from tests.input.files import GPS_HEADER, IMU_HEADER, as_text, fixes, rolling
from tests.input.test_rtklib_pos import solution

WORDS = ["", ",", ";", "\n", "\r", '"', "nan", "inf", "-", "1e308", "1e-320", "#", "%", " ", "\t", "\0", "0"]
WORDS += ["[", "(deg)", "x", "9" * 20, "s", "\u00e9", "\ud7ff"]
FILES = [
    (read_imu, as_text(rolling(60), IMU_HEADER)),
    (read_imu, as_text(rolling(60), IMU_HEADER, delimiter=";", decimal=",")),
    (read_imu, as_text(rolling(60), IMU_HEADER, delimiter=" ")),
    (read_gps, as_text(fixes(40), GPS_HEADER)),
    (read_gps, solution("llh")),
    (read_gps, solution("ecef", calendar=False)),
    (read_gps, solution("dms", separator=",")),
    (read_reference, as_text(fixes(40), GPS_HEADER.replace("sd_n_m", "roll_deg"))),
]


def _damaged(text: str, rng: random.Random) -> str:
    for _ in range(rng.choice([1, 1, 2, 5, 30])):
        what = rng.random()
        at = rng.randrange(len(text))
        lines = text.split("\n")
        line = rng.randrange(len(lines))
        if what < 0.5:
            text = text[:at] + rng.choice(WORDS) + text[at + rng.choice([0, 1, 3, 12]) :]
        elif what < 0.7:
            cells = lines[line].split(",")
            cells[rng.randrange(len(cells))] = rng.choice(WORDS)
            lines[line] = ",".join(cells)
            text = "\n".join(lines)
        elif what < 0.8:
            text = "\n".join([*lines[:line], rng.choice(lines), *lines[line:]])
        elif what < 0.9:
            at = rng.randrange(100)
            text = text[:at] + rng.choice(WORDS) + text[at + 1 :]
        else:
            text = text[:at]
        text = text or "x"
    return text


@pytest.mark.parametrize("seed", range(6))
def test_damaged_files_are_read_or_refused_in_words(tmp_path, seed):
    rng = random.Random(seed)
    read_well = 0
    for case in range(100):
        reader, text = rng.choice(FILES)
        path = tmp_path / f"{case}.csv"
        path.write_text(_damaged(text, rng), encoding="utf-8")
        try:
            reading = reader(path)
        except InputError:
            continue
        read_well += 1
        data = reading.data
        assert (np.diff(data.time) > 0).all()
        for array in (data.gyro, data.accel) if reader is read_imu else (data.lla,):
            assert np.isfinite(array).all()
        json.dumps(reading.facts.as_dict(), allow_nan=False)
    assert read_well > 5
