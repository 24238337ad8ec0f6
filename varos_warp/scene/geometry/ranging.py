"""How far rays go until they meet the terrain, an object or a copy: what the beams of a sonar measure."""

import numpy as np
from scipy.spatial import cKDTree

from varos_warp.scene.geometry.joining import join
from varos_warp.scene.geometry.parts import Instances, Moving, Part
from varos_warp.scene.geometry.surface import Surface


def ranges(parts: list[Part | Instances], points: np.ndarray, directions: np.ndarray, reach: float,
           T_w_o: dict[str, np.ndarray] | None = None) -> np.ndarray:
    """Distance [N] along rays to the first surface, float64 [m]; infinite where there is none within ``reach`` [m].

    Args:
        parts: Everything solid, from ``build_parts``.
        points: Where the rays start, float64 [N, 3] [m], world axes.
        directions: Unit vectors [N, 3].
        reach: [m]
        T_w_o: Pose [N, 4, 4] for each ray of what moves, by name; absent: where it begins.
    """
    return first_met(parts, points, directions, reach, T_w_o or {})[0]


def first_met(parts: list[Part | Instances], points: np.ndarray, directions: np.ndarray, reach: float,
              T_w_o: dict[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """The same, and which of ``T_w_o`` each ray meets, int [N]: its place there; -1: what stands still, or nothing."""
    single = [(part.vertices, part.faces) for part in parts if isinstance(part, Part) and part.name not in T_w_o]
    t = Surface(*join(single)).distances(points, directions) if single else np.full(len(points), np.inf)
    met, places = np.full(len(points), -1), {name: k for k, name in enumerate(T_w_o)}
    for group in parts:
        if group.name in T_w_o:
            there = _to_moving(group, points, directions, T_w_o[group.name])
            met[there < np.minimum(t, reach)] = places[group.name]
            t = np.minimum(t, there)
        if isinstance(group, Instances):
            there = _to_copies(group, points, directions, np.minimum(t, reach))
            met[there < t] = -1
            t = np.minimum(t, there)
    return np.where(t <= reach, t, np.inf), met


def _to_moving(part: Moving, points: np.ndarray, directions: np.ndarray, T_w_o: np.ndarray) -> np.ndarray:
    """Distance [N] along rays to an object at its pose for each of them [N, 4, 4]."""
    R_o_w = T_w_o[:, :3, :3].swapaxes(1, 2)
    start, d = (np.einsum("nij,nj->ni", R_o_w, x) for x in (points - T_w_o[:, :3, 3], directions))
    return Surface((part.vertices - part.origin) @ part.R_w_o, part.faces).distances(start, d)


def _to_copies(group: Instances, points: np.ndarray, directions: np.ndarray, reach: np.ndarray) -> np.ndarray:
    """Distance [N] along rays to the first of the copies, of which only those near to a ray's way [N] are looked at."""
    t, (ray, copy) = np.full(len(points), np.inf), _near(group, points, directions, reach)
    if len(ray):
        # directions are not normalised in the copy's axes, so that t stays in units of the world
        R = np.linalg.inv(group.T_w_o[copy, :3, :3])
        start, d = points[ray] - group.T_w_o[copy, :3, 3], directions[ray]
        found = Surface(group.vertices, group.faces).distances(*((R @ x[..., None])[..., 0] for x in (start, d)))
        np.minimum.at(t, ray, found)
    return t


def _near(group: Instances, points: np.ndarray, directions: np.ndarray, reach: np.ndarray
          ) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of a ray's and a copy's number where the ray's way passes the sphere about the copy."""
    if not len(group) or not len(points):
        return np.zeros(0, int), np.zeros(0, int)
    scale = np.cbrt(np.linalg.det(group.T_w_o[:, :3, :3]))
    radius = scale * np.linalg.norm(group.vertices, axis=1).max() * (1.0 + 1e-6)
    centre, half = group.T_w_o[:, :3, 3], 0.5 * reach
    found = cKDTree(centre).query_ball_point(points + half[:, None] * directions, half + radius.max())
    ray = np.repeat(np.arange(len(points)), [len(copies) for copies in found])
    copy = np.concatenate([*found, []]).astype(int)
    off = centre[copy] - points[ray]
    along = np.clip((off * directions[ray]).sum(axis=1), 0.0, reach[ray])
    passes = np.linalg.norm(off - along[:, None] * directions[ray], axis=1) <= radius[copy]
    return ray[passes], copy[passes]
