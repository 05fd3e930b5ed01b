# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Measure the DFNs of far_range_object_tracking and the compound on a simulated image of 1024 x 1024 pixels.

    python benchmarks/far_range.py [--rounds N]

The camera has a field of view of 11.4 degrees, the image the stars of the catalogue to magnitude 7.5.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
from _report import measure

from cdff_common.camera import CameraModel
from cdff_common.interfaces.dfpc import Sample
from cdff_common.interfaces.registry import Registry
from cdff_common.stars import add_sources, load_catalogue, visible_stars
from cdff_common.types import Frame
from cdff_core.dfns.apparent_size_ranging.interface import ApparentSizeRangingInputs
from cdff_core.dfns.attitude_from_directions.interface import AttitudeFromDirectionsInputs
from cdff_core.dfns.bearing_filtering.interface import BearingFilteringInputs
from cdff_core.dfns.multi_target_association.interface import MultiTargetAssociationInputs
from cdff_core.dfns.point_source_centroiding.interface import PointSourceCentroidingInputs
from cdff_core.dfns.point_source_detection.interface import PointSourceDetectionInputs
from cdff_core.dfns.star_field_background.interface import StarFieldBackgroundInputs
from cdff_core.dfns.star_identification.interface import StarIdentificationInputs
from cdff_core.dfpcs.far_range_object_tracking.target_ranging import apparent_sizes_m

CAMERA = CameraModel(1024, 1024, 5120.0, 5120.0, 511.5, 511.5)
SPREAD = np.eye(2) * 0.49
STAMP_NS = 1_700_000_000_000_000_000
#: The camera looks at right ascension 286, declination 29 degrees.
_AXIS = np.radians([286.0, 29.0])


def attitude() -> np.ndarray:
    """Return R_inertial_camera."""
    ra, dec = _AXIS
    forward = np.array([np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)])
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    return np.column_stack([right, np.cross(forward, right), forward])


def photograph(rng: np.random.Generator) -> np.ndarray:
    """Return an image with stars and noise."""
    light = np.full((CAMERA.rows, CAMERA.cols), 400.0, np.float32)
    catalogue = load_catalogue().at(STAMP_NS)
    indices, pixels = visible_stars(catalogue, CAMERA, attitude())
    faint = rng.uniform(0, 1023, (150, 2))
    fluxes = 2e4 * 10.0 ** (-0.4 * (np.r_[catalogue.magnitudes[indices], rng.uniform(7.5, 9.0, 150)] - 3.0))
    add_sources(light, np.concatenate([pixels, faint]), fluxes, 0.7)
    return (light + rng.normal(0.0, 20.0, light.shape)).clip(0, 65535).astype(np.uint16)


def sphere(rings: int = 76) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices and 23 104 triangles of a sphere of radius 1 m."""
    polar, azimuth = np.meshgrid(
        np.linspace(0.0, np.pi, rings + 1), np.linspace(0.0, 2 * np.pi, 2 * rings, False), indexing="ij"
    )
    unit = [np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)]
    index = np.arange(polar.size).reshape(polar.shape)
    a, b = index[:-1], index[1:]
    c, d = np.roll(b, -1, axis=1), np.roll(a, -1, axis=1)
    first, second = np.stack([a, b, c], -1), np.stack([a, c, d], -1)
    return np.stack(unit, -1).reshape(-1, 3), np.concatenate([first.reshape(-1, 3), second.reshape(-1, 3)])


def half_lit_disc(rng: np.random.Generator, side: int = 160, radius: float = 60.0) -> np.ndarray:
    """Return a window with a disc lit from the right, by the cosine of the Sun's zenith angle."""
    v, u = np.indices((side, side)) - 0.5 * (side - 1)
    inside = u * u + v * v < radius * radius
    light = np.where(inside, np.maximum(u / radius, 0.0), 0.0)
    light = cv2.GaussianBlur(light.astype(np.float32), (0, 0), 0.8) * 4000.0
    return (light + rng.normal(0.0, 20.0, light.shape)).astype(np.float32)


