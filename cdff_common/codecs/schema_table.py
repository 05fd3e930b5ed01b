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
_1 = Alias("Vector2d", "Vector2d", "values", Array(Real(), ((2, 2),), ("T-Double",)))
_2 = Alias("Vector3d", "Vector3d", "values", Array(Real(), ((3, 3),), ("T-Double",)))
_3 = Alias("Vector4d", "Vector4d", "values", Array(Real(), ((4, 4),), ("T-Double",)))
_4 = Alias("Vector6d", "Vector6d", "values", Array(Real(), ((6, 6),), ("T-Double",)))
_5 = Alias("VectorXd", "VectorXd", "values", Array(Real(), ((0, 100),), ("T-Double",)))
_6 = Alias("Quaterniond", "Quaterniond", "values", Array(Real(), ((4, 4),), ("T-Double",)))
_7 = Alias("AngleAxisd", "AngleAxisd", "values", Array(Real(), ((4, 4),), ("T-Double",)))
_8 = Alias("Matrix2d", "Matrix2d", "values", Array(Real(), ((2, 2), (2, 2)), ("SEQUENCE_OF", "T-Double")))
_9 = Alias("Matrix3d", "Matrix3d", "values", Array(Real(), ((3, 3), (3, 3)), ("SEQUENCE_OF", "T-Double")))
_10 = Alias("Matrix4d", "Matrix4d", "values", Array(Real(), ((4, 4), (4, 4)), ("SEQUENCE_OF", "T-Double")))
_11 = Alias("Matrix6d", "Matrix6d", "values", Array(Real(), ((6, 6), (6, 6)), ("SEQUENCE_OF", "T-Double")))
_12 = Alias("MatrixXd", "MatrixXd", "values", Array(Real(), ((0, 20), (0, 20)), ("SEQUENCE_OF", "T-Double")))
_13 = Alias("Affine3d", "Affine3d", "values", Array(Real(), ((4, 4), (4, 4)), ("SEQUENCE_OF", "T-Double")))
_14 = Alias("Isometry3d", "Isometry3d", "values", Array(Real(), ((4, 4), (4, 4)), ("SEQUENCE_OF", "T-Double")))
_15 = Alias("Transform3d", "Transform3d", "values", Array(Real(), ((4, 4), (4, 4)), ("SEQUENCE_OF", "T-Double")))
_16 = Alias("Covariance", "Covariance", "values", Array(Real(), ((6, 6), (6, 6)), ("SEQUENCE_OF", "T-Double")))
_17 = Alias("Point", "Point", "values", Array(Real(), ((3, 3),), ("T-Double",)))
_18 = Alias("Point2D", "Point2D", "values", Array(Real(), ((2, 2),), ("T-Double",)))
_19 = Alias("Point3D", "Point3D", "values", Array(Real(), ((3, 3),), ("T-Double",)))
_20 = Struct("Angle", "Angle", (Field("rad", "rad", Real()),))
_21 = Struct(
    "AngleSegment",
    "AngleSegment",
    (
        Field("startRad", "start_rad", Real()),
        Field("width", "width", Real()),
    ),
)
_22 = Struct(
    "Correspondence2D",
    "Correspondence2D",
    (
        Field("source", "source", Array(Real(), ((2, 2),), ("T-Double",))),
        Field("sink", "sink", Array(Real(), ((2, 2),), ("T-Double",))),
        Field("probability", "probability", Real()),
    ),
)
_23 = Alias("CorrespondenceMap2D", "CorrespondenceMap2D", "items", ListOf(_22, 0, 1024, "Correspondence2D"))
_24 = Struct(
    "Correspondence3D",
    "Correspondence3D",
    (
        Field("source", "source", Array(Real(), ((3, 3),), ("T-Double",))),
        Field("sink", "sink", Array(Real(), ((3, 3),), ("T-Double",))),
        Field("probability", "probability", Real()),
    ),
)
_25 = Alias("CorrespondenceMap3D", "CorrespondenceMap3D", "items", ListOf(_24, 0, 51200, "Correspondence3D"))
_26 = Struct(
    "VisualPointFeature2D",
    "VisualPointFeature2D",
    (
        Field("point", "point", Array(Real(), ((2, 2),), ("T-Double",))),
        Field("descriptor", "descriptor", Array(Real(), ((0, 128),), ("T-Float",))),
    ),
)
_27 = Alias(
    "VisualPointFeatureVector2D", "VisualPointFeatureVector2D", "items", ListOf(_26, 0, 1024, "VisualPointFeature2D")
)
_28 = Struct(
    "Point3DReference",
    "Point3DReference",
    (
        Field("pointCloudIdentifier", "point_cloud_identifier", Integer(0, 65535)),
        Field("index", "index", Integer(0, 9223372036854775807)),
    ),
)
_29 = Choice(
    "VisualPointFeature3DPoint",
    (
        Field("position", "position", Array(Real(), ((3, 3),), ("T-Double",))),
        Field("reference", "reference", _28),
    ),
)
_30 = Struct(
    "VisualPointFeature3D",
    "VisualPointFeature3D",
    (
        Field("point", "point", _29),
        Field("descriptor", "descriptor", Array(Real(), ((0, 352),), ("T-Float",))),
    ),
)
_31 = Enumeration(
    "VisualPointFeatureVector3DType",
    (
        ("all-positions", 0),
        ("all-references", 1),
        ("hybrid-vector", 2),
    ),
)
_32 = Enumeration(
    "VisualPointFeature3DType",
    (
        ("histogram", 0),
        ("shot", 1),
        ("pfh", 2),
    ),
)
_33 = Struct(
    "VisualPointFeatureVector3D",
    "VisualPointFeatureVector3D",
    (
        Field("list", "list", ListOf(_30, 0, 51200, "VisualPointFeature3D")),
        Field("list-type", "list_type", _31),
        Field("feature-type", "feature_type", _32),
    ),
)
_34 = Enumeration(
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
_35 = Struct(
    "Array3D",
    "Array3D",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("rows", "rows", Integer(0, 4294967295)),
        Field("cols", "cols", Integer(0, 4294967295)),
        Field("channels", "channels", Integer(0, 4294967295)),
        Field("depth", "depth", _34),
        Field("rowSize", "row_size", Integer(0, 4294967295)),
        Field("data", "data", Octets(66355200, "|u1", 0)),
    ),
)
_36 = Enumeration(
    "FramePixelModelT",
    (
        ("pix-UNDEF", 0),
        ("pix-POLY", 1),
        ("pix-DISP", 2),
    ),
)
_37 = Enumeration(
    "FrameErrorTypeT",
    (
        ("error-UNDEFINED", 0),
        ("error-DEAD", 1),
        ("error-FILTERED", 2),
    ),
)
_38 = Struct(
    "Frame-error-t",
    "FrameErrorT",
    (
        Field("type", "type", _37),
        Field("value", "value", Real()),
    ),
)
_39 = Struct(
    "Frame-attrib-t",
    "FrameAttribT",
    (
        Field("name", "name", Text(256)),
        Field("data", "data", Text(256)),
    ),
)
_40 = Enumeration(
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
_41 = Enumeration(
    "FrameStatusT",
    (
        ("status-EMPTY", 0),
        ("status-VALID", 1),
        ("status-INVALID", 2),
    ),
)
_42 = Struct(
    "Time",
    "Time",
    (
        Field("microseconds", "microseconds", Integer(-9223372036854775807, 9223372036854775807)),
        Field("usecPerSec", "usec_per_sec", Integer(-2147483648, 2147483647)),
    ),
)
_43 = Struct(
    "Frame-metadata-t",
    "FrameMetadataT",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("timeStamp", "time_stamp", _42),
        Field("receivedTime", "received_time", _42),
        Field("pixelModel", "pixel_model", _36),
        Field("pixelCoeffs", "pixel_coeffs", Array(Real(), ((0, 100),), ("T-Double",))),
        Field("errValues", "err_values", ListOf(_38, 0, 3, "Frame-error-t")),
        Field("attributes", "attributes", ListOf(_39, 0, 5, "Frame-attrib-t")),
        Field("mode", "mode", _40),
        Field("status", "status", _41),
    ),
)
_44 = Enumeration(
    "FrameCameraModelT",
    (
        ("cam-UNDEF", 0),
        ("cam-PINHOLE", 1),
        ("cam-FISHEYE", 2),
        ("cam-MAPS", 3),
    ),
)
_45 = Struct(
    "Frame-intrinsic-t",
    "FrameIntrinsicT",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("sensorId", "sensor_id", Text(256)),
        Field("cameraMatrix", "camera_matrix", Array(Real(), ((3, 3), (3, 3)), ("SEQUENCE_OF", "T-Double"))),
        Field("cameraModel", "camera_model", _44),
        Field("distCoeffs", "dist_coeffs", Array(Real(), ((0, 100),), ("T-Double",))),
    ),
)
_46 = Struct(
    "TransformWithCovariance-Metadata",
    "TransformWithCovarianceMetadata",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("producerId", "producer_id", Text(256)),
        Field("dataEstimated", "data_estimated", Array(Boolean(), ((7, 7),), ("BOOLEAN",))),
        Field("parentFrameId", "parent_frame_id", Text(256)),
        Field("parentTime", "parent_time", _42),
        Field("childFrameId", "child_frame_id", Text(256)),
        Field("childTime", "child_time", _42),
    ),
)
_47 = Struct(
    "TransformWithCovariance-Data",
    "TransformWithCovarianceData",
    (
        Field("translation", "translation", Array(Real(), ((3, 3),), ("T-Double",))),
        Field("orientation", "orientation", Array(Real(), ((4, 4),), ("T-Double",))),
        Field("cov", "cov", Array(Real(), ((6, 6), (6, 6)), ("SEQUENCE_OF", "T-Double"))),
    ),
)
_48 = Struct(
    "TransformWithCovariance",
    "TransformWithCovariance",
    (
        Field("metadata", "metadata", _46),
        Field("data", "data", _47),
    ),
)
_49 = Struct(
    "Frame-extrinsic-t",
    "FrameExtrinsicT",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("hasFixedTransform", "has_fixed_transform", Boolean()),
        Field("pose-robotFrame-sensorFrame", "pose_robot_frame_sensor_frame", _48),
        Field("pose-fixedFrame-robotFrame", "pose_fixed_frame_robot_frame", _48),
    ),
)
_50 = Struct(
    "Frame",
    "Frame",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("metadata", "metadata", _43),
        Field("intrinsic", "intrinsic", _45),
        Field("extrinsic", "extrinsic", _49),
        Field("data", "data", _35),
    ),
)
_51 = Struct(
    "FramePair",
    "FramePair",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("baseline", "baseline", Real()),
        Field("left", "left", _50),
        Field("right", "right", _50),
    ),
)
_52 = Enumeration(
    "FrameCompressedModeT",
    (
        ("mode-compressed-undefined", 0),
        ("mode-pjpg", 1),
    ),
)
_53 = Struct(
    "CompressedFrame",
    "CompressedFrame",
    (
        Field("ref-time", "ref_time", _42),
        Field("received-time", "received_time", _42),
        Field("image", "image", Array(Integer(0, 255), ((1, 262144),), ("T-UInt8",))),
        Field("attributes", "attributes", ListOf(_39, 1, 10, "Frame-attrib-t")),
        Field("rows", "rows", Integer(0, 4294967295)),
        Field("cols", "cols", Integer(0, 4294967295)),
        Field("frame-mode", "frame_mode", _52),
        Field("frame-status", "frame_status", _41),
    ),
)
_54 = Struct(
    "ImuSpan-Metadata",
    "ImuSpanMetadata",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("sensorId", "sensor_id", Text(256)),
    ),
)
_55 = Struct(
    "ImuSpan-Data",
    "ImuSpanData",
    (
        Field("stamps", "stamps", Octets(1073741824, "<i8", 0)),
        Field("acc", "acc", Octets(1073741824, "<f8", 3)),
        Field("gyro", "gyro", Octets(1073741824, "<f8", 3)),
        Field("mag", "mag", Octets(1073741824, "<f8", 3)),
    ),
)
_56 = Struct(
    "ImuSpan",
    "ImuSpan",
    (
        Field("metadata", "metadata", _54),
        Field("data", "data", _55),
    ),
)
_57 = Struct(
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
_58 = Struct(
    "JointLimitRange",
    "JointLimitRange",
    (
        Field("min", "min", _57),
        Field("max", "max", _57),
    ),
)
_59 = Struct(
    "OutOfBounds",
    "OutOfBounds",
    (
        Field("error-name", "error_name", Text(256)),
        Field("min", "min", Real()),
        Field("max", "max", Real()),
        Field("value", "value", Real()),
    ),
)
_60 = Struct(
    "JointLimits",
    "JointLimits",
    (
        Field("vector-name", "vector_name", Text(256)),
        Field("ranges", "ranges", ListOf(_58, 1, 60, "JointLimitRange")),
    ),
)
_61 = Struct(
    "Joints",
    "Joints",
    (
        Field("timestamp", "timestamp", _42),
        Field("names", "names", ListOf(Text(256), 0, 50, "T-String")),
        Field("elements", "elements", ListOf(_57, 0, 50, "JointState")),
    ),
)
_62 = Alias("JointTrajectory", "JointTrajectory", "items", ListOf(_57, 1, 60, "JointState"))
_63 = Struct(
    "JointsTrajectory",
    "JointsTrajectory",
    (
        Field("vector-name", "vector_name", ListOf(Text(256), 1, 60, "T-String")),
        Field("timetags", "timetags", ListOf(_42, 1, 60, "Time")),
        Field("trajectory", "trajectory", ListOf(ListOf(_57, 1, 60, "JointState"), 1, 60, "JointTrajectory")),
    ),
)
_64 = Struct("InvalidTimeStep", "InvalidTimeStep", (Field("time-step", "time_step", Integer(0, 4294967295)),))
_65 = Struct("InvalidName", "InvalidName", (Field("nameString", "name_string", Text(256)),))
_66 = Struct(
    "Wrench",
    "Wrench",
    (
        Field("timestamp", "timestamp", _42),
        Field("force", "force", Array(Real(), ((3, 3),), ("T-Double",))),
        Field("torque", "torque", Array(Real(), ((3, 3),), ("T-Double",))),
    ),
)
_67 = Struct(
    "Wrenches",
    "Wrenches",
    (
        Field("vector-name", "vector_name", Text(256)),
        Field("timestamp", "timestamp", _42),
        Field("wrenches", "wrenches", ListOf(_66, 1, 60, "Wrench")),
    ),
)
_68 = Struct(
    "Pressure",
    "Pressure",
    (
        Field("timestamp", "timestamp", _42),
        Field("pascals", "pascals", Real()),
    ),
)
_69 = Struct("Temperature", "Temperature", (Field("kelvin", "kelvin", Real()),))
_70 = Struct(
    "IMUSensors",
    "IMUSensors",
    (
        Field("timestamp", "timestamp", _42),
        Field("acc", "acc", Array(Real(), ((3, 3),), ("T-Double",))),
        Field("gyro", "gyro", Array(Real(), ((3, 3),), ("T-Double",))),
        Field("mag", "mag", Array(Real(), ((3, 3),), ("T-Double",))),
    ),
)
_71 = Struct(
    "LandmarkMap-Metadata",
    "LandmarkMapMetadata",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("producerId", "producer_id", Text(256)),
        Field("frameId", "frame_id", Text(256)),
        Field("timeStamp", "time_stamp", _42),
        Field("descriptorType", "descriptor_type", Text(256)),
    ),
)
_72 = Struct(
    "Array3DLarge",
    "Array3D",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("rows", "rows", Integer(0, 4294967295)),
        Field("cols", "cols", Integer(0, 4294967295)),
        Field("channels", "channels", Integer(0, 4294967295)),
        Field("depth", "depth", _34),
        Field("rowSize", "row_size", Integer(0, 4294967295)),
        Field("data", "data", Octets(1073741824, "|u1", 0)),
    ),
)
_73 = Struct(
    "LandmarkMap-Data",
    "LandmarkMapData",
    (
        Field("ids", "ids", Octets(1073741824, "<i8", 0)),
        Field("positions", "positions", Octets(1073741824, "<f8", 3)),
        Field("covariances", "covariances", Octets(1073741824, "<f8", 9)),
        Field("observations", "observations", Octets(1073741824, "<u4", 0)),
        Field("descriptors", "descriptors", _72),
    ),
)
_74 = Struct(
    "LandmarkMap",
    "LandmarkMap",
    (
        Field("metadata", "metadata", _71),
        Field("data", "data", _73),
    ),
)
_75 = Struct(
    "KeyFrame-Metadata",
    "KeyFrameMetadata",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("id", "id", Integer(0, 9223372036854775807)),
        Field("sensorId", "sensor_id", Text(256)),
        Field("timeStamp", "time_stamp", _42),
        Field("descriptorType", "descriptor_type", Text(256)),
    ),
)
_76 = Struct(
    "KeyFrame-Data",
    "KeyFrameData",
    (
        Field("keypoints", "keypoints", Octets(1073741824, "<f4", 2)),
        Field("scales", "scales", Octets(1073741824, "<f4", 0)),
        Field("landmarks", "landmarks", Octets(1073741824, "<i8", 0)),
        Field("descriptors", "descriptors", _72),
    ),
)
_77 = Struct(
    "KeyFrame",
    "KeyFrame",
    (
        Field("metadata", "metadata", _75),
        Field("pose", "pose", _48),
        Field("intrinsic", "intrinsic", _45),
        Field("data", "data", _76),
    ),
)
_78 = Struct(
    "FrameLarge",
    "Frame",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("metadata", "metadata", _43),
        Field("intrinsic", "intrinsic", _45),
        Field("extrinsic", "extrinsic", _49),
        Field("data", "data", _72),
    ),
)
_79 = Struct(
    "FramePairLarge",
    "FramePair",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("baseline", "baseline", Real()),
        Field("left", "left", _78),
        Field("right", "right", _78),
    ),
)
_80 = Alias("FramesSequenceLarge", "FramesSequence", "items", ListOf(_78, 0, 1024, "FrameLarge"))
_81 = Struct(
    "CompressedFrameLarge",
    "CompressedFrame",
    (
        Field("ref-time", "ref_time", _42),
        Field("received-time", "received_time", _42),
        Field("image", "image", Array(Integer(0, 255), ((1, 268435456),), ("T-UInt8",))),
        Field("attributes", "attributes", ListOf(_39, 1, 10, "Frame-attrib-t")),
        Field("rows", "rows", Integer(0, 4294967295)),
        Field("cols", "cols", Integer(0, 4294967295)),
        Field("frame-mode", "frame_mode", _52),
        Field("frame-status", "frame_status", _41),
    ),
)
_82 = Enumeration(
    "MapTypeT",
    (
        ("map-UNDEF", 0),
        ("map-DEM", 1),
        ("map-NAV", 2),
    ),
)
_83 = Struct(
    "Map-metadata-t",
    "MapMetadataT",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("timeStamp", "time_stamp", _42),
        Field("type", "type", _82),
        Field("errValues", "err_values", ListOf(_38, 0, 5, "Frame-error-t")),
        Field("scale", "scale", Real()),
        Field("pose-fixedFrame-mapFrame", "pose_fixed_frame_map_frame", _48),
    ),
)
_84 = Struct(
    "MapLarge",
    "Map",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("metadata", "metadata", _83),
        Field("data", "data", _72),
    ),
)
_85 = Struct(
    "PointCloud-DataLarge",
    "PointCloudData",
    (
        Field("points", "points", Array(Real(), ((0, 16777216), (3, 3)), ("Point", "T-Double"))),
        Field("colors", "colors", Array(Real(), ((0, 16777216), (3, 3)), ("Vector3d", "T-Double"))),
        Field("intensity", "intensity", Array(Integer(-2147483648, 2147483647), ((0, 16777216),), ("T-Int32",))),
    ),
)
_86 = Struct(
    "PointCloud-Metadata",
    "PointCloudMetadata",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("sensorId", "sensor_id", Text(256)),
        Field("frameId", "frame_id", Text(256)),
        Field("timeStamp", "time_stamp", _42),
        Field("height", "height", Integer(0, 4294967295)),
        Field("width", "width", Integer(0, 4294967295)),
        Field("isRegistered", "is_registered", Boolean()),
        Field("isOrdered", "is_ordered", Boolean()),
        Field("hasFixedTransform", "has_fixed_transform", Boolean()),
        Field("pose-robotFrame-sensorFrame", "pose_robot_frame_sensor_frame", _48),
        Field("pose-fixedFrame-robotFrame", "pose_fixed_frame_robot_frame", _48),
    ),
)
_87 = Struct(
    "PointcloudLarge",
    "Pointcloud",
    (
        Field("metadata", "metadata", _86),
        Field("data", "data", _85),
    ),
)
_88 = Struct(
    "OctreeLarge",
    "Octree",
    (
        Field("resolution", "resolution", Real()),
        Field("pointCloud", "point_cloud", _87),
    ),
)
_89 = Alias("CorrespondenceMap2DLarge", "CorrespondenceMap2D", "items", ListOf(_22, 0, 1048576, "Correspondence2D"))
_90 = Alias("CorrespondenceMap3DLarge", "CorrespondenceMap3D", "items", ListOf(_24, 0, 1048576, "Correspondence3D"))
_91 = Alias(
    "CorrespondenceMaps2DSequenceLarge",
    "CorrespondenceMaps2DSequence",
    "items",
    ListOf(ListOf(_22, 0, 1048576, "Correspondence2D"), 0, 16384, "CorrespondenceMap2DLarge"),
)
_92 = Alias(
    "CorrespondenceMaps3DSequenceLarge",
    "CorrespondenceMaps3DSequence",
    "items",
    ListOf(ListOf(_24, 0, 1048576, "Correspondence3D"), 0, 16384, "CorrespondenceMap3DLarge"),
)
_93 = Alias(
    "VisualPointFeatureVector2DLarge",
    "VisualPointFeatureVector2D",
    "items",
    ListOf(_26, 0, 1048576, "VisualPointFeature2D"),
)
_94 = Struct(
    "VisualPointFeatureVector3DLarge",
    "VisualPointFeatureVector3D",
    (
        Field("list", "list", ListOf(_30, 0, 1048576, "VisualPointFeature3D")),
        Field("list-type", "list_type", _31),
        Field("feature-type", "feature_type", _32),
    ),
)
_95 = Struct(
    "Pose",
    "Pose",
    (
        Field("pos", "pos", Array(Real(), ((3, 3),), ("T-Double",))),
        Field("orient", "orient", Array(Real(), ((4, 4),), ("T-Double",))),
    ),
)
_96 = Alias("PosesSequenceLarge", "PosesSequence", "items", ListOf(_95, 0, 1048576, "Pose"))
_97 = Alias(
    "PointSequenceLarge", "PointSequence", "values", Array(Real(), ((0, 16777216), (3, 3)), ("Point", "T-Double"))
)
_98 = Alias("DoubleSequenceLarge", "DoubleSequence", "values", Array(Real(), ((0, 16777216),), ("T-Double",)))
_99 = Alias("StringSequenceLarge", "StringSequence", "items", ListOf(Text(256), 0, 65536, "T-String"))
_100 = Alias(
    "VectorXdSequenceLarge",
    "VectorXdSequence",
    "items",
    ListOf(Array(Real(), ((0, 100),), ("T-Double",)), 0, 16777216, "VectorXd"),
)
_101 = Struct(
    "PathLarge",
    "Path",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("timeStamp", "time_stamp", _42),
        Field("waypoints", "waypoints", ListOf(_48, 0, 1048576, "TransformWithCovariance")),
    ),
)
_102 = Struct(
    "TrajectoryLarge",
    "Trajectory",
    (
        Field("speed", "speed", Real()),
        Field("points", "points", Array(Real(), ((1, 1048576), (3, 3)), ("Point", "T-Double"))),
    ),
)
_103 = Struct(
    "LaserScanLarge",
    "LaserScan",
    (
        Field("ref-time", "ref_time", _42),
        Field("start-angle", "start_angle", Real()),
        Field("angular-resolution", "angular_resolution", Real()),
        Field("speed", "speed", Real()),
        Field("ranges", "ranges", Array(Integer(-2147483648, 2147483647), ((1, 16777216),), ("T-Int32",))),
        Field("minRange", "min_range", Integer(0, 4294967295)),
        Field("maxRange", "max_range", Integer(0, 4294967295)),
        Field("remission", "remission", Array(Real(), ((1, 16777216),), ("T-Float",))),
    ),
)
_104 = Enumeration(
    "ProjectionType",
    (
        ("polar", 0),
        ("planar", 1),
    ),
)
_105 = Struct(
    "DepthMapLarge",
    "DepthMap",
    (
        Field("ref-time", "ref_time", _42),
        Field("timestamps", "timestamps", ListOf(_42, 1, 16777216, "Time")),
        Field("vertical-projection", "vertical_projection", _104),
        Field("horizontal-projection", "horizontal_projection", _104),
        Field("vertical-interval", "vertical_interval", Array(Real(), ((1, 16777216),), ("T-Double",))),
        Field("horizontal-interval", "horizontal_interval", Array(Real(), ((1, 16777216),), ("T-Double",))),
        Field("vertical-size", "vertical_size", Integer(0, 4294967295)),
        Field("horizontal-size", "horizontal_size", Integer(0, 4294967295)),
        Field("distances", "distances", Array(Real(), ((1, 16777216),), ("T-Float",))),
        Field("remissions", "remissions", Array(Real(), ((1, 16777216),), ("T-Float",))),
    ),
)
_106 = Struct(
    "DistanceImageLarge",
    "DistanceImage",
    (
        Field("ref-time", "ref_time", _42),
        Field("width", "width", Integer(0, 65535)),
        Field("height", "height", Integer(0, 65535)),
        Field("scale-x", "scale_x", Real()),
        Field("scale-y", "scale_y", Real()),
        Field("center-x", "center_x", Real()),
        Field("center-y", "center_y", Real()),
        Field("data", "data", Array(Real(), ((1, 16777216),), ("T-Float",))),
    ),
)
_107 = Struct(
    "LidarMap-Metadata",
    "LidarMapMetadata",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("producerId", "producer_id", Text(256)),
        Field("sensorId", "sensor_id", Text(256)),
        Field("timeStamp", "time_stamp", _42),
    ),
)
_108 = Struct(
    "LidarMap-Clouds",
    "LidarMapClouds",
    (
        Field("counts", "counts", Octets(1073741824, "<i8", 0)),
        Field("points", "points", Octets(1073741824, "<f4", 3)),
    ),
)
_109 = Struct(
    "LidarMap-Position",
    "LidarMapPosition",
    (
        Field("vertices", "vertices", Octets(1073741824, "<i8", 0)),
        Field("poses", "poses", Octets(1073741824, "<f8", 7)),
    ),
)
_110 = Struct(
    "PoseGraph-Metadata",
    "PoseGraphMetadata",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("producerId", "producer_id", Text(256)),
        Field("frameId", "frame_id", Text(256)),
        Field("timeStamp", "time_stamp", _42),
    ),
)
_111 = Struct(
    "PoseGraph-Vertices",
    "PoseGraphVertices",
    (
        Field("ids", "ids", Octets(1073741824, "<i8", 0)),
        Field("stamps", "stamps", Octets(1073741824, "<i8", 0)),
        Field("poses", "poses", Octets(1073741824, "<f8", 7)),
        Field("fixed", "fixed", Octets(1073741824, "<u1", 0)),
    ),
)
_112 = Struct(
    "PoseGraph-Edges",
    "PoseGraphEdges",
    (
        Field("ends", "ends", Octets(1073741824, "<i8", 2)),
        Field("poses", "poses", Octets(1073741824, "<f8", 7)),
        Field("information", "information", Octets(1073741824, "<f8", 36)),
        Field("kinds", "kinds", Octets(1073741824, "<u1", 0)),
    ),
)
_113 = Struct(
    "PoseGraph",
    "PoseGraph",
    (
        Field("metadata", "metadata", _110),
        Field("vertices", "vertices", _111),
        Field("edges", "edges", _112),
    ),
)
_114 = Struct(
    "LidarMap",
    "LidarMap",
    (
        Field("metadata", "metadata", _107),
        Field("graph", "graph", _113),
        Field("clouds", "clouds", _108),
        Field("position", "position", _109),
    ),
)
_115 = Struct(
    "LidarScan-Metadata",
    "LidarScanMetadata",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("sensorId", "sensor_id", Text(256)),
        Field("frameId", "frame_id", Text(256)),
        Field("startTime", "start_time", _42),
        Field("endTime", "end_time", _42),
    ),
)
_116 = Struct(
    "LidarScan-Data",
    "LidarScanData",
    (
        Field("points", "points", Octets(1073741824, "<f4", 3)),
        Field("timeOffsets", "time_offsets", Octets(1073741824, "<u4", 0)),
        Field("intensity", "intensity", Octets(1073741824, "<u2", 0)),
        Field("ring", "ring", Octets(1073741824, "<u2", 0)),
    ),
)
_117 = Struct(
    "LidarScan",
    "LidarScan",
    (
        Field("metadata", "metadata", _115),
        Field("data", "data", _116),
    ),
)
_118 = Struct(
    "Map",
    "Map",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("metadata", "metadata", _83),
        Field("data", "data", _35),
    ),
)
_119 = Struct(
    "GridMap-Metadata",
    "GridMapMetadata",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("frameId", "frame_id", Text(256)),
        Field("startTime", "start_time", _42),
        Field("endTime", "end_time", _42),
        Field("resolution", "resolution", Real()),
        Field("xMin", "x_min", Real()),
        Field("yMax", "y_max", Real()),
        Field("rows", "rows", Integer(0, 4294967295)),
        Field("cols", "cols", Integer(0, 4294967295)),
    ),
)
_120 = Struct(
    "GridLayer",
    "GridLayer",
    (
        Field("name", "name", Text(256)),
        Field("depth", "depth", _34),
        Field("data", "data", Octets(1073741824, "|u1", 0)),
    ),
)
_121 = Struct(
    "ElevationMap",
    "ElevationMap",
    (
        Field("metadata", "metadata", _119),
        Field("layers", "layers", ListOf(_120, 0, 64, "GridLayer")),
    ),
)
_122 = Struct(
    "NavigationMap",
    "NavigationMap",
    (
        Field("metadata", "metadata", _119),
        Field("layers", "layers", ListOf(_120, 0, 64, "GridLayer")),
    ),
)
_123 = Struct(
    "Mesh-Metadata",
    "MeshMetadata",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("producerId", "producer_id", Text(256)),
        Field("frameId", "frame_id", Text(256)),
        Field("timeStamp", "time_stamp", _42),
    ),
)
_124 = Struct(
    "Mesh-Data",
    "MeshData",
    (
        Field("vertices", "vertices", Octets(1073741824, "<f8", 3)),
        Field("triangles", "triangles", Octets(1073741824, "<u4", 3)),
        Field("normals", "normals", Octets(1073741824, "<f4", 3)),
        Field("colors", "colors", Octets(1073741824, "<u1", 3)),
    ),
)
_125 = Struct(
    "Mesh",
    "Mesh",
    (
        Field("metadata", "metadata", _123),
        Field("data", "data", _124),
    ),
)
_126 = Struct(
    "ObjectDetection",
    "ObjectDetection",
    (
        Field("label", "label", Text(256)),
        Field("score", "score", Real()),
        Field("pose", "pose", _48),
        Field("size", "size", Array(Real(), ((3, 3),), ("T-Double",))),
        Field("imageBox", "image_box", Array(Real(), ((4, 4),), ("T-Double",))),
    ),
)
_127 = Struct(
    "ObjectDetections",
    "ObjectDetections",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("timeStamp", "time_stamp", _42),
        Field("producerId", "producer_id", Text(256)),
        Field("sensorId", "sensor_id", Text(256)),
        Field("frameId", "frame_id", Text(256)),
        Field("detections", "detections", ListOf(_126, 0, 4096, "ObjectDetection")),
    ),
)
_128 = Enumeration(
    "ObjectTrackStatusT",
    (
        ("track-TENTATIVE", 0),
        ("track-CONFIRMED", 1),
        ("track-LOST", 2),
    ),
)
_129 = Struct(
    "ObjectTrack-Metadata",
    "ObjectTrackMetadata",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("timeStamp", "time_stamp", _42),
        Field("producerId", "producer_id", Text(256)),
        Field("frameId", "frame_id", Text(256)),
        Field("trackId", "track_id", Integer(0, 4294967295)),
        Field("label", "label", Text(256)),
        Field("status", "status", _128),
        Field("score", "score", Real()),
        Field("size", "size", Array(Real(), ((3, 3),), ("T-Double",))),
    ),
)
_130 = Struct(
    "ObjectTrack-Data",
    "ObjectTrackData",
    (
        Field("stamps", "stamps", Octets(1073741824, "<i8", 0)),
        Field("poses", "poses", Octets(1073741824, "<f8", 7)),
        Field("velocities", "velocities", Octets(1073741824, "<f8", 6)),
        Field("covariances", "covariances", Octets(1073741824, "<f8", 36)),
    ),
)
_131 = Struct(
    "ObjectTrack",
    "ObjectTrack",
    (
        Field("metadata", "metadata", _129),
        Field("data", "data", _130),
    ),
)
_132 = Enumeration(
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
_133 = Struct(
    "OG2-Region",
    "Og2Region",
    (
        Field("kind", "kind", _132),
        Field("frameId", "frame_id", Text(256)),
        Field("numbers", "numbers", Array(Real(), ((0, 100),), ("T-Double",))),
    ),
)
_134 = Enumeration(
    "Og2DeliverT",
    (
        ("deliver-AUTO", 0),
        ("deliver-INLINE", 1),
        ("deliver-REFERENCE", 2),
    ),
)
_135 = Struct(
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
        Field("time", "time", _42),
        Field("region", "region", _133),
        Field("maxAge", "max_age", Real()),
        Field("resolution", "resolution", Real()),
        Field("minCoverage", "min_coverage", Real()),
        Field("deliver", "deliver", _134),
        Field("deadline", "deadline", Integer(0, 4294967295)),
    ),
)
_136 = Enumeration(
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
_137 = Struct(
    "OG2-Job",
    "Og2Job",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("timeStamp", "time_stamp", _42),
        Field("jobId", "job_id", Text(256)),
        Field("requestId", "request_id", Text(256)),
        Field("robot", "robot", Text(256)),
        Field("product", "product", Text(256)),
        Field("state", "state", _136),
        Field("reason", "reason", Text(256)),
        Field("remaining", "remaining", Real()),
        Field("plan", "plan", ListOf(Text(256), 0, 256, "T-String")),
    ),
)
_138 = Enumeration(
    "Og2ReplyKindT",
    (
        ("reply-PROGRESS", 0),
        ("reply-PRODUCT", 1),
        ("reply-REFERENCE", 2),
        ("reply-ERROR", 3),
    ),
)
_139 = Enumeration(
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
_140 = Enumeration(
    "ProductStatusT",
    (
        ("status-OK", 0),
        ("status-DEGRADED", 1),
        ("status-FAILED", 2),
    ),
)
_141 = Enumeration(
    "ProductCovarianceKindT",
    (
        ("covariance-NONE", 0),
        ("covariance-FORMAL", 1),
        ("covariance-CALIBRATED", 2),
    ),
)
_142 = Struct(
    "Product-metric-t",
    "ProductMetricT",
    (
        Field("name", "name", Text(256)),
        Field("value", "value", Real()),
    ),
)
_143 = Struct(
    "Product-Quality",
    "ProductQuality",
    (
        Field("status", "status", _140),
        Field("reasons", "reasons", ListOf(Text(256), 0, 256, "T-String")),
        Field("covarianceKind", "covariance_kind", _141),
        Field("metrics", "metrics", ListOf(_142, 0, 1024, "Product-metric-t")),
    ),
)
_144 = Struct(
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
        Field("startTime", "start_time", _42),
        Field("endTime", "end_time", _42),
        Field("frameId", "frame_id", Text(256)),
        Field("childFrameId", "child_frame_id", Text(256)),
        Field("producerId", "producer_id", Text(256)),
        Field("configHash", "config_hash", Text(256)),
        Field("inputs", "inputs", ListOf(Text(256), 0, 65535, "T-String")),
        Field("quality", "quality", _143),
        Field("hasBox", "has_box", Boolean()),
        Field("box", "box", Array(Real(), ((6, 6),), ("T-Double",))),
        Field("resolution", "resolution", Real()),
    ),
)
_145 = Struct(
    "OG2-Reply",
    "Og2Reply",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("timeStamp", "time_stamp", _42),
        Field("requestId", "request_id", Text(256)),
        Field("jobId", "job_id", Text(256)),
        Field("kind", "kind", _138),
        Field("isFinal", "is_final", Boolean()),
        Field("errorCode", "error_code", _139),
        Field("retriable", "retriable", Boolean()),
        Field("detail", "detail", Text(256)),
        Field("metadata", "metadata", _144),
        Field("coverage", "coverage", Real()),
        Field("age", "age", Real()),
        Field("oldestAge", "oldest_age", Real()),
        Field("differences", "differences", ListOf(Text(256), 0, 256, "T-String")),
        Field("payload", "payload", Octets(1073741824, "|u1", 0)),
    ),
)
_146 = Struct(
    "PointCloud-Data",
    "PointCloudData",
    (
        Field("points", "points", Array(Real(), ((0, 400000), (3, 3)), ("Point", "T-Double"))),
        Field("colors", "colors", Array(Real(), ((0, 400000), (3, 3)), ("Vector3d", "T-Double"))),
        Field("intensity", "intensity", Array(Integer(-2147483648, 2147483647), ((0, 400000),), ("T-Int32",))),
    ),
)
_147 = Struct(
    "Pointcloud",
    "Pointcloud",
    (
        Field("metadata", "metadata", _86),
        Field("data", "data", _146),
    ),
)
_148 = Struct(
    "Octree",
    "Octree",
    (
        Field("resolution", "resolution", Real()),
        Field("pointCloud", "point_cloud", _147),
    ),
)
_149 = Alias("Position", "Position", "values", Array(Real(), ((3, 3),), ("T-Double",)))
_150 = Alias("Position2D", "Position2D", "values", Array(Real(), ((2, 2),), ("T-Double",)))
_151 = Alias("Orientation", "Orientation", "values", Array(Real(), ((4, 4),), ("T-Double",)))
_152 = Struct(
    "PoseUpdateThreshold",
    "PoseUpdateThreshold",
    (
        Field("distance", "distance", Real()),
        Field("angle", "angle", Real()),
    ),
)
_153 = Struct(
    "Pose2D",
    "Pose2D",
    (
        Field("position", "position", Array(Real(), ((2, 2),), ("T-Double",))),
        Field("orientation", "orientation", Real()),
    ),
)
_154 = Struct(
    "Motion2D",
    "Motion2D",
    (
        Field("translation", "translation", Real()),
        Field("rotation", "rotation", Real()),
    ),
)
_155 = Struct(
    "TwistWithCovariance-metadata",
    "TwistWithCovarianceMetadata",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("timeStamp", "time_stamp", _42),
    ),
)
_156 = Struct(
    "TwistWithCovariance-data",
    "TwistWithCovarianceData",
    (
        Field("vel", "vel", Array(Real(), ((3, 3),), ("T-Double",))),
        Field("rot", "rot", Array(Real(), ((3, 3),), ("T-Double",))),
        Field("cov", "cov", Array(Real(), ((6, 6), (6, 6)), ("SEQUENCE_OF", "T-Double"))),
    ),
)
_157 = Struct(
    "TwistWithCovariance",
    "TwistWithCovariance",
    (
        Field("metadata", "metadata", _155),
        Field("data", "data", _156),
    ),
)
_158 = Struct(
    "BodyState",
    "BodyState",
    (
        Field("ref-time", "ref_time", _42),
        Field("pose", "pose", _48),
        Field("velocity", "velocity", _157),
    ),
)
_159 = Struct(
    "RigidBodyState",
    "RigidBodyState",
    (
        Field("timestamp", "timestamp", _42),
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
_160 = Struct(
    "RigidBodyAcceleration",
    "RigidBodyAcceleration",
    (
        Field("ref-time", "ref_time", _42),
        Field("acceleration", "acceleration", Array(Real(), ((3, 3),), ("T-Double",))),
        Field("cov-acceleration", "cov_acceleration", Array(Real(), ((3, 3), (3, 3)), ("SEQUENCE_OF", "T-Double"))),
    ),
)
_161 = Struct(
    "Waypoint",
    "Waypoint",
    (
        Field("position", "position", Array(Real(), ((3, 3),), ("T-Double",))),
        Field("heading", "heading", Real()),
        Field("tol-position", "tol_position", Real()),
        Field("tol-heading", "tol_heading", Real()),
    ),
)
_162 = Struct(
    "Trajectory",
    "Trajectory",
    (
        Field("speed", "speed", Real()),
        Field("points", "points", Array(Real(), ((1, 50), (3, 3)), ("Point", "T-Double"))),
    ),
)
_163 = Struct(
    "Path",
    "Path",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("timeStamp", "time_stamp", _42),
        Field("waypoints", "waypoints", ListOf(_48, 0, 100, "TransformWithCovariance")),
    ),
)
_164 = Struct(
    "PoseTrajectory-Metadata",
    "PoseTrajectoryMetadata",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("producerId", "producer_id", Text(256)),
        Field("parentFrameId", "parent_frame_id", Text(256)),
        Field("childFrameId", "child_frame_id", Text(256)),
    ),
)
_165 = Struct(
    "PoseTrajectory-Data",
    "PoseTrajectoryData",
    (
        Field("stamps", "stamps", Octets(1073741824, "<i8", 0)),
        Field("poses", "poses", Octets(1073741824, "<f8", 7)),
        Field("covariances", "covariances", Octets(1073741824, "<f8", 36)),
    ),
)
_166 = Struct(
    "PoseTrajectory",
    "PoseTrajectory",
    (
        Field("metadata", "metadata", _164),
        Field("data", "data", _165),
    ),
)
_167 = Enumeration(
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
_168 = Struct(
    "LaserScan",
    "LaserScan",
    (
        Field("ref-time", "ref_time", _42),
        Field("start-angle", "start_angle", Real()),
        Field("angular-resolution", "angular_resolution", Real()),
        Field("speed", "speed", Real()),
        Field("ranges", "ranges", Array(Integer(-2147483648, 2147483647), ((1, 2000),), ("T-Int32",))),
        Field("minRange", "min_range", Integer(0, 4294967295)),
        Field("maxRange", "max_range", Integer(0, 4294967295)),
        Field("remission", "remission", Array(Real(), ((1, 2000),), ("T-Float",))),
    ),
)
_169 = Enumeration(
    "UnitAxis",
    (
        ("unit-x", 0),
        ("unit-y", 1),
        ("unit-z", 2),
    ),
)
_170 = Enumeration(
    "DepthMeasurementState",
    (
        ("valid-measurement", 0),
        ("too-far", 1),
        ("too-near", 2),
        ("measurement-error", 3),
    ),
)
_171 = Struct(
    "DepthMap",
    "DepthMap",
    (
        Field("ref-time", "ref_time", _42),
        Field("timestamps", "timestamps", ListOf(_42, 1, 30000, "Time")),
        Field("vertical-projection", "vertical_projection", _104),
        Field("horizontal-projection", "horizontal_projection", _104),
        Field("vertical-interval", "vertical_interval", Array(Real(), ((1, 30000),), ("T-Double",))),
        Field("horizontal-interval", "horizontal_interval", Array(Real(), ((1, 30000),), ("T-Double",))),
        Field("vertical-size", "vertical_size", Integer(0, 4294967295)),
        Field("horizontal-size", "horizontal_size", Integer(0, 4294967295)),
        Field("distances", "distances", Array(Real(), ((1, 30000),), ("T-Float",))),
        Field("remissions", "remissions", Array(Real(), ((1, 30000),), ("T-Float",))),
    ),
)
_172 = Struct(
    "DistanceImage",
    "DistanceImage",
    (
        Field("ref-time", "ref_time", _42),
        Field("width", "width", Integer(0, 65535)),
        Field("height", "height", Integer(0, 65535)),
        Field("scale-x", "scale_x", Real()),
        Field("scale-y", "scale_y", Real()),
        Field("center-x", "center_x", Real()),
        Field("center-y", "center_y", Real()),
        Field("data", "data", Array(Real(), ((1, 60),), ("T-Float",))),
    ),
)
_173 = Struct(
    "Sonar",
    "Sonar",
    (
        Field("ref-time", "ref_time", _42),
        Field("timestamps", "timestamps", ListOf(_42, 1, 60, "Time")),
        Field("bin-duration", "bin_duration", _42),
        Field("beam-width", "beam_width", _20),
        Field("beam-height", "beam_height", _20),
        Field("bearings", "bearings", ListOf(_20, 1, 60, "Angle")),
        Field("speed-of-sound", "speed_of_sound", Real()),
        Field("bin-count", "bin_count", Integer(0, 4294967295)),
        Field("beam-count", "beam_count", Integer(0, 4294967295)),
        Field("bins", "bins", Array(Real(), ((1, 60),), ("T-Float",))),
    ),
)
_174 = Struct(
    "SonarBeam",
    "SonarBeam",
    (
        Field("ref-time", "ref_time", _42),
        Field("bearing", "bearing", _20),
        Field("sampling-interval", "sampling_interval", Real()),
        Field("speed-of-sound", "speed_of_sound", Real()),
        Field("beamwidth-horizontal", "beamwidth_horizontal", Real()),
        Field("beamwidth-vertical", "beamwidth_vertical", Real()),
        Field("beam", "beam", Array(Integer(0, 255), ((1, 60),), ("T-UInt8",))),
    ),
)
_175 = Struct(
    "SonarScan",
    "SonarScan",
    (
        Field("ref-time", "ref_time", _42),
        Field("data", "data", Array(Integer(0, 255), ((1, 60),), ("T-UInt8",))),
        Field("time-beams", "time_beams", ListOf(_42, 1, 60, "Time")),
        Field("number-of-beams", "number_of_beams", Integer(0, 65535)),
        Field("number-of-bins", "number_of_bins", Integer(0, 65535)),
        Field("start-bearing", "start_bearing", _20),
        Field("angular-resolution", "angular_resolution", _20),
        Field("sampling-interval", "sampling_interval", Real()),
        Field("speed-of-sound", "speed_of_sound", Real()),
        Field("beamwidth-horizontal", "beamwidth_horizontal", _20),
        Field("beamwidth-vertical", "beamwidth_vertical", _20),
        Field("memory-layout-column", "memory_layout_column", Boolean()),
        Field("polar-coordinates", "polar_coordinates", Boolean()),
    ),
)
_176 = Alias("FramesSequence", "FramesSequence", "items", ListOf(_50, 0, 10, "Frame"))
_177 = Alias("PosesSequence", "PosesSequence", "items", ListOf(_95, 0, 10, "Pose"))
_178 = Alias(
    "CorrespondenceMaps2DSequence",
    "CorrespondenceMaps2DSequence",
    "items",
    ListOf(ListOf(_22, 0, 1024, "Correspondence2D"), 0, 56, "CorrespondenceMap2D"),
)
_179 = Alias(
    "CorrespondenceMaps3DSequence",
    "CorrespondenceMaps3DSequence",
    "items",
    ListOf(ListOf(_24, 0, 51200, "Correspondence3D"), 0, 56, "CorrespondenceMap3D"),
)
_180 = Alias("PointSequence", "PointSequence", "values", Array(Real(), ((0, 327680), (3, 3)), ("Point", "T-Double")))
_181 = Alias("DoubleSequence", "DoubleSequence", "values", Array(Real(), ((0, 327680),), ("T-Double",)))
_182 = Alias("StringSequence", "StringSequence", "items", ListOf(Text(256), 0, 100, "T-String"))
_183 = Alias(
    "VectorXdSequence",
    "VectorXdSequence",
    "items",
    ListOf(Array(Real(), ((0, 100),), ("T-Double",)), 0, 327680, "VectorXd"),
)
_184 = Enumeration(
    "IcuStateT",
    (
        ("icu-STEADY", 0),
        ("icu-SWITCHING", 1),
    ),
)
_185 = Struct(
    "ICU-Mode",
    "IcuMode",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("timeStamp", "time_stamp", _42),
        Field("robot", "robot", Text(256)),
        Field("sensor", "sensor", Text(256)),
        Field("mode", "mode", Text(256)),
        Field("target", "target", Text(256)),
        Field("state", "state", _184),
        Field("isOn", "is_on", Boolean()),
        Field("rate", "rate", Real()),
        Field("holder", "holder", Text(256)),
    ),
)
_186 = Enumeration(
    "DfpcStateT",
    (
        ("dfpc-UNCONFIGURED", 0),
        ("dfpc-INACTIVE", 1),
        ("dfpc-ACTIVE", 2),
        ("dfpc-ERROR", 3),
    ),
)
_187 = Struct(
    "DFPC-Status",
    "DfpcStatus",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("timeStamp", "time_stamp", _42),
        Field("robot", "robot", Text(256)),
        Field("dfpc", "dfpc", Text(256)),
        Field("implementation", "implementation", Text(256)),
        Field("configHash", "config_hash", Text(256)),
        Field("state", "state", _186),
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
_188 = Struct(
    "Event",
    "Event",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("ordinal", "ordinal", Integer(0, 9223372036854775807)),
        Field("timeStamp", "time_stamp", _42),
        Field("scope", "scope", Text(256)),
        Field("kind", "kind", Text(256)),
        Field("body", "body", Octets(65536, "|u1", 0)),
    ),
)
_189 = Enumeration(
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
    "Vector2d": _1,
    "Vector3d": _2,
    "Vector4d": _3,
    "Vector6d": _4,
    "VectorXd": _5,
    "Quaterniond": _6,
    "AngleAxisd": _7,
    "Matrix2d": _8,
    "Matrix3d": _9,
    "Matrix4d": _10,
    "Matrix6d": _11,
    "MatrixXd": _12,
    "Affine3d": _13,
    "Isometry3d": _14,
    "Transform3d": _15,
    "Covariance": _16,
    "Point": _17,
    "Point2D": _18,
    "Point3D": _19,
    "Angle": _20,
    "AngleSegment": _21,
    "Correspondence2D": _22,
    "CorrespondenceMap2D": _23,
    "Correspondence3D": _24,
    "CorrespondenceMap3D": _25,
    "VisualPointFeature2D": _26,
    "VisualPointFeatureVector2D": _27,
    "Point3DReference": _28,
    "VisualPointFeature3D": _30,
    "VisualPointFeatureVector3D": _33,
    "Array3D": _35,
    "Frame-error-t": _38,
    "Frame-attrib-t": _39,
    "Time": _42,
    "Frame-metadata-t": _43,
    "Frame-intrinsic-t": _45,
    "TransformWithCovariance-Metadata": _46,
    "TransformWithCovariance-Data": _47,
    "TransformWithCovariance": _48,
    "Frame-extrinsic-t": _49,
    "Frame": _50,
    "FramePair": _51,
    "CompressedFrame": _53,
    "ImuSpan-Metadata": _54,
    "ImuSpan-Data": _55,
    "ImuSpan": _56,
    "JointState": _57,
    "JointLimitRange": _58,
    "OutOfBounds": _59,
    "JointLimits": _60,
    "Joints": _61,
    "JointTrajectory": _62,
    "JointsTrajectory": _63,
    "InvalidTimeStep": _64,
    "InvalidName": _65,
    "Wrench": _66,
    "Wrenches": _67,
    "Pressure": _68,
    "Temperature": _69,
    "IMUSensors": _70,
    "LandmarkMap-Metadata": _71,
    "Array3DLarge": _72,
    "LandmarkMap-Data": _73,
    "LandmarkMap": _74,
    "KeyFrame-Metadata": _75,
    "KeyFrame-Data": _76,
    "KeyFrame": _77,
    "FrameLarge": _78,
    "FramePairLarge": _79,
    "FramesSequenceLarge": _80,
    "CompressedFrameLarge": _81,
    "Map-metadata-t": _83,
    "MapLarge": _84,
    "PointCloud-DataLarge": _85,
    "PointCloud-Metadata": _86,
    "PointcloudLarge": _87,
    "OctreeLarge": _88,
    "CorrespondenceMap2DLarge": _89,
    "CorrespondenceMap3DLarge": _90,
    "CorrespondenceMaps2DSequenceLarge": _91,
    "CorrespondenceMaps3DSequenceLarge": _92,
    "VisualPointFeatureVector2DLarge": _93,
    "VisualPointFeatureVector3DLarge": _94,
    "Pose": _95,
    "PosesSequenceLarge": _96,
    "PointSequenceLarge": _97,
    "DoubleSequenceLarge": _98,
    "StringSequenceLarge": _99,
    "VectorXdSequenceLarge": _100,
    "PathLarge": _101,
    "TrajectoryLarge": _102,
    "LaserScanLarge": _103,
    "DepthMapLarge": _105,
    "DistanceImageLarge": _106,
    "LidarMap-Metadata": _107,
    "LidarMap-Clouds": _108,
    "LidarMap-Position": _109,
    "PoseGraph-Metadata": _110,
    "PoseGraph-Vertices": _111,
    "PoseGraph-Edges": _112,
    "PoseGraph": _113,
    "LidarMap": _114,
    "LidarScan-Metadata": _115,
    "LidarScan-Data": _116,
    "LidarScan": _117,
    "Map": _118,
    "GridMap-Metadata": _119,
    "GridLayer": _120,
    "ElevationMap": _121,
    "NavigationMap": _122,
    "Mesh-Metadata": _123,
    "Mesh-Data": _124,
    "Mesh": _125,
    "ObjectDetection": _126,
    "ObjectDetections": _127,
    "ObjectTrack-Metadata": _129,
    "ObjectTrack-Data": _130,
    "ObjectTrack": _131,
    "OG2-Region": _133,
    "OG2-Request": _135,
    "OG2-Job": _137,
    "Product-metric-t": _142,
    "Product-Quality": _143,
    "Product-Metadata": _144,
    "OG2-Reply": _145,
    "PointCloud-Data": _146,
    "Pointcloud": _147,
    "Octree": _148,
    "Position": _149,
    "Position2D": _150,
    "Orientation": _151,
    "PoseUpdateThreshold": _152,
    "Pose2D": _153,
    "Motion2D": _154,
    "TwistWithCovariance-metadata": _155,
    "TwistWithCovariance-data": _156,
    "TwistWithCovariance": _157,
    "BodyState": _158,
    "RigidBodyState": _159,
    "RigidBodyAcceleration": _160,
    "Waypoint": _161,
    "Trajectory": _162,
    "Path": _163,
    "PoseTrajectory-Metadata": _164,
    "PoseTrajectory-Data": _165,
    "PoseTrajectory": _166,
    "LaserScan": _168,
    "DepthMap": _171,
    "DistanceImage": _172,
    "Sonar": _173,
    "SonarBeam": _174,
    "SonarScan": _175,
    "FramesSequence": _176,
    "PosesSequence": _177,
    "CorrespondenceMaps2DSequence": _178,
    "CorrespondenceMaps3DSequence": _179,
    "PointSequence": _180,
    "DoubleSequence": _181,
    "StringSequence": _182,
    "VectorXdSequence": _183,
    "ICU-Mode": _185,
    "DFPC-Status": _187,
    "Event": _188,
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
