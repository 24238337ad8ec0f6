"""Relief: form as geometry, refined until its edges are about two pixels of the nearest camera."""
