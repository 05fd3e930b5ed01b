# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Programs of robot frameworks send sweeps of a lidar or stereo images, and receive poses, maps and a DEM.

Each runs against ``cdff up`` with lidar SLAM, position manager, elevation and navigation mapping, and the
gateway of its framework. The drive is simulated.
"""

from __future__ import annotations

import json
import os
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from cdff_common.codecs import decode
from cdff_common.geometry import UncertainTransform
from cdff_dev.ports import free_port
from tests.integration.conftest import ROOT, process_starter, wait_until
from tests.support import corridor
from tests.support.framework_drive import (
    AZIMUTHS_RAD,
    ELEVATIONS_RAD,
    Drive,
    check_heights,
    check_poses,
    grid_map_cells,
    make_drive,
)
from tests.support.rock_name_service import PEERS, name_service

pytestmark = [pytest.mark.integration, pytest.mark.slow]

_FOLDER = Path(__file__).parent / "frameworks"
#: Time of the start with empty caches, and of a rover's program, which ends by itself, seconds.
_START_S, _PROGRAM_S = 400.0, 200.0
_ROS_SETTINGS = """
robot: mana
frames: {base_link: mana/base, map: site}
inputs:
  - {topic: /lidar/points, type: sensor_msgs/msg/PointCloud2, stream: lidar/scan, frame: mana/lidar}
outputs:
  - {product: position_manager/pose, topic: /cdff/pose, type: geometry_msgs/msg/PoseWithCovarianceStamped}
  - {product: position_manager/pose, topic: /tf, type: tf2_msgs/msg/TFMessage}
  - {product: navigation_mapping/navigation_map, topic: /map, type: nav_msgs/msg/OccupancyGrid}
requests:
  - {name: /cdff/get_dem, type: grid_map_msgs/srv/GetGridMap}
"""
_ROCK_SETTINGS = """
robot: mana
frames: {body: mana/base, world: site}
inputs:
  - {task: rover, port: laser_scans, type: /base/samples/DepthMap, stream: lidar/scan, frame: mana/lidar}
outputs:
  - {product: position_manager/pose, task: rover, port: pose_samples, type: /base/samples/RigidBodyState,
     type_of: rover.estimated_state}
  - {product: lidar_slam/odometry, task: rover, port: dynamic_transformations,
     type: /base/samples/RigidBodyState, type_of: rover.estimated_state}
  - {product: digital_elevation_mapping/cloud, task: rover, port: map_cloud, type: /base/samples/Pointcloud,
     type_of: rover.own_cloud}
requests: {products: [dem]}
"""
_DDS_SETTINGS = """
robot: mana
domain: DOMAIN
frames: {base_link: mana/base, map: site}
inputs:
  - {topic: /lidar/points, type: sensor_msgs/msg/PointCloud2, stream: lidar/scan, frame: mana/lidar}
outputs:
  - {product: position_manager/pose, topic: /cdff/pose, type: geometry_msgs/msg/PoseWithCovarianceStamped}
  - {product: position_manager/pose, topic: /tf, type: tf2_msgs/msg/TFMessage}
  - {product: navigation_mapping/navigation_map, topic: /map, type: nav_msgs/msg/OccupancyGrid}
requests:
  - {name: /cdff/get_map, type: nav_msgs/srv/GetMap, region: "bbox:0,-2,4,2"}
  - {name: /cdff/get_dem, type: grid_map_msgs/srv/GetGridMap}
"""
_STEREO_SETTINGS = """
robot: mana
inputs:
  - topic: /navcam/left/image_rect
    right: /navcam/right/image_rect
    type: sensor_msgs/msg/Image
    stream: navcam/pair
    frame: mana/navcam_left
    camera_info: /navcam/left/camera_info
    right_camera_info: /navcam/right/camera_info
