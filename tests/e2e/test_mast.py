# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Pose of the moving mast head of the rovers in the demonstration."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from cdff_common.client import Client
from cdff_common.errors import CdffError
from cdff_common.geometry import se3
from cdff_dev.missions.stage import Stage
from tests.integration.conftest import ROOT, wait_until

pytestmark = [pytest.mark.e2e, pytest.mark.timeout(240)]

CALL = ("-m", "cdff_common.cli", "call", "mana", "position_manager")


def run(endpoint: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, *arguments],
        cwd=ROOT,
        env={**os.environ, "CDFF_CONNECT": endpoint, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )


def call_operation(endpoint: str, operation: str, *parameters: str) -> Any:
    result = run(endpoint, *CALL, operation, *parameters, "--json")
    assert result.returncode == 0, result.stderr
    return json.loads(result.stdout)


def T_base_head(pan_rad: float, tilt_rad: float) -> NDArray[np.float64]:
    """Compute the pose of the head in the base frame with the values of deploy/profiles/rover_mast.urdf."""
    neck = se3.transform(se3.exp_so3([0, 0, pan_rad]), [0.20, 0.0, 1.10])
    return neck @ se3.transform(se3.exp_so3([0, tilt_rad, 0]), [0.10, 0.0, 0.08])


def pose_of(client: Client, parent: str, child: str, t_ns: str = "") -> NDArray[np.float64] | None:
    """Return ``T_parent_child`` at a time, by default the newest, or None if it is unknown."""
    query = {"parent": parent, "child": child} | ({"t_ns": t_ns} if t_ns else {})
    try:
        value, _ = client.call("mana", "position_manager", "get_pose", query)
    except CdffError:
        return None
    return np.asarray(value.transform.matrix)


@pytest.mark.slow
@pytest.mark.req("CDFF-SUP-195")
def test_the_pose_of_the_mast_head_follows_from_its_joints(stage: Stage, endpoint: str) -> None:
    with Client(endpoint) as client:
        wait_until(lambda: pose_of(client, "site", "mana/base") is not None, 60.0, "a pose of mana")
        for pan, tilt in ((0.6, -0.2), (-1.1, 0.9)):
            move_command = run(endpoint, "examples/move_mast.py", "mana", f"pan={pan}", f"tilt={tilt}")
            assert move_command.returncode == 0, move_command.stderr
            expected = T_base_head(pan, tilt)

            def has_expected_pose(expected: NDArray[np.float64] = expected) -> bool:
                T = pose_of(client, "mana/base", "mana/head")
                return T is not None and bool(np.allclose(T, expected, atol=1e-6))

            wait_until(has_expected_pose, 20.0, f"the head at {pan}, {tilt}")
            head = call_operation(endpoint, "get_pose", "parent=site", "child=mana/head")
            assert (head["parent"], head["child"]) == ("site", "mana/head")
            assert head["covariance"] is not None
            stamp_ns = head["stamp_ns"]

            def is_consistent(stamp_ns: str = stamp_ns, expected: NDArray[np.float64] = expected) -> bool:
                """Compare head and base; late visual odometry may change both between two queries."""
                head = pose_of(client, "site", "mana/head", stamp_ns)
                base = pose_of(client, "site", "mana/base", stamp_ns)
                return head is not None and base is not None and np.allclose(head, base @ expected, atol=1e-6)

            wait_until(is_consistent, 20.0, f"head and base at {stamp_ns}")


@pytest.mark.slow
def test_a_time_can_be_pinned_and_invalid_queries_are_refused_on_the_command_line(
    stage: Stage, endpoint: str
) -> None:
    pinned = call_operation(endpoint, "pin")
    assert call_operation(endpoint, "get_pins")["t1_ns"] == pinned["stamp_ns"]
    refused = run(endpoint, *CALL, "get_pose", "parent=site", "child=mana/arm")
    assert refused.returncode == 1
    assert "mana/arm" in refused.stderr
    assert len(refused.stderr.splitlines()) == 1
