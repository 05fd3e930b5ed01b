# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Mistakes in a profile: each is refused with its line, key, value, expectation and the nearest name."""

from __future__ import annotations

from pathlib import Path

import pytest

from cdff_common.errors import ConfigurationError, FaultsError
from cdff_common.interfaces.profile import load_profile
from cdff_common.interfaces.profile_checks.check import check_profile
from cdff_common.resources import shipped_names
from tests.support.small_profile import line_of, with_mistake, written

_IMU_EDGE = "      - {parent: pico/base, child: pico/imu, translation_m: [0.0, 0.0, 0.1]}\n"
_IMU_SENSOR = "        kind: imu\n        frame: pico/imu\n        streams: {sample: IMUSensors}\n"
_MAST_EDGE = "      - {parent: pico/base, child: pico/mast, translation_m: [0.2, 0.0, 0.6]}\n"

#: Correct text, mistaken text, part of the line of the fault, end of its key, part of its text.
MISTAKES = {
    "IMU wired to wheel odometry": (
        "odometry: sensor/wheels/odometry\n          imu",
        "odometry: sensor/imu/sample\n          imu",
        "odometry: sensor/imu",
        "position_manager.inputs.odometry",
        "has the type IMUSensors, port odometry takes TransformWithCovariance",
    ),
    "required input without a source": (
        "        inputs:\n          odometry: sensor/wheels/odometry\n",
        "        required_inputs: [odometrie]\n        inputs:\n          odometry: sensor/wheels/odometry\n",
        "required_inputs",
        "position_manager.required_inputs[0]",
        "no such input of position_manager with a source",
    ),
    "cloud wired to odometry": (
        "product/lidar_slam/odometry",
        "product/lidar_slam/cloud",
        "product/lidar_slam/cloud",
        "position_manager.inputs.lidar_odometry",
        "has the type Pointcloud, port lidar_odometry takes TransformWithCovariance",
    ),
    "edge is missing": (
        _MAST_EDGE,
        "",
        "child: pico/lidar",
        "frames[1].parent",
        "'pico/mast': this frame has no",
    ),
    "two parents": (
        _IMU_EDGE,
        _IMU_EDGE + "      - {parent: pico/mast, child: pico/imu}\n",
        "parent: pico/mast, child: pico/imu",
        "frames[6].child",
        "two parents, pico/base and pico/mast",
    ),
    "edge twice": (
        _IMU_EDGE,
        _IMU_EDGE + _IMU_EDGE.replace("0.1", "0.3"),
        "0.3]",
        "frames[6].child",
        "this edge twice (frames[5])",
    ),
    "loop": (
        "{parent: pico/base, child: pico/mast,",
        "{parent: pico/right, child: pico/mast,",
        "child: pico/right",
        "frames[4]",
        "closes a loop of pico/mast, pico/left, pico/right",
    ),
    "frame without edge": (
        "frame: pico/imu\n",
        "frame: pico/im\n",
        "frame: pico/im",
        "imu.frame",
        "'pico/imu'?",
    ),
    "camera below a misspelt frame": (
        "{parent: pico/mast, child: pico/left",
        "{parent: pico/mst, child: pico/left",
        "pico/mst",
        "frames[3].parent",
        "pico/left below it cannot be placed on the robot; expected an edge with this child, up to pico/base"
        "; did you mean 'pico/mast'?",
    ),
    "sensor in a frame of another robot": (
        "frame: pico/imu\n",
        "frame: mana/imu\n",
        "frame: mana",
        "sensors.imu.frame",
        "is a frame of mana, expected one of pico; did you mean 'pico/imu'?",
    ),
    "edge below a frame of another robot": (
        "{parent: pico/base, child: pico/imu",
        "{parent: mana/base, child: pico/imu",
        "mana/base",
        "frames[5].parent",
        "is a frame of mana, expected one of pico; did you mean 'pico/base'?",
    ),
    "sensor fixed to the site": (
        "{parent: pico/base, child: pico/imu",
        "{parent: site, child: pico/imu",
        "frame: pico/imu",
        "sensors.imu.frame",
        "is not below pico/base (site ← pico/imu)",
    ),
    "quaternion without length": (
        "[-0.5, 0.5, -0.5, 0.5]",
        "[0, 0, 0, 0]",
        "[0, 0, 0, 0]",
        "frames[3].quaternion_xyzw",
        "norm 0, expected a unit quaternion",
    ),
    "required port is absent": (
        "{scan: sensor/lidar/scan, odometry",
        "{odometry",
        "inputs: {odometry: sensor/wheels/odometry}",
        "lidar_slam.inputs.scan",
        "missing, lidar_slam requires this input (LidarScan)",
    ),
    "unknown port": (
        "lidar_odometry: product",
        "lidar_odom: product",
        "lidar_odom:",
        "inputs.lidar_odom",
        "did you mean 'lidar_odometry'?",
    ),
    "unknown stream": (
        "sensor/camera/pair",
        "sensor/camera/pairs",
        "camera/pairs",
        "inputs.stereo",
        "did you mean 'sensor/camera/pair'?",
    ),
    "unknown DFPC in a source": (
        "product/position_manager/pose",
        "product/position_manger/pose",
        "manger",
        "inputs.poses",
        "did you mean 'product/position_manager/pose'?",
    ),
    "unknown output port": (
        "product/position_manager/pose",
        "product/position_manager/poses",
        "/poses",
        "inputs.poses",
        "no output port of position_manager 'poses'; expected one of pose, trajectory",
    ),
    "malformed source": (
        "sensor/camera/pair",
        "camera/pair",
        "stereo: camera/pair",
        "inputs.stereo",
        "expected sensor/SENSOR/STREAM",
    ),
    "body misspelt": ("{name: moon}", "{name: mooon}", "mooon", "body.name", "did you mean 'moon'?"),
    "wrong implementation": (
        "implementation: Lidar",
        "implementation: Lidr",
        "Lidr",
        ".implementation",
        "expected one of Lidar, LidarGlobal, Stereo; did you mean 'Lidar'?",
    ),
    "unknown parameter": (
        "          resolution_m",
        "          resolution",
        "resolution",
        "parameters.resolution",
        "unknown parameter; expected one of resolution_m",
    ),
    "parameter out of bounds": (
        "resolution_m: 0.2",
        "resolution_m: -0.2",
        "-0.2",
        "parameters.resolution_m",
        "= -0.2: expected greater than 0",
    ),
    "unknown parameter of a DFN": (
        "voxel_m: 0.4",
        "voxel: 0.4",
        "voxel",
        "parameters.thinning.voxel",
        "did you mean 'voxel_m'?",
    ),
    "duplicate sensor": (
        "    dfpcs:\n",
        "      imu: # again\n" + _IMU_SENSOR + "    dfpcs:\n",
        "# again",
        "sensors.imu",
        "repeats the key of line 26, expected it once",
    ),
    "unknown key of a robot": ("    limits:", "    limit:", "limit:", "pico.limit", "did you mean 'limits'?"),
    "key of another level": (
        "kind: imu",
        "kind: imu\n        rate: 100",
        "rate: 100",
        "sensors.imu.rate",
        "rate_hz is a key of SensorMode",
    ),
    "unknown kind": ("kind: imu", "kind: imuu", "imuu", "imu.kind", "'imuu': expected one of stereo_camera"),
    "unknown type of a stream": (
        "IMUSensors",
        "ImuSensors",
        "ImuSensors",
        "imu.streams.sample",
        "did you mean 'IMUSensors'?",
    ),
    "unknown DFPC": (
        "name: lidar_slam",
        "name: lidar_slm",
        "lidar_slm",
        "dfpcs.lidar_slm.name",
        "did you mean 'lidar_slam'?",
    ),
    "unknown limit": (
        "max_slope_deg",
        "max_slope",
        "max_slope:",
        "limits.max_slope",
        "did you mean 'max_slope_deg'?",
    ),
    "limit of 0": ("width_m: 0.8", "width_m: 0", "width_m", "limits.width_m", "= 0.0: expected more than 0"),
    "text for a number": (
        "width_m: 0.8",
        "width_m: wide",
        "wide",
        "limits.width_m",
        "'wide': expected a valid",
    ),
    "mode that does not stream": (
        "{camera: nominal}",
        '{camera: "off"}',
        '{camera: "off"}',
        "modes.camera",
        "camera does not stream in this mode; expected one of nominal",
    ),
    "rate that no mode has": (
        "{camera: nominal}",
        "{camera: {min_rate_hz: 9}}",
        "min_rate_hz",
        "modes.camera",
        "no mode of camera meets this; it has off (on False), nominal (on True, rate_hz 4.0)",
    ),
    "unknown key of a mode": (
        "{camera: nominal}",
        "{camera: {min_rate: 9}}",
        "min_rate",
        "modes.camera.min_rate",
        "did you mean 'min_rate_hz'?",
    ),
    "unknown stream of the history": (
        "stream: scan, every_n",
        "stream: scans, every_n",
        "scans",
        "history[0].stream",
        "did you mean 'scan'?",
    ),
    "unknown product of a retention rule": (
        "product: trajectory",
        "product: trajectry",
        "trajectry",
        "retention[0].product",
        "did you mean 'trajectory'?",
    ),
    "missing kind": (
        "        kind: imu\n",
        "",
        "      imu:",
        "sensors.imu.kind",
        "missing, expected a value",
    ),
    "URDF that does not exist": (
        "    limits:",
        "    urdf: no.urdf\n    limits:",
        "no.urdf",
        "pico.urdf",
        "cannot be",
    ),
}


