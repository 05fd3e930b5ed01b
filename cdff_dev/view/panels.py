# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Panels of each robot, the same for every viewer: 3D scenes, images, plots and messages."""

from __future__ import annotations

from dataclasses import dataclass

from cdff_dev.view.feed import Contents

#: Opacity of an image over another one, such as a disparity.
OVERLAY_OPACITY = 0.5
#: Most images of a robot with a panel.
_MAX_IMAGES = 8
#: First part of the names of fixed frames, which belong to no robot.
_FRAMES = "frames"


@dataclass(frozen=True, slots=True)
class ImagePanel:
    """An image with the layers over it.

    Attributes
    ----------
    path, title : str
    marks : tuple of str
        Layers of features, correspondences and boxes.
    pictures : tuple of str
        Further images of the same camera, such as disparities.
    """

    path: str
    title: str
    marks: tuple[str, ...]
    pictures: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Scene3D:
    """A 3D view of everything below a root of the frame tree.

    Attributes
    ----------
    root : str
    layers : tuple of str
        Spatial layers and cameras; layers of true poses and of other robots are included.
    is_camera : bool
        Whether the root has the axes of a camera, y down.
    """

    root: str
    layers: tuple[str, ...]
    is_camera: bool


@dataclass(frozen=True, slots=True)
class Panels:
    """Panels of a robot, the most important ones first.

    Attributes
    ----------
    robot : str
    scenes : tuple of Scene3D
    images : tuple of ImagePanel
    plots : mapping of str to tuple of str
        Layers with numbers by the title of their plot.
    notes : tuple of str
        Layers with messages.
    """

    robot: str
    scenes: tuple[Scene3D, ...]
    images: tuple[ImagePanel, ...]
    plots: dict[str, tuple[str, ...]]
    notes: tuple[str, ...]


def panels_of(contents: Contents) -> list[Panels]:
    """Return the panels of each robot in the contents of a scene."""
    return [_panels(contents, robot, f"/{robot}/") for robot in contents.robots() if robot != _FRAMES]


def _panels(contents: Contents, robot: str, prefix: str) -> Panels:
    """Return the panels of the contents under a prefix."""
    own_roots = {contents.root_of(f) for n, f in contents.spatial.items() if n.startswith(prefix) and f}
    return Panels(
        robot,
        tuple(_scene(contents, root) for root in contents.roots() if root in own_roots),
        tuple(_image(contents, name, prefix) for name in _images(contents, prefix)[:_MAX_IMAGES]),
        _plots(contents, prefix),
        tuple(sorted(name for name in contents.notes if name.startswith(prefix))),
    )


def _scene(contents: Contents, root: str) -> Scene3D:
    """Return the 3D view of all contents whose frames are connected with ``root``."""
    inside = [name for name, frame in contents.spatial.items() if contents.root_of(frame) == root]
    cameras = [
        name
        for name, frame in contents.pictures.items()
        if frame and contents.root_of(frame) == root and name not in contents.overlays
    ]
    frames = set(contents.pictures.values())
    is_camera = root in frames or any(contents.parent_of.get(frame) == root for frame in frames)
    return Scene3D(root, tuple(sorted([*inside, *cameras])), is_camera)


def _images(contents: Contents, prefix: str) -> list[str]:
    """Return the layers with a panel of their own: images, marks without an image, then overlaid images."""
    on_images = {n for n, picture in contents.overlays.items() if picture and n not in contents.pictures}
    names = {name for name in (*contents.pictures, *contents.overlays) if name.startswith(prefix)}
    return sorted(names - on_images, key=lambda name: (name in contents.overlays, name))


def _image(contents: Contents, path: str, prefix: str) -> ImagePanel:
    over = sorted(name for name, picture in contents.overlays.items() if picture == path)
    marks = tuple(name for name in over if name not in contents.pictures)
    pictures = tuple(name for name in over if name in contents.pictures)
    return ImagePanel(path, path.removeprefix(prefix), marks, pictures)


def _plots(contents: Contents, prefix: str) -> dict[str, tuple[str, ...]]:
    """Return the plots of a robot by title: of uncertainty, timing, and each other group of numbers."""
    groups: dict[str, list[str]] = {}
    for name in contents.numbers:
        if name.startswith(prefix):
            parts = name.removeprefix(prefix).split("/")
            group = "timing" if "timing" in parts else parts[-1] if "sigma_m" in parts else "quality"
            title = group if "quality" in parts or "timing" in parts else "/".join(parts[:-1])
            groups.setdefault(title, []).append(name)
    ordered = sorted(groups.items(), key=lambda item: (item[0] != "sigma_m", item[0]))
    return {title: tuple(sorted(names)) for title, names in ordered}
