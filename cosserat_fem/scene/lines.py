"""On which line of a TOML file does a value stand?

Rule: the file was already read without fault by the TOML parser; this scanner only finds places, so it may be simple. It
records the line of every table, key, array entry and inline table entry under its path, for example
("rod", 0, "points", 3, 1). `line_of` falls back to the nearest enclosing entry that is known.
"""

from __future__ import annotations

import json

Path = tuple[str | int, ...]


class Lines:
    """Lines of a TOML text by path."""

    def __init__(self, text: str) -> None:
        self._text, self._at, self._line = text, 0, 1
        self.lines: dict[Path, int] = {(): 1}
        self._counts: dict[Path, int] = {}
        self._scan()

    def line_of(self, path: Path) -> int:
        """Line of the value at a path, or of the closest thing around it."""
        for n in range(len(path), -1, -1):
            if path[:n] in self.lines:
                return self.lines[path[:n]]
        return 1

    # The scanner proper: a cursor over the text, one method for each construct.

    def _peek(self) -> str:
        return self._text[self._at] if self._at < len(self._text) else ""

    def _next(self) -> str:
        char = self._peek()
        self._at += 1
        self._line += char == "\n"
        return char

    def _skip(self, *, newlines: bool = True) -> None:
        """Past blanks and comments."""
        while (char := self._peek()) and (char in " \t\r" or (char == "\n" and newlines) or char == "#"):
            if char == "#":
                while self._peek() not in ("\n", ""):
                    self._next()
            else:
                self._next()

    def _scan(self) -> None:
        table: Path = ()
        while True:
            self._skip()
            if not self._peek():
                return
            if self._peek() == "[":
                table = self._header()
            else:
                self._entry(table)

    def _header(self) -> Path:
        """[a.b] or [[a.b]]; entries under an array of tables carry its last number."""
        line = self._line
        self._next()
        many = self._peek() == "["
        if many:
            self._next()
        keys = self._keys("]")
        self._next()
        if many and self._peek() == "]":
            self._next()
        path: Path = ()
        for k, key in enumerate(keys):
            path += (key,)
            if many and k == len(keys) - 1:
                self.lines.setdefault(path, line)
                number = self._counts.get(path, -1) + 1
                self._counts[path] = number
                path += (number,)
            elif path in self._counts:
                path += (self._counts[path],)
        self.lines[path] = line
        return path

    def _keys(self, end: str) -> list[str]:
        """A dotted key up to (not past) one of the characters in `end`."""
        keys, word = [], ""
        while (char := self._peek()) and char not in end:
            if char in "\"'":
                word = self._string()
                if char == '"' and "\\" in word:
                    word = _unescaped(word)
            elif char == ".":
                keys.append(word.strip())
                word = ""
                self._next()
            else:
                word += self._next()
        keys.append(word.strip())
        return keys

    def _entry(self, table: Path) -> None:
        """key = value"""
        line = self._line
        path = table
        for key in self._keys("="):
            path += (key,)
            self.lines.setdefault(path, line)
        self._next()
        self._value(path)

    def _value(self, path: Path) -> None:
        self._skip(newlines=False)
        char = self._peek()
        if char in ("[", "{"):
            self._next()
            self._items(path, "]" if char == "[" else "}")
        elif char in "\"'" and char:
            self._string()
        else:
            while self._peek() and self._peek() not in ",]}\n#":
                self._next()

    def _items(self, path: Path, end: str) -> None:
        """Entries of an array or inline table, up to and past its end."""
        number = 0
        while True:
            self._skip()
            char = self._peek()
            if char in (end, ""):
                self._next()
                return
            if char == ",":
                self._next()
            elif end == "]":
                self.lines[(*path, number)] = self._line
                self._value((*path, number))
                number += 1
            else:
                self._entry(path)

    def _string(self) -> str:
        """Past a string of any of the four kinds; return its text."""
        quote = self._next()
        if self._peek() == quote:  # an empty string, or the start of a long one
            self._next()
            if self._peek() != quote:
                return ""
            self._next()
            quote *= 3
        start = self._at
        while self._peek():
            if self._text.startswith(quote, self._at):
                text = self._text[start : self._at]
                for _ in quote:
                    self._next()
                return text
            if quote[0] == '"' and self._peek() == "\\":
                self._next()
            self._next()
        return self._text[start:]


def _unescaped(text: str) -> str:
    """A quoted key with its escapes resolved; JSON's are TOML's but for two that nobody puts into a key."""
    try:
        return str(json.loads(f'"{text}"'))
    except ValueError:
        return text
