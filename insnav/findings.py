"""What insnav detects, as data: a code and numbers, never a sentence.

`insnav.messages` turns a finding into words. Nothing else in the package may depend on those words.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from enum import IntEnum, StrEnum
from typing import Any, Self, TypeAlias

# A number or numbers in SI units and radians, a count, or a name that stands in no language: of a column, option, unit.
Value: TypeAlias = float | int | str | tuple[float, ...] | tuple[str, ...]


class Severity(IntEnum):
    """How much a finding matters, in rising order."""

    NOTE = 0  # detected, and dealt with
    ASSUMPTION = 1  # taken for granted: neither the user nor the data said so
    WARNING = 2  # makes the result worse than it states, or may
    UNUSABLE = 3  # the result must not be used


class Code(StrEnum):
    """Everything that insnav can detect: one member each, with its usual severity.

    The part before the first dot says where it is detected. ``insnav/messages/en.toml`` has the words of each member.
    """

    severity: Severity

    def __new__(cls, code: str, severity: Severity = Severity.NOTE) -> Self:
        """Make a member of its name in files and its usual severity."""
        member = str.__new__(cls, code)
        member._value_ = code
        member.severity = severity
        return member

    # samples
    IMU_SPIKE = "imu.spike"
    IMU_SATURATED = "imu.saturated", Severity.WARNING
    IMU_STUCK = "imu.stuck", Severity.WARNING

    # fixes and filter
    GPS_FROZEN = "gps.frozen", Severity.WARNING
    GPS_OUTSIDE = "gps.outside"
    GATE_QUALITY = "gate.quality"
    GATE_PHYSICAL_POSITION = "gate.physical.position"
    GATE_PHYSICAL_VELOCITY = "gate.physical.velocity"
    GATE_POSITION = "gate.position"
    GATE_VELOCITY = "gate.velocity"
    GATE_RECORD_POSITION = "gate.record.position"
    GATE_RECORD_VELOCITY = "gate.record.velocity"
    DEWEIGHTED_POSITION = "deweighted.position"
    DEWEIGHTED_VELOCITY = "deweighted.velocity"
    PART = "filter.part"
    RESET = "filter.reset", Severity.WARNING
    REPAIR = "filter.repair"
    DIVERGED = "filter.diverged", Severity.WARNING

    # alignment, fixes and aiding, as the filter is prepared and runs
    IMU_LIMITED = "imu.limited", Severity.WARNING
    IMU_FROZEN = "imu.frozen", Severity.WARNING
    IMU_JITTER = "imu.jitter"
    IMU_CLOCK_RATE = "imu.clock_rate"
    ALIGN_LEVEL_STATIC = "align.level.static"
    ALIGN_LEVEL_FILTER = "align.level.filter"
    ALIGN_LEVEL_MOTION = "align.level.motion"
    ALIGN_LEVEL_MOTION_FILTER = "align.level.motion_filter"
    ALIGN_LEVEL_GIVEN = "align.level.given"
    ALIGN_HEADING_GYROCOMPASS = "align.heading.gyrocompass"
    ALIGN_HEADING_GYROCOMPASS_FILTER = "align.heading.gyrocompass_filter"
    ALIGN_HEADING_COURSE = "align.heading.course"
    ALIGN_HEADING_COURSE_FILTER = "align.heading.course_filter"
    ALIGN_HEADING_REVERSING = "align.heading.reversing"
    ALIGN_HEADING_ACCELERATION = "align.heading.acceleration"
    ALIGN_HEADING_GIVEN = "align.heading.given"
    ALIGN_HEADING_GIVEN_FILTER = "align.heading.given_filter"
    ALIGN_HEADING_UNKNOWN = "align.heading.unknown"
    ALIGN_LATE = "align.late"
    ATTITUDE_AXES = "attitude.axes"
    PARTS = "filter.parts"
    PART_BEFORE = "filter.part.before_start"
    PART_SHORT = "filter.part.short"
    PART_UNALIGNED = "filter.part.unaligned"
    GPS_SD_SCATTER = "gps.position_sd.scatter", Severity.ASSUMPTION
    GPS_SD_FIX_TYPE = "gps.position_sd.fix_type", Severity.ASSUMPTION
    GPS_SD_STAND_ALONE = "gps.position_sd.stand_alone", Severity.ASSUMPTION
    GPS_VELOCITY_SD = "gps.velocity_sd.scatter", Severity.ASSUMPTION
    GPS_ROUNDED_POSITION = "gps.rounded.position", Severity.ASSUMPTION
    GPS_ROUNDED_VELOCITY = "gps.rounded.velocity", Severity.ASSUMPTION
    GPS_FLOAT = "gps.float"
    GPS_VELOCITY_HALF = "gps.velocity.half", Severity.ASSUMPTION
    GPS_VELOCITY_LEVEL = "gps.velocity.level"
    GPS_VELOCITY_LAG = "gps.velocity.lag"
    GPS_DELAY_MOVED = "gps.delay.moved"
    GPS_CORRELATED_REPORTED = "gps.correlated.reported"
    GPS_CORRELATED_VELOCITY = "gps.correlated.velocity"
    GPS_DETECTABLE = "gps.detectable"
    GATE_AIDING = "gate.aiding"
    NHC_USED = "nhc.used"
    NHC_SLOW = "nhc.slow"
    NHC_LATERAL = "nhc.lateral"
    NHC_TURNED = "nhc.turned"
    BAROMETER_USED = "barometer.used"
    BAROMETER_POOR = "barometer.poor"
    MAGNETOMETER_USED = "magnetometer.used"
    MAGNETOMETER_FEW = "magnetometer.few"
    MAGNETOMETER_POOR = "magnetometer.poor"
    ODOMETER_USED = "odometer.used"
    ODOMETER_FEW = "odometer.few"
    ODOMETER_POOR = "odometer.poor"
    ODOMETER_SCALE = "odometer.scale"
    SPEEDOMETER_AXES = "speedometer.axes"
    SPEEDOMETER_CLOCK = "speedometer.clock"
    SPEEDOMETER_UNKNOWN = "speedometer.unknown"
    SPEEDOMETER_OUTLIERS = "speedometer.outliers"
    ZUPT_USED = "zupt.used"
    ZUPT_PARTLY = "zupt.partly"
    ZUPT_CONTRADICTED = "zupt.contradicted"
    ZUPT_SHORT = "zupt.short"
    ZUPT_UNSEEN = "zupt.unseen"
    ZUPT_POOR = "zupt.poor"
    ZUPT_NONE = "zupt.none"

    # faults that the filter finds: changes, gyros, clock, lever arm, noise
    # receivers that repeat or extrapolate, or become late
    GPS_FROZEN_VELOCITY = "gps.frozen_velocity", Severity.WARNING
    GPS_EXTRAPOLATED = "gps.extrapolated", Severity.WARNING
    CHANGE_DELAY = "change.delay", Severity.WARNING
    # sensors that change; ambiguous: false fixes explain the record as well
    CHANGE_GYRO_FAULT = "change.gyro_fault", Severity.WARNING
    CHANGE_TURNED = "change.turned", Severity.WARNING
    CHANGE_TURNED_AMBIGUOUS = "change.turned_ambiguous", Severity.WARNING
    CHANGE_ATTITUDE_LOST = "change.attitude_lost", Severity.WARNING
    CHANGE_ATTITUDE_LOST_AMBIGUOUS = "change.attitude_lost_ambiguous", Severity.WARNING
    CHANGE_GYRO_BIAS = "change.gyro_bias", Severity.WARNING
    CHANGE_GYRO_BIAS_AMBIGUOUS = "change.gyro_bias_ambiguous", Severity.WARNING
    CHANGE_ACCEL_BIAS = "change.accel_bias", Severity.WARNING
    CHANGE_ACCEL_BIAS_AMBIGUOUS = "change.accel_bias_ambiguous", Severity.WARNING
    RECORD_VELOCITY_MISSED = "record.velocity_missed", Severity.WARNING
    RECORD_VELOCITY_MISSED_AMBIGUOUS = "record.velocity_missed_ambiguous", Severity.WARNING
    # fixes that change and do not come back
    RECORD_JUMP = "record.jump", Severity.WARNING
    RECORD_DRIFT = "record.drift", Severity.WARNING
    RECORD_VELOCITY_STEP = "record.velocity_step", Severity.WARNING
    # false fixes, by the whole record
    RECORD_FALSE_POSITIONS = "record.false_positions", Severity.WARNING
    RECORD_FALSE_VELOCITIES = "record.false_velocities", Severity.WARNING
    RECORD_AMBIGUOUS_BEGIN = "record.ambiguous_begin", Severity.WARNING
    RECORD_AMBIGUOUS_END = "record.ambiguous_end", Severity.WARNING
    RECORD_RESETS_ACCEPTED = "record.resets_accepted", Severity.WARNING
    RECORD_RESETS_ENDURED = "record.resets_endured", Severity.WARNING
    RECORD_MOTION = "record.motion", Severity.WARNING
    RECORD_DISAGREEMENT = "record.disagreement", Severity.WARNING
    RECORD_WITHOUT_VELOCITIES = "record.without_velocities", Severity.WARNING
    RECORD_WHOLE_FIXES = "record.whole_fixes", Severity.WARNING
    RECORD_WORSE = "record.worse", Severity.WARNING
    # what the user gave and the drive contradicts
    GIVEN_HEADING_REJECTED = "given.heading_rejected", Severity.WARNING
    GIVEN_HEADING_KEPT = "given.heading_kept", Severity.WARNING
    GIVEN_LEVER_ARM_REJECTED = "given.lever_arm_rejected", Severity.WARNING
    GIVEN_LEVER_ARM_KEPT = "given.lever_arm_kept", Severity.WARNING
    GIVEN_DELAY = "given.delay", Severity.WARNING
    GIVEN_NOISE = "given.noise", Severity.WARNING
    # noise of IMU and fixes, by the innovations
    NOISE_GYROS = "noise.gyros", Severity.WARNING
    NOISE_HIDES_LEVER_ARM = "noise.hides_lever_arm", Severity.WARNING
    NOISE_SD_UNDERSTATED = "noise.sd_understated", Severity.WARNING
    NOISE_SD_IMPLAUSIBLE = "noise.sd_implausible", Severity.WARNING
    NOISE_HEIGHTS_IN_FEET = "noise.heights_in_feet", Severity.WARNING
    # what the filter estimates besides
    ESTIMATE_LEVER_ARM_CHECKED = "estimate.lever_arm_checked"
    ESTIMATE_NOISE = "estimate.noise"
    ESTIMATE_NOISE_PRESET = "estimate.noise_preset"
    ESTIMATE_POSITION_SD = "estimate.position_sd"
    ESTIMATE_VELOCITY_SD = "estimate.velocity_sd"
    ESTIMATE_CORRELATED = "estimate.correlated"
    ESTIMATE_CORRELATED_PLAUSIBLE = "estimate.correlated_plausible"
    ESTIMATE_CORRELATED_USUAL = "estimate.correlated_usual", Severity.ASSUMPTION
    ESTIMATE_CORRELATED_VELOCITY = "estimate.correlated_velocity"
    ESTIMATE_MISALIGNMENT = "estimate.misalignment"

    # clock, mounting and defaults of a drive, before it is navigated
    CLOCK_EPOCHS = "clock.epochs", Severity.ASSUMPTION
    MOUNTING_ASSUMED = "mounting.assumed", Severity.ASSUMPTION
    MOUNTING_DOUBTED = "mounting.doubted", Severity.WARNING
    MOUNTING_CONTRADICTS_GIVEN = "mounting.contradicts_given", Severity.WARNING
    MOUNTING_ALONG_AXES = "mounting.along_axes", Severity.ASSUMPTION
    MOUNTING_UPSIDE_DOWN = "mounting.upside_down", Severity.ASSUMPTION
    MOUNTING_ALONG_AXES_BY_COURSE = "mounting.along_axes.course", Severity.ASSUMPTION
    MOUNTING_ALONG_AXES_BY_FIXES = "mounting.along_axes.fixes", Severity.ASSUMPTION
    MOUNTING_YAW = "mounting.yaw", Severity.ASSUMPTION
    MOUNTING_TILTED = "mounting.tilted", Severity.ASSUMPTION
    MOUNTING_YAW_BY_COURSE = "mounting.yaw.course", Severity.ASSUMPTION
    MOUNTING_YAW_BY_FIXES = "mounting.yaw.fixes", Severity.ASSUMPTION
    MOUNTING_TRAVEL_VARIES = "mounting.travel_varies", Severity.ASSUMPTION
    GPS_FROM_REFERENCE = "gps.from_reference"
    GPS_SCALE = "gps.scale", Severity.WARNING
    MODEL_GIVEN = "imu_model.given"
    MODEL_OF_FILE = "imu_model.file"
    MODEL_OF_PART = "imu_model.part"
    MODEL_ASSUMED = "imu_model.assumed", Severity.ASSUMPTION
    MODEL_FROM_REST = "imu_model.from_rest", Severity.ASSUMPTION
    MODEL_ESTIMATED = "imu_model.estimated"
    MODEL_SIMULATED = "imu_model.simulated"
    MODEL_KEPT = "imu_model.kept"
    ALIGN_SHORT_REST = "align.short_rest"
    OUTAGE_NO_WINDOW = "outage.no_window"
    TUNE_DRIVES_DIFFER = "tune.drives_differ", Severity.WARNING

    # reference
    REF_OTHER = "ref.other_drive", Severity.WARNING
    REF_IS_GPS = "ref.same_as_gps", Severity.WARNING
    REF_NOT_FIXED = "ref.not_fixed"
    REF_AT_ANTENNA = "ref.at_antenna", Severity.ASSUMPTION
    REF_RADIANS = "ref.radians", Severity.WARNING
    REF_EXCHANGED = "ref.exchanged", Severity.WARNING
    REF_FEET = "ref.feet", Severity.WARNING
    REF_VELOCITY_NAMES = "ref.velocity.names", Severity.WARNING
    REF_VELOCITY_UNIT = "ref.velocity.unit", Severity.WARNING
    REF_VELOCITY_UP = "ref.velocity.up", Severity.WARNING
    REF_VELOCITY_OF_GPS = "ref.velocity.of_gps", Severity.WARNING
    REF_VELOCITY_LAG = "ref.velocity.lag", Severity.WARNING
    REF_CLOCK = "ref.clock", Severity.WARNING
    REF_CLOCK_OF_IMU = "ref.clock.of_imu", Severity.WARNING
    REF_HEADING_MISREAD = "ref.heading.misread", Severity.WARNING
    REF_HEADING_AXES = "ref.heading.axes", Severity.WARNING
    REF_HEADING_OFFSET = "ref.heading.offset", Severity.WARNING
    REF_HEADING_BEGIN = "ref.heading.begin", Severity.WARNING
    REF_TILT_MISREAD = "ref.tilt.misread", Severity.WARNING
    REF_POINT = "ref.point", Severity.WARNING
    REF_GEOID = "ref.geoid", Severity.WARNING
    REF_HEIGHT = "ref.height", Severity.WARNING

    # solution, judged when a run is finished; outage test, comparison
    RUN_REJECTED = "run.rejected", Severity.UNUSABLE
    RUN_CONTRADICTED = "run.contradicted", Severity.UNUSABLE
    RUN_LOST = "run.lost", Severity.UNUSABLE
    RUN_UNKNOWN = "run.unknown", Severity.UNUSABLE
    RUN_HEADING_LOST = "run.heading_lost", Severity.WARNING
    RUN_SCALE = "run.scale", Severity.WARNING
    RUN_SCALE_OF_ALL = "run.scale.of_all", Severity.WARNING
    RUN_RESET = "run.reset", Severity.WARNING
    RUN_LATE_FIXES = "run.late_fixes", Severity.WARNING
    RUN_MANY_REJECTED = "run.many_rejected", Severity.WARNING
    RUN_ROW_REJECTED = "run.row_rejected", Severity.WARNING
    RUN_OVERCONFIDENT = "run.overconfident", Severity.WARNING
    RUN_OVERCONFIDENT_GPS = "run.overconfident.gps", Severity.WARNING
    RUN_OVERCONFIDENT_OFFSET = "run.overconfident.offset", Severity.WARNING
    RUN_DIVERGED = "run.diverged", Severity.WARNING
    RUN_TURNED_AT_REST = "run.turned.at_rest", Severity.WARNING
    RUN_TURNED_IN_PLACE = "run.turned.in_place", Severity.WARNING
    RUN_LATE_START = "run.late_start", Severity.WARNING
    RUN_SATURATED = "run.saturated", Severity.WARNING
    RUN_STUCK = "run.stuck", Severity.WARNING
    RUN_LIMITED = "run.limited", Severity.WARNING
    RUN_GAPS = "run.gaps", Severity.WARNING
    RUN_NO_HEIGHTS = "run.no_heights", Severity.WARNING
    RUN_CONSTANT_HEIGHT = "run.constant_height", Severity.WARNING
    RUN_LEVER_ZERO = "run.lever_zero", Severity.ASSUMPTION
    RUN_SLOW_ERRORS = "run.slow_errors", Severity.ASSUMPTION
    OUTAGE_COMMON = "outage.common", Severity.WARNING

    # how files were read: formats, columns, times
    READ_ROWS_DAMAGED = "read.rows.damaged"
    READ_ROWS_UNREADABLE = "read.rows.unreadable"
    READ_ROWS_NO_FIX = "read.rows.no_fix"
    READ_ROWS_NO_TIME = "read.rows.no_time"
    READ_BYTES_DAMAGED = "read.bytes_damaged"
    READ_LOGGER_GAPS = "read.logger_gaps"
    READ_TIME_GPS_WEEK = "read.time.gps_week"
    READ_TIME_UTC_ASSUMED = "read.time.utc_assumed"
    READ_TIME_UNKNOWN_WEEK = "read.time.unknown_week"
    READ_TIME_OF_DAY = "read.time.of_day"
    READ_TIME_UNIX = "read.time.unix"
    READ_TIME_LOCAL = "read.time.local"
    READ_TIME_SINCE_START = "read.time.since_start"
    READ_TIME_OF_RECORDER = "read.time.of_recorder"
    READ_TIME_OF_SENSOR = "read.time.of_sensor"
    READ_TIME_BY_MESSAGES = "read.time.by_messages"
    READ_TIME_BY_RATE = "read.time.by_rate"
    READ_SOURCE = "read.source"
    READ_CONVENTION = "read.convention"
    READ_COLUMNS_BY_VALUES = "read.columns.by_values"
    READ_COLUMN_EMPTY = "read.columns.empty"
    READ_COLUMN_CONSTANT = "read.columns.constant"
    READ_COLUMN_FIX_ZERO = "read.columns.fix_zero"
    READ_ZEROS_UNKNOWN = "read.columns.zero_in_motion", Severity.ASSUMPTION
    READ_FILES_BY_NAME = "read.files_by_name", Severity.ASSUMPTION
    READ_FUSED = "read.fused"
    READ_REFERENCE_LOCAL = "read.reference_local"
    READ_ODOMETRY_SHORT = "read.odometry.short"
    READ_ODOMETRY_APART = "read.odometry.apart"
    READ_ODOMETRY_PLACED = "read.odometry.placed"
    READ_IMU_MODEL = "read.imu.model"
    READ_IMU_MODEL_BY_GRAVITY = "read.imu.model_by_gravity"
    READ_IMU_CORRECTED = "read.imu.corrected"
    READ_ACCEL_INTERPOLATED = "read.imu.interpolated"
    READ_GRAVITY_ADDED = "read.imu.gravity_added"
    READ_AXES_Z_DOWN = "read.imu.z_down"
    READ_RAW_SCALED = "read.imu.raw_scaled"
    READ_RAW_COUNTS = "read.imu.raw_counts"
    READ_SAMPLING = "read.imu.sampling"
    READ_SAMPLING_ASSUMED = "read.imu.sampling_assumed", Severity.ASSUMPTION
    READ_TEMPERATURE_INTERPOLATED = "read.imu.temperature"
    READ_FORCE_UNIT_ASSUMED = "read.force.unit_assumed", Severity.ASSUMPTION
    READ_FORCE_UNIT_BY_GRAVITY = "read.force.unit_by_gravity"
    READ_FORCE_NO_VERTICAL = "read.force.no_vertical"
    READ_SD_UNKNOWN = "read.sd.unknown"
    READ_SD_RAISED = "read.sd.raised"
    READ_SD_APPROXIMATE = "read.sd.approximate"
    READ_HEIGHT_MISSING = "read.height.missing"
    READ_HEIGHT_INTERPOLATED = "read.height.interpolated"
    READ_HEIGHT_BY_GEOID = "read.height.by_geoid"
    READ_HEIGHT_MSL = "read.height.msl"
    READ_HEIGHT_ELLIPSOIDAL = "read.height.ellipsoidal"
    READ_HEIGHT_ELLIPSOIDAL_ASSUMED = "read.height.ellipsoidal_assumed", Severity.ASSUMPTION
    READ_ANGLES_LARGE = "read.angles.large"
    READ_ANGLES_BY_VELOCITY = "read.angles.by_velocity"
    READ_ATTITUDE_UNIT_ASSUMED = "read.angles.attitude_assumed", Severity.ASSUMPTION
    READ_YAW_AS_HEADING = "read.angles.yaw"
    READ_VELOCITY_UNIT = "read.velocity.unit"
    READ_VELOCITY_TOPIC = "read.velocity.topic"
    READ_VELOCITY_LATENCY = "read.velocity.latency"
    READ_VELOCITY_UNTIMED = "read.velocity.untimed"

    # how data were understood: units, axes, signs, heights, rates
    # rows of a file; the subject is the input: imu, gps, ref or the name of a log
    ROWS_DUPLICATE = "rows.duplicate"
    ROWS_SAME_TIME = "rows.same_time"
    ROWS_REPEATED = "rows.repeated", Severity.ASSUMPTION
    ROWS_UNSORTED = "rows.unsorted"
    ROWS_NAN = "rows.nan"
    ROWS_NO_POSITION = "rows.no_position"
    ROWS_NO_TIME = "rows.no_time"
    ROWS_STRAY = "rows.stray"
    ROWS_GAP = "rows.gap"
    ROWS_SHORT_GAPS = "rows.short_gaps"
    ROWS_CUT = "rows.cut", Severity.WARNING
    # files that lack a part of the time of the other
    IMU_BEGINS_LATE = "files.imu_begins_late", Severity.WARNING
    IMU_ENDS_EARLY = "files.imu_ends_early", Severity.WARNING
    GPS_BEGINS_LATE = "files.gps_begins_late", Severity.WARNING
    GPS_ENDS_EARLY = "files.gps_ends_early", Severity.WARNING
    # columns
    COLUMN_TWICE = "columns.twice"
    COLUMNS_QUATERNION = "columns.quaternion", Severity.ASSUMPTION
    COLUMNS_UNUSED = "columns.unused"
    # times
    TIME_UNIT = "time.unit"
    TIME_OF_CLOCK = "time.of_clock", Severity.ASSUMPTION
    TIME_IN_TWO_COLUMNS = "time.two_columns"
    TIME_FROM_PARTS = "time.from_parts"
    TIME_FROM_TICKS = "time.from_ticks"
    TIME_RESTARTS = "time.restarts"
    # units and axes
    UNIT_STATED = "units.stated"
    ACCEL_UNIT = "units.accel"
    ACCEL_UNIT_UNCALIBRATED = "units.accel_uncalibrated"
    GYRO_UNIT = "units.gyro"
    GYRO_UNIT_BY_RATE = "units.gyro_by_rate"
    GYRO_UNIT_ASSUMED = "units.gyro_assumed", Severity.ASSUMPTION
    GYRO_WRONG_WAY = "units.gyro_wrong_way", Severity.WARNING
    AXES_GIVEN = "axes.given"
    AXES_BY_FORMAT = "axes.by_format"
    AXES_ASSUMED = "axes.assumed"  # a note: forward is assumed, and the drive may still show it
    # positions, velocities and their standard deviations
    PLACE_EARTH_FIXED = "positions.earth_fixed"
    POSITIONS_INTEGER = "positions.integer"
    HEIGHTS_INTEGER = "positions.integer_heights"
    POSITIONS_DEGREES_MINUTES = "positions.degrees_minutes"
    POSITIONS_SIGN = "positions.sign"
    VELOCITY_FROM_COURSE = "velocity.from_course"
    VELOCITY_FROM_HEIGHTS = "velocity.from_heights"
    VELOCITY_SD_COLUMN = "velocity.sd_column"
    SD_FROM_VARIANCES = "sd.from_variances"
    SD_FROM_RADIUS = "sd.from_radius"
    SD_VERTICAL_COLUMN = "sd.vertical_column"
    SD_VERTICAL_TWICE = "sd.vertical_twice"
    # what insnav check finds: notes need no action
    CHECK_REFUSED = "check.refused", Severity.UNUSABLE
    CHECK_OPTION_NEEDED = "check.option_needed", Severity.WARNING
    CHECK_STUCK = "check.stuck", Severity.WARNING
    CHECK_CLIPPED = "check.clipped", Severity.WARNING
    CHECK_SPIKES = "check.spikes", Severity.WARNING
    CHECK_IMU_GAPS = "check.imu_gaps", Severity.WARNING
    CHECK_UNSORTED = "check.unsorted", Severity.WARNING
    CHECK_SAME_TIME = "check.same_time", Severity.WARNING
    CHECK_LOW_RATE = "check.low_rate", Severity.WARNING
    CHECK_JITTER = "check.jitter", Severity.WARNING
    CHECK_COARSE = "check.coarse", Severity.WARNING
    CHECK_FORCE_STEP = "check.force_step", Severity.WARNING
    CHECK_JOLT = "check.jolt", Severity.WARNING
    CHECK_NO_REST = "check.no_rest", Severity.WARNING
    CHECK_NO_VELOCITIES = "check.no_velocities", Severity.WARNING
    CHECK_NO_SD = "check.no_sd", Severity.WARNING
    CHECK_SMALL_SD = "check.small_sd", Severity.WARNING
    CHECK_FALSE_VELOCITIES = "check.false_velocities"
    CHECK_JUMPS = "check.jumps"
    CHECK_GPS_GAPS = "check.gps_gaps"
    CHECK_VELOCITY_LAG = "check.velocity_lag"
    CHECK_SAME_DATA = "check.same_data", Severity.WARNING
    CHECK_AXES = "check.axes", Severity.WARNING
    CHECK_DELAY = "check.delay", Severity.WARNING
    CHECK_LEVER_ARM = "check.lever_arm", Severity.WARNING
    CHECK_NO_LEVER_ARM = "check.no_lever_arm", Severity.WARNING

    # bench and laboratory
    BENCH_CONDITION = "bench.condition", Severity.WARNING
    BENCH_SPIKES = "bench.spikes", Severity.WARNING
    BENCH_TEMPERATURE = "bench.temperature", Severity.WARNING
    BENCH_FEW = "bench.few", Severity.WARNING
    BENCH_OUTLIER = "bench.outlier", Severity.WARNING
    BENCH_CLIPPED = "bench.clipped", Severity.WARNING
    BENCH_DRIFT = "bench.drift", Severity.WARNING
    BENCH_ONE_SENSOR = "bench.one_sensor", Severity.WARNING
    BENCH_ONE_SENSE = "bench.one_sense", Severity.WARNING
    BENCH_ONE_SIDED = "bench.one_sided", Severity.WARNING
    BENCH_LEFT_OUT = "bench.left_out", Severity.WARNING
    BENCH_RATE_EXCLUDED = "bench.rate.excluded"
    BENCH_RATE_SATURATED = "bench.rate.saturated"
    BENCH_RATE_NONLINEAR = "bench.rate.nonlinear"
    BENCH_RATE_BEYOND = "bench.rate.beyond"
    BENCH_RATE_BENDING = "bench.rate.bending"
    BENCH_RATE_FLAT = "bench.rate.flat"
    BENCH_NO_MAP = "bench.no_map", Severity.WARNING
    BENCH_ZERO_SHIFT = "bench.zero_shift", Severity.WARNING
    BENCH_INTERCEPT = "bench.intercept", Severity.WARNING
    BENCH_SINGLE_POSE = "bench.single_pose", Severity.WARNING
    BENCH_UNUSED_TURNS = "bench.unused_turns", Severity.WARNING
    BENCH_OVERFIT = "bench.overfit", Severity.WARNING
    BENCH_G_SENSITIVITY = "bench.g_sensitivity", Severity.WARNING
    ROTOR_FALL_ORIGIN = "rotor.fall_origin", Severity.WARNING
    ROTOR_PRECESSION_ORIGIN = "rotor.precession_origin", Severity.WARNING
    ROTOR_POWERS = "rotor.powers", Severity.WARNING
    ROTOR_DISAGREE = "rotor.disagree", Severity.WARNING
    ACCEPTANCE_GIVEN_BIASES = "acceptance.given_biases", Severity.WARNING
    ACCEPTANCE_ONE_PART = "acceptance.one_part", Severity.WARNING
    ACCEPTANCE_TREND = "acceptance.trend", Severity.WARNING
    ACCEPTANCE_SHORT = "acceptance.short"
    ACCEPTANCE_NO_SCALE = "acceptance.no_scale", Severity.ASSUMPTION
    ALLAN_FILLED = "allan.filled", Severity.WARNING
    ALLAN_LONGEST_STRETCH = "allan.longest_stretch", Severity.WARNING
    ALLAN_JITTER = "allan.jitter", Severity.WARNING
    ALLAN_DAMAGED = "allan.damaged", Severity.WARNING
    ALLAN_COARSE = "allan.coarse", Severity.WARNING
    ALLAN_TEMPERATURE = "allan.temperature", Severity.WARNING
    ALLAN_SHORT = "allan.short", Severity.WARNING
    ALLAN_SILENT = "allan.silent", Severity.WARNING
    ALLAN_MISFIT = "allan.misfit", Severity.WARNING
    ALLAN_SINUSOID = "allan.sinusoid", Severity.WARNING
    ALLAN_RAMP = "allan.ramp", Severity.WARNING
    ALLAN_BIAS_PROCESS = "allan.bias.process"
    ALLAN_BIAS_FLOOR = "allan.bias.floor"
    ALLAN_BIAS_NONE = "allan.bias.none"
    ALLAN_BIAS_BOUND = "allan.bias.bound"
    ALLAN_ONE_TIME = "allan.one_time"
    ALLAN_UNSEEN = "allan.unseen"
    DRIFT_TIMES = "drift.times"
    DRIFT_NO_COLUMN = "drift.no_column", Severity.WARNING
    DRIFT_CONSTANT = "drift.constant", Severity.WARNING
    DRIFT_CONFOUNDED = "drift.confounded", Severity.WARNING
    DRIFT_NO_WALK = "drift.no_walk", Severity.WARNING

    # budget, requirement, platform, simulation, batch, tuning
    BUDGET_OWN_FIXES = "budget.own_fixes", Severity.ASSUMPTION
    BUDGET_IN_RUN_BIAS = "budget.in_run_bias"
    BUDGET_CORRELATED_FIXES = "budget.correlated_fixes"
    BUDGET_ABSENT = "budget.absent", Severity.WARNING
    BUDGET_IGNORED = "budget.ignored", Severity.WARNING
    BUDGET_SMOOTHED_START = "budget.smoothed_start", Severity.WARNING
    BUDGET_NO_STATIONARY_WINDOW = "budget.no_stationary_window"
    BUDGET_ALL_TURNING = "budget.all_turning"
    BUDGET_NONLINEAR = "budget.nonlinear", Severity.WARNING
    BUDGET_SIMULATED_MISMATCH = "budget.simulated_mismatch", Severity.WARNING
    BUDGET_UNEXPLAINED = "budget.unexplained", Severity.WARNING
    BUDGET_OUTSIDE_REPLICAS = "budget.outside_replicas", Severity.WARNING
    BUDGET_METHODS = "budget.methods", Severity.ASSUMPTION
    BUDGET_INDEPENDENT_SOURCES = "budget.independent_sources", Severity.ASSUMPTION
    BUDGET_SHORT_FORMS = "budget.short_forms", Severity.ASSUMPTION
    BUDGET_VERTICAL_HELD = "budget.vertical_held", Severity.ASSUMPTION
    BUDGET_VERTICAL_FREE = "budget.vertical_free", Severity.ASSUMPTION
    BUDGET_TURN_ON_BIASES = "budget.turn_on_biases", Severity.ASSUMPTION
    BUDGET_WINDOW_BIASES = "budget.window_biases", Severity.ASSUMPTION
    BUDGET_FLICKER = "budget.flicker", Severity.ASSUMPTION
    BUDGET_NORMAL_GRAVITY = "budget.normal_gravity", Severity.ASSUMPTION
    BUDGET_SIMULATED_BOUNDS = "budget.simulated_bounds", Severity.ASSUMPTION
    WINDOWS_START = "windows.start", Severity.ASSUMPTION
    WINDOWS_REFERENCE = "windows.reference", Severity.ASSUMPTION
    WINDOWS_PREDICTED = "windows.predicted", Severity.ASSUMPTION
    WINDOWS_ALONG_CROSS = "windows.along_cross", Severity.ASSUMPTION
    WINDOWS_LEVEL = "windows.level", Severity.ASSUMPTION
    END_LEVEL = "end_of_run.level", Severity.ASSUMPTION
    END_REFERENCE_SD = "end_of_run.reference_sd", Severity.ASSUMPTION
    END_TILT_OR_BIAS = "end_of_run.tilt_or_bias", Severity.ASSUMPTION
    FIELD_FACTOR = "requirement.field_factor", Severity.ASSUMPTION
    REQUIREMENT_INFEASIBLE = "requirement.infeasible", Severity.WARNING
    REQUIREMENT_COVARIANCE = "requirement.covariance", Severity.ASSUMPTION
    REQUIREMENT_IN_RUN_BIAS = "requirement.in_run_bias", Severity.ASSUMPTION
    REQUIREMENT_SHARES = "requirement.shares", Severity.ASSUMPTION
    REQUIREMENT_CAPPED = "requirement.capped", Severity.ASSUMPTION
    REQUIREMENT_PARTS = "requirement.parts", Severity.ASSUMPTION
    REQUIREMENT_AIDING = "requirement.aiding", Severity.ASSUMPTION
    REQUIREMENT_CALIBRATION = "requirement.calibration", Severity.ASSUMPTION
    PLATFORM_INTEGRATORS = "platform.integrators", Severity.ASSUMPTION
    PLATFORM_STEPS = "platform.steps", Severity.ASSUMPTION
    PLATFORM_VERTICAL_OFF = "platform.vertical_off", Severity.ASSUMPTION
    PLATFORM_VERTICAL_FREE = "platform.vertical_free", Severity.ASSUMPTION
    PLATFORM_VERTICAL_DAMPED = "platform.vertical_damped", Severity.ASSUMPTION
    PLATFORM_LEVEL_SAMPLES = "platform.level_samples", Severity.ASSUMPTION
    PLATFORM_DEMO_ERRORS = "platform.demo_errors", Severity.ASSUMPTION
    PLATFORM_DEMO_FOURTH = "platform.demo_fourth", Severity.ASSUMPTION
    PLATFORM_FIRST_ORDER = "platform.first_order", Severity.ASSUMPTION
    SIMULATION_ABSENT = "simulation.absent", Severity.ASSUMPTION
    SIMULATION_CORRELATED_FIXES = "simulation.correlated_fixes"
    SIMULATION_RUN_FAILED = "simulation.run_failed", Severity.WARNING
    SIMULATION_MORE_FAILED = "simulation.more_failed", Severity.WARNING
    SIMULATION_RUNS = "simulation.runs", Severity.ASSUMPTION
    REPLICA_FAR = "replica.far", Severity.WARNING
    REPLICA_WILD = "replica.wild", Severity.WARNING
    REPLICA_GAP = "replica.gap", Severity.WARNING
    CERTIFICATE_FAILED = "certificate.failed", Severity.WARNING
    CERTIFICATE_SAMPLES = "certificate.samples", Severity.ASSUMPTION
    CERTIFICATE_INTEGRATORS = "certificate.integrators", Severity.ASSUMPTION
    CERTIFICATE_CONING = "certificate.coning", Severity.ASSUMPTION
    CERTIFICATE_PLATFORM = "certificate.platform", Severity.ASSUMPTION
    CERTIFICATE_PYINS = "certificate.pyins", Severity.ASSUMPTION
    IMUS_STATISTICS = "imus.statistics", Severity.ASSUMPTION
    IMUS_BIASES = "imus.biases", Severity.ASSUMPTION
    IMUS_DOCUMENTS = "imus.documents", Severity.ASSUMPTION
    IMUS_MISSING = "imus.missing"
    ALIGN_LATITUDE = "align.latitude", Severity.WARNING
    BATCH_UNREADABLE = "batch.unreadable"
    BATCH_NO_RECORDING = "batch.no_recording"
    BATCH_NO_COLUMNS = "batch.no_columns"
    BATCH_SPARE_SAMPLES = "batch.spare_samples"
    BATCH_SPARE_FIXES = "batch.spare_fixes"
    BATCH_SPARE_REFERENCE = "batch.spare_reference"
    BATCH_OTHER_NAMES = "batch.other_names"
    BATCH_MOVED_ASIDE = "batch.moved_aside"
    REGRESSION_FAILS = "regression.fails", Severity.WARNING
    REGRESSION_MORE_FAIL = "regression.more_fail", Severity.WARNING
    REGRESSION_BROKEN = "regression.broken", Severity.WARNING
    REGRESSION_OTHER_CASE = "regression.other_case", Severity.WARNING
    REGRESSION_NEW_CASE = "regression.new_case", Severity.WARNING
    REGRESSION_NO_DATA = "regression.no_data", Severity.WARNING
    REGRESSION_NOT_QUICK = "regression.not_quick", Severity.WARNING
    REGRESSION_OVERCONFIDENT = "regression.overconfident"
    REGRESSION_PAIRED = "regression.paired", Severity.ASSUMPTION
    REGRESSION_HOLM = "regression.holm", Severity.ASSUMPTION
    REGRESSION_LIMITS = "regression.limits", Severity.ASSUMPTION
    REGRESSION_CPU = "regression.cpu", Severity.ASSUMPTION
    REGRESSION_NEES = "regression.nees", Severity.ASSUMPTION

    # kept folders of earlier versions
    STORED_TEXT = "stored.text"


def of_families(*families: str) -> frozenset[Code]:
    """Collect the codes of some families: the part before the first dot."""
    return frozenset(code for code in Code if code.partition(".")[0] in families)


# Changes of the IMU, and of the delay: an IMU in other axes looks like one.
OF_THE_IMU = of_families("change")
# What the user or the receiver gave is wrong.
GIVEN_CONTRADICTED = of_families("given", "noise")
# Fixes and IMU disagree, whichever is wrong.
CONTRADICTIONS = of_families("change", "given", "noise", "record")
# Fixes that a receiver or logger repeats or makes up.
NOT_MEASURED = frozenset({Code.GPS_FROZEN, Code.GPS_FROZEN_VELOCITY, Code.GPS_EXTRAPOLATED})
# Time-correlated errors of positions, from whatever source.
CORRELATED_POSITIONS = frozenset(
    {
        Code.GPS_CORRELATED_REPORTED,
        Code.GPS_CORRELATED_VELOCITY,
        Code.ESTIMATE_CORRELATED,
        Code.ESTIMATE_CORRELATED_PLAUSIBLE,
        Code.ESTIMATE_CORRELATED_USUAL,
    }
)
# Fixes came without a standard deviation of their position.
ASSUMED_POSITION_SD = frozenset({Code.GPS_SD_SCATTER, Code.GPS_SD_FIX_TYPE, Code.GPS_SD_STAND_ALONE})
# What insnav corrected in clocks and velocities; the short form of a run names these.
CORRECTIONS = frozenset({Code.GPS_VELOCITY_LAG, Code.IMU_CLOCK_RATE})
# How an IMU error specification was chosen.
MODEL_CHOICES = of_families("imu_model") - {Code.MODEL_KEPT}
# Single rows and fixes: ``events.csv`` lists them, and pages have what follows from them.
SINGLE = of_families("deweighted", "gate", "rows") | {Code.IMU_SPIKE, Code.GPS_OUTSIDE, Code.REPAIR}
# One warning of a run sums up all of a code.
SUMMED = frozenset(
    {
        Code.RESET,
        Code.DIVERGED,
        Code.IMU_SATURATED,
        Code.IMU_LIMITED,
        Code.IMU_STUCK,
        Code.IMU_FROZEN,
        Code.ROWS_GAP,
    }
)


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that insnav detected.

    Attributes
    ----------
    code : Code
        What it is.
    severity : Severity
        How much it matters; by default as usual for its code.
    begin, end : float
        When it begins and ends, in the time of the data [s]; ``NaN`` if it has no time. A moment has the same twice.
    values : tuple of (str, Value)
        Named numbers, most important first: SI units and radians, the unit at the end of the name (``delay_s``). A
        number that decided has its limit beside it, named ``limit`` with the same unit (``limit_s``).
    subject : str
        What it is about, by a name that stands in no language: ``imu``, ``gps``, ``gyro x``, a column, a file.
    """

    code: Code
    severity: Severity = Severity.NOTE
    begin: float = math.nan
    end: float = math.nan
    values: tuple[tuple[str, Value], ...] = ()
    subject: str = ""

    def __post_init__(self) -> None:
        for name in ("begin", "end"):
            if math.isnan(getattr(self, name)):  # one object, so that findings without a time compare equal
                object.__setattr__(self, name, math.nan)

    @classmethod
    def of(
        cls,
        code: Code,
        begin: float = math.nan,
        end: float | None = None,
        *,
        subject: str = "",
        severity: Severity | None = None,
        **values: Value,
    ) -> Self:
        """Make a finding: one moment if `end` is not given, the usual severity of its code unless that is given."""
        return cls(
            code,
            code.severity if severity is None else severity,
            float(begin),
            float(begin if end is None else end),
            tuple((name, _plain(value)) for name, value in values.items()),
            subject,
        )

    def as_dict(self) -> dict[str, Any]:
        """Give the finding in a form ready for JSON; a number that is not finite is None."""
        values = {name: _json_ready(value) for name, value in self.values}
        times = {"from_s": self.begin, "to_s": self.end} if self.timed else {}
        return {
            "code": self.code.value,
            "severity": self.severity.name.lower(),
            **({"subject": self.subject} if self.subject else {}),
            **{name: round(time, 6) for name, time in times.items()},
            **({"values": values} if values else {}),
        }

    @classmethod
    def from_dict(cls, facts: Mapping[str, Any]) -> Self:
        """Take a finding back from JSON; a code that this version does not know becomes a stored text."""
        code, severity = str(facts["code"]), str(facts.get("severity", "warning")).upper()
        known = code in set(Code)
        values = {str(name): math.nan if value is None else value for name, value in facts.get("values", {}).items()}
        begin, end = (math.nan if facts.get(name) is None else float(facts[name]) for name in ("from_s", "to_s"))
        return cls.of(
            Code(code) if known else Code.STORED_TEXT,
            begin,
            begin if math.isnan(end) else end,
            subject=str(facts.get("subject") or ""),
            severity=Severity[severity] if severity in Severity.__members__ else Severity.WARNING,
            **(values if known else {"text": code} | values),
        )

    def __getitem__(self, name: str) -> Any:
        """Give one of its values by its name."""
        for key, value in self.values:
            if key == name:
                return value
        raise KeyError(f"{self.code} has no {name}")

    def get(self, name: str, otherwise: Any = None) -> Any:
        """Give one of its values, or `otherwise` if it has none of this name."""
        return next((value for key, value in self.values if key == name), otherwise)

    @property
    def value(self) -> float:
        """The number that decided: the first of its values; ``NaN`` if there is none."""
        return next((float(value) for name, value in self._numbers() if not name.startswith("limit")), math.nan)

    @property
    def limit(self) -> float:
        """What that number was compared with; ``NaN`` if there is none."""
        return next((float(value) for name, value in self._numbers() if name.startswith("limit")), math.nan)

    def _numbers(self) -> Iterator[tuple[str, float]]:
        return ((name, value) for name, value in self.values if isinstance(value, int | float))

    def later(self, offset: float) -> Finding:
        """Give the same finding on a clock that is ahead by `offset` [s]."""
        return replace(self, begin=self.begin + offset, end=self.end + offset) if self.timed else self

    @property
    def timed(self) -> bool:
        """Whether it happened at a time of the data."""
        return not math.isnan(self.begin)


def of_code(findings: Iterable[Finding], *codes: Code) -> Iterator[Finding]:
    """Choose the findings that have one of some codes."""
    return (each for each in findings if each.code in codes)


def is_shown(finding: Finding) -> bool:
    """Whether a page shows a finding; ``events.csv`` has the others, one a row."""
    # version 0.2 wrote a text beside each event
    single = finding.code in SINGLE or finding.get("text") is not None
    return finding.code not in SUMMED and not (finding.timed and single and finding.severity is Severity.NOTE)


def by_time(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Sort findings by time; those without any come first, in their order."""
    return tuple(sorted(findings, key=lambda each: each.begin if each.timed else -math.inf))


def _json_ready(value: Any) -> Any:
    if isinstance(value, tuple):
        return [_json_ready(each) for each in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _plain(value: Any) -> Value:
    """Turn numbers and arrays of numpy into those of Python, which can be hashed."""
    if isinstance(value, str | bool):
        return value
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, list | tuple):
        return tuple(value)
    if isinstance(value, float) and math.isnan(value):
        return math.nan
    return value  # type: ignore[no-any-return]
