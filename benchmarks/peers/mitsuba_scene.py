"""A plain scene for Mitsuba 3: a dictionary of plugins, with meshes and light masks in files beside it.

What makes the two equal: radiometric units throughout; ``intensity`` is W/sr; a spot whose beam is as wide as its
cutoff has a hard edge; a box filter of one pixel; a depth of d means d - 1 events. The water is the camera's medium and
fills the world.
"""

import shutil
import tempfile
from pathlib import Path

import numpy as np

from benchmarks.peers.view import FOURNIER_FORAND, RAYLEIGH, PlainLight, PlainMesh, PlainScene, soft_edge
from varos_warp.errors import InputError

MASK_ERROR = 1e-4
"""Largest error of a baked soft edge, as a share of the intensity; sets the size of the mask."""
MASK_PIXELS = (64, 4096)
MASK_HALF_ANGLE = np.radians(80.0)
"""Widest cone with a soft edge: the mask is flat, and stretches without end towards 90 degrees."""


def write_mitsuba(plain: PlainScene, folder: Path, spp: int = 64, called: str | None = None) -> dict:
    """Dictionary for ``mitsuba.load_dict``; meshes (PLY) and light masks (EXR) are written into ``folder``.

    The dictionary calls it by its path, or as it is ``called``. Pixels that are not square, or a soft edge that no mask
    of 4096 pixels holds, are refused.
    """
    scene = {"type": "scene", "integrator": _integrator(plain), "sensor": _sensor(plain, spp)}
    called = str(folder) if called is None else called
    for i, mesh in enumerate(plain.meshes):
        name = f"mesh_{i}.ply"
        _write_mesh(mesh, folder / name)
        scene[f"mesh_{i}"] = _mesh(mesh, f"{called}/{name}")
    for i, light in enumerate(plain.lights):
        name = f"light_{i}.exr"
        if light.blend > 0.0:
            _write_mask(light, folder / name)
        scene[f"light_{i}"] = _light(light, f"{called}/{name}")
    return scene


def write_xml(plain: PlainScene, path: Path, spp: int) -> None:
    """A file that ``mitsuba`` opens, and beside it a folder ``<name>_files`` with what it refers to."""
    import mitsuba

    folder = path.with_name(f"{path.stem}_files")
    path.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=path.parent, prefix=".mitsuba-") as temp:
        whole, xml = Path(temp) / folder.name, Path(temp) / path.name
        whole.mkdir()
        scene = write_mitsuba(plain, whole, spp, called=folder.name)
        parser = mitsuba.parser
        parser.write_file(parser.parse_dict(parser.ParserConfig(mitsuba.variant()), scene), str(xml))
        shutil.rmtree(folder, ignore_errors=True)
        whole.rename(folder)
        xml.replace(path)


def _rgb(values):
    return {"type": "rgb", "value": [float(v) for v in values]}


def _transform(T):
    import mitsuba

    return mitsuba.ScalarTransform4f(np.asarray(T, float).tolist())


def _integrator(plain):
    """``volpath`` is NaN in channels without extinction; ``volpathmis`` also weights the channels' free paths."""
    depth = -1 if plain.max_events is None else plain.max_events + 1
    return {"type": "volpathmis" if plain.sigma_t.any() else "path", "max_depth": depth}


def _sensor(plain, spp):
    fx, fy = plain.focal
    if abs(fx / fy - 1.0) > 1e-6:
        raise InputError(
            "Mitsuba's pixels are square",
            key="cameras.sensor_mm",
            remedy="Give sensor_mm the proportions of the resolution.",
        )
    width, height = plain.resolution
    sensor = {
        "type": "thinlens" if plain.aperture > 0.0 else "perspective",
        "fov_axis": "x",
        "fov": float(2.0 * np.degrees(np.arctan(0.5 * width / fx))),
        "to_world": _transform(plain.T_w_c @ np.diag([-1.0, -1.0, 1.0, 1.0])),  # x left, y up, z forward
        "near_clip": 1e-3,
        "far_clip": 1e5,
        "film": {
            "type": "hdrfilm",
            "width": width,
            "height": height,
            "rfilter": {"type": "box"},
            "pixel_format": "rgb",
            "component_format": "float32",
        },
        "sampler": {"type": "independent", "sample_count": spp},
    }
    if plain.aperture > 0.0:
        sensor |= {"aperture_radius": float(plain.aperture), "focus_distance": float(plain.focus)}
    if plain.sigma_t.any():
        sensor["medium"] = _medium(plain)
    return sensor


