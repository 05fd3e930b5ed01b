# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Gateway to robots with ROS 1 (TCPROS and XML-RPC), which needs no ROS."""
