"""The course for the page: pictures from above and from the side, with the ground and what stands on it."""

import base64
import io
from dataclasses import dataclass, field

import numpy as np

from varos_warp.dataset.geometry import rebuilt
from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.errors import InputError
from varos_warp.scene.geometry.parts import Grown, Instances, Part

MARGIN_M = 12.0
"""How far the ground is drawn around the course."""
MOST_POINTS = 20_000
"""Vertices that stand for the ground and the objects."""

MOST_NUMBERS = 20
"""Waypoints that are numbered."""


@dataclass
class SceneParts:
    """The dataset's scene made anew."""

    parts: list[Part | Instances] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    """What looks wrong in the scene."""
    missing: str | None = None
    """The reason why there are no parts, in words."""


def scene_parts(data: Dataset) -> SceneParts:
    """The meshes that the dataset was rendered of; none where a file is not at hand, or is not the same any more."""
    from varos_warp.scene.checks import check_scene

    try:
        scene, parts = rebuilt(data)
    except InputError as error:
        return SceneParts(missing=error.message.rstrip("."))
    try:
        return SceneParts(parts, check_scene(scene, parts))
    except InputError as error:
        if scene.trajectory.file is None:
            return SceneParts(missing=error.message.rstrip("."))
        return SceneParts(parts)  # the file of a recorded course may be gone, the ground is not


def course_pictures(data: Dataset, scene: SceneParts) -> dict[str, str]:
    """base64 of PNG pictures of the course, by what they show; the side is the longer one."""
    course = data.poses("vehicle")[1][:, :3, 3] if "vehicle" in data.recorded else data.views()[1][:, :3, 3]
    points = ground_points(scene.parts, course)
    whole = data.meta["scene"]
    own = next((vehicle for vehicle in whole.get("vehicles") or () if vehicle["id"] == data.meta["vehicle"]), whole)
    stops = [stop["position"] for stop in own["trajectory"].get("waypoints") or own["trajectory"].get("poses") or ()]
    along = int(np.argmax(np.ptp(course[:, :2], axis=0)))
    return {
        "from above": _picture(course, points, stops, (0, 1)),
        "from the side": _picture(course, points, stops, (along, 2)),
    }


def ground_points(parts: list[Part | Instances], course: np.ndarray) -> np.ndarray:
    """Vertices [N, 3] of all parts near the course, some by chance; of copies, the places where they stand."""
    points = np.concatenate(
        [
            part.T_w_o[:, :3, 3] if isinstance(part, Instances) else part.vertices
            for part in parts
            if not isinstance(part, Grown)
        ]
        or [np.zeros((0, 3))]
    )
    low, high = course.min(axis=0)[:2] - MARGIN_M, course.max(axis=0)[:2] + MARGIN_M
    points = points[((points[:, :2] >= low) & (points[:, :2] <= high)).all(axis=1)]
    # every n-th vertex of a grid would draw stripes
    return np.random.default_rng(0).permutation(points)[:MOST_POINTS]


def _mark_waypoints(plot, places: np.ndarray) -> None:
    """Crosses over everything else at ``places`` [2, N], numbered where there is room for it."""
    from matplotlib.patheffects import withStroke

    edge = [withStroke(linewidth=3, foreground="white")]
    plot.plot(*places, "x", color="black", markersize=6, path_effects=edge, zorder=5, label="waypoints")
    for i, place in enumerate(places.T if places.shape[1] <= MOST_NUMBERS else ()):
        plot.annotate(str(i + 1), place, (5, 4), textcoords="offset points", fontsize=8, path_effects=edge, zorder=5)


def _picture(course: np.ndarray, points: np.ndarray, stops: list, axes: tuple[int, int]) -> str:
    """One view; ``axes``: which of x, y and z go to the right and up."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(4.6, 3.5), layout="constrained", dpi=180)
    plot = figure.subplots()
    order = np.argsort(points[:, 2])  # what is higher is seen from above
    plot.scatter(*points[order][:, axes].T, c=points[order, 2], cmap="cividis", s=9, linewidths=0, alpha=0.6)
    plot.plot(*course[:, axes].T, color="#d1495b", linewidth=1.6, label="course")
    for name, place, marker in (("start", course[0], "o"), ("end", course[-1], "s")):
        plot.plot(*place[list(axes)], marker, markersize=5, color="#d1495b", markeredgecolor="black", label=name)
    if stops:
        _mark_waypoints(plot, np.transpose(stops)[list(axes)])
    plot.set(xlabel=f"{'xyz'[axes[0]]} [m]", ylabel=f"{'xyz'[axes[1]]} [m]")
    plot.set_aspect("equal", adjustable="datalim")
    plot.ticklabel_format(useOffset=False, style="plain")
    plot.legend(fontsize=8, ncols=4, loc="lower center", bbox_to_anchor=(0.5, 1.0), frameon=False, columnspacing=1.2)
    data = io.BytesIO()
    figure.savefig(data, format="png")
    return base64.b64encode(data.getvalue()).decode()
