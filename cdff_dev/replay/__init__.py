# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Replays a log through a DFPC without any middleware, repeatably, byte for byte."""
