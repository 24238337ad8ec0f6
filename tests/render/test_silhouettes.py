"""Silhouettes: what would be seen of each thing if nothing else were there, by its number in S."""

import numpy as np
import pytest
from made_meshes import BOARD, Gltf, picture
from scipy.spatial.transform import Rotation

from varos_warp.render.renderer import FrameRenderer
from varos_warp.render.silhouettes import Silhouettes
from varos_warp.scene.file.load import scene_from_dict
from varos_warp.scene.frames import camera_pose, transform
from varos_warp.sim.companions import motions

STRAIGHT = {"id": "M0", "resolution": [96, 54]}
BENT = {
    "id": "M1",
    "resolution": [64, 36],
    "port": {"kind": "flat", "distance_m": 0.01},
    "distortion": {"model": "brown_conrady", "k": [-0.1, 0.02, 0, 0, 0]},
}


def scene(folder=".", **changes):
    return scene_from_dict(
        {
            "terrain": {"kind": "procedural", "size_m": 20, "resolution": 33, "position": [0, 5, -1.6]},
            "objects": [
                {"kind": "boulder", "position": [0.3, 4, 0]},
                {"kind": "pipe", "radius": 0.2, "length": 2, "position": [0, 3, 0]},
            ],
            "scatter": [
                {
                    "object": {"kind": "boulder", "diameter": 0.3},
                    "count": 40,
                    "area": [-3, 1, 3, 7],
                    "scale_range": [0.5, 2],
                }
            ],
            "growth": [
                {"on": ["objects.1", "scatter.0", "terrain"], "kind": "anemone", "per_m2": 10, "size_m": [0.1, 0.2]}
            ],
            "vehicle": {"cameras": [STRAIGHT, BENT]},
            "trajectory": {"poses": [{"position": [0, 0, 0]}]},
            **changes,
        },
        folder,
    )


def both(scene):
    renderer = FrameRenderer(scene, "cpu")
    numbers = {row["key"]: row["id"] for row in renderer.segments}
    return renderer, Silhouettes(scene, renderer.parts, numbers, renderer.world.origin, "cpu"), numbers


def poses(scene, time_ns=0):
    known = motions(scene)
    return lambda offset_ns: {key: course(time_ns + offset_ns) for key, course in known.items()}


@pytest.mark.parametrize("segments", ["coarse", "fine"])
def test_every_pixel_of_S_is_one_of_the_silhouette_from_any_view(segments):
    """Without exception: both ask the same ray about the same triangles. What grows is its host's, or has a number."""
    shown = scene(render={} if segments == "coarse" else {"segments": "fine"})
    renderer, silhouettes, numbers = both(shown)
    rng, hidden = np.random.default_rng(2), 0
    for camera in shown.vehicle.cameras:
        for _ in range(6):
            turn = Rotation.from_euler("xyz", rng.normal(0, [10, 10, 25]), degrees=True).as_matrix()
            T_w_v = transform(turn, rng.normal(0, 0.3, 3))
            S = renderer.render(T_w_v, camera, "S").S.instance.ravel()
            found = silhouettes.of(camera, camera_pose(camera, T_w_v), poses(shown))
            assert numbers["terrain"] not in found
            for number in np.setdiff1d(np.unique(S), [0, numbers["terrain"]]):
                seen = np.flatnonzero(S == number)
                assert np.isin(seen, found[number]).all()
                hidden += len(found[number]) - len(seen)
            assert all((np.diff(pixels) > 0).all() for pixels in found.values())
    assert hidden > 100  # or nothing hid anything
    assert (segments == "fine") == any(key.startswith("growth.") for key in numbers)


def test_a_thing_alone_in_its_scene_is_its_silhouette(monkeypatch):
    """S of a scene with nothing but one of the boulders; in the local world of both scenes."""
    from varos_warp.scene import device

    shown = scene()
    renderer, silhouettes, numbers = both(shown)
    monkeypatch.setattr(device, "local_origin", lambda *_: renderer.world.origin)
    for camera in shown.vehicle.cameras:
        found = silhouettes.of(camera, camera_pose(camera, np.eye(4)), poses(shown))
        alone = scene(terrain=None, objects=[shown.objects[0].model_dump()], scatter=[], growth=[])
        S = FrameRenderer(alone, "cpu").render(np.eye(4), camera, "S").S.instance
        np.testing.assert_array_equal(found[numbers["objects.0"]], np.flatnonzero(S))


def test_holes_of_masks_are_no_part_of_a_silhouette(tmp_path):
    """A net of 4 x 4 squares, every other a hole, that fills the view from behind a wall."""
    checker = np.indices((4, 4)).sum(axis=0) % 2 * 255
    pixels = np.concatenate([np.full((4, 4, 3), 188), checker[..., None]], axis=2)
    gltf = Gltf()
    gltf.mesh(BOARD, material=gltf.textured(picture(pixels), alphaMode="MASK"), attributes={"TEXCOORD_0": gltf.uv()})
    gltf.save(tmp_path / "net.glb")
    wall = Gltf()
    wall.mesh(BOARD)
    wall.save(tmp_path / "wall.glb")
    camera = {"resolution": [64, 64], "sensor_mm": [2.0, 2.0], "focal_mm": 2.0}
    shown = scene(
        tmp_path,
        terrain=None,
        scatter=[],
        growth=[],
        vehicle={"cameras": [camera]},
        objects=[
            {"file": "net.glb", "up": "y", "position": [0, 2, 0]},
            {"file": "wall.glb", "up": "y", "position": [0, 1, 0]},
        ],
    )
    renderer, silhouettes, numbers = both(shown)
    view = shown.vehicle.cameras[0]
    assert (renderer.render(np.eye(4), view, "S").S.instance == numbers["objects.1"]).all()
    mask = np.zeros(64 * 64, bool)
    mask[silhouettes.of(view, camera_pose(view, np.eye(4)), poses(shown))[numbers["objects.0"]]] = True
    inner = np.tile([False, *[True] * 14, False], 4)
    sure = inner[:, None] & inner[None]
    np.testing.assert_array_equal(mask.reshape(64, 64)[sure], (checker > 0).repeat(16, 0).repeat(16, 1)[sure])


def test_the_body_of_another_vehicle_is_where_it_is_at_the_frame_and_the_own_is_nowhere():
    def vehicle(name, y, speed):
        return {
            "id": name,
            "body": {"kind": "boulder", "diameter": 0.8},
            "cameras": [STRAIGHT],
            "trajectory": {"poses": [{"time_s": 0, "position": [0, y, 0]}, {"time_s": 2, "position": [speed, y, 0]}]},
        }

    shown = scene_from_dict(
        {
            "objects": [{"kind": "pipe", "radius": 0.3, "length": 2, "position": [0, 3, 0]}],
            "vehicles": [vehicle("0", 0, 0.0), vehicle("1", 6, 2.0)],
        }
    )
    renderer, silhouettes, numbers = both(shown)
    view, columns = shown.vehicle.cameras[0], []
    for time_ns in (500_000_000, 1_500_000_000):
        found = silhouettes.of(view, camera_pose(view, np.eye(4)), poses(shown, time_ns))
        S = renderer.render(np.eye(4), view, "S", time_ns=time_ns).S.instance.ravel()
        assert numbers["vehicles.0"] not in found
        whole = found[numbers["vehicles.1"]]
        assert np.isin(np.flatnonzero(S == numbers["vehicles.1"]), whole).all()
        columns.append((whole % 96).mean())
    assert columns[1] > columns[0] + 5
