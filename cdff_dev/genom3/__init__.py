# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Components of GenoM3: ``.gen`` and ``.idl`` files written from descriptions."""
