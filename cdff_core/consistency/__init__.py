# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Consistency of the sensors of a robot: mounts, clocks and rates compared with each other."""
