"""NMEA and u-blox logs, written by pynmeagps and pyubx2 from a known motion, and real ones where they lie."""

from __future__ import annotations

import re

import numpy as np
import pytest
from pynmeagps import NMEAMessage
from pyubx2 import GET, UBXMessage, UBXReader

from insnav.exceptions import InputError
from insnav.findings import Code
from insnav.input import read_gps, read_imu
from insnav.input.formats.ubx import _Clock, _sensor_time
from tests.input.files import noted
from tests.input.recordings import FIXES, REAL, SAMPLES, TOW, WEEK, Motion, real, same_places
from tests.refusals import refused

UTC = np.datetime64("1980-01-06T00:00:00.000") + np.timedelta64(WEEK * 604_800_000 + int(TOW * 1000) - 18_000, "ms")


def nmea(motion: Motion = FIXES, start: np.datetime64 = UTC, *, rmc: bool = True, gst: bool = True) -> bytes:
    """Sentences of each fix; the separation of the geoid is 21.5 m."""
    text = b""
    for t, lla, v, heading in zip(motion.t, motion.lla, motion.v_n, motion.heading, strict=True):
        now = start + np.timedelta64(round(t * 1e3), "ms")
        date, clock = str(now).split("T")
        clock = clock.replace(":", "")[:9]
        side = {"NS": "N" if lla[0] >= 0 else "S", "EW": "E" if lla[1] >= 0 else "W"}
        knots = np.hypot(*v[:2]) * 3600.0 / 1852.0
        lat, lon = (
            f"{int(a) * 100 + (a - int(a)) * 60:0{n}.7f}" for a, n in zip(np.abs(lla[:2]), (12, 13), strict=True)
        )
        place = [lat, side["NS"], lon, side["EW"]]
        day = f"{date[8:]}{date[5:7]}{date[2:4]}"
        if rmc:
            fields = [clock, "A", *place, f"{knots:.4f}", f"{heading:.4f}", day, "", "", "R"]
            text += NMEAMessage("GN", "RMC", GET, payload=fields).serialize()
        fields = [clock, *place, "4", "12", "0.8", f"{lla[2] - 21.5:.3f}", "M", "21.5", "M", "1.0", "0000"]
        text += NMEAMessage("GN", "GGA", GET, payload=fields).serialize()
        if gst:
            text += NMEAMessage("GN", "GST", GET, payload=[clock, "1", "1", "1", "0", "0.3", "0.4", "0.9"]).serialize()
        if not rmc:
            date_fields = [clock[:-1] + "3", date[8:], date[5:7], date[:4], "00", "00"]
            text += NMEAMessage("GN", "ZDA", GET, payload=date_fields).serialize()
            fields = [f"{heading:.4f}", "T", "", "M", f"{knots:.4f}", "N", f"{knots * 1.852:.4f}", "K", "R"]
            text += NMEAMessage("GN", "VTG", GET, payload=fields).serialize()
    return text


def ubx(motion: Motion = FIXES, *, samples: Motion | None = None, **others: int) -> bytes:
    """NAV-PVT of each fix, and ESF-MEAS of samples, whose clock began 1000 s before."""
    parts: list[tuple[float, bytes]] = []
    for t, lla, v in zip(motion.t, motion.lla, motion.v_n, strict=True):
        now = UTC + np.timedelta64(round(t * 1e3), "ms")
        date, clock = str(now).split("T")
        year, month, day = map(int, date.split("-"))
        hour, minute, second = clock.split(":")
        fields = {
            "iTOW": round((TOW + t) * 1e3), "year": year, "month": month, "day": day, "hour": int(hour),
            "min": int(minute), "second": int(float(second)), "validDate": 1, "validTime": 1, "tAcc": 20,
            "nano": round(float(second) % 1 * 1e9), "fixType": 3, "gnssFixOk": 1, "diffSoln": 1, "carrSoln": 2,
            "numSV": 20, "lon": lla[1], "lat": lla[0], "height": round(lla[2] * 1e3), "hMSL": 0, "hAcc": 20,
            "vAcc": 30, "velN": round(v[0] * 1e3), "velE": round(v[1] * 1e3), "velD": round(v[2] * 1e3), "sAcc": 100,
            "pDOP": 1.25,
        }  # fmt: skip
        parts.append((t + 0.03, UBXMessage("NAV", "NAV-PVT", GET, **(fields | others)).serialize()))
    for t, w, f in zip(samples.t, samples.gyro, samples.accel, strict=True) if samples else ():
        tag = round((1000.0 + t) * 1e3)
        words = [(14, w[0] * 57.29578 * 4096), (13, w[1] * 57.29578 * 4096), (5, w[2] * 57.29578 * 4096)]
        words += [(16, f[0] * 1024), (17, f[1] * 1024), (18, f[2] * 1024), (12, 2550)]
        data = b"".join((kind << 24 | (round(value) & 0xFFFFFF)).to_bytes(4, "little") for kind, value in words)
        head = tag.to_bytes(4, "little") + (len(words) << 11).to_bytes(2, "little") + bytes(2)
        parts.append((t, UBXMessage(b"\x10", b"\x02", GET, payload=head + data).serialize()))
    return b"".join(part for _, part in sorted(parts))


