"""Logs of controllers and receivers: written by their specifications, read back, and read by other libraries."""

from __future__ import annotations

import numpy as np
import pytest

import insnav
from insnav.exceptions import ConfigError, InputError
from insnav.findings import Code, of_code
from insnav.input import read_gps, read_imu, read_reference
from insnav.input.formats.registry import open_tables
from insnav.session.read import read_samples
from tests.input import written_logs as logs
from tests.input.files import G, noted
from tests.input.recordings import FIXES, REAL, SAMPLES, TOW, UNIX, Motion, real, same_places
from tests.refusals import refused

# log, start of its clock, what must be close to the truth: accelerations, velocities, deviations of positions
LOGS = {
    "ULog": (logs.ulog(), logs.BOOT, 1e-6, (0.3 / 2**0.5, 0.3 / 2**0.5, 0.5)),
    "dataflash": (logs.dataflash(), logs.BOOT, 1e-5, (0.3 / 2**0.5, 0.3 / 2**0.5, 0.5)),
    "dataflash text": (logs.dataflash_text(), logs.BOOT, 1e-9, (0.3 / 2**0.5, 0.3 / 2**0.5, 0.5)),
    "NovAtel": (logs.novatel(), TOW, 2e-5, (0.1, 0.2, 0.3)),
    "NovAtel RAWIMUS": (logs.novatel(typed=False), TOW, 2e-5, (0.1, 0.2, 0.3)),
    "NovAtel text": (logs.novatel_ascii(motion=SAMPLES), TOW, 2e-5, (0.1, 0.2, 0.3)),
    "SBF": (logs.sbf(), TOW, 1e-9, (0.1, 0.2, 0.3)),
    "SBF Cartesian": (logs.sbf(cartesian=True), TOW, 1e-9, (0.2, 0.2, 0.2)),
}


@pytest.mark.parametrize("name", LOGS)
def test_a_log_gives_what_was_written(save, name):
    data, start, accuracy, sd = LOGS[name]
    path = save(data)
    imu, gps = read_imu(path).data, read_gps(path).data
    per_second = 0.01 if imu.sampling == "increment" else 1.0
    assert np.allclose(imu.time, start + SAMPLES.t, atol=2e-6)
    assert np.allclose(imu.accel / per_second, SAMPLES.accel, atol=accuracy if per_second == 1.0 else 5e-5)
    assert np.allclose(imu.gyro / per_second, SAMPLES.gyro, atol=accuracy if per_second == 1.0 else 5e-5)
    assert np.allclose(gps.time, start + FIXES.t, atol=1e-6)
    assert same_places(gps, metres=0.03)
    assert np.allclose(gps.v_n, FIXES.v_n, atol=1e-5)
    assert np.allclose(gps.position_sd, sd, rtol=1e-5)
    assert set(gps.fix) == {1}


@pytest.mark.parametrize("name", LOGS)
def test_a_log_needs_no_option(save, name):
    drive = insnav.load(save(LOGS[name][0]))
    assert drive.gps is not None
    assert drive.imu.data.accel[:, 2].mean() < 0.0


def test_heights(save):
    assert read_gps(save(logs.ulog())).facts.height == "ellipsoidal"
    assert read_gps(save(logs.dataflash())).facts.height == "msl"


def test_the_attitude_of_a_receiver_is_a_reference(save):
    reference = read_reference(save(logs.novatel())).data
    assert np.allclose(
        np.degrees(reference.rph), np.column_stack([0.5 + 0 * FIXES.t, -1.0 + 0 * FIXES.t, FIXES.heading])
    )
    assert same_places(reference, metres=1e-4)


def test_samples_of_an_unknown_imu_are_refused(save):
    with refused(InputError, "format.novatel_scale") as caught:
        open_tables(save(logs.novatel(imu_type=200)))
    assert caught.value.values["types"] == (200,)


def test_an_imu_that_gravity_does_not_tell_is_refused(save):
    class Heavy(Motion):
        accel = 3.0 * SAMPLES.accel

    data = logs.novatel(Heavy(SAMPLES.t), typed=False)
    with refused(InputError, "format.novatel_scale") as caught:
        open_tables(save(data))
    assert caught.value.values["types"] == ()
    assert "RAWIMUS" in caught.value.values["message"]


