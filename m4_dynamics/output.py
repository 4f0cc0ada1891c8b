"""Result files appear whole or not at all: they are written beside their place and renamed into it."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from m4_dynamics.errors import ResultFileError

__all__ = ["replacing"]


@contextmanager
def replacing(path: Path | str) -> Iterator[Path]:
    """Yield a temporary path beside the result and rename it into place when the block ends well.

    Args:
        path: Where the result shall be; its folder must exist.

    Yields:
        A path in the same folder, to be written by the caller.

    Raises:
        ResultFileError: The folder is missing or the file cannot be written.
    """
    target = Path(path)
    if not target.parent.is_dir():
        raise ResultFileError(f"cannot write {target}: the folder {target.parent} does not exist")
    # The suffix stays last, since libraries choose the format by it; the process id keeps two writers apart.
    partial = target.with_name(f".{target.stem}.{os.getpid()}{target.suffix}")
    try:
        yield partial
        partial.replace(target)
    except OSError as error:
        raise ResultFileError(f"cannot write {target}: {error.strerror or error}") from error
    finally:
        partial.unlink(missing_ok=True)
