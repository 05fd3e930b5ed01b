# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Layout of the Rerun viewer: one tab a robot, with space, images, quality, timing and messages."""

from __future__ import annotations

from typing import Any

import rerun.blueprint as rrb

from cdff_dev.view.feed import Contents

#: Most images of a robot that are shown side by side; the others are in further tabs.
_MAX_PICTURES = 8


def blueprint(contents: Contents) -> rrb.Blueprint:
    """Return the layout for the contents of a scene."""
    tabs = [_robot_tab(contents, robot) for robot in contents.robots() if robot != "frames"]
    return rrb.Blueprint(rrb.Tabs(*tabs), collapse_panels=True)


def _robot_tab(contents: Contents, robot: str) -> Any:
    prefix = f"/{robot}/"
    own_roots = {contents.root_of(f) for n, f in contents.spatial.items() if n.startswith(prefix) and f}
    roots = [root for root in contents.roots() if root in own_roots]
    spaces = [_space(contents, root) for root in roots]
    pictures = sorted(name for name in contents.pictures if name.startswith(prefix))
    below: list[Any] = [
        rrb.Spatial2DView(origin=name, name=name.removeprefix(prefix)) for name in pictures[:_MAX_PICTURES]
    ]
    plots = [
        rrb.TimeSeriesView(origin="/", contents=sorted(names), name=title)
        for title, names in _plots(contents, prefix).items()
    ]
    notes = sorted(name for name in contents.notes if name.startswith(prefix))
    side: list[Any] = []
    if below:
        side.append(rrb.Tabs(*below) if len(below) > 2 else rrb.Vertical(*below))
    if plots:
        side.append(rrb.Tabs(*plots))
    if notes:
        side.append(rrb.TextLogView(origin="/", contents=notes, name="Messages"))
    main = rrb.Tabs(*spaces) if len(spaces) > 1 else (spaces[0] if spaces else None)
    parts = [part for part in (main, rrb.Vertical(*side) if side else None) if part is not None]
    shares = [2, 1] if len(parts) == 2 else None
    return rrb.Horizontal(*parts, column_shares=shares, name=robot)


def _space(contents: Contents, root: str) -> rrb.Spatial3DView:
    """Return the view of everything below a root; true poses are included."""
    inside = [name for name, frame in contents.spatial.items() if contents.root_of(frame) == root]
    is_camera = _is_camera(contents, root)
    cameras = [name for name, frame in contents.pictures.items() if frame and contents.root_of(frame) == root]
    return rrb.Spatial3DView(
        origin="/",
        contents=sorted([*inside, *cameras]),
        name=root,
        line_grid=not is_camera,  # the grid is the plane of x and y
        spatial_information=rrb.SpatialInformation(target_frame=root),
        eye_controls=rrb.EyeControls3D(eye_up=(0, -1, 0) if is_camera else (0, 0, 1)),
    )


def _is_camera(contents: Contents, root: str) -> bool:
    """Return whether a root has the axes of a camera, y down: images are in it or in one of its children."""
    frames = set(contents.pictures.values())
    return root in frames or any(contents.parent_of.get(frame) == root for frame in frames)


def _plots(contents: Contents, prefix: str) -> dict[str, list[str]]:
    """Return the plots of a robot by title: of uncertainty, timing, and each other group of numbers."""
    groups: dict[str, list[str]] = {}
    for name in contents.numbers:
        if name.startswith(prefix):
            parts = name.removeprefix(prefix).split("/")
            group = "timing" if "timing" in parts else parts[-1] if "sigma_m" in parts else "quality"
            title = group if "quality" in parts or "timing" in parts else "/".join(parts[:-1])
            groups.setdefault(title, []).append(name)
    return dict(sorted(groups.items(), key=lambda item: (item[0] != "sigma_m", item[0])))
