"""Fixtures that every test may use."""

from __future__ import annotations

import importlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings

# The same examples in every run: a suite that fails now and then is no help. Slow machines are no failure either.
settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.load_profile("repeatable")


@pytest.fixture(scope="session")
def require_peer() -> Callable[[str], Any]:
    """Import a package that only comparisons need.

    Where it is missing the test is skipped, so that a light installation can be tested; under CI=true that is a
    failure, or a comparison could go missing without anybody noticing.
    """

    def import_or_skip(name: str) -> Any:
        try:
            return importlib.import_module(name)
        except ImportError as error:
            reason = f"{name} is not installed ({error}); the extra 'peers' brings it"
            if os.environ.get("CI") == "true":
                pytest.fail(reason)
            pytest.skip(reason)

    return import_or_skip


@pytest.fixture(scope="session")
def example_robots() -> Path:
    """The folder of example-robot-data's robots, skipped or failed like a peer where it is missing."""
    from importlib import metadata

    try:
        distribution = metadata.distribution("example-robot-data")
    except metadata.PackageNotFoundError:
        reason = "example-robot-data is not installed; the extra 'peers' brings it"
        if os.environ.get("CI") == "true":
            pytest.fail(reason)
        pytest.skip(reason)
    return Path(str(distribution.locate_file("cmeel.prefix/share/example-robot-data/robots")))
