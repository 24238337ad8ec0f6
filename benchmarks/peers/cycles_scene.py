"""A plain scene for Blender's Cycles, through ``bpy``.

What makes the two equal: a spot of radius 0 radiates energy / (4 pi) W/sr whatever its cone, and its soft edge is
ours; the water is the world's volume, with the same coefficients; flat faces, a box filter of one pixel, no clamping,
no tone mapping. A bound of n on Cycles' bounces is one of n + 1 events, because a connection to a light is no bounce.
"""

import tempfile
from pathlib import Path

import bpy
import numpy as np

from benchmarks.peers.view import FOURNIER_FORAND, HENYEY_GREENSTEIN, RAYLEIGH, PlainLight, PlainMesh, PlainScene
from varos_warp.errors import InputError

ALL_BOUNCES = 64
"""What stands for no bound: Cycles has no roulette to end paths in water that absorbs nothing."""
MOST_BOUNCES = 1024
"""Most bounces that Cycles can be asked for."""
LEAST_PIXELS = 4
NODE_PHASES = {HENYEY_GREENSTEIN: "HENYEY_GREENSTEIN", FOURNIER_FORAND: "FOURNIER_FORAND", RAYLEIGH: "RAYLEIGH"}
SENSOR_MM = 36.0
"""Width of Blender's sensor, whatever the camera's is: smaller ones than 1 mm would be enlarged without a word."""


def build_cycles(
    plain: PlainScene, *, spp: int = 64, seed: int = 0, threads: int | None = None, denoise: bool = False
) -> None:
    """Replace what Blender holds by this scene, ready for the CPU; refuses cones beyond a half space, tiny images."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    for mesh in plain.meshes:
        _add_mesh(mesh)
    for i, light in enumerate(plain.lights):
        _add_light(light, f"light_{i}")
    _set_water(plain)
    _set_camera(plain)
    _set_sampling(bpy.context.scene, plain, spp, seed, threads)
    _set_denoising(bpy.context.scene.cycles, denoise)


def render_exr(path: Path) -> None:
    """Render to an EXR of 32 bits, linear radiance."""
    bpy.context.scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)


def read_exr(path: Path) -> np.ndarray:
    """Float32 [H, W, 3], rows from the top."""
    image = bpy.data.images.load(str(path))
    image.colorspace_settings.name = "Non-Color"
    width, height = image.size
    pixels = np.empty(width * height * image.channels, np.float32)
    image.pixels.foreach_get(pixels)
    return pixels.reshape(height, width, -1)[::-1, :, :3].copy()


def write_blend(path: Path) -> None:
    """Save what Blender holds as a file that it opens."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=path.parent, prefix=".blend-") as temp:
        whole = Path(temp) / path.name
        bpy.ops.wm.save_as_mainfile(filepath=str(whole), compress=True)
        whole.replace(path)


def _link(name, data):
    thing = bpy.data.objects.new(name, data)
    bpy.context.scene.collection.objects.link(thing)
    return thing


def _add_mesh(mesh: PlainMesh):
    data = bpy.data.meshes.new(mesh.name)
    data.vertices.add(len(mesh.vertices))
    data.vertices.foreach_set("co", mesh.vertices.astype(np.float32).ravel())
    data.loops.add(mesh.faces.size)
    data.loops.foreach_set("vertex_index", mesh.faces.astype(np.int32).ravel())
    data.polygons.add(len(mesh.faces))
    data.polygons.foreach_set("loop_start", np.arange(0, mesh.faces.size, 3, dtype=np.int32))
    data.update(calc_edges=True)
    if mesh.normals is None:
        data.shade_flat()
    else:
        data.shade_smooth()
        data.normals_split_custom_set(mesh.normals.reshape(-1, 3).tolist())
    data.materials.append(_diffuse(mesh))
    _link(mesh.name, data)


def _diffuse(mesh):
    material = bpy.data.materials.new(mesh.name)
    material.use_nodes = True
    nodes = material.node_tree.nodes
    nodes.clear()
    bsdf, output = nodes.new("ShaderNodeBsdfDiffuse"), nodes.new("ShaderNodeOutputMaterial")
    bsdf.inputs["Color"].default_value = (*mesh.reflectance, 1.0)
    bsdf.inputs["Roughness"].default_value = 0.0
    material.node_tree.links.new(bsdf.outputs[0], output.inputs["Surface"])
    return material


def _add_light(light: PlainLight, name: str):
    everywhere = light.half_angle >= np.pi
    if not everywhere and light.half_angle > np.pi / 2:
        raise InputError(
            "Blender's cones are at most 180 degrees wide",
            key="lights.cone_deg",
            value=float(np.degrees(2 * light.half_angle)),
            remedy="Use 360, or up to 180.",
        )
    data = bpy.data.lights.new(name, "POINT" if everywhere else "SPOT")
    data.shadow_soft_size = 0.0
    strongest = float(light.intensity.max())
    data.energy = 4.0 * np.pi * strongest
    data.color = light.intensity / strongest if strongest > 0.0 else (0.0, 0.0, 0.0)
    if not everywhere:
        data.spot_size, data.spot_blend = 2.0 * light.half_angle, light.blend
    thing = _link(name, data)
    thing.rotation_mode = "QUATERNION"
    from mathutils import Vector

    thing.rotation_quaternion = Vector(light.axis).to_track_quat("-Z", "Y")
    thing.location = light.position


