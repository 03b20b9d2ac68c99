"""Errors that carry what a user needs: the file, the place in it and the remedy."""

from __future__ import annotations

from collections.abc import Sequence


class GrassfireError(Exception):
    """Base of all errors that the package raises on purpose.

    Parameters
    ----------
    message : str
        What is wrong, one line.
    source : str, optional
        The file (or object) that it was found in.
    place : sequence of float or str, optional
        Where in it: coordinates in mm, a DXF handle, a key's path.
    remedy : str, optional
        What to do about it.
    """

    exit_code = 2

    def __init__(
        self,
        message: str,
        *,
        source: str | None = None,
        place: Sequence[float] | str | None = None,
        remedy: str | None = None,
    ) -> None:
        self.message = message
        self.source = source
        self.place = place
        self.remedy = remedy
        super().__init__(str(self))

    def __str__(self) -> str:
        parts = [self.message]
        if self.place is not None:
            if isinstance(self.place, str):
                parts.append(f"at {self.place}")
            else:
                parts.append("at (" + ", ".join(f"{value:.6g}" for value in self.place) + ")")
        text = " ".join(parts)
        if self.source:
            text = f"{self.source}: {text}"
        if self.remedy:
            text = f"{text}; {self.remedy}"
        return " ".join(text.split())


class InputError(GrassfireError):
    """A file, a job key or an argument that cannot be used (exit code 2)."""


class GeometryError(GrassfireError):
    """A region that cannot be processed, or an answer that cannot be certified (exit code 2)."""


class PlanningError(GrassfireError):
    """A pocket that cannot be machined as asked, e.g. no tool position exists (exit code 2)."""


class VerificationError(GrassfireError):
    """The machined text differs from what was asked (exit code 1)."""

    exit_code = 1
