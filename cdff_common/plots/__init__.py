# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Plots of values: hillshades, images, clouds from above, paths, poses. Matplotlib is imported when used."""

from cdff_common.plots.figure import check_plot_file, figure_bytes, new_figure, write_figure
from cdff_common.plots.values import figure_of

__all__ = ["check_plot_file", "figure_bytes", "figure_of", "new_figure", "write_figure"]
