"""What any step of a solution may raise."""


class UnsolvableError(ValueError):
    """A conflict that does not fit a road after all; the message says why."""
