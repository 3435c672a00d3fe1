"""How is a table of numbers read from a file? CSV, with or without a header.

Rule: the first row is a header only if none of its cells is a number. A header that holds all wanted names says which
columns they are; otherwise the columns are exactly the wanted ones, in their order. Nothing is guessed: every fault names
the file, the row (the line in the file) and the cell.
"""

from __future__ import annotations

import csv
import math
import os
import re
from collections.abc import Sequence

import numpy as np

from .errors import MeshError, one_line


def read_table(path: str | os.PathLike[str], columns: Sequence[str], where: str) -> np.ndarray:
    """Numbers (rows, columns) of a CSV file; blank rows and what follows a '#' are passed over.

    Parameters
    ----------
    columns : names of the wanted columns
    where : str
        How to call the file in messages.

    Raises
    ------
    MeshError
        The file cannot be read, has other columns, or a cell is not a finite number.
    """
    rows = _rows(path, where)
    pick, width = list(range(len(columns))), len(columns)
    if rows and not any(_is_number(cell) for cell in rows[0][1]):
        line, cells = rows.pop(0)
        names = [re.sub(r"\s*[\[(].*", "", cell).casefold() for cell in cells]  # "X [mm]" is x
        if set(columns) <= set(names):
            twice = [name for name in columns if names.count(name) > 1]
            if twice:
                raise MeshError(f"{where}, row {line}: the column {twice[0]!r} is there twice.")
            pick, width = [names.index(name) for name in columns], len(names)
        else:
            _check_width(cells, columns, width, f"{where}, row {line}")
            for k, name in enumerate(names):
                if name in columns and columns[k] != name:
                    raise MeshError(
                        f"{where}, row {line}: cell {k + 1} is {name!r}, but the column there is {columns[k]!r}. "
                        f"Name all of {', '.join(columns)}, or keep this order."
                    )
    if not rows:
        raise MeshError(f"{where}: holds no row of numbers; it needs the columns {', '.join(columns)}.")
    table = np.empty((len(rows), len(columns)))
    for k, (line, cells) in enumerate(rows):
        _check_width(cells, columns, width, f"{where}, row {line}")
        for j, column in enumerate(pick):
            if not _is_number(cells[column]) or not math.isfinite(float(cells[column])):
                raise MeshError(
                    f"{where}, row {line}: cell {column + 1} ({columns[j]}) must be a finite number "
                    f"(got {cells[column][:40]!r})."
                )
            table[k, j] = float(cells[column])
    return table


def read_header(path: str | os.PathLike[str], where: str) -> list[str]:
    """Names of the columns of a CSV file, in lower case and without units; MeshError if it has none."""
    rows = _rows(path, where)
    if not rows or any(_is_number(cell) for cell in rows[0][1]):
        raise MeshError(f"{where}: the first row must name the columns.")
    return [re.sub(r"\s*[\[(].*", "", cell).casefold() for cell in rows[0][1]]


def _rows(path: str | os.PathLike[str], where: str) -> list[tuple[int, list[str]]]:
    """Rows that hold something: their line in the file and their cells without blanks around them."""
    try:
        with open(path, newline="", encoding="utf-8-sig") as file:
            reader = csv.reader(line.split("#", 1)[0] for line in file)
            rows = [(reader.line_num, [cell.strip() for cell in row]) for row in reader]
    except FileNotFoundError:
        raise MeshError(f"{where} does not exist.") from None
    except OSError as error:
        raise MeshError(f"{where} cannot be read: {error.strerror}.") from None
    except UnicodeDecodeError:
        raise MeshError(f"{where} is not a text file in UTF-8.") from None
    except csv.Error as error:
        raise MeshError(f"{where} is not a table of numbers: {one_line(error)}.") from None
    return [(line, cells) for line, cells in rows if any(cells)]


def _check_width(cells: list[str], columns: Sequence[str], width: int, where: str) -> None:
    """Say what a row has too much or too little."""
    if len(cells) == width:
        return
    wanted = f"{width} columns {', '.join(columns)}" if width == len(columns) else f"{width} cells of the header"
    other = next((name for sign, name in ((";", "semicolons"), ("\t", "tabs")) if any(sign in c for c in cells)), "")
    hint = f" Separate cells by commas, not by {other}." if other else ""
    raise MeshError(f"{where}: has {len(cells)} cell{'s' * (len(cells) != 1)}, not the {wanted}.{hint}")


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
