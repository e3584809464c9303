"""Ring laser gyros at rest in a vehicle with people in it: gyrocompass and fine alignment.

The heading that came with the recording is itself coarse, and so is the band around it.
"""

from __future__ import annotations

import numpy as np
import pytest

from insnav.alignment import find_stationary
from insnav.attitude import wrap_pi
from insnav.filter.fine_alignment import FineAlignment, fine_alignment
from insnav.findings import Code
from insnav.imu import identify, load_imu
from insnav.input import read_imu, read_reference
from insnav.strapdown import intervals
from insnav.types import Alignment, FloatArray, ImuData
from tests.shared import recorded

NAME = "psins_rlg_static"
HEADING, LATITUDE = 90.6, 34.246  # as given with the recording [deg]


@pytest.fixture(scope="module")
def imu() -> ImuData:
    return read_imu(recorded(NAME) / "imu.csv.gz").data


@pytest.fixture(scope="module")
def lla() -> FloatArray:
    return read_reference(recorded(NAME) / "ref.csv").data.lla[0]


@pytest.fixture(scope="module")
def whole(imu: ImuData, lla: FloatArray) -> FineAlignment:
    return aligned(imu, lla, 0.0, 1.0)


def test_the_whole_record_is_found_to_be_at_rest(imu: ImuData) -> None:
    rest = find_stationary(intervals(imu))
    assert rest is not None
    assert rest[0] == pytest.approx(imu.time[0], abs=1.0)
    assert rest[1] == pytest.approx(imu.time[-1], abs=1.0)


def test_gyrocompass_finds_the_heading(whole: FineAlignment) -> None:
    found = whole.coarse
    assert found.heading_method is Code.ALIGN_HEADING_GYROCOMPASS
    off = np.degrees(wrap_pi(found.rph[2] - np.radians(HEADING)))
    print(f"gyrocompass {_text(found)}, given {HEADING} deg")
    assert abs(off) < 2.5
    assert abs(off) < 3.0 * np.degrees(found.sd[2])


def test_latitude_shows_in_the_sensors(whole: FineAlignment) -> None:
    latitude = np.degrees(whole.sensor_latitude)
    print(f"latitude from the sensors {latitude:.3f} deg, given {LATITUDE} deg")
    assert latitude == pytest.approx(LATITUDE, abs=1.0)


def test_fine_alignments_of_both_halves_agree_within_their_sd(imu: ImuData, lla: FloatArray) -> None:
    halves = [aligned(imu, lla, *share).fine for share in ((0.0, 0.5), (0.5, 1.0))]
    first, second = halves
    assert first is not None
    assert second is not None
    print(f"first half {_text(first)}, second half {_text(second)}")
    apart = np.degrees(abs(wrap_pi(first.rph[2] - second.rph[2])))
    sd = np.degrees(np.array([first.sd[2], second.sd[2]]))
    assert apart < 3.0 * np.hypot(*sd)
    assert (sd < 0.1).all()


def test_fine_alignment_ends_near_the_given_heading(whole: FineAlignment) -> None:
    assert whole.fine is not None
    print(f"fine {_text(whole.fine)}, given {HEADING} deg")
    assert np.degrees(whole.fine.rph[2]) == pytest.approx(HEADING, abs=2.5)
    assert np.degrees(whole.fine.sd[2]) < 0.1


def test_the_imu_model_found_from_the_noise_aligns_too(imu: ImuData, lla: FloatArray) -> None:
    span = (float(imu.time[0]), float(imu.time[-1]))
    spec, sentence = identify(imu, *span)
    found = fine_alignment(imu, spec, lla, span)
    assert found.fine is not None
    print(f"{sentence} coarse {_text(found.coarse)}, fine {_text(found.fine)}")
    for each in (found.coarse, found.fine):
        assert abs(wrap_pi(each.rph[2] - np.radians(HEADING))) < 3.0 * each.sd[2]
        assert np.degrees(each.sd[2]) < 10.0


def aligned(imu: ImuData, lla: FloatArray, begin: float, end: float) -> FineAlignment:
    """Alignment by a share of the record, with gyros of navigation grade."""
    first, length = imu.time[0], imu.time[-1] - imu.time[0]
    return fine_alignment(imu, load_imu("navigation"), lla, (first + begin * length, first + end * length))


def _text(found: Alignment) -> str:
    return f"{np.degrees(found.rph[2]):.3f} +- {np.degrees(found.sd[2]):.3f} deg"
