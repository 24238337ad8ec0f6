"""What the world is: the scene file, its meshes, materials and water, and their copy on the device."""
