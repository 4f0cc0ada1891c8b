"""Import of the packages that the benchmarks compare with; they are an extra, not a requirement."""

from __future__ import annotations

import importlib
from types import ModuleType

from m4_dynamics.errors import M4Error

__all__ = ["PeerMissingError", "import_peer"]


class PeerMissingError(M4Error):
    """A package to compare with is not installed.

    Attributes:
        module: The module that could not be imported.
    """

    def __init__(self, module: str, reason: str) -> None:
        self.module = module
        super().__init__(
            f"cannot compare with '{module}': {reason}; it comes with the extra 'peers', as in "
            "pip install 'm4_dynamics[peers]'"
        )


def import_peer(module: str) -> ModuleType:
    """Import a module of a package in the extra `peers`.

    Args:
        module: Dotted name, such as "pydrake.multibody.plant".

    Returns:
        The module.

    Raises:
        PeerMissingError: If it cannot be imported; says why and what to install.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise PeerMissingError(module, str(error)) from error
