# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A mission on a recorded log: orchestrator, DPM and DFPCs in one process, on the log's clock, without
Zenoh.
"""
