# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Replay of a log through a DFPC without middleware; two replays give identical outputs."""
