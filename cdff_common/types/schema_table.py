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
_1 = Enumeration("BodyMotionKindT", (("motion-RESTING", 0), ("motion-STEADY", 1), ("motion-TUMBLING", 2)))
_2 = Struct(
    "Time",
    "Time",
    (
        Field("microseconds", "microseconds", Integer(-9223372036854775807, 9223372036854775807)),
        Field("usecPerSec", "usec_per_sec", Integer(-2147483648, 2147483647)),
    ),
)
_3 = Struct(
    "BodyMotion",
    "BodyMotion",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("timeStamp", "time_stamp", _2),
        Field("producerId", "producer_id", Text(256)),
        Field("frameId", "frame_id", Text(256)),
        Field("bodyFrameId", "body_frame_id", Text(256)),
        Field("kind", "kind", _1),
        Field("axis", "axis", Array(Real(), ((3, 3),), ("T-Double",))),
        Field("axisSigma", "axis_sigma", Real()),
        Field("rate", "rate", Real()),
        Field("rateSigma", "rate_sigma", Real()),
        Field("momentRatios", "moment_ratios", Array(Real(), ((2, 2),), ("T-Double",))),
        Field(
            "covMomentRatios",
            "cov_moment_ratios",
            Array(Real(), ((2, 2), (2, 2)), ("SEQUENCE_OF", "T-Double")),
        ),
        Field(
            "principalAxes", "principal_axes", Array(Real(), ((3, 3), (3, 3)), ("SEQUENCE_OF", "T-Double"))
        ),
        Field("centre", "centre", Array(Real(), ((3, 3),), ("T-Double",))),
        Field("covCentre", "cov_centre", Array(Real(), ((3, 3), (3, 3)), ("SEQUENCE_OF", "T-Double"))),
        Field("unobservable", "unobservable", Array(Real(), ((0, 3), (3, 3)), ("Vector3d", "T-Double"))),
    ),
)
_4 = Struct(
    "Bundle-Metadata",
    "BundleMetadata",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("producerId", "producer_id", Text(256)),
        Field("frameId", "frame_id", Text(256)),
        Field("timeStamp", "time_stamp", _2),
    ),
)
_5 = Struct(
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
_6 = Struct(
    "Bundle-Lenses",
    "BundleLenses",
    (
        Field("values", "values", OctetString(1073741824, "<f8", 10)),
        Field("free", "free", OctetString(1073741824, "<u4", 0)),
    ),
)
_7 = Struct(
    "Bundle-Points",
    "BundlePoints",
    (
        Field("ids", "ids", OctetString(1073741824, "<i8", 0)),
        Field("positions", "positions", OctetString(1073741824, "<f8", 3)),
        Field("fixed", "fixed", OctetString(1073741824, "<u1", 0)),
    ),
)
_8 = Struct(
    "Bundle-Observations",
    "BundleObservations",
    (
        Field("cameras", "cameras", OctetString(1073741824, "<u4", 0)),
        Field("points", "points", OctetString(1073741824, "<u4", 0)),
        Field("pixels", "pixels", OctetString(1073741824, "<f8", 3)),
    ),
)
_9 = Struct(
    "Bundle-Prior",
    "BundlePrior",
    (
        Field("cameras", "cameras", OctetString(1073741824, "<i8", 0)),
        Field("poses", "poses", OctetString(1073741824, "<f8", 7)),
        Field("information", "information", OctetString(1073741824, "<f8", 0)),
        Field("gradient", "gradient", OctetString(1073741824, "<f8", 0)),
    ),
)
_10 = Struct(
    "BundleProblem",
    "BundleProblem",
    (
        Field("metadata", "metadata", _4),
        Field("cameras", "cameras", _5),
        Field("lenses", "lenses", _6),
        Field("points", "points", _7),
        Field("observations", "observations", _8),
        Field("prior", "prior", _9),
    ),
)
_11 = Alias("Vector2d", "Vector2d", "values", Array(Real(), ((2, 2),), ("T-Double",)))
_12 = Alias("Vector3d", "Vector3d", "values", Array(Real(), ((3, 3),), ("T-Double",)))
_13 = Alias("Vector4d", "Vector4d", "values", Array(Real(), ((4, 4),), ("T-Double",)))
_14 = Alias("Vector6d", "Vector6d", "values", Array(Real(), ((6, 6),), ("T-Double",)))
_15 = Alias("VectorXd", "VectorXd", "values", Array(Real(), ((0, 100),), ("T-Double",)))
_16 = Alias("Quaterniond", "Quaterniond", "values", Array(Real(), ((4, 4),), ("T-Double",)))
_17 = Alias("AngleAxisd", "AngleAxisd", "values", Array(Real(), ((4, 4),), ("T-Double",)))
_18 = Alias("Matrix2d", "Matrix2d", "values", Array(Real(), ((2, 2), (2, 2)), ("SEQUENCE_OF", "T-Double")))
_19 = Alias("Matrix3d", "Matrix3d", "values", Array(Real(), ((3, 3), (3, 3)), ("SEQUENCE_OF", "T-Double")))
_20 = Alias("Matrix4d", "Matrix4d", "values", Array(Real(), ((4, 4), (4, 4)), ("SEQUENCE_OF", "T-Double")))
_21 = Alias("Matrix6d", "Matrix6d", "values", Array(Real(), ((6, 6), (6, 6)), ("SEQUENCE_OF", "T-Double")))
_22 = Alias("MatrixXd", "MatrixXd", "values", Array(Real(), ((0, 20), (0, 20)), ("SEQUENCE_OF", "T-Double")))
_23 = Alias("Affine3d", "Affine3d", "values", Array(Real(), ((4, 4), (4, 4)), ("SEQUENCE_OF", "T-Double")))
_24 = Alias(
    "Isometry3d", "Isometry3d", "values", Array(Real(), ((4, 4), (4, 4)), ("SEQUENCE_OF", "T-Double"))
)
_25 = Alias(
    "Transform3d", "Transform3d", "values", Array(Real(), ((4, 4), (4, 4)), ("SEQUENCE_OF", "T-Double"))
)
_26 = Alias(
    "Covariance", "Covariance", "values", Array(Real(), ((6, 6), (6, 6)), ("SEQUENCE_OF", "T-Double"))
)
_27 = Alias("Point", "Point", "values", Array(Real(), ((3, 3),), ("T-Double",)))
_28 = Alias("Point2D", "Point2D", "values", Array(Real(), ((2, 2),), ("T-Double",)))
_29 = Alias("Point3D", "Point3D", "values", Array(Real(), ((3, 3),), ("T-Double",)))
_30 = Struct("Angle", "Angle", (Field("rad", "rad", Real()),))
_31 = Struct(
    "AngleSegment",
    "AngleSegment",
    (
        Field("startRad", "start_rad", Real()),
        Field("width", "width", Real()),
    ),
)
_32 = Struct(
    "Correspondence2D",
    "Correspondence2D",
    (
        Field("source", "source", Array(Real(), ((2, 2),), ("T-Double",))),
        Field("sink", "sink", Array(Real(), ((2, 2),), ("T-Double",))),
        Field("probability", "probability", Real()),
    ),
)
_33 = Alias("CorrespondenceMap2D", "CorrespondenceMap2D", "items", ListOf(_32, 0, 1024, "Correspondence2D"))
_34 = Struct(
    "Correspondence3D",
    "Correspondence3D",
    (
        Field("source", "source", Array(Real(), ((3, 3),), ("T-Double",))),
        Field("sink", "sink", Array(Real(), ((3, 3),), ("T-Double",))),
        Field("probability", "probability", Real()),
    ),
)
_35 = Alias("CorrespondenceMap3D", "CorrespondenceMap3D", "items", ListOf(_34, 0, 51200, "Correspondence3D"))
_36 = Struct(
    "VisualPointFeature2D",
    "VisualPointFeature2D",
    (
        Field("point", "point", Array(Real(), ((2, 2),), ("T-Double",))),
        Field("descriptor", "descriptor", Array(Real(), ((0, 128),), ("T-Float",))),
    ),
)
_37 = Alias(
    "VisualPointFeatureVector2D",
    "VisualPointFeatureVector2D",
    "items",
    ListOf(_36, 0, 1024, "VisualPointFeature2D"),
)
_38 = Struct(
    "Point3DReference",
    "Point3DReference",
    (
        Field("pointCloudIdentifier", "point_cloud_identifier", Integer(0, 65535)),
        Field("index", "index", Integer(0, 9223372036854775807)),
    ),
)
_39 = Choice(
    "VisualPointFeature3DPoint",
    (
        Field("position", "position", Array(Real(), ((3, 3),), ("T-Double",))),
        Field("reference", "reference", _38),
    ),
)
_40 = Struct(
    "VisualPointFeature3D",
    "VisualPointFeature3D",
    (
        Field("point", "point", _39),
        Field("descriptor", "descriptor", Array(Real(), ((0, 352),), ("T-Float",))),
    ),
)
_41 = Enumeration(
    "VisualPointFeatureVector3DType", (("all-positions", 0), ("all-references", 1), ("hybrid-vector", 2))
)
_42 = Enumeration("VisualPointFeature3DType", (("histogram", 0), ("shot", 1), ("pfh", 2)))
_43 = Struct(
    "VisualPointFeatureVector3D",
    "VisualPointFeatureVector3D",
    (
        Field("list", "list", ListOf(_40, 0, 51200, "VisualPointFeature3D")),
        Field("list-type", "list_type", _41),
        Field("feature-type", "feature_type", _42),
    ),
)
_44 = Enumeration(
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
_45 = Struct(
    "Array3D",
    "Array3D",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("rows", "rows", Integer(0, 4294967295)),
        Field("cols", "cols", Integer(0, 4294967295)),
        Field("channels", "channels", Integer(0, 4294967295)),
        Field("depth", "depth", _44),
        Field("rowSize", "row_size", Integer(0, 4294967295)),
        Field("data", "data", OctetString(66355200, "|u1", 0)),
    ),
)
_46 = Enumeration("FramePixelModelT", (("pix-UNDEF", 0), ("pix-POLY", 1), ("pix-DISP", 2)))
_47 = Enumeration("FrameErrorTypeT", (("error-UNDEFINED", 0), ("error-DEAD", 1), ("error-FILTERED", 2)))
_48 = Struct(
    "Frame-error-t",
    "FrameErrorT",
    (
        Field("type", "type", _47),
        Field("value", "value", Real()),
    ),
)
_49 = Struct(
    "Frame-attrib-t",
    "FrameAttribT",
    (
        Field("name", "name", Text(256)),
        Field("data", "data", Text(256)),
    ),
)
_50 = Enumeration(
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
_51 = Enumeration("FrameStatusT", (("status-EMPTY", 0), ("status-VALID", 1), ("status-INVALID", 2)))
_52 = Struct(
    "Frame-metadata-t",
    "FrameMetadataT",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("timeStamp", "time_stamp", _2),
        Field("receivedTime", "received_time", _2),
        Field("pixelModel", "pixel_model", _46),
        Field("pixelCoeffs", "pixel_coeffs", Array(Real(), ((0, 100),), ("T-Double",))),
        Field("errValues", "err_values", ListOf(_48, 0, 3, "Frame-error-t")),
        Field("attributes", "attributes", ListOf(_49, 0, 5, "Frame-attrib-t")),
        Field("mode", "mode", _50),
        Field("status", "status", _51),
    ),
)
_53 = Enumeration(
    "FrameCameraModelT", (("cam-UNDEF", 0), ("cam-PINHOLE", 1), ("cam-FISHEYE", 2), ("cam-MAPS", 3))
)
_54 = Struct(
    "Frame-intrinsic-t",
    "FrameIntrinsicT",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("sensorId", "sensor_id", Text(256)),
        Field("cameraMatrix", "camera_matrix", Array(Real(), ((3, 3), (3, 3)), ("SEQUENCE_OF", "T-Double"))),
        Field("cameraModel", "camera_model", _53),
        Field("distCoeffs", "dist_coeffs", Array(Real(), ((0, 100),), ("T-Double",))),
    ),
)
_55 = Struct(
    "TransformWithCovariance-Metadata",
    "TransformWithCovarianceMetadata",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("producerId", "producer_id", Text(256)),
        Field("dataEstimated", "data_estimated", Array(Boolean(), ((7, 7),), ("BOOLEAN",))),
        Field("parentFrameId", "parent_frame_id", Text(256)),
        Field("parentTime", "parent_time", _2),
        Field("childFrameId", "child_frame_id", Text(256)),
        Field("childTime", "child_time", _2),
    ),
)
_56 = Struct(
    "TransformWithCovariance-Data",
    "TransformWithCovarianceData",
    (
        Field("translation", "translation", Array(Real(), ((3, 3),), ("T-Double",))),
        Field("orientation", "orientation", Array(Real(), ((4, 4),), ("T-Double",))),
        Field("cov", "cov", Array(Real(), ((6, 6), (6, 6)), ("SEQUENCE_OF", "T-Double"))),
    ),
)
_57 = Struct(
    "TransformWithCovariance",
    "TransformWithCovariance",
    (
        Field("metadata", "metadata", _55),
        Field("data", "data", _56),
    ),
)
_58 = Struct(
    "Frame-extrinsic-t",
    "FrameExtrinsicT",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("hasFixedTransform", "has_fixed_transform", Boolean()),
        Field("pose-robotFrame-sensorFrame", "pose_robot_frame_sensor_frame", _57),
        Field("pose-fixedFrame-robotFrame", "pose_fixed_frame_robot_frame", _57),
    ),
)
_59 = Struct(
    "Frame",
    "Frame",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("metadata", "metadata", _52),
        Field("intrinsic", "intrinsic", _54),
        Field("extrinsic", "extrinsic", _58),
        Field("data", "data", _45),
    ),
)
_60 = Struct(
    "FramePair",
    "FramePair",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("baseline", "baseline", Real()),
        Field("left", "left", _59),
        Field("right", "right", _59),
    ),
)
_61 = Enumeration("FrameCompressedModeT", (("mode-compressed-undefined", 0), ("mode-pjpg", 1)))
_62 = Struct(
    "CompressedFrame",
    "CompressedFrame",
    (
        Field("ref-time", "ref_time", _2),
        Field("received-time", "received_time", _2),
        Field("image", "image", Array(Integer(0, 255), ((1, 262144),), ("T-UInt8",))),
        Field("attributes", "attributes", ListOf(_49, 1, 10, "Frame-attrib-t")),
        Field("rows", "rows", Integer(0, 4294967295)),
        Field("cols", "cols", Integer(0, 4294967295)),
        Field("frame-mode", "frame_mode", _61),
        Field("frame-status", "frame_status", _51),
    ),
)
_63 = Struct(
    "GroundAreas-Metadata",
    "GroundAreasMetadata",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("producerId", "producer_id", Text(256)),
        Field("frameId", "frame_id", Text(256)),
        Field("startTime", "start_time", _2),
        Field("endTime", "end_time", _2),
        Field("resolution", "resolution", Real()),
        Field("tolerance", "tolerance", Real()),
    ),
)
_64 = Struct(
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
_65 = Struct(
    "GroundAreas",
    "GroundAreas",
    (
        Field("metadata", "metadata", _63),
        Field("data", "data", _64),
    ),
)
_66 = Struct(
    "ImuSpan-Metadata",
    "ImuSpanMetadata",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("sensorId", "sensor_id", Text(256)),
    ),
)
_67 = Struct(
    "ImuSpan-Data",
    "ImuSpanData",
    (
        Field("stamps", "stamps", OctetString(1073741824, "<i8", 0)),
        Field("acc", "acc", OctetString(1073741824, "<f8", 3)),
        Field("gyro", "gyro", OctetString(1073741824, "<f8", 3)),
        Field("mag", "mag", OctetString(1073741824, "<f8", 3)),
    ),
)
_68 = Struct(
    "ImuSpan",
    "ImuSpan",
    (
        Field("metadata", "metadata", _66),
        Field("data", "data", _67),
    ),
)
_69 = Struct(
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
_70 = Struct(
    "JointLimitRange",
    "JointLimitRange",
    (
        Field("min", "min", _69),
        Field("max", "max", _69),
    ),
)
_71 = Struct(
    "OutOfBounds",
    "OutOfBounds",
    (
        Field("error-name", "error_name", Text(256)),
        Field("min", "min", Real()),
        Field("max", "max", Real()),
        Field("value", "value", Real()),
    ),
)
_72 = Struct(
    "JointLimits",
    "JointLimits",
    (
        Field("vector-name", "vector_name", Text(256)),
        Field("ranges", "ranges", ListOf(_70, 1, 60, "JointLimitRange")),
    ),
)
_73 = Struct(
    "Joints",
    "Joints",
    (
        Field("timestamp", "timestamp", _2),
        Field("names", "names", ListOf(Text(256), 0, 50, "T-String")),
        Field("elements", "elements", ListOf(_69, 0, 50, "JointState")),
    ),
)
_74 = Alias("JointTrajectory", "JointTrajectory", "items", ListOf(_69, 1, 60, "JointState"))
_75 = Struct(
    "JointsTrajectory",
    "JointsTrajectory",
    (
        Field("vector-name", "vector_name", ListOf(Text(256), 1, 60, "T-String")),
        Field("timetags", "timetags", ListOf(_2, 1, 60, "Time")),
        Field("trajectory", "trajectory", ListOf(ListOf(_69, 1, 60, "JointState"), 1, 60, "JointTrajectory")),
    ),
)
_76 = Struct("InvalidTimeStep", "InvalidTimeStep", (Field("time-step", "time_step", Integer(0, 4294967295)),))
_77 = Struct("InvalidName", "InvalidName", (Field("nameString", "name_string", Text(256)),))
_78 = Struct(
    "Wrench",
    "Wrench",
    (
        Field("timestamp", "timestamp", _2),
        Field("force", "force", Array(Real(), ((3, 3),), ("T-Double",))),
        Field("torque", "torque", Array(Real(), ((3, 3),), ("T-Double",))),
    ),
)
_79 = Struct(
    "Wrenches",
    "Wrenches",
    (
        Field("vector-name", "vector_name", Text(256)),
        Field("timestamp", "timestamp", _2),
        Field("wrenches", "wrenches", ListOf(_78, 1, 60, "Wrench")),
    ),
)
_80 = Struct(
    "Pressure",
    "Pressure",
    (
        Field("timestamp", "timestamp", _2),
        Field("pascals", "pascals", Real()),
    ),
)
_81 = Struct("Temperature", "Temperature", (Field("kelvin", "kelvin", Real()),))
_82 = Struct(
    "IMUSensors",
    "IMUSensors",
    (
        Field("timestamp", "timestamp", _2),
        Field("acc", "acc", Array(Real(), ((3, 3),), ("T-Double",))),
        Field("gyro", "gyro", Array(Real(), ((3, 3),), ("T-Double",))),
        Field("mag", "mag", Array(Real(), ((3, 3),), ("T-Double",))),
    ),
)
_83 = Struct(
    "LandmarkMap-Metadata",
    "LandmarkMapMetadata",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("producerId", "producer_id", Text(256)),
        Field("frameId", "frame_id", Text(256)),
        Field("timeStamp", "time_stamp", _2),
        Field("descriptorType", "descriptor_type", Text(256)),
    ),
)
_84 = Struct(
    "Array3DLarge",
    "Array3D",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("rows", "rows", Integer(0, 4294967295)),
        Field("cols", "cols", Integer(0, 4294967295)),
        Field("channels", "channels", Integer(0, 4294967295)),
        Field("depth", "depth", _44),
        Field("rowSize", "row_size", Integer(0, 4294967295)),
        Field("data", "data", OctetString(1073741824, "|u1", 0)),
    ),
)
_85 = Struct(
    "LandmarkMap-Data",
    "LandmarkMapData",
    (
        Field("ids", "ids", OctetString(1073741824, "<i8", 0)),
        Field("positions", "positions", OctetString(1073741824, "<f8", 3)),
        Field("covariances", "covariances", OctetString(1073741824, "<f8", 9)),
        Field("observations", "observations", OctetString(1073741824, "<u4", 0)),
        Field("descriptors", "descriptors", _84),
    ),
)
_86 = Struct(
    "LandmarkMap",
    "LandmarkMap",
    (
        Field("metadata", "metadata", _83),
        Field("data", "data", _85),
    ),
)
_87 = Struct(
    "KeyFrame-Metadata",
    "KeyFrameMetadata",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("id", "id", Integer(0, 9223372036854775807)),
        Field("sensorId", "sensor_id", Text(256)),
        Field("timeStamp", "time_stamp", _2),
        Field("descriptorType", "descriptor_type", Text(256)),
    ),
)
_88 = Struct(
    "KeyFrame-Data",
    "KeyFrameData",
    (
        Field("keypoints", "keypoints", OctetString(1073741824, "<f4", 2)),
        Field("scales", "scales", OctetString(1073741824, "<f4", 0)),
        Field("landmarks", "landmarks", OctetString(1073741824, "<i8", 0)),
        Field("descriptors", "descriptors", _84),
    ),
)
_89 = Struct(
    "KeyFrame",
    "KeyFrame",
    (
        Field("metadata", "metadata", _87),
        Field("pose", "pose", _57),
        Field("intrinsic", "intrinsic", _54),
        Field("data", "data", _88),
    ),
)
_90 = Struct(
    "FrameLarge",
    "Frame",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("metadata", "metadata", _52),
        Field("intrinsic", "intrinsic", _54),
        Field("extrinsic", "extrinsic", _58),
        Field("data", "data", _84),
    ),
)
_91 = Struct(
    "FramePairLarge",
    "FramePair",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("baseline", "baseline", Real()),
        Field("left", "left", _90),
        Field("right", "right", _90),
    ),
)
_92 = Alias("FramesSequenceLarge", "FramesSequence", "items", ListOf(_90, 0, 1024, "FrameLarge"))
_93 = Struct(
    "CompressedFrameLarge",
    "CompressedFrame",
    (
        Field("ref-time", "ref_time", _2),
        Field("received-time", "received_time", _2),
        Field("image", "image", Array(Integer(0, 255), ((1, 268435456),), ("T-UInt8",))),
        Field("attributes", "attributes", ListOf(_49, 1, 10, "Frame-attrib-t")),
        Field("rows", "rows", Integer(0, 4294967295)),
        Field("cols", "cols", Integer(0, 4294967295)),
        Field("frame-mode", "frame_mode", _61),
        Field("frame-status", "frame_status", _51),
    ),
)
_94 = Enumeration("MapTypeT", (("map-UNDEF", 0), ("map-DEM", 1), ("map-NAV", 2)))
_95 = Struct(
    "Map-metadata-t",
    "MapMetadataT",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("timeStamp", "time_stamp", _2),
        Field("type", "type", _94),
        Field("errValues", "err_values", ListOf(_48, 0, 5, "Frame-error-t")),
        Field("scale", "scale", Real()),
        Field("pose-fixedFrame-mapFrame", "pose_fixed_frame_map_frame", _57),
    ),
)
_96 = Struct(
    "MapLarge",
    "Map",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("metadata", "metadata", _95),
        Field("data", "data", _84),
    ),
)
_97 = Struct(
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
_98 = Struct(
    "PointCloud-Metadata",
    "PointCloudMetadata",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("sensorId", "sensor_id", Text(256)),
        Field("frameId", "frame_id", Text(256)),
        Field("timeStamp", "time_stamp", _2),
        Field("height", "height", Integer(0, 4294967295)),
        Field("width", "width", Integer(0, 4294967295)),
        Field("isRegistered", "is_registered", Boolean()),
        Field("isOrdered", "is_ordered", Boolean()),
        Field("hasFixedTransform", "has_fixed_transform", Boolean()),
        Field("pose-robotFrame-sensorFrame", "pose_robot_frame_sensor_frame", _57),
        Field("pose-fixedFrame-robotFrame", "pose_fixed_frame_robot_frame", _57),
    ),
)
_99 = Struct(
    "PointcloudLarge",
    "Pointcloud",
    (
        Field("metadata", "metadata", _98),
        Field("data", "data", _97),
    ),
)
_100 = Struct(
    "OctreeLarge",
    "Octree",
    (
        Field("resolution", "resolution", Real()),
        Field("pointCloud", "point_cloud", _99),
    ),
)
_101 = Alias(
    "CorrespondenceMap2DLarge", "CorrespondenceMap2D", "items", ListOf(_32, 0, 1048576, "Correspondence2D")
)
_102 = Alias(
    "CorrespondenceMap3DLarge", "CorrespondenceMap3D", "items", ListOf(_34, 0, 1048576, "Correspondence3D")
)
_103 = Alias(
    "CorrespondenceMaps2DSequenceLarge",
    "CorrespondenceMaps2DSequence",
    "items",
    ListOf(ListOf(_32, 0, 1048576, "Correspondence2D"), 0, 16384, "CorrespondenceMap2DLarge"),
)
_104 = Alias(
    "CorrespondenceMaps3DSequenceLarge",
    "CorrespondenceMaps3DSequence",
    "items",
    ListOf(ListOf(_34, 0, 1048576, "Correspondence3D"), 0, 16384, "CorrespondenceMap3DLarge"),
)
_105 = Alias(
    "VisualPointFeatureVector2DLarge",
    "VisualPointFeatureVector2D",
    "items",
    ListOf(_36, 0, 1048576, "VisualPointFeature2D"),
)
_106 = Struct(
    "VisualPointFeatureVector3DLarge",
    "VisualPointFeatureVector3D",
    (
        Field("list", "list", ListOf(_40, 0, 1048576, "VisualPointFeature3D")),
        Field("list-type", "list_type", _41),
        Field("feature-type", "feature_type", _42),
    ),
)
_107 = Struct(
    "Pose",
    "Pose",
    (
        Field("pos", "pos", Array(Real(), ((3, 3),), ("T-Double",))),
        Field("orient", "orient", Array(Real(), ((4, 4),), ("T-Double",))),
    ),
)
_108 = Alias("PosesSequenceLarge", "PosesSequence", "items", ListOf(_107, 0, 1048576, "Pose"))
_109 = Alias(
    "PointSequenceLarge",
    "PointSequence",
    "values",
    Array(Real(), ((0, 16777216), (3, 3)), ("Point", "T-Double")),
)
_110 = Alias(
    "DoubleSequenceLarge", "DoubleSequence", "values", Array(Real(), ((0, 16777216),), ("T-Double",))
)
_111 = Alias("StringSequenceLarge", "StringSequence", "items", ListOf(Text(256), 0, 65536, "T-String"))
_112 = Alias(
    "VectorXdSequenceLarge",
    "VectorXdSequence",
    "items",
    ListOf(Array(Real(), ((0, 100),), ("T-Double",)), 0, 16777216, "VectorXd"),
)
_113 = Struct(
    "PathLarge",
    "Path",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("timeStamp", "time_stamp", _2),
        Field("waypoints", "waypoints", ListOf(_57, 0, 1048576, "TransformWithCovariance")),
    ),
)
_114 = Struct(
    "TrajectoryLarge",
    "Trajectory",
    (
        Field("speed", "speed", Real()),
        Field("points", "points", Array(Real(), ((1, 1048576), (3, 3)), ("Point", "T-Double"))),
    ),
)
_115 = Struct(
    "LaserScanLarge",
    "LaserScan",
    (
        Field("ref-time", "ref_time", _2),
        Field("start-angle", "start_angle", Real()),
        Field("angular-resolution", "angular_resolution", Real()),
        Field("speed", "speed", Real()),
        Field("ranges", "ranges", Array(Integer(-2147483648, 2147483647), ((1, 16777216),), ("T-Int32",))),
        Field("minRange", "min_range", Integer(0, 4294967295)),
        Field("maxRange", "max_range", Integer(0, 4294967295)),
        Field("remission", "remission", Array(Real(), ((1, 16777216),), ("T-Float",))),
    ),
)
_116 = Enumeration("ProjectionType", (("polar", 0), ("planar", 1)))
_117 = Struct(
    "DepthMapLarge",
    "DepthMap",
    (
        Field("ref-time", "ref_time", _2),
        Field("timestamps", "timestamps", ListOf(_2, 1, 16777216, "Time")),
        Field("vertical-projection", "vertical_projection", _116),
        Field("horizontal-projection", "horizontal_projection", _116),
        Field("vertical-interval", "vertical_interval", Array(Real(), ((1, 16777216),), ("T-Double",))),
        Field("horizontal-interval", "horizontal_interval", Array(Real(), ((1, 16777216),), ("T-Double",))),
        Field("vertical-size", "vertical_size", Integer(0, 4294967295)),
        Field("horizontal-size", "horizontal_size", Integer(0, 4294967295)),
        Field("distances", "distances", Array(Real(), ((1, 16777216),), ("T-Float",))),
        Field("remissions", "remissions", Array(Real(), ((1, 16777216),), ("T-Float",))),
    ),
)
_118 = Struct(
    "DistanceImageLarge",
    "DistanceImage",
    (
        Field("ref-time", "ref_time", _2),
        Field("width", "width", Integer(0, 65535)),
        Field("height", "height", Integer(0, 65535)),
        Field("scale-x", "scale_x", Real()),
        Field("scale-y", "scale_y", Real()),
        Field("center-x", "center_x", Real()),
        Field("center-y", "center_y", Real()),
        Field("data", "data", Array(Real(), ((1, 16777216),), ("T-Float",))),
    ),
)
_119 = Struct(
    "LidarMap-Metadata",
    "LidarMapMetadata",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("producerId", "producer_id", Text(256)),
        Field("sensorId", "sensor_id", Text(256)),
        Field("timeStamp", "time_stamp", _2),
    ),
)
_120 = Struct(
    "LidarMap-Clouds",
    "LidarMapClouds",
    (
        Field("counts", "counts", OctetString(1073741824, "<i8", 0)),
        Field("points", "points", OctetString(1073741824, "<f4", 3)),
    ),
)
_121 = Struct(
    "LidarMap-Position",
    "LidarMapPosition",
    (
        Field("vertices", "vertices", OctetString(1073741824, "<i8", 0)),
        Field("poses", "poses", OctetString(1073741824, "<f8", 7)),
    ),
)
_122 = Struct(
    "PoseGraph-Metadata",
    "PoseGraphMetadata",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("producerId", "producer_id", Text(256)),
        Field("frameId", "frame_id", Text(256)),
        Field("timeStamp", "time_stamp", _2),
    ),
)
_123 = Struct(
    "PoseGraph-Vertices",
    "PoseGraphVertices",
    (
        Field("ids", "ids", OctetString(1073741824, "<i8", 0)),
        Field("stamps", "stamps", OctetString(1073741824, "<i8", 0)),
        Field("poses", "poses", OctetString(1073741824, "<f8", 7)),
        Field("fixed", "fixed", OctetString(1073741824, "<u1", 0)),
    ),
)
_124 = Struct(
    "PoseGraph-Edges",
    "PoseGraphEdges",
    (
        Field("ends", "ends", OctetString(1073741824, "<i8", 2)),
        Field("poses", "poses", OctetString(1073741824, "<f8", 7)),
        Field("information", "information", OctetString(1073741824, "<f8", 36)),
        Field("kinds", "kinds", OctetString(1073741824, "<u1", 0)),
    ),
)
_125 = Struct(
    "PoseGraph",
    "PoseGraph",
    (
        Field("metadata", "metadata", _122),
        Field("vertices", "vertices", _123),
        Field("edges", "edges", _124),
    ),
)
_126 = Struct(
    "LidarMap",
    "LidarMap",
    (
        Field("metadata", "metadata", _119),
        Field("graph", "graph", _125),
        Field("clouds", "clouds", _120),
        Field("position", "position", _121),
    ),
)
_127 = Struct(
    "LidarScan-Metadata",
    "LidarScanMetadata",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("sensorId", "sensor_id", Text(256)),
        Field("frameId", "frame_id", Text(256)),
        Field("startTime", "start_time", _2),
        Field("endTime", "end_time", _2),
    ),
)
_128 = Struct(
    "LidarScan-Data",
    "LidarScanData",
    (
        Field("points", "points", OctetString(1073741824, "<f4", 3)),
        Field("timeOffsets", "time_offsets", OctetString(1073741824, "<u4", 0)),
        Field("intensity", "intensity", OctetString(1073741824, "<u2", 0)),
        Field("ring", "ring", OctetString(1073741824, "<u2", 0)),
    ),
)
_129 = Struct(
    "LidarScan",
    "LidarScan",
    (
        Field("metadata", "metadata", _127),
        Field("data", "data", _128),
    ),
)
_130 = Struct(
    "Map",
    "Map",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("metadata", "metadata", _95),
        Field("data", "data", _45),
    ),
)
_131 = Struct(
    "GridMap-Metadata",
    "GridMapMetadata",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("frameId", "frame_id", Text(256)),
        Field("startTime", "start_time", _2),
        Field("endTime", "end_time", _2),
        Field("resolution", "resolution", Real()),
        Field("xMin", "x_min", Real()),
        Field("yMax", "y_max", Real()),
        Field("rows", "rows", Integer(0, 4294967295)),
        Field("cols", "cols", Integer(0, 4294967295)),
    ),
)
_132 = Struct(
    "GridLayer",
    "GridLayer",
    (
        Field("name", "name", Text(256)),
        Field("depth", "depth", _44),
        Field("data", "data", OctetString(1073741824, "|u1", 0)),
    ),
)
_133 = Struct(
    "ElevationMap",
    "ElevationMap",
    (
        Field("metadata", "metadata", _131),
        Field("layers", "layers", ListOf(_132, 0, 64, "GridLayer")),
    ),
)
_134 = Struct(
    "NavigationMap",
    "NavigationMap",
    (
        Field("metadata", "metadata", _131),
        Field("layers", "layers", ListOf(_132, 0, 64, "GridLayer")),
    ),
)
_135 = Struct(
    "Mesh-Metadata",
    "MeshMetadata",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("producerId", "producer_id", Text(256)),
        Field("frameId", "frame_id", Text(256)),
        Field("timeStamp", "time_stamp", _2),
    ),
)
_136 = Struct(
    "Mesh-Data",
    "MeshData",
    (
        Field("vertices", "vertices", OctetString(1073741824, "<f8", 3)),
        Field("triangles", "triangles", OctetString(1073741824, "<u4", 3)),
        Field("normals", "normals", OctetString(1073741824, "<f4", 3)),
        Field("colors", "colors", OctetString(1073741824, "<u1", 3)),
    ),
)
_137 = Struct(
    "Mesh",
    "Mesh",
    (
        Field("metadata", "metadata", _135),
        Field("data", "data", _136),
    ),
)
_138 = Struct(
    "ObjectDetection",
    "ObjectDetection",
    (
        Field("label", "label", Text(256)),
        Field("score", "score", Real()),
        Field("pose", "pose", _57),
        Field("size", "size", Array(Real(), ((3, 3),), ("T-Double",))),
        Field("imageBox", "image_box", Array(Real(), ((4, 4),), ("T-Double",))),
        Field("symmetricPoses", "symmetric_poses", OctetString(1073741824, "<f8", 7)),
    ),
)
_139 = Struct(
    "ObjectDetections",
    "ObjectDetections",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("timeStamp", "time_stamp", _2),
        Field("producerId", "producer_id", Text(256)),
        Field("sensorId", "sensor_id", Text(256)),
        Field("frameId", "frame_id", Text(256)),
        Field("detections", "detections", ListOf(_138, 0, 4096, "ObjectDetection")),
    ),
)
_140 = Enumeration(
    "ObjectTrackStatusT",
    (("track-TENTATIVE", 0), ("track-CONFIRMED", 1), ("track-LOST", 2), ("track-COASTING", 3)),
)
_141 = Struct(
    "ObjectTrack-Metadata",
    "ObjectTrackMetadata",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("timeStamp", "time_stamp", _2),
        Field("producerId", "producer_id", Text(256)),
        Field("frameId", "frame_id", Text(256)),
        Field("trackId", "track_id", Integer(0, 4294967295)),
        Field("label", "label", Text(256)),
        Field("status", "status", _140),
        Field("score", "score", Real()),
        Field("size", "size", Array(Real(), ((3, 3),), ("T-Double",))),
    ),
)
_142 = Struct(
    "ObjectTrack-Data",
    "ObjectTrackData",
    (
        Field("stamps", "stamps", OctetString(1073741824, "<i8", 0)),
        Field("poses", "poses", OctetString(1073741824, "<f8", 7)),
        Field("velocities", "velocities", OctetString(1073741824, "<f8", 6)),
        Field("covariances", "covariances", OctetString(1073741824, "<f8", 36)),
        Field("velocityCovariances", "velocity_covariances", OctetString(1073741824, "<f8", 36)),
        Field("bearings", "bearings", OctetString(1073741824, "<f8", 6)),
        Field("pixels", "pixels", OctetString(1073741824, "<f8", 2)),
        Field("pixelSigmas", "pixel_sigmas", OctetString(1073741824, "<f8", 2)),
    ),
)
_143 = Struct(
    "ObjectTrack",
    "ObjectTrack",
    (
        Field("metadata", "metadata", _141),
        Field("data", "data", _142),
    ),
)
_144 = Enumeration(
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
_145 = Struct(
    "OG2-Region",
    "Og2Region",
    (
        Field("kind", "kind", _144),
        Field("frameId", "frame_id", Text(256)),
        Field("numbers", "numbers", Array(Real(), ((0, 100),), ("T-Double",))),
    ),
)
_146 = Enumeration("Og2DeliverT", (("deliver-AUTO", 0), ("deliver-INLINE", 1), ("deliver-REFERENCE", 2)))
_147 = Struct(
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
        Field("time", "time", _2),
        Field("region", "region", _145),
        Field("maxAge", "max_age", Real()),
        Field("resolution", "resolution", Real()),
        Field("minCoverage", "min_coverage", Real()),
        Field("deliver", "deliver", _146),
        Field("deadline", "deadline", Integer(0, 4294967295)),
    ),
)
_148 = Enumeration(
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
_149 = Struct(
    "OG2-Job",
    "Og2Job",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("timeStamp", "time_stamp", _2),
        Field("jobId", "job_id", Text(256)),
        Field("requestId", "request_id", Text(256)),
        Field("robot", "robot", Text(256)),
        Field("product", "product", Text(256)),
        Field("state", "state", _148),
        Field("reason", "reason", Text(256)),
        Field("remaining", "remaining", Real()),
        Field("plan", "plan", ListOf(Text(256), 0, 256, "T-String")),
    ),
)
_150 = Enumeration(
    "Og2ReplyKindT", (("reply-PROGRESS", 0), ("reply-PRODUCT", 1), ("reply-REFERENCE", 2), ("reply-ERROR", 3))
)
_151 = Enumeration(
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
_152 = Enumeration("ProductStatusT", (("status-OK", 0), ("status-DEGRADED", 1), ("status-FAILED", 2)))
_153 = Enumeration(
    "ProductCovarianceKindT", (("covariance-NONE", 0), ("covariance-FORMAL", 1), ("covariance-CALIBRATED", 2))
)
_154 = Struct(
    "Product-metric-t",
    "ProductMetricT",
    (
        Field("name", "name", Text(256)),
        Field("value", "value", Real()),
    ),
)
_155 = Struct(
    "Product-Quality",
    "ProductQuality",
    (
        Field("status", "status", _152),
        Field("reasons", "reasons", ListOf(Text(256), 0, 256, "T-String")),
        Field("covarianceKind", "covariance_kind", _153),
        Field("metrics", "metrics", ListOf(_154, 0, 1024, "Product-metric-t")),
    ),
)
_156 = Struct(
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
        Field("startTime", "start_time", _2),
        Field("endTime", "end_time", _2),
        Field("frameId", "frame_id", Text(256)),
        Field("childFrameId", "child_frame_id", Text(256)),
        Field("producerId", "producer_id", Text(256)),
        Field("configHash", "config_hash", Text(256)),
        Field("inputs", "inputs", ListOf(Text(256), 0, 65535, "T-String")),
        Field("quality", "quality", _155),
        Field("hasBox", "has_box", Boolean()),
        Field("box", "box", Array(Real(), ((6, 6),), ("T-Double",))),
        Field("resolution", "resolution", Real()),
    ),
)
_157 = Struct(
    "OG2-Reply",
    "Og2Reply",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("timeStamp", "time_stamp", _2),
        Field("requestId", "request_id", Text(256)),
        Field("jobId", "job_id", Text(256)),
        Field("kind", "kind", _150),
        Field("isFinal", "is_final", Boolean()),
        Field("errorCode", "error_code", _151),
        Field("retriable", "retriable", Boolean()),
        Field("detail", "detail", Text(256)),
        Field("metadata", "metadata", _156),
        Field("coverage", "coverage", Real()),
        Field("age", "age", Real()),
        Field("oldestAge", "oldest_age", Real()),
        Field("differences", "differences", ListOf(Text(256), 0, 256, "T-String")),
        Field("payload", "payload", OctetString(1073741824, "|u1", 0)),
    ),
)
_158 = Struct(
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
_159 = Struct(
    "Pointcloud",
    "Pointcloud",
    (
        Field("metadata", "metadata", _98),
        Field("data", "data", _158),
    ),
)
_160 = Struct(
    "Octree",
    "Octree",
    (
        Field("resolution", "resolution", Real()),
        Field("pointCloud", "point_cloud", _159),
    ),
)
_161 = Alias("Position", "Position", "values", Array(Real(), ((3, 3),), ("T-Double",)))
_162 = Alias("Position2D", "Position2D", "values", Array(Real(), ((2, 2),), ("T-Double",)))
_163 = Alias("Orientation", "Orientation", "values", Array(Real(), ((4, 4),), ("T-Double",)))
_164 = Struct(
    "PoseUpdateThreshold",
    "PoseUpdateThreshold",
    (
        Field("distance", "distance", Real()),
        Field("angle", "angle", Real()),
    ),
)
_165 = Struct(
    "Pose2D",
    "Pose2D",
    (
        Field("position", "position", Array(Real(), ((2, 2),), ("T-Double",))),
        Field("orientation", "orientation", Real()),
    ),
)
_166 = Struct(
    "Motion2D",
    "Motion2D",
    (
        Field("translation", "translation", Real()),
        Field("rotation", "rotation", Real()),
    ),
)
_167 = Struct(
    "TwistWithCovariance-metadata",
    "TwistWithCovarianceMetadata",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("timeStamp", "time_stamp", _2),
    ),
)
_168 = Struct(
    "TwistWithCovariance-data",
    "TwistWithCovarianceData",
    (
        Field("vel", "vel", Array(Real(), ((3, 3),), ("T-Double",))),
        Field("rot", "rot", Array(Real(), ((3, 3),), ("T-Double",))),
        Field("cov", "cov", Array(Real(), ((6, 6), (6, 6)), ("SEQUENCE_OF", "T-Double"))),
    ),
)
_169 = Struct(
    "TwistWithCovariance",
    "TwistWithCovariance",
    (
        Field("metadata", "metadata", _167),
        Field("data", "data", _168),
    ),
)
_170 = Struct(
    "BodyState",
    "BodyState",
    (
        Field("ref-time", "ref_time", _2),
        Field("pose", "pose", _57),
        Field("velocity", "velocity", _169),
    ),
)
_171 = Struct(
    "RigidBodyState",
    "RigidBodyState",
    (
        Field("timestamp", "timestamp", _2),
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
_172 = Struct(
    "RigidBodyAcceleration",
    "RigidBodyAcceleration",
    (
        Field("ref-time", "ref_time", _2),
        Field("acceleration", "acceleration", Array(Real(), ((3, 3),), ("T-Double",))),
        Field(
            "cov-acceleration",
            "cov_acceleration",
            Array(Real(), ((3, 3), (3, 3)), ("SEQUENCE_OF", "T-Double")),
        ),
    ),
)
_173 = Struct(
    "Waypoint",
    "Waypoint",
    (
        Field("position", "position", Array(Real(), ((3, 3),), ("T-Double",))),
        Field("heading", "heading", Real()),
        Field("tol-position", "tol_position", Real()),
        Field("tol-heading", "tol_heading", Real()),
    ),
)
_174 = Struct(
    "Trajectory",
    "Trajectory",
    (
        Field("speed", "speed", Real()),
        Field("points", "points", Array(Real(), ((1, 50), (3, 3)), ("Point", "T-Double"))),
    ),
)
_175 = Struct(
    "Path",
    "Path",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("timeStamp", "time_stamp", _2),
        Field("waypoints", "waypoints", ListOf(_57, 0, 100, "TransformWithCovariance")),
    ),
)
_176 = Struct(
    "PoseTrajectory-Metadata",
    "PoseTrajectoryMetadata",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("producerId", "producer_id", Text(256)),
        Field("parentFrameId", "parent_frame_id", Text(256)),
        Field("childFrameId", "child_frame_id", Text(256)),
    ),
)
_177 = Struct(
    "PoseTrajectory-Data",
    "PoseTrajectoryData",
    (
        Field("stamps", "stamps", OctetString(1073741824, "<i8", 0)),
        Field("poses", "poses", OctetString(1073741824, "<f8", 7)),
        Field("covariances", "covariances", OctetString(1073741824, "<f8", 36)),
    ),
)
_178 = Struct(
    "PoseTrajectory",
    "PoseTrajectory",
    (
        Field("metadata", "metadata", _176),
        Field("data", "data", _177),
    ),
)
_179 = Struct(
    "PositionState-Metadata",
    "PositionStateMetadata",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("producerId", "producer_id", Text(256)),
    ),
)
_180 = Struct(
    "PositionState-Links",
    "PositionStateLinks",
    (
        Field("covariances", "covariances", OctetString(1073741824, "<f8", 9)),
        Field("links", "links", OctetString(1073741824, "<f8", 9)),
        Field("pins", "pins", OctetString(1073741824, "<i8", 0)),
        Field("broken", "broken", OctetString(1073741824, "<i8", 0)),
    ),
)
_181 = Struct(
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
_182 = Struct(
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
_183 = Struct(
    "PositionState",
    "PositionState",
    (
        Field("metadata", "metadata", _179),
        Field("line", "line", _178),
        Field("links", "links", _180),
        Field("filter", "filter", _181),
        Field("joints", "joints", _182),
    ),
)
_184 = Enumeration(
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
_185 = Struct(
    "LaserScan",
    "LaserScan",
    (
        Field("ref-time", "ref_time", _2),
        Field("start-angle", "start_angle", Real()),
        Field("angular-resolution", "angular_resolution", Real()),
        Field("speed", "speed", Real()),
        Field("ranges", "ranges", Array(Integer(-2147483648, 2147483647), ((1, 2000),), ("T-Int32",))),
        Field("minRange", "min_range", Integer(0, 4294967295)),
        Field("maxRange", "max_range", Integer(0, 4294967295)),
        Field("remission", "remission", Array(Real(), ((1, 2000),), ("T-Float",))),
    ),
)
_186 = Enumeration("UnitAxis", (("unit-x", 0), ("unit-y", 1), ("unit-z", 2)))
_187 = Enumeration(
    "DepthMeasurementState",
    (("valid-measurement", 0), ("too-far", 1), ("too-near", 2), ("measurement-error", 3)),
)
_188 = Struct(
    "DepthMap",
    "DepthMap",
    (
        Field("ref-time", "ref_time", _2),
        Field("timestamps", "timestamps", ListOf(_2, 1, 30000, "Time")),
        Field("vertical-projection", "vertical_projection", _116),
        Field("horizontal-projection", "horizontal_projection", _116),
        Field("vertical-interval", "vertical_interval", Array(Real(), ((1, 30000),), ("T-Double",))),
        Field("horizontal-interval", "horizontal_interval", Array(Real(), ((1, 30000),), ("T-Double",))),
        Field("vertical-size", "vertical_size", Integer(0, 4294967295)),
        Field("horizontal-size", "horizontal_size", Integer(0, 4294967295)),
        Field("distances", "distances", Array(Real(), ((1, 30000),), ("T-Float",))),
        Field("remissions", "remissions", Array(Real(), ((1, 30000),), ("T-Float",))),
    ),
)
_189 = Struct(
    "DistanceImage",
    "DistanceImage",
    (
        Field("ref-time", "ref_time", _2),
        Field("width", "width", Integer(0, 65535)),
        Field("height", "height", Integer(0, 65535)),
        Field("scale-x", "scale_x", Real()),
        Field("scale-y", "scale_y", Real()),
        Field("center-x", "center_x", Real()),
        Field("center-y", "center_y", Real()),
        Field("data", "data", Array(Real(), ((1, 60),), ("T-Float",))),
    ),
)
_190 = Struct(
    "Sonar",
    "Sonar",
    (
        Field("ref-time", "ref_time", _2),
        Field("timestamps", "timestamps", ListOf(_2, 1, 60, "Time")),
        Field("bin-duration", "bin_duration", _2),
        Field("beam-width", "beam_width", _30),
        Field("beam-height", "beam_height", _30),
        Field("bearings", "bearings", ListOf(_30, 1, 60, "Angle")),
        Field("speed-of-sound", "speed_of_sound", Real()),
        Field("bin-count", "bin_count", Integer(0, 4294967295)),
        Field("beam-count", "beam_count", Integer(0, 4294967295)),
        Field("bins", "bins", Array(Real(), ((1, 60),), ("T-Float",))),
    ),
)
_191 = Struct(
    "SonarBeam",
    "SonarBeam",
    (
        Field("ref-time", "ref_time", _2),
        Field("bearing", "bearing", _30),
        Field("sampling-interval", "sampling_interval", Real()),
        Field("speed-of-sound", "speed_of_sound", Real()),
        Field("beamwidth-horizontal", "beamwidth_horizontal", Real()),
        Field("beamwidth-vertical", "beamwidth_vertical", Real()),
        Field("beam", "beam", Array(Integer(0, 255), ((1, 60),), ("T-UInt8",))),
    ),
)
_192 = Struct(
    "SonarScan",
    "SonarScan",
    (
        Field("ref-time", "ref_time", _2),
        Field("data", "data", Array(Integer(0, 255), ((1, 60),), ("T-UInt8",))),
        Field("time-beams", "time_beams", ListOf(_2, 1, 60, "Time")),
        Field("number-of-beams", "number_of_beams", Integer(0, 65535)),
        Field("number-of-bins", "number_of_bins", Integer(0, 65535)),
        Field("start-bearing", "start_bearing", _30),
        Field("angular-resolution", "angular_resolution", _30),
        Field("sampling-interval", "sampling_interval", Real()),
        Field("speed-of-sound", "speed_of_sound", Real()),
        Field("beamwidth-horizontal", "beamwidth_horizontal", _30),
        Field("beamwidth-vertical", "beamwidth_vertical", _30),
        Field("memory-layout-column", "memory_layout_column", Boolean()),
        Field("polar-coordinates", "polar_coordinates", Boolean()),
    ),
)
_193 = Alias("FramesSequence", "FramesSequence", "items", ListOf(_59, 0, 10, "Frame"))
_194 = Alias("PosesSequence", "PosesSequence", "items", ListOf(_107, 0, 10, "Pose"))
_195 = Alias(
    "CorrespondenceMaps2DSequence",
    "CorrespondenceMaps2DSequence",
    "items",
    ListOf(ListOf(_32, 0, 1024, "Correspondence2D"), 0, 56, "CorrespondenceMap2D"),
)
_196 = Alias(
    "CorrespondenceMaps3DSequence",
    "CorrespondenceMaps3DSequence",
    "items",
    ListOf(ListOf(_34, 0, 51200, "Correspondence3D"), 0, 56, "CorrespondenceMap3D"),
)
_197 = Alias(
    "PointSequence", "PointSequence", "values", Array(Real(), ((0, 327680), (3, 3)), ("Point", "T-Double"))
)
_198 = Alias("DoubleSequence", "DoubleSequence", "values", Array(Real(), ((0, 327680),), ("T-Double",)))
_199 = Alias("StringSequence", "StringSequence", "items", ListOf(Text(256), 0, 100, "T-String"))
_200 = Alias(
    "VectorXdSequence",
    "VectorXdSequence",
    "items",
    ListOf(Array(Real(), ((0, 100),), ("T-Double",)), 0, 327680, "VectorXd"),
)
_201 = Enumeration("IcuStateT", (("icu-STEADY", 0), ("icu-SWITCHING", 1)))
_202 = Struct(
    "ICU-Mode",
    "IcuMode",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("timeStamp", "time_stamp", _2),
        Field("robot", "robot", Text(256)),
        Field("sensor", "sensor", Text(256)),
        Field("mode", "mode", Text(256)),
        Field("target", "target", Text(256)),
        Field("state", "state", _201),
        Field("isOn", "is_on", Boolean()),
        Field("rate", "rate", Real()),
        Field("holder", "holder", Text(256)),
    ),
)
_203 = Enumeration(
    "DfpcStateT", (("dfpc-UNCONFIGURED", 0), ("dfpc-INACTIVE", 1), ("dfpc-ACTIVE", 2), ("dfpc-ERROR", 3))
)
_204 = Struct(
    "DFPC-Status",
    "DfpcStatus",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("timeStamp", "time_stamp", _2),
        Field("robot", "robot", Text(256)),
        Field("dfpc", "dfpc", Text(256)),
        Field("implementation", "implementation", Text(256)),
        Field("configHash", "config_hash", Text(256)),
        Field("state", "state", _203),
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
_205 = Struct(
    "Event",
    "Event",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("ordinal", "ordinal", Integer(0, 9223372036854775807)),
        Field("timeStamp", "time_stamp", _2),
        Field("scope", "scope", Text(256)),
        Field("kind", "kind", Text(256)),
        Field("body", "body", OctetString(65536, "|u1", 0)),
    ),
)
_206 = Enumeration("Resolution", (("seconds", 0), ("milliseconds", 1), ("microseconds", 2)))
_207 = Struct(
    "VisualMap-Metadata",
    "VisualMapMetadata",
    (
        Field("msgVersion", "msg_version", Integer(0, 4294967295)),
        Field("producerId", "producer_id", Text(256)),
        Field("sensorId", "sensor_id", Text(256)),
        Field("timeStamp", "time_stamp", _2),
        Field("descriptorType", "descriptor_type", Text(256)),
    ),
)
_208 = Struct(
    "VisualMap-Points",
    "VisualMapPoints",
    (
        Field("counts", "counts", OctetString(1073741824, "<i8", 0)),
        Field("positions", "positions", OctetString(1073741824, "<f4", 3)),
        Field("depthSigmas", "depth_sigmas", OctetString(1073741824, "<f4", 0)),
        Field("descriptors", "descriptors", _84),
    ),
)
_209 = Struct(
    "VisualMap",
    "VisualMap",
    (
        Field("metadata", "metadata", _207),
        Field("graph", "graph", _125),
        Field("points", "points", _208),
    ),
)

#: ASN.1 name -> node of every type that can be a message.
MESSAGES: dict[str, Message] = {
    "Asn1Bitstream": _0,
    "Time": _2,
    "BodyMotion": _3,
    "Bundle-Metadata": _4,
    "Bundle-Cameras": _5,
    "Bundle-Lenses": _6,
    "Bundle-Points": _7,
    "Bundle-Observations": _8,
    "Bundle-Prior": _9,
    "BundleProblem": _10,
    "Vector2d": _11,
    "Vector3d": _12,
    "Vector4d": _13,
    "Vector6d": _14,
    "VectorXd": _15,
    "Quaterniond": _16,
    "AngleAxisd": _17,
    "Matrix2d": _18,
    "Matrix3d": _19,
    "Matrix4d": _20,
    "Matrix6d": _21,
    "MatrixXd": _22,
    "Affine3d": _23,
    "Isometry3d": _24,
    "Transform3d": _25,
    "Covariance": _26,
    "Point": _27,
    "Point2D": _28,
    "Point3D": _29,
    "Angle": _30,
    "AngleSegment": _31,
    "Correspondence2D": _32,
    "CorrespondenceMap2D": _33,
    "Correspondence3D": _34,
    "CorrespondenceMap3D": _35,
    "VisualPointFeature2D": _36,
    "VisualPointFeatureVector2D": _37,
    "Point3DReference": _38,
    "VisualPointFeature3D": _40,
    "VisualPointFeatureVector3D": _43,
    "Array3D": _45,
    "Frame-error-t": _48,
    "Frame-attrib-t": _49,
    "Frame-metadata-t": _52,
    "Frame-intrinsic-t": _54,
    "TransformWithCovariance-Metadata": _55,
    "TransformWithCovariance-Data": _56,
    "TransformWithCovariance": _57,
    "Frame-extrinsic-t": _58,
    "Frame": _59,
    "FramePair": _60,
    "CompressedFrame": _62,
    "GroundAreas-Metadata": _63,
    "GroundAreas-Data": _64,
    "GroundAreas": _65,
    "ImuSpan-Metadata": _66,
    "ImuSpan-Data": _67,
    "ImuSpan": _68,
    "JointState": _69,
    "JointLimitRange": _70,
    "OutOfBounds": _71,
    "JointLimits": _72,
    "Joints": _73,
    "JointTrajectory": _74,
    "JointsTrajectory": _75,
    "InvalidTimeStep": _76,
    "InvalidName": _77,
    "Wrench": _78,
    "Wrenches": _79,
    "Pressure": _80,
    "Temperature": _81,
    "IMUSensors": _82,
    "LandmarkMap-Metadata": _83,
    "Array3DLarge": _84,
    "LandmarkMap-Data": _85,
    "LandmarkMap": _86,
    "KeyFrame-Metadata": _87,
    "KeyFrame-Data": _88,
    "KeyFrame": _89,
    "FrameLarge": _90,
    "FramePairLarge": _91,
    "FramesSequenceLarge": _92,
    "CompressedFrameLarge": _93,
    "Map-metadata-t": _95,
    "MapLarge": _96,
    "PointCloud-DataLarge": _97,
    "PointCloud-Metadata": _98,
    "PointcloudLarge": _99,
    "OctreeLarge": _100,
    "CorrespondenceMap2DLarge": _101,
    "CorrespondenceMap3DLarge": _102,
    "CorrespondenceMaps2DSequenceLarge": _103,
    "CorrespondenceMaps3DSequenceLarge": _104,
    "VisualPointFeatureVector2DLarge": _105,
    "VisualPointFeatureVector3DLarge": _106,
    "Pose": _107,
    "PosesSequenceLarge": _108,
    "PointSequenceLarge": _109,
    "DoubleSequenceLarge": _110,
    "StringSequenceLarge": _111,
    "VectorXdSequenceLarge": _112,
    "PathLarge": _113,
    "TrajectoryLarge": _114,
    "LaserScanLarge": _115,
    "DepthMapLarge": _117,
    "DistanceImageLarge": _118,
    "LidarMap-Metadata": _119,
    "LidarMap-Clouds": _120,
    "LidarMap-Position": _121,
    "PoseGraph-Metadata": _122,
    "PoseGraph-Vertices": _123,
    "PoseGraph-Edges": _124,
    "PoseGraph": _125,
    "LidarMap": _126,
    "LidarScan-Metadata": _127,
    "LidarScan-Data": _128,
    "LidarScan": _129,
    "Map": _130,
    "GridMap-Metadata": _131,
    "GridLayer": _132,
    "ElevationMap": _133,
    "NavigationMap": _134,
    "Mesh-Metadata": _135,
    "Mesh-Data": _136,
    "Mesh": _137,
    "ObjectDetection": _138,
    "ObjectDetections": _139,
    "ObjectTrack-Metadata": _141,
    "ObjectTrack-Data": _142,
    "ObjectTrack": _143,
    "OG2-Region": _145,
    "OG2-Request": _147,
    "OG2-Job": _149,
    "Product-metric-t": _154,
    "Product-Quality": _155,
    "Product-Metadata": _156,
    "OG2-Reply": _157,
    "PointCloud-Data": _158,
    "Pointcloud": _159,
    "Octree": _160,
    "Position": _161,
    "Position2D": _162,
    "Orientation": _163,
    "PoseUpdateThreshold": _164,
    "Pose2D": _165,
    "Motion2D": _166,
    "TwistWithCovariance-metadata": _167,
    "TwistWithCovariance-data": _168,
    "TwistWithCovariance": _169,
    "BodyState": _170,
    "RigidBodyState": _171,
    "RigidBodyAcceleration": _172,
    "Waypoint": _173,
    "Trajectory": _174,
    "Path": _175,
    "PoseTrajectory-Metadata": _176,
    "PoseTrajectory-Data": _177,
    "PoseTrajectory": _178,
    "PositionState-Metadata": _179,
    "PositionState-Links": _180,
    "PositionState-Filter": _181,
    "PositionState-Joints": _182,
    "PositionState": _183,
    "LaserScan": _185,
    "DepthMap": _188,
    "DistanceImage": _189,
    "Sonar": _190,
    "SonarBeam": _191,
    "SonarScan": _192,
    "FramesSequence": _193,
    "PosesSequence": _194,
    "CorrespondenceMaps2DSequence": _195,
    "CorrespondenceMaps3DSequence": _196,
    "PointSequence": _197,
    "DoubleSequence": _198,
    "StringSequence": _199,
    "VectorXdSequence": _200,
    "ICU-Mode": _202,
    "DFPC-Status": _204,
    "Event": _205,
    "VisualMap-Metadata": _207,
    "VisualMap-Points": _208,
    "VisualMap": _209,
}

#: Name -> node of every CHOICE.
CHOICES: dict[str, Choice] = {
    "VisualPointFeature3D-point": _39,
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
