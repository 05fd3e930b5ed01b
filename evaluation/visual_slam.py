# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``visual_slam`` on 7-Scenes, EuRoC V1_01 pairs and KITTI, with other programs on the same images."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from cdff_common.arrays import Float32Array, FloatArray
from cdff_common.camera import CameraModel
from cdff_common.geometry import se3
from cdff_common.geometry.covariance import pose_error
from cdff_common.interfaces.dfpc import Dfpc, Output, Sample
from cdff_common.interfaces.product import Status
from cdff_common.interfaces.registry import Registry
from cdff_common.types import DistanceImage, Frame
from cdff_common.types.pose_graph_ext import LOOP_CLOSURE
from cdff_core.imaging.grey import grey_image
from cdff_core.visual_map.keyframe_points import registered_depth
from cdff_dev.logs import open_log
from cdff_dev.logs.source import LogSource
from evaluation.data_sets import euroc, kitti
from evaluation.peers.opencv_chain import Chain, chain, disparity_depth, image_depth
from evaluation.scenes.textured_corridor import Corridor, drive
from evaluation.visual_localisation import (
    EUROC_SIGMAS,
    KITCHEN,
    KITCHEN_OFFSET_M,
    KITCHEN_SIGMAS,
)

PARTS = ("kitchen", "euroc", "kitti", "loops", "corridor", "speed")
#: Accuracy of the reference poses of KITTI, metres and degrees.
KITTI_SIGMAS = (0.05, 0.2)
#: Time between two frames of the kitchen's sequence.
_FRAME_NS = 100_000_000
#: Frames of the map and of the revisit.
_MAPPED, _REVISIT = (220, 240), (260, 580)
#: Smallest ratio of the points of a frame that another frame of the same place shows, and tolerance of their
#: depths, as a ratio.
_COMMON, _DEPTH_TOLERANCE = 0.3, 0.1
_FALSE_M, _FALSE_DEG = 0.25, 10.0
_CHAIN = "OpenCV chain"
#: Distance between two pairs of the simulated drives.
_STEP_M = 0.3
_SIMULATED_SIGMAS = (1e-6, 1e-4)
_PORTS = {"FramePair": "pair", "Frame": "image", "DistanceImage": "depth"}


def evaluate(
    data: Path, progress: Callable[[str], None], parts: Sequence[str] = PARTS
) -> dict[str, dict[str, Any]]:
    """Return the figures of each part."""
    methods = {"kitchen": _kitchen, "euroc": _euroc, "kitti": _kitti, "loops": _loops}
    methods |= {"corridor": _corridor, "speed": _speed}
    figures = {}
    for part in parts:
        progress(f"visual slam: {part}")
        figures[part] = methods[part](data)
    return figures


def table(figures: dict[str, dict[str, Any]]) -> str:
    """Return the tables of the page."""
    lines = []
    for part, name in (("kitchen", "7-Scenes kitchen"), ("euroc", "EuRoC V1_01"), ("kitti", "KITTI 06")):
        lines += [
            f"| {name} | images | in the largest component | ATE online | ATE final | scale | rotation "
            "| keyframes, loops "
            "| NEES / 6 (1 expected) | CPU s |",
            "|---" * 10 + "|",
        ]
        lines += [_row(method, f) for method, f in figures.get(part, {}).items()]
        lines.append("")
    if measured := figures.get("kitti"):
        values = ", ".join(f"{name} {f['measured_end_percent']} %" for name, f in measured.items())
        lines += [f"KITTI, end error over the part with a measured reference: {values}.", ""]
    loops = figures.get("loops", {})
    if loops:
        lines += [
            "| loops | frames | recognised | false |",
            "|---|---|---|---|",
            f"| frames that show the place | {loops['same_place']} | {loops['recognised']} "
            f"| {loops['false']} |",
            f"| other frames | {loops['other_place']} | {loops['recognised_elsewhere']} "
            f"| {loops['false_elsewhere']} |",
        ]
    corridor = figures.get("corridor", {})
    if corridor:
        lines += [
            "",
            "| simulated corridor | pairs, path | odometry | online | final | loops | false loops | CPU s |",
            "|---" * 8 + "|",
        ]
    lines += [
        f"| {name} | {f['images']}, {f['path_m']} m | {f['odometry_mm']} mm | {f['online_mm']} mm "
        f"| {f['final_mm']} mm | {f['loops']} | {f['false_loops']} | {f['cpu_s']} |"
        for name, f in corridor.items()
    ]
    if speed := figures.get("speed"):
        lines += [
            "",
            "| pairs of 752 x 480 | located | keyframes | CPU s per pair | rate on one core |",
            "|---|---|---|---|---|",
            f"| {speed['images']} | {speed['located']} | {speed['keyframes']} | {speed['cpu_s']} "
            f"| {speed['rate_hz']} Hz |",
        ]
    return "\n".join(lines)