def test_a_profile_without_mistakes_has_no_faults(tmp_path: Path) -> None:
    assert check_profile(written(tmp_path)).faults == ()


@pytest.mark.parametrize("name", shipped_names("profiles"))
def test_the_shipped_profiles_have_neither_faults_nor_warnings(name: str) -> None:
    assert check_profile(name).faults == ()


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_the_only_fault_and_is_named_with_line_and_key(tmp_path: Path, mistake: str) -> None:
    correct, mistaken, part_of_line, key, message = MISTAKES[mistake]
    text = with_mistake(correct, mistaken)
    path = written(tmp_path, text)
    with pytest.raises(FaultsError) as refusal:
        load_profile(path, complete=True)
    (fault,) = refusal.value.faults
    assert fault.key.endswith(key)
    assert message in str(fault)
    assert str(refusal.value).startswith(f"{path}:{fault.line}: ")
    assert fault.line == line_of(text, part_of_line)


#: Correct text, implausible text, part of the warning.
IMPLAUSIBLE = {
    "lidar mount in mm": (
        "child: pico/lidar, translation_m: [0.0, 0.0, 0.2]",
        "child: pico/lidar, translation_m: [0.0, 0.0, 200]",
        "pico/lidar is 200 m from pico/mast, expected at most 3 m; the unit is metres",
    ),
    "baseline of 1.2 mm": (
        "[0.12, 0.0, 0.0]",
        "[0.0012, 0.0, 0.0]",
        "baseline of 0.0012 m, expected 0.01 to 2 m",
    ),
    "tilt of 75 degrees": (
        "rpy_deg: [0, 12, 0]",
        "rpy_deg: [0, 75, 0]",
        "sensor lidar: its z axis is 75° from",
    ),
    "lidar upside down": ("rpy_deg: [0, 12, 0]", "quaternion_xyzw: [1, 0, 0, 0]", "its z axis is 180° from"),
    "camera with the axes of the base": (
        ", quaternion_xyzw: [-0.5, 0.5, -0.5, 0.5]",
        "",
        "sensor camera: its optical axis z is 90° above the horizon",
    ),
    "camera upside down": (
        "[-0.5, 0.5, -0.5, 0.5]",
        "[0.5, 0.5, 0.5, 0.5]",
        "sensor camera: its y axis points up",
    ),
}


