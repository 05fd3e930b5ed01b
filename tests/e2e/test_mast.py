# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The mast of the demonstration's rovers moves, and the running system says where its head is."""

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
from cdff_dev.demo.stage import Stage
from tests.integration.conftest import ROOT, wait_until

pytestmark = [pytest.mark.e2e, pytest.mark.timeout(240)]

CALL = ("-m", "cdff_common.cli", "call", "mana", "position_manager")


def run(endpoint: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, *arguments], cwd=ROOT, env={**os.environ, "CDFF_CONNECT": endpoint, "PYTHONPATH": str(ROOT)},
        capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip


def called(endpoint: str, operation: str, *parameters: str) -> Any:
    done = run(endpoint, *CALL, operation, *parameters, "--json")
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def head_on_base(pan: float, tilt: float) -> NDArray[np.float64]:
    """``T_base_head`` of deploy/profiles/rover_mast.urdf, by hand."""
    neck = se3.transform(se3.exp_so3([0, 0, pan]), [0.20, 0.0, 1.10])
    return neck @ se3.transform(se3.exp_so3([0, tilt, 0]), [0.10, 0.0, 0.08])


def pose_of(client: Client, parent: str, child: str) -> NDArray[np.float64] | None:
    """``T_parent_child`` at the newest estimate; None while it is not known."""
    try:
        value, _ = client.call("mana", "position_manager", "get_pose", {"parent": parent, "child": child})
    except CdffError:
        return None
    return np.asarray(value.transform.matrix)


@pytest.mark.req("CDFF-SUP-195")
def test_where_the_head_of_the_mast_is_follows_from_its_joints(stage: Stage, endpoint: str) -> None:
    with Client(endpoint) as client:
        wait_until(lambda: pose_of(client, "site", "mana/base") is not None, 60.0, "a pose of mana")
        for pan, tilt in ((0.6, -0.2), (-1.1, 0.9)):
            moved = run(endpoint, "examples/move_mast.py", "mana", f"pan={pan}", f"tilt={tilt}")
            assert moved.returncode == 0, moved.stderr
            expected = head_on_base(pan, tilt)

            def is_there(expected: NDArray[np.float64] = expected) -> bool:
                found = pose_of(client, "mana/base", "mana/head")
                return found is not None and bool(np.allclose(found, expected, atol=1e-6))

            wait_until(is_there, 20.0, f"the head at {pan}, {tilt}")
            head = called(endpoint, "get_pose", "parent=site", "child=mana/head")
            at = {"parent": "site", "child": "mana/base", "t_ns": head["stamp_ns"]}
            base, _ = client.call("mana", "position_manager", "get_pose", at)
            assert (head["parent"], head["child"]) == ("site", "mana/head")
            np.testing.assert_allclose(np.array(head["T"]), base.transform.matrix @ expected, atol=1e-6)
            assert head["covariance"] is not None


def test_a_time_is_pinned_and_what_cannot_be_asked_is_refused_from_the_command_line(
    stage: Stage, endpoint: str
) -> None:
    pinned = called(endpoint, "pin")
    assert called(endpoint, "get_pins")["t1_ns"] == pinned["stamp_ns"]
    refused = run(endpoint, *CALL, "get_pose", "parent=site", "child=mana/arm")
    assert refused.returncode == 1
    assert "mana/arm" in refused.stderr
    assert len(refused.stderr.splitlines()) == 1
