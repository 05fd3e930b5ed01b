# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Layout of the Rerun viewer: one tab a robot, with space, images, quality, timing and messages."""

from __future__ import annotations

from typing import Any

import rerun as rr
import rerun.blueprint as rrb

from cdff_dev.view.feed import Contents
from cdff_dev.view.panels import OVERLAY_OPACITY, ImagePanel, Panels, Space, panels_of


def blueprint(contents: Contents) -> rrb.Blueprint:
    """Return the layout for the contents of a scene."""
    return rrb.Blueprint(rrb.Tabs(*map(_robot_tab, panels_of(contents))), collapse_panels=True)


def _robot_tab(panels: Panels) -> Any:
    """Return the tab of a robot: 3D views, images, plots and messages."""
    spaces = [_space(space) for space in panels.spaces]
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
    main = rrb.Tabs(*spaces) if len(spaces) > 1 else (spaces[0] if spaces else None)
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


def _space(space: Space) -> rrb.Spatial3DView:
    """Return the view of everything below a root."""
    return rrb.Spatial3DView(
        origin="/",
        contents=list(space.layers),
        name=space.root,
        line_grid=not space.is_camera,  # the grid is the plane of x and y
        spatial_information=rrb.SpatialInformation(target_frame=space.root),
        eye_controls=rrb.EyeControls3D(eye_up=(0, -1, 0) if space.is_camera else (0, 0, 1)),
    )
