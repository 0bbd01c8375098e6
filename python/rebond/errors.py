"""Exceptions of the package.

Each has the message of the command, on one line and with the arguments of functions in place of
options, and its exit code.
"""


class Error(Exception):
    """Everything that can go wrong in the package."""

    #: Exit code of the command ``rebond`` for such an error.
    exit_code = 130


class SceneError(Error, ValueError):
    """Scene or mesh that is invalid, or a structure without a unique solution."""

    exit_code = 2


class UsageError(Error, ValueError):
    """Call that does not fit the scene, or that the program refuses."""

    exit_code = 2


class MemoryLimitError(Error, MemoryError):
    """Work that needs more memory than is left."""

    exit_code = 2


class SolverError(Error, ArithmeticError):
    """Step whose solution does not meet the tolerance, or is not finite."""

    exit_code = 3


class FileError(Error, OSError):
    """File or folder that cannot be read or written."""

    exit_code = 4


class EnergyError(Error, ArithmeticError):
    """Energy above the limit of the guard."""

    exit_code = 5


class InternalError(Error, RuntimeError):
    """Defect of the program; please report it."""

    exit_code = 101
