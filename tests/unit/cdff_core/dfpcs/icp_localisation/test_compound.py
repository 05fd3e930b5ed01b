# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""ICP localisation: poses with covariance, and refusals with reasons."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cdff_common.errors import ConfigurationError, ProductNotFoundError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.covariance import pose_error
from cdff_common.geometry.direction_names import direction_name, direction_names
from cdff_common.interfaces.dfpc import Dfpc, Output, Sample
from cdff_common.interfaces.product import CovarianceKind, Status
from cdff_common.interfaces.registry import Registry
from cdff_common.types import Pointcloud, TransformWithCovariance
from tests.support import surfaces

T_TRUE = se3.exp_se3([0.5, -0.3, 0.2, 0.03, -0.02, 0.1])


def make_configured_dfpc(implementation: str | None = None, **config: Any) -> Dfpc:
    dfpc = Registry.default().make_dfpc("icp_localisation")
    dfpc.configure(config, implementation=implementation)
    return dfpc


def cloud(port: str, points: surfaces.Points, stamp_ns: int = 1000) -> Sample:
    value = Pointcloud.from_points(points, frame=port, stamp_ns=stamp_ns)
    return Sample(port, stamp_ns, 0, value, id=f"{port}-{stamp_ns}")


def guess(T: np.ndarray, stamp_ns: int = 1000) -> Sample:
    value = TransformWithCovariance.from_transform(
        UncertainTransform(T), parent="scene", child="model", stamp_ns=stamp_ns
    )
    return Sample("guess", stamp_ns, 0, value, id="guess")


def localise(dfpc: Dfpc, *samples: Sample) -> Output:
    outputs = [output for sample in samples for output in dfpc.step(sample)]
    assert len(outputs) == 1
    return outputs[0]


def model_of(points: surfaces.Points) -> surfaces.Points:
    return se3.transform_points(se3.inverse(T_TRUE), points)


@pytest.mark.parametrize(("implementation", "level"), [("PointToPlane", 1), ("Gicp", 2)])
def test_the_alignment_is_assessed_on_the_level_of_the_implementation(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch, implementation: str, level: int
) -> None:
    dfpc: Any = make_configured_dfpc(implementation, confirmations=0)
    sizes, process = [], dfpc._assess.process

    def record_size(inputs: Any) -> Any:
        sizes.append((len(inputs.source), len(inputs.target)))
        return process(inputs)

    monkeypatch.setattr(dfpc._assess, "process", record_size)
    model = cloud("model", model_of(surfaces.terrain(rng, 12_000)))
    scene = cloud("scene", surfaces.terrain(rng, 12_000))
    localise(dfpc, model, scene)
    levels = [dfpc._prepare(sample).levels for sample in (model, scene)]
    assert sizes == [tuple(len(cloud_levels[level].points_m) for cloud_levels in levels)]
    assert len(levels[0][1].points_m) < len(levels[0][2].points_m)


@pytest.mark.parametrize("implementation", ["PointToPlane", "Gicp", "Accurate", "Fast", "Quick"])
def test_a_model_is_localised_with_covariance_and_provenance(
    rng: np.random.Generator, implementation: str
) -> None:
    model, scene = cloud("model", model_of(surfaces.terrain(rng))), cloud("scene", surfaces.terrain(rng))
    output = localise(make_configured_dfpc(implementation), model, scene)
    T = output.value.transform
    error = se3.log_se3(se3.inverse(T_TRUE) @ T.matrix)
    assert output.quality.status is Status.OK
    kind = CovarianceKind.FORMAL if implementation == "Fast" else CovarianceKind.CALIBRATED
    assert output.quality.covariance_kind is kind
    assert np.linalg.norm(error[:3]) < 0.01
    assert np.linalg.norm(error[3:]) < 0.002
    assert 1e-4 < np.sqrt(T.covariance[0, 0]) < 0.05
    assert (output.frame, output.child, output.t1_ns) == ("scene", "model", 1000)
    assert output.inputs == ("model-1000", "scene-1000")
    assert {"overlap_model", "inlier_ratio", "rms_m", "iterations", "condition_number"} <= set(
        output.quality.metrics
    )