@pytest.mark.parametrize("value", IMPLAUSIBLE)
def test_an_implausible_value_is_a_warning_with_which_the_profile_runs(
    tmp_path: Path, value: str, caplog: pytest.LogCaptureFixture
) -> None:
    correct, implausible, message = IMPLAUSIBLE[value]
    path = written(tmp_path, with_mistake(correct, implausible))
    (warning,) = check_profile(path).faults
    assert warning.severity == "warning"
    assert message in str(warning)
    assert load_profile(path, complete=True).name == "small"
    assert str(warning) in caplog.text


def test_an_unused_sensor_without_a_place_is_a_warning(tmp_path: Path) -> None:
    text = with_mistake(
        "    dfpcs:\n",
        "      spare:\n        kind: imu\n        frame: pico/spare\n        streams: {}\n    dfpcs:\n",
    )
    (warning,) = check_profile(written(tmp_path, text)).faults
    assert (warning.severity, warning.key) == ("warning", "robots.pico.sensors.spare.frame")


def test_all_mistakes_are_reported_at_once(tmp_path: Path) -> None:
    text = with_mistake("kind: imu", "kind: imuu")
    for correct, mistaken in (
        ("{name: moon}", "{name: mooon}"),
        ("max_slope_deg", "max_slope"),
        ("width_m: 0.8", "width_m: wide"),
        ("{parent: pico/mast, child: pico/left", "{parent: pico/mst, child: pico/left"),
        ("voxel_m: 0.4", "voxel: 0.4"),
        ("sensor/camera/pair", "sensor/camera/pairs"),
        ("product: trajectory", "product: trajectry"),
    ):
        text = text.replace(correct, mistaken)
    faults = check_profile(written(tmp_path, text)).errors
    assert [fault.key.rsplit(".", maxsplit=1)[-1] for fault in faults] == [
        "name",
        "max_slope",
        "width_m",
        "parent",
        "kind",
        "stereo",
        "voxel",
        "product",
    ]
    assert [fault.line for fault in faults] == sorted(fault.line for fault in faults)


def test_text_that_is_no_yaml_is_refused_with_its_line(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r"small.yaml:7: is no YAML"):
        load_profile(written(tmp_path, with_mistake("limits:", "limits:\t{")))


def test_a_robot_may_start_in_the_frame_of_a_site_or_of_a_body_that_is_no_robot(tmp_path: Path) -> None:
    start = "{parent: bremen/hall, child: pico/odom}"
    path = written(tmp_path, with_mistake("{parent: site, child: pico/odom}", start))
    assert check_profile(path).faults == ()


@pytest.mark.parametrize(("dfpc", "is_reported"), [("imu", False), ("dpm", False), ("lidar_slamm", True)])
def test_a_retention_rule_may_name_a_sensor_or_the_dpm_and_another_name_is_a_warning(
    tmp_path: Path, dfpc: str, is_reported: bool
) -> None:
    rule = f"retention:\n  - {{product: '*', dfpc: {dfpc}, max_age_s: 10}}\n"
    checked = check_profile(written(tmp_path, with_mistake("retention:\n", rule)))
    assert checked.errors == ()
    assert [fault.key for fault in checked.warnings] == (["retention[0].dfpc"] if is_reported else [])