class Rocking(Motion):
    """A vehicle that rolls: gravity rotates in its axes as the gyros say. With the noise of an IMU."""

    noise = 2e-4 * np.random.default_rng(5).normal(size=(len(SAMPLES.t), 3))
    roll = property(lambda self: 0.3 * np.sin(0.8 * self.t))
    gyro = property(lambda self: self.noise + np.outer(0.24 * np.cos(0.8 * self.t), [1.0, 0.0, 0.0]))
    accel = property(lambda self: -G * np.column_stack([0.0 * self.t, np.sin(self.roll), np.cos(self.roll)]))


def test_the_rotation_of_gravity_shows_the_scale_of_the_gyros(save):
    """IMU-CPT and iIMU-FSAS have the same scale of velocities, and of angles in rad and in deg."""
    motion = Rocking(SAMPLES.t)
    read = read_imu(save(logs.novatel(motion, typed=False, scales=logs.IMU_CPT))).data
    assert np.allclose(read.gyro / 0.01, motion.gyro, atol=2e-5)


def test_a_record_at_rest_of_an_unknown_imu_is_asked_for(save):
    class Still(Rocking):
        gyro = Rocking.noise
        accel = np.tile([0.0, 0.0, -G], (len(SAMPLES.t), 1))

    path = save(logs.novatel(Still(SAMPLES.t), typed=False, scales=logs.IMU_CPT))
    with refused(ConfigError, "format.several_scales") as caught:
        insnav.allan(path)
    assert caught.value.values["topics"] == ("iIMU-FSAS", "IMU-CPT")
    noise = caught.value.values["noise_rad_sqrt_s"]
    assert noise == pytest.approx((2e-5 * np.pi / 180.0, 2e-5), rel=0.1)  # of 2e-4 rad/s at 100 Hz
    read = read_samples(path, {"topic": "IMU-CPT"}, "noise").data
    assert np.allclose(read.gyro / 0.01, Rocking.noise, atol=2e-5)


def test_novatel_text(save):
    data = read_gps(save(logs.novatel_ascii())).data
    assert same_places(data, metres=1e-3)
    assert np.allclose(data.v_n, FIXES.v_n, atol=1e-5)
    assert np.allclose(data.position_sd, [0.1, 0.2, 0.3])


@pytest.mark.parametrize(
    ("kind", "fix"), [("IONOFREE_FLOAT", 2.0), ("INS_PPP_BASIC_CONVERGING", 4.0), ("INS_PPP_BASIC", 4.0)]
)
def test_novatel_positions_of_every_type_are_fixes(save, kind, fix):
    """OEM7 Commands and Logs Reference Manual, position or velocity type: 33, 79 and 80."""
    read = read_gps(save(logs.novatel_ascii(kind=kind)))
    assert (read.data.fix == fix).all()
    assert any(each.code is Code.READ_FUSED for each in read.facts.evidence) is kind.startswith("INS")


def test_pymavlink_reads_the_same_dataflash(save):
    reader = pytest.importorskip("pymavlink.DFReader")
    log = reader.DFReader_binary(str(save(logs.dataflash())))
    places = []
    while (message := log.recv_match(type="GPS")) is not None:
        places.append((message.Lat, message.Lng, message.Alt))
    log.data_map.close()
    log.filehandle.close()
    data = read_gps(save(logs.dataflash())).data
    assert np.allclose(np.degrees(data.lla[:, :2]), np.array(places)[:, :2], atol=1e-12)


def test_pysbf2_reads_the_same_blocks(save):
    pysbf2 = pytest.importorskip("pysbf2")
    with save(logs.sbf()).open("rb") as stream:
        messages = [message for _, message in pysbf2.SBFReader(stream) if message.identity == "PVTGeodetic"]
    data = read_gps(save(logs.sbf())).data
    assert np.allclose(data.lla[:, 0], [each.Latitude for each in messages], atol=1e-15)
    assert np.allclose(data.v_n[:, 1], [each.Ve for each in messages])


