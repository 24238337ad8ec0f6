"""A scene in device memory: meshes with their BVHs, copies, materials, lights and water, in a local float32 world."""

import copy
import itertools
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache, partial
from typing import NamedTuple

import numpy as np
import warp as wp

from varos_warp.device.devices import kind_of
from varos_warp.device.launch import in_threads
from varos_warp.kernels.spec import SceneSpec
from varos_warp.kernels.world.camera import Camera as CameraData
from varos_warp.kernels.world.intersect import Instance as InstanceData
from varos_warp.kernels.world.intersect import Masks, SceneData
from varos_warp.kernels.world.optics import HALVINGS, NEWTON_STEPS, Coefficients, Optics, OpticsSpec
from varos_warp.kernels.world.texture import Material
from varos_warp.scene.description import Scene
from varos_warp.scene.description.vehicle import Camera
from varos_warp.scene.frames import camera_pose, intrinsics, transform
from varos_warp.scene.geometry.course import local_origin
from varos_warp.scene.geometry.normals import face_normals, kept_corner_normals
from varos_warp.scene.geometry.parts import FaceSpectra, Grown, Instances, Moving, Part
from varos_warp.scene.lights.records import Lights
from varos_warp.scene.materials.lobe import has_lobe, lobe_albedo_table
from varos_warp.scene.materials.records import (
    corner_values,
    device_material,
    face_pages,
    features,
    foretold_features,
    tints_of,
)
from varos_warp.scene.materials.textures import Textures
from varos_warp.scene.numbers import numbered, part_names
from varos_warp.scene.optics.camera import camera_model
from varos_warp.scene.optics.ports import DomePort, FlatPort
from varos_warp.scene.passes import BandPass, as_kernels_know
from varos_warp.scene.water import medium_record, optical_properties

LEAF_SIZE = {"cpu": 8, "cuda": 2}
"""Triangles per BVH leaf, by kind of device: 10 % faster than 4 on a CPU; 6 % faster than 8 on a GPU."""
BUILDER = {"cpu": "sah", "cuda": "cubql"}
"""Who builds it, by kind of device: both trace alike (1 % on an H100), where Warp's own tree for a GPU takes 15 to 40 %
longer; cuBQL builds it on the GPU, and the millions of triangles of a survey need not go through a host's core."""
Poses = Callable[[np.ndarray], dict[str, np.ndarray]]
"""Poses T_w_o [N, 4, 4] of everything that moves but the vehicle, by key, at times int64 [N] [ns]."""
MOST_JOINED_FACES = {"cpu": 0, "cuda": 1 << 23}
"""Copies with no more triangles in all join the one mesh (2 GB at most). On a GPU, the stack of a query over copies
fills the memory close to the cores, and without it everything takes two thirds of the time; on a CPU, two levels are
faster."""


class KnownSpectra(NamedTuple):
    """Faces of a part, or of a group of copies, that are known by wavelength."""

    faces: slice
    """Their places in the arrays of all faces."""
    numbers: np.ndarray
    """Numbers of the part, or of all copies, among materials."""
    spectra: FaceSpectra


def foretold_spec(scene: Scene, device: str) -> SceneSpec:
    """What a `DeviceScene` will find present, by the scene file alone.

    Wrong where `foretold_features` is, or a mesh file has masks that cut holes, or so many copies are scattered or grow
    that they do not join the mesh on a GPU.
    """
    copies = bool(scene.scatter or scene.growth) and MOST_JOINED_FACES[kind_of(device)] == 0
    scatters = scene.is_spectral or bool(optical_properties(scene).sigma_s.any())
    return SceneSpec(
        medium=scatters,
        surfaces=bool(scene.terrain or scene.objects or scene.scatter or scene.moving),
        bands=scene.is_spectral,
        instances=copies or bool(scene.moving),
        **foretold_features(scene),
    )


def _whole_first(shapes: list) -> list:
    """The surfaces, with what masks may cut as surfaces of its own at the end."""
    divided = [
        some for shape in shapes for some in (shape.divided(_smooth_normals(shape)) if shape.has_holes else [shape])
    ]
    return sorted(divided, key=lambda shape: shape.has_holes)


