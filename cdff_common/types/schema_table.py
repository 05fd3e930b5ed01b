# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from cdff_common/asn1/*.asn by cdff generate; do not edit.

"""Schema of all types: fields, sizes and bounds, for validation and the codecs."""

from __future__ import annotations

from cdff_common.types.schema import (
    Alias,
    Array,
    Boolean,
    Choice,
    Enumeration,
    Field,
    Integer,
    ListOf,
    Message,
    OctetString,
    Real,
    Struct,
    Text,
)

_0 = Struct(
    "Asn1Bitstream",
    "Asn1Bitstream",
    (
        Field("type", "type", Text(256)),
        Field("serialization-method", "serialization_method", Integer(0, 4294967295)),
        Field("data", "data", OctetString(1073741824, "|u1", 0)),
    ),
)
_1 = Struct(
    "Time",
    "Time",
    (
        Field("microseconds", "microseconds", Integer(-9223372036854775807, 9223372036854775807)),
        Field("usecPerSec", "usec_per_sec", Integer(-2147483648, 2147483647)),
    ),
)
_2 = Struct(
    "Bundle-Metadata",
    "BundleMetadata",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("producerId", "producer_id", Text(256)),
        Field("frameId", "frame_id", Text(256)),
        Field("timeStamp", "time_stamp", _1),
    ),
)
_3 = Struct(
    "Bundle-Cameras",
    "BundleCameras",
    (
        Field("ids", "ids", OctetString(1073741824, "<i8", 0)),
        Field("stamps", "stamps", OctetString(1073741824, "<i8", 0)),
        Field("poses", "poses", OctetString(1073741824, "<f8", 7)),
        Field("lenses", "lenses", OctetString(1073741824, "<u4", 0)),
        Field("fixed", "fixed", OctetString(1073741824, "<u1", 0)),
    ),
)
_4 = Struct(
    "Bundle-Lenses",
    "BundleLenses",
    (
        Field("values", "values", OctetString(1073741824, "<f8", 10)),
        Field("free", "free", OctetString(1073741824, "<u4", 0)),
    ),
)
_5 = Struct(
    "Bundle-Points",
    "BundlePoints",
    (
        Field("ids", "ids", OctetString(1073741824, "<i8", 0)),
        Field("positions", "positions", OctetString(1073741824, "<f8", 3)),
        Field("fixed", "fixed", OctetString(1073741824, "<u1", 0)),
    ),
)
_6 = Struct(
    "Bundle-Observations",
    "BundleObservations",
    (
        Field("cameras", "cameras", OctetString(1073741824, "<u4", 0)),
        Field("points", "points", OctetString(1073741824, "<u4", 0)),
        Field("pixels", "pixels", OctetString(1073741824, "<f8", 3)),
    ),
)
_7 = Struct(
    "Bundle-Prior",
    "BundlePrior",
    (
        Field("cameras", "cameras", OctetString(1073741824, "<i8", 0)),
        Field("poses", "poses", OctetString(1073741824, "<f8", 7)),
        Field("information", "information", OctetString(1073741824, "<f8", 0)),
        Field("gradient", "gradient", OctetString(1073741824, "<f8", 0)),
    ),
)
_8 = Struct(
    "BundleProblem",
    "BundleProblem",
    (
        Field("metadata", "metadata", _2),
        Field("cameras", "cameras", _3),
        Field("lenses", "lenses", _4),
        Field("points", "points", _5),
        Field("observations", "observations", _6),
        Field("prior", "prior", _7),
    ),
)
_9 = Alias("Vector2d", "Vector2d", "values", Array(Real(), ((2, 2),), ("T-Double",)))
_10 = Alias("Vector3d", "Vector3d", "values", Array(Real(), ((3, 3),), ("T-Double",)))
_11 = Alias("Vector4d", "Vector4d", "values", Array(Real(), ((4, 4),), ("T-Double",)))
_12 = Alias("Vector6d", "Vector6d", "values", Array(Real(), ((6, 6),), ("T-Double",)))
_13 = Alias("VectorXd", "VectorXd", "values", Array(Real(), ((0, 100),), ("T-Double",)))
_14 = Alias("Quaterniond", "Quaterniond", "values", Array(Real(), ((4, 4),), ("T-Double",)))
_15 = Alias("AngleAxisd", "AngleAxisd", "values", Array(Real(), ((4, 4),), ("T-Double",)))
_16 = Alias("Matrix2d", "Matrix2d", "values", Array(Real(), ((2, 2), (2, 2)), ("SEQUENCE_OF", "T-Double")))
_17 = Alias("Matrix3d", "Matrix3d", "values", Array(Real(), ((3, 3), (3, 3)), ("SEQUENCE_OF", "T-Double")))
_18 = Alias("Matrix4d", "Matrix4d", "values", Array(Real(), ((4, 4), (4, 4)), ("SEQUENCE_OF", "T-Double")))
_19 = Alias("Matrix6d", "Matrix6d", "values", Array(Real(), ((6, 6), (6, 6)), ("SEQUENCE_OF", "T-Double")))
_20 = Alias("MatrixXd", "MatrixXd", "values", Array(Real(), ((0, 20), (0, 20)), ("SEQUENCE_OF", "T-Double")))
_21 = Alias("Affine3d", "Affine3d", "values", Array(Real(), ((4, 4), (4, 4)), ("SEQUENCE_OF", "T-Double")))
_22 = Alias(
    "Isometry3d", "Isometry3d", "values", Array(Real(), ((4, 4), (4, 4)), ("SEQUENCE_OF", "T-Double"))
)
_23 = Alias(
    "Transform3d", "Transform3d", "values", Array(Real(), ((4, 4), (4, 4)), ("SEQUENCE_OF", "T-Double"))
)
_24 = Alias(
    "Covariance", "Covariance", "values", Array(Real(), ((6, 6), (6, 6)), ("SEQUENCE_OF", "T-Double"))
)
_25 = Alias("Point", "Point", "values", Array(Real(), ((3, 3),), ("T-Double",)))
_26 = Alias("Point2D", "Point2D", "values", Array(Real(), ((2, 2),), ("T-Double",)))
_27 = Alias("Point3D", "Point3D", "values", Array(Real(), ((3, 3),), ("T-Double",)))
_28 = Struct("Angle", "Angle", (Field("rad", "rad", Real()),))
_29 = Struct(
    "AngleSegment",
    "AngleSegment",
    (
        Field("startRad", "start_rad", Real()),
        Field("width", "width", Real()),
    ),
)
_30 = Struct(
    "Correspondence2D",
    "Correspondence2D",
    (
        Field("source", "source", Array(Real(), ((2, 2),), ("T-Double",))),
        Field("sink", "sink", Array(Real(), ((2, 2),), ("T-Double",))),
        Field("probability", "probability", Real()),
    ),
)
_31 = Alias("CorrespondenceMap2D", "CorrespondenceMap2D", "items", ListOf(_30, 0, 1024, "Correspondence2D"))
_32 = Struct(
    "Correspondence3D",
    "Correspondence3D",
    (
        Field("source", "source", Array(Real(), ((3, 3),), ("T-Double",))),
        Field("sink", "sink", Array(Real(), ((3, 3),), ("T-Double",))),
        Field("probability", "probability", Real()),
    ),
)
_33 = Alias("CorrespondenceMap3D", "CorrespondenceMap3D", "items", ListOf(_32, 0, 51200, "Correspondence3D"))
_34 = Struct(
    "VisualPointFeature2D",
    "VisualPointFeature2D",
    (
        Field("point", "point", Array(Real(), ((2, 2),), ("T-Double",))),
        Field("descriptor", "descriptor", Array(Real(), ((0, 128),), ("T-Float",))),
    ),
)
_35 = Alias(
    "VisualPointFeatureVector2D",
    "VisualPointFeatureVector2D",
    "items",
    ListOf(_34, 0, 1024, "VisualPointFeature2D"),
)
_36 = Struct(
    "Point3DReference",
    "Point3DReference",
    (
        Field("pointCloudIdentifier", "point_cloud_identifier", Integer(0, 65535)),
        Field("index", "index", Integer(0, 9223372036854775807)),
    ),
)
_37 = Choice(
    "VisualPointFeature3DPoint",
    (
        Field("position", "position", Array(Real(), ((3, 3),), ("T-Double",))),
        Field("reference", "reference", _36),
    ),
)
_38 = Struct(
    "VisualPointFeature3D",
    "VisualPointFeature3D",
    (
        Field("point", "point", _37),
        Field("descriptor", "descriptor", Array(Real(), ((0, 352),), ("T-Float",))),
    ),
)
_39 = Enumeration(
    "VisualPointFeatureVector3DType", (("all-positions", 0), ("all-references", 1), ("hybrid-vector", 2))
)
_40 = Enumeration("VisualPointFeature3DType", (("histogram", 0), ("shot", 1), ("pfh", 2)))
_41 = Struct(
    "VisualPointFeatureVector3D",
    "VisualPointFeatureVector3D",
    (
        Field("list", "list", ListOf(_38, 0, 51200, "VisualPointFeature3D")),
        Field("list-type", "list_type", _39),
        Field("feature-type", "feature_type", _40),
    ),
)
_42 = Enumeration(
    "Array3DDepthT",
    (
        ("depth-8U", 0),
        ("depth-8S", 1),
        ("depth-16U", 2),
        ("depth-16S", 3),
        ("depth-32S", 4),
        ("depth-32F", 5),
        ("depth-64F", 6),
    ),
)
_43 = Struct(
    "Array3D",
    "Array3D",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("rows", "rows", Integer(0, 4294967295)),
        Field("cols", "cols", Integer(0, 4294967295)),
        Field("channels", "channels", Integer(0, 4294967295)),
        Field("depth", "depth", _42),
        Field("rowSize", "row_size", Integer(0, 4294967295)),
        Field("data", "data", OctetString(66355200, "|u1", 0)),
    ),
)
_44 = Enumeration("FramePixelModelT", (("pix-UNDEF", 0), ("pix-POLY", 1), ("pix-DISP", 2)))
_45 = Enumeration("FrameErrorTypeT", (("error-UNDEFINED", 0), ("error-DEAD", 1), ("error-FILTERED", 2)))
_46 = Struct(
    "Frame-error-t",
    "FrameErrorT",
    (
        Field("type", "type", _45),
        Field("value", "value", Real()),
    ),
)
_47 = Struct(
    "Frame-attrib-t",
    "FrameAttribT",
    (
        Field("name", "name", Text(256)),
        Field("data", "data", Text(256)),
    ),
)
_48 = Enumeration(
    "FrameModeT",
    (
        ("mode-UNDEF", 0),
        ("mode-GRAY", 1),
        ("mode-RGB", 2),
        ("mode-RGBA", 3),
        ("mode-BGR", 4),
        ("mode-BGRA", 5),
        ("mode-HSV", 6),
        ("mode-HLS", 7),
        ("mode-YUV", 8),
        ("mode-UYVY", 9),
        ("mode-Lab", 10),
        ("mode-Luv", 11),
        ("mode-XYZ", 12),
        ("mode-YCrCb", 13),
        ("mode-RGB32", 14),
        ("mode-Bayer-RGGB", 15),
        ("mode-Bayer-GRBG", 16),
        ("mode-Bayer-BGGR", 17),
        ("mode-Bayer-GBRG", 18),
        ("mode-PJPG", 19),
        ("mode-JPEG", 20),
        ("mode-PNG", 21),
    ),
)
_49 = Enumeration("FrameStatusT", (("status-EMPTY", 0), ("status-VALID", 1), ("status-INVALID", 2)))
_50 = Struct(
    "Frame-metadata-t",
    "FrameMetadataT",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("timeStamp", "time_stamp", _1),
        Field("receivedTime", "received_time", _1),
        Field("pixelModel", "pixel_model", _44),
        Field("pixelCoeffs", "pixel_coeffs", Array(Real(), ((0, 100),), ("T-Double",))),
        Field("errValues", "err_values", ListOf(_46, 0, 3, "Frame-error-t")),
        Field("attributes", "attributes", ListOf(_47, 0, 5, "Frame-attrib-t")),
        Field("mode", "mode", _48),
        Field("status", "status", _49),
    ),
)
_51 = Enumeration(
    "FrameCameraModelT", (("cam-UNDEF", 0), ("cam-PINHOLE", 1), ("cam-FISHEYE", 2), ("cam-MAPS", 3))
)
_52 = Struct(
    "Frame-intrinsic-t",
    "FrameIntrinsicT",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("sensorId", "sensor_id", Text(256)),
        Field("cameraMatrix", "camera_matrix", Array(Real(), ((3, 3), (3, 3)), ("SEQUENCE_OF", "T-Double"))),
        Field("cameraModel", "camera_model", _51),
        Field("distCoeffs", "dist_coeffs", Array(Real(), ((0, 100),), ("T-Double",))),
    ),
)
_53 = Struct(
    "TransformWithCovariance-Metadata",
    "TransformWithCovarianceMetadata",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("producerId", "producer_id", Text(256)),
        Field("dataEstimated", "data_estimated", Array(Boolean(), ((7, 7),), ("BOOLEAN",))),
        Field("parentFrameId", "parent_frame_id", Text(256)),
        Field("parentTime", "parent_time", _1),
        Field("childFrameId", "child_frame_id", Text(256)),
        Field("childTime", "child_time", _1),
    ),
)
_54 = Struct(
    "TransformWithCovariance-Data",
    "TransformWithCovarianceData",
    (
        Field("translation", "translation", Array(Real(), ((3, 3),), ("T-Double",))),
        Field("orientation", "orientation", Array(Real(), ((4, 4),), ("T-Double",))),
        Field("cov", "cov", Array(Real(), ((6, 6), (6, 6)), ("SEQUENCE_OF", "T-Double"))),
    ),
)
_55 = Struct(
    "TransformWithCovariance",
    "TransformWithCovariance",
    (
        Field("metadata", "metadata", _53),
        Field("data", "data", _54),
    ),
)
_56 = Struct(
    "Frame-extrinsic-t",
    "FrameExtrinsicT",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("hasFixedTransform", "has_fixed_transform", Boolean()),
        Field("pose-robotFrame-sensorFrame", "pose_robot_frame_sensor_frame", _55),
        Field("pose-fixedFrame-robotFrame", "pose_fixed_frame_robot_frame", _55),
    ),
)
_57 = Struct(
    "Frame",
    "Frame",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("metadata", "metadata", _50),
        Field("intrinsic", "intrinsic", _52),
        Field("extrinsic", "extrinsic", _56),
        Field("data", "data", _43),
    ),
)
_58 = Struct(
    "FramePair",
    "FramePair",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("baseline", "baseline", Real()),
        Field("left", "left", _57),
        Field("right", "right", _57),
    ),
)
_59 = Enumeration("FrameCompressedModeT", (("mode-compressed-undefined", 0), ("mode-pjpg", 1)))
_60 = Struct(
    "CompressedFrame",
    "CompressedFrame",
    (
        Field("ref-time", "ref_time", _1),
        Field("received-time", "received_time", _1),
        Field("image", "image", Array(Integer(0, 255), ((1, 262144),), ("T-UInt8",))),
        Field("attributes", "attributes", ListOf(_47, 1, 10, "Frame-attrib-t")),
        Field("rows", "rows", Integer(0, 4294967295)),
        Field("cols", "cols", Integer(0, 4294967295)),
        Field("frame-mode", "frame_mode", _59),
        Field("frame-status", "frame_status", _49),
    ),
)
_61 = Struct(
    "GroundAreas-Metadata",
    "GroundAreasMetadata",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("producerId", "producer_id", Text(256)),
        Field("frameId", "frame_id", Text(256)),
        Field("startTime", "start_time", _1),
        Field("endTime", "end_time", _1),
        Field("resolution", "resolution", Real()),
        Field("tolerance", "tolerance", Real()),
    ),
)
_62 = Struct(
    "GroundAreas-Data",
    "GroundAreasData",
    (
        Field("kinds", "kinds", OctetString(1073741824, "<u1", 0)),
        Field("areas", "areas", OctetString(1073741824, "<f8", 0)),
        Field("ringCounts", "ring_counts", OctetString(1073741824, "<u4", 0)),
        Field("cornerCounts", "corner_counts", OctetString(1073741824, "<u4", 0)),
        Field("corners", "corners", OctetString(1073741824, "<f8", 2)),
    ),
)
_63 = Struct(
    "GroundAreas",
    "GroundAreas",
    (
        Field("metadata", "metadata", _61),
        Field("data", "data", _62),
    ),
)
_64 = Struct(
    "ImuSpan-Metadata",
    "ImuSpanMetadata",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("sensorId", "sensor_id", Text(256)),
    ),
)
_65 = Struct(
    "ImuSpan-Data",
    "ImuSpanData",
    (
        Field("stamps", "stamps", OctetString(1073741824, "<i8", 0)),
        Field("acc", "acc", OctetString(1073741824, "<f8", 3)),
        Field("gyro", "gyro", OctetString(1073741824, "<f8", 3)),
        Field("mag", "mag", OctetString(1073741824, "<f8", 3)),
    ),
)
_66 = Struct(
    "ImuSpan",
    "ImuSpan",
    (
        Field("metadata", "metadata", _64),
        Field("data", "data", _65),
    ),
)
_67 = Struct(
    "JointState",
    "JointState",
    (
        Field("position", "position", Real()),
        Field("speed", "speed", Real()),
        Field("effort", "effort", Real()),
        Field("raw", "raw", Real()),
        Field("acceleration", "acceleration", Real()),
    ),
)
_68 = Struct(
    "JointLimitRange",
    "JointLimitRange",
    (
        Field("min", "min", _67),
        Field("max", "max", _67),
    ),
)
_69 = Struct(
    "OutOfBounds",
    "OutOfBounds",
    (
        Field("error-name", "error_name", Text(256)),
        Field("min", "min", Real()),
        Field("max", "max", Real()),
        Field("value", "value", Real()),
    ),
)
_70 = Struct(
    "JointLimits",
    "JointLimits",
    (
        Field("vector-name", "vector_name", Text(256)),
        Field("ranges", "ranges", ListOf(_68, 1, 60, "JointLimitRange")),
    ),
)
_71 = Struct(
    "Joints",
    "Joints",
    (
        Field("timestamp", "timestamp", _1),
        Field("names", "names", ListOf(Text(256), 0, 50, "T-String")),
        Field("elements", "elements", ListOf(_67, 0, 50, "JointState")),
    ),
)
_72 = Alias("JointTrajectory", "JointTrajectory", "items", ListOf(_67, 1, 60, "JointState"))
_73 = Struct(
    "JointsTrajectory",
    "JointsTrajectory",
    (
        Field("vector-name", "vector_name", ListOf(Text(256), 1, 60, "T-String")),
        Field("timetags", "timetags", ListOf(_1, 1, 60, "Time")),
        Field("trajectory", "trajectory", ListOf(ListOf(_67, 1, 60, "JointState"), 1, 60, "JointTrajectory")),
    ),
)
_74 = Struct("InvalidTimeStep", "InvalidTimeStep", (Field("time-step", "time_step", Integer(0, 4294967295)),))
_75 = Struct("InvalidName", "InvalidName", (Field("nameString", "name_string", Text(256)),))
_76 = Struct(
    "Wrench",
    "Wrench",
    (
        Field("timestamp", "timestamp", _1),
        Field("force", "force", Array(Real(), ((3, 3),), ("T-Double",))),
        Field("torque", "torque", Array(Real(), ((3, 3),), ("T-Double",))),
    ),
)
_77 = Struct(
    "Wrenches",
    "Wrenches",
    (
        Field("vector-name", "vector_name", Text(256)),
        Field("timestamp", "timestamp", _1),
        Field("wrenches", "wrenches", ListOf(_76, 1, 60, "Wrench")),
    ),
)
_78 = Struct(
    "Pressure",
    "Pressure",
    (
        Field("timestamp", "timestamp", _1),
        Field("pascals", "pascals", Real()),
    ),
)
_79 = Struct("Temperature", "Temperature", (Field("kelvin", "kelvin", Real()),))
_80 = Struct(
    "IMUSensors",
    "IMUSensors",
    (
        Field("timestamp", "timestamp", _1),
        Field("acc", "acc", Array(Real(), ((3, 3),), ("T-Double",))),
        Field("gyro", "gyro", Array(Real(), ((3, 3),), ("T-Double",))),
        Field("mag", "mag", Array(Real(), ((3, 3),), ("T-Double",))),
    ),
)
_81 = Struct(
    "LandmarkMap-Metadata",
    "LandmarkMapMetadata",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("producerId", "producer_id", Text(256)),
        Field("frameId", "frame_id", Text(256)),
        Field("timeStamp", "time_stamp", _1),
        Field("descriptorType", "descriptor_type", Text(256)),
    ),
)
_82 = Struct(
    "Array3DLarge",
    "Array3D",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("rows", "rows", Integer(0, 4294967295)),
        Field("cols", "cols", Integer(0, 4294967295)),
        Field("channels", "channels", Integer(0, 4294967295)),
        Field("depth", "depth", _42),
        Field("rowSize", "row_size", Integer(0, 4294967295)),
        Field("data", "data", OctetString(1073741824, "|u1", 0)),
    ),
)
_83 = Struct(
    "LandmarkMap-Data",
    "LandmarkMapData",
    (
        Field("ids", "ids", OctetString(1073741824, "<i8", 0)),
        Field("positions", "positions", OctetString(1073741824, "<f8", 3)),
        Field("covariances", "covariances", OctetString(1073741824, "<f8", 9)),
        Field("observations", "observations", OctetString(1073741824, "<u4", 0)),
        Field("descriptors", "descriptors", _82),
    ),
)
_84 = Struct(
    "LandmarkMap",
    "LandmarkMap",
    (
        Field("metadata", "metadata", _81),
        Field("data", "data", _83),
    ),
)
_85 = Struct(
    "KeyFrame-Metadata",
    "KeyFrameMetadata",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("id", "id", Integer(0, 9223372036854775807)),
        Field("sensorId", "sensor_id", Text(256)),
        Field("timeStamp", "time_stamp", _1),
        Field("descriptorType", "descriptor_type", Text(256)),
    ),
)
_86 = Struct(
    "KeyFrame-Data",
    "KeyFrameData",
    (
        Field("keypoints", "keypoints", OctetString(1073741824, "<f4", 2)),
        Field("scales", "scales", OctetString(1073741824, "<f4", 0)),
        Field("landmarks", "landmarks", OctetString(1073741824, "<i8", 0)),
        Field("descriptors", "descriptors", _82),
    ),
)
_87 = Struct(
    "KeyFrame",
    "KeyFrame",
    (
        Field("metadata", "metadata", _85),
        Field("pose", "pose", _55),
        Field("intrinsic", "intrinsic", _52),
        Field("data", "data", _86),
    ),
)
_88 = Struct(
    "FrameLarge",
    "Frame",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("metadata", "metadata", _50),
        Field("intrinsic", "intrinsic", _52),
        Field("extrinsic", "extrinsic", _56),
        Field("data", "data", _82),
    ),
)
_89 = Struct(
    "FramePairLarge",
    "FramePair",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("baseline", "baseline", Real()),
        Field("left", "left", _88),
        Field("right", "right", _88),
    ),
)
_90 = Alias("FramesSequenceLarge", "FramesSequence", "items", ListOf(_88, 0, 1024, "FrameLarge"))
_91 = Struct(
    "CompressedFrameLarge",
    "CompressedFrame",
    (
        Field("ref-time", "ref_time", _1),
        Field("received-time", "received_time", _1),
        Field("image", "image", Array(Integer(0, 255), ((1, 268435456),), ("T-UInt8",))),
        Field("attributes", "attributes", ListOf(_47, 1, 10, "Frame-attrib-t")),
        Field("rows", "rows", Integer(0, 4294967295)),
        Field("cols", "cols", Integer(0, 4294967295)),
        Field("frame-mode", "frame_mode", _59),
        Field("frame-status", "frame_status", _49),
    ),
)
_92 = Enumeration("MapTypeT", (("map-UNDEF", 0), ("map-DEM", 1), ("map-NAV", 2)))
_93 = Struct(
    "Map-metadata-t",
    "MapMetadataT",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("timeStamp", "time_stamp", _1),
        Field("type", "type", _92),
        Field("errValues", "err_values", ListOf(_46, 0, 5, "Frame-error-t")),
        Field("scale", "scale", Real()),
        Field("pose-fixedFrame-mapFrame", "pose_fixed_frame_map_frame", _55),
    ),
)
_94 = Struct(
    "MapLarge",
    "Map",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("metadata", "metadata", _93),
        Field("data", "data", _82),
    ),
)
_95 = Struct(
    "PointCloud-DataLarge",
    "PointCloudData",
    (
        Field("points", "points", Array(Real(), ((0, 16777216), (3, 3)), ("Point", "T-Double"))),
        Field("colors", "colors", Array(Real(), ((0, 16777216), (3, 3)), ("Vector3d", "T-Double"))),
        Field(
            "intensity", "intensity", Array(Integer(-2147483648, 2147483647), ((0, 16777216),), ("T-Int32",))
        ),
    ),
)
_96 = Struct(
    "PointCloud-Metadata",
    "PointCloudMetadata",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("sensorId", "sensor_id", Text(256)),
        Field("frameId", "frame_id", Text(256)),
        Field("timeStamp", "time_stamp", _1),
        Field("height", "height", Integer(0, 4294967295)),
        Field("width", "width", Integer(0, 4294967295)),
        Field("isRegistered", "is_registered", Boolean()),
        Field("isOrdered", "is_ordered", Boolean()),
        Field("hasFixedTransform", "has_fixed_transform", Boolean()),
        Field("pose-robotFrame-sensorFrame", "pose_robot_frame_sensor_frame", _55),
        Field("pose-fixedFrame-robotFrame", "pose_fixed_frame_robot_frame", _55),
    ),
)
_97 = Struct(
    "PointcloudLarge",
    "Pointcloud",
    (
        Field("metadata", "metadata", _96),
        Field("data", "data", _95),
    ),
)
_98 = Struct(
    "OctreeLarge",
    "Octree",
    (
        Field("resolution", "resolution", Real()),
        Field("pointCloud", "point_cloud", _97),
    ),
)
_99 = Alias(
    "CorrespondenceMap2DLarge", "CorrespondenceMap2D", "items", ListOf(_30, 0, 1048576, "Correspondence2D")
)
_100 = Alias(
    "CorrespondenceMap3DLarge", "CorrespondenceMap3D", "items", ListOf(_32, 0, 1048576, "Correspondence3D")
)
_101 = Alias(
    "CorrespondenceMaps2DSequenceLarge",
    "CorrespondenceMaps2DSequence",
    "items",
    ListOf(ListOf(_30, 0, 1048576, "Correspondence2D"), 0, 16384, "CorrespondenceMap2DLarge"),
)
_102 = Alias(
    "CorrespondenceMaps3DSequenceLarge",
    "CorrespondenceMaps3DSequence",
    "items",
    ListOf(ListOf(_32, 0, 1048576, "Correspondence3D"), 0, 16384, "CorrespondenceMap3DLarge"),
)
_103 = Alias(
    "VisualPointFeatureVector2DLarge",
    "VisualPointFeatureVector2D",
    "items",
    ListOf(_34, 0, 1048576, "VisualPointFeature2D"),
)
_104 = Struct(
    "VisualPointFeatureVector3DLarge",
    "VisualPointFeatureVector3D",
    (
        Field("list", "list", ListOf(_38, 0, 1048576, "VisualPointFeature3D")),
        Field("list-type", "list_type", _39),
        Field("feature-type", "feature_type", _40),
    ),
)
_105 = Struct(
    "Pose",
    "Pose",
    (
        Field("pos", "pos", Array(Real(), ((3, 3),), ("T-Double",))),
        Field("orient", "orient", Array(Real(), ((4, 4),), ("T-Double",))),
    ),
)
_106 = Alias("PosesSequenceLarge", "PosesSequence", "items", ListOf(_105, 0, 1048576, "Pose"))
_107 = Alias(
    "PointSequenceLarge",
    "PointSequence",
    "values",
    Array(Real(), ((0, 16777216), (3, 3)), ("Point", "T-Double")),
)
_108 = Alias(
    "DoubleSequenceLarge", "DoubleSequence", "values", Array(Real(), ((0, 16777216),), ("T-Double",))
)
_109 = Alias("StringSequenceLarge", "StringSequence", "items", ListOf(Text(256), 0, 65536, "T-String"))
_110 = Alias(
    "VectorXdSequenceLarge",
    "VectorXdSequence",
    "items",
    ListOf(Array(Real(), ((0, 100),), ("T-Double",)), 0, 16777216, "VectorXd"),
)
_111 = Struct(
    "PathLarge",
    "Path",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("timeStamp", "time_stamp", _1),
        Field("waypoints", "waypoints", ListOf(_55, 0, 1048576, "TransformWithCovariance")),
    ),
)
_112 = Struct(
    "TrajectoryLarge",
    "Trajectory",
    (
        Field("speed", "speed", Real()),
        Field("points", "points", Array(Real(), ((1, 1048576), (3, 3)), ("Point", "T-Double"))),
    ),
)
_113 = Struct(
    "LaserScanLarge",
    "LaserScan",
    (
        Field("ref-time", "ref_time", _1),
        Field("start-angle", "start_angle", Real()),
        Field("angular-resolution", "angular_resolution", Real()),
        Field("speed", "speed", Real()),
        Field("ranges", "ranges", Array(Integer(-2147483648, 2147483647), ((1, 16777216),), ("T-Int32",))),
        Field("minRange", "min_range", Integer(0, 4294967295)),
        Field("maxRange", "max_range", Integer(0, 4294967295)),
        Field("remission", "remission", Array(Real(), ((1, 16777216),), ("T-Float",))),
    ),
)
_114 = Enumeration("ProjectionType", (("polar", 0), ("planar", 1)))
_115 = Struct(
    "DepthMapLarge",
    "DepthMap",
    (
        Field("ref-time", "ref_time", _1),
        Field("timestamps", "timestamps", ListOf(_1, 1, 16777216, "Time")),
        Field("vertical-projection", "vertical_projection", _114),
        Field("horizontal-projection", "horizontal_projection", _114),
        Field("vertical-interval", "vertical_interval", Array(Real(), ((1, 16777216),), ("T-Double",))),
        Field("horizontal-interval", "horizontal_interval", Array(Real(), ((1, 16777216),), ("T-Double",))),
        Field("vertical-size", "vertical_size", Integer(0, 4294967295)),
        Field("horizontal-size", "horizontal_size", Integer(0, 4294967295)),
        Field("distances", "distances", Array(Real(), ((1, 16777216),), ("T-Float",))),
        Field("remissions", "remissions", Array(Real(), ((1, 16777216),), ("T-Float",))),
    ),
)
_116 = Struct(
    "DistanceImageLarge",
    "DistanceImage",
    (
        Field("ref-time", "ref_time", _1),
        Field("width", "width", Integer(0, 65535)),
        Field("height", "height", Integer(0, 65535)),
        Field("scale-x", "scale_x", Real()),
        Field("scale-y", "scale_y", Real()),
        Field("center-x", "center_x", Real()),
        Field("center-y", "center_y", Real()),
        Field("data", "data", Array(Real(), ((1, 16777216),), ("T-Float",))),
    ),
)
_117 = Struct(
    "LidarMap-Metadata",
    "LidarMapMetadata",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("producerId", "producer_id", Text(256)),
        Field("sensorId", "sensor_id", Text(256)),
        Field("timeStamp", "time_stamp", _1),
    ),
)
_118 = Struct(
    "LidarMap-Clouds",
    "LidarMapClouds",
    (
        Field("counts", "counts", OctetString(1073741824, "<i8", 0)),
        Field("points", "points", OctetString(1073741824, "<f4", 3)),
    ),
)
_119 = Struct(
    "LidarMap-Position",
    "LidarMapPosition",
    (
        Field("vertices", "vertices", OctetString(1073741824, "<i8", 0)),
        Field("poses", "poses", OctetString(1073741824, "<f8", 7)),
    ),
)
_120 = Struct(
    "PoseGraph-Metadata",
    "PoseGraphMetadata",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("producerId", "producer_id", Text(256)),
        Field("frameId", "frame_id", Text(256)),
        Field("timeStamp", "time_stamp", _1),
    ),
)
_121 = Struct(
    "PoseGraph-Vertices",
    "PoseGraphVertices",
    (
        Field("ids", "ids", OctetString(1073741824, "<i8", 0)),
        Field("stamps", "stamps", OctetString(1073741824, "<i8", 0)),
        Field("poses", "poses", OctetString(1073741824, "<f8", 7)),
        Field("fixed", "fixed", OctetString(1073741824, "<u1", 0)),
    ),
)
_122 = Struct(
    "PoseGraph-Edges",
    "PoseGraphEdges",
    (
        Field("ends", "ends", OctetString(1073741824, "<i8", 2)),
        Field("poses", "poses", OctetString(1073741824, "<f8", 7)),
        Field("information", "information", OctetString(1073741824, "<f8", 36)),
        Field("kinds", "kinds", OctetString(1073741824, "<u1", 0)),
    ),
)
_123 = Struct(
    "PoseGraph",
    "PoseGraph",
    (
        Field("metadata", "metadata", _120),
        Field("vertices", "vertices", _121),
        Field("edges", "edges", _122),
    ),
)
_124 = Struct(
    "LidarMap",
    "LidarMap",
    (
        Field("metadata", "metadata", _117),
        Field("graph", "graph", _123),
        Field("clouds", "clouds", _118),
        Field("position", "position", _119),
    ),
)
_125 = Struct(
    "LidarScan-Metadata",
    "LidarScanMetadata",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("sensorId", "sensor_id", Text(256)),
        Field("frameId", "frame_id", Text(256)),
        Field("startTime", "start_time", _1),
        Field("endTime", "end_time", _1),
    ),
)
_126 = Struct(
    "LidarScan-Data",
    "LidarScanData",
    (
        Field("points", "points", OctetString(1073741824, "<f4", 3)),
        Field("timeOffsets", "time_offsets", OctetString(1073741824, "<u4", 0)),
        Field("intensity", "intensity", OctetString(1073741824, "<u2", 0)),
        Field("ring", "ring", OctetString(1073741824, "<u2", 0)),
    ),
)
_127 = Struct(
    "LidarScan",
    "LidarScan",
    (
        Field("metadata", "metadata", _125),
        Field("data", "data", _126),
    ),
)
_128 = Struct(
    "Map",
    "Map",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("metadata", "metadata", _93),
        Field("data", "data", _43),
    ),
)
_129 = Struct(
    "GridMap-Metadata",
    "GridMapMetadata",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("frameId", "frame_id", Text(256)),
        Field("startTime", "start_time", _1),
        Field("endTime", "end_time", _1),
        Field("resolution", "resolution", Real()),
        Field("xMin", "x_min", Real()),
        Field("yMax", "y_max", Real()),
        Field("rows", "rows", Integer(0, 4294967295)),
        Field("cols", "cols", Integer(0, 4294967295)),
    ),
)
_130 = Struct(
    "GridLayer",
    "GridLayer",
    (
        Field("name", "name", Text(256)),
        Field("depth", "depth", _42),
        Field("data", "data", OctetString(1073741824, "|u1", 0)),
    ),
)
_131 = Struct(
    "ElevationMap",
    "ElevationMap",
    (
        Field("metadata", "metadata", _129),
        Field("layers", "layers", ListOf(_130, 0, 64, "GridLayer")),
    ),
)
_132 = Struct(
    "NavigationMap",
    "NavigationMap",
    (
        Field("metadata", "metadata", _129),
        Field("layers", "layers", ListOf(_130, 0, 64, "GridLayer")),
    ),
)
_133 = Struct(
    "Mesh-Metadata",
    "MeshMetadata",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("producerId", "producer_id", Text(256)),
        Field("frameId", "frame_id", Text(256)),
        Field("timeStamp", "time_stamp", _1),
    ),
)
_134 = Struct(
    "Mesh-Data",
    "MeshData",
    (
        Field("vertices", "vertices", OctetString(1073741824, "<f8", 3)),
        Field("triangles", "triangles", OctetString(1073741824, "<u4", 3)),
        Field("normals", "normals", OctetString(1073741824, "<f4", 3)),
        Field("colors", "colors", OctetString(1073741824, "<u1", 3)),
    ),
)
_135 = Struct(
    "Mesh",
    "Mesh",
    (
        Field("metadata", "metadata", _133),
        Field("data", "data", _134),
    ),
)
_136 = Struct(
    "ObjectDetection",
    "ObjectDetection",
    (
        Field("label", "label", Text(256)),
        Field("score", "score", Real()),
        Field("pose", "pose", _55),
        Field("size", "size", Array(Real(), ((3, 3),), ("T-Double",))),
        Field("imageBox", "image_box", Array(Real(), ((4, 4),), ("T-Double",))),
        Field("symmetricPoses", "symmetric_poses", OctetString(1073741824, "<f8", 7)),
    ),
)
_137 = Struct(
    "ObjectDetections",
    "ObjectDetections",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("timeStamp", "time_stamp", _1),
        Field("producerId", "producer_id", Text(256)),
        Field("sensorId", "sensor_id", Text(256)),
        Field("frameId", "frame_id", Text(256)),
        Field("detections", "detections", ListOf(_136, 0, 4096, "ObjectDetection")),
    ),
)
_138 = Enumeration("ObjectTrackStatusT", (("track-TENTATIVE", 0), ("track-CONFIRMED", 1), ("track-LOST", 2)))
_139 = Struct(
    "ObjectTrack-Metadata",
    "ObjectTrackMetadata",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("timeStamp", "time_stamp", _1),
        Field("producerId", "producer_id", Text(256)),
        Field("frameId", "frame_id", Text(256)),
        Field("trackId", "track_id", Integer(0, 4294967295)),
        Field("label", "label", Text(256)),
        Field("status", "status", _138),
        Field("score", "score", Real()),
        Field("size", "size", Array(Real(), ((3, 3),), ("T-Double",))),
    ),
)
_140 = Struct(
    "ObjectTrack-Data",
    "ObjectTrackData",
    (
        Field("stamps", "stamps", OctetString(1073741824, "<i8", 0)),
        Field("poses", "poses", OctetString(1073741824, "<f8", 7)),
        Field("velocities", "velocities", OctetString(1073741824, "<f8", 6)),
        Field("covariances", "covariances", OctetString(1073741824, "<f8", 36)),
        Field("velocityCovariances", "velocity_covariances", OctetString(1073741824, "<f8", 36)),
    ),
)
_141 = Struct(
    "ObjectTrack",
    "ObjectTrack",
    (
        Field("metadata", "metadata", _139),
        Field("data", "data", _140),
    ),
)
_142 = Enumeration(
    "Og2RegionKindT",
    (
        ("region-ANY", 0),
        ("region-BBOX", 1),
        ("region-BOX", 2),
        ("region-CIRCLE", 3),
        ("region-POLYGON", 4),
        ("region-NEAR", 5),
    ),
)
_143 = Struct(
    "OG2-Region",
    "Og2Region",
    (
        Field("kind", "kind", _142),
        Field("frameId", "frame_id", Text(256)),
        Field("numbers", "numbers", Array(Real(), ((0, 100),), ("T-Double",))),
    ),
)
_144 = Enumeration("Og2DeliverT", (("deliver-AUTO", 0), ("deliver-INLINE", 1), ("deliver-REFERENCE", 2)))
_145 = Struct(
    "OG2-Request",
    "Og2Request",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("requestId", "request_id", Text(256)),
        Field("robot", "robot", Text(256)),
        Field("product", "product", Text(256)),
        Field("asType", "as_type", Text(256)),
        Field("format", "format", Text(256)),
        Field("frameId", "frame_id", Text(256)),
        Field("childFrameId", "child_frame_id", Text(256)),
        Field("hasTime", "has_time", Boolean()),
        Field("time", "time", _1),
        Field("region", "region", _143),
        Field("maxAge", "max_age", Real()),
        Field("resolution", "resolution", Real()),
        Field("minCoverage", "min_coverage", Real()),
        Field("deliver", "deliver", _144),
        Field("deadline", "deadline", Integer(0, 4294967295)),
    ),
)
_146 = Enumeration(
    "Og2JobStateT",
    (
        ("job-RECEIVED", 0),
        ("job-LOOKING", 1),
        ("job-PLANNING", 2),
        ("job-PREPARING", 3),
        ("job-WAITING", 4),
        ("job-DELIVERING", 5),
        ("job-DONE", 6),
        ("job-FAILED", 7),
        ("job-CANCELLED", 8),
    ),
)
_147 = Struct(
    "OG2-Job",
    "Og2Job",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("timeStamp", "time_stamp", _1),
        Field("jobId", "job_id", Text(256)),
        Field("requestId", "request_id", Text(256)),
        Field("robot", "robot", Text(256)),
        Field("product", "product", Text(256)),
        Field("state", "state", _146),
        Field("reason", "reason", Text(256)),
        Field("remaining", "remaining", Real()),
        Field("plan", "plan", ListOf(Text(256), 0, 256, "T-String")),
    ),
)
_148 = Enumeration(
    "Og2ReplyKindT", (("reply-PROGRESS", 0), ("reply-PRODUCT", 1), ("reply-REFERENCE", 2), ("reply-ERROR", 3))
)
_149 = Enumeration(
    "Og2ErrorCodeT",
    (
        ("error-NONE", 0),
        ("error-INVALID-ARGUMENT", 1),
        ("error-NOT-FOUND", 2),
        ("error-NOT-ACTIVE", 3),
        ("error-UNAVAILABLE", 4),
        ("error-DEADLINE", 5),
        ("error-OVERLOADED", 6),
        ("error-DENIED", 7),
        ("error-INTERNAL", 8),
    ),
)
_150 = Enumeration("ProductStatusT", (("status-OK", 0), ("status-DEGRADED", 1), ("status-FAILED", 2)))
_151 = Enumeration(
    "ProductCovarianceKindT", (("covariance-NONE", 0), ("covariance-FORMAL", 1), ("covariance-CALIBRATED", 2))
)
_152 = Struct(
    "Product-metric-t",
    "ProductMetricT",
    (
        Field("name", "name", Text(256)),
        Field("value", "value", Real()),
    ),
)
_153 = Struct(
    "Product-Quality",
    "ProductQuality",
    (
        Field("status", "status", _150),
        Field("reasons", "reasons", ListOf(Text(256), 0, 256, "T-String")),
        Field("covarianceKind", "covariance_kind", _151),
        Field("metrics", "metrics", ListOf(_152, 0, 1024, "Product-metric-t")),
    ),
)
_154 = Struct(
    "Product-Metadata",
    "ProductMetadata",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("id", "id", Text(256)),
        Field("robot", "robot", Text(256)),
        Field("dfpc", "dfpc", Text(256)),
        Field("port", "port", Text(256)),
        Field("product", "product", Text(256)),
        Field("encoding", "encoding", Text(256)),
        Field("size", "size", Integer(0, 9223372036854775807)),
        Field("sha256", "sha256", Text(256)),
        Field("seq", "seq", Integer(0, 9223372036854775807)),
        Field("startTime", "start_time", _1),
        Field("endTime", "end_time", _1),
        Field("frameId", "frame_id", Text(256)),
        Field("childFrameId", "child_frame_id", Text(256)),
        Field("producerId", "producer_id", Text(256)),
        Field("configHash", "config_hash", Text(256)),
        Field("inputs", "inputs", ListOf(Text(256), 0, 65535, "T-String")),
        Field("quality", "quality", _153),
        Field("hasBox", "has_box", Boolean()),
        Field("box", "box", Array(Real(), ((6, 6),), ("T-Double",))),
        Field("resolution", "resolution", Real()),
    ),
)
_155 = Struct(
    "OG2-Reply",
    "Og2Reply",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("timeStamp", "time_stamp", _1),
        Field("requestId", "request_id", Text(256)),
        Field("jobId", "job_id", Text(256)),
        Field("kind", "kind", _148),
        Field("isFinal", "is_final", Boolean()),
        Field("errorCode", "error_code", _149),
        Field("retriable", "retriable", Boolean()),
        Field("detail", "detail", Text(256)),
        Field("metadata", "metadata", _154),
        Field("coverage", "coverage", Real()),
        Field("age", "age", Real()),
        Field("oldestAge", "oldest_age", Real()),
        Field("differences", "differences", ListOf(Text(256), 0, 256, "T-String")),
        Field("payload", "payload", OctetString(1073741824, "|u1", 0)),
    ),
)
_156 = Struct(
    "PointCloud-Data",
    "PointCloudData",
    (
        Field("points", "points", Array(Real(), ((0, 400000), (3, 3)), ("Point", "T-Double"))),
        Field("colors", "colors", Array(Real(), ((0, 400000), (3, 3)), ("Vector3d", "T-Double"))),
        Field(
            "intensity", "intensity", Array(Integer(-2147483648, 2147483647), ((0, 400000),), ("T-Int32",))
        ),
    ),
)
_157 = Struct(
    "Pointcloud",
    "Pointcloud",
    (
        Field("metadata", "metadata", _96),
        Field("data", "data", _156),
    ),
)
_158 = Struct(
    "Octree",
    "Octree",
    (
        Field("resolution", "resolution", Real()),
        Field("pointCloud", "point_cloud", _157),
    ),
)
_159 = Alias("Position", "Position", "values", Array(Real(), ((3, 3),), ("T-Double",)))
_160 = Alias("Position2D", "Position2D", "values", Array(Real(), ((2, 2),), ("T-Double",)))
_161 = Alias("Orientation", "Orientation", "values", Array(Real(), ((4, 4),), ("T-Double",)))
_162 = Struct(
    "PoseUpdateThreshold",
    "PoseUpdateThreshold",
    (
        Field("distance", "distance", Real()),
        Field("angle", "angle", Real()),
    ),
)
_163 = Struct(
    "Pose2D",
    "Pose2D",
    (
        Field("position", "position", Array(Real(), ((2, 2),), ("T-Double",))),
        Field("orientation", "orientation", Real()),
    ),
)
_164 = Struct(
    "Motion2D",
    "Motion2D",
    (
        Field("translation", "translation", Real()),
        Field("rotation", "rotation", Real()),
    ),
)
_165 = Struct(
    "TwistWithCovariance-metadata",
    "TwistWithCovarianceMetadata",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("timeStamp", "time_stamp", _1),
    ),
)
_166 = Struct(
    "TwistWithCovariance-data",
    "TwistWithCovarianceData",
    (
        Field("vel", "vel", Array(Real(), ((3, 3),), ("T-Double",))),
        Field("rot", "rot", Array(Real(), ((3, 3),), ("T-Double",))),
        Field("cov", "cov", Array(Real(), ((6, 6), (6, 6)), ("SEQUENCE_OF", "T-Double"))),
    ),
)
_167 = Struct(
    "TwistWithCovariance",
    "TwistWithCovariance",
    (
        Field("metadata", "metadata", _165),
        Field("data", "data", _166),
    ),
)
_168 = Struct(
    "BodyState",
    "BodyState",
    (
        Field("ref-time", "ref_time", _1),
        Field("pose", "pose", _55),
        Field("velocity", "velocity", _167),
    ),
)
_169 = Struct(
    "RigidBodyState",
    "RigidBodyState",
    (
        Field("timestamp", "timestamp", _1),
        Field("sourceFrame", "source_frame", Text(256)),
        Field("targetFrame", "target_frame", Text(256)),
        Field("pos", "pos", Array(Real(), ((3, 3),), ("T-Double",))),
        Field("cov-position", "cov_position", Array(Real(), ((3, 3), (3, 3)), ("SEQUENCE_OF", "T-Double"))),
        Field("orient", "orient", Array(Real(), ((4, 4),), ("T-Double",))),
        Field(
            "cov-orientation", "cov_orientation", Array(Real(), ((3, 3), (3, 3)), ("SEQUENCE_OF", "T-Double"))
        ),
        Field("velocity", "velocity", Array(Real(), ((3, 3),), ("T-Double",))),
        Field("cov-velocity", "cov_velocity", Array(Real(), ((3, 3), (3, 3)), ("SEQUENCE_OF", "T-Double"))),
        Field("angular-velocity", "angular_velocity", Array(Real(), ((3, 3),), ("T-Double",))),
        Field(
            "cov-angular-velocity",
            "cov_angular_velocity",
            Array(Real(), ((3, 3), (3, 3)), ("SEQUENCE_OF", "T-Double")),
        ),
    ),
)
_170 = Struct(
    "RigidBodyAcceleration",
    "RigidBodyAcceleration",
    (
        Field("ref-time", "ref_time", _1),
        Field("acceleration", "acceleration", Array(Real(), ((3, 3),), ("T-Double",))),
        Field(
            "cov-acceleration",
            "cov_acceleration",
            Array(Real(), ((3, 3), (3, 3)), ("SEQUENCE_OF", "T-Double")),
        ),
    ),
)
_171 = Struct(
    "Waypoint",
    "Waypoint",
    (
        Field("position", "position", Array(Real(), ((3, 3),), ("T-Double",))),
        Field("heading", "heading", Real()),
        Field("tol-position", "tol_position", Real()),
        Field("tol-heading", "tol_heading", Real()),
    ),
)
_172 = Struct(
    "Trajectory",
    "Trajectory",
    (
        Field("speed", "speed", Real()),
        Field("points", "points", Array(Real(), ((1, 50), (3, 3)), ("Point", "T-Double"))),
    ),
)
_173 = Struct(
    "Path",
    "Path",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("timeStamp", "time_stamp", _1),
        Field("waypoints", "waypoints", ListOf(_55, 0, 100, "TransformWithCovariance")),
    ),
)
_174 = Struct(
    "PoseTrajectory-Metadata",
    "PoseTrajectoryMetadata",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("producerId", "producer_id", Text(256)),
        Field("parentFrameId", "parent_frame_id", Text(256)),
        Field("childFrameId", "child_frame_id", Text(256)),
    ),
)
_175 = Struct(
    "PoseTrajectory-Data",
    "PoseTrajectoryData",
    (
        Field("stamps", "stamps", OctetString(1073741824, "<i8", 0)),
        Field("poses", "poses", OctetString(1073741824, "<f8", 7)),
        Field("covariances", "covariances", OctetString(1073741824, "<f8", 36)),
    ),
)
_176 = Struct(
    "PoseTrajectory",
    "PoseTrajectory",
    (
        Field("metadata", "metadata", _174),
        Field("data", "data", _175),
    ),
)
_177 = Struct(
    "PositionState-Metadata",
    "PositionStateMetadata",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("producerId", "producer_id", Text(256)),
    ),
)
_178 = Struct(
    "PositionState-Links",
    "PositionStateLinks",
    (
        Field("covariances", "covariances", OctetString(1073741824, "<f8", 9)),
        Field("links", "links", OctetString(1073741824, "<f8", 9)),
        Field("pins", "pins", OctetString(1073741824, "<i8", 0)),
        Field("broken", "broken", OctetString(1073741824, "<i8", 0)),
    ),
)
_179 = Struct(
    "PositionState-Filter",
    "PositionStateFilter",
    (
        Field("start", "start", OctetString(1073741824, "<f8", 7)),
        Field("startCovariance", "start_covariance", OctetString(1073741824, "<f8", 36)),
        Field("body", "body", OctetString(1073741824, "<f8", 7)),
        Field("vectors", "vectors", OctetString(1073741824, "<f8", 3)),
        Field("names", "names", ListOf(Text(256), 0, 64, "T-String")),
        Field("stamps", "stamps", OctetString(1073741824, "<i8", 0)),
        Field("poses", "poses", OctetString(1073741824, "<f8", 7)),
        Field("measured", "measured", OctetString(1073741824, "<f8", 7)),
        Field("measuredCovariances", "measured_covariances", OctetString(1073741824, "<f8", 36)),
        Field("covariance", "covariance", OctetString(1073741824, "<f8", 6)),
    ),
)
_180 = Struct(
    "PositionState-Joints",
    "PositionStateJoints",
    (
        Field("names", "names", ListOf(Text(256), 0, 256, "T-String")),
        Field("counts", "counts", OctetString(1073741824, "<i8", 0)),
        Field("stamps", "stamps", OctetString(1073741824, "<i8", 0)),
        Field("values", "values", OctetString(1073741824, "<f8", 0)),
        Field("broken", "broken", OctetString(1073741824, "<i8", 0)),
    ),
)
_181 = Struct(
    "PositionState",
    "PositionState",
    (
        Field("metadata", "metadata", _177),
        Field("line", "line", _176),
        Field("links", "links", _178),
        Field("filter", "filter", _179),
        Field("joints", "joints", _180),
    ),
)
_182 = Enumeration(
    "LaserRangeErrors",
    (
        ("too-far", 0),
        ("too-near", 1),
        ("measurement-error", 2),
        ("other-range-errors", 3),
        ("max-range-error", 4),
        ("end-laser-range-errors", 5),
    ),
)
_183 = Struct(
    "LaserScan",
    "LaserScan",
    (
        Field("ref-time", "ref_time", _1),
        Field("start-angle", "start_angle", Real()),
        Field("angular-resolution", "angular_resolution", Real()),
        Field("speed", "speed", Real()),
        Field("ranges", "ranges", Array(Integer(-2147483648, 2147483647), ((1, 2000),), ("T-Int32",))),
        Field("minRange", "min_range", Integer(0, 4294967295)),
        Field("maxRange", "max_range", Integer(0, 4294967295)),
        Field("remission", "remission", Array(Real(), ((1, 2000),), ("T-Float",))),
    ),
)
_184 = Enumeration("UnitAxis", (("unit-x", 0), ("unit-y", 1), ("unit-z", 2)))
_185 = Enumeration(
    "DepthMeasurementState",
    (("valid-measurement", 0), ("too-far", 1), ("too-near", 2), ("measurement-error", 3)),
)
_186 = Struct(
    "DepthMap",
    "DepthMap",
    (
        Field("ref-time", "ref_time", _1),
        Field("timestamps", "timestamps", ListOf(_1, 1, 30000, "Time")),
        Field("vertical-projection", "vertical_projection", _114),
        Field("horizontal-projection", "horizontal_projection", _114),
        Field("vertical-interval", "vertical_interval", Array(Real(), ((1, 30000),), ("T-Double",))),
        Field("horizontal-interval", "horizontal_interval", Array(Real(), ((1, 30000),), ("T-Double",))),
        Field("vertical-size", "vertical_size", Integer(0, 4294967295)),
        Field("horizontal-size", "horizontal_size", Integer(0, 4294967295)),
        Field("distances", "distances", Array(Real(), ((1, 30000),), ("T-Float",))),
        Field("remissions", "remissions", Array(Real(), ((1, 30000),), ("T-Float",))),
    ),
)
_187 = Struct(
    "DistanceImage",
    "DistanceImage",
    (
        Field("ref-time", "ref_time", _1),
        Field("width", "width", Integer(0, 65535)),
        Field("height", "height", Integer(0, 65535)),
        Field("scale-x", "scale_x", Real()),
        Field("scale-y", "scale_y", Real()),
        Field("center-x", "center_x", Real()),
        Field("center-y", "center_y", Real()),
        Field("data", "data", Array(Real(), ((1, 60),), ("T-Float",))),
    ),
)
_188 = Struct(
    "Sonar",
    "Sonar",
    (
        Field("ref-time", "ref_time", _1),
        Field("timestamps", "timestamps", ListOf(_1, 1, 60, "Time")),
        Field("bin-duration", "bin_duration", _1),
        Field("beam-width", "beam_width", _28),
        Field("beam-height", "beam_height", _28),
        Field("bearings", "bearings", ListOf(_28, 1, 60, "Angle")),
        Field("speed-of-sound", "speed_of_sound", Real()),
        Field("bin-count", "bin_count", Integer(0, 4294967295)),
        Field("beam-count", "beam_count", Integer(0, 4294967295)),
        Field("bins", "bins", Array(Real(), ((1, 60),), ("T-Float",))),
    ),
)
_189 = Struct(
    "SonarBeam",
    "SonarBeam",
    (
        Field("ref-time", "ref_time", _1),
        Field("bearing", "bearing", _28),
        Field("sampling-interval", "sampling_interval", Real()),
        Field("speed-of-sound", "speed_of_sound", Real()),
        Field("beamwidth-horizontal", "beamwidth_horizontal", Real()),
        Field("beamwidth-vertical", "beamwidth_vertical", Real()),
        Field("beam", "beam", Array(Integer(0, 255), ((1, 60),), ("T-UInt8",))),
    ),
)
_190 = Struct(
    "SonarScan",
    "SonarScan",
    (
        Field("ref-time", "ref_time", _1),
        Field("data", "data", Array(Integer(0, 255), ((1, 60),), ("T-UInt8",))),
        Field("time-beams", "time_beams", ListOf(_1, 1, 60, "Time")),
        Field("number-of-beams", "number_of_beams", Integer(0, 65535)),
        Field("number-of-bins", "number_of_bins", Integer(0, 65535)),
        Field("start-bearing", "start_bearing", _28),
        Field("angular-resolution", "angular_resolution", _28),
        Field("sampling-interval", "sampling_interval", Real()),
        Field("speed-of-sound", "speed_of_sound", Real()),
        Field("beamwidth-horizontal", "beamwidth_horizontal", _28),
        Field("beamwidth-vertical", "beamwidth_vertical", _28),
        Field("memory-layout-column", "memory_layout_column", Boolean()),
        Field("polar-coordinates", "polar_coordinates", Boolean()),
    ),
)
_191 = Alias("FramesSequence", "FramesSequence", "items", ListOf(_57, 0, 10, "Frame"))
_192 = Alias("PosesSequence", "PosesSequence", "items", ListOf(_105, 0, 10, "Pose"))
_193 = Alias(
    "CorrespondenceMaps2DSequence",
    "CorrespondenceMaps2DSequence",
    "items",
    ListOf(ListOf(_30, 0, 1024, "Correspondence2D"), 0, 56, "CorrespondenceMap2D"),
)
_194 = Alias(
    "CorrespondenceMaps3DSequence",
    "CorrespondenceMaps3DSequence",
    "items",
    ListOf(ListOf(_32, 0, 51200, "Correspondence3D"), 0, 56, "CorrespondenceMap3D"),
)
_195 = Alias(
    "PointSequence", "PointSequence", "values", Array(Real(), ((0, 327680), (3, 3)), ("Point", "T-Double"))
)
_196 = Alias("DoubleSequence", "DoubleSequence", "values", Array(Real(), ((0, 327680),), ("T-Double",)))
_197 = Alias("StringSequence", "StringSequence", "items", ListOf(Text(256), 0, 100, "T-String"))
_198 = Alias(
    "VectorXdSequence",
    "VectorXdSequence",
    "items",
    ListOf(Array(Real(), ((0, 100),), ("T-Double",)), 0, 327680, "VectorXd"),
)
_199 = Enumeration("IcuStateT", (("icu-STEADY", 0), ("icu-SWITCHING", 1)))
_200 = Struct(
    "ICU-Mode",
    "IcuMode",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("timeStamp", "time_stamp", _1),
        Field("robot", "robot", Text(256)),
        Field("sensor", "sensor", Text(256)),
        Field("mode", "mode", Text(256)),
        Field("target", "target", Text(256)),
        Field("state", "state", _199),
        Field("isOn", "is_on", Boolean()),
        Field("rate", "rate", Real()),
        Field("holder", "holder", Text(256)),
    ),
)
_201 = Enumeration(
    "DfpcStateT", (("dfpc-UNCONFIGURED", 0), ("dfpc-INACTIVE", 1), ("dfpc-ACTIVE", 2), ("dfpc-ERROR", 3))
)
_202 = Struct(
    "DFPC-Status",
    "DfpcStatus",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("timeStamp", "time_stamp", _1),
        Field("robot", "robot", Text(256)),
        Field("dfpc", "dfpc", Text(256)),
        Field("implementation", "implementation", Text(256)),
        Field("configHash", "config_hash", Text(256)),
        Field("state", "state", _201),
        Field("samples", "samples", Integer(0, 9223372036854775807)),
        Field("outputs", "outputs", Integer(0, 9223372036854775807)),
        Field("degraded", "degraded", Integer(0, 9223372036854775807)),
        Field("failed", "failed", Integer(0, 9223372036854775807)),
        Field("dropped", "dropped", Integer(0, 9223372036854775807)),
        Field("malformed", "malformed", Integer(0, 9223372036854775807)),
        Field("meanStep", "mean_step", Real()),
        Field("maxStep", "max_step", Real()),
        Field("lastError", "last_error", Text(256)),
    ),
)
_203 = Struct(
    "Event",
    "Event",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("ordinal", "ordinal", Integer(0, 9223372036854775807)),
        Field("timeStamp", "time_stamp", _1),
        Field("scope", "scope", Text(256)),
        Field("kind", "kind", Text(256)),
        Field("body", "body", OctetString(65536, "|u1", 0)),
    ),
)
_204 = Enumeration("Resolution", (("seconds", 0), ("milliseconds", 1), ("microseconds", 2)))

