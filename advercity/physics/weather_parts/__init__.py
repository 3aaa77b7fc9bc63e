"""The parts of the weather: one module each, with all effects on light and sensors."""
