# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``cdff check``: comparison of descriptions with the code, and of requirements with the tests."""
