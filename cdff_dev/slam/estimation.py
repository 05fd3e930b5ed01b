# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Estimation of a trajectory and a map from a log by one compound."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import InputError, RefusedError
from cdff_common.interfaces.dfpc import Dfpc, DfpcContext
from cdff_common.interfaces.product import Product, Status
from cdff_common.interfaces.profile import load_profile
from cdff_common.interfaces.registry import Registry
from cdff_common.progress import Progress
from cdff_common.types import LidarScan
from cdff_core.runtime import Runner
from cdff_dev.compare.trajectory.track import Track
from cdff_dev.compilation import compilation_notice
from cdff_dev.logs.source import LogSource, only_stream
from cdff_dev.replay.engine import samples_of
from cdff_dev.replay.wiring import robot_of, wire
from cdff_dev.slam.methods import RGBD_SLAM, Method
from cdff_dev.slam.true_poses import TruePoses, true_poses

#: Largest share of FAILED poses of a result: the path after each is continued by a prediction.
_MAX_FAILED = 0.05
#: Largest share of FAILED poses, and of images that are not in the trajectory, if parts are merged.
_MAX_FAILED_PARTS, _MAX_MISSING = 0.5, 0.2
#: Smallest share of the points of a sweep within the range limits without a message that states the ranges.
_MIN_IN_RANGE = 0.1
#: Largest difference of the times of an image and its depth image.
_DEPTH_TOLERANCE_NS = 50_000_000
#: Content without a stream that a calibration would make usable.
_CAMERA_CONTENT = ("image", "calibration", "stereo camera")
#: Largest number of streams that a message names; of more streams it states the number of each type.
_MAX_NAMED = 8


@dataclass(frozen=True, slots=True, eq=False)
class Estimation:
    """Result of a run.

    Attributes
    ----------
    method : Method
    track : Track
        Poses T_first_current: corrected by loop closures if the compound has a trajectory.
    child : str
        Frame whose poses these are: the base of the robot or, without a profile, the sensor.
    values : dict of str to Any
        Last values of the other output ports.
    products : list of Product
        All poses with their quality, and the last products of the other ports.
    truth : TruePoses
        True poses of the log.
    step_s : NDArray[np.float64], shape (n,)
        Elapsed time of each sample of the sensor, seconds.
    run : dict
        Configuration, counts and cost, for ``run.json``.
    """

    method: Method
    track: Track
    child: str
    values: dict[str, Any]
    products: list[Product]
    truth: TruePoses
    step_s: NDArray[np.float64]
    run: dict[str, Any]


@dataclass(slots=True)
class _Outputs:
    """Poses and last products of the outputs of a run.

    ``reordered`` counts the samples of the sensor before which stamps go backwards in the recording.
    ``statuses`` and ``reasons`` count the poses with each status, and those with each reason that are not OK.
    """

    poses: dict[int, Any] = field(default_factory=dict)
    child: str = ""
    products: list[Product] = field(default_factory=list)
    last: dict[str, Product] = field(default_factory=dict)
    step_s: list[float] = field(default_factory=list)
    reordered: int = 0
    statuses: dict[str, int] = field(default_factory=dict)
    reasons: dict[str, int] = field(default_factory=dict)

    def add(self, product: Product) -> None:
        """Add a product: poses are collected and their status counted, of
        other ports the last one is kept.
        """
        if product.port != "pose":
            if product.value is not None:
                self.last[product.port] = product
            return
        quality = product.header.quality
        self.statuses[quality.status.name] = self.statuses.get(quality.status.name, 0) + 1
        names = {reason.split(":")[0] for reason in quality.reasons}
        for name in names if quality.status is not Status.OK else ():
            self.reasons[name] = self.reasons.get(name, 0) + 1
        if product.value is not None:
            self.poses[product.header.t1_ns] = product.value.transform
            self.child = product.header.child or ""
            self.products.append(product)

    @property
    def values(self) -> dict[str, Any]:
        """Last values of the ports other than the pose."""
        return {port: product.value for port, product in self.last.items()}


