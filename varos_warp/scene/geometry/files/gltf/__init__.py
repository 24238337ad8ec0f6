"""glTF 2.0: the document and its buffers, accessors, materials, and the nodes that place its meshes."""