def main() -> int:
    """Print the costs as JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=15)
    rounds = parser.parse_args().rounds
    rng = np.random.default_rng(1)
    image = photograph(rng)
    dfns: dict[str, Any] = {}
    for name, implementation in (
        ("StarFieldBackground", "TileMedian"),
        ("PointSourceDetection", "MatchedFilter"),
        ("PointSourceCentroiding", "PointSpreadFit"),
        ("StarIdentification", "PairVerification"),
        ("AttitudeFromDirections", "WeightedWahba"),
        ("BearingFiltering", "ConstantAngularVelocity"),
        ("MultiTargetAssociation", "MultipleHypotheses"),
        ("ApparentSizeRanging", "RenderedComparison"),
    ):
        dfns[name] = Registry.default().make_dfn(name, implementation)
        dfns[name].configure()
    report: dict[str, Any] = {}

    def record(name: str, call: Callable[[], Any]) -> Any:
        report[name] = measure(call, rounds)
        return call()

    grey = image.astype(np.float32)
    removed = record(
        "StarFieldBackground",
        lambda: dfns["StarFieldBackground"].process(
            StarFieldBackgroundInputs(image=grey, saturation=65535.0)
        ),
    )
    sources = record(
        "PointSourceDetection",
        lambda: dfns["PointSourceDetection"].process(
            PointSourceDetectionInputs(
                residual=removed.residual, noise=removed.noise, mask=removed.mask, point_spread=SPREAD
            )
        ),
    )
    report["sources"] = len(sources.points)
    fit = record(
        "PointSourceCentroiding",
        lambda: dfns["PointSourceCentroiding"].process(
            PointSourceCentroidingInputs(
                residual=removed.residual, noise=removed.noise, points=sources.points, point_spread=SPREAD
            )
        ),
    )
    vertices, triangles = sphere()
    window = half_lit_disc(rng)
    of_ranging = ApparentSizeRangingInputs(
        image=window,
        noise=20.0,
        focal=5120.0,
        point_spread=0.8,
        sizes=apparent_sizes_m(vertices),
        vertices=vertices,
        triangles=triangles,
        attitude=np.eye(3),
        sun=np.array([1.0, 0.0, 0.0]),
    )
    record("ApparentSizeRanging", lambda: dfns["ApparentSizeRanging"].process(of_ranging))
    rays = CAMERA.rays(fit.centroids[:60])
    sigmas = np.full(len(rays), 2e-5)

    def identify(guess: np.ndarray | None) -> Any:
        return dfns["StarIdentification"].process(
            StarIdentificationInputs(
                directions=rays, sigmas=sigmas, stamp=STAMP_NS, attitude=guess, attitude_sigma=1e-3
            )
        )

    record("StarIdentification with attitude", lambda: identify(attitude()))
    stars = record("StarIdentification", lambda: identify(None))
    matched = stars.stars >= 0
    record(
        "AttitudeFromDirections",
        lambda: dfns["AttitudeFromDirections"].process(
            AttitudeFromDirectionsInputs(
                directions=stars.corrected[matched],
                references=stars.star_directions[matched],
                sigmas=sigmas[matched],
            )
        ),
    )
    many = np.repeat(np.eye(3)[:1], 100, axis=0)
    covariances = np.repeat(np.eye(6)[None] * 1e-8, 100, axis=0)
    record(
        "BearingFiltering",
        lambda: dfns["BearingFiltering"].process(
            BearingFilteringInputs(
                directions=many,
                rates=np.full((100, 3), 1e-4),
                covariances=covariances,
                interval=1.0,
                measured=many,
                measured_covariances=np.repeat(np.eye(3)[None] * 1e-9, 100, axis=0),
            )
        ),
    )
    stamps = iter(range(1, 10_000))

    def associate() -> Any:
        v = np.concatenate([rays, CAMERA.rays(rng.uniform(0, 1023, (20, 2)))])
        n = len(v)
        return dfns["MultiTargetAssociation"].process(
            MultiTargetAssociationInputs(
                stamp=STAMP_NS + next(stamps) * 10**9,
                directions=v,
                covariances=np.repeat(np.eye(3)[None] * (3e-5) ** 2, n, axis=0),
                snr=np.full(n, 6.0),
                pixels=np.zeros((n, 2)),
                can_start=np.ones(n, bool),
                defect_evidence=np.full(n, -9.0),
                stars=np.zeros((0, 3)),
                blend_angle=5e-4,
                solid_angle=0.04,
                is_dark=False,
            )
        )

    record("MultiTargetAssociation", associate)
    dfpc = Registry.default().make_dfpc("far_range_object_tracking")
    dfpc.configure()

    def step() -> Any:
        index = next(stamps)
        stamp_ns = STAMP_NS + index * 10**9
        frame = Frame.from_image(
            image_of[index % len(image_of)],
            stamp_ns=stamp_ns,
            sensor="robot/camera",
            camera_matrix=CAMERA.matrix,
        )
        return list(dfpc.step(Sample("image", stamp_ns, index, frame, frame="robot/camera")))

    image_of = [photograph(np.random.default_rng(7)) for _ in range(1)]
    noise = [rng.normal(0.0, 20.0, grey.shape) for _ in range(6)]
    image_of = [(image_of[0] + n).clip(0, 65535).astype(np.uint16) for n in noise]
    for _ in range(8):
        step()
    record("FarRangeObjectTracking", step)
    sys.stdout.write(json.dumps(report, indent=1) + "\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
