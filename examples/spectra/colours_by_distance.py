"""A colour chart by distance: what a camera sees, what colour correction should find, why one coefficient will not do.

    varos-warp run examples/spectra/chart.yaml -o chart
    python examples/spectra/colours_by_distance.py chart -o chart.png

Above: image A from four distances, each exposed for its brightest patch; and the light that came straight from the
chart, without the veil, divided by T. Below: chromaticities of the patches as seen; the effective attenuation of the
camera that sees the sea floor; and the same in the space of attenuation coefficients (Akkaynak and Treibitz 2018, A
revised underwater image formation model, CVPR), with those that single patches have between two distances.
"""

import argparse
import sys
from itertools import pairwise

import numpy as np
from matplotlib.figure import Figure

import varos_warp as vw
from varos_warp.dataset.readiness.frames.light import layers_of

COLUMNS, ROWS = 6, 4
WHITE = 18
"""Number of the white patch."""
MIDDLE = 0.6
"""Share of a patch's side over which it is averaged."""
LEAST_PX = 5.0
"""A camera sees the chart if the middles of its patches are as wide as that in its image."""
RGB = ("#c1121f", "#2a9d3f", "#1d5fc4")


class View:
    """What one camera sees of the chart.

    Args:
        frame: A frame through it.
        chart: The chart's block in the scene file; it is not turned.
    """

    def __init__(self, frame, chart):
        self.frame = frame
        self.direct = layers_of(frame.data, frame.number, frame.camera)["direct"].astype(float)
        step = chart["patch_m"] + chart["gap_m"]
        column, row = np.meshgrid(np.arange(COLUMNS) - 2.5, 1.5 - np.arange(ROWS))
        middles = np.stack([step * column, np.zeros((ROWS, COLUMNS)), step * row], -1).reshape(-1, 1, 3)
        half = 0.5 * MIDDLE * chart["patch_m"]
        corners = chart["position"] + middles + half * np.array([[-1, 0, -1], [1, 0, 1]])
        T_w_c = frame.T_w_c
        self.pixels = frame.data.camera_model(frame.camera).project((corners - T_w_c[:3, 3]) @ T_w_c[:3, :3])

    @property
    def is_whole(self):
        """Whether all patches are in the image, and large enough."""
        low, high = self.pixels.min(axis=1), self.pixels.max(axis=1)
        height, width = self.frame.A.shape[:2]
        return bool(((low >= 0) & (high <= [width, height]) & (high - low >= LEAST_PX)).all())

    def patches(self, image):
        """Mean of an image [H, W, 3] over the middle of each patch, float64 [24, 3]."""
        low, high = np.ceil(self.pixels.min(axis=1)).astype(int), np.floor(self.pixels.max(axis=1)).astype(int)
        return np.array(
            [image[y0:y1, x0:x1].mean(axis=(0, 1), dtype=float) for (x0, y0), (x1, y1) in zip(low, high, strict=True)]
        )

    @property
    def window(self):
        """Rows and columns of the image that have the patches and a little around them."""
        low, high = self.pixels.min(axis=(0, 1)), self.pixels.max(axis=(0, 1))
        margin = 0.15 * (high - low)
        (left, top), (right, bottom) = np.maximum(low - margin, 0).astype(int), (high + margin).astype(int)
        return slice(top, bottom), slice(left, right)

    @property
    def distance(self):
        """Mean distance [m] of the patches."""
        return float(self.patches(self.frame.range[..., None]).mean())

    def developed(self, image):
        """Linear sRGB of an image of the camera's channels, by its colour matrix if it has one."""
        matrix = self.frame.data.color_matrix(self.frame.camera)
        return image if matrix is None else image @ matrix.T

    @property
    def corrected(self):
        """The direct light over what the water lets through: what white light of the lamp would tell of the chart."""
        T = self.frame.T.astype(float)
        return np.divide(self.direct, T, out=np.zeros_like(T), where=T > 0.0)


def chart_views(data):
    """The views of a dataset that have the whole chart, by distance."""
    charts = [block for block in data.meta["scene"]["objects"] if block["kind"] == "color_chart"]
    views = [View(data[0, camera], chart) for camera in data.cameras for chart in charts[:1]]
    return sorted((view for view in views if view.is_whole), key=lambda view: view.distance)


def of_patches(near, far):
    """Attenuation [1/m] of the direct light of each patch between two distances, float64 [24, 3].

    The lamp stands still, so that water is all that makes the difference.
    """
    return np.log(near.patches(near.direct) / far.patches(far.direct)) / (far.distance - near.distance)


def by_distance(frame, edges):
    """Medians of a frame's effective attenuation between distances, float64 [N - 1, 3]; NaN where nothing is seen."""
    groups = np.digitize(frame.range, edges) - 1
    return np.array(
        [
            np.median(frame.effective_attenuation[groups == k], axis=0) if (groups == k).any() else np.full(3, np.nan)
            for k in range(len(edges) - 1)
        ]
    )


def srgb(linear):
    """Linear values by the curve of sRGB, cut at 0 and 1."""
    x = np.clip(linear, 0.0, 1.0)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)


