"""Readers of mesh files, one for each format, which all give a `MeshFile`; docs/meshes.md says what each reads."""
