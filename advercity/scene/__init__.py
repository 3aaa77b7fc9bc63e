"""Static world of a scenario: ground, buildings, vegetation, roadside objects and bodies."""
