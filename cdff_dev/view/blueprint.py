# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Layout of the Rerun viewer: one tab per robot, with 3D scenes, images, quality, timing and messages."""

from __future__ import annotations

from typing import Any

import rerun as rr
import rerun.blueprint as rrb

from cdff_dev.view.feed import Contents
from cdff_dev.view.panels import OVERLAY_OPACITY, ImagePanel, Panels, Scene3D, panels_of


def blueprint(contents: Contents) -> rrb.Blueprint:
    """Return the layout for the contents of a scene."""
    return rrb.Blueprint(rrb.Tabs(*map(_robot_tab, panels_of(contents))), collapse_panels=True)


def _robot_tab(panels: Panels) -> Any:
    """Return the tab of a robot: 3D views, images, plots and messages."""
    scenes = [_scene(scene) for scene in panels.scenes]
    images = [_image(image) for image in panels.images]
    plots = [
        rrb.TimeSeriesView(origin="/", contents=list(names), name=title)
        for title, names in panels.plots.items()
    ]
    side: list[Any] = []
    if images:
        side.append(rrb.Tabs(*images) if len(images) > 2 else rrb.Vertical(*images))
    if plots:
        side.append(rrb.Tabs(*plots))
    if panels.notes:
        columns = rrb.TextLogColumns(text_log_columns=["LogLevel", "Body"])
        side.append(
            rrb.TextLogView(origin="/", contents=list(panels.notes), name="Messages", columns=columns)
        )
    main = rrb.Tabs(*scenes) if len(scenes) > 1 else (scenes[0] if scenes else None)
    parts = [part for part in (main, rrb.Vertical(*side) if side else None) if part is not None]
    shares = None if len(parts) < 2 else [1, 1] if images else [2, 1]
    return rrb.Horizontal(*parts, column_shares=shares, name=panels.robot)


def _image(image: ImagePanel) -> rrb.Spatial2DView:
    """Return the view of an image with its features, detections and disparities."""
    layers = (image.path, *image.pictures, *image.marks)
    return rrb.Spatial2DView(
        origin=image.path,
        contents=[f"{layer}{end}" for layer in layers for end in ("", "/lines")],
        name=image.title,
        overrides={name: rr.Image.from_fields(opacity=OVERLAY_OPACITY) for name in image.pictures},
    )


def _scene(scene: Scene3D) -> rrb.Spatial3DView:
    """Return the 3D view of everything below a root frame."""
    return rrb.Spatial3DView(
        origin="/",
        contents=list(scene.layers),
        name=scene.root,
        line_grid=not scene.is_camera,  # the grid is the plane of x and y
        spatial_information=rrb.SpatialInformation(target_frame=scene.root),
        eye_controls=rrb.EyeControls3D(eye_up=(0, -1, 0) if scene.is_camera else (0, 0, 1)),
    )
