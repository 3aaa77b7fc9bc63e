"""Path tracing on Mitsuba's ray-tracing kernels, for machines without a graphics card, too."""

from advercity_mitsuba.backend import MitsubaBackend

__all__ = ["MitsubaBackend"]
