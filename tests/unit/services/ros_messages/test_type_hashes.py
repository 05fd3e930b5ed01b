# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Hashes of types are those of the type descriptions of ROS 2 Kilted (``kilted_hashes.json``)."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from rosbags.typesys import Stores, get_typestore

from services.ros_messages.message_types import RosTypes
from services.ros_messages.service_types import ActionType, ServiceType
from services.ros_messages.type_hashes import message_hash, service_hash

_OFFICIAL: dict[str, str] = json.loads((Path(__file__).parent / "kilted_hashes.json").read_text())
_DEFINITIONS = get_typestore(Stores.ROS2_KILTED).fielddefs
#: Services, which rosbags lacks, as in their packages.
_SERVICES = {
    "action_msgs/srv/CancelGoal": """int8 ERROR_NONE=0
GoalInfo goal_info
---
int8 ERROR_REJECTED=1
int8 return_code
GoalInfo[] goals_canceling""",
    "lifecycle_msgs/srv/ChangeState": "Transition transition\n---\nbool success",
    "lifecycle_msgs/srv/GetAvailableStates": "---\nState[] available_states",
    "lifecycle_msgs/srv/GetAvailableTransitions": "---\nTransitionDescription[] available_transitions",
    "lifecycle_msgs/srv/GetState": "---\nState current_state",
    "rcl_interfaces/srv/DescribeParameters": "string[] names\n---\nParameterDescriptor[] descriptors",
    "rcl_interfaces/srv/GetLoggerLevels": "string[] names\n---\nLoggerLevel[] levels",
    "rcl_interfaces/srv/GetParameterTypes": "string[] names\n---\nuint8[] types",
    "rcl_interfaces/srv/GetParameters": "string[] names\n---\nParameterValue[] values",
    "rcl_interfaces/srv/ListParameters": """uint64 DEPTH_RECURSIVE=0
string[] prefixes
uint64 depth
---
ListParametersResult result""",
    "rcl_interfaces/srv/SetLoggerLevels": "LoggerLevel[] levels\n---\nSetLoggerLevelsResult[] results",
    "rcl_interfaces/srv/SetParameters": "Parameter[] parameters\n---\nSetParametersResult[] results",
    "rcl_interfaces/srv/SetParametersAtomically": "Parameter[] parameters\n---\nSetParametersResult result",
    "type_description_interfaces/srv/GetTypeDescription": """string type_name
string type_hash
bool include_type_sources true
---
bool successful
string failure_reason
TypeDescription type_description
TypeSource[] type_sources
KeyValue[] extra_information""",
}


def test_the_table_has_64_messages_and_14_services() -> None:
    kinds = [name.split("/")[1] for name in _OFFICIAL]
    assert (kinds.count("msg"), kinds.count("srv")) == (64, 14)
    assert {name for name in _OFFICIAL if "/srv/" in name} == set(_SERVICES)


@pytest.mark.parametrize("name", sorted(_OFFICIAL))
def test_a_hash_is_that_of_ros_2(name: str) -> None:
    if name in _SERVICES:
        assert service_hash(_DEFINITIONS, name, _SERVICES[name]) == _OFFICIAL[name]
    else:
        assert message_hash(_DEFINITIONS, name) == _OFFICIAL[name]


def test_the_service_set_bool_has_the_hash_in_the_keys_of_other_implementations() -> None:
    found = service_hash(_DEFINITIONS, "std_srvs/srv/SetBool", "bool data\n---\nbool success\nstring message")
    assert found == "RIHS01_abe9e4bb6b41b40e6789712c00ec8871923e089af3f667a79992a428cff2da0a"


def test_the_services_and_topics_of_an_action_have_the_hashes_of_ros_2() -> None:
    """Values of the type descriptions in ros-kilted-test-msgs 2.3.0 and ros-kilted-nav-msgs 5.5.1."""
    types = RosTypes(2)
    definition = "int32 order\n---\nint32[] sequence\n---\nint32[] sequence\n"
    action = ActionType.register(types, "test_msgs/action/Fibonacci", definition)
    assert action.send_goal.type_hash == (
        "RIHS01_d807633803e38e164276573cd97e9fbd71e109c290bbf4cc312a0a1c9da7bbd9"
    )
    assert action.get_result.type_hash == (
        "RIHS01_5d30fdeb21d20e117aa5f36c7b4f0b6874f1a8cf7a9c038d58f1156c5737b209"
    )
    assert action.feedback_type == "test_msgs/action/Fibonacci_FeedbackMessage"
    assert action.feedback_hash == ("RIHS01_37487bae8cea358366b97003c1ef1ca7ce7c08df36f9e8cca496624226aee64e")
    get_map = ServiceType.register(types, "nav_msgs/srv/GetMap", "---\nOccupancyGrid map\n")
    assert get_map.type_hash == "RIHS01_c8ae77c9995b3554b5ba80e4d4d443f970ac65143102a1d893ec24fc07b31147"


def test_detections_have_the_hash_of_vision_msgs_4() -> None:
    """Value in the keys of an implementation of ROS 2 in Elixir; it covers the five nested definitions."""
    found = message_hash(RosTypes(2).store.fielddefs, "vision_msgs/msg/Detection3DArray")
    assert found == "RIHS01_793f5eab9595ac1c0da07873cc859db42eae51f0ee76056db8562515d830e018"
