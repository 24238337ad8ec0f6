"""Marine snow over many seeds: the mean of what bodies add is what is taken out for them, in unlike scenes.

    python -m benchmarks.snow_truth [seeds] [words of names ...]

For each scene a line: the mean of S over that of E with its standard error, the largest |mean (S - E)| of the 8 x 8
blocks in standard errors and the skewness of that block over seeds, and how many blocks exceed 4. Rare bodies close by
make blocks skew: where they are missed, the mean and its estimated error are both too low. So in open water the errors
are those of Campbell's integral instead, of n g^2 over places and sizes, g the light of a body in the block; the line
has the ratio of sampled variances to it, and that of the integral of n g, in numpy, to E.
"""

import functools
import sys

import numpy as np
import warp as wp
from scipy import stats
from scipy.spatial.transform import Rotation

from varos_warp.kernels.particles.bodies import FARTHEST_GRAIN
from varos_warp.kernels.particles.floc import ROUND
from varos_warp.render.particles.cells import reach_of
from varos_warp.render.renderer import FrameRenderer
from varos_warp.scene.file.load import scene_from_dict
from varos_warp.scene.frames import transform
from varos_warp.scene.water.flocs import flocs
from varos_warp.scene.water.particles import particle_laws

FOURNIER_FORAND = {"kind": "fournier_forand", "n": 1.10, "mu": 3.5835}
CAMERA = {"id": "M0", "resolution": [64, 40], "sensor_mm": [8, 5], "focal_mm": 6}
FOCAL_PX = 48.0
LAMP = {
    "kind": "spot",
    "position": [0.5, 0, 0.2],
    "direction": [-0.1, 1, 0],
    "intensity": [100, 100, 100],
    "cone_deg": 90,
    "blend": 0.5,
}
FOUR = [
    LAMP | {"position": [x, 0, z], "direction": [-0.3 * x, 1, -0.6 * z], "cone_deg": 70}
    for x in (-0.5, 0.5)
    for z in (-0.3, 0.3)
]
TERRAIN = {
    "terrain": {"kind": "procedural", "size_m": 12, "resolution": 65, "relief_m": 0.3, "position": [0, 2, -0.8]},
    "scatter": [{"object": {"kind": "boulder", "diameter": 0.3, "seed": 2}, "count": 30, "circle": [0, 2, 1.5]}],
}
BOX = [
    {"kind": "concrete_block", "only": ["block"], "size_m": size, "position": position}
    for size, position in (
        ([4, 4, 0.4], [0, 0, -1.1]),
        ([4, 4, 0.4], [0, 0, 0.7]),
        ([0.6, 3.6, 1.8], [-1.3, 0, -0.9]),
        ([0.6, 3.6, 1.8], [1.3, 0, -0.9]),
        ([3.6, 0.6, 1.8], [0, 1.5, -0.9]),
        ([3.6, 0.6, 1.8], [0, -1.5, -0.9]),
    )
]
"""A closed room of 2 x 2.4 x 1.4 m around the vehicle."""
SHUTTER = {"time_s": 0.05}
SIDEWAYS = [0.5, 0.2, 0.1]
"""Velocity of a vehicle that moves [m/s]."""
N_WATER = {"temperature_C": 10, "salinity": 35}


def water(kind):
    return {"jerlov": {"type": kind, "phase": FOURNIER_FORAND}}


def scene(camera=None, lights=(LAMP,), kind="1C", share=0.005, **more):
    return scene_from_dict(
        {
            "water": water(kind),
            "particles": [{"share": share}],
            "vehicle": {"lights": list(lights), "cameras": [CAMERA | (camera or {})]},
            "trajectory": {"poses": [{"position": [0, 0, 0]}]},
        }
        | more
    )


