"""Every error a caller may want to handle.

AdvercityError
├── InputError      what a person wrote is wrong: a declaration, a spec, an option (exit code 2)
└── RunError        a run failed: simulator, renderer, disk, machine (exit code 1)
    └── BackendError    a rendering backend is missing, broken or has no device
"""


class AdvercityError(Exception):
    """Base of all errors raised on purpose; its text is for the user, without a traceback."""


class InputError(AdvercityError):
    """What a person wrote is wrong; the text says where and what would be right."""


class RunError(AdvercityError):
    """Something failed while running; the text says what and what to try."""


class BackendError(RunError):
    """A rendering backend is missing, does not import, or finds no device."""