def estimate(
    method: Method, log: LogSource, name: str, profile: str | None = None, stream: str | None = None
) -> Estimation:
    """Pass the samples of a log to the compound of a method.

    Parameters
    ----------
    name : str
        Name of the log, for messages and ``run.json``.
    profile : str, optional
        Profile with frames and parameters of the robot.
    stream : str, optional
        Stream of the sensor; required if several have its type.

    Raises
    ------
    InputError
        If the log has no sensor of the method.
    RefusedError
        If more than 5 % of the poses are FAILED.
    """
    types = {stream_name: info.type_name for stream_name, info in log.streams.items()}
    if method.type_name not in types.values():
        raise InputError(
            f"{name}: no {method.type_name} for cdff {method.name}: it has {_contents(types)}; {method.hint}"
            + "".join(
                f"; {unused}: {item.reason}"
                for unused, item in log.unconverted.items()
                if item.type_name in _CAMERA_CONTENT
            )
        )
    sensor = sensor_stream(method, log, stream)
    robot = robot_of({sensor: types[sensor]}, None)
    dfpc = _configure_dfpc(method, robot, profile)
    chosen = {method.port: sensor}
    if method is RGBD_SLAM:
        chosen["depth"] = depth_stream(log, sensor)
    wired = wire(dfpc.description, types, robot, chosen)
    outputs, cost = _run(dfpc, method, log, wired, robot)
    n = sum(outputs.statuses.values())
    if not outputs.poses or _is_incomplete(method, outputs):
        raise RefusedError(_refusal(method, log, sensor, name, outputs) + _range_note(dfpc, log, sensor))
    run = {
        "log": name,
        "streams": wired,
        "dfpc": dfpc.name,
        "implementation": dfpc.implementation,
        "config_hash": dfpc.config_hash,
        "parameters": dfpc.config.model_dump(mode="json"),
        "poses": n,
        "statuses": outputs.statuses,
        "reasons": outputs.reasons,
        "stamps_backwards": outputs.reordered,
        **cost,
    }
    return Estimation(
        method=method,
        track=_track(outputs),
        child=outputs.child,
        values=outputs.values,
        products=[*outputs.products, *outputs.last.values()],
        truth=true_poses(log, outputs.child),
        step_s=np.array(outputs.step_s),
        run=run,
    )


def sensor_stream(method: Method, log: LogSource, stream: str | None = None) -> str:
    """Return the stream of the sensor; of several streams of images, the only one with simultaneous depth
    images.
    """
    if stream is None and method is RGBD_SLAM:
        images = [name for name, info in log.streams.items() if info.type_name == method.type_name]
        with_depth = [name for name in images if _has_depths(log, name)]
        stream = with_depth[0] if len(with_depth) == 1 else None
    return only_stream(log, [method.type_name], stream, f"type {method.type_name}")


def depth_stream(log: LogSource, images: str) -> str:
    """Return the stream of the depth images of a stream of images.

    Of several with the same times it is the only one in the frame of the images: drivers offer depth images
    as measured, and others that are computed for the colour camera. Raises InputError if there are several.
    """
    names = [name for name, info in log.streams.items() if info.type_name == "DistanceImage"]
    in_time = [name for name in names if _are_in_time(log, images, name)] or names
    if len(in_time) > 1:
        first_samples = log.first_samples([images, *in_time])
        frames = {name: s.header.frame for name, s in first_samples.items() if s.header is not None}
        same = [name for name in in_time if name in frames and frames[name] == frames.get(images)]
        in_time = same if len(same) == 1 else in_time
    if len(in_time) > 1:
        raise InputError(
            f"{len(in_time)} streams of depth images for {images}: {', '.join(in_time)}; expected one of "
            "them in the frame of the images, or a log with one (cdff log cut --stream)"
        )
    return in_time[0]


def _has_depths(log: LogSource, images: str) -> bool:
    """Return whether most images of a stream have a depth image of the same time."""
    names = [name for name, info in log.streams.items() if info.type_name == "DistanceImage"]
    return any(_are_in_time(log, images, name) for name in names)


def _are_in_time(log: LogSource, images: str, depths: str) -> bool:
    """Return whether most images of a stream have a sample of another at the same time."""
    stamps_ns, others_ns = log.stamps_ns(images), np.sort(log.stamps_ns(depths))
    if not len(stamps_ns) or not len(others_ns):
        return False
    after = np.searchsorted(others_ns, stamps_ns).clip(0, len(others_ns) - 1)
    nearest_ns = [others_ns[after], others_ns[(after - 1).clip(0)]]
    gaps_ns = np.abs(np.array(nearest_ns) - stamps_ns).min(axis=0)
    return bool(np.mean(gaps_ns <= _DEPTH_TOLERANCE_NS) > 0.5)


def _contents(types: Mapping[str, str]) -> str:
    """Return the streams of a log with their types, or the types of many streams with their numbers."""
    if len(types) <= _MAX_NAMED:
        return ", ".join(f"{name} ({type_name})" for name, type_name in types.items()) or "no streams"
    counts = Counter(types.values())
    return ", ".join(f"{count} streams of {type_name}" for type_name, count in counts.most_common())


def too_many_failed(statuses: Mapping[str, int]) -> bool:
    """Return whether more than 5 % of the poses are FAILED; ``statuses`` counts the poses by status."""
    return statuses.get("FAILED", 0) > _MAX_FAILED * sum(statuses.values())


