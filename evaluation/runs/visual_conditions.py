# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Sets of images with true poses, and runs of the visual compounds on disturbed images of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from cdff_common.arrays import FloatArray
from cdff_common.geometry import se3
from cdff_common.interfaces.dfpc import DfpcContext, Output, Sample
from cdff_common.interfaces.registry import Registry
from cdff_common.types import DistanceImage, Frame, FramePair, PoseGraph, VisualMap
from cdff_common.types.pose_graph_ext import PRIOR
from cdff_core.imaging.grey import grey_image
from cdff_core.visual_map.keyframe_points import points_of_depth, points_of_pair
from cdff_dev.map_building.build import localisation_features
from cdff_dev.simulate.camera import camera_of_world
from cdff_dev.simulate.scenario import Scenario, load_scenario
from cdff_dev.simulate.surface import Texture
from cdff_dev.simulate.world import cast_scene, make_world
from evaluation.data_sets import euroc, kitti
from evaluation.data_sets.image_conditions import View
from evaluation.runs.short_steps import SIMULATED_CAMERA as DENSE_SIMULATED
from evaluation.runs.traverse import SIMULATED_CAMERA as SPARSE_SIMULATED
from evaluation.visual_localisation import EUROC_SIGMAS, KITCHEN_OFFSET_M, KITCHEN_SIGMAS, kitchen_frames

#: Compounds that need a stereo camera, and those that an RGB-D camera suffices for.
STEREO_COMPOUNDS = ("visual_slam", "visual_localisation", "visual_odometry_dense", "visual_odometry_sparse")
MAPPED_COMPOUNDS = ("visual_slam", "visual_localisation")
#: Views of a set: every second one is in the map, the others are queries; the first ones are a sequence.
_VIEWS, _SEQUENCE = 16, 10
#: Accuracy of the reference poses of KITTI, metres and degrees.
_KITTI_SIGMAS = (0.05, 0.2)
_PERIOD_NS = 100_000_000
#: Seed of the simulated terrain, rover, and time between two pairs, seconds.
_SEED, _ROBOT, _STEP_S, _FIRST_S = 401, "r2", 0.7, 2.0
#: Period and contrast of the repetitive ground.
_RIPPLE_M, _RIPPLE_CONTRAST = 0.25, 0.5


@dataclass(frozen=True, slots=True, eq=False)
class ImageSet:
    """Consecutive views with true poses.

    Attributes
    ----------
    views : list of View
    truth : ndarray, shape (n, 4, 4)
        ``T_world_camera`` of the left camera.
    sigma_m, sigma_deg : float
        Accuracy of the true poses.
    baseline_m : float
        0 for an RGB-D camera.
    depths : tuple of DistanceImage
        Depth images of an RGB-D camera.
    parameters : dict
        Parameters by compound.
    scene_condition : str
        Name of the condition that the scene represents, such as a low Sun; empty if the conditions are
        applied to the images.
    mapped : list of View or None
        Views at the same poses of which the map is made; None: those of ``views``.
    compounds : tuple of str
        Compounds that can process the images.
    """

    views: list[View]
    truth: FloatArray
    sigma_m: float
    sigma_deg: float
    baseline_m: float = 0.0
    depths: tuple[DistanceImage, ...] = ()
    parameters: dict[str, dict[str, Any]] | None = None
    scene_condition: str = ""
    mapped: list[View] | None = None
    compounds: tuple[str, ...] = STEREO_COMPOUNDS

    @property
    def is_stereo(self) -> bool:
        """True for a stereo camera."""
        return not self.depths

    @property
    def sequence(self) -> list[View]:
        """Views that are tracked."""
        return self.views[:_SEQUENCE]

    @property
    def queries(self) -> list[View]:
        """Views that are located in the map."""
        return self.views[1::2]

    def parameters_of(self, compound: str) -> dict[str, Any]:
        """Return the parameters of a compound."""
        return (self.parameters or {}).get(compound, {})

    def pair(self, view: View) -> FramePair:
        """Return a view of a stereo camera as a message."""
        return FramePair.from_images(
            *view.images,
            baseline_m=self.baseline_m,
            camera_matrix=view.camera_matrix,
            stamp_ns=view.stamp_ns,
            sensor="rover/navcam_left",
        )

    def frame(self, view: View) -> Frame:
        """Return the first image of a view as a message."""
        return Frame.from_image(
            view.images[0], stamp_ns=view.stamp_ns, camera_matrix=view.camera_matrix, sensor="rover/camera"
        )


