"""The shapes of the world: mesh files, terrain, parametric objects, copies, and questions to them."""
