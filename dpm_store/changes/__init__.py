# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Record of every change outside the database: it shows what a damaged database lost, and restores it."""
