# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Interface and data views of TASTE (ESROCOS): written from descriptions, read for a profile."""
