"""Warnings before rendering of what looks wrong in a scene but may be meant."""

from dataclasses import replace

import numpy as np
import trimesh
from scipy.spatial import cKDTree

from varos_warp.products.sensors.registry import mounted as sensors_on
from varos_warp.scene.angles import check_angles
from varos_warp.scene.band_checks import check_bands
from varos_warp.scene.camera_checks import GRID, check_cameras
from varos_warp.scene.description import Scene
from varos_warp.scene.description.image_types import DEPTH
from varos_warp.scene.description.recorded import FOR_WAYPOINTS
from varos_warp.scene.description.render import sees_water
from varos_warp.scene.description.surfaces import WORN, Layered
from varos_warp.scene.frames import camera_pose, transform
from varos_warp.scene.geometry.course import find_course, local_origin, places, standpoints, turns, used_stops
from varos_warp.scene.geometry.joining import join
from varos_warp.scene.geometry.parts import Grown, Instances, Moving, Part
from varos_warp.scene.geometry.query import clearance, heights_at, is_inside, ranges
from varos_warp.scene.hull import vehicle_radius
from varos_warp.scene.lights.distribution import distribution
from varos_warp.scene.optics.camera import camera_model
from varos_warp.scene.water import optical_properties

NEAREST = 16
"""Nearest places of a path that are tested for lying inside a part."""
MOST_STOPS = 50
"""Stops from which surfaces are looked for."""
MOST_POSES = 1000
"""Poses of a recorded course that are looked at one by one."""
OFF_THE_MAP_M = 10e3
"""Distance from surfaces beyond which one has coordinates of a map and the other has not."""
FARTHEST_MOUNT_M, FARTHEST_MOUNT = 5.0, 10.0
"""How far from the vehicle's origin something on it may be: metres, or radii of the vehicle if they are more."""


def check_scene(scene: Scene, parts: list[Part | Instances], path: tuple | None = None) -> list[str]:
    """Warnings, one sentence each, of things that look wrong.

    Args:
        scene: The scene.
        parts: Its geometry, from ``build_parts``.
        path: Where the vehicle is simulated to go, at steps of 5 cm or less, as ``path_samples`` gives it: time int64
            [N] [ns], position [N, 3] [m], the reference that it was asked to follow [N, 3] [m], and the waypoint that
            it heads for, int [N]. Absent: only the waypoints or poses are checked.
    """
    made = [f"{part.name}: {words}" for part in parts for words in part.doubts]
    # what grows is so small that nothing is in its way
    parts = [part.before or part for part in parts if not isinstance(part, Grown)]
    find_course(scene, parts)
    looked_at = _looked_at(scene)
    stops = places(scene.trajectory)[looked_at]
    poses = transform(turns(scene.trajectory)[looked_at].as_matrix(), stops)
    still = [part for part in parts if part.name not in scene.companions]  # which go their ways
    solids = _gather(scene, still, poses, path)
    at_stops, told = _check_stops(scene, solids, stops)
    on_the_way = [] if path is None else _check_path(scene, solids, path, told)
    found = [
        *made,
        *check_angles(scene),
        *_check_trajectory(scene.trajectory),
        *_check_wear(scene.materials),
        *_check_water(scene),
        *_check_sizes(scene, parts),
        *_check_reach(scene, parts),
        *_check_mounts(scene),
        *check_cameras(scene),
        *_check_exposure(scene),
        *_check_lights(scene, poses),
        *_check_inside(scene, solids, poses),
        *_check_carried_inside(scene, solids, poses),
        *_check_starts(parts),
        *_check_lamps_in_bodies(scene, parts),
        *at_stops,
        *_check_sight(scene, parts, poses),
        *check_bands(scene, parts, poses),
        *on_the_way,
    ]
    found.sort(key=lambda words: ": all " not in words)  # what spoils everything comes first
    return [scene.key_in_file(words) for words in found]