def _row(method: str, row: dict[str, Any]) -> str:
    online = f"{row['online_mm']} mm" if "online_mm" in row else "–"
    size = f"{row['keyframes']}, {row['loops']}" if "keyframes" in row else "–"
    return (
        f"| {method} | {row['images']} | {row['located']} | {online} | {row['final_mm']} mm | {row['scale']} "
        f"| {row['rotation_deg']}° | {size} | {row.get('nees_per_freedom', '–')} | {row['cpu_s']} |"
    )


def _corridor(data: Path) -> dict[str, Any]:
    """Return the figures of drives around a corridor, also with four sides that look the same."""
    figures = {}
    for name, laps, twins in (("four different sides", 1.5, False), ("four equal sides", 1.2, True)):
        world, run, dfpc = Corridor(seed=1, twins=twins), _Run(), _new({})
        truth, odometry = {}, {}
        for i, T in enumerate(drive(laps, _STEP_M)):
            stamp = (i + 1) * _FRAME_NS
            truth[stamp] = T
            pair = world.pair(T)
            for output in _add(run, dfpc, [Sample("pair", stamp, i, pair)]):
                if output.port == "odometry" and output.value is not None:
                    odometry[stamp] = np.array(output.value.transform.matrix)
        false = _finish(run, dfpc, truth)
        path = np.array([T[:3, 3] for T in truth.values()])
        figures[name] = {
            **_figures(run, truth, _SIMULATED_SIGMAS),
            "path_m": round(float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum()), 1),
            "odometry_mm": _accuracy(odometry, truth)["final_mm"],
            "false_loops": false,
        }
    return figures


def _speed(data: Path) -> dict[str, Any]:
    """Return the CPU time for a stereo pair of a drive: 60 pairs of 752 x 480 pixels, one every 0.15 m."""
    world, run, dfpc = Corridor(seed=1, magnification=2), _Run(), _new({})
    for i, T in enumerate(islice(drive(1.0, 0.5 * _STEP_M), 60)):
        _add(run, dfpc, [Sample("pair", (i + 1) * _FRAME_NS, i, world.pair(T))])
    cpu_s = run.cpu_s / run.images
    return {
        "images": run.images,
        "located": len(run.online),
        "keyframes": len(dfpc.call("export_map", {}).keyframes),
        "cpu_s": round(cpu_s, 3),
        "rate_hz": round(1.0 / cpu_s, 1),
    }


@dataclass(slots=True)
class _Run:
    """Result of a run: poses with covariance by stamp, trajectory and map at the end, cost."""

    online: dict[int, tuple[FloatArray, FloatArray]] = field(default_factory=dict)
    final: dict[int, FloatArray] = field(default_factory=dict)
    images: int = 0
    cpu_s: float = 0.0
    metrics: dict[str, float] = field(default_factory=dict)


def _kitchen(data: Path) -> dict[str, Any]:
    log = open_log(data / KITCHEN)
    T_depth_colour = se3.inverse(se3.transform(np.eye(3), KITCHEN_OFFSET_M))
    truth = {stamp: T @ T_depth_colour for stamp, T in _truth(log).items()}
    run = _run(log, {"depth_offset_m": KITCHEN_OFFSET_M})
    frames = _rgbd_frames(log)
    log.close()
    offset = se3.transform(np.eye(3), KITCHEN_OFFSET_M)
    first = next(iter(frames.values()))[0]
    peer = chain(
        [grey_image(frame) for frame, _ in frames.values()],
        [image_depth(registered_depth(frame, depth, offset)) for frame, depth in frames.values()],
        np.array(first.camera_matrix),
    )
    return {
        "cdff": _figures(run, truth, KITCHEN_SIGMAS),
        _CHAIN: _chain_figures(peer, list(frames), truth),
    }


