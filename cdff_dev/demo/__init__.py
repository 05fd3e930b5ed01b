# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The demonstration: the whole system on recorded data, asked as an autonomy framework asks, judged by itself."""