@pytest.mark.parametrize("normals_to_fine", [True, False])
def test_only_the_coarsest_level_gets_normals_if_the_fine_ones_need_none(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch, normals_to_fine: bool
) -> None:
    dfpc: Any = make_configured_dfpc("PointToPlane", normals_to_fine=normals_to_fine, confirmations=0)
    has_normals: dict[int, set[bool]] = {}
    for level, register in enumerate(dfpc._register):

        def record(inputs: Any, level: int = level, process: Any = register.process) -> Any:
            has_normals.setdefault(level, set()).add(inputs.target_normals is not None)
            return process(inputs)

        monkeypatch.setattr(register, "process", record)
    localise(dfpc, cloud("model", model_of(surfaces.terrain(rng))), cloud("scene", surfaces.terrain(rng)))
    assert len(has_normals) > 1
    assert has_normals.pop(0) == {True}
    assert all(answers == {normals_to_fine} for answers in has_normals.values())


def test_the_covariance_of_a_cloud_without_coarser_levels_contains_its_resolution(
    rng: np.random.Generator,
) -> None:
    T_true = se3.exp_se3([0.1, -0.05, 0.02, 0.01, 0.0, 0.02])
    scene = surfaces.terrain(rng)[:1800]
    model = se3.transform_points(se3.inverse(T_true), surfaces.terrain(rng)[:1800])
    T = localise(make_configured_dfpc(), cloud("model", model), cloud("scene", scene)).value.transform
    e = pose_error(T_true, T.matrix)
    assert e @ np.linalg.solve(T.covariance, e) < 15.0


def test_with_other_dfn_parameters_the_covariance_is_only_formal(rng: np.random.Generator) -> None:
    model, scene = cloud("model", model_of(surfaces.terrain(rng))), cloud("scene", surfaces.terrain(rng))
    output = localise(make_configured_dfpc(register_fine={"gate_spacings": 2.0}), model, scene)
    assert output.quality.covariance_kind is CovarianceKind.FORMAL


def test_a_scene_received_before_its_model_is_processed_with_the_model(rng: np.random.Generator) -> None:
    output = localise(
        make_configured_dfpc(),
        cloud("scene", surfaces.terrain(rng)),
        cloud("model", model_of(surfaces.terrain(rng))),
    )
    assert output.quality.status is Status.OK


def test_the_registration_starts_from_the_guess(rng: np.random.Generator) -> None:
    T_true = se3.exp_se3([20.0, 10.0, 5.0, 0.2, 0.3, 2.5])
    model = cloud("model", se3.transform_points(se3.inverse(T_true), surfaces.terrain(rng)))
    scene = cloud("scene", surfaces.terrain(rng))
    near = T_true @ se3.exp_se3([0.2, 0.1, 0.1, 0.02, 0.02, 0.05])
    output = localise(make_configured_dfpc(), guess(near), model, scene)
    assert output.quality.status is Status.OK
    assert np.linalg.norm(se3.log_se3(se3.inverse(T_true) @ output.value.transform.matrix)[:3]) < 0.02


@pytest.mark.req("CDFF-CORE-072")
def test_flat_ground_is_refused_with_the_degenerate_directions_named(rng: np.random.Generator) -> None:
    output = localise(
        make_configured_dfpc(), cloud("model", surfaces.plane(rng)), cloud("scene", surfaces.plane(rng))
    )
    assert output.value is None
    assert output.quality.status is Status.FAILED
    reasons = " ".join(output.quality.reasons)
    assert "degenerate:rotation_z" in reasons
    assert reasons.count("degenerate:translation") == 2


@pytest.mark.req("CDFF-CORE-072")
def test_a_corridor_is_refused_along_its_axis_only(rng: np.random.Generator) -> None:
    output = localise(
        make_configured_dfpc(), cloud("model", surfaces.corridor(rng)), cloud("scene", surfaces.corridor(rng))
    )
    assert output.quality.status is Status.FAILED
    assert [r for r in output.quality.reasons if r.startswith("degenerate:")] == ["degenerate:translation_x"]


def test_unrelated_clouds_are_refused(rng: np.random.Generator) -> None:
    unrelated = surfaces.terrain(rng)[:, [1, 0, 2]] * [1, 1, -2] + [0, 0, 3]
    output = localise(
        make_configured_dfpc(), cloud("model", unrelated), cloud("scene", surfaces.terrain(rng))
    )
    assert output.quality.status is Status.FAILED


