"""A sea floor from photogrammetry (paper 3.1.1): join, merge, repair, crop, shrinkwrap, decimate; with a report."""

from varos_warp.scene.geometry.joining import crop, join, merge_near
from varos_warp.scene.geometry.mesh_files import write_ply
from varos_warp.scene.geometry.surface import Surface
from varos_warp.scene.geometry.terrain.closing import add_bottom, add_skirt
from varos_warp.scene.geometry.terrain.comparison import compare, mesh_facts, one_sided_distance
from varos_warp.scene.geometry.terrain.decimation import decimate
from varos_warp.scene.geometry.terrain.draping import drape, rasterise
from varos_warp.scene.geometry.terrain.pipeline import STEPS, Log, preprocess, preprocess_meshes
from varos_warp.scene.geometry.terrain.repair import clean, drop_not_finite, fill_holes, orient, suspicious_size
from varos_warp.scene.geometry.terrain.wrapping import is_height_field, is_sheet, shrinkwrap

__all__ = [
    "STEPS",
    "Log",
    "Surface",
    "add_bottom",
    "add_skirt",
    "clean",
    "compare",
    "crop",
    "decimate",
    "drape",
    "drop_not_finite",
    "fill_holes",
    "is_height_field",
    "is_sheet",
    "join",
    "merge_near",
    "mesh_facts",
    "one_sided_distance",
    "orient",
    "preprocess",
    "preprocess_meshes",
    "rasterise",
    "shrinkwrap",
    "suspicious_size",
    "write_ply",
]