def track(
    compound: str, images: ImageSet, views: Sequence[View], context: DfpcContext
) -> list[tuple[View, Output]]:
    """Return the pose of each view by a compound that estimates the motion."""
    dfpc = Registry.default().make_dfpc(compound)
    dfpc.configure(images.parameters_of(compound), context)
    answers = []
    for seq, view in enumerate(views):
        if images.is_stereo:
            port = "pair" if compound == "visual_slam" else "stereo"
            samples = [Sample(port, view.stamp_ns, seq, images.pair(view), str(seq))]
        else:
            samples = [
                Sample("image", view.stamp_ns, seq, images.frame(view), f"i{seq}"),
                Sample("depth", view.stamp_ns, seq, images.depths[view.index], f"d{seq}"),
            ]
        outputs = [o for sample in samples for o in dfpc.step(sample) if o.port == "pose"]
        answers += [(view, output) for output in outputs]
    return answers


def localise(images: ImageSet, views: Sequence[View], context: DfpcContext) -> list[tuple[View, Output]]:
    """Return the pose of each view in the map of the undisturbed views between them."""
    dfpc = Registry.default().make_dfpc("visual_localisation")
    dfpc.configure({}, context)
    list(dfpc.step(Sample("map", 0, 0, _map(images))))
    answers = []
    for seq, view in enumerate(views):
        value = images.pair(view) if images.is_stereo else images.frame(view)
        port = "pair" if images.is_stereo else "image"
        (output,) = dfpc.step(Sample(port, view.stamp_ns, seq, value, str(seq)))
        answers.append((view, output))
    return answers


@cache
def _map(images: ImageSet) -> VisualMap:
    """Return the map of every second view."""
    extractor, match = localisation_features()
    views = (images.mapped or images.views)[::2]
    if images.is_stereo:
        points = [points_of_pair(images.pair(view), extractor, match) for view in views]
    else:
        offset = se3.transform(np.eye(3), KITCHEN_OFFSET_M)
        points = [
            points_of_depth(images.frame(view), images.depths[view.index], extractor, offset)
            for view in views
        ]
    ids = np.arange(len(views))
    sigmas = np.repeat([images.sigma_m, np.radians(images.sigma_deg)], 3)
    graph = PoseGraph.from_arrays(
        ids,
        np.array([view.stamp_ns for view in views]),
        np.array([images.truth[view.index] for view in views]),
        np.stack([ids, ids], axis=1),
        np.tile(np.eye(4), (len(ids), 1, 1)),
        np.tile(np.diag(sigmas**-2.0), (len(ids), 1, 1)),
        np.full(len(ids), PRIOR),
        frame="world",
    )
    return VisualMap.from_parts(
        graph,
        points,
        sensor="rover/camera",
        stamp_ns=0,
        descriptor_type="ROOT_SIFT",
        producer="evaluation",
    )


def kitti_set(data: Path) -> ImageSet:
    """Return pairs of KITTI without the first ones, whose reference poses are interpolated."""
    pairs, truth = kitti.read(data / kitti.SEQUENCE)
    first = kitti.measured_from(truth)
    chosen = pairs[first : first + _VIEWS]
    return _stereo_set(chosen, truth[first : first + _VIEWS], *_KITTI_SIGMAS)


def euroc_set(data: Path) -> ImageSet:
    """Return consecutive pairs of EuRoC; they are too far apart for odometry."""
    views = euroc.stereo_views(data / euroc.FOLDER)[:_VIEWS]
    images = _stereo_set([v.pair for v in views], np.array([v.T_world_left for v in views]), *EUROC_SIGMAS)
    return replace(images, compounds=MAPPED_COMPOUNDS)


