# SPDX-License-Identifier: BSD-3-Clause
"""The field of row differences of a pair as a picture."""

import numpy as np

from ._core import InputError, RowField
from .files import PathLike
from .plot import pyplot

_LEAST_SCALE = 0.25  #: px at the ends of the colours: smaller differences are to look small


def draw_rows(image: np.ndarray, field: RowField, title: str, file: PathLike) -> None:
    """Cells of the image coloured by their median, with the figure (px, right less left row) and an
    arrow in the direction of the difference.

    image: (H, W) uint8, a left image.
    """
    plt = pyplot()
    height, width = image.shape
    rows, columns = field.medians.shape
    most = max(_LEAST_SCALE, field.largest)
    figure, axes = plt.subplots(figsize=(9, 9 * height / width + 1))
    axes.imshow(image, cmap="gray", vmin=0, vmax=255)
    extent = (-0.5, width - 0.5, height - 0.5, -0.5)
    cells = axes.imshow(np.ma.masked_invalid(field.medians), cmap="coolwarm", vmin=-most, vmax=most,
                        alpha=0.45, extent=extent, interpolation="nearest")
    x, y = np.meshgrid((np.arange(columns) + 0.5) * width / columns,
                       (np.arange(rows) + 0.5) * height / rows)
    seen = np.isfinite(field.medians)
    # The longest one is half as long as a cell is high.
    axes.quiver(x[seen], y[seen], np.zeros(seen.sum()), field.medians[seen], angles="xy",
                scale_units="xy", scale=2 * most * rows / height, width=0.004, pivot="middle",
                edgecolor="white", linewidth=0.5)
    for u, v, value in zip(x[seen], y[seen], field.medians[seen]):
        axes.annotate(f"{value:+.2f}", (u, v), (8, 0), textcoords="offset points", fontsize=9,
                      va="center", bbox={"facecolor": "white", "alpha": 0.6, "pad": 1, "lw": 0})
    figure.colorbar(cells, ax=axes, fraction=0.03, pad=0.02, label="right row less left row, px")
    axes.set(xlim=extent[:2], ylim=extent[2:], xticks=[], yticks=[])
    axes.set_title(title, fontsize=9)
    try:
        figure.savefig(file, dpi=100, bbox_inches="tight")
    except (OSError, ValueError) as error:
        raise InputError(f"cannot write {file}: {error}") from None
    finally:
        plt.close(figure)
