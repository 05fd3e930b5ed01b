# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The Orchestrator: from a request of the autonomy framework (OG2) to a product, and what has to run for it (paper §2.2)."""
