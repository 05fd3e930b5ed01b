# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Mapping between messages of ROS and types of CDFF, one table for the logs of ROS and for the gateways."""
