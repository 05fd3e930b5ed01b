# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Disturbances of a mission, one kind each file; ``table.py`` lists them all."""
