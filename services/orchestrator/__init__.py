# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The Orchestrator (paper §2.2): from a request of the autonomy framework to a product, and what runs for
it.
"""
