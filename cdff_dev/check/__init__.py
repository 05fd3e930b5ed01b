# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Checks of descriptions against code, and of requirements against tests: ``cdff check``."""
