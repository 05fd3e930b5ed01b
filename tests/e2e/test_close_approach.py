# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A close approach in orbit with processes: the plan changes from the far camera to a lidar."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from cdff_common.client import Client
from cdff_common.geometry import se3
from cdff_common.interfaces.profile import load_profile
from tests.support.approach import Approach, run_approach

pytestmark = [pytest.mark.e2e, pytest.mark.slow, pytest.mark.timeout(900)]


@pytest.fixture(scope="module")
def approach() -> Iterator[Approach]:
    with run_approach("close_approach") as approach:
        yield approach


def test_requests_with_bounds_on_the_accuracy_change_the_provider(approach: Approach) -> None:
    outcomes = approach.outcomes
    assert [outcome.faults for outcome in outcomes] == [()] * len(outcomes)
    plan = "\n".join(outcomes[2].explanation)
    for dfpc in ("far_range_object_tracking", "target_detection", "lidar_target_tracking"):
        assert f"plan: servicer/{dfpc}" in plan
    assert "detections from product/target_detection/detections" in plan


def test_the_pose_of_the_client_in_the_frame_of_the_arm_is_true(approach: Approach) -> None:
    frames = load_profile("close_approach").robots[0].frames
    T_base_arm = next(mount.transform.matrix for mount in frames if mount.child == "servicer/arm")
    with Client(approach.connect) as client:
        newest = client.search("pose", robot="servicer", dfpc="lidar_target_tracking", limit=1)[0]
        t_ns = newest.header.t1_ns
        estimate = client.pose("servicer", parent="servicer/arm", child="client/body", t_ns=t_ns)
    truth = se3.inverse(T_base_arm) @ approach.true_pose("lidar", t_ns)  # the lidar is in the base
    error_m = estimate.matrix[:3, 3] - truth[:3, 3]
    error_rad = se3.log_so3(estimate.matrix[:3, :3] @ truth[:3, :3].T)
    assert np.linalg.norm(error_m) < 0.05
    assert np.linalg.norm(error_rad) < np.radians(1.0)
    assert estimate.covariance is not None
    sigmas = np.sqrt(np.diag(estimate.covariance))
    assert np.all(np.abs(np.r_[error_m, error_rad]) < 5.0 * sigmas)
