"""The exceptions of the package."""


class PincError(Exception):
    """An error of this package."""


class InputError(PincError, ValueError):
    """Something given cannot be used: a config, a file, an argument. The message says where, what
    was found and what was expected."""


class RunError(PincError, RuntimeError):
    """A training or a run failed."""


for _error in (PincError, InputError, RunError):
    _error.__module__ = "pinc_nmpc"