def _gather(scene, parts, poses, path):
    """The parts, and of every scatter the copies near to where vehicle and cameras go, as one part with its name."""
    fixed = [c.position for c in scene.vehicle.cameras if c.mount == "world"]
    points = np.vstack([poses[:, :3, 3], *fixed, *(() if path is None else path[1:3])])
    mounted = [*scene.vehicle.cameras, *scene.vehicle.lights]
    margin = vehicle_radius(scene) + max(np.linalg.norm(block.position) for block in mounted)
    tree, solids = cKDTree(points), []
    for part in parts:
        if isinstance(part, Part):
            solids.append(part)
            continue
        boxes = part.extents()
        close = tree.query(boxes.mean(axis=1))[0] <= margin + 0.5 * np.linalg.norm(np.diff(boxes, axis=1)[:, 0], axis=1)
        copies = part.some(close).parts()
        if copies:
            vertices, faces = join((copy.vertices, copy.faces) for copy in copies)
            solids.append(replace(copies[0], name=part.name, vertices=vertices, faces=faces))
    return solids


def _check_trajectory(trajectory):
    """Keys of waypoints beside exact poses."""
    if not trajectory.is_exact:
        return
    fields = type(trajectory).model_fields
    idle = [key for key in FOR_WAYPOINTS if getattr(trajectory, key) != fields[key].default]
    if idle:
        form = "poses" if trajectory.poses is not None else "file"
        yield f"trajectory.{idle[0]}: without effect beside {form}, which says when the vehicle is where" + (
            f"; so are {', '.join(idle[1:])}" if idle[1:] else ""
        )


def _check_wear(materials):
    """Wear of materials that have none."""
    for name, material in materials.items():
        if not isinstance(material, Layered) or {material.relief, material.steep} & WORN:
            continue
        if material.wear != Layered.model_fields["wear"].default:
            yield f"materials.{name}.wear: without effect on {material.relief}, which does not wear"


def looks_like_transmission(coefficients) -> bool:
    """Return whether three coefficients [1/m] look like transmissions over a metre, exp(-c), given by mistake.

    Water's transmission lies near 1 and rises from red to blue; its coefficients fall from red to blue, but in the
    murkiest types, where they exceed 1. So: all between 0.3 and 1, and rising. (Seen in the field: Jerlov I as
    (0.905, 0.961, 0.982), which as coefficients would make the clearest ocean the murkiest.)
    """
    c = np.asarray(coefficients, float)
    return bool(((c >= 0.3) & (c < 1.0)).all() and (np.diff(c) > 0.0).all())


def _check_water(scene):
    water = None if scene.is_spectral else optical_properties(scene)
    if water is None or not water.sigma_t.any():
        return
    for name, values in (("sigma_a", water.sigma_a), ("sigma_s + sigma_a", water.sigma_t)):
        if looks_like_transmission(values):
            given, meant = (", ".join(f"{v:.3g}" for v in row) for row in (values, -np.log(values)))
            yield (
                f"water: {name} = [{given}] looks like a transmission per metre, which falls as exp(-c); "
                f"as a coefficient that would be [{meant}] 1/m"
            )
            return
    best = np.log(10.0) / water.sigma_t[water.sigma_t > 0.0].min()
    if water.sigma_t.all() and best < 0.5:
        yield f"water: a tenth of the light is left after {best:.2g} m in the clearest channel: nothing will be seen"


def _check_sizes(scene, parts):
    """Sizes that no sea floor or man-made object has; a factor of 1000 suggests millimetres."""
    for part in parts:
        first = next(box.vertices for box in part.boxes())  # of a scatter, one of the copies
        size = float(np.ptp(first, axis=0).max())
        largest, smallest = (50e3, 1.0) if part.name == "terrain" else (100.0, 2e-3)
        if smallest <= size <= largest:
            continue
        only, unit, scale = ("only ", "kilometres", 1000) if size < smallest else ("", "millimetres", 0.001)
        given = _scale_of(scene, part.name)
        how = f"; if its file is in {unit}, give scale: {scale}"
        if given != 1.0:
            how = f" with scale: {given}; check scale; parts are in metres"
        yield f"{part.name}: {only}{size:.4g} m across{how}"