def _euroc(data: Path) -> dict[str, Any]:
    folder = data / euroc.FOLDER
    log = open_log(folder / "map")
    run, stamps = _run(log, {}), list(_truth(log))
    log.close()
    names = {int(p.name.split("_")[0]) // 1000 for p in (folder / "map").glob("*_0.jpg")}
    views = [v for v in euroc.stereo_views(folder) if v.pair.stamp_ns // 1000 in names]
    pairs = [view.pair for view in views]
    # The log rounds the stamps of the file names, and the views cut them off.
    truth = {min(stamps, key=lambda s: abs(s - v.pair.stamp_ns)): v.T_world_left for v in views}
    K = np.array(pairs[0].camera_matrix)
    peer = chain(
        [grey_image(p.left) for p in pairs],
        [disparity_depth(grey_image(p.right), K[0, 0], float(p.baseline)) for p in pairs],
        K,
    )
    return {
        "cdff": _figures(run, truth, EUROC_SIGMAS),
        _CHAIN: _chain_figures(peer, list(truth), truth),
    }


def _kitti(data: Path) -> dict[str, Any]:
    log = open_log(data / kitti.SEQUENCE)
    truth = _truth(log)
    run = _run(log, {})
    log.close()
    pairs, _ = kitti.read(data / kitti.SEQUENCE)
    started = time.process_time()
    odometry = kitti.run_dfpc(pairs)
    cpu_s = (time.process_time() - started) / len(pairs)
    stamps = sorted(truth)
    figures = {
        "cdff": _figures(run, truth, KITTI_SIGMAS),
        "visual_odometry_sparse": _chain_figures(Chain(odometry, cpu_s), stamps, truth),
    }
    true = np.array([truth[stamp] for stamp in stamps])
    for name, poses in (
        ("cdff", np.array([run.final[stamp] for stamp in stamps])),
        ("visual_odometry_sparse", odometry),
    ):
        figures[name]["measured_end_percent"] = round(kitti.measured_percent(poses, true), 3)
    return figures


def _loops(data: Path) -> dict[str, Any]:
    """Return how many frames of the revisit are located in the map of the first frames."""
    log = open_log(data / KITCHEN)
    T_depth_colour = se3.inverse(se3.transform(np.eye(3), KITCHEN_OFFSET_M))
    truth = {stamp: T @ T_depth_colour for stamp, T in _truth(log).items()}
    frames = {stamp // _FRAME_NS: (stamp, *f) for stamp, f in _rgbd_frames(log).items()}
    log.close()
    mapped = {n: f for n, f in frames.items() if _MAPPED[0] <= n <= _MAPPED[1]}
    revisit = {n: f for n, f in frames.items() if _REVISIT[0] <= n <= _REVISIT[1]}
    dfpc = _new({"depth_offset_m": KITCHEN_OFFSET_M})
    for stamp, frame, depth in mapped.values():
        _add_rgbd(dfpc, stamp, frame, depth)
    value = dfpc.call("export_map", {})
    T_world_first = truth[next(iter(mapped.values()))[0]]
    counts = {"same_place": 0, "recognised": 0, "false": 0}
    counts |= {"other_place": 0, "recognised_elsewhere": 0, "false_elsewhere": 0}
    offset = se3.transform(np.eye(3), KITCHEN_OFFSET_M)
    depths = {n: registered_depth(f, d, offset) for n, (_, f, d) in (mapped | revisit).items()}
    camera = CameraModel.of_frame(next(iter(mapped.values()))[1])
    for n, (stamp, frame, depth) in revisit.items():
        common = max(
            _common(camera, depths[m], depths[n], se3.inverse(truth[stamp]) @ truth[s])
            for m, (s, *_) in mapped.items()
        )
        names = ("same_place", "recognised", "false")
        if common < _COMMON:
            names = ("other_place", "recognised_elsewhere", "false_elsewhere")
        counts[names[0]] += 1
        single = _new({"depth_offset_m": KITCHEN_OFFSET_M})
        list(single.step(Sample("map", 0, 0, value)))
        T = _add_rgbd(single, stamp, frame, depth)
        if T is None:
            continue
        e = pose_error(se3.inverse(T_world_first) @ truth[stamp], T)
        is_false = np.linalg.norm(e[:3]) > _FALSE_M or np.degrees(np.linalg.norm(e[3:])) > _FALSE_DEG
        counts[names[2] if is_false else names[1]] += 1
    return counts


def _common(camera: CameraModel, depth: Float32Array, other: Float32Array, T_other_this: FloatArray) -> float:
    """Return the ratio of the points of a depth image that another one shows at their depth."""
    rows, columns = np.nonzero(depth[::8, ::8] > 0.1)
    z = depth[::8, ::8][rows, columns].astype(np.float64)
    rays = camera.rays(8.0 * np.column_stack([columns, rows]))
    points = se3.transform_points(T_other_this, rays / rays[:, 2:] * z[:, None])
    pixels = np.nan_to_num(np.rint(camera.project(points)), nan=-1.0).astype(int)
    inside = (points[:, 2] > 0.1) & (pixels >= 0).all(axis=1)
    inside &= (pixels[:, 0] < other.shape[1]) & (pixels[:, 1] < other.shape[0])
    depth_in_other = other[pixels[inside, 1], pixels[inside, 0]]
    is_same = np.abs(depth_in_other - points[inside, 2]) < _DEPTH_TOLERANCE * points[inside, 2]
    return float(is_same.sum()) / max(len(z), 1)


def _new(parameters: dict[str, Any]) -> Dfpc:
    dfpc = Registry.default().make_dfpc("visual_slam")
    dfpc.configure(parameters)
    return dfpc


def _add_rgbd(dfpc: Dfpc, stamp_ns: int, frame: Frame, depth: DistanceImage) -> FloatArray | None:
    """Return the pose of an image; None if it has none."""
    outputs = [
        *dfpc.step(Sample("image", stamp_ns, 0, frame)),
        *dfpc.step(Sample("depth", stamp_ns, 0, depth)),
    ]
    (pose,) = [output for output in outputs if output.port == "pose"]
    return None if pose.value is None else np.array(pose.value.transform.matrix)


def _run(log: LogSource, parameters: dict[str, Any]) -> _Run:
    """Return the result of the samples of a log."""
    ports = {name: _PORTS[info.type_name] for name, info in log.streams.items() if info.type_name in _PORTS}
    dfpc, run = _new(parameters), _Run()
    _add(
        run,
        dfpc,
        (
            Sample(ports[item.stream], item.stamp_ns, seq, item.value)
            for seq, item in enumerate(log.samples(list(ports)))
        ),
    )
    _finish(run, dfpc, {})
    return run


def _add(run: _Run, dfpc: Dfpc, samples: Iterable[Sample]) -> list[Output]:
    """Pass samples to the compound, add the poses to a run, and return all outputs."""
    collected = []
    for sample in samples:
        started = time.process_time()
        outputs = list(dfpc.step(sample))
        run.cpu_s += time.process_time() - started
        collected += outputs
        for output in outputs:
            if output.port != "pose":
                continue
            run.images += 1
            if output.quality.status is not Status.FAILED:
                T = output.value.transform
                run.online[output.t1_ns] = (np.array(T.matrix), np.array(T.covariance))
    return collected


def _finish(run: _Run, dfpc: Dfpc, truth: dict[int, FloatArray]) -> int:
    """Add the outputs at the end to a run; return the number of loops that contradict the true poses."""
    started = time.process_time()
    outputs = {output.port: output for output in dfpc.finish()}
    run.cpu_s += time.process_time() - started
    run.metrics = dict(outputs["map"].quality.metrics)
    trajectory, graph = outputs["trajectory"].value, outputs["graph"].value
    run.final = dict(zip(trajectory.stamps_ns.tolist(), np.array(trajectory.matrices), strict=True))
    stamps = dict(zip(graph.vertices.ids.tolist(), graph.vertices.stamps_ns.tolist(), strict=True))
    false = 0
    for (a, b), T, kind in zip(
        graph.edges.ends.tolist(), graph.edges.matrices, graph.edges.kinds, strict=True
    ):
        if truth and kind == LOOP_CLOSURE:
            e = pose_error(se3.inverse(truth[stamps[a]]) @ truth[stamps[b]], T)
            false += bool(np.linalg.norm(e[:3]) > _FALSE_M or np.linalg.norm(e[3:]) > np.radians(_FALSE_DEG))
    return false


def _truth(log: LogSource) -> dict[int, FloatArray]:
    (name,) = [name for name in log.streams if "/truth.pose" in name]
    return {s.stamp_ns: np.array(s.value.transform.matrix) for s in log.samples([name])}


def _rgbd_frames(log: LogSource) -> dict[int, tuple[Frame, DistanceImage]]:
    streams = {info.type_name: name for name, info in log.streams.items()}
    depths = {s.stamp_ns: s.value for s in log.samples([streams["DistanceImage"]])}
    return {s.stamp_ns: (s.value, depths[s.stamp_ns]) for s in log.samples([streams["Frame"]])}


def _figures(run: _Run, truth: dict[int, FloatArray], truth_sigmas: tuple[float, float]) -> dict[str, Any]:
    online = _accuracy({stamp: T for stamp, (T, _) in run.online.items()}, truth)
    return {
        "images": run.images,
        "located": len(run.final),
        "online_mm": online["final_mm"],
        **_accuracy(run.final, truth),
        "keyframes": int(run.metrics["keyframes"]),
        "loops": int(run.metrics["loops"]),
        "loops_rejected": int(run.metrics["loops_rejected"]),
        "nees_per_freedom": _nees(run.online, truth, truth_sigmas),
        "cpu_s": round(run.cpu_s / max(run.images, 1), 3),
    }


def _chain_figures(peer: Chain, stamps: Sequence[int], truth: dict[int, FloatArray]) -> dict[str, Any]:
    poses = {stamp: T for stamp, T in zip(stamps, peer.poses, strict=True) if np.isfinite(T).all()}
    return {
        "images": len(stamps),
        "located": len(poses),
        **_accuracy(poses, truth),
        "cpu_s": round(peer.cpu_s, 3),
    }


def _accuracy(poses: dict[int, FloatArray], truth: dict[int, FloatArray]) -> dict[str, float]:
    """Return the errors after alignment by rotation and translation, and the scale of the true path."""
    stamps = sorted(set(poses) & set(truth))
    estimated, true = (np.array([source[stamp] for stamp in stamps]) for source in (poses, truth))
    centred_estimate = estimated[:, :3, 3] - estimated[:, :3, 3].mean(axis=0)
    centred_truth = true[:, :3, 3] - true[:, :3, 3].mean(axis=0)
    U, S, V = np.linalg.svd(centred_truth.T @ centred_estimate)
    signs = np.array([1.0, 1.0, np.sign(np.linalg.det(U @ V))])
    R = U * signs @ V
    errors = np.linalg.norm(centred_truth - centred_estimate @ R.T, axis=1)
    # The positions of a straight path leave a rotation open: orientations are aligned by their mean.
    to_true = true[:, :3, :3] @ np.swapaxes(estimated[:, :3, :3], 1, 2)
    R_mean = se3.normalise_rotation(to_true.mean(axis=0))
    rotation_errors = np.swapaxes(true[:, :3, :3], 1, 2) @ (R_mean @ estimated[:, :3, :3])
    return {
        "final_mm": round(1e3 * float(np.sqrt(np.mean(errors**2))), 1),
        "max_mm": round(1e3 * float(errors.max()), 1),
        "scale": round(float((S * signs).sum() / (centred_estimate**2).sum()), 4),
        "rotation_deg": round(
            float(np.degrees(np.sqrt(np.mean(se3.rotation_angle(rotation_errors) ** 2)))), 3
        ),
    }


def _nees(
    poses: dict[int, tuple[FloatArray, FloatArray]],
    truth: dict[int, FloatArray],
    truth_sigmas: tuple[float, float],
) -> float:
    """Return the mean NEES per degree of freedom of the poses relative to the first one."""
    first = min(stamp for stamp in poses if stamp in truth)
    T_first = se3.inverse(truth[first])
    noise = 2.0 * np.diag(np.repeat([truth_sigmas[0], np.radians(truth_sigmas[1])], 3) ** 2.0)
    squares = []
    for stamp, (T, covariance) in poses.items():
        if stamp != first and stamp in truth:
            e = pose_error(T_first @ truth[stamp], T)
            squares.append(float(e @ np.linalg.solve(covariance + noise, e)))
    return round(float(np.mean(squares)) / 6.0, 2)
