# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compilation of the kernels that detect and track known bodies in scans."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from cdff_common.geometry import se3
from cdff_common.interfaces.registry import Registry
from cdff_core.dfns.model_preparation.interface import ModelPreparationInputs
from cdff_core.dfns.model_registration.interface import ModelRegistrationInputs
from cdff_core.object_models.scan_detection import DetectionLimits, ScanDetector, surface_ports

#: Vertices of a wedge without symmetry, metres, with which the kernels are compiled, and its distance from
#: the sensor.
_VERTICES = np.array([[0, 0, 0], [1.0, 0, 0], [0, 0.7, 0], [0, 0, 0.4]])
_TRIANGLES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
#: Distance of the tetrahedron from the camera.
_DISTANCE_M = 5.0
_COARSE = {"points": 1000, "views": 60, "view_pixels": 64, "grid_cells": 16}


@cache
def compile_kernels() -> None:
    """Detect and register a wedge, once in this process: the first scan takes no longer than the others."""
    registry = Registry.default()

    def dfn(name: str, parameters: dict[str, Any] | None = None) -> Any:
        instance = registry.make_dfn(name)
        instance.configure(parameters)
        return instance

    model = dfn("model_preparation", _COARSE).process(
        ModelPreparationInputs(vertices=_VERTICES, triangles=_TRIANGLES)
    )
    T = se3.transform(np.eye(3), [0.0, 0.0, _DISTANCE_M])
    scan = se3.transform_points(T, model.points[model.normals[:, 2] < 0.0])
    detector = ScanDetector(
        dfn("model_pose_search", {"rolls": 4, "hypotheses": 3}),
        dfn("model_pose_refinement"),
        DetectionLimits(0.0, 10, 0.0, 10.0),
    )
    detector.detect("wedge", model, scan, {})
    inputs = ModelRegistrationInputs(
        scan=scan,
        pose=T,
        drawn_vertices=model.drawn_vertices,
        drawn_triangles=model.drawn_triangles,
        centre_m=model.centre_m,
        sigma_m=0.01,
        **surface_ports(model),
    )
    dfn("model_registration").process(inputs)
