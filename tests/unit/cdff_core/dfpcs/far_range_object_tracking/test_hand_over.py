# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The position of a resolved object among the stars starts the tracking at close range."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.dfpc import DfpcContext, Sample
from cdff_common.interfaces.registry import Registry
from cdff_common.types import Mesh, ObjectTrackStatusT, TransformWithCovariance, Vector3d
from tests.support.satellite import satellite
from tests.support.star_scene import CAMERA, SATELLITE_SUN, T0_NS, StarScene, satellite_light

TRACK_CONFIRMED = ObjectTrackStatusT.TRACK_CONFIRMED


@pytest.mark.slow
def test_the_position_of_a_resolved_target_starts_target_tracking() -> None:
    scene = StarScene(rate=np.zeros(3))
    far, close = (Registry.default().make_dfpc(n) for n in ("far_range_object_tracking", "target_tracking"))
    far.configure({}, DfpcContext("robot"))
    close.configure({})
    vertices, triangles = satellite()
    far.step(
        Sample("model", T0_NS, 0, Mesh.from_arrays(vertices, triangles, frame="client/body", stamp_ns=T0_NS))
    )
    R = se3.exp_so3([0.3, -0.5, 0.2])
    size = float(np.ptp(vertices, axis=0).max())
    states, squares, sigmas_px = [], [], []
    for k in range(30):
        stamp_ns = T0_NS + k * 10**9
        range_m = CAMERA.fx * size / 50.0 - 0.2 * k
        T = se3.transform(R, range_m * np.array([-0.02 + 0.0012 * k, 0.01, 1.0]))
        far.step(Sample("sun", stamp_ns, k, Vector3d(scene.rotation(k) @ SATELLITE_SUN)))
        attitude = TransformWithCovariance.from_transform(
            UncertainTransform(se3.transform(scene.rotation(k) @ R, np.zeros(3)), np.zeros((6, 6))),
            parent="inertial",
            child="client/body",
            stamp_ns=stamp_ns,
        )
        far.step(Sample("body_attitude", stamp_ns, k, attitude))
        for output in far.step(scene.sample(scene.light(k) + satellite_light(T), k)):
            if output.port == "track" and output.value.metadata.status == TRACK_CONFIRMED:
                sigmas_px.append(output.value.data.bearings[0, 2:4] * CAMERA.fx)
            if output.port == "position":
                single = output.value.transform
                error = single.matrix[:3, 3] - T[:3, 3]
                squares.append(float(error @ np.linalg.solve(single.covariance[:3, :3], error)))
                states += [
                    (T, state)
                    for state in close.step(Sample("measurement", output.t1_ns, k, output.value, id=f"{k}"))
                    if state.port == "pose"
                ]
    assert len(states) >= 8
    T, state = states[-1]
    assert (state.frame, state.child) == ("robot/camera", "client/body")
    estimate = state.value.transform
    assert estimate.matrix[:3, 3] == pytest.approx(T[:3, 3], rel=0.03, abs=0.02 * T[2, 3])
    assert np.linalg.norm(se3.log_so3(estimate.matrix[:3, :3].T @ T[:3, :3])) < 0.03
    # The direction of a partly shadowed body of 50 pixels is known to a part of its extent.
    assert 5.0 < np.median(sigmas_px) < 10.0
    # The errors of the images are alike: only a single position has the stated covariance.
    assert np.median(squares) < 12.0
