"""Roads: their layout, SUMO networks, lanes, markings and meshes, authored or imported."""