def _configure_dfpc(method: Method, robot: str, profile: str | None) -> Dfpc:
    """Return the DFPC of a method, configured by the profile if there is one."""
    dfpc = Registry.default().make_dfpc(method.dfpc)
    context, parameters, implementation = DfpcContext(robot), {}, None
    if profile is not None:
        of_robot = load_profile(profile).robot(robot)
        entry = of_robot.dfpc(method.dfpc)
        context, parameters = of_robot.context(entry), dict(entry.parameters)
        implementation = entry.implementation
    with compilation_notice(dfpc.name):
        dfpc.configure(parameters, context, implementation)
    return dfpc


def _run(
    dfpc: Dfpc, method: Method, log: LogSource, wired: dict[str, str], robot: str
) -> tuple[_Outputs, dict[str, float]]:
    """Return the outputs, and wall and CPU seconds; ends once too many of all poses have failed."""
    runner, outputs = Runner(dfpc), _Outputs()
    count = log.streams[wired[method.port]].count
    progress = Progress(count, method.unit)
    start_s, cpu_start_s = time.monotonic(), time.process_time()
    last_seq = -1
    for sample in samples_of(log, wired, robot):
        step_start_s = time.monotonic()
        runner.push(sample)
        for product in runner.drain():
            outputs.add(product)
        if sample.port == method.port:
            outputs.step_s.append(time.monotonic() - step_start_s)
            outputs.reordered += sample.seq < last_seq
            last_seq = sample.seq
            progress.advance()
        limit = _MAX_FAILED_PARTS if method.merges_parts else _MAX_FAILED
        if outputs.statuses.get("FAILED", 0) > limit * count:
            break
    for product in runner.finish():
        outputs.add(product)
    progress.close()
    if runner.counters.errors and not outputs.poses:
        raise InputError(f"{dfpc.name}: every sample was refused; the last: {runner.counters.last_error}")
    return outputs, {"wall_s": time.monotonic() - start_s, "cpu_s": time.process_time() - cpu_start_s}


def _is_incomplete(method: Method, outputs: _Outputs) -> bool:
    """Return whether too many poses are FAILED or, if parts are merged, not in the trajectory."""
    trajectory = outputs.values.get("trajectory")
    if not method.merges_parts or trajectory is None:
        return too_many_failed(outputs.statuses)
    return len(trajectory.stamps_ns) < (1.0 - _MAX_MISSING) * sum(outputs.statuses.values())


def _refusal(method: Method, log: LogSource, sensor: str, name: str, outputs: _Outputs) -> str:
    """Return why there is no result: shares of failures, their reasons, and the time between samples."""
    n_failed, n = outputs.statuses.get("FAILED", 0), sum(outputs.statuses.values())
    info = log.streams[sensor]
    period_s = (info.t1_ns - info.t0_ns) * 1e-9 / max(info.count - 1, 1)
    reasons = ", ".join(sorted(outputs.reasons, key=lambda name: (-outputs.reasons[name], name))[:3])
    jumps = f"; their stamps go backwards {outputs.reordered} times" if outputs.reordered else ""
    part = f"the first {n}" if n < info.count else str(n)
    return (
        f"{name}: {n_failed} of {part} {method.unit} were not located ({reasons or 'no output'}); they are "
        f"{period_s:.2f} s apart: {method.dfpc} needs {method.unit} that overlap from one to the next{jumps}"
    )


def _range_note(dfpc: Dfpc, log: LogSource, sensor: str) -> str:
    """Return the ranges of the first sweep if few of them are among those that the compound uses."""
    scan = log.first_samples([sensor])[sensor].value
    limits = (getattr(dfpc.config, name, None) for name in ("min_range_m", "max_range_m"))
    least_m, most_m = limits
    if not isinstance(scan, LidarScan) or least_m is None or most_m is None or not len(scan.points_m):
        return ""
    ranges_m = np.linalg.norm(scan.points_m, axis=1)
    if np.mean((ranges_m > least_m) & (ranges_m < most_m)) > _MIN_IN_RANGE:
        return ""
    low, median, high = (f"{float(f'{r:.3g}'):g}" for r in np.quantile(ranges_m, (0.05, 0.5, 0.95)))
    return (
        f"; the points of the first sweep are {low} to {high} m away, half of them nearer than {median} m, "
        f"and only those from {least_m:g} to {most_m:g} m are used: expected metres, or min_range_m and "
        "max_range_m in a profile"
    )


def _track(outputs: _Outputs) -> Track:
    """Return the poses relative to the first pose, as corrected by the last loop closure."""
    trajectory = outputs.values.get("trajectory")
    if trajectory is not None and len(trajectory.stamps_ns):
        return Track("estimate", trajectory.stamps_ns, trajectory.matrices, trajectory.covariances)
    stamps_ns = np.array(sorted(outputs.poses), dtype=np.int64)
    transforms = [outputs.poses[int(stamp)] for stamp in stamps_ns]
    unknown = np.full((6, 6), np.nan)
    covariances = np.array([unknown if T.covariance is None else T.covariance for T in transforms])
    return Track("estimate", stamps_ns, np.array([T.matrix for T in transforms]), covariances)
