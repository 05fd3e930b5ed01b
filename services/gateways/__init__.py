# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Common parts of the gateways to robots with ROS: settings, conversion, limits, counters and requests."""