SCENES = {
    **{
        f"{kind}, share {share}": ({"kind": kind, "share": share, "render": {"integrator": "path"}}, None)
        for kind in ("IB", "1C")
        for share in (0.002, 0.005, 0.013)
    },
    "terrain, four lamps": ({"lights": FOUR, "kind": "3C"} | TERRAIN, None),
    "closed box": ({"kind": "7C", "objects": BOX}, None),
    "world camera": ({"camera": {"mount": "world", "position": [0.6, 0.2, 0.3], "look_at": [0, 2, 0]}}, None),
    "lamp in view": (
        {"lights": [LAMP | {"position": [0.3, 1.2, 0.1], "direction": [-0.3, -0.2, 0], "cone_deg": 120}]},
        None,
    ),
    "moving, shutter": ({"camera": {"exposure": SHUTTER}}, SIDEWAYS),
    "forward, shutter": ({"camera": {"exposure": SHUTTER}}, [0.0, 0.5, 0.0]),
    "rolling": ({"camera": {"exposure": SHUTTER | {"readout_s": 0.05}}}, SIDEWAYS),
    "dome port": ({"camera": {"port": {"kind": "dome", "radius_m": 0.05}}}, None),
    "fisheye": ({"camera": {"focal_mm": 3, "distortion": {"model": "kannala_brandt", "k": [0.01, 0, 0, 0]}}}, None),
    "dispersion": ({"camera": {"n_water": N_WATER, "port": {"kind": "flat", "distance_m": 0.02}}}, None),
    "disk lamps": ({"lights": [LAMP | {"radius_m": 0.1}]}, None),
    "strobe": ({"lights": [LAMP | {"strobe": {"on_s": 0.005}}], "camera": {"exposure": SHUTTER}}, SIDEWAYS),
}


def moving(velocity, offset_ns):
    return transform(np.eye(3), np.multiply.outer(1e-9 * offset_ns, velocity))


