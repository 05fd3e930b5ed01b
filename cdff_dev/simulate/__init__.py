# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Simulation of rovers: terrain, ray-cast cameras and lidar, IMU, slipping wheels, ground truth."""
