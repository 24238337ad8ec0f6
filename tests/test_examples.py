"""Every scene that ships loads and renders, and together they show every block and key of scene files."""

import typing
from pathlib import Path

import numpy as np
import pytest
from pydantic import BaseModel

from varos_warp.render.renderer import FrameRenderer, NextFrame
from varos_warp.scene.angles import check_angles
from varos_warp.scene.description import Scene
from varos_warp.scene.description.lens import NoDistortion
from varos_warp.scene.description.placed import Parametric
from varos_warp.scene.description.surfaces import Layered
from varos_warp.scene.file.load import load_scene
from varos_warp.scene.file.templates import TEMPLATES
from varos_warp.scene.geometry.build import build_parts
from varos_warp.scene.optics.camera import camera_model, pixel_centres
from varos_warp.sim.trajectory import simulate

ROOT = Path(__file__).parents[1]
SHIPPED = [
    *sorted(path for path in (ROOT / "examples").rglob("*.yaml") if path.parent.name != "sweeps"),
    *(ROOT / "varos_warp" / "data" / f"{name}.yaml" for name in ("demo", "starter")),
    *sorted((ROOT / "varos_warp" / "data" / "templates").glob("*.yaml")),
]
SMALL = {
    "demo": ["terrain.resolution=65"],
    "starter": ["terrain.resolution=65"],
    "munkholmen": [
        "objects.1.bolted=false",
        "terrain.preprocess.shrinkwrap_resolution=65",
        *(f"scatter.{i}.count=3" for i in range(4)),
    ],
    "every_block": [
        "terrain.preprocess.shrinkwrap_resolution=33",
        "terrain.preprocess.target_vertices=800",
        "scatter.0.count=5",
    ],
    **{
        pattern: ["terrain.resolution=33"]
        for pattern in ("lawn_mower", "orbit", "spiral", "there_and_back", "hull_following")
    },
    **{
        survey: ["terrain.resolution=65", "scatter.0.count=3", "scatter.1.count=3"]
        for survey in ("pipeline_inspection", "stereo_survey", "kelp_reef")
    },
    "harbour_wall": [
        "terrain.resolution=65",
        "scatter.0.count=3",
        *(f"objects.{i}.{key}" for i in range(4) for key in ("length_m=3", "height_m=4", "fender_length_m=2")),
    ],
    "hull": [f"objects.{i}.length_m=5" for i in range(3)],
    "calibration": ["vehicle.cameras.0.port=null", "vehicle.cameras.1.port=null"],
    **{board: ["terrain.resolution=33"] for board in ("calibration_camera", "calibration_imu")},
    **{
        valve: ["terrain.resolution=65", "scatter.0.count=3", "objects.1.bolted=false"]
        for valve in ("static_observer", "turbid_water")
    },
    **{fleet: ["terrain.resolution=33"] for fleet in ("vehicles", "recorded")},
    **{survey: [] for survey in ("soundings", "height_map", "points")},
    "cameras": [
        "terrain.resolution=33",
        *(f"vehicle.cameras.{i}.calibration=null" for i in (0, 1)),
        *(f"vehicle.cameras.{i}.{key}=null" for i in (2, 3) for key in ("distortion", "intrinsics")),
        "vehicle.cameras.2.f_stop=0",
    ],
    "jerlov": [],
    "constituents": [],
    "files": [],
    "chart": ["terrain.resolution=33"],
    "poses": [
        "terrain.resolution=33",
        "scatter.0.count=3",
        "scatter.1.count=3",
        *(f"vehicle.cameras.{i}.{key}=null" for i in (1, 2) for key in ("port", "distortion", "n_water")),
    ],
}
"""What makes each scene cheap, by file or folder. No block goes but ports and distortion, for each of which kernels
would be compiled anew, and what says how many pixels there are: other tests render through them."""


def with_little_on_it(scene: Scene) -> list[str]:
    """Surfaces of few triangles, a tenth of what grows on them, scattered stones of two shapes at most.

    Most of the time goes into forming them, each shape anew.
    """
    objects = {f"objects.{i}": each for i, each in enumerate(scene.objects)}
    objects |= {f"scatter.{i}.object": each.object for i, each in enumerate(scene.scatter)}
    made = {key: each for key, each in objects.items() if isinstance(each, Parametric)}
    relief = [key for key, each in made.items() if isinstance(scene.materials.get(each.material or ""), Layered)]
    return [
        "render.max_triangles=6000",
        *(f"{key}.chord_error_m=0.05" for key in made),
        *(f"{key}.max_edge_m=0.2" for key in relief),  # else of squares of 5 cm
        *(f"scatter.{i}.shapes=2" for i, each in enumerate(scene.scatter) if (each.shapes or 1) > 2),
        *(f"growth.{i}.per_m2={0.1 * each.per_m2}" for i, each in enumerate(scene.growth) if each.per_m2),
    ]


def name_of(path: Path) -> str:
    return path.parent.name if path.stem == "scene" else path.stem