def _scale_of(scene, name):
    """Scale that the scene file gives a part; 1 of a vehicle's body."""
    kind, _, number = name.partition(".")
    if kind == "scatter":
        return scene.scatter[int(number)].object.scale
    return scene.terrain.scale if kind == "terrain" else scene.objects[int(number)].scale if kind == "objects" else 1.0


def _check_reach(scene, parts):
    """Courses so wide that the single precision of rays, finest in their middle, loses steps of D at their ends."""
    if not parts or DEPTH not in scene.render.outputs:
        return []
    reach = float(np.abs(standpoints(scene, parts) - local_origin(scene, parts)).max())
    near, far = scene.render.depth_range_m
    rounding, step = reach * 2.0**-24, (far - near) / 65535.0
    if rounding <= 0.5 * step:
        return []
    return [
        f"trajectory: goes {reach:.3g} m from its middle, where single precision rounds places by "
        f"{1e3 * rounding:.2g} mm, more than half a step of D ({1e3 * step:.2g} mm); divide it into several "
        f"scenes{_from_a_map(scene, reach)}"
    ]


def _from_a_map(scene, distance):
    """Keys for coordinates of a map, in brackets, where something lies as far away as only those do."""
    keys = [f"{name}.origin" for name in ("terrain", "trajectory") if getattr(getattr(scene, name), "file", None)]
    known = keys and distance > OFF_THE_MAP_M
    return f" ({' and '.join(keys)}: the place in a file's coordinates that becomes 0, 0, 0)" if known else ""


def _check_mounts(scene):
    """What would hang far outside of the vehicle: positions in millimetres."""
    vehicle = scene.vehicle
    reach = max(FARTHEST_MOUNT_M, FARTHEST_MOUNT * vehicle_radius(scene))
    mounted = {
        f"vehicle.cameras.{i} ({camera.id})": camera
        for i, camera in enumerate(vehicle.cameras)
        if camera.mount == "vehicle"
    }
    mounted |= {f"vehicle.lights.{i}": light for i, light in enumerate(vehicle.lights)}
    mounted |= {f"vehicle.{sensor.key}": block for sensor, block in sensors_on(vehicle)}
    for key, block in mounted.items():
        if (distance := np.linalg.norm(block.position)) > reach:
            example = next(abs(x) for x in block.position if x)
            yield (
                f"{key}: {distance:.3g} m from the vehicle's origin; positions are in metres "
                f"({example / 1000:g} for {example:g} mm)"
            )


def _check_exposure(scene):
    return [
        f"render.exposure.{name}: a gain of {value:g} makes the picture black or white"
        for name, value in scene.render.exposure
        if isinstance(value, float) and not 1e-4 <= value <= 1e4
    ]


def _check_lights(scene, poses):
    lights = scene.vehicle.lights
    if sees_water(scene.render.outputs) and not any(any(light.intensity) for light in scene.lights):
        yield "vehicle.lights: there is no light, so A will be black"
        return
    for i, light in enumerate(lights):
        distribution(light, scene)  # or an error tells what is wrong with its file
        if scene.water != "none" and any((T @ (*light.position, 1.0))[2] > scene.surface_depth_m for T in poses):
            yield (
                f"vehicle.lights.{i}: is above the sea surface (z = {scene.surface_depth_m:g} m) on the "
                "way; light and camera are taken to be in water everywhere"
            )
        if light.kind != "point" and light.direction[1] < 0.0:
            yield f"vehicle.lights.{i}: shines backwards (the vehicle's forward axis is +y)"


