"""What light meets: cameras, lights, the medium, phase functions, surfaces, textures, and the rays between them."""
