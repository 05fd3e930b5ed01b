# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Scenes in the layout of the BOP benchmark, and single frames with ``truth.json``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from cdff_dev.logs.formats import LogFormat, LogLocation

if TYPE_CHECKING:
    from cdff_dev.logs.indexed import IndexedLog


def is_scene(folder: Path) -> bool:
    """Return True for a folder with ``scene_camera.json``."""
    return (folder / "scene_camera.json").is_file()


def is_single_frame(folder: Path) -> bool:
    """Return True for a folder with ``rgb.png``, ``depth.png`` and ``truth.json``."""
    return all((folder / name).is_file() for name in ("rgb.png", "depth.png", "truth.json"))


def _recognises(location: LogLocation) -> bool:
    return location.folder is not None and (is_scene(location.folder) or is_single_frame(location.folder))


def _open(location: LogLocation, _: Path | None) -> IndexedLog:
    from cdff_dev.logs.formats.bop.scene import scene_log, single_frame_log

    assert location.folder is not None
    return scene_log(location.folder) if is_scene(location.folder) else single_frame_log(location.folder)


FORMAT = LogFormat("BOP scene", "a folder with scene_camera.json and rgb", _recognises, _open)