def _stereo_set(pairs: Sequence[FramePair], truth: FloatArray, sigma_m: float, sigma_deg: float) -> ImageSet:
    views = [
        View(
            (np.array(grey_image(pair.left)), np.array(grey_image(pair.right))),
            np.array(pair.camera_matrix),
            (i + 1) * _PERIOD_NS,
            i,
        )
        for i, pair in enumerate(pairs)
    ]
    return ImageSet(views, truth, sigma_m, sigma_deg, baseline_m=float(pairs[0].baseline))


def kitchen_set(data: Path) -> ImageSet:
    """Return colour and depth images of the kitchen, 0.9 s apart."""
    frames = [frame for _, frame in sorted(kitchen_frames(data).items())][: 3 * _VIEWS : 3]
    views = [
        View(
            (np.array(grey_image(frame.colour)),),
            np.array(frame.colour.camera_matrix),
            frame.colour.metadata.time_stamp.ns,
            i,
        )
        for i, frame in enumerate(frames)
    ]
    return ImageSet(
        views,
        np.array([frame.T_world_colour for frame in frames]),
        *KITCHEN_SIGMAS,
        depths=tuple(frame.depth for frame in frames),
        parameters={"visual_slam": {"depth_offset_m": KITCHEN_OFFSET_M}},
        compounds=MAPPED_COMPOUNDS,
    )


def simulated_sets() -> list[ImageSet]:
    """Return a drive among rocks, the same under a low Sun, and one over ground with a periodic pattern.

    Under the low Sun, the map is that of the high Sun.
    """
    rocks = load_scenario("visual_rocks", _SEED)
    usual = _simulated(rocks)
    low_sun = _simulated(load_scenario("visual_low_sun", _SEED))
    repetitive = _simulated(rocks, is_repetitive=True)
    return [
        usual,
        replace(low_sun, scene_condition="low Sun with long shadows", mapped=usual.views),
        replace(repetitive, scene_condition="repetitive ground"),
    ]


def _simulated(scenario: Scenario, *, is_repetitive: bool = False) -> ImageSet:
    world = make_world(scenario)
    if is_repetitive:
        assert world.appearance is not None  # of a scenario with a camera
        count = int(np.sqrt(len(world.appearance.detail.texels)))
        tile = _ripples(1 << (count.bit_length() - 1), world.appearance.detail.texel_m)
        flat = replace(world.appearance.ground, texels=np.full_like(world.appearance.ground.texels, 0.6))
        world.appearance = replace(world.appearance, ground=flat, detail=tile)
    scene = cast_scene(world.relief, world.rocks)
    camera = camera_of_world(world, scene)
    assert camera is not None
    model, rng = camera.model, np.random.default_rng(_SEED)
    poses = world.motions[_ROBOT].poses(_FIRST_S + _STEP_S * np.arange(_VIEWS))
    views = [
        View(camera.pair(T, rng), model.camera_matrix, (i + 1) * _PERIOD_NS, i) for i, T in enumerate(poses)
    ]
    return ImageSet(
        views,
        poses @ model.T_base_left,
        1e-6,
        1e-5,
        baseline_m=model.baseline_m,
        parameters={"visual_odometry_dense": DENSE_SIMULATED, "visual_odometry_sparse": SPARSE_SIMULATED},
    )


def _ripples(size: int, texel_m: float) -> Texture:
    """Return a periodic texture of crossed ripples."""
    x_m = (np.arange(size) + 0.5) * texel_m
    periods = max(1, round(size * texel_m / _RIPPLE_M))
    wave = np.sin(2.0 * np.pi * periods * x_m / (size * texel_m))
    image = 1.0 + 0.5 * _RIPPLE_CONTRAST * (wave[:, None] + wave[None, :])
    return Texture.from_image(image.astype(np.float32), texel_m, 0.0, wraps=True)