#: ASN.1 name -> node of every type that can be a message.
MESSAGES: dict[str, Message] = {
    "Asn1Bitstream": _0,
    "Time": _1,
    "Bundle-Metadata": _2,
    "Bundle-Cameras": _3,
    "Bundle-Lenses": _4,
    "Bundle-Points": _5,
    "Bundle-Observations": _6,
    "Bundle-Prior": _7,
    "BundleProblem": _8,
    "Vector2d": _9,
    "Vector3d": _10,
    "Vector4d": _11,
    "Vector6d": _12,
    "VectorXd": _13,
    "Quaterniond": _14,
    "AngleAxisd": _15,
    "Matrix2d": _16,
    "Matrix3d": _17,
    "Matrix4d": _18,
    "Matrix6d": _19,
    "MatrixXd": _20,
    "Affine3d": _21,
    "Isometry3d": _22,
    "Transform3d": _23,
    "Covariance": _24,
    "Point": _25,
    "Point2D": _26,
    "Point3D": _27,
    "Angle": _28,
    "AngleSegment": _29,
    "Correspondence2D": _30,
    "CorrespondenceMap2D": _31,
    "Correspondence3D": _32,
    "CorrespondenceMap3D": _33,
    "VisualPointFeature2D": _34,
    "VisualPointFeatureVector2D": _35,
    "Point3DReference": _36,
    "VisualPointFeature3D": _38,
    "VisualPointFeatureVector3D": _41,
    "Array3D": _43,
    "Frame-error-t": _46,
    "Frame-attrib-t": _47,
    "Frame-metadata-t": _50,
    "Frame-intrinsic-t": _52,
    "TransformWithCovariance-Metadata": _53,
    "TransformWithCovariance-Data": _54,
    "TransformWithCovariance": _55,
    "Frame-extrinsic-t": _56,
    "Frame": _57,
    "FramePair": _58,
    "CompressedFrame": _60,
    "GroundAreas-Metadata": _61,
    "GroundAreas-Data": _62,
    "GroundAreas": _63,
    "ImuSpan-Metadata": _64,
    "ImuSpan-Data": _65,
    "ImuSpan": _66,
    "JointState": _67,
    "JointLimitRange": _68,
    "OutOfBounds": _69,
    "JointLimits": _70,
    "Joints": _71,
    "JointTrajectory": _72,
    "JointsTrajectory": _73,
    "InvalidTimeStep": _74,
    "InvalidName": _75,
    "Wrench": _76,
    "Wrenches": _77,
    "Pressure": _78,
    "Temperature": _79,
    "IMUSensors": _80,
    "LandmarkMap-Metadata": _81,
    "Array3DLarge": _82,
    "LandmarkMap-Data": _83,
    "LandmarkMap": _84,
    "KeyFrame-Metadata": _85,
    "KeyFrame-Data": _86,
    "KeyFrame": _87,
    "FrameLarge": _88,
    "FramePairLarge": _89,
    "FramesSequenceLarge": _90,
    "CompressedFrameLarge": _91,
    "Map-metadata-t": _93,
    "MapLarge": _94,
    "PointCloud-DataLarge": _95,
    "PointCloud-Metadata": _96,
    "PointcloudLarge": _97,
    "OctreeLarge": _98,
    "CorrespondenceMap2DLarge": _99,
    "CorrespondenceMap3DLarge": _100,
    "CorrespondenceMaps2DSequenceLarge": _101,
    "CorrespondenceMaps3DSequenceLarge": _102,
    "VisualPointFeatureVector2DLarge": _103,
    "VisualPointFeatureVector3DLarge": _104,
    "Pose": _105,
    "PosesSequenceLarge": _106,
    "PointSequenceLarge": _107,
    "DoubleSequenceLarge": _108,
    "StringSequenceLarge": _109,
    "VectorXdSequenceLarge": _110,
    "PathLarge": _111,
    "TrajectoryLarge": _112,
    "LaserScanLarge": _113,
    "DepthMapLarge": _115,
    "DistanceImageLarge": _116,
    "LidarMap-Metadata": _117,
    "LidarMap-Clouds": _118,
    "LidarMap-Position": _119,
    "PoseGraph-Metadata": _120,
    "PoseGraph-Vertices": _121,
    "PoseGraph-Edges": _122,
    "PoseGraph": _123,
    "LidarMap": _124,
    "LidarScan-Metadata": _125,
    "LidarScan-Data": _126,
    "LidarScan": _127,
    "Map": _128,
    "GridMap-Metadata": _129,
    "GridLayer": _130,
    "ElevationMap": _131,
    "NavigationMap": _132,
    "Mesh-Metadata": _133,
    "Mesh-Data": _134,
    "Mesh": _135,
    "ObjectDetection": _136,
    "ObjectDetections": _137,
    "ObjectTrack-Metadata": _139,
    "ObjectTrack-Data": _140,
    "ObjectTrack": _141,
    "OG2-Region": _143,
    "OG2-Request": _145,
    "OG2-Job": _147,
    "Product-metric-t": _152,
    "Product-Quality": _153,
    "Product-Metadata": _154,
    "OG2-Reply": _155,
    "PointCloud-Data": _156,
    "Pointcloud": _157,
    "Octree": _158,
    "Position": _159,
    "Position2D": _160,
    "Orientation": _161,
    "PoseUpdateThreshold": _162,
    "Pose2D": _163,
    "Motion2D": _164,
    "TwistWithCovariance-metadata": _165,
    "TwistWithCovariance-data": _166,
    "TwistWithCovariance": _167,
    "BodyState": _168,
    "RigidBodyState": _169,
    "RigidBodyAcceleration": _170,
    "Waypoint": _171,
    "Trajectory": _172,
    "Path": _173,
    "PoseTrajectory-Metadata": _174,
    "PoseTrajectory-Data": _175,
    "PoseTrajectory": _176,
    "PositionState-Metadata": _177,
    "PositionState-Links": _178,
    "PositionState-Filter": _179,
    "PositionState-Joints": _180,
    "PositionState": _181,
    "LaserScan": _183,
    "DepthMap": _186,
    "DistanceImage": _187,
    "Sonar": _188,
    "SonarBeam": _189,
    "SonarScan": _190,
    "FramesSequence": _191,
    "PosesSequence": _192,
    "CorrespondenceMaps2DSequence": _193,
    "CorrespondenceMaps3DSequence": _194,
    "PointSequence": _195,
    "DoubleSequence": _196,
    "StringSequence": _197,
    "VectorXdSequence": _198,
    "ICU-Mode": _200,
    "DFPC-Status": _202,
    "Event": _203,
}

