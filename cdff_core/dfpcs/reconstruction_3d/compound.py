# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Controller of Reconstruction3D: queue captures, wait for their poses or determine them, fuse, publish."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np

from cdff_common.arrays import ByteArray, FloatArray
from cdff_common.errors import (
    ConfigurationError,
    ExtrapolationError,
    FrameNotFoundError,
    InputError,
    ProductNotFoundError,
    RefusedError,
)
from cdff_common.geometry import PoseTrack, UncertainTransform
from cdff_common.interfaces.dfn import Dfn
from cdff_common.interfaces.dfpc import Output, Sample
from cdff_common.interfaces.product import Quality, Status
from cdff_common.types import Mesh, Pointcloud
from cdff_core.dfns.disparity_image.interface import DisparityImageInputs
from cdff_core.dfns.normals_estimation.interface import NormalsEstimationInputs
from cdff_core.dfns.surface_fusion.interface import SurfaceFusionInputs, SurfaceFusionOutputs
from cdff_core.dfns.surface_fusion.truncated_signed_distance import compile_kernels
from cdff_core.dfpcs.reconstruction_3d.configuration import Reconstruction3DConfig
from cdff_core.dfpcs.reconstruction_3d.interface import Reconstruction3DInterface
from cdff_core.dfpcs.reconstruction_3d.organised import (
    OrganisedCloud,
    colors_of,
    of_cloud,
    of_depth,
)
from cdff_core.dfpcs.reconstruction_3d.surface_registration import SurfaceRegistration
from cdff_core.imaging.depth_images import depth_of
from cdff_core.object_models.prepared import body_frame

#: Greatest number of captures listed as inputs of a product.
_MAX_INPUTS = 256
#: Step of the intensity of the cloud, in voxels.
_SIGMA_STEP = 1e-5
#: Edge of the cells for the registration, in distances between the points of the first capture.
_CELLS_PER_SPACING = 1.0


class _UsedCapture(NamedTuple):
    stamp_ns: int
    id: str


