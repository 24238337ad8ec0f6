"""Surfaces of the sea as functions of the vertices of a mesh: displacement, reflectance and silt.

`sites.py` says what a recipe is given and gives; a new one is a file here and its line in `registry.py`.
"""