def test_pyulog_reads_the_same_messages(save):
    pyulog = pytest.importorskip("pyulog")
    log = pyulog.ULog(str(save(logs.ulog())))
    theirs = {each.name: each.data for each in log.data_list}
    assert np.allclose(read_imu(save(logs.ulog())).data.gyro[:, 2], theirs["sensor_combined"]["gyro_rad[2]"])
    ours = np.degrees(read_gps(save(logs.ulog())).data.lla[:, 1])
    assert np.allclose(ours, 1e-7 * theirs["vehicle_gps_position"]["lon"], atol=1e-9)


@pytest.mark.parametrize("zone", ["Z", "+02:00"])
def test_gpx(save, zone):
    reading = read_gps(save(logs.gpx(zone=zone)))
    assert np.allclose(reading.data.time, TOW + FIXES.t, atol=1e-6)
    assert same_places(reading.data, metres=1e-3)
    assert reading.facts.height == "msl"
    (untimed,) = noted(reading, Code.READ_ROWS_NO_TIME)
    assert (untimed["count"], untimed["rows"]) == (1, 41)


def test_gnss_logger(save):
    path = save(logs.gnss_logger())
    imu, gps = read_imu(path), read_gps(path)
    assert imu.facts.axes == "RFU"
    assert np.allclose(imu.data.accel, [0.0, 2.5, -G], atol=1e-9)
    assert np.allclose(gps.data.time, UNIX + FIXES.t, atol=1e-6)
    assert same_places(gps.data, metres=1e-3)
    side = 3.0 / np.sqrt(-2.0 * np.log(0.32))
    assert np.allclose(gps.data.position_sd, [side, side, 6.0])


@real
@pytest.mark.parametrize(
    ("file", "n_imu", "n_gps", "place"),
    [
        ("px4/v6c_6s.ulg", 1297, 13, (36.369, 127.368)),
        ("px4/cubeorange_6s_static.ulg", 1298, 32, (63.417, 10.408)),
        ("ardupilot/plane_3_8_short_LGPL.BIN", 45, 5, (-35.363, 149.165)),
        ("septentrio/x5_pvtcartesian_58.sbf", 0, 58, None),
        ("novatel/propak6_insppp_inspvax_corrimudata.gps", 0, 2288, (43.404, -80.470)),
        ("novatel/swri_bestpos_bestvel.gps", 0, 33, (29.444, -98.615)),
        ("gpx/car_etrex20x.gpx", 0, 104, (45.27, 13.71)),
        ("phone/gnsslogger_v1_4.txt", 0, 216, (37.4225, -122.0817)),
    ],
)
def test_real_logs(file, n_imu, n_gps, place):
    gps = read_gps(REAL / file)
    assert gps.facts.n_used == n_gps
    if place:
        assert np.allclose(np.degrees(gps.data.lla[0, :2]), place, atol=5e-3)
    if n_imu:
        assert read_imu(REAL / file).facts.n_used == n_imu
    else:
        with refused(InputError, "format.fixes_for_samples"):
            read_imu(REAL / file)


@real
def test_real_heights_and_what_cannot_be_used():
    gps = read_gps(REAL / "novatel" / "oem7_bestpos.gps").data
    vax = read_reference(REAL / "novatel" / "oem7_bestpos.gps").data
    assert vax.lla[0, 2] == pytest.approx(gps.lla[0, 2], abs=0.2)  # both are written above the sea
    vas = read_reference(REAL / "novatel" / "oem7_ins2.gps").data
    assert vas.lla[0, 2] == pytest.approx(1080.76, abs=0.1)  # INSPVAS: above the ellipsoid
    for file in ("septentrio/x5_measepoch.sbf", "septentrio/x5_status.sbf"):
        with refused(InputError, "format.sbf_no_data"):
            open_tables(REAL / file)
    unsampled = REAL / "novatel" / "propak6_insppp_inspvax_corrimudata.gps"
    with refused(InputError, "format.fixes_for_samples") as caught:
        insnav.load(unsampled)
    assert caught.value.values["unusable"] == ("CORRIMUDATA",)
    (corrected,) = of_code(open_tables(unsampled)["gps"].notes, Code.READ_IMU_CORRECTED)
    assert corrected["messages"] == ("CORRIMUDATA",)
