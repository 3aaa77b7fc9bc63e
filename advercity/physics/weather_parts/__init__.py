"""The parts of the weather: a module each, with all that the part does to light and sensors."""
