# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""ModelDetection: objects on a table, absent and hidden objects, wrong input, a cube in real depth images."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from cdff_common.geometry import se3
from cdff_common.interfaces.dfpc import Dfpc, Output, Sample
from cdff_common.interfaces.product import Status
from cdff_common.interfaces.registry import Registry
from cdff_common.types import DistanceImage, Mesh
from tests.support import satellite
from tests.support.depth_scenes import T_CAMERA_TABLE, depth_image

PREPARE = {"points": 3000, "views": 60, "view_pixels": 96, "grid_cells": 32}
#: A bracket without symmetry, and a block; the lower side is z = 0, metres.
BRACKET = satellite.merged(
    satellite.box((0.20, 0.12, 0.06), (0.0, 0.0, 0.03)),
    satellite.box((0.05, 0.12, 0.12), (-0.075, 0.0, 0.12)),
)
BLOCK = satellite.box((0.16, 0.10, 0.08), (0.0, 0.0, 0.04))


def on_table(x_m: float, y_m: float, angle_rad: float) -> np.ndarray:
    return T_CAMERA_TABLE @ se3.transform(se3.exp_so3([0.0, 0.0, angle_rad]), np.array([x_m, y_m, 0.0]))


def make_dfpc(*models: tuple[str, satellite.Mesh], **config: object) -> Dfpc:
    dfpc = Registry.default().make_dfpc("model_detection")
    dfpc.configure({"prepare": PREPARE, **config})
    for name, mesh in models:
        value = Mesh.from_arrays(*mesh, frame=f"{name}/body", stamp_ns=0)
        assert list(dfpc.step(Sample("model", 0, 0, value, id=name))) == []
    return dfpc


def detected(dfpc: Dfpc, image: DistanceImage) -> Output:
    (output,) = dfpc.step(Sample("depth", 0, 0, image, id="d", frame="rover/depth"))
    assert output.port == "detections"
    return output


def error(T: np.ndarray, T_true: np.ndarray) -> tuple[float, float]:
    """Return the position error, metres, and the rotation error, degrees."""
    angle = se3.rotation_angle(T[:3, :3].T @ T_true[:3, :3])
    return float(np.linalg.norm(T[:3, 3] - T_true[:3, 3])), float(np.degrees(angle))


def test_two_objects_on_a_table_are_found(rng: np.random.Generator) -> None:
    T_bracket, T_block = on_table(-0.16, 0.02, 0.5), on_table(0.18, -0.03, -0.4)
    dfpc = make_dfpc(("bracket", BRACKET), ("block", BLOCK))
    output = detected(dfpc, depth_image([(BRACKET, T_bracket), (BLOCK, T_block)], rng))
    assert output.quality.status is Status.DEGRADED
    # The block looks the same from several sides.
    assert output.quality.reasons[0].startswith(("symmetric_model", "ambiguous"))
    detection_by_label = {detection.label: detection for detection in output.value.detections}
    assert sorted(detection_by_label) == ["block", "bracket"]
    metres, degrees = error(detection_by_label["bracket"].pose.transform.matrix, T_bracket)
    assert metres < 0.005
    assert degrees < 2.0
    T = detection_by_label["block"].pose.transform.matrix
    assert np.linalg.norm((T - T_block)[:3] @ [0.0, 0.0, 0.04, 1.0]) < 0.005
    assert output.value.frame_id == "rover/depth"


def test_an_absent_object_is_not_found(rng: np.random.Generator) -> None:
    output = detected(make_dfpc(("bracket", BRACKET)), depth_image([(BLOCK, on_table(0.1, 0.0, 0.3))], rng))
    assert output.quality.status is Status.FAILED
    assert output.quality.reasons[0] == "not_found"
    assert output.value is None


def test_a_table_alone_has_no_part(rng: np.random.Generator) -> None:
    output = detected(make_dfpc(("bracket", BRACKET)), depth_image([], rng))
    assert output.quality.reasons == ("not_found", "no_part")


@pytest.mark.parametrize(
    ("factor", "reason"), [(0.0, "few_points"), (1000.0, "not_found"), (0.001, "not_found")]
)
def test_empty_images_and_wrong_units_are_refused(
    rng: np.random.Generator, factor: float, reason: str
) -> None:
    image = depth_image([(BRACKET, on_table(0.0, 0.0, 0.3))], rng)
    scaled = DistanceImage(
        width=image.width,
        height=image.height,
        scale_x=image.scale_x,
        scale_y=image.scale_y,
        center_x=image.center_x,
        center_y=image.center_y,
        data=factor * image.data,
    )
    output = detected(make_dfpc(("bracket", BRACKET)), scaled)
    assert output.quality.status is Status.FAILED
    assert any(r.startswith(reason) for r in output.quality.reasons)


def test_a_cut_image_is_bad_input(rng: np.random.Generator) -> None:
    cut = DistanceImage(width=320, height=240, scale_x=0.01, scale_y=0.01, data=np.ones(100))
    output = detected(make_dfpc(("bracket", BRACKET)), cut)
    assert output.quality.status is Status.FAILED
    assert "100 distances" in output.quality.reasons[0]


def test_an_image_waits_for_the_first_model(rng: np.random.Generator) -> None:
    dfpc = make_dfpc()
    image = depth_image([(BRACKET, on_table(0.0, 0.0, 0.3))], rng)
    assert list(dfpc.step(Sample("depth", 0, 0, image))) == []
    (output,) = dfpc.step(Sample("model", 0, 0, Mesh.from_arrays(*BRACKET, frame="b/body", stamp_ns=0)))
    assert output.value is not None
    dfpc = make_dfpc()
    dfpc.step(Sample("depth", 0, 0, image))
    (output,) = dfpc.finish()
    assert output.quality.reasons == ("no_model",)


@pytest.mark.slow
def test_the_cube_of_visp_is_found_and_not_in_a_kitchen(real_data: Callable[[str], Path]) -> None:
    from evaluation import model_detection as evaluated

    data = real_data("visp_rbt_rgbd").parent
    rows = evaluated.tracked_rows(data, "cube", frames=(69, 77))
    assert all(row["is_found"] and row["m"] < 0.02 and row["deg"] < 8.0 for row in rows)
    assert not any(evaluated.kitchen_rows(real_data("seven_scenes_redkitchen").parent, "cube", every=200))