def _check_inside(scene, parts, poses):
    """Cameras within rock or objects, and above the surface."""
    for i, camera in enumerate(scene.vehicle.cameras):
        fixed = camera.mount == "world"
        points = np.array([camera_pose(camera, T)[:3, 3] for T in ([np.eye(4)] if fixed else poses)])
        found = [(_inside(part, points), _within(part), "") for part in parts]
        if scene.water != "none":
            found.append(
                (
                    points[:, 2] > scene.surface_depth_m,
                    f"above the sea surface (z = {scene.surface_depth_m:g} m)",
                    "; surface_depth_m is the depth of world z = 0",
                )
            )
        for wrong, what, remark in found:
            if wrong.any():
                where = "" if fixed else f" at {_which(scene, wrong)}"
                yield f"vehicle.cameras.{i} ({camera.id}): is {what}{where}{remark}"


def _check_carried_inside(scene, parts, poses):
    """Lamps and sensors in rock or objects, where the vehicle itself is not: that is told of by itself."""
    T_w_v = np.array(poses)
    carried = [
        (f"lights.{i}", light.position, "none of its light leaves it") for i, light in enumerate(scene.vehicle.lights)
    ]
    carried += [
        (sensor.key, block.position, "its beams meet the far side of that")
        for sensor, block in sensors_on(scene.vehicle)
        if sensor.needs_solids
    ]
    for part in parts:
        outside = ~_inside(part, T_w_v[:, :3, 3])
        for key, position, so in carried:
            wrong = outside & _inside(part, T_w_v[:, :3, :3] @ position + T_w_v[:, :3, 3])
            if wrong.any():
                yield f"vehicle.{key}: is {_within(part)} at {_which(scene, wrong)}, and {so}"


def _check_starts(parts):
    """What moves and begins in the ground or in something else, one warning for each; what lies on it may."""
    told = set()
    single = [part for part in parts if isinstance(part, Part)]
    for part in (part for part in single if isinstance(part, Moving)):
        middle = part.extents()[0].mean(axis=0)
        for other in single:
            if other is not part and (other.name, part.name) not in told and _inside(other, middle).any():
                told.add((part.name, other.name))
                yield (
                    f"{part.name}: the middle of it is {_within(other)} where it begins; nothing keeps "
                    "what moves out of other things (move its first stop)"
                )
                break


def _check_lamps_in_bodies(scene, parts):
    """Lights of other vehicles that their own bodies enclose."""
    bodies = {part.name: part for part in parts if part.name in scene.companions}
    for i, vehicle in enumerate(scene.vehicles or ()):
        if (body := bodies.get(vehicle.key)) is None or not vehicle.lights:
            continue
        within = _inside(body, np.array([light.position for light in vehicle.lights]) @ body.R_w_o.T + body.origin)
        yield from [
            f"vehicles.{i}.lights.{k}: is inside the body of its vehicle, so that no other vehicle sees its "
            "light (move it out, or make the body smaller)"
            for k in np.flatnonzero(within)
        ]


def _check_stops(scene, parts, stops):
    """Waypoints or poses under the terrain, or nearer to anything than the vehicle's radius, and where they are."""
    warnings, radius, touching = [], vehicle_radius(scene), np.zeros(len(stops), bool)
    for part in parts:
        under, distance = _inside(part, stops), _clearance(part, stops, radius)
        close = np.isfinite(distance) & ~under
        if under.any():
            height = f", whose height there is {_height(part, stops[under])}" if part.name == "terrain" else ""
            lost = "; nothing of it is seen from there: raise the course, or lower the terrain" if under.all() else ""
            warnings.append(f"trajectory: {_which(scene, under)} {_are(under)} {_within(part)}{height}{lost}")
        if close.any():
            warnings.append(
                f"trajectory: {_which(scene, close)} {_are(close)} nearer to {part.name} "
                f"than the vehicle's radius of {radius:.2f} m ({distance[close].min():.2f} m)"
            )
        touching |= under | close
    return warnings, stops[touching]


