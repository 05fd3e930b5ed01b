# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Replays of the three cloud registration DFPCs on measured clouds give the recorded poses."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from cdff_common.cli import main
from cdff_common.geometry import se3
from cdff_common.types import Pointcloud
from cdff_dev.compare.registration.rates import pose_errors
from cdff_dev.logs import LogWriter, open_log
from evaluation.data_sets.clouds import kitti_pair, milk_carton, small_gicp_pair

pytestmark = [pytest.mark.golden, pytest.mark.slow]

#: DFPC: ports of source and target, port of the pose, reader of the clouds, recorded x y z qx qy qz qw.
GOLDEN = {
    "icp_localisation": (
        ("model", "scene"),
        "pose",
        kitti_pair,
        (0.470381, -0.019793, 0.007647, 0.000661, 0.000551, -0.010843, 0.999941),
    ),
    "point_cloud_matching": (
        ("source", "target"),
        "transform",
        small_gicp_pair,
        (0.492668, 0.106328, -0.026071, 0.002709, 0.000180, -0.005343, 0.999982),
    ),
    "shot_localisation": (
        ("model", "scene"),
        "pose",
        milk_carton,
        (-0.159261, 0.212425, -0.042161, -0.006546, 0.109367, 0.059550, 0.992194),
    ),
}
#: Library versions may change a pose by a fraction of the noise of the clouds.
TOLERANCE_M, TOLERANCE_DEG = 0.002, 0.05


@pytest.mark.parametrize("dfpc", GOLDEN)
def test_two_replays_give_the_recorded_pose_and_equal_bytes(
    dfpc: str, real_data: Callable[[str], Path], tmp_path: Path
) -> None:
    ports, output_port, read_clouds, recorded = GOLDEN[dfpc]
    source, target, _ = read_clouds(real_data("kitti_velodyne").parent)
    log = tmp_path / "clouds.msg"
    with LogWriter(log) as writer:
        for i, (port, points) in enumerate(zip(ports, (source, target), strict=True), 1):
            stamp_ns = 1_000_000 * i
            writer.write(
                f"/mana/{port}.cloud", Pointcloud.from_points(points, frame=port, stamp_ns=stamp_ns), stamp_ns
            )
    wiring = [argument for port in ports for argument in ("--map", f"{port}=/mana/{port}.cloud")]
    for name in "ab":
        assert main(["replay", str(log), "--dfpc", dfpc, *wiring, "--out", str(tmp_path / name)]) == 0
    first, second = ((tmp_path / name / "outputs.msg").read_bytes() for name in "ab")
    assert first == second
    with closing(open_log(tmp_path / "a" / "outputs.msg")) as outputs:
        (sample,) = list(outputs.samples())
    assert sample.stream == f"/mana/{dfpc}.{output_port}"
    T = sample.value.transform
    T_recorded = se3.transform_from_quaternion_xyzw(recorded[:3], recorded[3:])
    error_m, error_deg = pose_errors(T.matrix, T_recorded)
    estimate = [*T.matrix[:3, 3], *se3.quaternion_xyzw_from_matrix(T.matrix[:3, :3])]
    assert error_m <= TOLERANCE_M, f"moved by {error_m} m, pose is now {estimate}"
    assert error_deg <= TOLERANCE_DEG, f"rotated by {error_deg} degrees, pose is now {estimate}"
    assert np.all(np.linalg.eigvalsh(T.covariance) > 0.0)
