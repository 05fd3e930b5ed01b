# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Checks of a profile without driving: all faults at once, each with its line and the nearest known name."""
