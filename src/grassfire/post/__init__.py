"""Post processors: programs to the G-code of one controller.

A post is a TOML file in `post/` (see `definition.Post`) or an object that a package registers
under the entry point group `grassfire.posts`.
"""

from __future__ import annotations

import difflib
import tomllib
from dataclasses import replace
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Protocol, runtime_checkable

from pydantic import ValidationError

from ..errors import InputError
from ..tolerance import MACHINING
from ..toolpath import Program, Section
from .definition import Post
from .plain import render_plain_language
from .render import render_program

__all__ = [
    "Post",
    "PostProcessor",
    "find_posts",
    "load_post",
    "registered_posts",
    "render",
    "split_by_tool",
]

ENTRY_POINT_GROUP = "grassfire.posts"


@runtime_checkable
class PostProcessor(Protocol):
    """What a class registered under `grassfire.posts` offers; it is called without arguments."""

    name: str
    description: str
    extension: str

    def render(
        self,
        program: Program,
        *,
        clearance_height: float,
        tolerance: float,
        findings: list[str] | None,
    ) -> str:
        """Text of the program; see `grassfire.post.render`."""
        ...


def find_posts() -> dict[str, Path]:
    """Post definitions that come with the package, by name, in alphabetical order."""
    return {path.stem: path for path in sorted(_definitions().glob("*.toml"))}


def registered_posts() -> dict[str, EntryPoint]:
    """Posts that other packages register, by name; they come before definitions of that name."""
    found = entry_points(group=ENTRY_POINT_GROUP)
    return {point.name: point for point in sorted(found, key=lambda point: point.name)}


def load_post(name_or_path: str | Path, base_dir: Path | None = None) -> Post | PostProcessor:
    """Find and check a post.

    Parameters
    ----------
    name_or_path : str or Path
        A name of `registered_posts` or `find_posts`, or the path of a TOML file (it ends in
        `.toml` or holds a separator).
    base_dir : Path, optional
        Folder that a relative path starts from; the working directory by default.

    Raises
    ------
    InputError
        For unknown names (with the nearest known ones), unreadable files, unknown keys and values
        that do not fit.
    """
    text = str(name_or_path)
    if isinstance(name_or_path, Path) or text.endswith(".toml") or "/" in text or "\\" in text:
        return _read_definition((base_dir or Path()) / text)
    registered = registered_posts()
    if text in registered:
        return _load_registered(registered[text])
    posts = find_posts()
    if text not in posts:
        known = sorted({*posts, *registered})
        nearest = difflib.get_close_matches(text.lower(), known, n=3, cutoff=0.4) or known
        raise InputError(
            f"unknown post {text!r}", remedy="nearest known names: " + ", ".join(nearest)
        )
    return _read_definition(posts[text])


def render(
    program: Program,
    post: Post | PostProcessor,
    *,
    clearance_height: float,
    tolerance: float = MACHINING,
    findings: list[str] | None = None,
) -> str:
    """Write a program in a controller's G-code.

    Parameters
    ----------
    program : Program
        Sections whose tool paths begin with a rapid, at the clearance height or where the section
        before ended.
    post : Post or PostProcessor
    clearance_height : float
        z of the first move of the program, of every tool change and of the end, mm.
    tolerance : float
        How far a written arc, or the chord of one that cannot be written, may lie from the
        planned arc, mm.
    findings : list of str, optional
        Notes on what is written otherwise than planned are appended here.

    Returns
    -------
    str
        ASCII text with a newline after every line; the same for the same input. Every end is the
        planned one rounded to the post's decimals; both radii of every arc as written agree to
        the post's `radius_mismatch`.

    Raises
    ------
    InputError
        For what the controller cannot do: a coordinate system or coolant that it lacks, moves
        from unknown positions, without feed or spindle speed, arcs with two radii, rapids that
        move across and up or down at once below the clearance height, lines that are too long.
    """
    if isinstance(post, Post):
        write = render_plain_language if post.dialect == "plain-language" else render_program
        return write(
            program,
            post,
            clearance_height=clearance_height,
            tolerance=tolerance,
            findings=findings,
        )
    return post.render(
        program, clearance_height=clearance_height, tolerance=tolerance, findings=findings
    )


def split_by_tool(program: Program) -> tuple[Program, ...]:
    """One program for each run of sections with one tool, in the order of machining.

    They are named after the program, counted from 1: `bracket-1-T1`, `bracket-2-T4`. Each is
    complete: the position is not known where it begins.
    """
    runs: list[list[Section]] = []
    for section in program.sections:
        if not runs or runs[-1][-1].tool_number != section.tool_number:
            runs.append([])
        runs[-1].append(section)
    return tuple(
        replace(program, name=f"{program.name}-{count}-T{run[0].tool_number}", sections=tuple(run))
        for count, run in enumerate(runs, 1)
    )


def _definitions() -> Path:
    """`grassfire/_post` of an installed wheel, else `post/` of the source checkout."""
    package = Path(__file__).resolve().parents[1]
    installed = package / "_post"
    return installed if installed.is_dir() else package.parents[1] / "post"


def _read_definition(path: Path) -> Post:
    try:
        with path.open("rb") as stream:
            data = tomllib.load(stream)
    except OSError as error:
        raise InputError(
            f"post definition cannot be read: {error.strerror}", source=str(path)
        ) from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"not valid TOML: {error}", source=str(path)) from error
    try:
        return Post.model_validate(data)
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"]) or "post definition"
        unknown = first["type"] == "extra_forbidden"
        message = f"unknown key {key!r}" if unknown else f"{key}: {first['msg']}"
        raise InputError(message, source=str(path)) from error


def _load_registered(point: EntryPoint) -> PostProcessor:
    try:
        post = point.load()()
    except (ImportError, AttributeError, TypeError) as error:
        raise InputError(
            f"post {point.name!r} ({point.value}) cannot be loaded: {error}"
        ) from error
    if not isinstance(post, PostProcessor):
        raise InputError(
            f"post {point.name!r} ({point.value}) lacks name, description, extension or render"
        )
    return post