def _height(terrain, stops):
    """Height of the terrain over places, in words."""
    tops = [float(z[-1]) for z in heights_at(terrain.vertices, terrain.faces, stops[:, :2]) if len(z)]
    low, high = min(tops), max(tops)
    return f"{low:.2f} m" if high - low < 0.005 else f"{low:.2f} to {high:.2f} m"


def _check_sight(scene, parts, poses):
    """Cameras that have no surface in sight at most of the stops; where things move, one may come into it."""
    if not parts or scene.moving:
        return
    reach = scene.render.depth_range_m[1]
    boxes = np.concatenate([part.extents() for part in parts])
    chosen, numbers = np.unique(np.linspace(0, len(poses) - 1, MOST_STOPS).astype(int)), _looked_at(scene)
    for i, camera in enumerate(scene.vehicle.cameras):
        fixed = camera.mount == "world"
        T_w_c = camera_pose(camera, np.array([np.eye(4)] if fixed else [poses[stop] for stop in chosen]))
        blind = ~_sees(parts, boxes, camera, T_w_c, reach)
        if 2 * np.count_nonzero(blind) <= len(blind):
            continue
        first, low, high = T_w_c[int(np.argmax(blind))], boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)
        number, lost = numbers[chosen[np.argmax(blind)]], np.zeros(len(poses), bool)
        lost[chosen] = blind
        if blind.all():
            lost[:] = True
        where = "" if fixed else f" at {_which(scene, lost)}"
        yield (
            f"vehicle.cameras.{i} ({camera.id}): sees no surface within {reach:g} m (render.depth_range_m)"
            f"{where}: D holds nothing there, A little but water; "
            f"{'' if fixed else f'at {_stop(scene)} {number} '}it is at {_place(first[:3, 3])}, "
            f"terrain and objects from {_place(low)} to {_place(high)}; "
            f"{_towards(scene, boxes, first, reach, fixed)}"
        )


def _towards(scene, boxes, T_w_c, reach, fixed):
    """What brings things in boxes [N, 2, 3] into the sight of a camera: to go there, or to turn it."""
    beside = np.maximum(boxes[:, 0] - T_w_c[:3, 3], T_w_c[:3, 3] - boxes[:, 1]).clip(0.0)
    if (distance := np.linalg.norm(beside, axis=1).min()) > reach:
        of_course = f"move the course to them, or them to the course{_from_a_map(scene, distance)}"
        return "move the camera to them" if fixed else of_course
    more = "" if fixed else ", or look_at of the trajectory"
    return f"turn the camera towards them (its rotation_euler_deg{more})"


def _sees(parts, boxes, camera, T_w_c, reach):
    """Return whether a camera at poses [N, 4, 4] sees a surface: along some of its rays, or the middle of something."""
    model, (width, height) = camera_model(camera), camera.resolution
    x, y = ((np.arange(GRID) + 0.5) * side / GRID for side in (width, height))
    rays = model.rays(np.stack(np.meshgrid(x, y), -1).reshape(-1, 2))
    seen = rays.weight > 0.0
    R, start = T_w_c[:, None, :3, :3], T_w_c[:, None, :3, 3]
    origin = (R @ rays.origin[seen][..., None])[..., 0] + start
    along = (R @ rays.direction[seen][..., None])[..., 0]

    def meets(some, k):
        t = ranges(some, origin[k].reshape(-1, 3), along[k].reshape(-1, 3), reach)
        return np.isfinite(t).reshape(len(k), along.shape[1]).any(axis=1)

    copied = [part for part in parts if isinstance(part, Instances)]
    found = meets([part for part in parts if not isinstance(part, Instances)], np.arange(len(T_w_c)))
    middles = boxes.mean(axis=1)
    for k in np.flatnonzero(~found):
        points = (middles - T_w_c[k, :3, 3]) @ T_w_c[k, :3, :3]
        points = points[np.linalg.norm(points, axis=1) < reach]
        pixels = model.project(points)
        found[k] = ((pixels >= 0.0) & (pixels <= camera.resolution)).all(axis=1).any()
    blind = np.flatnonzero(~found)
    found[blind] = meets(copied, blind)  # last, for there are many
    return found


