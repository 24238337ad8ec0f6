"""What is no pose is refused, and by the name of its argument."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import varos_warp as vw
from varos_warp.errors import InputError
from varos_warp.scene.file.load import scene_from_dict
from varos_warp.scene.frames import transform

PROPER = transform(Rotation.from_euler("xyz", [10, 20, 30], degrees=True).as_matrix(), [1.0, 2.0, 3.0])
MIRRORED = PROPER @ np.diag([-1.0, 1.0, 1.0, 1.0])
DOUBLED = PROPER @ np.diag([2.0, 2.0, 2.0, 1.0])
SHEARED = PROPER @ np.array([[1, 0.1, 0, 0], [0, np.sqrt(0.99), 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
IMPROPER = {
    "mirrored": (MIRRORED, "mirrors"),
    "doubled": (DOUBLED, "scale"),
    "sheared": (SHEARED, "right angles"),
    "not a number": (np.full((4, 4), np.nan), "not finite"),
    "infinite": (transform(None, [np.inf, 0, 0]), "not finite"),
    "3 x 4": (PROPER[:3], r"\(3, 4\)"),
    "rotation alone": (PROPER[:3, :3], r"\(3, 3\)"),
    "quaternion": ([1.0, 0.0, 0.0, 0.0], "quaternion"),
    "position and quaternion": ([0, 0, 0, 1, 0, 0, 0], "quaternion"),
    "two": (np.stack([PROPER, PROPER]), r"\(2, 4, 4\)"),
    "rows": (PROPER.T, "transpose"),
    "text": ("eye", "numbers"),
    "nothing": (None, "numbers"),
    "ragged": ([[1, 0], [0]], "numbers"),
    "complex": (PROPER.astype(complex), "numbers"),
    "truth values": (np.eye(4, dtype=bool), "numbers"),
    "library object": (Rotation.identity(), "numbers"),
}


@pytest.fixture(scope="module")
def renderer():
    scene = scene_from_dict(
        {
            "water": "none",
            "terrain": {"kind": "procedural", "size_m": 4, "resolution": 9},
            "vehicle": {
                "cameras": [{"id": "M0", "resolution": [16, 9], "exposure": {"readout_s": 0.02}}],
                "lights": [],
            },
            "trajectory": {"poses": [{"position": [0, 0, 2]}]},
        }
    )
    return vw.FrameRenderer(scene, "cpu")


@pytest.fixture(params=IMPROPER)
def improper(request):
    """No pose, and what is said of it."""
    return IMPROPER[request.param]


def refused(name, words, function, *arguments, **options):
    with pytest.raises(InputError, match=words) as caught:
        function(*arguments, **options)
    assert caught.value.key == name
    assert len(str(caught.value).splitlines()) == 1
    assert caught.value.remedy


def test_the_pose_of_the_vehicle(renderer, improper):
    pose, words = improper
    refused("T_w_v", words, renderer.render, pose, outputs="D")
    refused("T_w_v", words, renderer.rays, pose)
    refused("T_w_v", words, renderer.project, [[0.0, 5.0, 0.0]], pose)


def test_the_pose_at_the_next_frame(renderer, improper):
    pose, words = improper
    refused("following.T_w_v", words, renderer.render, PROPER, outputs="F", following=vw.NextFrame(pose))


@pytest.mark.parametrize("name", ["mirrored", "doubled", "sheared", "not a number", "rows"])
def test_a_pose_of_a_motion_is_told_by_its_number(renderer, name):
    pose, words = IMPROPER[name]

    def motion(offset_ns):
        return np.stack([PROPER] * (len(offset_ns) - 1) + [pose])

    refused("motion[8]", words, renderer.render, PROPER, outputs="D", motion=motion)
    refused(
        "following.motion[8]",
        words,
        renderer.render,
        PROPER,
        outputs="F",
        following=vw.NextFrame(PROPER, motion=motion),
    )


@pytest.mark.parametrize(
    ("poses", "words"),
    [
        (None, "numbers"),
        (PROPER, r"\(4, 4\), not \(9, 4, 4\)"),
        (np.stack([PROPER[:3]] * 9), r"\(9, 3, 4\)"),
        (PROPER[None], r"\(1, 4, 4\), not \(9, 4, 4\)"),
    ],
)
def test_what_a_motion_gives_instead_of_poses(renderer, poses, words):
    refused("motion", words, renderer.render, PROPER, outputs="D", motion=lambda _: poses)


@pytest.mark.parametrize("motion", [PROPER, "still"])
def test_a_motion_that_cannot_be_called(renderer, motion):
    refused("motion", "function", renderer.render, PROPER, outputs="D", motion=motion)


def test_poses_of_a_plan(renderer):
    refused("poses[1]", "mirrors", vw.plan_render, renderer.scene, renderer, [PROPER, MIRRORED])
    refused("poses", r"\(4, 4\), not \(N, 4, 4\)", vw.plan_render, renderer.scene, renderer, PROPER)
    refused("poses", "numbers", vw.plan_render, renderer.scene, renderer, None)


@pytest.mark.parametrize("name", ["rays", "project"])
def test_points_have_as_many_numbers_as_they_need(renderer, name):
    points, arguments = ([1.0, 2.0, 3.0, 4.0], (PROPER,))
    if name == "rays":
        refused("points", r"\[\.\.\., 2\]", renderer.rays, PROPER, None, points)
    else:
        refused("points", r"\[\.\.\., 3\]", renderer.project, points, *arguments)


def test_rounding_to_single_precision_and_lists_are_no_mistake(renderer):
    exact = renderer.render(PROPER, outputs="D").D.range
    for pose in (PROPER.astype(np.float32), PROPER.tolist(), np.round(PROPER, 6)):
        np.testing.assert_allclose(renderer.render(pose, outputs="D").D.range, exact, rtol=1e-4)