outputs:
  - product: visual_odometry_sparse/pose
    topic: /cdff/pose
    type: geometry_msgs/msg/PoseWithCovarianceStamped
  - {product: visual_odometry_sparse/pose, topic: /tf, type: tf2_msgs/msg/TFMessage}
"""


@pytest.fixture(scope="module")
def drive() -> Drive:
    return make_drive()


def run_rover(
    folder: Path,
    gateway: str,
    settings: str,
    command: list[str],
    port: int,
    variables: dict[str, str],
    profile_name: str = "profile.yaml",
) -> dict[str, Any]:
    """Return the JSON that a rover's program prints while the whole system runs.

    Parameters
    ----------
    port : int
        Port of the router of the bus.
    variables : dict of str to str
        Environment of the system; that of the program is ``PATH``, ``HOME`` and these.
    """
    (folder / "gateway.yaml").write_text(settings)
    profile = folder / "profile.yaml"
    profile.write_text((_FOLDER / profile_name).read_text().replace("GATEWAY", gateway))
    endpoint = f"tcp/127.0.0.1:{port}"
    with process_starter(endpoint, folder, **variables) as start:
        options = ("--profile", str(profile), "--connect", endpoint, "--http", f"127.0.0.1:{free_port()}")
        start("cdff_common.cli", "up", *options, "--data-dir", str(folder / "data"))
        log = folder / "cdff_common.cli.log"
        wait_until(lambda: "\nready: " in log.read_text(), _START_S, "the system is ready")
        environment = {"PATH": os.environ["PATH"], "HOME": str(folder), "ROS_DOMAIN_ID": "0", **variables}
        done = subprocess.run(
            command, capture_output=True, text=True, env=environment, timeout=_PROGRAM_S, check=False
        )
    assert done.returncode == 0, done.stderr[-3000:]
    result: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return result


def save_drive(drive: Drive, folder: Path) -> str:
    """Write the points of the sweeps for a program in another environment; return the path."""
    points, offsets_ns = drive.points_m()
    path = folder / "drive.npz"
    np.savez(path, points=points, offsets_ns=offsets_ns)
    return str(path)


def check_ros(drive: Drive, found: dict[str, Any]) -> None:
    """Compare what a rover with ROS has received with the true drive."""
    assert found["dem"], "no DEM"
    assert found["pose_frames"] == ["map"]
    error_m = check_poses(drive, found["starts_ns"], found["poses"])
    assert found["tree_frames"] == [["map", "base_link"]]
    check_poses(drive, found["starts_ns"], found["tree"])
    cells = {int(value): count for value, count in found["map"]["cells"].items()}
    assert found["map"]["frame_id"] == "map"
    assert found["map"]["size"] == [150, 150]
    assert set(cells) <= {-1, 0, 50, 100}
    assert cells.get(0, 0) + cells.get(50, 0) > 5000, f"cells of the map without a hazard: {cells}"
    assert found["dem"]["frame_id"] == "map"
    rms_m = check_heights(drive, grid_map_cells(found["dem"]))
    print(f"largest error of a pose {error_m:.3f} m, root mean square error of heights {rms_m:.3f} m")


def test_a_rover_with_ros_2_has_poses_maps_and_a_dem_of_its_lidar(drive: Drive, tmp_path: Path) -> None:
    python = ROOT / "build" / "ros2-peers" / "bin" / "python"
    if not python.exists():
        pytest.skip("zenoh-ros2-sdk is not installed; make peers installs it")
    port = free_port()
    command = [str(python), str(_FOLDER / "ros2_rover.py"), str(port), save_drive(drive, tmp_path)]
    check_ros(drive, run_rover(tmp_path, "gateway_ros2", _ROS_SETTINGS, command, port, {}))


def test_a_rover_with_ros_2_has_poses_of_its_stereo_camera(tmp_path: Path) -> None:
    python = ROOT / "build" / "ros2-peers" / "bin" / "python"
    if not python.exists():
        pytest.skip("zenoh-ros2-sdk is not installed; make peers installs it")
    truth, path, port = corridor.drive(9), tmp_path / "pairs.npz", free_port()
    pairs = [corridor.stereo_pair(T, 0) for T in truth]
    images = np.array([[pair.left.image, pair.right.image] for pair in pairs])
    np.savez(path, pairs=images, K=corridor.CAMERA, baseline_m=corridor.BASELINE_M)
    command = [str(python), str(_FOLDER / "ros2_stereo.py"), str(port), str(path)]
    found = run_rover(tmp_path, "gateway_ros2", _STEREO_SETTINGS, command, port, {}, "stereo_profile.yaml")
    assert found["pose_frames"] == ["vo"]
    positions_m = {int(stamp_ns): pose[:3] for stamp_ns, *pose in found["poses"]}
    T_first = np.linalg.inv(truth[0])
    errors_m = [
        float(np.linalg.norm(positions_m[stamp_ns] - (T_first @ T)[:3, 3]))
        for stamp_ns, T in zip(found["stamps_ns"], truth[1:], strict=True)
    ]
    assert max(errors_m) < 0.03, errors_m
    # /tf has the pose of the base, which carries the camera; both have the same stamp.
    parent, child, (stamp_ns, *base) = found["tree"][-1]
    assert (parent, child) == ("vo", "base")
    T_vo_camera, T_vo_base = (
        UncertainTransform.from_quaternion(p[:3], xyzw=p[3:]).matrix
        for p in (next(pose for ns, *pose in found["poses"] if ns == stamp_ns), base)
    )
    T_base_camera = UncertainTransform.from_xyz_rpy_deg((0.3, 0.1, 1.2), (-90.0, 0.0, -90.0)).matrix
    np.testing.assert_allclose(T_vo_base @ T_base_camera, T_vo_camera, atol=1e-6)
    print(f"largest error of a pose {max(errors_m):.4f} m")


@contextmanager
def ros_master(folder: Path) -> Iterator[dict[str, str]]:
    """Yield the variables of programs of ROS 1 while a master runs."""
    variables = {"ROS_MASTER_URI": f"http://127.0.0.1:{free_port()}", "ROS_IP": "127.0.0.1"}
    port = variables["ROS_MASTER_URI"].rpartition(":")[2]
    environment = {"PATH": "/usr/bin:/bin", "HOME": str(folder), **variables}
    command = ["/usr/bin/rosmaster", "--core", "-p", port]
    with (
        (folder / "master.log").open("wb") as log,
        subprocess.Popen(command, env=environment, stdout=log, stderr=log) as master,
    ):
        try:
            yield variables
        finally:
            master.kill()


def test_a_rover_with_ros_1_has_poses_maps_and_a_dem_of_its_lidar(drive: Drive, tmp_path: Path) -> None:
    installed = subprocess.run(
        ["/usr/bin/python3", "-c", "import rospy, nav_msgs, tf2_msgs"], check=False, capture_output=True
    )
    if installed.returncode or not Path("/usr/bin/rosmaster").exists():
        pytest.skip("Debian's ROS 1 is not installed; make peers installs it")
    program = [str(_FOLDER / "ros1_rover.py"), str(ROOT / "tests" / "integration")]
    command = ["/usr/bin/python3", *program, save_drive(drive, tmp_path)]
    with ros_master(tmp_path) as variables:
        found = run_rover(tmp_path, "gateway_ros1", _ROS_SETTINGS, command, free_port(), variables)
    check_ros(drive, found)


def test_a_rover_with_ros_2_on_dds_has_poses_maps_and_a_dem_of_its_lidar(
    drive: Drive, tmp_path: Path
) -> None:
    python, cyclone = ROOT / "build" / "dds-peers" / "bin" / "python", ROOT / "build" / "cyclonedds"
    if not python.exists() or not cyclone.is_dir():
        pytest.skip("rclpy or Cyclone DDS is not installed; make peers installs them")
    domain = str(1 + os.getpid() % 90)
    variables = {
        "PYTHONPATH": os.pathsep.join([str(ROOT), str(cyclone)]),
        "ROS_DOMAIN_ID": domain,
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "ROS_LOG_DIR": str(tmp_path),
    }
    relay = str(ROOT / "deploy" / "ros" / "request_relay.py")
    command = [str(python), str(_FOLDER / "dds_rover.py"), relay, save_drive(drive, tmp_path)]
    settings = _DDS_SETTINGS.replace("DOMAIN", domain)
    found = run_rover(tmp_path, "gateway_dds", settings, command, free_port(), variables)
    error_m = check_poses(drive, found["starts_ns"], found["poses"])
    for grid, least in ((found["map"], 5000), (found["requested"], 200)):
        cells = {int(value): count for value, count in grid["cells"].items()}
        assert grid["frame_id"] == "map"
        assert cells.get(0, 0) + cells.get(50, 0) > least, f"cells without a hazard: {cells}"
    assert found["requested"]["size"] == [20, 20]
    assert found["topics"]["/tf"] == ["tf2_msgs/msg/TFMessage"]
    assert found["tree_frames"] == [["map", "base_link"]]
    check_poses(drive, found["starts_ns"], found["tree"])
    assert found["dem"]["frame_id"] == "map"
    rms_m = check_heights(drive, grid_map_cells(found["dem"]))
    print(f"largest error of a pose {error_m:.3f} m, root mean square error of heights {rms_m:.3f} m")


def test_a_rover_with_rock_has_poses_clouds_and_a_dem_of_its_lidar(drive: Drive, tmp_path: Path) -> None:
    if not (PEERS / "omniNames").is_file():
        pytest.skip("omniORB is not installed; make peers installs it")
    ranges = tmp_path / "ranges"
    ranges.write_bytes(drive.ranges_m.tobytes())
    path = tmp_path / "drive.json"
    content = {"elevations": list(ELEVATIONS_RAD), "azimuths": list(AZIMUTHS_RAD), "ranges": str(ranges)}
    path.write_text(json.dumps(content))
    with name_service(tmp_path / "names") as names_port:
        program = [str(_FOLDER / "rock_rover.py"), str(ROOT / "tests" / "integration" / "rock")]
        command = [str(PEERS / "python"), *program, str(names_port), str(path)]
        variables = {"CDFF_ROCK_NAMES": f"127.0.0.1:{names_port}"}
        found = run_rover(tmp_path, "gateway_rock", _ROCK_SETTINGS, command, free_port(), variables)
    type_name, content_hex = found["dem"]
    assert type_name, found["refusal"]
    assert found["interface"] == [
        ["requestProduct"],
        ["/std/string", "/double", "/std/vector</uint8_t>"],
    ]
    assert found["denied"].startswith("DENIED: type='mesh'")
    assert found["pose_frames"] == [["world", "body"]]
    error_m = check_poses(drive, found["starts_ns"], found["poses"])
    assert found["tree_frames"] == [["lidar_odom", "lidar"]]
    cloud_rms_m = check_heights(drive, np.array(found["points"]), sigma_m=0.06)
    dem = decode(type_name, bytes.fromhex(content_hex), "uper")
    rms_m = check_heights(drive, cells_of(dem))
    print(
        f"largest error of a pose {error_m:.3f} m, root mean square error of heights {rms_m:.3f} m, "
        f"of the cloud {cloud_rms_m:.3f} m"
    )


def cells_of(dem: Any) -> NDArray[np.float64]:
    """Return the centres of the cells (n, 3) with their heights."""
    heights, grid = dem.layer("mean"), dem.geometry
    rows, columns = np.indices(heights.shape)
    x = grid.xmin_m + (columns.ravel() + 0.5) * grid.resolution_m
    y = grid.ymax_m - (rows.ravel() + 0.5) * grid.resolution_m
    return np.column_stack([x, y, heights.ravel()])
