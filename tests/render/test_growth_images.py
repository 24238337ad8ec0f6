"""Growth in images: S has hosts or copies, D and C those of its triangles, joined with the mesh or not."""

import numpy as np
import pytest

from varos_warp.render.renderer import FrameRenderer
from varos_warp.scene import device
from varos_warp.scene.file.load import scene_from_dict
from varos_warp.scene.frames import camera_pose

CAMERA = {"id": "M0", "resolution": [96, 64], "sensor_mm": [4.8, 3.2], "focal_mm": 4.8}
BLOCKS = [
    {"on": ["objects.0", "scatter.0"], "kind": "barnacle", "per_m2": 80, "size_m": [0.08, 0.2], "cluster": 3},
    {"on": ["terrain"], "kind": "starfish", "per_m2": 2, "size_m": [0.3, 0.5]},
]
AT = np.eye(4)
AT[2, 3] = 1.2


def scene(segments="host", growth=BLOCKS, **more):
    return scene_from_dict(
        {
            "terrain": {"kind": "procedural", "size_m": 20, "resolution": 21, "relief_m": 0.2, "feature_m": 6},
            "objects": [{"kind": "boulder", "diameter": 1.2, "position": [0, 2.5, 0.7], "chord_error_m": 0.01}],
            "scatter": [
                {
                    "object": {"kind": "boulder", "diameter": 0.4, "chord_error_m": 0.01},
                    "count": 12,
                    "shapes": 3,
                    "area": [-2, 1, 2, 5],
                }
            ],
            "growth": growth,
            "vehicle": {"cameras": [CAMERA]},
            "trajectory": {"poses": [{"position": [0, 0, 1.2]}]},
            "render": {"outputs": ["C", "D", "S"], "segments": segments},
            **more,
        }
    )


def images(of, **options):
    renderer = FrameRenderer(of, "cpu", **options)
    return renderer, renderer.render(AT, outputs="CDS")


@pytest.fixture(scope="module")
def host():
    return images(scene())


@pytest.fixture(scope="module")
def fine():
    return images(scene("fine"))


def test_s_has_the_numbers_of_hosts(host):
    """Where it lies before what is seen without it, S says one of what it grows on; elsewhere, what it said."""
    renderer, seen = host
    bare_renderer, bare = images(scene(growth=[]))
    assert renderer.segments == bare_renderer.segments
    assert not any(row["key"].startswith("growth") for row in renderer.segments)
    nearer = seen.D.depth < bare.D.depth - 1e-4
    assert np.count_nonzero(nearer) > 300
    carrying = {row["id"] for row in renderer.segments}
    assert set(np.unique(seen.S.instance[nearer])) <= carrying
    beyond = nearer & (seen.S.instance != bare.S.instance)
    assert np.count_nonzero(beyond) < 0.5 * np.count_nonzero(nearer)  # only where it stands over its host's outline
    np.testing.assert_array_equal(seen.S.instance[~nearer], bare.S.instance[~nearer])


def test_fine_s_names_each_copy(host, fine):
    renderer, seen = fine
    names = {row["id"]: row["key"] for row in renderer.segments}
    parts = {
        name: (T[:3, 3], size, group.hosts[k])
        for group in renderer.parts
        if group.name.startswith("growth")
        for name, T, size, k in zip(group.names, group.T_w_o, group.scale, group.host, strict=True)
    }
    assert sorted(parts) == sorted(name for name in names.values() if name.startswith("growth"))
    T_w_c = camera_pose(renderer.scene.vehicle.cameras[0], AT)
    rows, cols = np.nonzero(np.vectorize(lambda n: n in names and names[n].startswith("growth"))(seen.S.instance))
    assert len(rows) > 300
    on_host = np.array(
        [
            next(row["id"] for row in renderer.segments if row["key"] == parts[names[n]][2])
            for n in seen.S.instance[rows, cols]
        ]
    )
    np.testing.assert_array_equal(host[1].S.instance[rows, cols], on_host)
    for row, col in zip(rows[::7], cols[::7], strict=True):
        z = seen.D.depth[row, col]
        place = T_w_c @ [(col + 0.5 - 48) / 96 * z, (row + 0.5 - 32) / 96 * z, z, 1.0]
        root, size, _ = parts[names[seen.S.instance[row, col]]]
        assert np.linalg.norm(place[:3] - root) < size


def test_d_and_c_do_not_depend_on_the_numbers(host, fine):
    np.testing.assert_array_equal(host[1].D.depth, fine[1].D.depth)
    np.testing.assert_array_equal(host[1].C.normal, fine[1].C.normal)


@pytest.mark.parametrize("segments", ["host", "fine"])
def test_copies_that_join_the_mesh_look_the_same(host, fine, segments, monkeypatch):
    monkeypatch.setitem(device.MOST_JOINED_FACES, "cpu", 1 << 30)
    renderer, joined = images(scene(segments))
    assert renderer.world.joins_copies
    apart = {"host": host, "fine": fine}[segments][1]
    agree = np.isclose(joined.D.depth, apart.D.depth, 0.0, 1e-5)
    assert agree.mean() > 0.999  # of edges, rounding decides
    np.testing.assert_array_equal(joined.S.instance[agree], apart.S.instance[agree])


def test_copies_have_their_colours_joined_or_not(host, monkeypatch):
    """B from the same random numbers, but where rounding leads a path elsewhere."""
    apart = host[0].render(AT, outputs="B", spp_b=4, denoise_b="none").B.radiance
    monkeypatch.setitem(device.MOST_JOINED_FACES, "cpu", 1 << 30)
    joined = images(scene())[0].render(AT, outputs="B", spp_b=4, denoise_b="none").B.radiance
    bare = images(scene(growth=[]))[0].render(AT, outputs="B", spp_b=4, denoise_b="none").B.radiance
    assert np.median(np.abs(joined - apart).max(axis=-1)) < 1e-5
    assert np.mean(np.abs(joined - apart)) < 0.1 * np.mean(np.abs(bare - apart))


def test_a_body_of_ones_own_keeps_its_number():
    vehicles = [
        {
            "id": name,
            "cameras": [CAMERA],
            "trajectory": {"poses": [{"position": [x, 0, 1.2]}]},
            "body": {"kind": "boulder", "diameter": 0.3},
        }
        for name, x in (("0", 0), ("1", 0.8))
    ]
    content = scene().model_dump(exclude={"vehicle", "trajectory", "observer"}) | {"vehicles": vehicles}
    renderer, seen = images(scene_from_dict(content))
    keys = [row["key"] for row in renderer.segments]
    assert keys[:4] == ["terrain", "objects.0", "vehicles.0", "vehicles.1"]
    assert set(np.unique(seen.S.instance)) <= {0, *range(1, len(keys) + 1)}
    assert keys.index("objects.0") + 1 in seen.S.instance
    other = FrameRenderer(scene_from_dict(content | {"observer": "1"}), "cpu")
    places = [[group.T_w_o for group in each.parts if group.name.startswith("growth")] for each in (renderer, other)]
    assert all(np.array_equal(a, b) for a, b in zip(*places, strict=True)), "it stands alike whoever sees it"
