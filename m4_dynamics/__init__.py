"""Model-based analysis of wheeled-and-thrustered robots that balance on two wheels and climb (WAIR).

The public names are loaded on first use, so that `import m4_dynamics` stays light.
"""

from __future__ import annotations

import importlib
from typing import Any

__version__ = "0.1.0"

#: Public name -> module that defines it.
_PUBLIC: dict[str, str] = {}

__all__ = ["__version__", *_PUBLIC]


def __getattr__(name: str) -> Any:
    if name in _PUBLIC:
        return getattr(importlib.import_module(_PUBLIC[name]), name)
    raise AttributeError(f"module 'm4_dynamics' has no attribute '{name}'")


def __dir__() -> list[str]:
    return sorted(__all__)
