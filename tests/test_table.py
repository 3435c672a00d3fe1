"""Tables of numbers from CSV files."""

import re

import numpy as np
import pytest

import cosserat_fem as cf
from cosserat_fem.table import read_table

COLUMNS = ("x", "y", "z")
ROWS = np.array([(1.0, 2.0, 3.0), (4.0, 5.0, 6.0)])


def read(tmp_path, text):
    file = tmp_path / "t.csv"
    file.write_bytes(text if isinstance(text, bytes) else text.encode())
    return read_table(file, COLUMNS, "table 't.csv'")


@pytest.mark.parametrize(
    "text",
    [
        "1,2,3\n4,5,6\n",
        "x,y,z\n1,2,3\n4,5,6\n",
        b"\xef\xbb\xbf1,2,3\r\n4,5,6\r\n",  # with a byte order mark, as spreadsheets write
        b"\xef\xbb\xbfx,y,z\n1,2,3\n4,5,6\n",
        "# route of today\n\n 1 , 2 , 3 # start\n,,\n4,5,6",
        "along,across,up\n1,2,3\n4,5,6\n",  # names that say nothing: the order counts
        "z,x,y\n3,1,2\n6,4,5\n",
        "Z [mm],X [mm],Y (mm)\n3,1,2\n6,4,5\n",
        "station,z,y,x\nA,3,2,1\nB,6,5,4\n",  # what is not wanted need not be a number
        '"x","y","z"\n"1","2","3"\n4,5,6\n',
    ],
)
def test_read(tmp_path, text):
    np.testing.assert_array_equal(read(tmp_path, text), ROWS)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1,2,O\n4,5,6\n", "table 't.csv', row 1: cell 3 (z) must be a finite number (got 'O')."),  # no header
        ("x,y,z\n1,2,3\n\n4,,6\n", "table 't.csv', row 4: cell 2 (y) must be a finite number (got '')."),
        ("1,2,3\n4,inf,6\n", "table 't.csv', row 2: cell 2 (y) must be a finite number (got 'inf')."),
        ("z,y,x\n1,2,3\n4,5,b\n", "table 't.csv', row 3: cell 3 (x) must be a finite number (got 'b')."),
        ("1,2,3,4\n", "table 't.csv', row 1: has 4 cells, not the 3 columns x, y, z."),
        ("1,2,3\n4,5\n", "table 't.csv', row 2: has 2 cells, not the 3 columns x, y, z."),
        ("1;2;3\n", "row 1: has 1 cell, not the 3 columns x, y, z. Separate cells by commas, not by semicolons."),
        ("1\t2\t3\n", "Separate cells by commas, not by tabs."),
        ("a,b\n1,2\n", "table 't.csv', row 1: has 2 cells, not the 3 columns x, y, z."),
        ("x,y,z,name\n1,2,3\n", "table 't.csv', row 2: has 3 cells, not the 4 cells of the header."),
        ("x,y,x,z\n1,2,3,4\n", "table 't.csv', row 1: the column 'x' is there twice."),
        (
            "y,x,up\n1,2,3\n",
            "row 1: cell 1 is 'y', but the column there is 'x'. Name all of x, y, z, or keep this order.",
        ),
        ("", "table 't.csv': holds no row of numbers; it needs the columns x, y, z."),
        ("x,y,z\n", "table 't.csv': holds no row of numbers; it needs the columns x, y, z."),
        (b"1,2,\xff\n", "table 't.csv' is not a text file in UTF-8."),
    ],
)
def test_faults(tmp_path, text, message):
    with pytest.raises(cf.MeshError, match=re.escape(message)):
        read(tmp_path, text)


def test_missing(tmp_path):
    with pytest.raises(cf.MeshError, match="table 'none' does not exist."):
        read_table(tmp_path / "none.csv", COLUMNS, "table 'none'")
    with pytest.raises(cf.MeshError, match="table 'folder' cannot be read: "):
        read_table(tmp_path, COLUMNS, "table 'folder'")
