# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Sensor faults of the simulator: one module per sensor, and solids that are no terrain. All are off by default."""
