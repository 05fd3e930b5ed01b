# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Layout of Foxglove: one tab per robot, with 3D scenes, images, quality, timing and messages."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from foxglove import layouts as fl

from cdff_dev.view.feed import Contents
from cdff_dev.view.panels import OVERLAY_OPACITY, ImagePanel, Panels, Scene3D, panels_of


def layout_of(contents: Contents) -> fl.Layout:
    """Return the layout for the contents of a scene."""
    tabs = [fl.TabItem(title=panels.robot, content=_robot(panels)) for panels in panels_of(contents)]
    return fl.Layout(content=fl.TabContainer(tabs=tabs))


def _robot(panels: Panels) -> fl.SplitContainer:
    """Return the panels of a robot."""
    scenes = [fl.TabItem(title=scene.root, content=_scene(scene)) for scene in panels.scenes]
    side = (
        [fl.TabItem(title=image.title, content=_image(image)) for image in panels.images],
        [fl.TabItem(title=title, content=_plot(names)) for title, names in panels.plots.items()],
        [fl.TabItem(title=name.split("/", 2)[-1], content=_log(name)) for name in panels.notes],
    )
    rows = [fl.SplitItem(content=fl.TabContainer(tabs=tabs)) for tabs in side if tabs]
    share = 1 if panels.images else 2
    columns: list[Any] = []
    if scenes:
        columns.append(fl.SplitItem(proportion=share, content=fl.TabContainer(tabs=scenes)))
    if rows:
        columns.append(fl.SplitItem(content=fl.SplitContainer(direction="column", items=rows)))
    return fl.SplitContainer(items=columns)


def _scene(scene: Scene3D) -> fl.ThreeDeePanel:
    """Return the 3D panel of everything below a root frame."""
    topics: dict[str, Any] = {
        name: fl.BaseRendererSceneUpdateTopicSettings(visible=True) for name in scene.layers
    }
    config = fl.ThreeDeeConfig(fixed_frame=scene.root, follow_tf=scene.root, topics=topics)
    return fl.ThreeDeePanel(config=config)


def _image(image: ImagePanel) -> fl.ImagePanel:
    """Return the panel of an image with its features, detections and disparities."""
    mode = fl.ImageModeConfig(
        image_topic=image.path,
        annotations={name: fl.ImageAnnotationSettings(visible=True) for name in image.marks},
        overlay_topics=[
            fl.ImageOverlayTopicConfig(id=name, topic=name, visible=True, opacity=OVERLAY_OPACITY)
            for name in image.pictures
        ],
    )
    return fl.ImagePanel(config=fl.ImageConfig(image_mode=mode))


def _plot(names: Sequence[str]) -> fl.PlotPanel:
    paths = [fl.PlotSeries(value=f"{name}.value", label=name, enabled=True) for name in names]
    return fl.PlotPanel(config=fl.PlotConfig(paths=paths, show_legend=True))


def _log(name: str) -> fl.LogPanel:
    return fl.LogPanel(config=fl.LogConfig(topic_to_render=name))