class Reconstruction3D(Reconstruction3DInterface):
    """Surface of captures in a truncated signed distance field; their poses are given or determined."""

    Config = Reconstruction3DConfig
    config: Reconstruction3DConfig

    def setup(self) -> None:
        """Create the DFNs, clear the surface, offer the store item."""
        if "voxel_m" in self.slot_parameters("fusion"):
            raise ConfigurationError(f"{self.name}: fusion: voxel_m is a parameter of the DFPC")
        compile_kernels()
        self._normals, self._disparity = self.dfn("normals"), self.dfn("disparity")
        self._register = self.dfn("registration") if self.config.solve_poses else None
        self._mesh: Mesh | None = None
        self.restart()
        self.store.offer("mesh", lambda: self._mesh)

    def restart(self) -> None:
        """Clear the surface; the next capture starts a new one."""
        self._poses, self._frames, self._frame = PoseTrack(), ("", ""), "model"
        self._queue: deque[Sample] = deque()
        self._images: deque[Sample] = deque(maxlen=self.config.max_waiting)
        self._fusion: Dfn[Any, SurfaceFusionInputs, SurfaceFusionOutputs] | None = None
        self._voxel_m = 0.0
        self._used: list[_UsedCapture] = []
        self._drops: Counter[str] = Counter()
        self._rejected_blocks, self._newest_ns = 0, 0
        self._registration: SurfaceRegistration | None = None

    def on_depth(self, sample: Sample) -> Iterable[Output]:
        """Queue the capture; process the captures that the poses enclose, or determine its pose."""
        self._newest_ns = max(self._newest_ns, sample.stamp_ns)
        if self.config.solve_poses:
            return list(self._add(sample))
        self._queue.append(sample)
        outputs = list(self._process_queue(is_last=False))
        if len(self._queue) > self.config.max_waiting:
            self._queue.popleft()
            self._drops["waited_for_pose"] += 1
        return outputs

    on_cloud = on_scan = on_stereo = on_depth

    def on_image(self, sample: Sample) -> Iterable[Output]:
        """Keep the image for the colour of a depth image of the same time."""
        self._newest_ns = max(self._newest_ns, sample.stamp_ns)
        self._images.append(sample)
        return ()

    def on_poses(self, sample: Sample) -> Iterable[Output]:
        """Add the pose; process the captures that the poses enclose. Ignored with ``solve_poses``."""
        if self.config.solve_poses:
            return []
        if sample.value is None or sample.quality.status is Status.FAILED:
            self._drops["failed_pose"] += 1
            return []
        frames = sample.value.parent_frame, sample.value.child_frame
        if self._frames not in (("", ""), frames):
            raise InputError(f"{self.name}: pose of frames {frames}, expected {self._frames}")
        self._frames = frames
        if self._is_uncertain(sample.value.transform):
            self._drops["uncertain_pose"] += 1
            return []
        self._poses.insert(sample.stamp_ns, sample.value.transform)
        outputs = list(self._process_queue(is_last=False))
        oldest_ns = min((queued.stamp_ns for queued in self._queue), default=sample.stamp_ns)
        self._poses.evict_before(min(oldest_ns, sample.stamp_ns - round(2e9 * self.config.max_pose_gap_s)))
        return outputs

    def _is_uncertain(self, pose: UncertainTransform) -> bool:
        """Return whether a pose is less accurate than required; an unknown covariance is accepted."""
        if pose.covariance is None:
            return False
        limits = self.config.max_pose_sigma_m, self.config.max_pose_sigma_rad
        blocks = pose.covariance[:3, :3], pose.covariance[3:, 3:]
        return any(
            limit is not None and float(np.linalg.eigvalsh(block)[-1]) > limit**2
            for limit, block in zip(limits, blocks, strict=True)
        )

    def finish(self) -> Iterable[Output]:
        """Process the waiting captures, publish the surface."""
        outputs = list(self._process_queue(is_last=True))
        return [*outputs, *self._publish()]

    def get_mesh(self) -> Mesh:
        """Return the surface of all captures; raises ProductNotFoundError below `min_captures`."""
        if self._fusion is None or len(self._used) < self.config.min_captures:
            raise ProductNotFoundError(
                f"{self.name}: {len(self._used)} captures fused, expected {self.config.min_captures}"
            )
        return self._mesh_of(self._extract(self._fusion))

    def _process_queue(self, *, is_last: bool) -> Iterable[Output]:
        """Fuse the captures that the poses enclose; yield their poses, and the surface when it is due."""
        while self._queue:
            sample = self._queue[0]
            if not is_last and not (self._poses.stamps_ns and self._poses.stamps_ns[-1] >= sample.stamp_ns):
                return
            self._queue.popleft()
            yield from self._add(sample)

    def _add(self, sample: Sample) -> Iterable[Output]:
        """Fuse a capture; yield its pose, and the surface when it is due."""
        try:
            cloud = self._organise(sample)
            T_model_sensor, weak = (
                (self._pose(sample), ())
                if self._register is None
                else self._solve(sample, cloud, self._register)
            )
            self._fuse(sample, cloud, T_model_sensor)
        except RefusedError as refusal:
            self._drops[refusal.reasons[0].split(":")[0]] += 1
            return
        except ExtrapolationError:
            self._drops["no_pose"] += 1
            return
        except FrameNotFoundError:
            self._drops["frame_unknown"] += 1
            return
        except InputError:
            self._drops["malformed"] += 1
            return
        self._used.append(_UsedCapture(sample.stamp_ns, sample.id))
        self._frame = self._model_frame(sample)
        yield Output.of_pose(
            "pose",
            T_model_sensor,
            stamp_ns=sample.stamp_ns,
            frame=self._frame,
            child=sample.frame or "sensor",
            quality=Quality.from_reasons([f"degenerate:{name}" for name in weak], self.covariance_kind),
            inputs=(sample.id,),
            producer=self.name,
        )
        if len(self._used) % self.config.publish_every == 0:
            yield from self._publish()

    def _model_frame(self, sample: Sample) -> str:
        """Return the frame of the surface."""
        if self.config.solve_poses:
            return body_frame(self.config.body) if self.config.body else "model"
        return self._frames[1 if self._is_of_body(sample) else 0] or "model"

    def _solve(
        self, sample: Sample, cloud: OrganisedCloud, register: Dfn[Any, Any, Any]
    ) -> tuple[UncertainTransform, tuple[str, ...]]:
        """Return T_model_sensor by registration with the surface so far, and the directions that only the
        prediction determines; raises RefusedError.
        """
        if self._registration is None:
            self._registration = SurfaceRegistration(register, _CELLS_PER_SPACING * cloud.scale_m())
        is_point = np.isfinite(cloud.normals).all(axis=2) & np.isfinite(cloud.points).all(axis=2)
        R = cloud.T_sensor_camera[:3, :3]
        located = self._registration.locate(
            sample.stamp_ns,
            cloud.points[is_point].astype(np.float64) @ R.T,
            cloud.normals[is_point].astype(np.float64) @ R.T,
            float(np.median(cloud.sigmas[is_point])),
        )
        return located.pose, located.weak

    def _is_of_body(self, sample: Sample) -> bool:
        """Return True if the poses are T_sensor_body."""
        parent, child = self._frames
        if sample.frame and sample.frame in self._frames and parent != child:
            return sample.frame == parent
        return self.config.pose_of == "body"

    def _pose(self, sample: Sample) -> UncertainTransform:
        """Return T_model_sensor at the time of a capture; raises ExtrapolationError or FrameNotFoundError."""
        gap_s = 1e-9 * self._poses.gap_ns(sample.stamp_ns)
        if gap_s > self.config.max_pose_gap_s:
            raise ExtrapolationError(f"{self.name}: no pose within {self.config.max_pose_gap_s:g} s")
        pose = self._poses.at(sample.stamp_ns, "pose of the sensor")
        if self._is_of_body(sample):
            return pose.inverse()
        child = self._frames[1]
        if sample.frame and child not in ("", sample.frame):
            pose = pose @ UncertainTransform.exact(self._mount(child, sample.frame, sample.stamp_ns))
        return pose

    def _fuse(self, sample: Sample, cloud: OrganisedCloud, T_model_sensor: UncertainTransform) -> None:
        """Fuse a capture; raises InputError or RefusedError."""
        if self._fusion is None:
            self._voxel_m = self.config.voxel_m or _round_length(cloud.scale_m())
            self._fusion = self.dfn("fusion", voxel_m=self._voxel_m)
        fused = self._fusion.process(
            SurfaceFusionInputs(
                points=cloud.points,
                normals=cloud.normals,
                sigmas=cloud.sigmas,
                colors=self._colors(sample, cloud),
                camera_matrix=cloud.camera_matrix,
                pose=T_model_sensor.matrix @ cloud.T_sensor_camera,
                is_extracted=False,
            )
        )
        self._rejected_blocks += fused.rejected_blocks

    def _organise(self, sample: Sample) -> OrganisedCloud:
        """Return the points of a cloud, depth image or stereo pair with normals and standard deviations."""
        config, value = self.config, sample.value
        max_range_m = np.inf if config.max_range_m is None else config.max_range_m
        if sample.port in ("cloud", "scan"):
            ranges = np.linalg.norm(value.points_m, axis=1)
            with np.errstate(invalid="ignore"):
                points = value.points_m[(ranges >= config.min_range_m) & (ranges <= max_range_m)]
            normals = self._normals.process(NormalsEstimationInputs(points=points)).normals
            return of_cloud(points, normals, config.range_sigma_m)
        if sample.port == "depth":
            z, K = depth_of(value, config.min_range_m, max_range_m)
            return of_depth(z, K, config.depth_sigma_m + config.depth_sigma_per_m * z**2, config.max_step)
        disparity = self._disparity.process(
            DisparityImageInputs(left=value.left, right=value.right)
        ).disparity.image
        K = value.camera_matrix
        with np.errstate(invalid="ignore", divide="ignore"):
            z = np.where(disparity > 0.0, K[0, 0] * value.baseline / disparity, np.nan)
            z[(z < config.min_range_m) | (z > max_range_m)] = np.nan
        sigma_z = z**2 * config.disparity_sigma_px / (K[0, 0] * value.baseline)
        return of_depth(z, K, sigma_z, config.max_step)

    def _colors(self, sample: Sample, cloud: OrganisedCloud) -> ByteArray | None:
        """Return the colours of a capture, if it has an image whose camera has a known place."""
        if sample.port == "stereo":
            return colors_of(cloud, sample.value.left, np.eye(4))
        image = next((image for image in self._images if image.stamp_ns == sample.stamp_ns), None)
        if image is None or not image.value.camera_matrix.any():
            return None
        if image.value.frame in ("", sample.frame):
            return colors_of(cloud, image.value, np.eye(4))
        try:
            mount = self._mount(image.value.frame, sample.frame, sample.stamp_ns)
        except FrameNotFoundError:
            if not self.config.images_registered:
                self._drops["image_frame_unknown"] += 1
                return None
            mount = np.eye(4)
        return colors_of(cloud, image.value, mount)

    def _mount(self, parent: str, child: str, stamp_ns: int) -> FloatArray:
        """Return T_parent_child of two frames of the robot; raises FrameNotFoundError."""
        return self.context.frames.lookup(parent, child, stamp_ns).matrix

    def _extract(self, fusion: Dfn[Any, SurfaceFusionInputs, SurfaceFusionOutputs]) -> SurfaceFusionOutputs:
        """Return the surface fused so far, without adding a capture."""
        none = np.zeros((0, 0, 3), np.float32)
        return fusion.process(
            SurfaceFusionInputs(
                points=none,
                normals=none,
                sigmas=none[:, :, 0],
                camera_matrix=np.eye(3),
                pose=np.eye(4),
                is_extracted=True,
            )
        )

    def _mesh_of(self, surface: SurfaceFusionOutputs) -> Mesh:
        """Return a surface as a mesh."""
        return Mesh.from_arrays(
            surface.vertices,
            surface.triangles.astype(np.uint32),
            frame=self._frame,
            stamp_ns=self._used[-1].stamp_ns,
            normals=surface.vertex_normals.astype(np.float32),
            colors=surface.vertex_colors,
            producer=self.name,
        )

    def _publish(self) -> Iterable[Output]:
        """Return the surface of all captures, or why there is none."""
        refused_captures, used_captures = self._drops["contradicts_surface"], len(self._used)
        if not used_captures and not self._drops and not self._newest_ns:
            return []
        drops = [f"{reason}:{count}" for reason, count in sorted(self._drops.items())]
        failed = []
        if used_captures < self.config.min_captures:
            failed.append(f"few_captures:{used_captures}<{self.config.min_captures}")
        elif refused_captures > self.config.max_refused * (used_captures + refused_captures):
            failed.append(f"poses_contradict:{refused_captures}/{used_captures + refused_captures}")
        surface = None if failed or self._fusion is None else self._extract(self._fusion)
        if surface is not None and not len(surface.triangles):
            failed, surface = ["no_surface"], None
        if self._rejected_blocks:
            drops.append(f"memory_limit:{self._rejected_blocks}")
        metrics = {
            "captures": float(used_captures),
            "refused": float(refused_captures),
            "voxel_m": self._voxel_m,
        }
        if surface is not None:
            metrics |= {
                "vertices": float(len(surface.vertices)),
                "blocks": float(surface.blocks),
                "sigma_m": float(np.median(surface.vertex_sigmas)),
                "views": float(np.median(surface.vertex_views)),
            }
        kind = self.covariance_kind
        quality = Quality.from_reasons(drops, kind, metrics, failed=failed)
        mesh, cloud = None, None
        if surface is not None:
            mesh = self._mesh = self._mesh_of(surface)
            cloud = Pointcloud.from_points(
                surface.vertices,
                frame=self._frame,
                stamp_ns=self._used[-1].stamp_ns,
                colors=surface.vertex_colors.astype(np.float64),
                intensity=np.rint(surface.vertex_sigmas / (_SIGMA_STEP * self._voxel_m)).astype(np.int32),
            )
        first_ns = self._used[0].stamp_ns if self._used else self._newest_ns
        last_ns = self._used[-1].stamp_ns if self._used else self._newest_ns
        inputs = tuple(capture.id for capture in self._used[-_MAX_INPUTS:])
        return [
            Output(port, value, first_ns, last_ns, self._frame, None, quality, inputs)
            for port, value in (("mesh", mesh), ("cloud", cloud))
        ]


def _round_length(length_m: float) -> float:
    """Return a length rounded to two digits."""
    return float(f"{length_m:.1e}")
