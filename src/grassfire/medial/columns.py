"""Dataclasses of arrays: one row an item."""

from __future__ import annotations

from dataclasses import Field
from typing import Any, ClassVar, Self

import numpy as np

from grassfire.medial.sites import BoolArray, FloatArray, IntArray


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
    """Numbers (n,) of rows given as (k, n) columns: equal for equal rows, from 0 in order."""
    order = np.lexsort(columns)
    step = np.any(np.diff(columns[:, order], axis=1) != 0, axis=0)
    number: IntArray = np.zeros(columns.shape[1], dtype=np.int64)
    number[order] = np.concatenate([[0], np.cumsum(step)])
    return number
