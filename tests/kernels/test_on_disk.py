"""Warp finds a kernel on disk by a hash of its code, which must not depend on what a process made before."""

import pytest

from varos_warp.kernels.field.tabulate import tabulate_single_scattering
from varos_warp.kernels.spec import SceneSpec
from varos_warp.kernels.transport.ambient import make_ambient_kernel
from varos_warp.kernels.transport.camera_segment import make_camera_kernel
from varos_warp.kernels.transport.path import make_subpath_kernel
from varos_warp.kernels.transport.reference import make_reference_kernel
from varos_warp.kernels.world.optics import OpticsSpec

BENT = OpticsSpec("brown_conrady", "dome", dispersion=True)
RICHEST = SceneSpec(instances=True, field=True, camera_field=True, optics=BENT, varies=True)


def functions_of(kernel) -> dict:
    """All functions that a kernel calls, by their names."""
    found, unread = {}, [kernel]
    while unread:
        _, _, called = unread.pop().adj.get_references()
        more = {f.key: f for f in called if not f.is_builtin() and f.key not in found}
        found |= more
        unread += more.values()
    return found


@pytest.mark.parametrize(
    "make",
    [
        lambda: make_camera_kernel(RICHEST),
        lambda: make_subpath_kernel(RICHEST),
        lambda: make_reference_kernel(RICHEST),
        lambda: make_ambient_kernel(RICHEST),
        lambda: tabulate_single_scattering,
    ],
    ids=["camera", "subpaths", "reference", "ambient", "tabulate"],
)
def test_no_expression_is_evaluated_only_when_the_code_is_made(make):
    """`wp.static` of a loop's index is: the hash knows its values only once some kernel has been made with it."""
    functions = functions_of(make())
    assert len(functions) > 10
    assert {name for name, f in functions.items() if f.adj.has_unresolved_static_expressions} == set()
