"""Relief is exact at vertices, converges between them, keeps meshes closed, and gives the same bytes again."""

import numpy as np
import pytest
import trimesh

from varos_warp.scene.description.surfaces import Layered
from varos_warp.scene.description.world import Diffuse
from varos_warp.scene.geometry.parts import Part
from varos_warp.scene.geometry.procedural import grid_mesh
from varos_warp.scene.geometry.relief import form
from varos_warp.scene.geometry.surface import Surface
from varos_warp.scene.geometry.topology import edge_uses

A, K = 0.01, 20.0
"""Amplitude [m] and wavenumber [1/m] of waves."""
LOOK = Layered(kind="layered", relief="rock")


class Waves:
    """h = a sin(k x), all of it coarse; grey."""

    by_vertex = True

    def coarse(self, sites, look):
        return A * np.sin(K * sites.p[:, 0])

    def fine(self, sites, look):
        return np.zeros(len(sites.p))

    def colour(self, sites, shape, look):
        return np.full((len(sites.p), 3), 0.2), np.zeros(len(sites.p))


@pytest.fixture(autouse=True)
def waves(monkeypatch):
    monkeypatch.setitem(form.RECIPES, "rock", Waves())


def plane():
    x = np.linspace(-0.5, 0.5, 5)
    vertices, faces = grid_mesh(x, x, np.zeros((5, 5)))
    return Part("objects.0", vertices, faces, Diffuse())


def made(part, edge):
    return form.formed(form.base_of(part), LOOK, lambda points, normals: np.full(len(points), edge), None)


def test_heights_at_vertices_are_those_of_the_recipe():
    """To the rounding of float32, in which they are kept."""
    v = made(plane(), 0.05)["vertices"].astype(float)
    np.testing.assert_allclose(v[:, 2], A * np.sin(K * v[:, 0]), atol=1e-7)


def test_the_surface_between_vertices_converges_with_the_square_of_the_edge():
    """Chords of a sine are off by at most a k^2 e^2 / 8; half the edge, a quarter of the error."""
    x = np.random.default_rng(0).uniform(-0.45, 0.45, (4000, 2))
    off = []
    for edge in (0.08, 0.04, 0.02):
        mesh = made(plane(), edge)
        surface = Surface(mesh["vertices"].astype(float), mesh["faces"])
        t = surface.distances(np.column_stack([x, np.full(len(x), 1.0)]), np.broadcast_to([0.0, 0, -1], (len(x), 3)))
        off.append(np.abs(1.0 - t - A * np.sin(K * x[:, 0])).max())
        assert off[-1] < A * K**2 * edge**2 / 8.0 * 1.02
    assert np.array(off[:-1]) / off[1:] == pytest.approx(4.0, rel=0.35)


def test_normals_converge_to_those_of_the_waves():
    """Away from the outline, where half of the faces are missing."""
    off = []
    for edge in (0.04, 0.02):
        mesh = made(plane(), edge)
        v, n = mesh["vertices"].astype(float), mesh["normals"].astype(float)
        inside = np.abs(v[:, :2]).max(axis=1) < 0.45
        slope = A * K * np.cos(K * v[:, 0])
        true = np.column_stack([-slope, np.zeros(len(v)), np.ones(len(v))]) / np.sqrt(1.0 + slope**2)[:, None]
        off.append(np.sqrt(np.square(n - true)[inside].sum(axis=1).mean()))
    assert off[0] / off[1] > 1.8  # first order where neighbours are uneven, second on even grids
    assert off[1] < 0.02


def test_a_steep_bank_is_of_the_sediment_of_the_level_ground_below_it():
    def banked(points):
        gap = np.linalg.norm(points[:, :2], axis=1)
        return gap, 2.0 * np.clip(0.3 - gap, 0.0, None)  # 63 degrees

    looks = [Layered(kind="layered", relief="sand", steep=steep) for steep in (None, "rock")]
    sand, both = (
        form.formed(form.base_of(plane()), look, lambda points, normals: np.full(len(points), 0.05), banked)
        for look in looks
    )
    assert (sand["vertices"] == both["vertices"]).all()
    assert (sand["colours"] == both["colours"]).all()


