# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Identities of a mission: certificates of one authority, and what each identity may do on the bus."""
