# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""By which names a DFN is found."""

from __future__ import annotations

from pathlib import Path

import pytest

from cdff_common.errors import ConfigurationError
from cdff_common.interfaces.description import DfnDescription
from cdff_common.interfaces.registry import Found, Registry


@pytest.fixture
def registry() -> Registry:
    made = Registry()
    for name in ("X1", "V2Filter", "LaserFilter"):
        description = DfnDescription(name=name)
        made.dfns[description.folder] = Found("nowhere", Path("dfn.yaml"), description)
    return made


@pytest.mark.parametrize("name", ["X1", "V2Filter", "LaserFilter"])
def test_class_name_and_folder_name_find_the_same(registry: Registry, name: str) -> None:
    by_class = registry.dfn(name)
    assert registry.dfn(by_class.folder) is by_class
    assert registry.resolve(by_class.folder) == ("dfn", by_class.folder)


#: What InFuse called image DFNs and their implementations, and what answers to it here.
INFUSE = {
    "BundleAdjustment": "bundle_optimization", "CeresAdjustment": "bundle_optimization",
    "SvdDecomposition": "bundle_optimization", "CamerasTransformEstimation": "cameras_transform_estimation",
    "EssentialMatrixDecomposition": "cameras_transform_estimation", "ColorConversion": "color_conversion",
    "DepthFiltering": "image_filtering", "ConvolutionFilter": "image_filtering",
    "DisparityImage": "disparity_image", "DisparityImageEdres": "disparity_image",
    "DisparityMapping": "disparity_image/Bm",
    "HirschmullerDisparityMapping": "disparity_image/Sgbm", "DisparityToPointCloud": "disparity_to_point_cloud",
    "DisparityToPointCloudWithIntensity": "disparity_to_point_cloud",
    "FeaturesDescription2D": "features_description_2d", "OrbDescriptor": "features_description_2d/Orb",
    "FeaturesExtraction2D": "features_extraction_2d", "HarrisDetector2D": "features_extraction_2d/GridGftt",
    "OrbDetectorDescriptor": "features_extraction_2d/Orb", "FeaturesMatching2D": "features_matching_2d",
    "FlannMatcher": "features_matching_2d", "FundamentalMatrixComputation": "fundamental_matrix_computation",
    "FundamentalMatrixRansac": "fundamental_matrix_computation", "ImageDegradation": "image_degradation",
    "ImageDegradationEdres": "image_degradation", "ImageFiltering": "image_filtering",
    "BackgroundExtraction": "background_subtraction", "BackgroundSubtractorMOG2": "background_subtraction",
    "CannyEdgeDetection": "image_filtering/CannyEdgeDetection",
    "DerivativeEdgeDetection": "image_filtering/DerivativeEdgeDetection", "ImageUndistortion": "image_undistortion",
    "ImageUndistortionRectification": "image_undistortion", "ImageRectification": "image_undistortion",
    "ImageRectificationEdres": "image_undistortion", "PerspectiveNPointSolving": "perspective_n_point_solving",
    "IterativePnpSolver": "perspective_n_point_solving", "PointCloudReconstruction2DTo3D": "n_view_triangulation",
    "StereoDegradation": "stereo_degradation", "StereoDegradationEdres": "stereo_degradation",
    "StereoMotionEstimation": "stereo_motion_estimation", "StereoMotionEstimationEdres": "stereo_motion_estimation",
    "StereoRectification": "stereo_rectification", "StereoRectificationEdres": "stereo_rectification",
    "Transform3DEstimation": "transform_estimation_3d", "CeresEstimation": "transform_estimation_3d",
    "LeastSquaresMinimization": "transform_estimation_3d/LeastSquares",
}  # fmt: skip


@pytest.mark.parametrize("name", INFUSE)
def test_names_of_infuse_find_what_does_the_same(name: str) -> None:
    folder, _, implementation = INFUSE[name].partition("/")
    assert Registry.default().dfn(name).folder == folder
    made = Registry.default().make_dfn(name)
    assert made.configure() is None
    if implementation:
        assert type(made).__name__ == implementation


def test_an_implementation_has_its_name_elsewhere_as_another_one() -> None:
    made = Registry.default().make_dfn("FeaturesDescription2D", "OrbDescriptor")
    assert type(made).__name__ == "Orb"
    assert type(Registry.default().make_dfn("FeaturesMatching2D", "FlannMatcher")).__name__ == "MutualRatio"
    with pytest.raises(ConfigurationError, match=r"expected one of .*Orb, OrbDescriptor"):
        Registry.default().make_dfn("FeaturesDescription2D", "Surf")


def test_every_class_name_finds_its_own_though_another_is_also_called_so() -> None:
    registry = Registry.default()
    for folder, found in registry.dfns.items():
        assert registry.dfn(found.description.name).folder == folder
    for folder, found in registry.dfpcs.items():
        assert registry.dfpc(found.description.name).folder == folder
        assert registry.resolve(found.description.name) == ("dfpc", folder)
