"""More samples than their numbers can count are refused before anything is rendered."""

import pytest
from standins import scene_dict

from varos_warp.errors import InputError
from varos_warp.render.options import RenderOptions
from varos_warp.scene.description.render import MOST_SPP
from varos_warp.scene.file.load import scene_from_dict


@pytest.mark.parametrize("key", ["spp", "spp_b"])
def test_more_samples_than_can_be_counted_are_refused(key, tmp_path):
    with pytest.raises(InputError, match=key):
        scene_from_dict(scene_dict(render={key: MOST_SPP + 1}), tmp_path)
    with pytest.raises(InputError, match="must be at most"):
        RenderOptions(**{key: MOST_SPP + 1})
    assert getattr(scene_from_dict(scene_dict(render={key: MOST_SPP}), tmp_path).render, key) == MOST_SPP