def _medium(plain):
    albedo = np.divide(plain.sigma_s, plain.sigma_t, out=np.zeros(3), where=plain.sigma_t > 0.0)
    scale = max(1.0, float(plain.sigma_t.max()))  # an RGB triple is refused above 1
    return {
        "type": "homogeneous",
        "sigma_t": _rgb(plain.sigma_t / scale),
        "scale": scale,
        "albedo": _rgb(albedo),
        "phase": _phase(plain.lobes),
    }


def _phase(lobes):
    """One phase function, or the first blended with all the others."""
    weights = np.array([lobe.weight for lobe in lobes])
    if len(lobes) == 1:
        return _lobe(lobes[0])
    return {
        "type": "blendphase",
        "weight": float(weights[1:].sum() / weights.sum()),
        "first": _lobe(lobes[0]),
        "others": _phase(lobes[1:]),
    }


def _lobe(lobe):
    if lobe.kind == FOURNIER_FORAND:
        raise InputError(
            "Mitsuba has no Fournier-Forand, and its tables are even in the cosine: too coarse ahead",
            key="water.phase",
            remedy="Use Cycles, or Henyey-Greenstein, Rayleigh and mixtures of them.",
        )
    if lobe.kind == RAYLEIGH:
        return {"type": "rayleigh"}
    return {"type": "hg", "g": float(lobe.g)} if lobe.g else {"type": "isotropic"}


def _write_mesh(mesh: PlainMesh, path: Path):
    import trimesh  # more than half a second, which a scene without meshes needs not

    flat = mesh.normals is None
    mesh = mesh if flat else mesh.corners()
    normals = None if flat else mesh.normals.reshape(-1, 3)
    shape = trimesh.Trimesh(mesh.vertices, mesh.faces, vertex_normals=normals, process=False)
    shape.export(path, vertex_normal=not flat)


def _mesh(mesh: PlainMesh, file: str):
    """Without normals in the file Mitsuba would smooth over every edge, hence ``face_normals``."""
    bsdf = {"type": "twosided", "material": {"type": "diffuse", "reflectance": _rgb(mesh.reflectance)}}
    return {"type": "ply", "filename": file, "face_normals": mesh.normals is None, "bsdf": bsdf}


def _light(light: PlainLight, mask: str):
    if light.half_angle >= np.pi:
        return {"type": "point", "position": light.position.tolist(), "intensity": _rgb(light.intensity)}
    half = float(np.degrees(light.half_angle))
    spot = {
        "type": "spot",
        "to_world": _transform(_towards(light)),
        "cutoff_angle": half,
        "beam_width": half,
        "intensity": _rgb(light.intensity),
    }
    if light.blend > 0.0:
        spot["texture"] = {"type": "bitmap", "filename": mask, "raw": True, "wrap_mode": "clamp"}
    return spot


def _towards(light):
    """Pose [4, 4] whose z is the axis of the light."""
    z = light.axis
    x = np.cross(np.eye(3)[np.argmin(np.abs(z))], z)
    x /= np.linalg.norm(x)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = np.column_stack([x, np.cross(z, x), z]), light.position
    return T


def mask_pixels(half_angle: float, blend: float) -> int:
    """Side of the mask [pixels] at which its bilinear interpolation is right to ``MASK_ERROR``; 0 if none serves.

    Interpolation over a step h errs by h^2 f''/8; across the mask the tangent of the angle goes twice from 0 to the
    cone's.
    """
    tangent, step = np.linspace(0.0, np.tan(half_angle), 20_001), 1.0 / 20_000
    bend = np.abs(np.diff(soft_edge(np.cos(np.arctan(tangent)), half_angle, blend), 2)).max() / step**2
    pixels = max(2.0 * np.sqrt(bend / 8.0 / MASK_ERROR), MASK_PIXELS[0])
    return 2 ** int(np.ceil(np.log2(pixels))) if pixels <= MASK_PIXELS[1] else 0


def _write_mask(light, path):
    """The soft edge as a picture that the light throws, for Mitsuba's own edge is linear in the angle."""
    import mitsuba

    pixels = mask_pixels(light.half_angle, light.blend) if light.half_angle <= MASK_HALF_ANGLE else 0
    if not pixels:
        raise InputError(
            "Mitsuba cannot be given so wide a cone, or so narrow a soft edge",
            key="lights.blend",
            value=light.blend,
            remedy="Use blend 0, cones up to 160 degrees and blends above 0.03.",
        )
    at = (2.0 * np.arange(pixels) + 1.0) / pixels - 1.0
    tangent = np.tan(light.half_angle) * np.hypot(*np.meshgrid(at, at))
    share = soft_edge(1.0 / np.sqrt(1.0 + tangent**2), light.half_angle, light.blend)
    mitsuba.Bitmap(share[..., None].astype(np.float32)).write(str(path))