def draw_images(figure, views):
    """As seen, and corrected."""
    axes = figure.subplots(2, len(views))
    for (above, below), view in zip(axes.T, views, strict=True):
        for axis, image in ((above, view.frame.A_radiance), (below, view.corrected)):
            axis.imshow(srgb(0.9 * view.developed(image) / view.patches(view.developed(image)).max())[view.window])
            axis.set(xticks=[], yticks=[])
        above.set_title(f"{view.distance:.0f} m", fontsize=10)
    axes[0, 0].set_ylabel("as seen", fontsize=9)
    axes[1, 0].set_ylabel("direct / T", fontsize=9)


def draw_chromaticities(axis, views):
    """Lines of the patches, from the nearest view to the farthest."""
    seen = np.array([view.patches(view.frame.A_radiance) for view in views])
    r, g, _ = np.moveaxis(seen / seen.sum(axis=-1, keepdims=True), -1, 0)
    nearest = views[0].patches(views[0].developed(views[0].corrected))
    colours = srgb(nearest / nearest[WHITE].max())
    axis.plot(r, g, color="0.8", linewidth=0.7, zorder=1)
    for size, x, y in zip((48, 26, 14, 7), r, g, strict=False):
        axis.scatter(x, y, s=size, c=colours, edgecolors="0.3", linewidths=0.4, zorder=2)
    axis.set(xlabel="R / (R + G + B)", ylabel="G / (R + G + B)", title="patches as seen; smaller: farther")


def draw_attenuation(axis, frame, edges):
    """Of red, green and blue by distance."""
    for channel, colour, name in zip(by_distance(frame, edges).T, RGB, ("red", "green", "blue"), strict=True):
        axis.plot(0.5 * (edges[1:] + edges[:-1]), channel, color=colour, label=name)
    axis.set(xlabel="distance [m]", ylabel="-ln(T) / r [1/m]", ylim=(0.0, None), title="effective attenuation")
    axis.legend(fontsize=8, frameon=False)


def draw_locus(axis, frame, views, edges):
    """Green and blue over red."""
    of_water, near_far = by_distance(frame, edges), [*pairwise(views)]
    for channel, name in ((1, "green"), (2, "blue")):
        axis.plot(of_water[:, 0], of_water[:, channel], color=RGB[channel], label=f"{name}, all pixels")
        for size, (near, far) in zip((22, 12, 5), near_far, strict=False):
            found = of_patches(near, far)
            label = f"patches, {near.distance:.0f} to {far.distance:.0f} m" if channel == 1 else None
            axis.scatter(
                found[:, 0],
                found[:, channel],
                s=size,
                facecolors="none",
                edgecolors=RGB[channel],
                linewidths=0.6,
                label=label,
            )
    axis.set(xlabel="of red [1/m]", ylabel="of green, of blue [1/m]", title="space of attenuation coefficients")
    axis.legend(fontsize=7, frameon=False)


def draw(data, path):
    """The figure of a dataset."""
    views, frame = (
        chart_views(data),
        max((data[0, camera] for camera in data.cameras), key=lambda f: np.ptp(f.range[np.isfinite(f.range)])),
    )
    seen = frame.range[np.isfinite(frame.range)]
    edges = np.linspace(np.ceil(seen.min()), np.floor(np.quantile(seen, 0.99)), 40)
    figure = Figure(figsize=(10.5, 7.3), layout="constrained", dpi=100)
    images, plots = figure.subfigures(2, 1, height_ratios=(1.12, 1.0))
    draw_images(images, views)
    axes = plots.subplots(1, 3)
    draw_chromaticities(axes[0], views)
    draw_attenuation(axes[1], frame, edges)
    draw_locus(axes[2], frame, views, edges)
    for axis in axes:
        axis.title.set_fontsize(10)
        axis.tick_params(labelsize=8)
    figure.savefig(path)


def main(arguments=None):
    """Draw the figure, and print what it shows of white."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("dataset", help="A dataset of chart.yaml.")
    parser.add_argument("-o", "--output", default="chart.png", help="The figure.")
    options = parser.parse_args(arguments)
    try:
        data = vw.Dataset(options.dataset)
    except vw.InputError as error:
        parser.error(str(error))
    missing = [letter for letter in "ADT" if letter not in data.outputs]
    if missing or "direct" not in layers_of(data, data.frames[0], data.cameras[0]):
        parser.error(f"{options.dataset}: needs images A, D and T, and render.linear_exr with the layer direct")
    views = chart_views(data)
    if not views:
        parser.error(f"{options.dataset}: no camera sees all of a colour chart, its patches {LEAST_PX:g} pixels wide")
    for near, far in pairwise(views):
        print(
            f"white from {near.distance:.1f} to {far.distance:.1f} m: "
            + ", ".join(f"{value:.3f}" for value in of_patches(near, far)[WHITE])
            + " 1/m"
        )
    draw(data, options.output)
    return 0


if __name__ == "__main__":
    sys.exit(main())
