# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Runs of DFPCs on simulated or recorded traverses, shared by several evaluations."""
