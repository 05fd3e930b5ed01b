# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The database engine: schema, transactions, migrations, the directory lock and the disk quota."""
