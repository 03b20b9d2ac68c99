"""Dataclasses of arrays: one row an item."""

from __future__ import annotations

from dataclasses import Field
from typing import Any, ClassVar, Self

import numpy as np

from grassfire.medial.sites import BoolArray, FloatArray, IntArray

_WEIGHTS = (2**0.5, 3**0.5)


class Columns:
    """Base of dataclasses whose fields are arrays of one length, or `Columns` again."""

    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]

    def take(self, index: IntArray | BoolArray | slice) -> Self:
        """Rows `index`."""
        columns = [getattr(self, name) for name in self.__dataclass_fields__]
        if isinstance(index, slice):
            return type(self)(
                *[
                    part.take(index) if isinstance(part, Columns) else part[index]
                    for part in columns
                ]
            )
        rows = index.nonzero()[0] if index.dtype == bool else index
        # Faster than indexing, which has to find out what the index is each time.
        return type(self)(
            *[
                part.take(rows) if isinstance(part, Columns) else part.take(rows, axis=0)
                for part in columns
            ]
        )

    @classmethod
    def join(cls, *parts: Self) -> Self:
        """All rows of all parts, of which there is at least one."""

        def rows(columns: list[Any]) -> Any:
            first = columns[0]
            return first.join(*columns) if isinstance(first, Columns) else np.concatenate(columns)

        return cls(
            *[rows([getattr(part, name) for part in parts]) for name in cls.__dataclass_fields__]
        )


def equal_rows(columns: FloatArray | IntArray) -> IntArray:
    """Numbers (n,) of rows given as (k, n) columns: equal for equal rows alone, from 0."""
    order, step = grouped(columns)
    number: IntArray = np.zeros(columns.shape[1], dtype=np.int64)
    number[order[1:]] = np.cumsum(step)
    return number


def grouped(columns: FloatArray | IntArray) -> tuple[IntArray, BoolArray]:
    """An order (n,) of rows given as (k, n) columns in which equal ones are neighbours, first come
    first, and whether rows differ from the one before, (n - 1,)."""
    # One sum of irrational multiples tells rows apart, but for those that rounding makes the same.
    key = columns[0].astype(np.float64)
    for column, weight in zip(columns[1:], _WEIGHTS, strict=False):
        key += weight * column
    order = key.argsort(kind="stable")
    key, step = key.take(order), _steps(columns, order)
    if len(columns) > len(_WEIGHTS) + 1 or np.any(step & (key[1:] == key[:-1])):
        order = np.lexsort(columns)
        step = _steps(columns, order)
    return order, step


def _steps(columns: FloatArray | IntArray, order: IntArray) -> BoolArray:
    """Whether rows in an order differ from the one before."""
    step = np.zeros(max(len(order) - 1, 0), dtype=bool)
    for column in columns:
        value = column.take(order)
        step |= value[1:] != value[:-1]
    return step
