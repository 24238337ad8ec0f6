"""Formats that are not read, and what to do about them: the remedy names a way to a format that is."""

from varos_warp.scene.description.survey import ENDINGS

BLENDER = "Convert it in Blender: File > Import, then File > Export > glTF 2.0 (.glb)"
CAD = "Export it from the CAD program, or from FreeCAD, as STL or OBJ in metres"
POINTS = "Convert it to LAS, such as with CloudCompare or `pdal translate`, for terrain: {kind: heights}"
RASTER = "Convert it to GeoTIFF, such as with `gdal_translate IN OUT.tif`, for terrain: {kind: heights}"
SONAR = "Grid it first, such as with MB-System's mbgrid or QPS Qimera, and export a GeoTIFF"
VECTOR = "Contours and vectors are no surface: grid them first, such as with `gdal_grid` or QGIS, and export a GeoTIFF"
MESHES = "Convert it to PLY, such as with MeshLab, ParaView or meshio"
PICTURE = "A picture is no mesh; heights in grey are read from PNG and TIFF files"
ARCHIVE = "Unpack it first"
HEIGHTS = "Heights are a terrain: give terrain: {kind: heights, file: ...}"

REMEDIES = {
    ending: remedy
    for remedy, endings in (
        ("Open it in Blender and export it: File > Export > glTF 2.0 (.glb)", ".blend .blend1"),
        (BLENDER, ".fbx .3ds .abc .usd .usda .usdc .usdz .x3d .wrl .vrml .lwo .vrm"),
        (
            "Export it from the program that made it as glTF 2.0 (.glb)",
            ".max .ma .mb .c4d .skp .hip .ztl .uasset .prefab",
        ),
        (
            CAD,
            ".step .stp .iges .igs .brep .sldprt .sldasm .ipt .iam .3dm .dwg .dxf .fcstd .catpart .catproduct .prt "
            ".sat .x_t .jt .ifc .3mf .amf",
        ),
        (POINTS, ".e57 .pcd .pts .ptx .copc .rcp .rcs .fls .zfs .spz .splat"),
        (
            RASTER,
            ".bag .nc .nc4 .cdf .grd .netcdf .h5 .hdf .hdf5 .vrt .img .dem .bil .flt .hgt .adf .dt0 .dt1 .dt2 .csar "
            ".gtx .jp2 .ecw .sid .mbtiles",
        ),
        (SONAR, ".all .kmall .s7k .gsf .xtf .jsf .hsx .mb88 .mb56"),
        (VECTOR, ".shp .gpkg .kml .kmz .geojson .gml .000"),
        (MESHES, ".vtk .vtp .vtu .msh .mesh .inp .ctm .drc"),
        (PICTURE, ".jpg .jpeg .exr .bmp .webp .gif .hdr .tga .psd"),
        (ARCHIVE, ".zip .gz .7z .rar .tar .bz2 .xz"),
        ("Save one array of heights with numpy.save, for terrain: {kind: heights}", ".npz"),
        (HEIGHTS, " ".join(ENDINGS)),
    )
    for ending in endings.split()
}


def remedy_for(ending: str, known: tuple[str, ...]) -> str:
    """Tell what to do about a file whose ending is not one of those that are known."""
    return f"{REMEDIES.get(ending.lower(), 'Export it in another format')}. Meshes are {', '.join(known)}."