def test_a_periodic_cloud_is_ambiguous(rng: np.random.Generator) -> None:
    def waves() -> surfaces.Points:
        xy = rng.uniform(-10, 10, (6000, 2))
        heights = 0.06 * np.sin(np.pi * xy[:, 0]) + 0.6 * np.sin(0.6 * xy[:, 1]) + 0.02 * xy[:, 1] ** 2
        return np.c_[xy, heights + rng.normal(0, 0.002, 6000)]

    output = localise(make_configured_dfpc(), cloud("model", waves()), cloud("scene", waves()))
    assert output.quality.status is Status.FAILED
    assert "ambiguous" in output.quality.reasons


@pytest.mark.parametrize("points", [np.zeros((10, 3)), np.full((500, 3), np.nan), np.zeros((500, 3))])
def test_an_unusable_cloud_leads_to_a_failed_output(rng: np.random.Generator, points: np.ndarray) -> None:
    output = localise(make_configured_dfpc(), cloud("model", surfaces.terrain(rng)), cloud("scene", points))
    assert output.quality.status is Status.FAILED
    assert output.quality.reasons


def test_a_broken_model_fails_the_scene_that_needs_it(rng: np.random.Generator) -> None:
    dfpc = make_configured_dfpc()
    assert list(dfpc.step(cloud("model", np.zeros((10, 3))))) == []
    output = localise(dfpc, cloud("scene", surfaces.terrain(rng)))
    assert output.quality.status is Status.FAILED
    assert any("model" in reason for reason in output.quality.reasons)


def test_the_next_scene_starts_from_the_last_alignment_until_forget_is_called(
    rng: np.random.Generator,
) -> None:
    dfpc = make_configured_dfpc()
    far = se3.exp_se3([0.0, 0.0, 0.0, 0.0, 0.0, 3.0])
    model = cloud("model", se3.transform_points(se3.inverse(far), surfaces.terrain(rng)))
    assert (
        localise(dfpc, guess(far), model, cloud("scene", surfaces.terrain(rng))).quality.status is Status.OK
    )
    second = localise(dfpc, cloud("scene", surfaces.terrain(rng), 2000))
    assert second.quality.status is Status.OK
    dfpc.call("forget", {})
    third = localise(dfpc, cloud("scene", surfaces.terrain(rng), 3000))
    assert third.quality.status is Status.FAILED


def test_the_store_has_the_model_and_the_last_alignment(rng: np.random.Generator) -> None:
    dfpc = make_configured_dfpc()
    with pytest.raises(ProductNotFoundError, match="still empty"):
        dfpc.store.get("last_alignment")
    localise(dfpc, cloud("model", model_of(surfaces.terrain(rng))), cloud("scene", surfaces.terrain(rng)))
    assert dfpc.store.items == ("aligned_model", "last_alignment", "model")
    assert dfpc.store.get("last_alignment").parent_frame == "scene"
    aligned, model = dfpc.store.get("aligned_model"), dfpc.store.get("model")
    T = dfpc.store.get("last_alignment").transform
    np.testing.assert_allclose(aligned.points_m, T.apply(model.points_m), atol=1e-9)
    assert aligned.frame == "scene"


def test_the_same_clouds_give_the_same_pose_bit_for_bit(rng: np.random.Generator) -> None:
    model, scene = cloud("model", model_of(surfaces.terrain(rng))), cloud("scene", surfaces.terrain(rng))
    first, second = (localise(make_configured_dfpc(), model, scene).value.transform for _ in range(2))
    np.testing.assert_array_equal(first.matrix, second.matrix)
    np.testing.assert_array_equal(first.covariance, second.covariance)


def test_parameters_reach_the_dfns_and_unknown_ones_are_refused() -> None:
    with pytest.raises(ConfigurationError, match="kernel_scales"):
        make_configured_dfpc(register_fine={"kernel_scales": -1.0})
    with pytest.raises(ConfigurationError, match="min_overlaps"):
        make_configured_dfpc(min_overlaps=0.3)


def test_directions_are_named_by_axis_or_by_components() -> None:
    assert direction_name(np.array([0, 0.99, 0.1, 0, 0, 0.0])) == "translation_y"
    assert direction_name(np.array([0, 0.1, 0, 0, 0.02, -0.99])) == "rotation_z"
    assert direction_name(np.array([0.7, 0.7, 0, 0, 0, 0])) == "translation(0.71,0.71,0.00)"


def test_the_names_of_directions_do_not_depend_on_the_basis(rng: np.random.Generator) -> None:
    flat = np.eye(6)[[0, 1, 5]]
    rotation = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    assert direction_names(rotation @ flat) == ["translation_x", "translation_y", "rotation_z"]
    assert direction_names(np.zeros((0, 6))) == []
