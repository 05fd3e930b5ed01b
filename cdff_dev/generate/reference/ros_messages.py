# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``ros.md`` and a page for each message of ROS that has a type of CDFF, from the table of messages."""

from __future__ import annotations

from cdff_dev.generate.asn1_model import type_models
from cdff_dev.generate.python_source import render
from services.ros_messages.mapping import MessageMapping, mapping_table


def pages() -> dict[str, str]:
    """Return the text of the index and of the page of each message, by path below ``docs/reference``."""
    table = mapping_table()
    entries: dict[str, list[MessageMapping]] = {}
    for entry in table.messages:
        entries.setdefault(entry.message, []).append(entry)
    classes = {model.name: model.class_name for model in type_models().values()}
    by_message = dict(sorted(entries.items()))
    names = {message: page_name(message) for message in by_message}
    texts = {
        "ros.md": render(
            "ros.md.j2", entries=by_message, names=names, classes=classes, conventions=table.conventions
        )
    }
    for message, same in by_message.items():
        texts[f"ros/{names[message]}.md"] = render(
            "ros_message.md.j2", message=message, entries=same, classes=classes
        )
    return texts


def page_name(message: str) -> str:
    """Return the name of the page of a message: ``sensor_msgs_Imu`` of ``sensor_msgs/msg/Imu``."""
    package, _, kind = message.split("/")
    return f"{package}_{kind}"