@pytest.fixture
def save(tmp_path):
    def write(data: bytes):
        path = tmp_path / "drive.log"
        path.write_bytes(data)
        return path

    return write


@pytest.mark.parametrize("rmc", [True, False])
def test_nmea_gives_time_place_velocity_quality_and_sd(save, rmc):
    data = read_gps(save(nmea(rmc=rmc))).data
    assert np.allclose(data.time, TOW + FIXES.t, atol=1e-9)
    assert same_places(data)
    assert np.allclose(data.v_n[:, :2], FIXES.v_n[:, :2], atol=1e-3)
    assert np.abs(data.v_n[:, 2]).max() < 0.01  # from the heights
    assert np.allclose(data.position_sd, [0.3, 0.4, 0.9])
    assert set(data.fix) == {1}
    assert (set(data.satellites), set(data.dop)) == ({12.0}, {0.8})


def test_a_new_day_does_not_turn_the_clock_back(save):
    start = np.datetime64("2024-12-31T23:59:56.000")
    data = read_gps(save(nmea(start=start))).data
    assert np.allclose(np.diff(data.time), 0.2)
    assert data.time[0] == pytest.approx(2 * 86_400 + 86_400 - 4 + 18)  # a Tuesday, and leap seconds


def test_sentences_with_a_wrong_checksum_are_left_out_and_counted(save):
    text = nmea()
    end = text.index(b"\n", 300) + 1
    reading = read_gps(save(text[:end] + b"\x00\xb5\xff junk \n" + text[end:].replace(b",0.3,", b",0.5,", 3)))
    (damaged,) = noted(reading, Code.READ_ROWS_DAMAGED)
    assert (damaged.subject, damaged["count"]) == ("NMEA", 3)
    assert np.isnan(reading.data.position_sd[:, 0]).sum() == 3


def test_exchanged_fields_that_the_checksum_does_not_show_are_no_positions(save):
    """The checksum is the same in any order. Longitude and dilution of precision exchanged moved a drive to 0.8'."""
    lines = []
    for line in nmea(rmc=False).split(b"\n"):
        words = line.split(b",")
        if words[0].endswith(b"GGA"):
            words[4], words[8] = words[8], words[4]
        lines.append(b",".join(words))
    with refused(InputError, "format.nmea_no_position"):
        read_gps(save(b"\n".join(lines)))


def test_altitude_without_separation_is_height_above_sea_level(save):
    text = b""
    for line in nmea().splitlines():
        if b"GGA" in line:
            fields = line[1:].split(b"*")[0].decode().split(",")
            fields[11] = ""
            line = NMEAMessage("GN", "GGA", GET, payload=fields[1:]).serialize().strip()
        text += line + b"\n"
    reading = read_gps(save(text))
    assert reading.facts.height == "msl"
    assert np.allclose(reading.data.lla[:, 2], 80.0 - 21.5, atol=2e-3)


def test_ubx_gives_what_pyubx2_reads(save):
    path = save(ubx())
    data = read_gps(path).data
    assert np.allclose(data.time, TOW + FIXES.t)
    assert same_places(data)
    assert np.allclose(data.v_n, FIXES.v_n, atol=6e-4)
    assert np.allclose(data.position_sd, [0.02 / 2**0.5, 0.02 / 2**0.5, 0.03])
    assert set(data.fix) == {1}
    assert (set(data.satellites), set(data.dop)) == ({20.0}, {1.25})
    with path.open("rb") as stream:
        theirs = [message for _, message in UBXReader(stream)]
    assert np.allclose(np.degrees(data.lla[:, 0]), [each.lat for each in theirs], atol=1e-12)


def test_high_precision_and_covariances_are_used(save):
    more = b""
    for t, lla in zip(FIXES.t, FIXES.lla, strict=True):
        itow = round((TOW + t) * 1e3)
        more += UBXMessage(
            "NAV", "NAV-HPPOSLLH", GET, iTOW=itow, lon=lla[1], lat=lla[0], height=90_000, _HPheight=0.4, hAcc=9, vAcc=9
        ).serialize()
        more += UBXMessage(
            "NAV", "NAV-COV", GET, iTOW=itow, posCovValid=1, velCovValid=1, posCovNN=0.01, posCovEE=0.04, posCovDD=0.09,
            velCovNN=1e-4, velCovEE=4e-4, velCovDD=9e-4,
        ).serialize()  # fmt: skip
    data = read_gps(save(ubx() + more)).data
    assert np.allclose(data.lla[:, 2], 90.0004)
    assert np.allclose(data.position_sd, [0.1, 0.2, 0.3])
    assert np.allclose(data.velocity_sd, [0.01, 0.02, 0.03])


