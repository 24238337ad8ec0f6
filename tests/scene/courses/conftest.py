"""What the tests of recorded courses share: a scene whose trajectory is a file, and that file."""

import pytest

from varos_warp.scene.courses.recorded import read_course
from varos_warp.scene.file.load import scene_from_dict


@pytest.fixture
def course(tmp_path):
    """Reads a text as a recorded course, with keys of the trajectory and the vehicle."""

    def read(text, vehicle=None, name="course.txt", **trajectory):
        data = text if isinstance(text, bytes) else text.encode()
        (tmp_path / name).write_bytes(data)
        scene = scene_from_dict({"trajectory": {"file": name, **trajectory}, "vehicle": vehicle or {}}, tmp_path)
        read_course(scene)
        return scene.trajectory.stops

    return read