#: Name -> node of every CHOICE.
CHOICES: dict[str, Choice] = {
    "VisualPointFeature3D-point": _37,
}

#: ASN.1 name -> name of its size variant with larger bounds.
LARGE: dict[str, str] = {
    "CorrespondenceMap2D": "CorrespondenceMap2DLarge",
    "CorrespondenceMap3D": "CorrespondenceMap3DLarge",
    "VisualPointFeatureVector2D": "VisualPointFeatureVector2DLarge",
    "VisualPointFeatureVector3D": "VisualPointFeatureVector3DLarge",
    "Array3D": "Array3DLarge",
    "Frame": "FrameLarge",
    "FramePair": "FramePairLarge",
    "CompressedFrame": "CompressedFrameLarge",
    "Map": "MapLarge",
    "PointCloud-Data": "PointCloud-DataLarge",
    "Pointcloud": "PointcloudLarge",
    "Octree": "OctreeLarge",
    "Trajectory": "TrajectoryLarge",
    "Path": "PathLarge",
    "LaserScan": "LaserScanLarge",
    "DepthMap": "DepthMapLarge",
    "DistanceImage": "DistanceImageLarge",
    "FramesSequence": "FramesSequenceLarge",
    "PosesSequence": "PosesSequenceLarge",
    "CorrespondenceMaps2DSequence": "CorrespondenceMaps2DSequenceLarge",
    "CorrespondenceMaps3DSequence": "CorrespondenceMaps3DSequenceLarge",
    "PointSequence": "PointSequenceLarge",
    "DoubleSequence": "DoubleSequenceLarge",
    "StringSequence": "StringSequenceLarge",
    "VectorXdSequence": "VectorXdSequenceLarge",
}
