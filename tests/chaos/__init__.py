# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Chaos suite: a running mission under random disturbances, with an oracle that checks its promises."""
