# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Controller of VisualSlam: locate images, make keyframes, close loops, publish poses and map."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from cdff_common.errors import InputError, RefusedError
from cdff_common.interfaces.dfpc import Output, Sample
from cdff_common.interfaces.product import Quality
from cdff_common.types import PoseTrajectory, VisualMap
from cdff_core.dfpcs.visual_slam.configuration import VisualSlamConfig
from cdff_core.dfpcs.visual_slam.interface import VisualSlamInterface
from cdff_core.dfpcs.visual_slam.keyframe_map import VisualKeyframeMap
from cdff_core.dfpcs.visual_slam.keyframe_mapper import KeyframeMapper
from cdff_core.dfpcs.visual_slam.products import ProductBuilder
from cdff_core.dfpcs.visual_slam.view import CameraView, ViewBuilder
from cdff_core.keyframe_graph.checkpoint_schedule import CheckpointSchedule
from cdff_core.stereo_odometry.robot_masks import RobotMasks
from cdff_core.visual_map.features import FeatureExtractor


class VisualSlam(VisualSlamInterface):
    """Poses relative to keyframes, which a pose graph and bundle adjustment keep consistent.

    In the frame ``{robot}/visual_odom`` poses drift but never jump; in ``{robot}/visual_slam``, the map
    frame, loop closures correct them. Both frames start at the first image.
    """

    Config = VisualSlamConfig
    config: VisualSlamConfig

    def setup(self) -> None:
        """Create the DFNs, clear the map, offer the store items."""
        extractor = FeatureExtractor(self.dfn("detect"), self.dfn("describe"))
        self._masks = RobotMasks(self.context)
        self._views = ViewBuilder(
            extractor, self.dfn("disparity"), self.dfn("refine"), self._masks, self.config.depth_offset_m
        )
        self._mapper = KeyframeMapper(self, self.config)
        self.forget()
        self.store.offer("map", self.state)
        self.store.offer("graph", lambda: self._products.graph() if len(self.keyframes) else None)
        self.store.offer("trajectory", lambda: self._products.stored_trajectory())  # noqa: PLW0108  replaced

    def forget(self) -> None:
        """Clear map and trajectory and start again."""
        self._views.clear()
        self._mapper.clear()
        self._products = ProductBuilder(self.name, self.context.robot, self._mapper)
        self._checkpoints = CheckpointSchedule()
        self._last_ns: int | None = None
        self.state_revision += 1

    @property
    def keyframes(self) -> VisualKeyframeMap:
        """Keyframes and pose graph; read-only for callers."""
        return self._mapper.keyframes

    def on_pair(self, sample: Sample) -> Iterable[Output]:
        """Locate the left camera at a pair; the outputs are FAILED if the pair cannot be used."""
        try:
            return self._process(self._views.of_pair(sample))
        except (InputError, RefusedError) as error:
            return self._products.refused(sample.stamp_ns, (sample.id,), Quality.from_error(error))

    def on_image(self, sample: Sample) -> Iterable[Output]:
        """Locate the camera when the depth image of the same time has arrived."""
        return self._on_rgbd(sample)

    def on_depth(self, sample: Sample) -> Iterable[Output]:
        """Locate the camera when the image of the same time has arrived."""
        return self._on_rgbd(sample)

    def on_joints(self, sample: Sample) -> Iterable[Output]:
        """Set the joint positions for the masks of later pairs."""
        self._masks.set_joints(sample.value)
        return ()

    def on_map(self, sample: Sample) -> Iterable[Output]:
        """Import a map: an empty map is replaced by it; otherwise loop closures with it are searched."""
        keys = tuple(self._import(sample.value).values())
        if self.keyframes.root in keys:
            return ()
        self._mapper.connect(keys)
        return self._products.reports(max(sample.stamp_ns, self._products.newest_ns))

    def finish(self) -> Iterable[Output]:
        """Adjust the whole map; publish trajectory, graph, cloud and map."""
        waiting = self._views.take_waiting()
        outputs = [] if waiting is None else self._without_depth(waiting)
        if not len(self.keyframes):
            return outputs
        self._mapper.finish()
        self.state_revision += 1
        return [*outputs, *self._products.final()]

    def export_map(self) -> VisualMap:
        """Return the map; raises ProductNotFoundError without a map."""
        return self._products.visual_map()

    def get_trajectory(self, t0_ns: int, t1_ns: int) -> PoseTrajectory:
        """Return ``T_slam_camera`` between two times; raises ProductNotFoundError without a pose there."""
        return self._products.trajectory(t0_ns, t1_ns)

    def state(self) -> VisualMap | None:
        """Return the map; None before the first keyframe."""
        return self.export_map() if len(self.keyframes) else None

    def resume(self, state: Any) -> None:
        """Import the map of a previous run; raises InputError if ``state`` is not a VisualMap."""
        if not isinstance(state, VisualMap):
            raise InputError(f"{self.name}: state of type {type(state).__name__}, expected VisualMap")
        self.forget()
        self._import(state)

    def _on_rgbd(self, sample: Sample) -> Iterable[Output]:
        try:
            view, incomplete = self._views.of_rgbd(sample)
            outputs = [] if incomplete is None else self._without_depth(incomplete)
            return outputs if view is None else [*outputs, *self._process(view)]
        except (InputError, RefusedError) as error:
            return self._products.refused(sample.stamp_ns, (sample.id,), Quality.from_error(error))

    def _without_depth(self, image: Sample) -> list[Output]:
        """Return FAILED outputs of an image whose depth image did not arrive."""
        quality = Quality.failed("no_depth_image")
        return list(self._products.refused(image.stamp_ns, (image.id,), quality))

    def _process(self, view: CameraView) -> Iterable[Output]:
        """Run the control sequence for one view."""
        if self._last_ns is not None and view.stamp_ns <= self._last_ns:
            raise RefusedError("stamps must increase", [f"stamp_not_after:{self._last_ns}"])
        tracking = self._mapper.add_view(view)
        self._last_ns = view.stamp_ns
        self.state_revision += self._checkpoints.is_due(self._mapper.path_length_m)
        outputs = list(self._products.poses(view, tracking))
        if tracking.is_map_changed:
            outputs += self._products.reports(view.stamp_ns)
        return outputs

    def _import(self, message: VisualMap) -> dict[int, int]:
        self.state_revision += 1
        return self._mapper.import_map(message)
