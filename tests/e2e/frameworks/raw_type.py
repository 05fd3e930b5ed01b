# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Message types for rclpy whose packages are not installed: their messages are bytes in CDR.

rclpy finds a type by a description in C (``rosidl_message_type_support_t``). Here it is that of an installed
type with another name. That suffices for subscriptions with ``raw=True`` and for messages that are bytes,
which rclpy and Fast DDS do not decode.
"""

import ctypes
from ctypes import c_char_p, c_void_p, py_object

from geometry_msgs.msg import TransformStamped

FAST_DDS = b"rosidl_typesupport_fastrtps_c"


class TypeSupport(ctypes.Structure):
    """``rosidl_message_type_support_t``."""

    _fields_ = (
        ("identifier", c_char_p),
        ("data", c_void_p),
        ("function", c_void_p),
        ("hash", c_void_p),
        ("description", c_void_p),
        ("sources", c_void_p),
    )


class Callbacks(ctypes.Structure):
    """``message_type_support_callbacks_t`` of ``rosidl_typesupport_fastrtps_cpp``."""

    _fields_ = (
        ("namespace", c_char_p),
        ("name", c_char_p),
        ("serialize", c_void_p),
        ("deserialize", c_void_p),
        ("size", c_void_p),
        ("largest_size", c_void_p),
        ("key", c_void_p),
    )


def raw_type(package, name):
    """Return a class for ``package/msg/name``."""
    capsules = ctypes.pythonapi
    capsules.PyCapsule_GetPointer.restype = c_void_p
    capsules.PyCapsule_GetPointer.argtypes = [py_object, c_char_p]
    capsules.PyCapsule_New.restype = py_object
    capsules.PyCapsule_New.argtypes = [c_void_p, c_char_p, c_void_p]
    installed = type(TransformStamped)
    installed.__import_type_support__()
    general = TypeSupport.from_address(capsules.PyCapsule_GetPointer(installed._TYPE_SUPPORT, None))
    find = ctypes.CFUNCTYPE(c_void_p, c_void_p, c_char_p)(general.function)
    found = TypeSupport.from_address(find(ctypes.addressof(general), FAST_DDS))
    callbacks = Callbacks.from_buffer_copy(Callbacks.from_address(found.data))
    callbacks.namespace, callbacks.name = f"{package}::msg".encode(), name.encode()
    support = TypeSupport.from_buffer_copy(found)
    support.data = ctypes.addressof(callbacks)
    members = {
        "_TYPE_SUPPORT": capsules.PyCapsule_New(ctypes.addressof(support), None, None),
        "_memory": (callbacks, support),
    }
    for member in ("_CREATE_ROS_MESSAGE", "_CONVERT_FROM_PY", "_CONVERT_TO_PY", "_DESTROY_ROS_MESSAGE"):
        members[member] = getattr(installed, member)
    return type("RawType", (type,), members)(name, (), {})
