# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The player: a log's samples on the bus at their time, and the mission clock that they set."""
