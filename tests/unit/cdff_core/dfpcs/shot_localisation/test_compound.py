# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""SHOT localisation: a model anywhere in a scene, a missing model, and a model that occurs twice."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from cdff_common.errors import ProductNotFoundError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.dfpc import Dfpc, Output, Sample
from cdff_common.interfaces.product import CovarianceKind, Status
from cdff_common.interfaces.registry import Registry
from cdff_common.types import Pointcloud, TransformWithCovariance
from cdff_core.dfns.registration_3d.interface import Registration3DInputs, Registration3DOutputs
from cdff_core.dfns.registration_3d.point_to_plane_icp import PointToPlaneIcp
from tests.support import surfaces

T_TRUE = se3.exp_se3([4.0, -3.0, 2.0, 0.3, -0.2, 2.0])


def make_configured_dfpc(implementation: str | None = None, **config: Any) -> Dfpc:
    dfpc = Registry.default().make_dfpc("shot_localisation")
    dfpc.configure(config, implementation=implementation)
    return dfpc


def cloud(port: str, points: surfaces.Points, stamp_ns: int = 1000) -> Sample:
    value = Pointcloud.from_points(points, frame=port, stamp_ns=stamp_ns)
    return Sample(port, stamp_ns, 0, value, id=f"{port}-{stamp_ns}")


def guess(T: np.ndarray) -> Sample:
    value = TransformWithCovariance.from_transform(
        UncertainTransform(T), parent="scene", child="model", stamp_ns=1000
    )
    return Sample("guess", 1000, 0, value, id="guess")


def localise(dfpc: Dfpc, *samples: Sample) -> Output:
    outputs = [output for sample in samples for output in dfpc.step(sample)]
    assert len(outputs) == 1
    return outputs[0]


def scene(rng: np.random.Generator) -> surfaces.Points:
    return surfaces.terrain(rng, 12_000)


def model(rng: np.random.Generator) -> surfaces.Points:
    """Return the centre of the scene, sampled again, in the frame of the model."""
    points = surfaces.terrain(rng, 12_000)
    inside = np.all(np.abs(points[:, :2] - [2.0, -1.0]) < 5.0, axis=1)
    return se3.transform_points(se3.inverse(T_TRUE), points[inside])


def error_of(output: Output) -> np.ndarray:
    return se3.log_se3(se3.inverse(T_TRUE) @ output.value.transform.matrix)


def test_a_model_is_localised_without_a_guess_with_covariance_and_provenance(
    rng: np.random.Generator,
) -> None:
    output = localise(make_configured_dfpc(), cloud("model", model(rng)), cloud("scene", scene(rng)))
    assert output.quality.status is not Status.FAILED, output.quality.reasons
    assert output.quality.covariance_kind is CovarianceKind.FORMAL
    assert np.linalg.norm(error_of(output)) < 0.05
    assert (output.frame, output.child) == ("scene", "model")
    assert output.inputs == ("model-1000", "scene-1000")


def test_a_good_guess_is_tested_first_and_used_once(rng: np.random.Generator) -> None:
    dfpc = make_configured_dfpc()
    near = T_TRUE @ se3.exp_se3([0.1, 0.1, 0.05, 0.02, 0.01, 0.03])
    output = localise(dfpc, guess(near), cloud("model", model(rng)), cloud("scene", scene(rng)))
    assert "matches" not in output.quality.metrics
    assert np.linalg.norm(error_of(output)) < 0.05
    assert output.inputs == ("model-1000", "scene-1000", "guess")
    assert "matches" in localise(dfpc, cloud("scene", scene(rng), 2000)).quality.metrics


def test_a_wrong_guess_does_not_affect_the_result(rng: np.random.Generator) -> None:
    far = se3.exp_se3([50.0, 0, 0, 0, 1.0, 0])
    output = localise(
        make_configured_dfpc(), guess(far), cloud("model", model(rng)), cloud("scene", scene(rng))
    )
    assert np.linalg.norm(error_of(output)) < 0.05


def test_a_scene_received_before_its_model_is_processed_with_the_model(rng: np.random.Generator) -> None:
    dfpc = make_configured_dfpc()
    with pytest.raises(ProductNotFoundError, match="still empty"):
        dfpc.store.get("last_pose")
    localise(dfpc, cloud("scene", scene(rng)), cloud("model", model(rng)))
    assert dfpc.store.get("last_pose").parent_frame == "scene"
    assert dfpc.store.get("model").frame == "model"


def test_a_model_that_is_not_in_the_scene_is_refused(rng: np.random.Generator) -> None:
    other = surfaces.terrain(rng)[:, [1, 0, 2]] * [1, 1, -2]
    output = localise(make_configured_dfpc(), cloud("model", other), cloud("scene", scene(rng)))
    assert output.value is None
    assert output.quality.reasons[0] == "not_found"


def test_a_wrong_pose_with_residuals_above_the_roughness_is_refused(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    register = PointToPlaneIcp.process

    def register_a_quarter(icp: PointToPlaneIcp, inputs: Registration3DInputs) -> Registration3DOutputs:
        coarse = 1000 < len(inputs.source) < 3000
        return register(icp, replace(inputs, source=inputs.source[::4]) if coarse else inputs)

    monkeypatch.setattr(PointToPlaneIcp, "process", register_a_quarter)
    clouds = cloud("model", model(rng)), cloud("scene", scene(rng))
    without_gate, with_gate = (
        localise(make_configured_dfpc(view_search={"enabled": False}, **gate), *clouds)
        for gate in ({"max_roughnesses": 100.0}, {})
    )
    assert np.linalg.norm(error_of(without_gate)) > 1.0
    assert np.linalg.norm(error_of(with_gate)) < 0.05


def test_a_model_that_occurs_twice_is_ambiguous(rng: np.random.Generator) -> None:
    scene_with_two = np.vstack([scene(rng), scene(rng) + np.array([40.0, 0.0, 0.0])])
    output = localise(make_configured_dfpc(), cloud("model", model(rng)), cloud("scene", scene_with_two))
    assert output.quality.status is Status.FAILED
    assert output.quality.reasons[0] == "ambiguous"


@pytest.mark.parametrize("port", ["model", "scene"])
def test_an_unusable_cloud_leads_to_a_failed_output(rng: np.random.Generator, port: str) -> None:
    points = {"model": model(rng), "scene": scene(rng)} | {port: np.zeros((10, 3))}
    output = localise(make_configured_dfpc(), *(cloud(name, points[name]) for name in ("model", "scene")))
    assert output.quality.status is Status.FAILED
    assert output.quality.reasons[0].startswith("bad_")


def test_forget_clears_the_guess(rng: np.random.Generator) -> None:
    dfpc = make_configured_dfpc()
    assert list(dfpc.step(guess(T_TRUE))) == []
    dfpc.call("forget", {})
    assert "matches" in localise(dfpc, cloud("model", model(rng)), cloud("scene", scene(rng))).quality.metrics
