# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Simulated sensor faults, off by default: one module per sensor, and solids that are no terrain."""
