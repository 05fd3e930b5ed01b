# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Replay of a mission on a recorded log: orchestrator, DPM and DFPCs in one process, without Zenoh."""
