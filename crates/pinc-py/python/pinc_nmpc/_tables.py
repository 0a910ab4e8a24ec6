"""Tables: dictionaries of NumPy arrays by column, and the CSV files that they are written to."""

import csv
import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Union

import numpy as np

from ._errors import InputError

if TYPE_CHECKING:
    import pandas

Table = dict[str, np.ndarray]
FilePath = Union[str, "os.PathLike[str]"]


def read(path: Path) -> Table:
    """The table in a CSV file; an empty cell of numbers is NaN."""
    with open(path, newline="", encoding="utf-8") as file:
        rows = list(csv.reader(file))
    header, cells = rows[0], rows[1:]
    return {column: _column([row[i] for row in cells]) for i, column in enumerate(header)}


def frame(table: Mapping[str, Any]) -> "pandas.DataFrame":
    """A table as a data frame of pandas."""
    try:
        import pandas
    except ImportError as error:
        raise ImportError("frames need the package pandas: pip install pandas") from error
    return pandas.DataFrame(table)


def write(table: Any, path: Path, name: str) -> None:
    """Writes a table, or a data frame, as CSV; NaN is an empty cell. Errors call it ``name``."""
    columns = {str(name): _numbers(table[name]) for name in table}
    lengths = {column.shape for column in columns.values()}
    if len(lengths) != 1 or len(next(iter(lengths))) != 1:
        raise InputError(f"{name}: columns of the shapes {sorted(lengths)} given, expected one length")
    with open(path, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        writer.writerows(zip(*([_cell(value) for value in of.tolist()] for of in columns.values())))


def _numbers(column: Any) -> np.ndarray:
    """A column as an array; what is masked is missing."""
    if np.ma.isMaskedArray(column):
        return np.ma.filled(column.astype(float), np.nan)
    return np.asarray(column)


def _cell(value: Any) -> str:
    return "" if value is None or value != value else str(value)


def _column(cells: list[str]) -> np.ndarray:
    """The cells of a column as numbers, or as texts where they are none."""
    try:
        return np.array([float(cell) if cell else np.nan for cell in cells])
    except ValueError:
        return np.array(cells)