def test_samples_of_the_receiver_lie_on_the_clock_of_the_fixes(save):
    path = save(ubx(samples=SAMPLES))
    data = read_imu(path).data
    assert np.allclose(data.gyro, SAMPLES.gyro, atol=1e-5)
    assert np.allclose(data.accel, SAMPLES.accel, atol=1e-3)
    assert np.allclose(np.diff(data.time), 0.01, atol=1e-6)
    # each epoch is written 30 ms after it was, which nothing in the log tells
    assert abs(data.time[0] - TOW + 0.03) < 0.015
    assert np.allclose(data.temperature, 25.5)
    assert same_places(read_gps(path).data)


@pytest.mark.parametrize("others", [{"fixType": 0}, {"gnssFixOk": 0}, {"fixType": 5}])
def test_epochs_without_a_fix_are_no_fixes(save, others):
    with pytest.raises(InputError, match="few"):
        read_gps(save(ubx(**others)))


def test_damaged_messages_are_left_out_and_counted(save):
    data = bytearray(ubx())
    data[100 * 3 + 40] ^= 1
    reading = read_gps(save(bytes(data)))
    assert len(reading.data.time) == len(FIXES.t) - 1
    (damaged,) = noted(reading, Code.READ_ROWS_DAMAGED)
    assert (damaged.subject, damaged["count"]) == ("NAV-PVT", 1)


def test_nmea_is_taken_where_ubx_has_no_position(save):
    ack = UBXMessage("ACK", "ACK-ACK", GET, clsID=6, msgID=1).serialize()
    assert same_places(read_gps(save(ack + nmea() + ack)).data)


@pytest.mark.parametrize("data", [b"\xb5b\x01\x07\x5c\x00", nmea()[:60], ubx()[:90]])
def test_a_log_without_a_whole_message_is_refused(save, data):
    with pytest.raises(InputError):
        read_gps(save(data))


@real
@pytest.mark.parametrize(
    ("file", "n", "start", "place", "fastest"),
    [
        ("nmea/f9k_drive_4min.nmea", 240, 440_628.0, (37.42, -122.08), 15.82),
        ("nmea/netr9_static_putty.nmea", 625, 396_328.0, (48.7807, 9.1716), None),
        ("ublox/walk_f9p_rawx_pvt.ubx", 515, 408_639.75, (40.0967, -105.1472), 1.82),
        ("ublox/zed_f9r_esf_status_nav_pvat.ubx", 527, 136_153.0, (51.262, -0.573), 15.315),
    ],
)
def test_real_logs_hold_what_is_known_of_them(file, n, start, place, fastest):
    data = read_gps(REAL / file).data
    assert len(data.time) == n
    assert data.time[0] == pytest.approx(start, abs=1e-6)
    assert np.allclose(np.degrees(data.lla[0, :2]), place, atol=0.01)
    if fastest:
        assert np.nanmax(np.hypot(*data.v_n[:, :2].T)) == pytest.approx(fastest, rel=1e-3)


@real
def test_a_real_receiver_says_the_same_in_both_of_its_languages(save):
    path = REAL / "ublox" / "walk_f9p_rawx_pvt.ubx"
    ours = read_gps(path)
    theirs = read_gps(save(b"\n".join(re.findall(rb"\$G[^$]*?\*[0-9A-F]{2}", path.read_bytes()))))
    assert np.allclose(ours.data.time, theirs.data.time)
    assert np.allclose(ours.data.lla, theirs.data.lla, atol=1e-8 * 60)
    known = np.isfinite(theirs.data.v_n[:, 0])  # no course at walking pace
    assert known.sum() > 50
    moving = known & (np.hypot(*ours.data.v_n[:, :2].T) > 0.5)
    assert np.allclose(ours.data.v_n[moving, :2], theirs.data.v_n[moving, :2], atol=0.01)
    assert ours.data.lla[0, 2] == pytest.approx(1601.435 - 21.387, abs=0.01)  # hMSL, and the separation there


@real
def test_real_logs_without_positions_are_refused_in_words():
    for file, code in (("mixed_nmea_ubx_cfg.ubx", "format.nmea_no_position"), ("esf_meas_19.ubx", "format.lacks_part")):
        with refused(InputError, code):
            read_gps(REAL / "ublox" / file)


@pytest.mark.parametrize(("count", "code"), [(3, Code.READ_TIME_OF_SENSOR), (12, Code.READ_TIME_CONSTANT)])
def test_why_a_sensor_keeps_its_own_clock(count: int, code: Code) -> None:
    """Too few epochs, or samples before them that all have one time."""
    clock = _Clock(time=np.arange(float(count)), at=2 * np.arange(count) + 1)
    tags, finding = _sensor_time(np.full(2 * count, 500.0), np.arange(2 * count), clock, raw=False)
    assert (finding.code, finding["count"]) == (code, count)
    assert set(tags) == {0.5}