def _set_water(plain):
    """A black world, filled with the water."""
    world = bpy.data.worlds.new("water")
    bpy.context.scene.world = world
    world.use_nodes = True
    tree = world.node_tree
    tree.nodes.clear()
    output = tree.nodes.new("ShaderNodeOutputWorld")
    if plain.sigma_t.any():
        tree.links.new(_water_socket(tree, plain), output.inputs["Volume"])
    world.cycles.volume_sampling = "MULTIPLE_IMPORTANCE"  # EQUIANGULAR alone makes fireflies in world volumes


def _water_socket(tree, plain):
    """A volume for each lobe of the phase function, added up; the first absorbs for all."""
    total = None
    for lobe in plain.lobes:
        volume = tree.nodes.new("ShaderNodeVolumeCoefficients")
        volume.phase = NODE_PHASES[lobe.kind]
        volume.inputs["Absorption Coefficients"].default_value = tuple(plain.sigma_a * (total is None))
        volume.inputs["Scatter Coefficients"].default_value = tuple(lobe.weight * plain.sigma_s)
        if lobe.kind == HENYEY_GREENSTEIN:
            volume.inputs["Anisotropy"].default_value = lobe.g
        elif lobe.kind == FOURNIER_FORAND:
            volume.inputs["IOR"].default_value = lobe.n
            volume.inputs["Backscatter"].default_value = lobe.backscatter
        total = volume.outputs[0] if total is None else _added(tree, total, volume.outputs[0])
    return total


def _added(tree, first, second):
    both = tree.nodes.new("ShaderNodeAddShader")
    tree.links.new(first, both.inputs[0])
    tree.links.new(second, both.inputs[1])
    return both.outputs[0]


def _set_camera(plain):
    from mathutils import Matrix

    width, height = plain.resolution
    if min(width, height) < LEAST_PIXELS:
        raise InputError(
            "Blender's images are at least 4 pixels wide and high",
            key="cameras.resolution",
            value=plain.resolution,
            remedy="Ask for a larger image.",
        )
    data = bpy.data.cameras.new("camera")
    fx, fy = plain.focal
    data.sensor_fit, data.sensor_width = "HORIZONTAL", SENSOR_MM
    data.lens = SENSOR_MM * fx / width
    if not np.isclose(data.lens, SENSOR_MM * fx / width, rtol=1e-6):
        raise InputError("Blender has no lens of that angle", key="cameras.focal_mm", remedy="Use a narrower view.")
    data.clip_start, data.clip_end = 1e-4, 1e5  # what lies before the start has no water
    if plain.aperture > 0.0:
        data.dof.use_dof, data.dof.focus_distance = True, plain.focus
        data.dof.aperture_fstop = 1e-3 * data.lens / (2.0 * plain.aperture)
    thing = _link("camera", data)
    thing.matrix_world = Matrix((plain.T_w_c @ np.diag([1.0, -1.0, -1.0, 1.0])).tolist())  # x right, y up, z back
    render = bpy.context.scene.render
    render.resolution_x, render.resolution_y, render.resolution_percentage = width, height, 100
    render.pixel_aspect_x, render.pixel_aspect_y = max(fy / fx, 1.0), max(fx / fy, 1.0)
    bpy.context.scene.camera = thing


def _set_sampling(scene, plain, spp, seed, threads):
    render, cycles = scene.render, scene.cycles
    render.engine, cycles.device = "CYCLES", "CPU"
    render.use_persistent_data = True  # a second rendering starts without the work of the first
    if threads:
        render.threads_mode, render.threads = "FIXED", threads
    cycles.samples, cycles.seed = spp, seed
    bounces = ALL_BOUNCES if plain.max_events is None else min(plain.max_events - 1, MOST_BOUNCES)
    cycles.max_bounces = cycles.diffuse_bounces = cycles.volume_bounces = bounces
    cycles.use_adaptive_sampling = cycles.use_auto_tile = False
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = cycles.light_sampling_threshold = 0.0
    cycles.pixel_filter_type, cycles.filter_width = "BOX", 1.0
    scene.view_settings.view_transform = "Raw"
    settings = render.image_settings
    settings.file_format, settings.color_mode, settings.color_depth = "OPEN_EXR", "RGB", "32"
    render.film_transparent = False


def _set_denoising(cycles, denoise):
    """Open Image Denoise on colour alone, the paper's way (section 3.2.1)."""
    cycles.use_denoising = denoise
    if denoise:
        cycles.denoiser, cycles.denoising_input_passes = "OPENIMAGEDENOISE", "RGB"
