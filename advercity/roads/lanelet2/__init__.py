"""Import of Lanelet2 maps."""
