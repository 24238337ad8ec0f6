"""Factories of kernels, asked by several threads at once."""

import time
from concurrent.futures import ThreadPoolExecutor

from varos_warp.kernels.spec import SceneSpec, specialised


def test_threads_that_ask_at_once_get_one_kernel():
    made = []

    @specialised("masks")
    def make(spec):
        time.sleep(0.05)  # while others ask
        made.append(spec)
        return object()

    with ThreadPoolExecutor(4) as pool:
        found = set(pool.map(make, [SceneSpec(masks=True, disks=i) for i in range(4)]))
    assert made == [SceneSpec(masks=True)]
    assert len(found) == 1
