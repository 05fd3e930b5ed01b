# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Conversion of the types of ROCK (``base-types``), shared by the reader of pocolog files and the gateway."""
