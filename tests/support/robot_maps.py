# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Maps of two robots with a known relative pose, and loop closures between the maps."""

from __future__ import annotations

import numpy as np

from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.se3 import FloatArray
from cdff_common.types import PoseGraph
from cdff_core.map_merging.robot_maps import Closure, RobotMap

ROBOTS = ("mana", "minnie")

#: Pose of each keyframe relative to the previous one.
STEP = se3.exp_se3([5.0, 0.3, 0.1, 0.01, 0.02, 0.2])
CLOSURE_COVARIANCE = np.diag([0.005**2] * 3 + [0.0005**2] * 3)

#: True poses of the map frames in the site frame.
T_SITE_SLAM = {"mana": np.eye(4), "minnie": se3.transform(se3.exp_so3([0.02, -0.01, 2.9]), [18.0, 4.0, 0.5])}


def robot_map(robot: str, survey_error: FloatArray, sigma_m: float, keyframes: int = 5) -> RobotMap:
    """Return the map of a robot with keyframes along a curve; its surveyed pose has ``survey_error``."""
    poses = [np.eye(4)]
    for _ in range(keyframes - 1):
        poses.append(poses[-1] @ STEP)
    graph = PoseGraph.from_arrays(
        np.arange(keyframes) + 3,
        (np.arange(keyframes) + 1) * 10**10,
        np.array(poses),
        np.array([[i + 3, i + 4] for i in range(keyframes - 1)]),
        np.array([STEP] * (keyframes - 1)),
        np.array([np.linalg.inv(CLOSURE_COVARIANCE)] * (keyframes - 1)),
        [0] * (keyframes - 1),
        frame=f"{robot}/slam",
        fixed=np.arange(keyframes) == 0,
    )
    survey = UncertainTransform(
        T_SITE_SLAM[robot] @ survey_error,
        np.diag([sigma_m**2] * 3 + [0.1**2] * 3 if sigma_m > 0.1 else [1e-6] * 6),
    )
    return RobotMap(robot, graph, survey, survey)


def maps() -> list[RobotMap]:
    """Return the map of mana, surveyed without error, and that of minnie with an error of 1.3 m."""
    return [
        robot_map("mana", np.eye(4), 0.01),
        robot_map("minnie", se3.exp_se3([1.0, -0.8, 0.2, 0.0, 0.0, 0.08]), 1.5),
    ]


def closure(a: int, b: int, error: FloatArray | None = None) -> Closure:
    """Return the loop closure between keyframe ``a`` of mana and ``b`` of minnie, counted from 0."""
    mana, minnie = (list(m.keyframes.items())[i] for m, i in zip(maps(), (a, b), strict=True))
    T = se3.inverse(T_SITE_SLAM["mana"] @ mana[1]) @ T_SITE_SLAM["minnie"] @ minnie[1]
    return Closure(
        mana[0], minnie[0], UncertainTransform(T if error is None else error @ T, CLOSURE_COVARIANCE)
    )


def error_m(anchors: dict[str, UncertainTransform]) -> float:
    """Return the error of the translation between the two map frames."""
    relative = se3.inverse(anchors["mana"].matrix) @ anchors["minnie"].matrix
    return float(np.linalg.norm((relative - se3.inverse(T_SITE_SLAM["mana"]) @ T_SITE_SLAM["minnie"])[:3, 3]))
