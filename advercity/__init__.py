"""advercity: adverse-weather V2X driving data, compiled from YAML."""

__version__ = "0.1.0"