def _id(mesh: wp.Mesh | None) -> int:
    """The handle of a mesh; 0 of none."""
    return 0 if mesh is None else mesh.id


def _smooth_normals(shape: Part | Instances) -> np.ndarray:
    """Normals of the corners [F, 3, 3], smoothed over edges that are not sharp."""
    if shape.normals is not None:
        return shape.normals
    return kept_corner_normals(shape.vertices, shape.faces, shape.smooth_angle)


def _without_holes(parts: list[Part]) -> int:
    """Number of the faces that no mask cuts, which come first."""
    return sum(len(part.faces) for part in parts if not part.has_holes)


class DeviceScene:
    """Owns everything that kernels read of a scene; ``data`` holds all but the lights (`lit`), and keeps it alive.

    World coordinates are float64 and may be far from zero; on the device everything is relative to ``origin``.

    Args:
        origin: Float64 [3]; absent: `local_origin`.
        joins_copies: Whether copies join the one mesh; absent: on a GPU, if they are few.
    """

    def __init__(
        self,
        scene: Scene,
        parts: list[Part | Instances],
        device: str,
        *,
        origin: np.ndarray | None = None,
        joins_copies: bool | None = None,
    ):
        scene = as_kernels_know(scene)
        self.scene, self.device = scene, device
        self.kind = kind_of(device)
        parts = [part.whole_first() for part in parts]
        self.origin = local_origin(scene, parts) if origin is None else origin
        self.water = optical_properties(scene)
        self.lights = Lights(scene, device)
        self.moving = [part for part in parts if isinstance(part, Moving)]
        self.part_names = part_names(scene, parts)
        """Names of all that S numbers, in the order of their numbers, which begin at 1."""
        self._numbers, self.segment_of = numbered(scene, parts, self.part_names)
        copied_faces = sum(len(group) * len(group.faces) for group in parts if isinstance(group, Instances))
        fit = copied_faces <= MOST_JOINED_FACES[self.kind]
        self.joins_copies = fit if joins_copies is None else joins_copies
        self.spec = SceneSpec(
            medium=bool(self.water.sigma_s.any()),
            surfaces=bool(parts),
            instances=not self.joins_copies or bool(self.moving),
            **features(parts),
            masks=any(part.has_holes for part in parts),
        )
        """What is present, for which kernels are compiled; of a camera's optics the images know."""
        self.data = SceneData()
        self.data.medium = medium_record(self.water, device)
        self.poses: Poses = lambda offset_ns: {}
        """Poses of everything that moves but the vehicle, while a shutter is open: known of a frame (`moved`) only."""
        self._spectra: list[KnownSpectra] = []
        if parts:
            self._upload_geometry(parts)

    def relit(self, scene: Scene, bands: BandPass | None = None) -> "DeviceScene":
        """Return the same terrain, objects and materials in the water and with the lights and cameras of another scene.

        Both share what is uploaded; the origin stays, and procedural images remain as fine as they are.
        ``bands`` tell what the channels of the other scene are, if they are bands of the spectrum.
        """
        other = self._copied()
        scene = as_kernels_know(scene)
        other.scene, other.water = scene, optical_properties(scene)
        other.spec = replace(self.spec, medium=bool(other.water.sigma_s.any()))
        other.lights = Lights(scene, self.device)
        other.data.medium = medium_record(other.water, self.device)
        if bands is not None:
            other.spec = replace(other.spec, bands=True)
            other._reflect_in(bands)
        return other

    def _reflect_in(self, bands: BandPass):
        """Reflectances in bands: what is known by wavelength as it is, all else by the colours of materials."""
        parts = len(self.data.materials) if self.spec.surfaces else 0
        to_bands = np.repeat(bands.to_bands[None].astype(np.float32), parts, axis=0)
        for known in self._spectra:
            to_bands[known.numbers] = np.eye(3)
        self.data.to_bands = self._array(to_bands, wp.mat33)
        if self._spectra:
            values = self.data.corner_values.numpy().reshape(-1, 3, 3).copy()
            for known in self._spectra:
                values[known.faces] = known.spectra.at(bands.wavelength_nm)[:, None]
            self.data.corner_values = self._array(values.reshape(-1, 3), wp.vec3)

    def moved(self, poses: Poses, offset_ns: np.ndarray) -> "DeviceScene":
        """The scene with what moves where it is at a frame; itself where nothing does.

        Args:
            offset_ns: All times but 0 that are asked for, int64 [N]: of these, `moving_at` may be rendered.
        """
        if not self.moving and not self.lights.carriers:
            return self
        other = self._copied()
        other.poses = poses
        if self.moving:
            other._place(other.poses_at(np.concatenate([np.zeros(1, np.int64), offset_ns])))
        return other

    def placed_as(self, other: "DeviceScene") -> "DeviceScene":
        """The scene with what moves where it is in another of the same geometry, which `moved` has made."""
        placed = self._copied()
        placed.poses = other.poses
        if self.moving:
            placed.instance_bvh, placed.data.instance_bvh = other.instance_bvh, other.data.instance_bvh
            placed.data.moving = other.data.moving
        return placed

    def _copied(self) -> "DeviceScene":
        """A copy of this scene that shares its arrays, with a record of its own."""
        other = copy.copy(self)
        other.data = SceneData()
        other.data.assign(self.data)
        return other

    def poses_at(self, offset_ns: np.ndarray) -> np.ndarray:
        """Poses T_w_o [N, M, 4, 4] of the meshes that move, in the order of ``moving``."""
        poses = self.poses(offset_ns)
        return np.stack([poses[part.name] for part in self.moving], axis=1)

    def carriers_at(self, offset_ns: np.ndarray) -> dict[str, np.ndarray]:
        """Poses [N, 4, 4] of the companions that carry lights, by key, at times from the frame's, int64 [N] [ns]."""
        return self.poses(offset_ns) if self.lights.carriers else {}

    def moving_at(self, offset_ns: np.ndarray) -> wp.array:
        """Records [N, M] of what moves at times from the frame's, int64 [N] [ns]."""
        if not self.moving:
            return wp.empty((len(offset_ns), 0), dtype=InstanceData, device=self.device)
        return self._array(self._placed(self.poses_at(offset_ns)), InstanceData)

    def _known_by_wavelength(
        self, shapes: list[Part | Instances], with_faces: list[Part | Instances]
    ) -> list[KnownSpectra]:
        """What reflects as it was measured, given shapes and what has their faces, one after another in arrays."""
        ends = np.cumsum([0] + [len(part.faces) for part in with_faces])
        return [
            KnownSpectra(slice(*ends[k : k + 2]), self._numbers[shape.first_name], part.skin.spectra)
            for k, (shape, part) in enumerate(zip(shapes, with_faces, strict=True))
            if part.skin is not None and part.skin.spectra is not None
        ]

    def _upload_geometry(self, parts: list[Part | Instances]):
        """The mesh of what stands still and those of instances, with arrays per face."""
        single = [part for part in parts if isinstance(part, Part)]
        copied = [part for part in parts if isinstance(part, Instances)]
        still = [part for part in single if not isinstance(part, Moving)]
        shapes = _whole_first([*still, *copied]) if self.joins_copies else [*_whole_first(still), *copied]
        once = [shape for shape in shapes if self.joins_copies or isinstance(shape, Part)]
        in_mesh = [shape if isinstance(shape, Part) else shape.joined() for shape in once]
        with_faces = [*(in_mesh if self.joins_copies else shapes), *self.moving]
        jobs = [  # which take about as long as each other
            partial(corner_values, with_faces),
            partial(self._upload_mesh, in_mesh),
            partial(self._upload_materials, single, copied),
            partial(self._upload_normals, [*shapes, *self.moving]),
        ]
        values, *_ = in_threads(lambda job: job(), jobs)
        face_part = [np.repeat(self._numbers[shape.first_name], len(shape.faces)) for shape in once]
        self.data.face_part = self._array(np.concatenate([np.zeros(0, np.int32), *face_part]), wp.int32)
        if self.spec.instances:
            self._upload_instances([] if self.joins_copies else copied, sum(map(len, face_part)))
        self.data.corner_values = self._array(values, wp.vec3)
        self._spectra = self._known_by_wavelength([*shapes, *self.moving], with_faces)
        face_tint, tints = tints_of(with_faces)
        self.data.face_tint, self.data.corner_tints = self._array(face_tint, wp.int32), self._array(tints, wp.vec4)
        self.data.face_page = self._array(face_pages(with_faces), wp.int32)
        if self.spec.masks:
            self._upload_masks(_without_holes(in_mesh))

    def _upload_masks(self, first_cut_face: int):
        """What functions of masks read, once all arrays are there."""
        record = Masks()
        record.first_cut_face = first_cut_face
        for name in ("face_part", "materials", "corner_values", "face_tint", "corner_tints", "face_page"):
            setattr(record, name, getattr(self.data, name))
        self.data.masks = self._array([record], Masks)

    def _upload_mesh(self, parts: list[Part]):
        """One mesh of several parts, if there are any."""
        if not parts:
            return
        starts = np.cumsum([0] + [len(part.vertices) for part in parts])
        vertices = np.concatenate([part.vertices for part in parts]) - self.origin
        faces = np.concatenate([part.faces + start for part, start in zip(parts, starts, strict=False)])
        self.mesh, self.whole = self._meshes(vertices, faces, _without_holes(parts))
        self.data.mesh, self.data.whole = _id(self.mesh), _id(self.whole)

    def _upload_materials(self, single: list[Part], copied: list[Instances]):
        # by their boxes, joined or not, so that a copy looks the same on every device
        boxes = [box for group in copied if not isinstance(group, Grown) for box in group.boxes()]
        order = {name: number for number, name in enumerate(self.part_names)}
        placed = [*single, *sorted(boxes, key=lambda box: order[box.name])]
        self.textures = Textures(self.scene, self.device)
        # of what moves, patterns are in the axes of its mesh
        origins = [part.origin if isinstance(part, Moving) else self.origin for part in placed]
        materials = [
            device_material(part, self.scene, np.asarray(origin), self.textures)
            for part, origin in zip(placed, origins, strict=True)
        ]
        if own := self.scene.own_body:
            materials.insert(self.part_names.index(own), Material())
        which = list(range(len(materials)))
        for group in (group for group in copied if isinstance(group, Grown)):  # colours alone: one for all its copies
            first = group.some(slice(1)).boxes()[0]
            which += [len(materials)] * len(np.unique(self._numbers[group.first_name]))
            materials.append(device_material(first, self.scene, self.origin, self.textures))
        on_host = wp.array(materials, dtype=Material, device="cpu").numpy()
        self.data.materials = self._array(on_host[which], Material)
        if any(has_lobe(part.material) for part in [*single, *copied]):
            self.data.lobe_albedo = self._array(lobe_albedo_table(), float)

    def _array(self, values, dtype) -> wp.array:
        return wp.array(values, dtype=dtype, device=self.device)

    def _meshes(self, vertices: np.ndarray, faces: np.ndarray, whole: int) -> tuple[wp.Mesh, wp.Mesh | None]:
        """A mesh, and one of its first faces, ``whole`` in number, if masks may cut the others."""
        apart = self._mesh(vertices, faces[:whole]) if 0 < whole < len(faces) else None
        return self._mesh(vertices, faces), apart

    def _mesh(self, vertices: np.ndarray, faces: np.ndarray) -> wp.Mesh:
        return wp.Mesh(
            points=self._array(vertices.astype(np.float32), wp.vec3),
            bvh_constructor=BUILDER[self.kind],
            indices=self._array(faces.ravel().astype(np.int32), wp.int32),
            bvh_leaf_size=LEAF_SIZE[self.kind],
        )

    def _upload_instances(self, groups: list[Instances], first_face: int):
        """The meshes of what stands there many times or moves, a record for each, and boxes around the copies."""
        in_own_axes = [part.vertices - part.origin for part in self.moving]
        self.instanced_meshes = [
            self._meshes(vertices, shape.faces, shape.whole_faces)
            for vertices, shape in zip(
                [*(group.vertices for group in groups), *in_own_axes], [*groups, *self.moving], strict=True
            )
        ]
        unplaced = []
        for shape, mesh in zip([*groups, *self.moving], self.instanced_meshes, strict=True):
            record = InstanceData()
            record.mesh, record.whole = (_id(each) for each in mesh)
            record.first_face, record.part, record.scale = first_face, int(self._numbers[shape.first_name][0]), 1.0
            unplaced.append(record)
            first_face += len(shape.faces)
        blank = wp.array(unplaced, dtype=InstanceData, device="cpu").numpy()
        self.data.instances = self._array(self._copies(groups, blank[: len(groups)]), InstanceData)
        self.copy_boxes = np.concatenate([np.zeros((0, 2, 3)), *(group.extents() - self.origin for group in groups)])
        self._unplaced = blank[len(groups) :]
        self._place(np.array([transform(part.R_w_o, part.origin) for part in self.moving]).reshape(1, -1, 4, 4))

    def _copies(self, groups: list[Instances], unplaced: np.ndarray) -> np.ndarray:
        """Records of all copies of groups, given one of each that is not placed yet."""
        records, start = np.repeat(unplaced, [len(group) for group in groups]), 0
        for group in groups:
            own = records[start : start + len(group)]
            scale = group.scale
            own["part"], own["scale"] = self._numbers[group.first_name], scale
            own["R"], own["p"] = group.T_w_o[:, :3, :3] / scale[:, None, None], group.T_w_o[:, :3, 3] - self.origin
            start += len(group)
        return records

    def _turned(self, T_w_o: np.ndarray) -> np.ndarray:
        """Rotations [N, M, 3, 3] of the meshes of what moves, whose axes are the world's where it begins."""
        return T_w_o[..., :3, :3] @ np.array([part.R_w_o.T for part in self.moving]).reshape(-1, 3, 3)

    def _placed(self, T_w_o: np.ndarray) -> np.ndarray:
        """Records [N, M] of what moves for its poses [N, M, 4, 4]."""
        records = np.repeat(self._unplaced[None], len(T_w_o), axis=0)
        records["R"], records["p"] = self._turned(T_w_o), T_w_o[..., :3, 3] - self.origin
        return records

    def _place(self, T_w_o: np.ndarray):
        """What moves where the first of its poses [N, M, 4, 4] has it, and a BVH over where all of them have it."""
        boxes = [self.copy_boxes]
        for k, part in enumerate(self.moving):
            corners = part.boxes()[0].vertices - part.origin
            extent = np.stack([corners.min(axis=0), corners.max(axis=0)])
            corners = np.array(list(itertools.product(*extent.T)))
            there = corners @ self._turned(T_w_o)[:, k].swapaxes(1, 2) + T_w_o[:, k, None, :3, 3] - self.origin
            boxes.insert(k, np.stack([there.min(axis=(0, 1)), there.max(axis=(0, 1))])[None])
        low, high = np.moveaxis(np.concatenate(boxes), 1, 0)
        margin = 1e-6 * (1.0 + max(np.abs(low).max(), np.abs(high).max()))  # the rounding of float32, on the safe side
        self.instance_bvh = wp.Bvh(
            self._array((low - margin).astype(np.float32), wp.vec3),
            self._array((high + margin).astype(np.float32), wp.vec3),
            constructor="sah",
            leaf_size=1,
        )
        self.data.instance_bvh = self.instance_bvh.id
        self.data.moving = self._array(self._placed(T_w_o[:1])[0], InstanceData)

    def _upload_normals(self, parts: list[Part | Instances]):
        smooth = [_smooth_normals(part) for part in parts]
        self.data.smooth_normals = self._per_corner(parts, smooth)
        if any(part.smooth_shading for part in parts):
            lit = [
                normals if part.smooth_shading else np.repeat(face_normals(part.vertices, part.faces)[:, None], 3, 1)
                for part, normals in zip(parts, smooth, strict=True)
            ]
            self.data.shading_normals, self.data.has_shading_normals = self._per_corner(parts, lit), 1

    def _per_corner(self, parts: list[Part | Instances], normals: list[np.ndarray]) -> wp.array:
        """Normals [F, 3, 3] of each part as one array; of copies that join the mesh, turned with each of them."""
        turned = []
        for part, own in zip(parts, normals, strict=True):
            flat = own.reshape(-1, 3).astype(np.float32, copy=False)
            if isinstance(part, Part) or not self.joins_copies:
                turned.append(flat)
            else:
                R_w_o = part.T_w_o[:, :3, :3] / part.scale[:, None, None]
                turned += [flat @ R.T for R in R_w_o.astype(np.float32)]
        return self._array(np.concatenate(turned), wp.vec3)

    def lit(self, T_w_v: np.ndarray) -> SceneData:
        """The scene for kernels, with the vehicle's lights where a pose of the vehicle has them."""
        scene = self._copied().data
        scene.lights = self.lights.at(T_w_v, self.origin, self.carriers_at(np.zeros(1, np.int64)))
        return scene

    def camera(self, camera: Camera, T_w_v: np.ndarray, *, pinhole: bool = False) -> CameraData:
        """Camera record for a pose of the vehicle; ``pinhole`` leaves out the depth of field."""
        return camera_record(camera, T_w_v, self.origin, pinhole=pinhole)


