"""The static stage of a scenario: road network, meshes, materials, bodies."""
