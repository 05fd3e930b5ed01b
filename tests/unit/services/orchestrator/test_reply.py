# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Products converted to the requested frame and type."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import InputError, UnavailableError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.product import Quality
from cdff_common.types import PoseTrajectory, TransformWithCovariance
from cdff_core.orchestration.acceptance import ProductCandidate
from cdff_core.orchestration.request import parse_request
from services.orchestrator.product_finder import ProductMatch
from services.orchestrator.reply import ConvertedProduct, converted, derived_header

S = 1_000_000_000


@pytest.mark.parametrize(("moved_m", "is_static"), [(0.5e-6, True), (1e-3, False)])
def test_a_trajectory_is_moved_only_between_frames_at_rest(moved_m: float, is_static: bool) -> None:
    T = np.stack([se3.transform(np.eye(3), [x, 0.0, 0.0]) for x in (0.0, 1.0)])
    trajectory = PoseTrajectory.from_arrays([S, 2 * S], T, parent="mana/odom", child="mana/base")
    candidate = ProductCandidate("t", "mana", 2 * S, 2 * S)
    match = ProductMatch(candidate, (), trajectory, "mana/odom", child="mana/base")
    request = parse_request({"type": "trajectory", "robot": "mana", "frame": "site"}, "mana")

    def lookup(parent: str, child: str, t_ns: int) -> UncertainTransform:
        assert (parent, child) == ("site", "mana/odom")
        return UncertainTransform.exact(se3.transform(np.eye(3), [0.0, 5.0 + moved_m * (t_ns == S), 0.0]))

    if is_static:
        result = converted(request, match, lookup)
        assert (result.frame, result.child) == ("site", "mana/base")
        np.testing.assert_allclose(result.value.matrices[:, :3, 3], [[0, 5, 0], [1, 5, 0]], atol=1e-5)
    else:
        with pytest.raises(UnavailableError, match="ask for frame=mana/odom"):
            converted(request, match, lookup)


def test_a_pose_of_the_frame_tree_has_a_header_without_inputs_at_its_time() -> None:
    T = UncertainTransform(np.eye(4))
    pose = TransformWithCovariance.from_transform(T, parent="site", child="mana/base", stamp_ns=2 * S)
    match = ProductMatch(ProductCandidate("t", "mana", 2 * S, 2 * S), (), T, "site", child="mana/base")
    product = ConvertedProduct(pose, "TransformWithCovariance", "site", "mana/base")
    parameters = {"type": "pose", "robot": "mana", "frame": "site", "child": "mana/base"}
    header = derived_header(parse_request({**parameters, "t": str(2 * S)}, "mana"), match, product)
    assert (header.t0_ns, header.t1_ns) == (2 * S, 2 * S)
    assert (header.inputs, header.quality) == ((), Quality())
    with pytest.raises(InputError, match="nothing to derive a header from"):
        derived_header(parse_request(parameters, "mana"), match, product)