def camera_record(camera: Camera, T_w_v: np.ndarray, origin, *, pinhole: bool = False) -> CameraData:
    """A camera for a pose of the vehicle, relative to ``origin``; ``pinhole`` leaves out the depth of field."""
    T_w_c, K = camera_pose(camera, T_w_v), intrinsics(camera)
    record = CameraData()
    record.position = wp.vec3(*(T_w_c[:3, 3] - origin))
    record.right, record.down, record.forward = (wp.vec3(*T_w_c[:3, axis]) for axis in range(3))
    record.fx, record.fy, record.cx, record.cy = K[0, 0], K[1, 1], K[0, 2], K[1, 2]
    record.pixel_angle = 1.0 / K[0, 0]
    open_lens = camera.f_stop > 0.0 and not pinhole
    record.aperture = 0.5e-3 * camera.focal_mm / camera.f_stop if open_lens else 0.0
    record.focus = camera.focus_m if open_lens else 1.0
    if optics_spec(camera).bends:
        record.optics = optics_record(camera)
        record.pixel_angle = camera_model(camera).pixel_angle
    return record


def camera_records(camera: Camera, T_w_v: np.ndarray, origin, device: str, *, pinhole: bool = False) -> wp.array:
    """`camera_record` for poses [N, 4, 4] of the vehicle, as an array on a device."""
    record = wp.array([camera_record(camera, T_w_v[0], origin, pinhole=pinhole)], dtype=CameraData, device="cpu")
    records = np.repeat(record.numpy(), len(T_w_v))
    T_w_c = camera_pose(camera, T_w_v)
    records["position"] = T_w_c[:, :3, 3] - origin
    for axis, name in enumerate(("right", "down", "forward")):
        records[name] = T_w_c[:, :3, axis]
    return wp.array(records, dtype=CameraData, device=device)