def test_every_shipped_camera_sees_through_its_lens_and_port():
    """Most pixels have a ray in the water, in all colours; the corners may miss the glass."""
    for scene in map(load_scene, SHIPPED):
        for camera in scene.vehicle.cameras:
            model = camera_model(camera)
            weight = [model.rays(pixel_centres(*camera.resolution), channel).weight for channel in range(3)]
            assert (np.min(weight, axis=0) > 0.0).mean() > 0.8, (scene.name, camera.id)


@pytest.mark.usefixtures("few_bodies")
@pytest.mark.parametrize("path", SHIPPED, ids=name_of)
def test_every_shipped_scene_renders(path):
    """First frame through every camera, all outputs: finite numbers, and none of the images is black."""
    shipped = load_scene(path)
    own, course = ("vehicles.0", "vehicles.0.trajectory") if shipped.vehicles else ("vehicle", "trajectory")
    small = [f"{own}.cameras.{i}.resolution=[16, 9]" for i in range(len(shipped.vehicle.cameras))]
    length = [f"{course}.duration_s=0.5"] * (name_of(path) not in TEMPLATES or not shipped.trajectory.duration_s)
    cheap = [*SMALL[name_of(path)], *small, *with_little_on_it(shipped), "render.integrator=path", *length]
    scene = load_scene(path, cheap)
    parts = build_parts(scene)
    simulation, renderer = simulate(scene, parts), FrameRenderer(scene, "cpu", parts)
    assert name_of(path) not in TEMPLATES or simulation.messages == []
    assert check_angles(scene) == []
    T_w_v, T_w_v_next = simulation.frames.T_w_v(0), simulation.trajectory.T_w_v(-1)
    for camera in scene.vehicle.cameras:
        frame = renderer.render(
            T_w_v,
            camera.id,
            "ABCDSF",
            following=NextFrame(T_w_v_next),
            spp=2,
            spp_b=2,
            denoise="none",
            denoise_b="none",
        )
        for image in (frame.A, frame.B):
            assert np.isfinite(image.radiance).all()
            assert image.radiance.shape == (9, 16, 3)
            assert (image.radiance.mean(axis=(0, 1)) > 1e-6).all()
        seen = np.isfinite(frame.D.depth)
        assert seen.mean() > 0.3
        assert (frame.D.depth[seen] > 0.0).all()
        np.testing.assert_allclose(np.linalg.norm(frame.C.normal[seen], axis=-1), 1.0, atol=1e-3)
        assert (frame.S.instance[seen] > 0).all()
        assert np.isfinite(frame.F.motion[seen]).all()


# ---------------------------------------------------------------------------------------------- every block is shown


def models_in(annotation) -> set[type[BaseModel]]:
    """Models that a type annotation mentions."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return {annotation}
    return set().union(*(models_in(inner) for inner in typing.get_args(annotation)))


def test_every_template_is_listed_and_the_listing_names_no_other():
    assert {path.stem for path in SHIPPED if path.parent.name == "templates"} | {"starter"} == set(TEMPLATES)


def every_model(model: type[BaseModel] = Scene, found: frozenset = frozenset()) -> frozenset[type[BaseModel]]:
    """A model, and those of its fields; deprecated ones aside."""
    if model in found:
        return found
    found |= {model}
    for field in (field for field in model.model_fields.values() if not field.deprecated):
        for inner in models_in(field.annotation):
            found = every_model(inner, found)
    return found - {NoDistortion}  # which examples show, too, but which is loaded as no block


def given(block) -> set[tuple[type, str]]:
    """(model, key) of everything that a file says, not what is there by default; with the models it inherits from."""
    if isinstance(block, list | tuple | dict):
        return set().union(*(given(item) for item in (block.values() if isinstance(block, dict) else block)))
    if not isinstance(block, BaseModel):
        return set()
    bases = [base for base in type(block).__mro__ if issubclass(base, BaseModel)]
    here = {(base, key) for base in bases for key in block.model_fields_set}
    return here.union(*(given(getattr(block, key)) for key in block.model_fields_set))


@pytest.fixture(scope="module")
def shown():
    return set().union(*(given(load_scene(path)) for path in SHIPPED))


def test_the_shipped_scenes_show_every_kind_of_block(shown):
    """A part of a mixture shows its phase function too."""
    assert [model.__name__ for model in every_model() if not any(shows is model for shows, _ in shown)] == []


def owner(model: type[BaseModel], key: str) -> type[BaseModel]:
    """The most basic model that has a key: every object has a position, one that shows it is enough."""
    return [base for base in model.__mro__ if key in getattr(base, "model_fields", ())][-1]


def test_the_shipped_scenes_show_every_key(shown):
    """Deprecated keys aside."""
    keys = {
        (owner(model, key), key)
        for model in every_model()
        for key, field in model.model_fields.items()
        if not field.deprecated
    }
    assert sorted(f"{model.__name__}.{key}" for model, key in keys - shown) == []
