# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from cdff_common/asn1/*.asn by cdff generate; do not edit.

"""The types as the codecs see them."""

from __future__ import annotations

from cdff_common.codecs.schema import (
    Alias,
    Array,
    Boolean,
    Choice,
    Enumeration,
    Field,
    Integer,
    ListOf,
    Message,
    Octets,
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
        Field("data", "data", Octets(1073741824, "|u1", 0)),
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
        Field("ids", "ids", Octets(1073741824, "<i8", 0)),
        Field("stamps", "stamps", Octets(1073741824, "<i8", 0)),
        Field("poses", "poses", Octets(1073741824, "<f8", 7)),
        Field("lenses", "lenses", Octets(1073741824, "<u4", 0)),
        Field("fixed", "fixed", Octets(1073741824, "<u1", 0)),
    ),
)
_4 = Struct(
    "Bundle-Lenses",
    "BundleLenses",
    (
        Field("values", "values", Octets(1073741824, "<f8", 10)),
        Field("free", "free", Octets(1073741824, "<u4", 0)),
    ),
)
_5 = Struct(
    "Bundle-Points",
    "BundlePoints",
    (
        Field("ids", "ids", Octets(1073741824, "<i8", 0)),
        Field("positions", "positions", Octets(1073741824, "<f8", 3)),
        Field("fixed", "fixed", Octets(1073741824, "<u1", 0)),
    ),
)
_6 = Struct(
    "Bundle-Observations",
    "BundleObservations",
    (
        Field("cameras", "cameras", Octets(1073741824, "<u4", 0)),
        Field("points", "points", Octets(1073741824, "<u4", 0)),
        Field("pixels", "pixels", Octets(1073741824, "<f8", 3)),
    ),
)
_7 = Struct(
    "Bundle-Prior",
    "BundlePrior",
    (
        Field("cameras", "cameras", Octets(1073741824, "<i8", 0)),
        Field("poses", "poses", Octets(1073741824, "<f8", 7)),
        Field("information", "information", Octets(1073741824, "<f8", 0)),
        Field("gradient", "gradient", Octets(1073741824, "<f8", 0)),
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
_22 = Alias("Isometry3d", "Isometry3d", "values", Array(Real(), ((4, 4), (4, 4)), ("SEQUENCE_OF", "T-Double")))
_23 = Alias("Transform3d", "Transform3d", "values", Array(Real(), ((4, 4), (4, 4)), ("SEQUENCE_OF", "T-Double")))
_24 = Alias("Covariance", "Covariance", "values", Array(Real(), ((6, 6), (6, 6)), ("SEQUENCE_OF", "T-Double")))
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
    "VisualPointFeatureVector2D", "VisualPointFeatureVector2D", "items", ListOf(_34, 0, 1024, "VisualPointFeature2D")
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
    "VisualPointFeatureVector3DType",
    (
        ("all-positions", 0),
        ("all-references", 1),
        ("hybrid-vector", 2),
    ),
)
_40 = Enumeration(
    "VisualPointFeature3DType",
    (
        ("histogram", 0),
        ("shot", 1),
        ("pfh", 2),
    ),
)
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
        Field("data", "data", Octets(66355200, "|u1", 0)),
    ),
)
_44 = Enumeration(
    "FramePixelModelT",
    (
        ("pix-UNDEF", 0),
        ("pix-POLY", 1),
        ("pix-DISP", 2),
    ),
)
_45 = Enumeration(
    "FrameErrorTypeT",
    (
        ("error-UNDEFINED", 0),
        ("error-DEAD", 1),
        ("error-FILTERED", 2),
    ),
)
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
_49 = Enumeration(
    "FrameStatusT",
    (
        ("status-EMPTY", 0),
        ("status-VALID", 1),
        ("status-INVALID", 2),
    ),
)
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
    "FrameCameraModelT",
    (
        ("cam-UNDEF", 0),
        ("cam-PINHOLE", 1),
        ("cam-FISHEYE", 2),
        ("cam-MAPS", 3),
    ),
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
_59 = Enumeration(
    "FrameCompressedModeT",
    (
        ("mode-compressed-undefined", 0),
        ("mode-pjpg", 1),
    ),
)
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
    "ImuSpan-Metadata",
    "ImuSpanMetadata",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("sensorId", "sensor_id", Text(256)),
    ),
)
_62 = Struct(
    "ImuSpan-Data",
    "ImuSpanData",
    (
        Field("stamps", "stamps", Octets(1073741824, "<i8", 0)),
        Field("acc", "acc", Octets(1073741824, "<f8", 3)),
        Field("gyro", "gyro", Octets(1073741824, "<f8", 3)),
        Field("mag", "mag", Octets(1073741824, "<f8", 3)),
    ),
)
_63 = Struct(
    "ImuSpan",
    "ImuSpan",
    (
        Field("metadata", "metadata", _61),
        Field("data", "data", _62),
    ),
)
_64 = Struct(
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
_65 = Struct(
    "JointLimitRange",
    "JointLimitRange",
    (
        Field("min", "min", _64),
        Field("max", "max", _64),
    ),
)
_66 = Struct(
    "OutOfBounds",
    "OutOfBounds",
    (
        Field("error-name", "error_name", Text(256)),
        Field("min", "min", Real()),
        Field("max", "max", Real()),
        Field("value", "value", Real()),
    ),
)
_67 = Struct(
    "JointLimits",
    "JointLimits",
    (
        Field("vector-name", "vector_name", Text(256)),
        Field("ranges", "ranges", ListOf(_65, 1, 60, "JointLimitRange")),
    ),
)
_68 = Struct(
    "Joints",
    "Joints",
    (
        Field("timestamp", "timestamp", _1),
        Field("names", "names", ListOf(Text(256), 0, 50, "T-String")),
        Field("elements", "elements", ListOf(_64, 0, 50, "JointState")),
    ),
)
_69 = Alias("JointTrajectory", "JointTrajectory", "items", ListOf(_64, 1, 60, "JointState"))
_70 = Struct(
    "JointsTrajectory",
    "JointsTrajectory",
    (
        Field("vector-name", "vector_name", ListOf(Text(256), 1, 60, "T-String")),
        Field("timetags", "timetags", ListOf(_1, 1, 60, "Time")),
        Field("trajectory", "trajectory", ListOf(ListOf(_64, 1, 60, "JointState"), 1, 60, "JointTrajectory")),
    ),
)
_71 = Struct("InvalidTimeStep", "InvalidTimeStep", (Field("time-step", "time_step", Integer(0, 4294967295)),))
_72 = Struct("InvalidName", "InvalidName", (Field("nameString", "name_string", Text(256)),))
_73 = Struct(
    "Wrench",
    "Wrench",
    (
        Field("timestamp", "timestamp", _1),
        Field("force", "force", Array(Real(), ((3, 3),), ("T-Double",))),
        Field("torque", "torque", Array(Real(), ((3, 3),), ("T-Double",))),
    ),
)
_74 = Struct(
    "Wrenches",
    "Wrenches",
    (
        Field("vector-name", "vector_name", Text(256)),
        Field("timestamp", "timestamp", _1),
        Field("wrenches", "wrenches", ListOf(_73, 1, 60, "Wrench")),
    ),
)
_75 = Struct(
    "Pressure",
    "Pressure",
    (
        Field("timestamp", "timestamp", _1),
        Field("pascals", "pascals", Real()),
    ),
)
_76 = Struct("Temperature", "Temperature", (Field("kelvin", "kelvin", Real()),))
_77 = Struct(
    "IMUSensors",
    "IMUSensors",
    (
        Field("timestamp", "timestamp", _1),
        Field("acc", "acc", Array(Real(), ((3, 3),), ("T-Double",))),
        Field("gyro", "gyro", Array(Real(), ((3, 3),), ("T-Double",))),
        Field("mag", "mag", Array(Real(), ((3, 3),), ("T-Double",))),
    ),
)
_78 = Struct(
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
_79 = Struct(
    "Array3DLarge",
    "Array3D",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("rows", "rows", Integer(0, 4294967295)),
        Field("cols", "cols", Integer(0, 4294967295)),
        Field("channels", "channels", Integer(0, 4294967295)),
        Field("depth", "depth", _42),
        Field("rowSize", "row_size", Integer(0, 4294967295)),
        Field("data", "data", Octets(1073741824, "|u1", 0)),
    ),
)
_80 = Struct(
    "LandmarkMap-Data",
    "LandmarkMapData",
    (
        Field("ids", "ids", Octets(1073741824, "<i8", 0)),
        Field("positions", "positions", Octets(1073741824, "<f8", 3)),
        Field("covariances", "covariances", Octets(1073741824, "<f8", 9)),
        Field("observations", "observations", Octets(1073741824, "<u4", 0)),
        Field("descriptors", "descriptors", _79),
    ),
)
_81 = Struct(
    "LandmarkMap",
    "LandmarkMap",
    (
        Field("metadata", "metadata", _78),
        Field("data", "data", _80),
    ),
)
_82 = Struct(
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
_83 = Struct(
    "KeyFrame-Data",
    "KeyFrameData",
    (
        Field("keypoints", "keypoints", Octets(1073741824, "<f4", 2)),
        Field("scales", "scales", Octets(1073741824, "<f4", 0)),
        Field("landmarks", "landmarks", Octets(1073741824, "<i8", 0)),
        Field("descriptors", "descriptors", _79),
    ),
)
_84 = Struct(
    "KeyFrame",
    "KeyFrame",
    (
        Field("metadata", "metadata", _82),
        Field("pose", "pose", _55),
        Field("intrinsic", "intrinsic", _52),
        Field("data", "data", _83),
    ),
)
_85 = Struct(
    "FrameLarge",
    "Frame",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("metadata", "metadata", _50),
        Field("intrinsic", "intrinsic", _52),
        Field("extrinsic", "extrinsic", _56),
        Field("data", "data", _79),
    ),
)
_86 = Struct(
    "FramePairLarge",
    "FramePair",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("baseline", "baseline", Real()),
        Field("left", "left", _85),
        Field("right", "right", _85),
    ),
)
_87 = Alias("FramesSequenceLarge", "FramesSequence", "items", ListOf(_85, 0, 1024, "FrameLarge"))
_88 = Struct(
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
_89 = Enumeration(
    "MapTypeT",
    (
        ("map-UNDEF", 0),
        ("map-DEM", 1),
        ("map-NAV", 2),
    ),
)
_90 = Struct(
    "Map-metadata-t",
    "MapMetadataT",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("timeStamp", "time_stamp", _1),
        Field("type", "type", _89),
        Field("errValues", "err_values", ListOf(_46, 0, 5, "Frame-error-t")),
        Field("scale", "scale", Real()),
        Field("pose-fixedFrame-mapFrame", "pose_fixed_frame_map_frame", _55),
    ),
)
_91 = Struct(
    "MapLarge",
    "Map",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("metadata", "metadata", _90),
        Field("data", "data", _79),
    ),
)
_92 = Struct(
    "PointCloud-DataLarge",
    "PointCloudData",
    (
        Field("points", "points", Array(Real(), ((0, 16777216), (3, 3)), ("Point", "T-Double"))),
        Field("colors", "colors", Array(Real(), ((0, 16777216), (3, 3)), ("Vector3d", "T-Double"))),
        Field("intensity", "intensity", Array(Integer(-2147483648, 2147483647), ((0, 16777216),), ("T-Int32",))),
    ),
)
_93 = Struct(
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
_94 = Struct(
    "PointcloudLarge",
    "Pointcloud",
    (
        Field("metadata", "metadata", _93),
        Field("data", "data", _92),
    ),
)
_95 = Struct(
    "OctreeLarge",
    "Octree",
    (
        Field("resolution", "resolution", Real()),
        Field("pointCloud", "point_cloud", _94),
    ),
)
_96 = Alias("CorrespondenceMap2DLarge", "CorrespondenceMap2D", "items", ListOf(_30, 0, 1048576, "Correspondence2D"))
_97 = Alias("CorrespondenceMap3DLarge", "CorrespondenceMap3D", "items", ListOf(_32, 0, 1048576, "Correspondence3D"))
_98 = Alias(
    "CorrespondenceMaps2DSequenceLarge",
    "CorrespondenceMaps2DSequence",
    "items",
    ListOf(ListOf(_30, 0, 1048576, "Correspondence2D"), 0, 16384, "CorrespondenceMap2DLarge"),
)
_99 = Alias(
    "CorrespondenceMaps3DSequenceLarge",
    "CorrespondenceMaps3DSequence",
    "items",
    ListOf(ListOf(_32, 0, 1048576, "Correspondence3D"), 0, 16384, "CorrespondenceMap3DLarge"),
)
_100 = Alias(
    "VisualPointFeatureVector2DLarge",
    "VisualPointFeatureVector2D",
    "items",
    ListOf(_34, 0, 1048576, "VisualPointFeature2D"),
)
_101 = Struct(
    "VisualPointFeatureVector3DLarge",
    "VisualPointFeatureVector3D",
    (
        Field("list", "list", ListOf(_38, 0, 1048576, "VisualPointFeature3D")),
        Field("list-type", "list_type", _39),
        Field("feature-type", "feature_type", _40),
    ),
)
_102 = Struct(
    "Pose",
    "Pose",
    (
        Field("pos", "pos", Array(Real(), ((3, 3),), ("T-Double",))),
        Field("orient", "orient", Array(Real(), ((4, 4),), ("T-Double",))),
    ),
)
_103 = Alias("PosesSequenceLarge", "PosesSequence", "items", ListOf(_102, 0, 1048576, "Pose"))
_104 = Alias(
    "PointSequenceLarge", "PointSequence", "values", Array(Real(), ((0, 16777216), (3, 3)), ("Point", "T-Double"))
)
_105 = Alias("DoubleSequenceLarge", "DoubleSequence", "values", Array(Real(), ((0, 16777216),), ("T-Double",)))
_106 = Alias("StringSequenceLarge", "StringSequence", "items", ListOf(Text(256), 0, 65536, "T-String"))
_107 = Alias(
    "VectorXdSequenceLarge",
    "VectorXdSequence",
    "items",
    ListOf(Array(Real(), ((0, 100),), ("T-Double",)), 0, 16777216, "VectorXd"),
)
_108 = Struct(
    "PathLarge",
    "Path",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("timeStamp", "time_stamp", _1),
        Field("waypoints", "waypoints", ListOf(_55, 0, 1048576, "TransformWithCovariance")),
    ),
)
_109 = Struct(
    "TrajectoryLarge",
    "Trajectory",
    (
        Field("speed", "speed", Real()),
        Field("points", "points", Array(Real(), ((1, 1048576), (3, 3)), ("Point", "T-Double"))),
    ),
)
_110 = Struct(
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
_111 = Enumeration(
    "ProjectionType",
    (
        ("polar", 0),
        ("planar", 1),
    ),
)
_112 = Struct(
    "DepthMapLarge",
    "DepthMap",
    (
        Field("ref-time", "ref_time", _1),
        Field("timestamps", "timestamps", ListOf(_1, 1, 16777216, "Time")),
        Field("vertical-projection", "vertical_projection", _111),
        Field("horizontal-projection", "horizontal_projection", _111),
        Field("vertical-interval", "vertical_interval", Array(Real(), ((1, 16777216),), ("T-Double",))),
        Field("horizontal-interval", "horizontal_interval", Array(Real(), ((1, 16777216),), ("T-Double",))),
        Field("vertical-size", "vertical_size", Integer(0, 4294967295)),
        Field("horizontal-size", "horizontal_size", Integer(0, 4294967295)),
        Field("distances", "distances", Array(Real(), ((1, 16777216),), ("T-Float",))),
        Field("remissions", "remissions", Array(Real(), ((1, 16777216),), ("T-Float",))),
    ),
)
_113 = Struct(
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
_114 = Struct(
    "LidarMap-Metadata",
    "LidarMapMetadata",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("producerId", "producer_id", Text(256)),
        Field("sensorId", "sensor_id", Text(256)),
        Field("timeStamp", "time_stamp", _1),
    ),
)
_115 = Struct(
    "LidarMap-Clouds",
    "LidarMapClouds",
    (
        Field("counts", "counts", Octets(1073741824, "<i8", 0)),
        Field("points", "points", Octets(1073741824, "<f4", 3)),
    ),
)
_116 = Struct(
    "LidarMap-Position",
    "LidarMapPosition",
    (
        Field("vertices", "vertices", Octets(1073741824, "<i8", 0)),
        Field("poses", "poses", Octets(1073741824, "<f8", 7)),
    ),
)
_117 = Struct(
    "PoseGraph-Metadata",
    "PoseGraphMetadata",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("producerId", "producer_id", Text(256)),
        Field("frameId", "frame_id", Text(256)),
        Field("timeStamp", "time_stamp", _1),
    ),
)
_118 = Struct(
    "PoseGraph-Vertices",
    "PoseGraphVertices",
    (
        Field("ids", "ids", Octets(1073741824, "<i8", 0)),
        Field("stamps", "stamps", Octets(1073741824, "<i8", 0)),
        Field("poses", "poses", Octets(1073741824, "<f8", 7)),
        Field("fixed", "fixed", Octets(1073741824, "<u1", 0)),
    ),
)
_119 = Struct(
    "PoseGraph-Edges",
    "PoseGraphEdges",
    (
        Field("ends", "ends", Octets(1073741824, "<i8", 2)),
        Field("poses", "poses", Octets(1073741824, "<f8", 7)),
        Field("information", "information", Octets(1073741824, "<f8", 36)),
        Field("kinds", "kinds", Octets(1073741824, "<u1", 0)),
    ),
)
_120 = Struct(
    "PoseGraph",
    "PoseGraph",
    (
        Field("metadata", "metadata", _117),
        Field("vertices", "vertices", _118),
        Field("edges", "edges", _119),
    ),
)
_121 = Struct(
    "LidarMap",
    "LidarMap",
    (
        Field("metadata", "metadata", _114),
        Field("graph", "graph", _120),
        Field("clouds", "clouds", _115),
        Field("position", "position", _116),
    ),
)
_122 = Struct(
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
_123 = Struct(
    "LidarScan-Data",
    "LidarScanData",
    (
        Field("points", "points", Octets(1073741824, "<f4", 3)),
        Field("timeOffsets", "time_offsets", Octets(1073741824, "<u4", 0)),
        Field("intensity", "intensity", Octets(1073741824, "<u2", 0)),
        Field("ring", "ring", Octets(1073741824, "<u2", 0)),
    ),
)
_124 = Struct(
    "LidarScan",
    "LidarScan",
    (
        Field("metadata", "metadata", _122),
        Field("data", "data", _123),
    ),
)
_125 = Struct(
    "Map",
    "Map",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("metadata", "metadata", _90),
        Field("data", "data", _43),
    ),
)
_126 = Struct(
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
_127 = Struct(
    "GridLayer",
    "GridLayer",
    (
        Field("name", "name", Text(256)),
        Field("depth", "depth", _42),
        Field("data", "data", Octets(1073741824, "|u1", 0)),
    ),
)
_128 = Struct(
    "ElevationMap",
    "ElevationMap",
    (
        Field("metadata", "metadata", _126),
        Field("layers", "layers", ListOf(_127, 0, 64, "GridLayer")),
    ),
)
_129 = Struct(
    "NavigationMap",
    "NavigationMap",
    (
        Field("metadata", "metadata", _126),
        Field("layers", "layers", ListOf(_127, 0, 64, "GridLayer")),
    ),
)
_130 = Struct(
    "Mesh-Metadata",
    "MeshMetadata",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("producerId", "producer_id", Text(256)),
        Field("frameId", "frame_id", Text(256)),
        Field("timeStamp", "time_stamp", _1),
    ),
)
_131 = Struct(
    "Mesh-Data",
    "MeshData",
    (
        Field("vertices", "vertices", Octets(1073741824, "<f8", 3)),
        Field("triangles", "triangles", Octets(1073741824, "<u4", 3)),
        Field("normals", "normals", Octets(1073741824, "<f4", 3)),
        Field("colors", "colors", Octets(1073741824, "<u1", 3)),
    ),
)
_132 = Struct(
    "Mesh",
    "Mesh",
    (
        Field("metadata", "metadata", _130),
        Field("data", "data", _131),
    ),
)
_133 = Struct(
    "ObjectDetection",
    "ObjectDetection",
    (
        Field("label", "label", Text(256)),
        Field("score", "score", Real()),
        Field("pose", "pose", _55),
        Field("size", "size", Array(Real(), ((3, 3),), ("T-Double",))),
        Field("imageBox", "image_box", Array(Real(), ((4, 4),), ("T-Double",))),
    ),
)
_134 = Struct(
    "ObjectDetections",
    "ObjectDetections",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("timeStamp", "time_stamp", _1),
        Field("producerId", "producer_id", Text(256)),
        Field("sensorId", "sensor_id", Text(256)),
        Field("frameId", "frame_id", Text(256)),
        Field("detections", "detections", ListOf(_133, 0, 4096, "ObjectDetection")),
    ),
)
_135 = Enumeration(
    "ObjectTrackStatusT",
    (
        ("track-TENTATIVE", 0),
        ("track-CONFIRMED", 1),
        ("track-LOST", 2),
    ),
)
_136 = Struct(
    "ObjectTrack-Metadata",
    "ObjectTrackMetadata",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("timeStamp", "time_stamp", _1),
        Field("producerId", "producer_id", Text(256)),
        Field("frameId", "frame_id", Text(256)),
        Field("trackId", "track_id", Integer(0, 4294967295)),
        Field("label", "label", Text(256)),
        Field("status", "status", _135),
        Field("score", "score", Real()),
        Field("size", "size", Array(Real(), ((3, 3),), ("T-Double",))),
    ),
)
_137 = Struct(
    "ObjectTrack-Data",
    "ObjectTrackData",
    (
        Field("stamps", "stamps", Octets(1073741824, "<i8", 0)),
        Field("poses", "poses", Octets(1073741824, "<f8", 7)),
        Field("velocities", "velocities", Octets(1073741824, "<f8", 6)),
        Field("covariances", "covariances", Octets(1073741824, "<f8", 36)),
    ),
)
_138 = Struct(
    "ObjectTrack",
    "ObjectTrack",
    (
        Field("metadata", "metadata", _136),
        Field("data", "data", _137),
    ),
)
_139 = Enumeration(
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
_140 = Struct(
    "OG2-Region",
    "Og2Region",
    (
        Field("kind", "kind", _139),
        Field("frameId", "frame_id", Text(256)),
        Field("numbers", "numbers", Array(Real(), ((0, 100),), ("T-Double",))),
    ),
)
_141 = Enumeration(
    "Og2DeliverT",
    (
        ("deliver-AUTO", 0),
        ("deliver-INLINE", 1),
        ("deliver-REFERENCE", 2),
    ),
)
_142 = Struct(
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
        Field("region", "region", _140),
        Field("maxAge", "max_age", Real()),
        Field("resolution", "resolution", Real()),
        Field("minCoverage", "min_coverage", Real()),
        Field("deliver", "deliver", _141),
        Field("deadline", "deadline", Integer(0, 4294967295)),
    ),
)
_143 = Enumeration(
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
_144 = Struct(
    "OG2-Job",
    "Og2Job",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("timeStamp", "time_stamp", _1),
        Field("jobId", "job_id", Text(256)),
        Field("requestId", "request_id", Text(256)),
        Field("robot", "robot", Text(256)),
        Field("product", "product", Text(256)),
        Field("state", "state", _143),
        Field("reason", "reason", Text(256)),
        Field("remaining", "remaining", Real()),
        Field("plan", "plan", ListOf(Text(256), 0, 256, "T-String")),
    ),
)
_145 = Enumeration(
    "Og2ReplyKindT",
    (
        ("reply-PROGRESS", 0),
        ("reply-PRODUCT", 1),
        ("reply-REFERENCE", 2),
        ("reply-ERROR", 3),
    ),
)
_146 = Enumeration(
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
_147 = Enumeration(
    "ProductStatusT",
    (
        ("status-OK", 0),
        ("status-DEGRADED", 1),
        ("status-FAILED", 2),
    ),
)
_148 = Enumeration(
    "ProductCovarianceKindT",
    (
        ("covariance-NONE", 0),
        ("covariance-FORMAL", 1),
        ("covariance-CALIBRATED", 2),
    ),
)
_149 = Struct(
    "Product-metric-t",
    "ProductMetricT",
    (
        Field("name", "name", Text(256)),
        Field("value", "value", Real()),
    ),
)
_150 = Struct(
    "Product-Quality",
    "ProductQuality",
    (
        Field("status", "status", _147),
        Field("reasons", "reasons", ListOf(Text(256), 0, 256, "T-String")),
        Field("covarianceKind", "covariance_kind", _148),
        Field("metrics", "metrics", ListOf(_149, 0, 1024, "Product-metric-t")),
    ),
)
_151 = Struct(
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
        Field("quality", "quality", _150),
        Field("hasBox", "has_box", Boolean()),
        Field("box", "box", Array(Real(), ((6, 6),), ("T-Double",))),
        Field("resolution", "resolution", Real()),
    ),
)
_152 = Struct(
    "OG2-Reply",
    "Og2Reply",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("timeStamp", "time_stamp", _1),
        Field("requestId", "request_id", Text(256)),
        Field("jobId", "job_id", Text(256)),
        Field("kind", "kind", _145),
        Field("isFinal", "is_final", Boolean()),
        Field("errorCode", "error_code", _146),
        Field("retriable", "retriable", Boolean()),
        Field("detail", "detail", Text(256)),
        Field("metadata", "metadata", _151),
        Field("coverage", "coverage", Real()),
        Field("age", "age", Real()),
        Field("oldestAge", "oldest_age", Real()),
        Field("differences", "differences", ListOf(Text(256), 0, 256, "T-String")),
        Field("payload", "payload", Octets(1073741824, "|u1", 0)),
    ),
)
_153 = Struct(
    "PointCloud-Data",
    "PointCloudData",
    (
        Field("points", "points", Array(Real(), ((0, 400000), (3, 3)), ("Point", "T-Double"))),
        Field("colors", "colors", Array(Real(), ((0, 400000), (3, 3)), ("Vector3d", "T-Double"))),
        Field("intensity", "intensity", Array(Integer(-2147483648, 2147483647), ((0, 400000),), ("T-Int32",))),
    ),
)
_154 = Struct(
    "Pointcloud",
    "Pointcloud",
    (
        Field("metadata", "metadata", _93),
        Field("data", "data", _153),
    ),
)
_155 = Struct(
    "Octree",
    "Octree",
    (
        Field("resolution", "resolution", Real()),
        Field("pointCloud", "point_cloud", _154),
    ),
)
_156 = Alias("Position", "Position", "values", Array(Real(), ((3, 3),), ("T-Double",)))
_157 = Alias("Position2D", "Position2D", "values", Array(Real(), ((2, 2),), ("T-Double",)))
_158 = Alias("Orientation", "Orientation", "values", Array(Real(), ((4, 4),), ("T-Double",)))
_159 = Struct(
    "PoseUpdateThreshold",
    "PoseUpdateThreshold",
    (
        Field("distance", "distance", Real()),
        Field("angle", "angle", Real()),
    ),
)
_160 = Struct(
    "Pose2D",
    "Pose2D",
    (
        Field("position", "position", Array(Real(), ((2, 2),), ("T-Double",))),
        Field("orientation", "orientation", Real()),
    ),
)
_161 = Struct(
    "Motion2D",
    "Motion2D",
    (
        Field("translation", "translation", Real()),
        Field("rotation", "rotation", Real()),
    ),
)
_162 = Struct(
    "TwistWithCovariance-metadata",
    "TwistWithCovarianceMetadata",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("timeStamp", "time_stamp", _1),
    ),
)
_163 = Struct(
    "TwistWithCovariance-data",
    "TwistWithCovarianceData",
    (
        Field("vel", "vel", Array(Real(), ((3, 3),), ("T-Double",))),
        Field("rot", "rot", Array(Real(), ((3, 3),), ("T-Double",))),
        Field("cov", "cov", Array(Real(), ((6, 6), (6, 6)), ("SEQUENCE_OF", "T-Double"))),
    ),
)
_164 = Struct(
    "TwistWithCovariance",
    "TwistWithCovariance",
    (
        Field("metadata", "metadata", _162),
        Field("data", "data", _163),
    ),
)
_165 = Struct(
    "BodyState",
    "BodyState",
    (
        Field("ref-time", "ref_time", _1),
        Field("pose", "pose", _55),
        Field("velocity", "velocity", _164),
    ),
)
_166 = Struct(
    "RigidBodyState",
    "RigidBodyState",
    (
        Field("timestamp", "timestamp", _1),
        Field("sourceFrame", "source_frame", Text(256)),
        Field("targetFrame", "target_frame", Text(256)),
        Field("pos", "pos", Array(Real(), ((3, 3),), ("T-Double",))),
        Field("cov-position", "cov_position", Array(Real(), ((3, 3), (3, 3)), ("SEQUENCE_OF", "T-Double"))),
        Field("orient", "orient", Array(Real(), ((4, 4),), ("T-Double",))),
        Field("cov-orientation", "cov_orientation", Array(Real(), ((3, 3), (3, 3)), ("SEQUENCE_OF", "T-Double"))),
        Field("velocity", "velocity", Array(Real(), ((3, 3),), ("T-Double",))),
        Field("cov-velocity", "cov_velocity", Array(Real(), ((3, 3), (3, 3)), ("SEQUENCE_OF", "T-Double"))),
        Field("angular-velocity", "angular_velocity", Array(Real(), ((3, 3),), ("T-Double",))),
        Field(
            "cov-angular-velocity", "cov_angular_velocity", Array(Real(), ((3, 3), (3, 3)), ("SEQUENCE_OF", "T-Double"))
        ),
    ),
)
_167 = Struct(
    "RigidBodyAcceleration",
    "RigidBodyAcceleration",
    (
        Field("ref-time", "ref_time", _1),
        Field("acceleration", "acceleration", Array(Real(), ((3, 3),), ("T-Double",))),
        Field("cov-acceleration", "cov_acceleration", Array(Real(), ((3, 3), (3, 3)), ("SEQUENCE_OF", "T-Double"))),
    ),
)
_168 = Struct(
    "Waypoint",
    "Waypoint",
    (
        Field("position", "position", Array(Real(), ((3, 3),), ("T-Double",))),
        Field("heading", "heading", Real()),
        Field("tol-position", "tol_position", Real()),
        Field("tol-heading", "tol_heading", Real()),
    ),
)
_169 = Struct(
    "Trajectory",
    "Trajectory",
    (
        Field("speed", "speed", Real()),
        Field("points", "points", Array(Real(), ((1, 50), (3, 3)), ("Point", "T-Double"))),
    ),
)
_170 = Struct(
    "Path",
    "Path",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("timeStamp", "time_stamp", _1),
        Field("waypoints", "waypoints", ListOf(_55, 0, 100, "TransformWithCovariance")),
    ),
)
_171 = Struct(
    "PoseTrajectory-Metadata",
    "PoseTrajectoryMetadata",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("producerId", "producer_id", Text(256)),
        Field("parentFrameId", "parent_frame_id", Text(256)),
        Field("childFrameId", "child_frame_id", Text(256)),
    ),
)
_172 = Struct(
    "PoseTrajectory-Data",
    "PoseTrajectoryData",
    (
        Field("stamps", "stamps", Octets(1073741824, "<i8", 0)),
        Field("poses", "poses", Octets(1073741824, "<f8", 7)),
        Field("covariances", "covariances", Octets(1073741824, "<f8", 36)),
    ),
)
_173 = Struct(
    "PoseTrajectory",
    "PoseTrajectory",
    (
        Field("metadata", "metadata", _171),
        Field("data", "data", _172),
    ),
)
_174 = Struct(
    "PositionState-Metadata",
    "PositionStateMetadata",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("producerId", "producer_id", Text(256)),
    ),
)
_175 = Struct(
    "PositionState-Links",
    "PositionStateLinks",
    (
        Field("covariances", "covariances", Octets(1073741824, "<f8", 9)),
        Field("links", "links", Octets(1073741824, "<f8", 9)),
        Field("pins", "pins", Octets(1073741824, "<i8", 0)),
        Field("broken", "broken", Octets(1073741824, "<i8", 0)),
    ),
)
_176 = Struct(
    "PositionState-Filter",
    "PositionStateFilter",
    (
        Field("start", "start", Octets(1073741824, "<f8", 7)),
        Field("startCovariance", "start_covariance", Octets(1073741824, "<f8", 36)),
        Field("body", "body", Octets(1073741824, "<f8", 7)),
        Field("vectors", "vectors", Octets(1073741824, "<f8", 3)),
        Field("names", "names", ListOf(Text(256), 0, 64, "T-String")),
        Field("stamps", "stamps", Octets(1073741824, "<i8", 0)),
        Field("poses", "poses", Octets(1073741824, "<f8", 7)),
        Field("measured", "measured", Octets(1073741824, "<f8", 7)),
        Field("measuredCovariances", "measured_covariances", Octets(1073741824, "<f8", 36)),
        Field("covariance", "covariance", Octets(1073741824, "<f8", 6)),
    ),
)
_177 = Struct(
    "PositionState",
    "PositionState",
    (
        Field("metadata", "metadata", _174),
        Field("line", "line", _173),
        Field("links", "links", _175),
        Field("filter", "filter", _176),
    ),
)
_178 = Enumeration(
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
_179 = Struct(
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
_180 = Enumeration(
    "UnitAxis",
    (
        ("unit-x", 0),
        ("unit-y", 1),
        ("unit-z", 2),
    ),
)
_181 = Enumeration(
    "DepthMeasurementState",
    (
        ("valid-measurement", 0),
        ("too-far", 1),
        ("too-near", 2),
        ("measurement-error", 3),
    ),
)
_182 = Struct(
    "DepthMap",
    "DepthMap",
    (
        Field("ref-time", "ref_time", _1),
        Field("timestamps", "timestamps", ListOf(_1, 1, 30000, "Time")),
        Field("vertical-projection", "vertical_projection", _111),
        Field("horizontal-projection", "horizontal_projection", _111),
        Field("vertical-interval", "vertical_interval", Array(Real(), ((1, 30000),), ("T-Double",))),
        Field("horizontal-interval", "horizontal_interval", Array(Real(), ((1, 30000),), ("T-Double",))),
        Field("vertical-size", "vertical_size", Integer(0, 4294967295)),
        Field("horizontal-size", "horizontal_size", Integer(0, 4294967295)),
        Field("distances", "distances", Array(Real(), ((1, 30000),), ("T-Float",))),
        Field("remissions", "remissions", Array(Real(), ((1, 30000),), ("T-Float",))),
    ),
)
_183 = Struct(
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
_184 = Struct(
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
_185 = Struct(
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
_186 = Struct(
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
_187 = Alias("FramesSequence", "FramesSequence", "items", ListOf(_57, 0, 10, "Frame"))
_188 = Alias("PosesSequence", "PosesSequence", "items", ListOf(_102, 0, 10, "Pose"))
_189 = Alias(
    "CorrespondenceMaps2DSequence",
    "CorrespondenceMaps2DSequence",
    "items",
    ListOf(ListOf(_30, 0, 1024, "Correspondence2D"), 0, 56, "CorrespondenceMap2D"),
)
_190 = Alias(
    "CorrespondenceMaps3DSequence",
    "CorrespondenceMaps3DSequence",
    "items",
    ListOf(ListOf(_32, 0, 51200, "Correspondence3D"), 0, 56, "CorrespondenceMap3D"),
)
_191 = Alias("PointSequence", "PointSequence", "values", Array(Real(), ((0, 327680), (3, 3)), ("Point", "T-Double")))
_192 = Alias("DoubleSequence", "DoubleSequence", "values", Array(Real(), ((0, 327680),), ("T-Double",)))
_193 = Alias("StringSequence", "StringSequence", "items", ListOf(Text(256), 0, 100, "T-String"))
_194 = Alias(
    "VectorXdSequence",
    "VectorXdSequence",
    "items",
    ListOf(Array(Real(), ((0, 100),), ("T-Double",)), 0, 327680, "VectorXd"),
)
_195 = Enumeration(
    "IcuStateT",
    (
        ("icu-STEADY", 0),
        ("icu-SWITCHING", 1),
    ),
)
_196 = Struct(
    "ICU-Mode",
    "IcuMode",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("timeStamp", "time_stamp", _1),
        Field("robot", "robot", Text(256)),
        Field("sensor", "sensor", Text(256)),
        Field("mode", "mode", Text(256)),
        Field("target", "target", Text(256)),
        Field("state", "state", _195),
        Field("isOn", "is_on", Boolean()),
        Field("rate", "rate", Real()),
        Field("holder", "holder", Text(256)),
    ),
)
_197 = Enumeration(
    "DfpcStateT",
    (
        ("dfpc-UNCONFIGURED", 0),
        ("dfpc-INACTIVE", 1),
        ("dfpc-ACTIVE", 2),
        ("dfpc-ERROR", 3),
    ),
)
_198 = Struct(
    "DFPC-Status",
    "DfpcStatus",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("timeStamp", "time_stamp", _1),
        Field("robot", "robot", Text(256)),
        Field("dfpc", "dfpc", Text(256)),
        Field("implementation", "implementation", Text(256)),
        Field("configHash", "config_hash", Text(256)),
        Field("state", "state", _197),
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
_199 = Struct(
    "Event",
    "Event",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("ordinal", "ordinal", Integer(0, 9223372036854775807)),
        Field("timeStamp", "time_stamp", _1),
        Field("scope", "scope", Text(256)),
        Field("kind", "kind", Text(256)),
        Field("body", "body", Octets(65536, "|u1", 0)),
    ),
)
_200 = Enumeration(
    "Resolution",
    (
        ("seconds", 0),
        ("milliseconds", 1),
        ("microseconds", 2),
    ),
)

#: ASN.1 name -> node, of every type that can be a message.
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
    "ImuSpan-Metadata": _61,
    "ImuSpan-Data": _62,
    "ImuSpan": _63,
    "JointState": _64,
    "JointLimitRange": _65,
    "OutOfBounds": _66,
    "JointLimits": _67,
    "Joints": _68,
    "JointTrajectory": _69,
    "JointsTrajectory": _70,
    "InvalidTimeStep": _71,
    "InvalidName": _72,
    "Wrench": _73,
    "Wrenches": _74,
    "Pressure": _75,
    "Temperature": _76,
    "IMUSensors": _77,
    "LandmarkMap-Metadata": _78,
    "Array3DLarge": _79,
    "LandmarkMap-Data": _80,
    "LandmarkMap": _81,
    "KeyFrame-Metadata": _82,
    "KeyFrame-Data": _83,
    "KeyFrame": _84,
    "FrameLarge": _85,
    "FramePairLarge": _86,
    "FramesSequenceLarge": _87,
    "CompressedFrameLarge": _88,
    "Map-metadata-t": _90,
    "MapLarge": _91,
    "PointCloud-DataLarge": _92,
    "PointCloud-Metadata": _93,
    "PointcloudLarge": _94,
    "OctreeLarge": _95,
    "CorrespondenceMap2DLarge": _96,
    "CorrespondenceMap3DLarge": _97,
    "CorrespondenceMaps2DSequenceLarge": _98,
    "CorrespondenceMaps3DSequenceLarge": _99,
    "VisualPointFeatureVector2DLarge": _100,
    "VisualPointFeatureVector3DLarge": _101,
    "Pose": _102,
    "PosesSequenceLarge": _103,
    "PointSequenceLarge": _104,
    "DoubleSequenceLarge": _105,
    "StringSequenceLarge": _106,
    "VectorXdSequenceLarge": _107,
    "PathLarge": _108,
    "TrajectoryLarge": _109,
    "LaserScanLarge": _110,
    "DepthMapLarge": _112,
    "DistanceImageLarge": _113,
    "LidarMap-Metadata": _114,
    "LidarMap-Clouds": _115,
    "LidarMap-Position": _116,
    "PoseGraph-Metadata": _117,
    "PoseGraph-Vertices": _118,
    "PoseGraph-Edges": _119,
    "PoseGraph": _120,
    "LidarMap": _121,
    "LidarScan-Metadata": _122,
    "LidarScan-Data": _123,
    "LidarScan": _124,
    "Map": _125,
    "GridMap-Metadata": _126,
    "GridLayer": _127,
    "ElevationMap": _128,
    "NavigationMap": _129,
    "Mesh-Metadata": _130,
    "Mesh-Data": _131,
    "Mesh": _132,
    "ObjectDetection": _133,
    "ObjectDetections": _134,
    "ObjectTrack-Metadata": _136,
    "ObjectTrack-Data": _137,
    "ObjectTrack": _138,
    "OG2-Region": _140,
    "OG2-Request": _142,
    "OG2-Job": _144,
    "Product-metric-t": _149,
    "Product-Quality": _150,
    "Product-Metadata": _151,
    "OG2-Reply": _152,
    "PointCloud-Data": _153,
    "Pointcloud": _154,
    "Octree": _155,
    "Position": _156,
    "Position2D": _157,
    "Orientation": _158,
    "PoseUpdateThreshold": _159,
    "Pose2D": _160,
    "Motion2D": _161,
    "TwistWithCovariance-metadata": _162,
    "TwistWithCovariance-data": _163,
    "TwistWithCovariance": _164,
    "BodyState": _165,
    "RigidBodyState": _166,
    "RigidBodyAcceleration": _167,
    "Waypoint": _168,
    "Trajectory": _169,
    "Path": _170,
    "PoseTrajectory-Metadata": _171,
    "PoseTrajectory-Data": _172,
    "PoseTrajectory": _173,
    "PositionState-Metadata": _174,
    "PositionState-Links": _175,
    "PositionState-Filter": _176,
    "PositionState": _177,
    "LaserScan": _179,
    "DepthMap": _182,
    "DistanceImage": _183,
    "Sonar": _184,
    "SonarBeam": _185,
    "SonarScan": _186,
    "FramesSequence": _187,
    "PosesSequence": _188,
    "CorrespondenceMaps2DSequence": _189,
    "CorrespondenceMaps3DSequence": _190,
    "PointSequence": _191,
    "DoubleSequence": _192,
    "StringSequence": _193,
    "VectorXdSequence": _194,
    "ICU-Mode": _196,
    "DFPC-Status": _198,
    "Event": _199,
}

#: ASN.1 name -> that of the sibling with room for more.
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
