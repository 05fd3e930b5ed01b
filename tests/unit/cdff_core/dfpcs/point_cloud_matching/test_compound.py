# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""PointCloudMatching: finds the overlap from any heading, and says where there is none."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cdff_common.errors import ConfigurationError, ProductNotFoundError
from cdff_common.geometry import se3
from cdff_common.interfaces.dfpc import Dfpc, Output, Sample
from cdff_common.interfaces.product import CovarianceKind, Status
from cdff_common.interfaces.registry import Registry
from cdff_common.types import Pointcloud
from tests import surfaces

T_TRUE = se3.exp_se3([30.0, -12.0, 5.0, 0.1, -0.2, 2.5])


def made(**config: Any) -> Dfpc:
    dfpc = Registry.default().make_dfpc("point_cloud_matching")
    dfpc.configure(config)
    return dfpc


def cloud(port: str, points: surfaces.Points, stamp_ns: int = 1000) -> Sample:
    value = Pointcloud.from_points(points, frame=port, stamp_ns=stamp_ns)
    return Sample(port, stamp_ns, 0, value, id=f"{port}-{stamp_ns}")


def matched(dfpc: Dfpc, *samples: Sample) -> Output:
    outputs = [output for sample in samples for output in dfpc.step(sample)]
    assert len(outputs) == 1
    return outputs[0]


def source_of(points: surfaces.Points) -> surfaces.Points:
    return se3.transform_points(se3.inverse(T_TRUE), points)


def test_two_parts_of_a_surface_meet_from_any_heading_with_covariance_and_provenance(rng: np.random.Generator) -> None:
    left, right = surfaces.terrain(rng, 9000), surfaces.terrain(rng, 9000)
    left, right = left[left[:, 0] < 4.0], right[right[:, 0] > -4.0]
    output = matched(made(), cloud("target", left), cloud("source", source_of(right)))
    assert output.quality.status is not Status.FAILED
    assert output.quality.covariance_kind is CovarianceKind.FORMAL
    T = output.value.transform
    error = se3.log_se3(T.matrix @ se3.inverse(T_TRUE))
    assert np.linalg.norm(error[:3]) < 0.03
    assert np.linalg.norm(error[3:]) < 0.005
    assert T.covariance is not None
    assert (output.frame, output.child, output.t1_ns) == ("target", "source", 1000)
    assert output.inputs == ("target-1000", "source-1000")
    assert {"matches", "match_inliers", "clique", "overlap_source", "least_agreement"} <= set(output.quality.metrics)


def test_a_source_that_comes_first_waits_for_its_target(rng: np.random.Generator) -> None:
    dfpc = made()
    source, target = cloud("source", source_of(surfaces.terrain(rng))), cloud("target", surfaces.terrain(rng))
    with pytest.raises(ProductNotFoundError, match="nothing yet"):
        dfpc.store.get("target")
    assert matched(dfpc, source, target).quality.status is Status.OK
    assert dfpc.store.get("last_transform").parent_frame == "target"
    assert dfpc.store.get("target").frame == "target"


@pytest.mark.slow
def test_the_same_clouds_give_the_same_answer_to_the_bit(rng: np.random.Generator) -> None:
    samples = cloud("target", surfaces.terrain(rng)), cloud("source", source_of(surfaces.terrain(rng)))
    first, second = (matched(made(), *samples).value.transform for _ in range(2))
    assert np.array_equal(first.matrix, second.matrix)
    assert np.array_equal(first.covariance, second.covariance)


def test_clouds_that_share_nothing_are_said_to_have_no_overlap(rng: np.random.Generator) -> None:
    other = surfaces.terrain(rng)[:, [1, 0, 2]] * [1, 1, -2] + [0, 0, 3]
    output = matched(made(), cloud("target", surfaces.terrain(rng)), cloud("source", other))
    assert output.value is None
    assert output.quality.status is Status.FAILED
    assert output.quality.reasons[0] == "no_overlap"


@pytest.mark.slow
@pytest.mark.parametrize("shape", [surfaces.plane, surfaces.corridor])
def test_a_shape_that_can_slide_is_not_answered(rng: np.random.Generator, shape: Any) -> None:
    output = matched(made(), cloud("target", shape(rng)), cloud("source", shape(rng)))
    assert output.quality.status is Status.FAILED


@pytest.mark.parametrize("points", [np.zeros((10, 3)), np.full((500, 3), np.nan), np.zeros((500, 3))])
def test_a_cloud_without_use_leads_to_a_failed_output(rng: np.random.Generator, points: np.ndarray) -> None:
    good = surfaces.terrain(rng)
    bad_source = matched(made(), cloud("target", good), cloud("source", points))
    bad_target = matched(made(), cloud("target", points), cloud("source", good))
    assert bad_source.quality.status is bad_target.quality.status is Status.FAILED
    assert bad_source.quality.reasons[0].startswith(("bad_input", "no_overlap"))
    assert bad_target.quality.reasons[0].startswith(("bad_target", "bad_input", "no_overlap"))


def test_after_forgetting_a_source_waits_again(rng: np.random.Generator) -> None:
    dfpc = made()
    assert list(dfpc.step(cloud("target", surfaces.terrain(rng)))) == []
    dfpc.call("forget", {})
    assert list(dfpc.step(cloud("source", surfaces.terrain(rng)))) == []


def test_a_radius_that_is_none_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="support_voxels"):
        made(support_voxels=[])
    with pytest.raises(ConfigurationError, match="support_voxels"):
        made(support_voxels=[-1.0])
