"""Options of the test suite."""

from __future__ import annotations

import pytest
from hypothesis import settings

# examples are as slow as the machine is busy
settings.register_profile("steady", deadline=None)
settings.load_profile("steady")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--update-golden",
        action="store_true",
        help="write the golden programs anew instead of comparing with them",
    )
