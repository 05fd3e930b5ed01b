# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Gateway to robots with ROS 2 on Zenoh (``rmw_zenoh``), which needs no ROS."""
