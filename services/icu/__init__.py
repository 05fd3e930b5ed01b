# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Simulated Instrument Control Unit (OG4): sensor modes of the profile, with delays and refusals."""
