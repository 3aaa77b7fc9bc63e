"""Bodies of actors: procedural shapes, rigged people, and converted 3-D models."""
