"""Files for the cells of the table of docs/meshes.md; importing these modules registers them."""