def _place(point):
    return f"({', '.join(f'{x:.4g}' for x in np.round(point, 3) + 0.0)})"


def _check_path(scene, parts, path, told):
    """Return warnings where the vehicle goes, or was asked to go, through a part or nearer to it than its radius.

    One warning per part, of the nearest place. A path that gets inside comes near the surface on its way, so only the
    nearest places are asked whether they are inside. Places next to stops in ``told`` [n, 3] are known already.
    """
    time_ns, position, reference, waypoint = path
    radius = vehicle_radius(scene)
    for part in parts:
        for points, what in ((position, "the vehicle goes"), (reference, "the course leads")):
            distance = _clearance(part, points, radius)
            distance[_runs_past(np.isfinite(distance), points, told, 2.0 * radius)] = np.inf
            if not np.isfinite(distance).any():
                continue
            order = np.argsort(distance, kind="stable")[: np.count_nonzero(np.isfinite(distance))]
            worst, nearest = order[0], order[:NEAREST]
            how = f"nearer to {part.name} than its radius of {radius:.2f} m ({distance[worst]:.2f} m)"
            if len(set(_inside(part, points[nearest]))) > 1:
                how = f"through {part.name}"
            yield (
                f"trajectory: on the way to {_stop(scene)} {waypoint[worst]}, at "
                f"{time_ns[worst] * 1e-9:.2f} s, {what} {how}"
            )
            break


def _runs_past(near, points, stops, reach):
    """Which places [N] belong to an unbroken run of ``near`` ones that comes within ``reach`` of a stop."""
    run = np.cumsum(np.diff(near, prepend=False))
    at_stop = np.zeros(len(points), bool)
    for stop in stops:
        at_stop |= near & (np.linalg.norm(points - stop, axis=1) < reach)
    return near & np.isin(run, run[at_stop])


def _inside(part, points):
    """Which points [N, 3], or [3], are under the terrain or inside a closed object, bool [N]."""
    found = is_inside(part.vertices, part.faces, points, part.extents()[0])
    if part.name == "terrain" or not found.any():
        return found
    return found & trimesh.Trimesh(part.vertices, part.faces, process=False).is_watertight


def _clearance(part, points, reach):
    """Distance [N] of points [N, 3] from a part [m]; infinite where it is not below ``reach``."""
    return clearance(part.vertices, part.faces, points, reach, part.extents()[0])


def _within(part):
    return "under the terrain" if part.name == "terrain" else f"inside {part.name}"


def _stop(scene):
    return "pose" if scene.trajectory.is_exact else "waypoint"


def _looked_at(scene):
    """Numbers of the stops that are looked at: all of a scene file; of a recorded course some, first and last too."""
    used = used_stops(scene.trajectory)
    if scene.trajectory.file is None or len(used) <= MOST_POSES:
        return used
    return used[np.linspace(0, len(used) - 1, MOST_POSES).astype(int)]


def _which(scene, chosen):
    """Stops in words, of bool [N]: waypoint 3; waypoints 0, 1 and 71 more; all 73 waypoints."""
    of, name = _looked_at(scene), _stop(scene)
    numbers, left_out = of[chosen], len(used_stops(scene.trajectory)) - len(of)
    among = f" of the {len(of)} that are looked at" * (left_out > 0)
    if len(numbers) == 1:
        return f"{name} {numbers[0]}{among}"
    if len(numbers) == len(chosen):
        return f"all {len(numbers)} {name}s{' that are looked at' * (left_out > 0)}"
    more = f" and {len(numbers) - 5} more" if len(numbers) > 5 else ""
    return f"{name}s {', '.join(map(str, numbers[:5]))}{more}{among}"


def _are(chosen):
    return "are" if np.count_nonzero(chosen) > 1 else "is"