def test_what_is_closed_stays_closed():
    ball = trimesh.creation.icosphere(subdivisions=2)
    mesh = made(Part("objects.0", np.array(ball.vertices), np.array(ball.faces, np.int32), Diffuse()), 0.05)
    once, often = edge_uses(mesh["faces"])
    assert len(once) == len(often) == 0
    assert trimesh.Trimesh(mesh["vertices"], mesh["faces"], process=False).volume > 4.0


def test_hollows_do_not_cross_themselves():
    """Outwards into a gutter of radius 2 cm no place moves by more than 0.4 of that."""
    t = np.linspace(-np.pi, 0.0, 41)
    x, y = np.meshgrid(0.02 * np.cos(t), np.linspace(0, 0.2, 21))
    z = np.broadcast_to(0.02 * np.sin(t), x.shape)
    number = np.arange(x.size).reshape(x.shape)
    a, b, c, d = number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]
    faces = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    vertices = np.stack([x, y, z], -1).reshape(-1, 3)
    normals = form.vertex_normals(vertices, faces)
    h = form._bounded(np.full(len(vertices), 1.0), vertices, normals, form.neighbours_of(len(vertices), faces))
    inside = (np.abs(vertices[:, 0]) < 0.018) & (np.abs(vertices[:, 1] - 0.1) < 0.09)
    assert h[inside] == pytest.approx(0.4 * 0.02, rel=0.05)


def test_the_same_surface_again_has_the_same_bytes():
    one, two = made(plane(), 0.05), made(plane(), 0.05)
    assert all(one[key].tobytes() == two[key].tobytes() for key in one)


def test_sharp_edges_stay_where_they_are_and_smooth_ones_are_rounded():
    box = trimesh.creation.box()
    part = Part("objects.0", np.array(box.vertices), np.array(box.faces, np.int32), Diffuse(), smooth_shading=True)
    assert not form.base_of(part).normals.any()
    ball = trimesh.creation.icosphere(subdivisions=3)
    part = Part("objects.0", np.array(ball.vertices), np.array(ball.faces, np.int32), Diffuse(), smooth_shading=True)
    base = form.base_of(part)
    assert np.einsum("ij,ij->i", base.normals, base.vertices) == pytest.approx(1.0, abs=1e-3)


class Inwards(Waves):
    """Everything 10 cm inwards."""

    def coarse(self, sites, look):
        return np.full(len(sites.p), -0.1)


def slab(thickness):
    box = trimesh.creation.box((1.0, 1.0, thickness))
    return Part("objects.0", np.array(box.vertices), np.array(box.faces, np.int32), Diffuse())


def test_a_thin_slab_keeps_a_third_of_its_thickness(monkeypatch):
    """From both sides the form takes a third of 5 cm at most."""
    monkeypatch.setitem(form.RECIPES, "rock", Inwards())
    mesh = made(slab(0.05), 0.05)
    v = mesh["vertices"].astype(float)
    inside = np.abs(v[:, :2]).max(axis=1) < 0.3
    assert np.abs(v[inside, 2]) == pytest.approx(0.05 / 6.0, abs=1e-5)
    assert mesh["held"] > 0.5
    assert mesh["thinnest"] == pytest.approx(0.05, rel=1e-3)


def test_a_thick_slab_is_moved_as_far_as_its_recipe_says(monkeypatch):
    monkeypatch.setitem(form.RECIPES, "rock", Inwards())
    mesh = made(slab(0.5), 0.05)
    v = mesh["vertices"].astype(float)
    inside = np.abs(v[:, :2]).max(axis=1) < 0.3
    assert np.abs(v[inside, 2]) == pytest.approx(0.15, abs=1e-6)
    assert mesh["held"] == 0.0


def test_no_part_is_thinner_than_nothing(monkeypatch):
    """A face that float32 meets edge on has its plane behind the ray: such a thickness would push relief outwards."""
    behind = np.array([[-0.005, 1.0, -1.0], [-0.005, -1.0, 1.0], [-0.005, 1.0, 1.0]])
    surface = Surface(behind, np.array([[0, 1, 2]], np.int32))
    monkeypatch.setattr(surface, "first_hits", lambda points, _: (np.zeros(len(points), np.int32), None))
    along = np.array([[1.0, 0.0, 0.0]])
    assert surface.distances(np.zeros((1, 3)), along) < 0.0, "the case is as it was found"
    assert form._thickness(surface, np.zeros((1, 3)), along) > 0.0
