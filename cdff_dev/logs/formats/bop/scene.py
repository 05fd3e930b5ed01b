# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Scenes of the BOP benchmark as logs: colour and depth images, and the true poses of the objects.

Hodan, T. et al. (2018). BOP: benchmark for 6D object pose estimation. ECCV.
doi:10.1007/978-3-030-01249-6_2
"""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import replace
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np

from cdff_common.camera import CameraModel
from cdff_common.errors import InputError
from cdff_common.geometry import se3
from cdff_common.geometry.se3 import FloatArray
from cdff_dev.logs.file_stamps import PERIOD_NS
from cdff_dev.logs.image_streams import IMAGE_SUFFIXES, Stamps, depth_stream, frame_stream, pose_stream
from cdff_dev.logs.indexed import IndexedLog, IndexedStream
from cdff_dev.logs.other_files import other_files
from cdff_dev.logs.source import Unconverted

ROBOT = "bop"
_COLOUR, _DEPTH = f"/{ROBOT}/colour.frame", f"/{ROBOT}/depth.depth"
#: Translations and depths of BOP are in millimetres; metres of one.
_MM = 1e-3
_MASKS = ("mask", "mask_visib")
#: Largest JSON file of a scene: a larger one would need much memory to parse.
_MAX_JSON_BYTES = 1 << 26


def scene_log(folder: Path) -> IndexedLog:
    """Open a scene: ``rgb`` or ``gray``, ``depth``, ``scene_camera.json`` and ``scene_gt.json``.

    Image n has the stamp n times 100 ms. Streams are ``/bop/colour.frame``, ``/bop/depth.depth``, and for
    each object ``/bop/truth.object_{id}``: its pose in the camera, metres; of several instances of an object
    in an image the first one.

    Raises
    ------
    InputError
        If a file is not as the benchmark defines, or the cameras of the images differ.
    """
    cameras = _json(folder / "scene_camera.json")
    camera, unit_m = _common_camera(folder / "scene_camera.json", cameras)
    streams: dict[str, IndexedStream] = {}
    if colour := _images(folder, ("rgb", "gray")):
        stamps_ns = _stamps([int(file.stem) for file in colour])
        streams[_COLOUR] = frame_stream(_COLOUR, colour, stamps_ns, camera)
    if depth := _images(folder, ("depth",)):
        stamps_ns = _stamps([int(file.stem) for file in depth])
        streams[_DEPTH] = depth_stream(_DEPTH, depth, stamps_ns, camera, unit_m)
    unconverted: dict[str, Unconverted] = {}
    if (truth := folder / "scene_gt.json").is_file():
        added, repeated = _truth_streams(truth, _json(truth), _COLOUR if colour else _DEPTH)
        streams |= added
        if repeated:
            unconverted[truth.name] = Unconverted("pose", repeated, "further instances of the same object")
    for name in _MASKS:
        if count := len(_images(folder, (name,))):
            unconverted[name] = Unconverted("mask", count, "no CDFF type has masks of objects")
    masks = [file for name in _MASKS for file in _images(folder, (name,))]
    used_files = {*colour, *depth, *masks, folder / "scene_camera.json", truth}
    others = other_files(folder, used_files.__contains__, "not an image, a camera or a pose of the scene")
    return IndexedLog(streams, others | unconverted)


def single_frame_log(folder: Path) -> IndexedLog:
    """Open ``rgb.png``, ``depth.png`` and ``truth.json`` with ``camera`` and ``pose``; see ``scene_log``."""
    path = folder / "truth.json"
    document = _json(path)
    if not all(isinstance(document.get(name), dict) for name in ("camera", "pose")):
        raise InputError(f"{path}: expected the objects camera and pose")
    camera, unit_m = _common_camera(path, {"0": document["camera"]})
    stamps_ns = _stamps([0])
    streams, _ = _truth_streams(path, {"0": [document["pose"]]}, _COLOUR)
    streams[_COLOUR] = frame_stream(_COLOUR, [folder / "rgb.png"], stamps_ns, camera)
    streams[_DEPTH] = depth_stream(_DEPTH, [folder / "depth.png"], stamps_ns, camera, unit_m)
    read = ("rgb.png", "depth.png", path.name)
    reason = f"not one of {', '.join(read)}"
    return IndexedLog(streams, other_files(folder, lambda file: file.name in read, reason))


def _json(path: Path) -> dict[str, Any]:
    """Return the object in a JSON file; raises InputError."""
    if path.stat().st_size > _MAX_JSON_BYTES:
        raise InputError(f"{path}: {path.stat().st_size} bytes, expected at most {_MAX_JSON_BYTES}")
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: not JSON: {error}") from error
    if not isinstance(document, dict) or not document:
        raise InputError(f"{path}: expected a JSON object with an entry for each image")
    return document


def _common_camera(path: Path, cameras: Mapping[str, Any]) -> tuple[CameraModel, float]:
    """Return the camera of all images, without size, and the metres of a depth value of 1."""
    try:
        cameras_and_scales = {
            (*(float(v) for v in entry["cam_K"]), float(entry.get("depth_scale", 1.0)))
            for entry in cameras.values()
        }
        if len(cameras_and_scales) > 1:
            raise ValueError(f"{len(cameras_and_scales)} different cameras")
        *matrix, scale = next(iter(cameras_and_scales))
        camera = CameraModel.from_matrix(np.reshape(matrix, (3, 3)))
    except (KeyError, TypeError, ValueError, InputError) as error:
        raise InputError(
            f"{path}: {type(error).__name__} {error}; expected one cam_K for all images"
        ) from error
    return replace(camera, rows=0, cols=0), scale * _MM


def _truth_streams(
    path: Path, poses: Mapping[str, Sequence[Mapping[str, Any]]], images: str
) -> tuple[dict[str, IndexedStream], int]:
    """Return a stream of poses for each object, and the number of poses of further instances.

    The poses are those in the frame of the stream of ``images``: colour and depth images have one camera.
    """
    camera = images.removeprefix("/").rpartition(".")[0]
    tracks: dict[int, dict[int, FloatArray]] = defaultdict(dict)
    repeated = 0
    try:
        for number, entries in sorted(((int(n), e) for n, e in poses.items()), key=itemgetter(0)):
            for entry in entries:
                track = tracks[int(entry["obj_id"])]
                if number in track:
                    repeated += 1
                    continue
                R = np.array(entry["cam_R_m2c"], dtype=np.float64).reshape(3, 3)
                t_m = np.array(entry["cam_t_m2c"], dtype=np.float64).reshape(3) * _MM
                if not np.all(np.isfinite([*R.ravel(), *t_m])):
                    raise ValueError(f"a pose of object {entry['obj_id']} in image {number} is not finite")
                track[number] = se3.transform(se3.normalise_rotation(R), t_m)
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{path}: {type(error).__name__} {error}; expected poses of objects") from error
    streams = {}
    for object_id, track in tracks.items():
        name, T = f"/{ROBOT}/truth.object_{object_id}", np.array(list(track.values()))
        child = f"{ROBOT}/object_{object_id}"
        streams[name] = pose_stream(name, T, _stamps(list(track)), parent=camera, child=child)
    return streams, repeated


def _images(folder: Path, names: Sequence[str]) -> list[Path]:
    """Return the images of the first sub-folder that exists, in the order of their numbers."""
    for name in names:
        if (folder / name).is_dir():
            return sorted(
                file
                for file in (folder / name).iterdir()
                if file.suffix in IMAGE_SUFFIXES and file.stem.split("_")[0].isdigit()
            )
    return []


def _stamps(numbers: Sequence[int]) -> Stamps:
    return np.array(numbers, np.int64) * PERIOD_NS