def blocks(values):
    height, width = (n // 8 * 8 for n in values.shape[:2])
    return values[:height, :width].reshape(height // 8, 8, width // 8, 8, -1).mean((1, 3), dtype=float)


def layers(of_scene, velocity, seeds):
    """S and E of blocks, [seed, row, column, channel]; ``velocity`` is the vehicle's, None if it stands."""
    motion = None if velocity is None else functools.partial(moving, velocity)
    renderer = FrameRenderer(of_scene, "cpu")
    drawn, mean = [], []
    for seed in range(1000, 1000 + seeds):
        renderer.snow.scene = of_scene.model_copy(update={"seed": seed})
        n = renderer.render(np.eye(4), outputs="N", seed=seed, motion=motion).N
        drawn.append(blocks(n.light))
        mean.append(blocks((n.light - n.added) / n.passed[..., None]))
    return np.array(drawn), np.array(mean)


POINTS = 400_000
"""Bodies by which Campbell's integrals of a block are estimated."""
POINT = 1.55
"""Radius of an even disc whose second moments are those of a point's image [pixels]."""


def in_block(x, y, size, corner, rng):
    """Return whether two points of the image of each body, a floc of a size [pixels], lie in a block: bool [2, N]."""
    at, radius, share = flocs()
    shape = rng.integers(len(share), size=len(x))
    seen = Rotation.random(len(x), rng).as_matrix()[:, :2]
    loose = np.clip(size * np.linalg.norm(at, axis=-1).max(1)[shape] / ROUND - 1.0, 0.0, 1.0)
    found = []
    for _ in "12":
        grain = (share.cumsum(1)[shape] < rng.random(len(x))[:, None]).sum(1).clip(max=share.shape[1] - 1)
        off = (loose * size)[:, None] * np.einsum("nij,nj->ni", seen, at[shape, grain])
        disc = np.hypot(size * (1.0 + loose * (radius[shape, grain] - 1.0)), POINT)
        turn, r = 2.0 * np.pi * rng.random(len(x)), disc * np.sqrt(rng.random(len(x)))
        across, down = x + off[:, 0] + r * np.cos(turn), y + off[:, 1] + r * np.sin(turn)
        inside = (across >= corner[0]) & (across < corner[0] + 8)
        found.append(inside & (down >= corner[1]) & (down < corner[1] + 8))
    return np.array(found)


def light_of_bodies(law, p, d, t, r, area):
    """Sum over all pixels of the radiance of bodies [N, 3], lit by `LAMP`; all in float64."""
    way = p - LAMP["position"]
    distance, axis = np.linalg.norm(way, axis=1), np.array(LAMP["direction"], float)
    edge = np.cos(np.radians(LAMP["cone_deg"] / 2))
    s = np.clip((way @ axis / np.linalg.norm(axis) / distance - edge) / (LAMP["blend"] * (1.0 - edge)), 0.0, 1.0)
    least = law.block.least_px / FOCAL_PX
    drawn = np.clip((t - 0.05) / 0.05, 0, 1) * np.clip((r / (least * t) - 1) / 0.5, 0, 1)
    drawn *= np.clip(4 * (1 - t / reach_of(law)), 0, 1) * np.clip((distance - 0.05) / 0.05, 0, 1)
    phase = law.phase.eval(-np.einsum("ij,ij->i", way, d) / distance)
    sent = drawn * np.pi * r**2 * phase * s * s * (3 - 2 * s) / distance**2 / area
    return sent[:, None] * LAMP["intensity"] * law.albedo * np.exp(-law.water.sigma_t * (t + distance)[:, None])


def campbell(law, corner, rng):
    """Mean and variance [3] of a block's light, by drawing places and sizes of single bodies."""
    (r0, r1), reach, n = law.block.radius_m, reach_of(law), POINTS
    t, r = 0.05 * (reach / 0.05) ** rng.random(n), r0 * (r1 / r0) ** rng.random(n)
    beside = FARTHEST_GRAIN * FOCAL_PX * r / t * 1.3 + 3.0
    x, y = (c - beside + (8 + 2 * beside) * rng.random(n) for c in corner)
    d = np.stack([(x - 32) / FOCAL_PX, np.ones(n), (20 - y) / FOCAL_PX], -1)
    cos = 1.0 / np.linalg.norm(d, axis=1)
    d *= cos[:, None]
    area = t**2 * cos**3 / FOCAL_PX**2
    g = light_of_bodies(law, t[:, None] * d, d, t, r, area) / 64
    one, two = in_block(x, y, r / np.sqrt(area), corner, rng)
    weight = (
        law.density
        * r**-law.block.slope
        * area
        * (8 + 2 * beside) ** 2
        * t
        * np.log(reach / 0.05)
        * r
        * np.log(r1 / r0)
        / n
    )
    return (weight * one) @ g, (weight * (one & two)) @ g**2 * (1.0 + 0.3**2 / 2)


def campbell_of(of_scene):
    """Return moments by Campbell's theorem of all blocks [row, column, 3] of a scene of open water with one lamp."""
    law, rng = particle_laws(of_scene)[0], np.random.default_rng(1)
    made = [[campbell(law, (8 * col, 8 * row), rng) for col in range(8)] for row in range(5)]
    return np.moveaxis(np.array(made), 2, 0)


def line_of(drawn, mean, expected=None):
    """A line of the table; ``expected``: Campbell's mean and variance of the blocks."""
    seeds, off = len(drawn), drawn - mean
    variance, known = off.var(0, ddof=1), ""
    if expected is not None:
        known = (
            f"   mean of Campbell / E {expected[0].mean() / mean.mean():.4f}, variance sampled / Campbell "
            f"{np.median(variance / expected[1]):.3f} (median)"
        )
        variance = expected[1]
    z = off.mean(0) / np.maximum(np.sqrt(variance / seeds), 1e-30)
    worst = tuple(map(int, np.unravel_index(np.abs(z).argmax(), z.shape)))
    frames, total = drawn.mean((1, 2, 3)), mean.mean()
    return (
        f"{frames.mean() / total:7.4f} +- {frames.std(ddof=1) / np.sqrt(seeds) / total:.4f}   "
        f"z of frames {(off.mean((1, 2, 3)).mean() / off.mean((1, 2, 3)).std(ddof=1) * np.sqrt(seeds)):5.2f}   "
        f"largest {z[worst]:6.2f} at {worst}, skewness {stats.skew(off[(slice(None), *worst)]):5.2f}   "
        f"{(np.abs(z) > 4).sum()} of {z.size} beyond 4{known}"
    )


def main(arguments):
    wp.config.quiet = True
    seeds = int(arguments[0]) if arguments else 256
    for name, (how, velocity) in SCENES.items():
        if len(arguments) > 1 and not any(word in name for word in arguments[1:]):
            continue
        of_scene = scene(**how)
        expected = campbell_of(of_scene) if "share" in name else None
        print(f"{name:22s}", line_of(*layers(of_scene, velocity, seeds), expected), flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