@lru_cache(maxsize=64)
def optics_spec(camera: Camera) -> OpticsSpec:
    """What kernels are compiled for, to see through a camera."""
    if camera.distortion is None and camera.port is None:
        return OpticsSpec()
    model = camera_model(camera)
    ends = model.lens_ends_within(*camera.resolution) or not model.lens_settles(
        *camera.resolution, HALVINGS, NEWTON_STEPS
    )
    spec = OpticsSpec(model.lens.model, ends=ends)
    if model.port is None:
        return spec
    return replace(spec, port=camera.port.kind, dispersion=len(set(model.n_water)) > 1, rim=model.port.has_rim)


def optics_record(camera: Camera) -> Optics:
    """Lens and port of a camera."""
    model, record = camera_model(camera), Optics()
    if camera.distortion is not None:
        record.k = Coefficients(*model.lens.k, *[0.0] * (Coefficients._length_ - len(model.lens.k)))
        reach = model.lens_reach(*camera.resolution)
        record.reach = min(reach, model.lens.limit) if optics_spec(camera).ends else reach  # which holds steps back
    if isinstance(model.port, FlatPort):
        record.axis, record.distance = wp.vec3(*model.port.normal), model.port.distance_m
    if isinstance(model.port, DomePort):
        record.axis, record.distance = wp.vec3(*model.port.centre), model.port.radius_m - model.port.thickness_m
    if model.port is not None:
        record.thickness, record.n_glass = model.port.thickness_m, model.port.n_glass
        if model.port.has_rim:
            record.rim = model.port.clear_radius_m if isinstance(model.port, FlatPort) else model.port.rim_cosine
    record.n_water = wp.vec3(*model.n_water)
    return record
